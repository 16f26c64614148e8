/** Packs come in parts where the server can, and whole where it cannot; hashes come first. */
import { createHash } from "node:crypto";
import { afterEach, beforeEach, describe, expect, test, vi } from "vitest";
import type { Pack, WebStudy } from "../src/kernel/formats";
import { fetched, Files, partsOf } from "../src/stage/files";

const SIZES = [700_000, 300_000, 500_000, 2_000_000, 10];
const BYTES = Uint8Array.from({ length: SIZES.reduce((a, b) => a + b) }, (_, n) => (n * 7919) >> 3);
const ENDS = SIZES.map((_, n) => SIZES.slice(0, n + 1).reduce((a, b) => a + b));
const PACK = {
  file: "a clip.pack",
  bytes: BYTES.length,
  ends: ENDS,
  shared: [],
  frames: [],
  sha256: ENDS.map((end, n) => createHash("sha256").update(BYTES.subarray(ENDS[n - 1] ?? 0, end)).digest("hex")),
} as unknown as Pack;
const STUDY = { stimuli: { clip: PACK }, stimulus_px: [4, 3], pictures: {} } as unknown as WebStudy;

/** Requests so far: the range, and how the cache is used. */
let asked: [string, RequestCache | undefined][];
let decoded: number[];

/** A server: what it answers to a range, or to the whole file where it is null. */
function serves(answer: (range: [number, number] | null) => [number, Uint8Array]): void {
  vi.stubGlobal("fetch", (_url: string, init: RequestInit) => {
    const range = new Headers(init.headers).get("range");
    asked.push([range ?? "whole", init.cache]);
    const [, from, to] = /^bytes=(\d+)-(\d+)$/.exec(range ?? "") ?? [];
    const [status, bytes] = answer(range === null ? null : [Number(from), Number(to) + 1]);
    return Promise.resolve(new Response(bytes as BodyInit, { status }));
  });
}

const withRanges = (range: [number, number] | null): [number, Uint8Array] =>
  range ? [206, BYTES.slice(...range)] : [200, BYTES];
const withoutRanges = (): [number, Uint8Array] => [200, BYTES];

beforeEach(() => {
  [asked, decoded] = [[], []];
  vi.stubGlobal("createImageBitmap", (blob: Blob) => {
    decoded.push(blob.size);
    return Promise.resolve({ width: 4, height: 3, close: () => undefined });
  });
});
afterEach(() => {
  vi.unstubAllGlobals();
});

describe("a pack", () => {
  test("is cut between frames, a part at most a mebibyte unless one frame has more", () => {
    expect(partsOf(PACK)).toEqual([[0, 2], [2, 3], [3, 4], [4, 5]]);
  });

  test("comes in parts from a server with ranges", async () => {
    serves(withRanges);
    expect(await new Files(STUDY).frames("clip")).toHaveLength(5);
    const ranges = ["bytes=0-999999", "bytes=1000000-1499999", "bytes=1500000-3499999", "bytes=3500000-3500009"];
    expect(asked).toEqual(ranges.map((range) => [range, "force-cache"]));
    expect(decoded).toEqual(SIZES);
  });

  test("comes whole, and once, from a server without ranges", async () => {
    serves(withoutRanges);
    expect(await new Files(STUDY).frames("clip")).toHaveLength(5);
    expect(asked).toHaveLength(1);
    expect(decoded).toEqual(SIZES);
  });

  test("is asked for whole where ranges give something else", async () => {
    serves((range) => (range ? [206, BYTES.slice(5, 5 + range[1] - range[0])] : [200, BYTES]));
    expect(await new Files(STUDY).frames("clip")).toHaveLength(5);
    expect(asked).toEqual([["bytes=0-999999", "force-cache"], ["whole", "reload"]]);
    expect(decoded).toEqual(SIZES); // nothing of what was wrong
  });

  test("of one part is asked for without a range", async () => {
    const small = { ...PACK, ends: [10], bytes: 10, sha256: [createHash("sha256").update(BYTES.subarray(0, 10)).digest("hex")] };
    serves(() => [200, BYTES.slice(0, 10)]);
    await new Files({ ...STUDY, stimuli: { clip: small } }).frames("clip");
    expect(asked).toEqual([["whole", "force-cache"]]);
  });

  test("with a wrong byte is named and nothing of that part is decoded", async () => {
    const changed = Uint8Array.from(BYTES);
    changed[1_200_000] = (changed[1_200_000] ?? 0) ^ 1;
    serves((range) => (range ? [206, changed.slice(...range)] : [200, changed]));
    await expect(new Files(STUDY).frames("clip")).rejects.toThrow(
      "frame 2 of clip is not the one that was hashed",
    );
    expect(decoded).not.toContain(SIZES[2]);
  });

  test("that is short is named", async () => {
    serves(() => [200, BYTES.slice(0, -1)]);
    await expect(new Files(STUDY).frames("clip")).rejects.toThrow(
      "packs/a clip.pack must have 3500010 bytes (has 3500009)",
    );
  });
});

