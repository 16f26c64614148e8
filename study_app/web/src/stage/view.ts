/** The participant's window, looked at before and in every attempt: size, ratio of pixels, full screen. */
import type { Disturbance } from "../kernel/attempt";
import type { BrowserWindow, WebStudy } from "../kernel/formats";
import { showsAll } from "../kernel/window";
import { scaleFor } from "./gate";
import { button, lineOf, showParts } from "./note";
import { filled, type Words } from "./words";

/** Time between two looks at a window that lacks something. */
const LOOK_MS = 250;

export class View {
  /** Screen pixels per pixel of a stimulus. */
  private scale = 1;
  private keeps_scale = false;
  /** The browser gives the full screen, so that who left it is asked back. */
  private gives_full = false;
  private seen = glance();

  constructor(
    private readonly canvas: HTMLCanvasElement,
    private readonly pages: HTMLElement,
    private readonly study: WebStudy,
    private readonly words: Words,
  ) {}

  /** From now on the scale stays, so that zooming the page changes nothing of what is shown. */
  keepScale(): void {
    this.keeps_scale = true;
  }

  /** The window, once it lacks nothing; until then the page says what, and waits for a press. */
  async fitting(): Promise<BrowserWindow> {
    for (;;) {
      const now = await this.look();
      const lack = this.lackOf(now);
      if (lack === null) return now;
      await this.pressed(lack);
      if (!(await fillScreen())) this.gives_full = false; // not any more
    }
  }

  /** Change since the last look, by what is cheap to compare at each flip. */
  changed(): Disturbance | null {
    const now = glance();
    if (this.seen.full && !now.full) return "full-screen";
    const same = Object.entries(now).every(([name, value]) => this.seen[name as keyof typeof now] === value);
    return same ? null : "size";
  }

  private async look(): Promise<BrowserWindow> {
    const window_px = await cover(this.canvas);
    this.seen = glance();
    const { full, ratio } = this.seen;
    this.gives_full ||= full;
    if (!this.keeps_scale) this.scale = Math.max(1, scaleFor(this.study.window_px, window_px, ratio));
    return { window_px, device_pixel_ratio: ratio, scale: this.scale, full_screen: full };
  }

  /** Lack of a window, in words. */
  private lackOf(now: BrowserWindow): string | null {
    const { study, words } = this;
    if (this.seen.zoom !== 1) return words.zoomed;
    if (!showsAll(now, study.window_px)) {
      const [width, height] = study.window_px.map((of_px) => now.scale * of_px);
      const got = now.window_px.join(" x ");
      return filled(words.window, { width: width ?? 0, height: height ?? 0, got });
    }
    return this.gives_full && !now.full_screen ? words.fullScreen : null;
  }

  /** Say what is wrong, and whether it still is, until the participant presses the button. */
  private async pressed(lack: string): Promise<void> {
    const text = lineOf(lack);
    const press = new Promise<true>((resolve) => {
      const next = button(this.gives_full ? this.words.resume : this.words.next, "next", () => {
        resolve(true);
      });
      showParts(this.pages, "window", text, next);
      next.focus();
    });
    for (;;) {
      const waited = new Promise<false>((resolve) => setTimeout(resolve, LOOK_MS, false));
      if (await Promise.race([press, waited])) return;
      text.textContent = this.lackOf(await this.look()) ?? this.words.fits;
    }
  }
}

/** The window by what costs nothing to ask. `zoom` is that of two fingers, which enlarges pixels. */
function glance(): { width: number; height: number; ratio: number; zoom: number; full: boolean } {
  return {
    width: innerWidth,
    height: innerHeight,
    ratio: devicePixelRatio,
    zoom: visualViewport?.scale ?? 1,
    full: document.fullscreenElement !== null,
  };
}

/** Give the canvas as many pixels as the screen has under it; return them. */
export async function cover(canvas: HTMLCanvasElement): Promise<[number, number]> {
  const size = await new Promise<[number, number]>((resolve) => {
    const observer = new ResizeObserver(([entry]) => {
      const box = entry?.devicePixelContentBoxSize[0];
      if (!box) return;
      observer.disconnect();
      resolve([box.inlineSize, box.blockSize]);
    });
    try {
      observer.observe(canvas, { box: "device-pixel-content-box" });
    } catch {
      // Safari does not tell it.
      const { clientWidth, clientHeight } = canvas;
      resolve([Math.round(devicePixelRatio * clientWidth), Math.round(devicePixelRatio * clientHeight)]);
    }
  });
  [canvas.width, canvas.height] = size;
  return size;
}

/** Ask for the full screen; true if it is there. */
export async function fillScreen(): Promise<boolean> {
  if (document.fullscreenElement) return true;
  try {
    await document.documentElement.requestFullscreen({ navigationUI: "hide" });
    return true;
  } catch {
    return false; // refused, or no browser of such: the window stays as it is, and the lines say so
  }
}
