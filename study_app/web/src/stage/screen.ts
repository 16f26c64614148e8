/** The participant's screen: one canvas over the whole viewport, in whole pixels; keys, pointer,
 * pages of text, and what comes between participant and page.
 */
import type { AttemptRun, Disturbance, Press } from "../kernel/attempt";
import type { Page, PageResult, Stage } from "../kernel/conduct";
import type { WebStudy } from "../kernel/formats";
import type { PlannedTrial } from "../kernel/plan";
import { POINTER } from "../kernel/script";
import type { Files } from "./files";
import { keyName } from "./keys";
import { button, lineOf, showNote, showParts } from "./note";
import { painterOf, type Painter } from "./painter";
import { fillScreen, type View } from "./view";
import type { Words } from "./words";

/** Time after which a participant who waits for pictures is told why. */
const SLOW_MS = 5000;

export class Screen implements Stage {
  readonly painter: Painter;
  private presses: Press[] = [];
  private between: Disturbance | null = null;
  private watching = false;
  private readonly opened_ms = performance.now();
  private readonly opening = crypto.getRandomValues(new Uint32Array(1))[0] ?? 0;

  constructor(
    readonly canvas: HTMLCanvasElement,
    private readonly pages: HTMLElement,
    private readonly study: WebStudy,
    private readonly files: Files,
    private readonly words: Words,
    private readonly view: View,
    private readonly scale: number,
    pictures: ReadonlyMap<string, ImageBitmap>,
  ) {
    this.painter = painterOf(canvas, { background: study.background, scale, pictures });
    this.painter.resize(canvas.width, canvas.height);
    addEventListener("keydown", (event) => {
      this.down(event);
    });
    canvas.addEventListener("pointerdown", (event) => {
      this.pointed(event);
    });
    const disturbs = (from: EventTarget, event: string, what: Disturbance, is = () => true) => {
      from.addEventListener(event, () => {
        if (this.watching && is()) this.between ??= what;
      });
    };
    disturbs(window, "blur", "focus");
    disturbs(document, "visibilitychange", "hidden", () => document.hidden);
    disturbs(document, "fullscreenchange", "full-screen", () => !document.fullscreenElement);
    disturbs(window, "resize", "size");
  }

  /** Stamps of a line: times, and the opening of the page, drawn by chance. */
  stamps(): { t_s: number; at: string; opening: number } {
    const t_s = Math.round((performance.now() - this.opened_ms) * 1e3) / 1e6;
    return { t_s, at: new Date().toISOString(), opening: this.opening };
  }

  async prepare(trial: PlannedTrial, next: PlannedTrial | null): Promise<string | null> {
    const later = next?.stimuli ?? [];
    this.files.keep([...trial.stimuli, ...later]);
    const began_ms = performance.now();
    let waits: "wait" | "slow" = "wait";
    const tell = () => {
      showNote(this.pages, this.words[this.files.down ? "down" : waits]);
    };
    const slow = setTimeout(() => {
      waits = "slow";
      tell();
    }, SLOW_MS);
    this.files.heard = tell;
    tell();
    const loading = Promise.all(trial.stimuli.map((name) => this.files.frames(name)));
    const frames = await loading.finally(() => {
      clearTimeout(slow);
      this.files.heard = () => undefined; // fetched beside a trial, they are no news
    });
    const waited_ms = performance.now() - began_ms;
    // Fetched a trial ahead; what goes wrong is told when its trial comes.
    later.forEach((name) => void this.files.frames(name).catch(() => undefined));
    this.painter.hold(frames);
    if (waited_ms < SLOW_MS) return null;
    return `the stimuli of ${trial.id} came after ${Math.round(waited_ms / 1000)} s`;
  }

