/** The trials of one participant, as `protocols/plan.py` defines them. */
import { Chance } from "./chance";
import type { WebArrangement, WebCell, WebDesign } from "./formats";
import { at } from "./list";
import { placeOf, shownAt, windowsOf } from "./places";

export type Role = "practice" | "main" | "catch";

export interface PlannedTrial {
  readonly id: string;
  /** 0 is practice. */
  readonly block: number;
  readonly role: Role;
  readonly repeat: number;
  /** Names in the manifest; empty until an adaptive rule chooses. */
  readonly stimuli: readonly string[];
  /** The answer that each response key stands for, from left to right. */
  readonly answers: readonly string[];
  readonly correct: string | null;
  /** The adaptive track that chooses what is shown; null: it is planned. */
  readonly track: string | null;
  readonly level: number | null;
}

/** Participant of a session. */
export interface Person {
  readonly seed: number;
  readonly participant: string;
  readonly slot: number;
  /** The export's key of the places. Left out by exports of older versions, which draw by the seed. */
  readonly places_key?: number | null | undefined;
}

export interface Plan extends Person {
  readonly trials: readonly PlannedTrial[];
}

/** Stimuli of a trial, whatever the order: no two trials in a row show the same. */
export function shown(trial: { readonly stimuli: readonly string[] }): string {
  return [...new Set(trial.stimuli)].sort().join("\n");
}

export function makePlan(design: WebDesign, person: Person): Plan {
  const { seed, participant, slot } = person;
  const chance = new Chance(seed, participant, slot, "plan");
  const place = placeOf(design, person.places_key ?? seed, slot);
  const own = shownAt(design, place);
  const main = mainTrials(own, place, Math.floor(place / windowsOf(design)), chance);
  const blocks = new Map<number, PlannedTrial[]>([[0, practiceTrials(own, place, chance)]]);
  for (let number = 1; number <= design.blocks; number++) blocks.set(number, []);
  const block = (number: number) => blocks.get(number) ?? [];
  main.forEach((trial, index) => {
    const number = 1 + Math.floor((index * design.blocks) / main.length);
    block(number).push({ ...trial, block: number });
  });
  for (const [number, trial] of catchTrials(own, place, chance)) {
    const after = chance.below(block(number).length) + 1; // never the first of its block
    block(number).splice(after, 0, { ...trial, block: number });
  }
  const trials: PlannedTrial[] = [];
  for (let number = 0; number <= design.blocks; number++) {
    const last = trials.at(-1);
    const ordered = apart(block(number), last ? shown(last) : null);
    trials.push(...keyed(design, place, chance, ordered));
  }
  return { seed, participant, slot, trials };
}

function planned(
  design: WebDesign,
  role: Role,
  number: number,
  of: Partial<PlannedTrial>,
): PlannedTrial {
  return {
    id: `${role}-${String(number).padStart(4, "0")}`,
    block: 0,
    role,
    repeat: 0,
    stimuli: [],
    answers: design.answers,
    correct: null,
    track: null,
    level: null,
    ...of,
  };
}

function arranged(cell: WebCell, turn: number): Pick<WebArrangement, "stimuli" | "correct"> {
  const { stimuli, correct } = at(
    cell.arrangements,
    (cell.parity + turn) % cell.arrangements.length,
  );
  return { stimuli, correct };
}

/** The main trials in order: all of the first repeat, then all of the second, ... */
function mainTrials(
  design: WebDesign,
  place: number,
  row: number,
  chance: Chance,
): PlannedTrial[] {
  const { adaptive, cells, scenes } = design;
  if (adaptive) {
    const rounds = Array.from({ length: adaptive.trials }, () => chance.shuffled(adaptive.tracks));
    return rounds
      .flat()
      .map(({ name }, number) => planned(design, "main", number, { track: name }));
  }
  const ordered: [number, WebCell][] = [];
  let round = 0;
  for (let repeat = 0; repeat < design.repeats; repeat++) {
    if (design.scene_order === "random") {
      ordered.push(...chance.shuffled(cells).map((cell): [number, WebCell] => [repeat, cell]));
      continue;
    }
    const queues = scenes.map((scene) =>
      chance.shuffled(cells.filter((cell) => cell.scene === scene)),
    );
    for (; queues.some((queue) => queue.length); round++) {
      for (const index of latinRow(scenes.length, row + round)) {
        const cell = at(queues, index).pop();
        if (cell) ordered.push([repeat, cell]);
      }
    }
  }
  return ordered.map(([repeat, cell], number) =>
    planned(design, "main", number, { repeat, ...arranged(cell, repeat + place) }),
  );
}

