/** One attempt, flip by flip, as `study_app/attempt.py` defines it; and the log of what was
 * observed, from which Python runs it again.
 */
import type { AttemptLine, BrowserWindow, Press as ReadPress, ScriptQuestion, ShownPicture, WebPhase } from "./formats";
import { at } from "./list";
import { Pacer } from "./pacing";
import { answerOf, type Interrupt, type TrialScript } from "./script";
import { advance, BEGIN, follows, isDone, isOver, type Trial } from "./trial";

/** Observations of an attempt: a press and a disturbance say after which flip. */
export type AttemptLog = Pick<AttemptLine, "flips_us" | "presses" | "disturbed" | "window" | "poses">;
export type Disturbance = NonNullable<AttemptLine["disturbed"]>[1];

/** A key that went down, or the pointer. */
export type Press = Omit<ReadPress, "flip">;

/** Picture of the next flip. */
export interface Shown {
  readonly phase: WebPhase;
  readonly refreshes: number;
  /** Notice of how the attempt stands, drawn first. */
  readonly notice: ShownPicture | null;
}

export class AttemptRun {
  state: Trial = BEGIN;
  /** Pause and quit keys, also those during the blank at the end. */
  readonly interrupts: Interrupt[] = [];
  /** The window as the attempt began; a stage that has one says it. */
  window: BrowserWindow | null = null;
  /** Poses of the head so far, as a line has them; a headset gives them. */
  poses: (() => string) | null = null;
  private readonly pacer: Pacer;
  private readonly stamps_us: number[] = [];
  private readonly presses: ReadPress[] = [];
  private disturbed: [number, Disturbance] | null = null;
  private asked: ScriptQuestion | null = null;
  private onset_us = 0;
  private written = false;

  /** `onOutcome` is called once, after the first flip of the blank at the end: the time to write. */
  constructor(
    private readonly script: TrialScript,
    refresh_hz: number,
    private readonly onOutcome: (run: AttemptRun) => void,
  ) {
    this.pacer = new Pacer(refresh_hz);
  }

  get done(): boolean {
    return isDone(this.state, this.script);
  }

  /** True if the outcome is known, and has been shown. */
  get over(): boolean {
    return isOver(this.state);
  }

  /** True if the participant's answer is awaited, so that a click may give it. */
  get asks(): boolean {
    return !this.over && at(this.script.phases, this.state.phase).question?.pointer === true;
  }

  shows(): Shown {
    const phase = at(this.script.phases, this.state.phase);
    return { phase, refreshes: this.state.frames, notice: follows(this.state, this.script) };
  }

  /** The flip that showed `shows()` came at `t_us`; then these keys were read. */
  flipped(t_us: number, presses: readonly Press[], disturbed: Disturbance | null): void {
    const phase = at(this.script.phases, this.state.phase);
    const number = this.stamps_us.push(t_us) - 1;
    const refreshes = this.pacer.flip(t_us / 1e6);
    if (phase.question?.name !== this.asked?.name) {
      this.asked = phase.question;
      this.onset_us = t_us;
    }
    if (this.state.phase === this.script.phases.length - 1 && !this.written) {
      this.written = true;
      this.onOutcome(this);
    }
    this.presses.push(...presses.map((press) => ({ ...press, flip: number })));
    const [answer, key] = this.read(presses);
    let interrupt = key;
    if (disturbed && !interrupt && !this.over) {
      interrupt = "focus-lost";
      this.disturbed = [number, disturbed];
    }
    if (key) this.interrupts.push(key);
    const observed = { refreshes: number ? refreshes : 1, answer, interrupt };
    this.state = advance(this.state, observed, this.script);
  }

  /** All that was observed so far. */
  log(): AttemptLog {
    const since = this.stamps_us.map((t_us, flip) => t_us - (this.stamps_us[flip - 1] ?? 0));
    const { disturbed, window } = this;
    return { flips_us: since, presses: [...this.presses], disturbed, window, poses: this.poses?.() ?? null };
  }

  /** The answer, where one is awaited, and the wish to pause or quit. */
  private read(presses: readonly Press[]): [answer: string | null, interrupt: Interrupt | null] {
    const question = at(this.script.phases, this.state.phase).question;
    let answer: string | null = null;
    let interrupt: Interrupt | null = null;
    for (const { key, at_us, x } of presses) {
      if (this.script.quit_keys.includes(key)) interrupt = "quit";
      else if (this.script.pause_keys.includes(key)) interrupt ??= "paused";
      else if (answer === null && at_us >= this.onset_us && !this.over && question) {
        answer = answerOf(question, key, x ?? 0);
      }
    }
    return [answer, interrupt];
  }
}