  async attempt(run: AttemptRun): Promise<void> {
    run.window = await this.view.fitting();
    this.painter.resize(...run.window.window_px);
    this.presses = [];
    this.between = null;
    this.watching = true;
    this.pages.hidden = true;
    this.painter.paint(null);
    return new Promise<void>((resolve, reject) => {
      let drawn = false;
      const frame = (now_ms: number) => {
        try {
          if (drawn) this.flipped(run, now_ms);
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
    }).finally(() => {
      this.watching = false;
      delete this.canvas.dataset["phase"];
      this.canvas.style.cursor = "default";
    });
  }

  async page(page: Page): Promise<PageResult> {
    const result = await showPage(this.pages, page, this.study, this.words);
    if (!result.leaves) await fillScreen(); // a key or click just asked
    return result;
  }

  /** Note a flip: the picture of the last callback is on the screen from this one on. */
  private flipped(run: AttemptRun, now_ms: number): void {
    const presses = this.presses;
    this.presses = [];
    const disturbed = this.between ?? this.view.changed();
    this.between = null;
    run.flipped(this.clock_us(now_ms), presses, disturbed);
  }

  private clock_us(stamp_ms: number): number {
    return Math.max(0, Math.round((stamp_ms - this.opened_ms) * 1e3));
  }

  private down(event: KeyboardEvent): void {
    if (!this.watching) return;
    const key = keyName(event);
    if (key) event.preventDefault();
    if (key && !event.repeat) {
      this.presses.push({ key, at_us: this.clock_us(event.timeStamp), x: null });
    }
  }

  private pointed(event: PointerEvent): void {
    if (!this.watching) return;
    const ratio = this.canvas.width / this.canvas.clientWidth;
    const [width] = this.study.screen_px;
    const from_middle = event.clientX * ratio - Math.floor(this.canvas.width / 2);
    const share = from_middle / (this.scale * width) + 0.5;
    const x = Math.min(Math.max(share, 0), 1);
    this.presses.push({ key: POINTER, at_us: this.clock_us(event.timeStamp), x });
  }
}

function showPage(
  element: HTMLElement,
  page: Page,
  study: WebStudy,
  words: Words,
): Promise<PageResult> {
  const began_ms = performance.now();
  const texts = page.text.split("\n").map((line) => lineOf(line));
  const field = page.question ? answerField(page.question.choices, page.draft) : null;
  const labels: Partial<Record<string, string>> = { consent: words.agree, quit: words.stay };
  return new Promise((resolve) => {
    const next = button(labels[page.name] ?? words.next, "next", () => {
      end(false);
    });
    const leave = button(words.leave, "leave", () => {
      end(true);
    });
    const buttons = document.createElement("nav");
    buttons.append(next, leave);
    const bar = page.done_share > 0 ? [doneBar(page.done_share)] : [];
    const fields = field ? [field.element] : [];
    showParts(element, page.name, ...bar, ...texts, ...fields, buttons);
    (field?.first ?? next).focus();
    const waits_ms = page.least_s * 1000;
    next.disabled = waits_ms > 0;
    const timer = setTimeout(() => {
      next.disabled = false;
      if (!field) next.focus();
    }, waits_ms);
    const end = (leaves: boolean) => {
      if (!leaves && (next.disabled || (field && !field.value()))) return;
      clearTimeout(timer);
      removeEventListener("keydown", down);
      element.hidden = true;
      element.replaceChildren();
      const duration_s = Math.round((performance.now() - began_ms) * 1e3) / 1e6;
      resolve({ leaves, answer: field?.value() ?? "", duration_s });
    };
    const down = (event: KeyboardEvent) => {
      const typing = event.target instanceof HTMLTextAreaElement;
      const key = keyName(event);
      if (event.repeat || typing) return;
      if (study.quit_keys.includes(key)) end(true);
      else if (study.continue_keys.includes(key)) end(false);
      else return;
      event.preventDefault();
    };
    addEventListener("keydown", down);
  });
}

function doneBar(share: number): HTMLProgressElement {
  const made = document.createElement("progress");
  made.value = share;
  return made;
}

interface Field {
  readonly element: HTMLElement;
  readonly first: HTMLElement;
  value(): string;
}

/** Field in which an answer is typed, or one of several is chosen. */
function answerField(choices: readonly string[], draft: string): Field {
  if (!choices.length) {
    const text = document.createElement("textarea");
    text.dir = "auto";
    text.maxLength = 20_000;
    text.value = draft;
    return { element: text, first: text, value: () => text.value.trim() };
  }
  const list = document.createElement("fieldset");
  const options = choices.map((choice) => {
    const label = document.createElement("label");
    const option = document.createElement("input");
    Object.assign(option, { type: "radio", name: "choice", checked: choice === draft });
    label.append(option, lineOf(choice, "span"));
    list.append(label);
    return option;
  });
  const value = () => choices[options.findIndex((option) => option.checked)] ?? "";
  return { element: list, first: options[0] ?? list, value };
}
