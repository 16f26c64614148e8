/** A study inside jsPsych: the session is one node, around it stand the lab's own timelines.
 *
 * The kernel knows nothing of jsPsych, and jsPsych nothing of trials.
 */
import * as jsPsychModule from "jspsych";
import { begun, overLine, run, type Ending, type Options } from "./main";
import { insist } from "./store/stores";

type Timeline = Parameters<jsPsychModule.JsPsych["run"]>[0];

export interface Shell extends Options {
  /** Shown to whoever begins, and not again to whoever comes back: consent, questions. */
  readonly before?: Timeline;
  /** Shown once a session is completed. */
  readonly after?: Timeline;
  /** Takes what the lab's own screens collected, as JSON. Left out: JATOS keeps it as a file. */
  readonly keep?: (data: string) => Promise<unknown>;
}

/** Run a study between two timelines of a lab; how it ended. */
export async function runInJsPsych(shell: Shell): Promise<Ending | "refused"> {
  const { before = [], after = [], jatos } = shell;
  const resumes = await begun(shell);
  const jsPsych = jsPsychModule.initJsPsych();
  let ended: Ending | "refused" = "refused";
  let over: () => void;
  const rest = new Promise<void>((resolve) => (over = resolve));
  let done: Promise<unknown> = Promise.resolve();

  const upload = jatos && ((text: string) => jatos.uploadResultFile(text, "jspsych.json"));
  const keep = shell.keep ?? upload;
  /** Before the session, too: the page may not live to its end. */
  const kept = async () => {
    if (keep && jsPsych.data.get().count()) {
      await overLine((told) => insist(() => keep(jsPsych.data.get().json()), told));
    }
  };

  class Session {
    static readonly info = { name: "metamerlab", version: "1", parameters: {}, data: {} };

    trial(): void {
      const hand = (ending: Ending) => {
        ended = ending;
        jsPsych.finishTrial({ ending });
        return rest;
      };
      done = kept().then(() => run({ ...shell, rest: hand })).then((ending) => (ended = ending));
    }
  }

  const timeline = [
    { timeline: before, conditional_function: () => !resumes && before.length > 0 },
    { type: Session },
    { timeline: after, conditional_function: () => ended === "completed" && after.length > 0 },
  ];
  await jsPsych.run(timeline as unknown as Timeline);
  await kept();
  over!();
  await done;
  return ended;
}

// Plugins of jsPsych, loaded as scripts, look for it there.
Object.assign(globalThis, { jsPsychModule, metamerlab: { runInJsPsych } });
