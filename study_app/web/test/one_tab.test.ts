/** One tab goes on, also where a browser has no locks. That locks do it, tests/web/ asks of browsers. */
import { afterEach, beforeEach, describe, expect, test, vi } from "vitest";
import { holdLink } from "../src/store/one_tab";

/** Channels of one browser, whose messages come at once. */
class Channel extends EventTarget {
  static readonly open = new Set<Channel>();
  onmessage: ((event: MessageEvent) => void) | null = null;

  constructor(readonly name: string) {
    super();
    Channel.open.add(this);
  }

  postMessage(data: string): void {
    for (const other of [...Channel.open].filter((one) => one !== this && one.name === this.name)) {
      const event = new MessageEvent("message", { data });
      other.onmessage?.(event);
      other.dispatchEvent(event);
    }
  }

  close(): void {
    Channel.open.delete(this);
  }
}

beforeEach(() => {
  vi.useFakeTimers();
  vi.stubGlobal("BroadcastChannel", Channel);
  vi.stubGlobal("navigator", {});
});
afterEach(() => {
  Channel.open.clear();
  vi.useRealTimers();
  vi.unstubAllGlobals();
});

const second = () => vi.advanceTimersByTimeAsync(1000);
const nothing = () => Promise.resolve();

describe("a tab without locks", () => {
  test("waits until the other one is closed, and another link does not", async () => {
    const first = holdLink("link", vi.fn(), nothing);
    await second();
    const waits = vi.fn();
    const goesOn = vi.fn();
    void holdLink("link", waits, nothing).then(goesOn);
    const other = holdLink("other link", vi.fn(), nothing);
    await second();
    expect((await other).waited).toBe(false);
    await vi.advanceTimersByTimeAsync(60_000);
    expect(waits).toHaveBeenCalledTimes(1);
    expect(goesOn).not.toHaveBeenCalled();
    (await first).release();
    await second();
    expect(goesOn).toHaveBeenCalledWith(expect.objectContaining({ waited: true }));
  });

  test("asks the other one, which first does what it must", async () => {
    const done: string[] = [];
    const leaves = async () => {
      await new Promise((resolve) => setTimeout(resolve, 700));
      done.push("left");
    };
    void holdLink("link", vi.fn(), leaves);
    await second();
    void holdLink("link", (ask) => { ask(); }, nothing).then(() => done.push("goes on"));
    await vi.advanceTimersByTimeAsync(10_000);
    expect(done).toEqual(["left", "goes on"]);
  });
});
