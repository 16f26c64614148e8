/** The kernel against values worked by hand. That it is Python's, tests/web/ asks. */
import { describe, expect, test } from "vitest";
import { nextLevel } from "../src/kernel/adaptive";
import { Chance } from "../src/kernel/chance";
import type { ScriptQuestion, UpDownRule, WebDesign } from "../src/kernel/formats";
import { Pacer } from "../src/kernel/pacing";
import { placeOf } from "../src/kernel/places";
import { latinRow } from "../src/kernel/plan";
import { answerOf, frameOf } from "../src/kernel/script";

describe("chance", () => {
  test("is SHA-256 of the seed's hash and a counter", () => {
    // sha256(sha256('[1,"P01"]') + 8 zero bytes) begins with these eight bytes.
    const first = 0x729b87ec28f0c667n;
    expect(new Chance(1, "P01").below(1000)).toBe(Number(first % 1000n));
  });

  test("refuses seeds that JavaScript would round", () => {
    expect(() => new Chance(2 ** 53)).toThrow("a seed must hold whole numbers");
    expect(() => new Chance(0.5)).toThrow("a seed must hold whole numbers");
  });

  test("shuffles without loss", () => {
    const items = [...Array(100).keys()];
    const order = new Chance(3).shuffled(items);
    expect(order).not.toEqual(items);
    expect([...order].sort((a, b) => a - b)).toEqual(items);
  });
});

describe("places and rows", () => {
  test("drawn places are a permutation of each round", () => {
    const design = { places: "drawn", rounds: [2, 6] } as unknown as WebDesign;
    const places = [...Array(12).keys()].map((slot) => placeOf(design, 5, slot));
    expect([...places.slice(0, 6)].sort()).toEqual([0, 1, 2, 3, 4, 5]);
    expect([...places.slice(6)].sort()).toEqual([0, 1, 2, 3, 4, 5]);
  });

  test("rows of a Latin square zigzag, and an odd square has its mirror image", () => {
    expect(latinRow(4, 0)).toEqual([0, 1, 3, 2]);
    expect(latinRow(4, 1)).toEqual([1, 2, 0, 3]);
    expect(latinRow(3, 3)).toEqual([2, 1, 0]);
  });
});

describe("flips", () => {
  test("a missed refresh is counted, and a flip that is late on its own is not", () => {
    const pacer = new Pacer(100);
    expect([0, 0.01, 0.0118, 0.03, 0.0425].map((t_s) => pacer.flip(t_s))).toEqual([0, 1, 0, 2, 1]);
  });
});

describe("levels", () => {
  const rule: UpDownRule = {
    kind: "up-down",
    levels: [1, 2, 3, 4, 5],
    start: 5,
    harder: [2, 1],
    easier: [2, 1],
    in_a_row: 2,
    one_at_first: true,
    falling: false,
  };

  test("a track goes down by its first step until it turns, then needs two in a row", () => {
    expect(nextLevel(rule, [])).toBe(5);
    expect(nextLevel(rule, [[5, true]])).toBe(3);
    const turned = [[5, true], [3, false]] as const;
    expect(nextLevel(rule, turned)).toBe(4);
    expect(nextLevel(rule, [...turned, [4, true]])).toBe(4);
    expect(nextLevel(rule, [...turned, [4, true], [4, true]])).toBe(3);
  });

  test("an answer at a level that the track did not ask for is refused", () => {
    expect(() => nextLevel(rule, [[1, true]])).toThrow("asks for 5");
  });
});

describe("answers and frames", () => {
  const question: ScriptQuestion = {
    name: "answer",
    answers: ["first", "second", "none"],
    keys: [["left", "a"], ["right"], ["space"]],
    pointer: true,
  };

  test("a key gives its answer, and a click that of its column", () => {
    expect(answerOf(question, "a")).toBe("first");
    expect(answerOf(question, "b")).toBeNull();
    expect([-0.1, 0, 0.34, 0.99, 1].map((x) => answerOf(question, "pointer", x))).toEqual([
      "first",
      "first",
      "second",
      "none",
      "none",
    ]);
    expect(answerOf({ ...question, pointer: false }, "pointer", 0.5)).toBeNull();
  });

  test("a clip keeps its last frame", () => {
    const clip = { kind: "frames", stimulus: 0, every: 2, last: 3, at: [0, 0], crop: null } as const;
    expect([0, 1, 2, 7, 8, 100].map((refreshes) => frameOf(clip, refreshes))).toEqual([
      0, 0, 1, 3, 3, 3,
    ]);
  });
});
