/** A trial as data that a stage can draw: the part of `protocols/script.py` that the browser needs. */
import type { AttemptLine, Frames, RefreshRate, ScriptQuestion, WebPhase, WebStudy } from "./formats";
import type { PlannedTrial } from "./plan";

export type VoidReason = NonNullable<AttemptLine["void_reason"]>;
export type Interrupt = Extract<VoidReason, "paused" | "quit" | "focus-lost">;

export interface TrialScript extends Pick<WebStudy, "dropped_max" | "pause_keys" | "quit_keys"> {
  readonly phases: readonly WebPhase[];
  readonly correct: string | null;
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
export function answerOf(question: ScriptQuestion, key: string, x = 0): string | null {
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

/** The script of a trial at one of the study's refresh rates. */
export function scriptOf(
  study: WebStudy,
  rate: RefreshRate,
  language: string,
  trial: PlannedTrial,
): TrialScript {
  const practice = trial.role === "practice";
  const kind = rate.scripts[language]?.find(
    (script) => script.practice === practice && script.answers.join() === trial.answers.join(),
  );
  if (!kind) throw new Error(`the study has no script for ${trial.id} in ${language}`);
  return {
    phases: kind.phases,
    correct: trial.correct,
    dropped_max: study.dropped_max,
    pause_keys: study.pause_keys,
    quit_keys: study.quit_keys,
  };
}
