/** Levels chosen from the answers so far, as `protocols/adaptive/` defines them.
 *
 * The table of the psychometric function comes from Python, so no special function is written here.
 */
import type { QuestPlusRule, UpDownRule } from "./formats";
import { at } from "./list";

/** A level that was shown, and whether the answer was right. */
export type Answered = readonly [level: number, correct: boolean];

/** Of levels that differ by less, the lowest is taken. */
const TIE_NATS = 1e-9;

export function nextLevel(
  rule: QuestPlusRule | UpDownRule,
  history: readonly Answered[],
): number {
  return rule.kind === "quest-plus" ? questPlus(rule, history) : upDown(rule, history);
}

interface Tables {
  readonly correct: readonly Float64Array[];
  readonly logCorrect: readonly Float64Array[];
  readonly logWrong: readonly Float64Array[];
  readonly answerEntropy: readonly Float64Array[];
  readonly logPrior: Float64Array;
}

const made = new WeakMap<QuestPlusRule, Tables>();

function tablesOf(rule: QuestPlusRule): Tables {
  let tables = made.get(rule);
  if (!tables) {
    const correct = rule.correct.map((row) => Float64Array.from(row));
    tables = {
      correct,
      logCorrect: correct.map((row) => row.map(Math.log)),
      logWrong: correct.map((row) => row.map((p) => Math.log1p(-p))),
      answerEntropy: correct.map((row) => row.map((p) => entropy(p) + entropy(1 - p))),
      logPrior: Float64Array.from(rule.log_prior, (value) => value ?? -Infinity),
    };
    made.set(rule, tables);
  }
  return tables;
}

/** The level of least expected entropy, of equals the lowest. */
function questPlus(rule: QuestPlusRule, history: readonly Answered[]): number {
  const expected = expectedEntropy(rule, history);
  const least = Math.min(...expected);
  return at(
    rule.levels,
    expected.findIndex((value) => value < least + TIE_NATS),
  );
}

/** The entropy, in nats, that is expected after one more answer at each level. */
export function expectedEntropy(rule: QuestPlusRule, history: readonly Answered[]): number[] {
  const { correct, answerEntropy } = tablesOf(rule);
  const weight = posterior(rule, history);
  let all = 0;
  for (const share of weight) all += entropy(share);
  return correct.map((row, level) => {
    const right = dot(row, weight);
    const known = dot(at(answerEntropy, level), weight);
    return all - (entropy(right) + entropy(1 - right) - known);
  });
}

function posterior(rule: QuestPlusRule, history: readonly Answered[]): Float64Array {
  const { logCorrect, logWrong, logPrior } = tablesOf(rule);
  const counts = rule.levels.map(() => [0, 0] as [wrong: number, right: number]);
  for (const [level, correct] of history) {
    at(counts, indexOf(rule.levels, level))[Number(correct)]! += 1;
  }
  const weight = Float64Array.from(logPrior);
  counts.forEach(([wrong, right], level) => {
    if (right) add(weight, right, at(logCorrect, level));
    if (wrong) add(weight, wrong, at(logWrong, level));
  });
  const most = weight.reduce((a, b) => Math.max(a, b), -Infinity);
  let sum = 0;
  for (let point = 0; point < weight.length; point++) {
    sum += weight[point] = Math.exp(weight[point]! - most);
  }
  return weight.map((share) => share / sum);
}

function upDown(rule: UpDownRule, history: readonly Answered[]): number {
  const low = at(rule.levels, 0);
  const high = at(rule.levels, rule.levels.length - 1);
  const towardsHarder = rule.falling ? 1 : -1;
  let [position, run, direction, reversals] = [rule.start, 0, 0, 0];
  history.forEach(([level, correct], trial) => {
    const asked = nearest(position, rule.levels);
    if (level !== asked) {
      throw new Error(`answer ${trial} of the track was given at ${level}, which asks for ${asked}`);
    }
    run = correct ? run + 1 : 0;
    const needed = rule.one_at_first && !reversals ? 1 : rule.in_a_row;
    if (correct && run < needed) return;
    run = 0;
    const turn = correct ? towardsHarder : -towardsHarder;
    if (direction === -turn) reversals++;
    direction = turn;
    const steps = correct ? rule.harder : rule.easier;
    position += turn * at(steps, Math.min(reversals, steps.length - 1));
    position = Math.min(Math.max(position, low), high);
  });
  return nearest(position, rule.levels);
}

/** The level nearest to a position, of two as near the lower. */
function nearest(position: number, levels: readonly number[]): number {
  return levels.reduce((best, level) =>
    Math.abs(level - position) < Math.abs(best - position) ? level : best,
  );
}

function indexOf(levels: readonly number[], level: number): number {
  const index = levels.indexOf(level);
  if (index < 0) throw new Error(`an answer must be at one of the study's levels (got ${level})`);
  return index;
}

function entropy(p: number): number {
  return p > 0 ? -p * Math.log(p) : 0;
}

function dot(a: Float64Array, b: Float64Array): number {
  let sum = 0;
  for (let index = 0; index < a.length; index++) sum += a[index]! * b[index]!;
  return sum;
}

function add(to: Float64Array, times: number, what: Float64Array): void {
  for (let index = 0; index < to.length; index++) to[index]! += times * what[index]!;
}
