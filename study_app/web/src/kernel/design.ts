/** Design that a study's plan follows from: the part of `study.json` that Python exports for it.
 *
 * The names are those of `protocols/browser/web_study.py`, which defines them.
 */
export interface Arrangement {
  readonly stimuli: readonly string[];
  readonly correct: string | null;
  /** Of the column that an adaptive rule chooses; null where there is none. */
  readonly level: number | null;
}

/** One condition of the design; its arrangements take turns over repeats and places. */
export interface Cell {
  readonly scene: string;
  readonly parity: number;
  readonly arrangements: readonly Arrangement[];
}

export interface QuestPlusRule {
  readonly kind: "quest-plus";
  readonly levels: readonly number[];
  /** Probability of a right answer: a row for each level, a column for each point of the grid. */
  readonly correct: readonly (readonly number[])[];
  /** Of each point of the grid; null where its prior is 0. */
  readonly log_prior: readonly (number | null)[];
}

export interface UpDownRule {
  readonly kind: "up-down";
  readonly levels: readonly number[];
  readonly start: number;
  readonly harder: readonly number[];
  readonly easier: readonly number[];
  readonly in_a_row: number;
  readonly one_at_first: boolean;
  readonly falling: boolean;
}

export interface Track {
  readonly name: string;
  /** All that its trials may show. */
  readonly options: readonly Arrangement[];
}

export interface Adaptive {
  readonly trials: number;
  readonly tracks: readonly Track[];
  readonly rule: QuestPlusRule | UpDownRule;
}

export interface Practice {
  readonly trials: number;
  readonly rounds: number;
  readonly criterion_share: number | null;
  readonly cells: readonly Cell[];
}

export interface Design {
  readonly answers: readonly string[];
  readonly scenes: readonly string[];
  readonly repeats: number;
  readonly blocks: number;
  readonly scene_order: "balanced" | "random";
  readonly side: "by-participant" | "by-trial" | "fixed";
  readonly places: "by-arrival" | "drawn";
  /** After how many places arrangements and keys are balanced, and the scenes as well. */
  readonly rounds: readonly [number, number];
  readonly max_attempts: number;
  readonly consent_required: boolean;
  /** Names of the closing questions. */
  readonly questions: readonly string[];
  readonly cells: readonly Cell[];
  readonly catch_trials: number;
  readonly catch_cells: readonly Cell[];
  readonly practice: Practice | null;
  readonly adaptive: Adaptive | null;
}

/** Participant of a session. */
export interface Person {
  readonly seed: number;
  readonly participant: string;
  readonly slot: number;
}

/** Entry `index` of a list that has one. */
export function at<T>(list: readonly T[], index: number): T {
  const found = list[index];
  if (found === undefined) throw new Error(`there is no entry ${index} of ${list.length}`);
  return found;
}
