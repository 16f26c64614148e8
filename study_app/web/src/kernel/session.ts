/** Next step of a session, as `study_app/session.py` defines it: a pure function of design,
 * plan and events so far. Nothing else is remembered.
 */
import { nextLevel, type Answered } from "./adaptive";
import { Chance } from "./chance";
import type {
  AnswerLine, AttemptLine, BlockEndLine, BlockStartLine, BreakLine, ConsentLine, WebDesign,
} from "./formats";
import { at } from "./list";
import { placeOf, shownAt } from "./places";
import { shown, type Plan, type PlannedTrial } from "./plan";

export interface Attempt
  extends Pick<AttemptLine, "kind" | "trial" | "attempt" | "outcome" | "void_reason"> {
  readonly correct: boolean | null;
  readonly track: string | null;
  readonly level: number | null;
  readonly stimuli: readonly string[];
}

/** Event of a session; kinds that decide nothing are left out. */
export type SessionEvent =
  | Attempt
  | Pick<ConsentLine, "kind" | "agreed">
  | Pick<BlockStartLine | BlockEndLine, "kind" | "block">
  | Pick<BreakLine, "kind" | "after_block">
  | Pick<AnswerLine, "kind" | "question">;

export type Step =
  | { readonly step: "ask-consent" }
  | {
      readonly step: "start-block";
      readonly block: number;
      /** Nothing was shown yet: instructions come before. */
      readonly first: boolean;
    }
  | {
      readonly step: "run-trial";
      readonly trial: PlannedTrial;
      readonly attempt: number;
      readonly position: number;
    }
  | { readonly step: "end-block"; readonly block: number }
  | { readonly step: "take-break"; readonly after_block: number }
  | { readonly step: "ask-question"; readonly question: string }
  | { readonly step: "finish"; readonly consented: boolean };

/** Voids that do not count towards `max_attempts`: nothing was wrong with the attempt itself. */
const NOT_THE_PARTICIPANTS: ReadonlySet<string> = new Set(["paused", "quit", "focus-lost"]);

export function nextStep(design: WebDesign, plan: Plan, events: readonly SessionEvent[]): Step {
  const consent = events.find((event) => event.kind === "consent");
  if (design.consent_required) {
    if (!consent) return { step: "ask-consent" };
    if (!consent.agreed) return { step: "finish", consented: false };
  }
  const attempts = events.filter((event) => event.kind === "attempt");
  const started = new Set(events.flatMap((e) => (e.kind === "block-start" ? [e.block] : [])));
  const ended = new Set(events.flatMap((e) => (e.kind === "block-end" ? [e.block] : [])));
  const rested = new Set(events.flatMap((e) => (e.kind === "break" ? [e.after_block] : [])));
  const blocks = [...new Set(plan.trials.map((trial) => trial.block))].sort((a, b) => a - b);
  for (const block of blocks) {
    if (ended.has(block)) {
      if (block > 0 && block !== blocks.at(-1) && !rested.has(block)) {
        return { step: "take-break", after_block: block };
      }
      continue;
    }
    if (!started.has(block)) return { step: "start-block", block, first: !started.size };
    const [next] = remaining(design, plan, block, attempts);
    if (!next) return { step: "end-block", block };
    const tries = attempts.filter((attempt) => attempt.trial === next.id).length;
    const trial = chosen(design, plan, next, attempts);
    return { step: "run-trial", trial, attempt: tries + 1, position: attempts.length };
  }
  const answered = new Set(events.flatMap((e) => (e.kind === "answer" ? [e.question] : [])));
  const question = design.questions.find((name) => !answered.has(name));
  if (question !== undefined) return { step: "ask-question", question };
  return { step: "finish", consented: true };
}

/** Return the trial after `trial`, the one that runs; null where that is not known. */
export function following(
  design: WebDesign,
  plan: Plan,
  events: readonly SessionEvent[],
  trial: PlannedTrial,
): PlannedTrial | null {
  const attempts = events.filter((event) => event.kind === "attempt");
  let queue = remaining(design, plan, trial.block, attempts).slice(1);
  for (const trials of trial.block === 0 ? practiceRounds(design, plan) : []) {
    const left = queueOf(design, plan, trials, attempts);
    if (left.length !== 1 || left[0]?.id !== trial.id) continue;
    const answers = rightAnswers(trials, attempts);
    const [right, wrong] = [true, false].map((last) => isPassed(design, [...answers, last]));
    if (right !== wrong) return null;
    if (right) queue = [];
  }
  queue = [...queue, ...plan.trials.filter((entry) => entry.block > trial.block)];
  return queue[0]?.stimuli.length ? queue[0] : null;
}

