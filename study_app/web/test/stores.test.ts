/** A browser's storage, which participants use one after the other. */
import { describe, expect, it } from "vitest";
import type { History } from "../src/kernel/lines";
import { LocalStore } from "../src/store/stores";

function storage(): Storage {
  const held = new Map<string, string>();
  return {
    get length() {
      return held.size;
    },
    key: (index) => [...held.keys()][index] ?? null,
    getItem: (name) => held.get(name) ?? null,
    setItem: (name, text) => void held.set(name, text),
    removeItem: (name) => void held.delete(name),
    clear: () => {
      held.clear();
    },
  };
}

const lineOf = (participant: string, n: number) => `{"study":"s","participant":"${participant}","n":${n}}\n`;

/** Let a participant say so many lines in a page of its own. */
async function says(store: LocalStore, participant: string, lines: number): Promise<void> {
  const of = { slot: 0, slot_from: "link", seed: 1, language: "en", rate_hz: 60, identifier: null, places_key: null } as const;
  for (let n = 0; n < lines; n++) {
    const last = lineOf(participant, n);
    const history: History = { begun: { participant, ...of }, run: 0, next: n + 1, events: [], last };
    await store.keep(history);
    await store.send(last);
  }
}

describe("a page that stays open at its end", () => {
  it.each(["saves", "withdraws"])("%s its own lines only, whoever began in another tab since", async (how) => {
    const shared = storage();
    const page = () => new LocalStore("link", shared);
    const [old, gate, next] = [page(), page(), page()];
    await says(old, "w-old", 3);
    const saved = old.lines();
    await gate.load();
    await gate.leave();
    expect(gate.left()).toBe(saved);
    await says(next, "w-next", 2);
    if (how === "saves") old.forget(saved);
    else await old.withdraw();
    expect(next.left()).toBe("");
    expect(next.lines()).toBe(lineOf("w-next", 0) + lineOf("w-next", 1));
    expect((await next.load())?.begun.participant).toBe("w-next");
    expect(next.used).toBe(false);
  });

  it("keeps what the same participant said in another tab since", async () => {
    const shared = storage();
    const old = new LocalStore("link", shared);
    await says(old, "w-old", 2);
    const saved = old.lines();
    await says(new LocalStore("link", shared), "w-old", 3);
    old.forget(saved);
    expect(old.lines()).toContain(lineOf("w-old", 2));
    expect(await old.load()).not.toBeNull();
  });
});
