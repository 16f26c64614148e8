/** A trial as data that a stage can draw: the part of `protocols/script.py` that the browser needs. */

export interface Frames {
  readonly kind: "frames";
  readonly stimulus: number;
  /** Refreshes that each frame stands for. 0: the first one stays. */
  readonly every: number;
  readonly last: number;
  /** Of the upper left corner: pixels right of and below the screen's middle. */
  readonly at: readonly [number, number];
  readonly crop: readonly [number, number, number, number] | null;
}

/** A stimulus drawn to the gaze. The browser watches none: an export with one is refused. */
export interface Live {
  readonly kind: "live";
  readonly stimulus: number;
  readonly at: readonly [number, number];
}

export interface Picture {
  readonly kind: "picture";
  /** Name of its file among the study's pictures. */
  readonly of: string;
  readonly at: readonly [number, number];
}

export interface Fill {
  readonly kind: "fill";
  readonly rect: readonly [number, number, number, number];
  readonly grey: number;
}

export type Entry = Frames | Live | Picture | Fill;

export interface Question {
  readonly name: string;
  readonly answers: readonly string[];
  readonly keys: readonly (readonly string[])[];
  readonly pointer: boolean;
}

export type Interrupt = "paused" | "quit" | "focus-lost";
export type VoidReason =
  | Interrupt
  | "gaze-break"
  | "data-loss"
  | "no-fixation"
  | "too-late"
  | "dropped-frames";
export type Outcome = VoidReason | "warned" | "right" | "wrong";

export interface ScriptPhase {
  readonly name: string;
  /** Refreshes that it lasts. Null: until an answer ends it. */
  readonly frames: number | null;
  readonly show: readonly Entry[];
  readonly gate_frames: number | null;
  readonly watched: boolean;
  readonly question: Question | null;
  readonly timeout_frames: number | null;
  readonly follows: Readonly<Partial<Record<Outcome, Picture>>>;
}

export interface TrialScript {
  readonly phases: readonly ScriptPhase[];
  readonly correct: string | null;
  readonly gaze: "enforce" | "warn" | "monitor" | "none";
  readonly dropped_max: number;
  readonly pause_keys: readonly string[];
  readonly quit_keys: readonly string[];
}

/** The study's own question. */
export const STUDY_QUESTION = "answer";
/** The key name of a click or touch. */
export const POINTER = "pointer";

/** Index of the frame that is shown after so many refreshes of the phase. */
export function frameOf(entry: Frames, refreshes: number): number {
  return entry.every ? Math.min(Math.floor(refreshes / entry.every), entry.last) : 0;
}

/** The answer that a key gives; `x` is where the pointer pressed, as a share of the width. */
export function answerOf(question: Question, key: string, x = 0): string | null {
  const { answers, keys } = question;
  if (key === POINTER) {
    const place = Math.min(Math.max(Math.trunc(x * answers.length), 0), answers.length - 1);
    return question.pointer ? (answers[place] ?? null) : null;
  }
  return answers[keys.findIndex((of) => of.includes(key))] ?? null;
}

/** The phase that follows on an answer in phase `index`. */
export function afterAnswer(script: TrialScript, index: number): number {
  const name = script.phases[index]?.question?.name;
  const next = script.phases.findIndex((phase, i) => i > index && phase.question?.name !== name);
  return next < 0 ? index + 1 : next;
}

/** Number of questions asked. */
export function questionsOf(script: TrialScript): number {
  return new Set(script.phases.flatMap(({ question }) => (question ? [question.name] : []))).size;
}