function practiceTrials(design: WebDesign, place: number, chance: Chance): PlannedTrial[] {
  const { practice } = design;
  if (!practice) return [];
  const cells = chance.shuffled(practice.cells);
  return Array.from({ length: practice.trials * practice.rounds }, (_, number) => {
    const repeat = Math.floor(number / cells.length);
    const cell = at(cells, number % cells.length);
    return planned(design, "practice", number, { repeat, ...arranged(cell, repeat + place) });
  });
}

/** [block, trial] of every catch trial, spread evenly. */
function catchTrials(design: WebDesign, place: number, chance: Chance): [number, PlannedTrial][] {
  if (!design.catch_trials) return [];
  const order = chance.shuffled(design.catch_cells);
  return Array.from({ length: design.catch_trials }, (_, number) => {
    const cell = at(order, number % order.length);
    const block = 1 + Math.floor((number * design.blocks) / design.catch_trials);
    return [block, planned(design, "catch", number, arranged(cell, number + place))];
  });
}

/** A row of a Latin square in which every item follows every other equally often (Williams 1949). */
export function latinRow(count: number, row: number): number[] {
  const order = Array.from({ length: count }, (_, step) => {
    const zigzag = step % 2 ? (step + 1) / 2 : -step / 2;
    return (((zigzag + row) % count) + count) % count;
  });
  const mirrored = count % 2 === 1 && Math.floor(row / count) % 2 === 1;
  return mirrored ? order.reverse() : order;
}

/** The trials so that no two in a row show the same, moved as little as possible. */
function apart(trials: readonly PlannedTrial[], before: string | null): PlannedTrial[] {
  // What came before a break counts unless that leaves a block of several stimuli no order.
  for (const met of new Set(trials.map(shown)).size > 1 ? [before, null] : [before]) {
    const ordered = orderedApart(trials, met, true) ?? orderedApart(trials, met, false);
    if (ordered) return ordered;
  }
  throw new Error("no two trials in a row may show the same: there is no such order");
}

function orderedApart(
  trials: readonly PlannedTrial[],
  before: string | null,
  openCounts: boolean,
): PlannedTrial[] | null {
  const left = [...trials];
  const ordered: PlannedTrial[] = [];
  const counts = new Map<string, number>();
  for (const trial of left) {
    const what = shown(trial);
    if (what || openCounts) counts.set(what, (counts.get(what) ?? 0) + 1);
  }
  let crowding = ""; // what must come at every second place from now on
  while (left.length) {
    const most = Math.max(0, ...counts.values());
    const crowded = 2 * most > left.length; // must come now, or it meets itself at the end
    if (crowded && (counts.get(crowding) ?? 0) !== most) {
      crowding = [...counts].find(([, count]) => count === most)?.[0] ?? "";
    }
    const place = left.findIndex((trial) => {
      const what = shown(trial);
      if (openCounts && !what) return true;
      const meets = what === before && what !== "";
      return !meets && (!crowded || what === crowding || before === crowding);
    });
    const [trial] = place < 0 ? [] : left.splice(place, 1);
    if (!trial) return null;
    const what = shown(trial);
    const count = counts.get(what);
    if (count !== undefined) counts.set(what, count - 1);
    ordered.push(trial);
    before = what;
  }
  return ordered;
}

/** The trials of a block with the answers of their keys. */
function keyed(
  design: WebDesign,
  place: number,
  chance: Chance,
  trials: readonly PlannedTrial[],
): PlannedTrial[] {
  const orders = [design.answers, [...design.answers].reverse()];
  if (design.side === "by-trial") {
    const drawn = chance.shuffled(trials.map((_, index) => at(orders, index % 2)));
    return trials.map((trial, index) => ({ ...trial, answers: at(drawn, index) }));
  }
  const turned = design.side === "by-participant" && Math.floor(place / 2) % 2 === 1;
  return trials.map((trial) => ({ ...trial, answers: at(orders, Number(turned)) }));
}
