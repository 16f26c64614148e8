/** A slot's place in the counterbalancing, as `protocols/plan.py` defines it. */
import { Chance } from "./chance";
import type { WebDesign } from "./formats";

export function placeOf(design: WebDesign, seed: number, slot: number): number {
  if (design.places !== "drawn") return slot;
  const [short, whole] = design.rounds;
  const number = Math.floor(slot / short);
  const blocks = whole / short;
  const rest = drawn(slot % short, short, new Chance(seed, "places", "short", number));
  const chance = new Chance(seed, "places", "whole", Math.floor(number / blocks), rest);
  return drawn(number % blocks, blocks, chance) * short + rest;
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