/** The trials of a block that are still to come, in order. */
export function remaining(
  design: WebDesign,
  plan: Plan,
  block: number,
  attempts: readonly Attempt[],
): PlannedTrial[] {
  const rounds = block === 0 ? practiceRounds(design, plan) : [];
  if (!rounds.length) return queueOf(design, plan, ofBlock(plan, block), attempts);
  for (const [number, trials] of rounds.entries()) {
    const left = queueOf(design, plan, trials, attempts);
    if (left.length) return [...left, ...rounds.slice(number + 1).flat()];
    if (isPassed(design, rightAnswers(trials, attempts))) break;
  }
  return [];
}

/** A trial with what it shows: for adaptive ones, given the attempts so far. */
export function chosen(
  design: WebDesign,
  plan: Plan,
  trial: PlannedTrial,
  attempts: readonly Attempt[],
): PlannedTrial {
  const { seed, participant, slot } = plan;
  const { adaptive } = shownAt(design, placeOf(design, plan.places_key ?? seed, slot));
  if (trial.track === null || !adaptive) return trial;
  const past = attempts.filter(
    (attempt) => attempt.track === trial.track && attempt.outcome === "completed",
  );
  const tries = attempts.filter((attempt) => attempt.trial === trial.id).length;
  const history = past.map(({ level, correct }): Answered => [level ?? NaN, correct === true]);
  const level = nextLevel(adaptive.rule, history);
  const track = adaptive.tracks.find(({ name }) => name === trial.track);
  const options = track?.options.filter((option) => option.level === level) ?? [];
  const chance = new Chance(seed, participant, slot, "choose", trial.id, tries);
  // The answer first: to avoid the last picture must not make its successor predictable.
  const answers = [...new Set(options.map((option) => option.correct ?? "None"))].sort();
  const answer = at(answers, chance.below(answers.length));
  const fit = options.filter((option) => (option.correct ?? "None") === answer);
  const last = past.at(-1);
  const fresh = last ? fit.filter((option) => shown(option) !== shown(last)) : fit;
  const among = fresh.length ? fresh : fit;
  const { stimuli, correct } = at(among, chance.below(among.length));
  return { ...trial, stimuli, correct, level };
}

function ofBlock(plan: Plan, block: number): PlannedTrial[] {
  return plan.trials.filter((trial) => trial.block === block);
}

/** The rounds of practice with a criterion; none where practice has none. */
function practiceRounds(design: WebDesign, plan: Plan): PlannedTrial[][] {
  const { practice } = design;
  if (!practice || practice.criterion_share === null) return [];
  const trials = ofBlock(plan, 0);
  const rounds = [];
  for (let first = 0; first < trials.length; first += practice.trials) {
    rounds.push(trials.slice(first, first + practice.trials));
  }
  return rounds;
}

/** Of every answer to these trials whether it was right. */
function rightAnswers(trials: readonly PlannedTrial[], attempts: readonly Attempt[]): boolean[] {
  const names = new Set(trials.map((trial) => trial.id));
  return attempts
    .filter((attempt) => names.has(attempt.trial) && attempt.outcome === "completed")
    .map((attempt) => attempt.correct === true);
}

/** True if these answers to a round of practice reach its criterion. */
function isPassed(design: WebDesign, answers: readonly boolean[]): boolean {
  const share = design.practice?.criterion_share ?? null;
  const right = answers.filter(Boolean).length;
  return share !== null && answers.length > 0 && right >= share * answers.length;
}

function queueOf(
  design: WebDesign,
  plan: Plan,
  trials: readonly PlannedTrial[],
  attempts: readonly Attempt[],
): PlannedTrial[] {
  const queue = [...trials];
  const names = new Set(trials.map((trial) => trial.id));
  const counted = new Map<string, number>();
  for (const attempt of attempts) {
    if (!names.has(attempt.trial)) continue;
    const place = queue.findIndex((trial) => trial.id === attempt.trial);
    const [trial] = place < 0 ? [] : queue.splice(place, 1);
    if (!trial) throw new Error(`${attempt.trial} was over before attempt ${attempt.attempt}`);
    if (attempt.void_reason === null) continue;
    if (!NOT_THE_PARTICIPANTS.has(attempt.void_reason)) {
      counted.set(trial.id, (counted.get(trial.id) ?? 0) + 1);
    }
    if ((counted.get(trial.id) ?? 0) < design.max_attempts) {
      queue.splice(requeued(plan, queue, trial, attempt.attempt), 0, trial);
    }
  }
  return queue;
}

/** Return the place in the queue where a void trial comes again. */
function requeued(
  plan: Plan,
  queue: readonly PlannedTrial[],
  trial: PlannedTrial,
  attempt: number,
): number {
  const { seed, participant, slot } = plan;
  const chance = new Chance(seed, participant, slot, "requeue", trial.id, attempt);
  const what = shown(trial);
  const differs = (place: number) => shown(at(queue, place)) !== what;
  const places = queue.map((_, index) => index + 1);
  const free = places.filter(
    (place) => !what || (differs(place - 1) && (place === queue.length || differs(place))),
  );
  const candidates = free.length ? free : places.length ? places : [0];
  return at(candidates, chance.below(candidates.length));
}
