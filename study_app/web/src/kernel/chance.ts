/** Reproducible chance, as `protocols/disk/hashing.py` defines it: integers from SHA-256 of (seed, counter).
 *
 * SHA-256 is synchronous, so that what comes next in a session stays a pure function.
 */
import { sha256 } from "@noble/hashes/sha2.js";

const TWO_64 = 1n << 64n;
const utf8 = new TextEncoder();

/** A stream of integers, fixed by `seed`: whole numbers and texts. */
export class Chance {
  private readonly block = new Uint8Array(40); // the key, then the counter
  private readonly view = new DataView(this.block.buffer);
  private counter = 0n;

  constructor(...seed: readonly (number | string)[]) {
    const broken = seed.find((part) => typeof part === "number" && !Number.isSafeInteger(part));
    if (broken !== undefined) throw new Error(`a seed must hold whole numbers (got ${broken})`);
    this.block.set(sha256(utf8.encode(JSON.stringify(seed))));
  }

  /** An integer in [0, bound), every one equally likely. */
  below(bound: number): number {
    if (!(bound >= 1)) throw new Error(`bound must be at least 1 (got ${bound})`);
    const count = BigInt(bound);
    const limit = TWO_64 - (TWO_64 % count); // above it, the remainders would not be equally likely
    let drawn = this.draw();
    while (drawn >= limit) drawn = this.draw();
    return Number(drawn % count);
  }

  /** The items in random order (Fisher and Yates). */
  shuffled<T>(items: Iterable<T>): T[] {
    const order = [...items];
    for (let last = order.length - 1; last > 0; last--) {
      const other = this.below(last + 1);
      [order[last], order[other]] = [order[other] as T, order[last] as T];
    }
    return order;
  }

  private draw(): bigint {
    this.view.setBigUint64(32, this.counter++);
    const digest = sha256(this.block);
    return new DataView(digest.buffer, digest.byteOffset).getBigUint64(0);
  }
}