/** Time passes to each next timer, until `done` has come; how much that was. */
async function passing<T>(done: Promise<T>): Promise<[T, number]> {
  const began_ms = performance.now();
  const left = new Set([done]);
  const over = () => left.delete(done);
  done.then(over, over);
  while (left.size) await vi.advanceTimersToNextTimerAsync();
  return [await done, performance.now() - began_ms];
}

describe("a file", () => {
  beforeEach(() => {
    vi.useFakeTimers();
  });
  afterEach(() => {
    vi.useRealTimers();
  });

  test("is asked for again for minutes, ever more slowly, and whoever waits is told once", async () => {
    const told: boolean[] = [];
    serves(() => [asked.length < 12 ? 503 : 200, BYTES.slice(0, 5)]);
    const [data, took_ms] = await passing(fetched("some", "default", "", (down) => told.push(down)));
    expect([data.byteLength, asked.length, told]).toEqual([5, 12, [true, false]]);
    expect(took_ms).toBeGreaterThan(120_000);
    expect(asked.slice(0, 3).map(([, cache]) => cache)).toEqual(["default", "reload", "reload"]);
  });

  test("that never comes is named with what the server said", async () => {
    serves(() => [503, BYTES]);
    await expect(passing(fetched("some"))).rejects.toThrow("some did not come (the server says 503)");
    vi.stubGlobal("fetch", () => Promise.reject(new TypeError("the line is down")));
    await expect(passing(fetched("some"))).rejects.toThrow("some did not come (TypeError: the line is down)");
  });

  test("that is not there is asked for once", async () => {
    serves(() => [404, BYTES]);
    await expect(fetched("some")).rejects.toThrow("some did not come (the server says 404)");
    expect(asked).toHaveLength(1);
  });

  test("that sends no byte for a minute is asked for anew, and one that comes slowly is not", async () => {
    const waits_ms = [[50_000, 50_000, 61_000], [59_000, 59_000, 59_000]];
    vi.stubGlobal("fetch", (_url: string, { signal }: { signal: AbortSignal }) => {
      const [...waits] = waits_ms[asked.push(["whole", undefined]) - 1] ?? [];
      const body = new ReadableStream<Uint8Array>({
        async pull(controller) {
          const wait_ms = waits.shift();
          await new Promise((resolve) => setTimeout(resolve, wait_ms));
          if (wait_ms === undefined) controller.close();
          else if (signal.aborted) controller.error(signal.reason);
          else controller.enqueue(BYTES.slice(0, 7));
        },
      });
      return Promise.resolve(new Response(body));
    });
    const [data] = await passing(fetched("some"));
    expect([data.byteLength, asked.length]).toEqual([21, 2]);
  });

  test("of text that was kept wrong is fetched again, past what was kept", async () => {
    const sha256 = createHash("sha256").update(BYTES.subarray(0, 9)).digest("hex");
    const picture = { file: "some.png", sha256, size_px: [4, 3] } as const;
    serves(() => [200, BYTES.slice(0, asked.length < 2 ? 8 : 9)]);
    expect((await new Files({ ...STUDY, pictures: { words: picture } }).pictures()).size).toBe(1);
    expect(asked).toEqual([["whole", "default"], ["whole", "reload"]]);
  });
});
