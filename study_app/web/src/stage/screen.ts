/** The participant's screen: one canvas over the whole viewport, in whole pixels; keys, pointer,
 * pages of text, and what comes between participant and page.
 */
import type { AttemptRun } from "../kernel/attempt";
import type { Page, PageResult } from "../kernel/conduct";
import type { WebStudy } from "../kernel/formats";
import { POINTER } from "../kernel/script";
import type { Device, On, Opened } from "./device";
import type { Files } from "./files";
import { checkKeys, checkPhone, machineOf, measuredRate, nearestRate } from "./gate";
import { keyName } from "./keys";
import { showNote } from "./note";
import { Observing } from "./observing";
import { showPage } from "./pages";
import { painterOf, type Painter } from "./painter";
import { fillScreen, View } from "./view";
import { wordsOf, type Words } from "./words";

/** The screen as a device on which a study runs. */
export const screenDevice: Device = {
  words: wordsOf,
  told: () => ({ keys: null, before: [] }),
  async check(study, words, pages) {
    checkPhone(words);
    await checkKeys(study, words, pages);
  },
  open,
};

async function open({ canvas, pages, study, files, words }: On): Promise<Opened> {
  await fillScreen();
  const view = new View(canvas, pages, study, words);
  const { full_screen } = await view.fitting();
  showNote(pages, ...(full_screen ? [] : [words.noFullScreen]), words.measuring);
  const measured = await measuredRate(requestAnimationFrame);
  const rate = nearestRate(study, words, measured.refresh_hz);
  const pictures = await files.pictures();
  const shown = await view.fitting();
  view.keepScale();
  const stage = new Screen(canvas, pages, study, files, words, view, shown.scale, pictures);
  return { stage, rate, machine: machineOf(measured, shown) };
}

class Screen extends Observing {
  readonly painter: Painter;

  constructor(
    readonly canvas: HTMLCanvasElement,
    private readonly pages: HTMLElement,
    private readonly study: WebStudy,
    files: Files,
    words: Words,
    private readonly view: View,
    private readonly scale: number,
    pictures: ReadonlyMap<string, ImageBitmap>,
  ) {
    super(files, words);
    this.painter = painterOf(canvas, { background: study.background, scale, pictures });
    this.painter.resize(canvas.width, canvas.height);
    addEventListener("keydown", (event) => {
      this.down(event);
    });
    canvas.addEventListener("pointerdown", (event) => {
      this.pointed(event);
    });
    this.disturbs(window, "blur", "focus");
    this.disturbs(document, "visibilitychange", "hidden", () => document.hidden);
    this.disturbs(document, "fullscreenchange", "full-screen", () => !document.fullscreenElement);
    this.disturbs(window, "resize", "size");
  }

  async attempt(run: AttemptRun): Promise<void> {
    run.window = await this.view.fitting();
    this.painter.resize(...run.window.window_px);
    this.pages.hidden = true;
    this.painter.paint(null);
    return this.watched(
      new Promise<void>((resolve, reject) => {
        let drawn = false;
        const frame = (now_ms: number) => {
          try {
            if (drawn) run.flipped(this.clock_us(now_ms), ...this.observed(() => this.view.changed()));
            if (run.done) {
              this.painter.paint(null);
              resolve();
              return;
            }
            const shown = run.shows();
            this.painter.paint(shown);
            this.canvas.dataset["phase"] = shown.phase.name; // for whoever drives the page
            this.canvas.style.cursor = run.asks ? "default" : "none";
            drawn = true;
            requestAnimationFrame(frame);
          } catch (error) {
            reject(error instanceof Error ? error : new Error(String(error)));
          }
        };
        requestAnimationFrame(frame);
      }),
    ).finally(() => {
      delete this.canvas.dataset["phase"];
      this.canvas.style.cursor = "default";
    });
  }

  async page(page: Page): Promise<PageResult> {
    const result = await showPage(this.pages, page, this.study, this.words);
    if (!result.leaves) await fillScreen(); // a key or click just asked
    return result;
  }

  protected waits(why: string): void {
    showNote(this.pages, why);
  }

  protected hold(frames: readonly (readonly ImageBitmap[])[]): void {
    this.painter.hold(frames);
  }

  private down(event: KeyboardEvent): void {
    if (!this.watching) return;
    const key = keyName(event);
    if (key) event.preventDefault();
    if (key && !event.repeat) this.pressed(key, event.timeStamp);
  }

  private pointed(event: PointerEvent): void {
    if (!this.watching) return;
    const ratio = this.canvas.width / this.canvas.clientWidth;
    const [width] = this.study.screen_px;
    const from_middle = event.clientX * ratio - Math.floor(this.canvas.width / 2);
    const share = from_middle / (this.scale * width) + 0.5;
    this.pressed(POINTER, event.timeStamp, Math.min(Math.max(share, 0), 1));
  }
}
