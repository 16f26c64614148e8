/** Common parts of screen and headset: clocks, stimuli, and what is noted during an attempt. */
import type { AttemptRun, Disturbance, Press } from "../kernel/attempt";
import type { Page, PageResult, Stage } from "../kernel/conduct";
import type { PlannedTrial } from "../kernel/plan";
import type { Files } from "./files";
import type { Words } from "./words";

/** Time after which a participant who waits for pictures is told why. */
const SLOW_MS = 5000;

export abstract class Observing implements Stage {
  /** True during an attempt. */
  protected watching = false;
  private presses: Press[] = [];
  private between: Disturbance | null = null;
  private readonly opened_ms = performance.now();
  private readonly opening = crypto.getRandomValues(new Uint32Array(1))[0] ?? 0;

  constructor(
    protected readonly files: Files,
    protected readonly words: Words,
  ) {}

  abstract attempt(run: AttemptRun): Promise<void>;
  abstract page(page: Page): Promise<PageResult>;
  /** Say why nothing is shown. */
  protected abstract waits(why: string): void;
  /** Make the frames of a trial's stimuli ready. */
  protected abstract hold(frames: readonly (readonly ImageBitmap[])[]): void;

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
      this.waits(this.words[this.files.down ? "down" : waits]);
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
    this.hold(frames);
    if (waited_ms < SLOW_MS) return null;
    return `the stimuli of ${trial.id} came after ${Math.round(waited_ms / 1000)} s`;
  }

  /** Note what happens until an attempt is over. */
  protected async watched(attempt: Promise<void>): Promise<void> {
    this.presses = [];
    this.between = null;
    this.watching = true;
    return attempt.finally(() => {
      this.watching = false;
    });
  }

  /** Presses and disturbance since the flip before; where there was none, what `look` finds. */
  protected observed(look: () => Disturbance | null): [Press[], Disturbance | null] {
    const { presses } = this;
    const disturbed = this.between ?? look();
    this.presses = [];
    this.between = null;
    return [presses, disturbed];
  }

  protected pressed(key: string, stamp_ms: number, x: number | null = null): void {
    if (this.watching) this.presses.push({ key, at_us: this.clock_us(stamp_ms), x });
  }

  /** Note an event of the browser that comes between participant and page. */
  protected disturbs(from: EventTarget, event: string, what: Disturbance, is: (told: Event) => boolean = () => true): void {
    from.addEventListener(event, (told) => {
      if (this.watching && is(told)) this.between ??= what;
    });
  }

  protected clock_us(stamp_ms: number): number {
    return Math.max(0, Math.round((stamp_ms - this.opened_ms) * 1e3));
  }
}
