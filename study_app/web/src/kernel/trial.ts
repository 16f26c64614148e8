/** One attempt at a trial, as `study_app/trial.py` defines it: a pure state machine, counted in
 * refreshes. No clock, screen or keyboard is read here, and no gaze is watched in a browser.
 */
import type { ShownPicture, WebPhase } from "./formats";
import { at } from "./list";
import { afterAnswer, questionsOf, STUDY_QUESTION, type Interrupt, type TrialScript, type VoidReason } from "./script";

/** Observations up to one flip. */
export interface Observed {
  /** Refreshes since the flip before: 1 in time, more where some were missed. */
  readonly refreshes: number;
  readonly answer: string | null;
  readonly interrupt: Interrupt | null;
}

/** An attempt: what the next flip shows, and how it ended once it has. */
export interface Trial {
  readonly phase: number;
  /** Refreshes of this phase before the next flip. */
  readonly frames: number;
  readonly dropped: number;
  /** To the study's own question. */
  readonly answer: string | null;
  /** To all others, in the order in which they were asked. */
  readonly further: readonly string[];
  readonly completed: boolean;
  readonly void_reason: VoidReason | null;
}

export const BEGIN: Trial = {
  phase: 0,
  frames: 0,
  dropped: 0,
  answer: null,
  further: [],
  completed: false,
  void_reason: null,
};

/** True if every phase is over. */
export function isDone(trial: Trial, script: TrialScript): boolean {
  return trial.phase === script.phases.length;
}

/** True if the outcome is fixed; feedback and blank may still be running. */
export function isOver(trial: Trial): boolean {
  return trial.completed || trial.void_reason !== null;
}

/** The picture that says how the attempt stands, where the next flip shows one. */
export function follows(trial: Trial, script: TrialScript): ShownPicture | null {
  const told = at(script.phases, trial.phase).follows;
  const judged = trial.completed && script.correct !== null;
  const answered = trial.answer === script.correct ? "right" : "wrong";
  const stands = [trial.void_reason, judged ? answered : null];
  for (const name of stands) {
    const picture = name === null ? undefined : told[name];
    if (picture) return picture;
  }
  return null;
}

/** The trial after one more flip. A flip that comes late shortens nothing. */
export function advance(trial: Trial, observed: Observed, script: TrialScript): Trial {
  if (isDone(trial, script)) throw new Error("the trial is done; start a new one");
  const phase = at(script.phases, trial.phase);
  // The first flip of a phase is its onset, however late it came.
  const step = trial.frames === 0 ? 1 : observed.refreshes;
  if (isOver(trial)) return lasted(trial, step, phase);
  if (observed.interrupt !== null) return voided(trial, observed.interrupt, script);
  const now = countDropped(trial, observed, script);
  if (now.dropped > script.dropped_max) return voided(now, "dropped-frames", script);
  if (phase.question !== null) return asked(now, observed.answer, step, phase, script);
  return lasted(now, step, phase);
}

/** Go on by so many refreshes, to the next phase where this one has had its length. */
function lasted(trial: Trial, step: number, phase: WebPhase): Trial {
  const frames = trial.frames + step;
  const over = phase.frames !== null && frames >= phase.frames;
  return over ? { ...trial, phase: trial.phase + 1, frames: 0 } : { ...trial, frames };
}

/** Take an answer, and go on behind the last phase that asks for it; or wait for one. */
function asked(
  trial: Trial,
  answer: string | null,
  step: number,
  phase: WebPhase,
  script: TrialScript,
): Trial {
  const after = afterAnswer(script, trial.phase);
  if (answer !== null && phase.question?.answers.includes(answer)) {
    const own = phase.question.name === STUDY_QUESTION;
    const told = own ? { answer } : { further: [...trial.further, answer] };
    const given = 1 + Number(trial.answer !== null) + trial.further.length;
    return { ...trial, phase: after, frames: 0, completed: given === questionsOf(script), ...told };
  }
  const frames = trial.frames + step;
  const ends = phase.frames !== null && frames >= phase.frames && after === trial.phase + 1;
  const late = phase.timeout_frames !== null && frames >= phase.timeout_frames;
  return ends || late ? voided(trial, "too-late", script) : lasted(trial, step, phase);
}

function voided(trial: Trial, reason: VoidReason, script: TrialScript): Trial {
  return { ...trial, phase: script.phases.length - 1, frames: 0, void_reason: reason };
}

/** Count the missed refreshes that kept a picture of a watched phase on the screen. */
function countDropped(trial: Trial, observed: Observed, script: TrialScript): Trial {
  const kept = trial.frames ? trial.phase : trial.phase - 1;
  if (observed.refreshes <= 1 || !script.phases[kept]?.watched) return trial;
  return { ...trial, dropped: trial.dropped + observed.refreshes - 1 };
}
