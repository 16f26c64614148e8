/** A slot's place in the counterbalancing, and what it shows, as `protocols/plan.py` defines it. */
import { Chance } from "./chance";
import type { WebCell, WebDesign } from "./formats";

export function placeOf(design: WebDesign, seed: number, slot: number): number {
  if (design.places !== "drawn") return slot;
  const [short, whole] = design.rounds;
  const number = Math.floor(slot / short);
  const blocks = whole / short;
  const rest = drawn(slot % short, short, new Chance(seed, "places", "short", number));
  const chance = new Chance(seed, "places", "whole", Math.floor(number / blocks), rest);
  return drawn(number % blocks, blocks, chance) * short + rest;
}

/** After how many places every scene is shown equally often: 1 where each shows all. */
export function windowsOf({ scenes, scenes_each }: WebDesign): number {
  return scenes.length / divisor(scenes.length, scenes_each);
}

/** The design with the scenes that a place shows alone; practice elsewhere stays as it is. */
export function shownAt(design: WebDesign, place: number): WebDesign {
  const { scenes, scenes_each, rounds, practice, adaptive } = design;
  const count = windowsOf(design);
  if (count === 1) return design;
  const round = (rounds[0] / divisor(rounds[0], count)) * count;
  const first = ((place + Math.floor(place / round)) % count) * scenes_each;
  const shown = new Set(
    Array.from({ length: scenes_each }, (_, step) => scenes[(first + step) % scenes.length]),
  );
  const of = (cells: readonly WebCell[]) => {
    const own = cells.filter(({ scene }) => shown.has(scene));
    return own.length ? own : cells;
  };
  const tracks = adaptive?.tracks.map((track) => {
    return { ...track, options: track.options.filter(({ scene }) => shown.has(scene ?? "")) };
  });
  return {
    ...design,
    scenes: scenes.filter((scene) => shown.has(scene)),
    cells: of(design.cells),
    catch_cells: of(design.catch_cells),
    practice: practice && { ...practice, cells: of(practice.cells) },
    adaptive: adaptive && {
      ...adaptive,
      tracks: tracks?.filter(({ options }) => options.length) ?? [],
    },
  };
}

function divisor(a: number, b: number): number {
  return b ? divisor(b, a % b) : a;
}

/** One entry of a permutation of [0, count), without making those behind it. */
function drawn(number: number, count: number, chance: Chance): number {
  const moved = new Map<number, number>();
  for (let place = 0; place <= number; place++) {
    const other = place + chance.below(count - place);
    const [here, there] = [moved.get(place) ?? place, moved.get(other) ?? other];
    moved.set(other, here).set(place, there);
  }
  return moved.get(number) ?? number;
}
