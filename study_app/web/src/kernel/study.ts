/** The file `study.json`, which `protocols/browser/web_study.py` defines: all that the page needs. */
import type { Design } from "./design";
import type { PlannedTrial } from "./plan";
import type { ScriptPhase, TrialScript } from "./script";

export interface WebScript {
  readonly answers: readonly string[];
  readonly practice: boolean;
  readonly phases: readonly ScriptPhase[];
}

export interface Rate {
  readonly refresh_hz: number;
  readonly deviations_s: Readonly<Record<string, number>>;
  /** By language. */
  readonly scripts: Readonly<Record<string, readonly WebScript[]>>;
}

/** The frames of a stimulus: PNG files one after the other in one file. */
export interface Pack {
  readonly file: string;
  readonly bytes: number;
  readonly sha256: readonly string[];
  readonly ends: readonly number[];
}

export interface PictureFile {
  readonly file: string;
  readonly sha256: string;
  readonly size_px: readonly [number, number];
}

export interface ClosingQuestion {
  readonly name: string;
  readonly text: string;
  /** None: the answer is free text. */
  readonly choices: readonly string[];
}

/** Texts that a participant reads beside trials. */
export interface Pages {
  readonly consent: string;
  readonly instructions: readonly string[];
  readonly practice: string;
  readonly start: string;
  /** `{done}` and `{total}` stand for numbers of blocks. */
  readonly break_page: string;
  readonly paused: string;
  readonly preparing: string;
  readonly quit_question: string;
  readonly thanks: string;
  readonly questions: readonly ClosingQuestion[];
}

export interface WebStudy {
  readonly format: 1;
  readonly study: string;
  readonly title: string;
  readonly protocol_sha256: string;
  readonly manifest_sha256: string;
  readonly revision: string;
  readonly default_language: string;
  readonly pages: Readonly<Record<string, Pages>>;
  readonly background: number;
  /** Smallest part of the screen, about its middle, that shows all of a trial. */
  readonly window_px: readonly [number, number];
  /** Of the screen that the study was made for: a pointer answers by its share of the width. */
  readonly screen_px: readonly [number, number];
  readonly design: Design;
  readonly break_s: number;
  readonly rates: readonly Rate[];
  readonly dropped_max: number;
  readonly continue_keys: readonly string[];
  readonly pause_keys: readonly string[];
  readonly quit_keys: readonly string[];
  readonly stimulus_px: readonly [number, number];
  readonly stimuli: Readonly<Record<string, Pack>>;
  readonly pictures: Readonly<Record<string, PictureFile>>;
  readonly decoded_bytes: number;
  readonly identifier: string | null;
  readonly completion_url: string | null;
  readonly completion_code: string | null;
}

/** The script of a trial at one of the study's refresh rates. */
export function scriptOf(
  study: WebStudy,
  rate: Rate,
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
    gaze: "none",
    dropped_max: study.dropped_max,
    pause_keys: study.pause_keys,
    quit_keys: study.quit_keys,
  };
}
