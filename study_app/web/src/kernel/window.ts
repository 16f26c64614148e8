/** The part of a study that a window shows, as `protocols/browser/browser_window.py` defines it. */
import type { BrowserWindow } from "./formats";

/** True if a window shows so many pixels of a study, each as large as its scale says. */
export function showsAll(window: BrowserWindow, need_px: readonly [number, number]): boolean {
  return need_px.every((of_px, edge) => (window.window_px[edge] ?? 0) >= window.scale * of_px);
}
