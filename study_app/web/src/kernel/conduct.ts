/** Conducts a session: asks `nextStep` what to do, does it on a stage, and says it.
 *
 * As `study_app/conduct.py`, with promises. The stage knows the DOM, this does not.
 */
import { AttemptRun } from "./attempt";
import type { EndLine, RefreshRate, WebPages, ClosingQuestion, WebStudy } from "./formats";
import type { LineLog } from "./lines";
import { makePlan, type PlannedTrial } from "./plan";
import { following, nextStep, type Attempt, type Step } from "./session";
import { scriptOf } from "./script";

export type PageName =
  | "consent"
  | "instructions"
  | "practice"
  | "start"
  | "break"
  | "paused"
  | "quit"
  | "question";

/** A page of text that waits for the participant to go on, or to leave. */
export interface Page {
  readonly name: PageName;
  readonly text: string;
  /** Shortest time on the page, s; a participant who goes on earlier stays. */
  readonly least_s: number;
  readonly question: ClosingQuestion | null;
  /** Text that was typed or chosen before the question was left. */
  readonly draft: string;
  /** Share of the session that is done, shown as a bar; 0: nothing is shown. */
  readonly done_share: number;
}

export interface PageResult {
  readonly leaves: boolean;
  /** Answer that a question's page collected. */
  readonly answer: string;
  readonly duration_s: number;
}

export interface Stage {
  page(page: Page): Promise<PageResult>;
  /** Make a trial's stimuli ready, and begin to fetch the next one's; what is worth a note. */
  prepare(trial: PlannedTrial, next: PlannedTrial | null): Promise<string | null>;
  /** Show an attempt flip by flip until it is done. */
  attempt(run: AttemptRun): Promise<void>;
}

export type Ending = EndLine["reason"];

export async function conduct(
  study: WebStudy,
  rate: RefreshRate,
  lines: LineLog,
  stage: Stage,
  hash: (text: string) => Promise<string>,
): Promise<Ending> {
  const conductor = new Conductor(study, rate, lines, stage, hash);
  let reason: Ending;
  try {
    reason = await conductor.run();
  } catch (error) {
    await lines.say({ kind: "note", text: String(error).slice(0, 2000) });
    await lines.say({ kind: "end", reason: "error" });
    throw error;
  }
  await lines.say({ kind: "end", reason });
  return reason;
}

class Conductor {
  private readonly plan;
  private readonly pages: WebPages;

  constructor(
    private readonly study: WebStudy,
    private readonly rate: RefreshRate,
    private readonly lines: LineLog,
    private readonly stage: Stage,
    private readonly hash: (text: string) => Promise<string>,
  ) {
    const { language } = lines.begun;
    this.plan = makePlan(study.design, lines.begun);
    const pages = study.pages[language];
    if (!pages) throw new Error(`the study has no texts in ${language}`);
    this.pages = pages;
  }

  async run(): Promise<Ending> {
    for (;;) {
      const step = nextStep(this.study.design, this.plan, this.lines.history);
      if (step.step === "finish") return step.consented ? "completed" : "consent-refused";
      if (!(await this.does(step))) return "quit";
    }
  }

  /** Do one step; false where the participant leaves. */
  private async does(step: Exclude<Step, { step: "finish" }>): Promise<boolean> {
    const { lines, pages } = this;
    switch (step.step) {
      case "ask-consent": {
        const { leaves } = await this.stage.page(plain("consent", pages.consent));
        const agreed = !leaves;
        const text_sha256 = await this.hash(pages.consent);
        await lines.say({ kind: "consent", agreed, text_sha256 }, { kind: "consent", agreed });
        return true;
      }
      case "start-block": {
        const { block, first } = step;
        const instructions = first ? pages.instructions : [];
        for (const text of instructions) {
          if ((await this.show(plain("instructions", text))).leaves) return false;
        }
        const opening = block === 0 ? "practice" : "start";
        const main = this.plan.trials.find((trial) => trial.block > 0)?.block;
        if (block === 0 || block === main) {
          if ((await this.show(plain(opening, pages[opening]))).leaves) return false;
        }
        await lines.say({ kind: "block-start", block }, { kind: "block-start", block });
        return true;
      }
      case "end-block": {
        const { block } = step;
        await lines.say({ kind: "block-end", block }, { kind: "block-end", block });
        return true;
      }
      case "take-break": {
        const { after_block } = step;
        const total = Math.max(...this.plan.trials.map((trial) => trial.block));
        const text = pages.break_page
          .replaceAll("{done}", String(after_block))
          .replaceAll("{total}", String(total));
        const page = {
          ...plain("break", text),
          least_s: this.study.break_s,
          done_share: after_block / total,
        };
        const { leaves, duration_s } = await this.show(page);
        if (leaves) return false;
        await lines.say({ kind: "break", after_block, duration_s }, { kind: "break", after_block });
        return true;
      }
      case "ask-question": {
        const asked = pages.questions.find(({ name }) => name === step.question);
        if (!asked) throw new Error(`the study has no question ${step.question}`);
        const page: Page = { ...plain("question", asked.text), question: asked };
        const { leaves, answer } = await this.show(page);
        if (leaves) return false;
        const said = { kind: "answer", question: asked.name } as const;
        await lines.say({ ...said, text: answer }, said);
        return true;
      }
      case "run-trial":
        return this.trial(step);
    }
  }

  /** Show a page; whoever wants to leave is asked, and may stay. */
  private async show(page: Page): Promise<PageResult> {
    let now = page;
    for (;;) {
      const result = await this.stage.page(now);
      if (!result.leaves || (await this.confirmed())) return result;
      now = { ...page, draft: result.answer };
    }
  }

  private async confirmed(): Promise<boolean> {
    return (await this.stage.page(plain("quit", this.pages.quit_question))).leaves;
  }

  private async trial(step: Extract<Step, { step: "run-trial" }>): Promise<boolean> {
    const { study, rate, lines } = this;
    const { trial, attempt, position } = step;
    const script = scriptOf(study, rate, lines.begun.language, trial);
    const next = following(study.design, this.plan, lines.history, trial);
    const note = await this.stage.prepare(trial, next);
    if (note !== null) await lines.say({ kind: "note", text: note });
    let sent = Promise.resolve();
    const run = new AttemptRun(script, rate.refresh_hz, ({ state }) => {
      const { answer, completed, void_reason } = state;
      const event: Attempt = {
        kind: "attempt",
        trial: trial.id,
        attempt,
        outcome: completed ? "completed" : "void",
        void_reason,
        correct: completed && trial.correct !== null ? answer === trial.correct : null,
        track: trial.track,
        level: trial.level,
        stimuli: trial.stimuli,
      };
      const said = { kind: "attempt", trial: trial.id, attempt, position } as const;
      const ended = { outcome: event.outcome, void_reason, answer: completed ? answer : null };
      sent = lines.say({ ...said, ...run.log(), ...ended }, event);
    });
    await this.stage.attempt(run);
    await sent;
    return this.goesOn(run);
  }

  /** Ask once after the quit key; rest after the pause key or a disturbance. */
  private async goesOn(run: AttemptRun): Promise<boolean> {
    if (run.interrupts.includes("quit")) return !(await this.confirmed());
    if (!run.interrupts.includes("paused") && run.state.void_reason !== "focus-lost") return true;
    const { leaves, duration_s } = await this.stage.page(plain("paused", this.pages.paused));
    await this.lines.say({ kind: "pause", duration_s });
    return !leaves;
  }
}

function plain(name: PageName, text: string): Page {
  return { name, text, least_s: 0, question: null, draft: "", done_share: 0 };
}
