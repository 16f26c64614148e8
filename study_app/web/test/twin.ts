/** Answers questions about the kernel, a JSON line each: how Python's tests compare both sides. */
import { createInterface } from "node:readline";
import { nextLevel, type Answered } from "../src/kernel/adaptive";
import type { Design, Person, QuestPlusRule, UpDownRule } from "../src/kernel/design";
import { Pacer } from "../src/kernel/pacing";
import { makePlan } from "../src/kernel/plan";
import type { TrialScript } from "../src/kernel/script";
import { following, nextStep, type SessionEvent } from "../src/kernel/session";
import { advance, BEGIN, follows, isDone, shownFrames, type Observed } from "../src/kernel/trial";

type Asked =
  | { ask: "design"; name: string; design: Design }
  | { ask: "plan"; name: string; person: Person }
  | { ask: "walk"; name: string; person: Person; events: SessionEvent[] }
  | { ask: "levels"; rule: QuestPlusRule | UpDownRule; history: Answered[] }
  | { ask: "flips"; refresh_hz: number; stamps_s: number[] }
  | { ask: "attempt"; script: TrialScript; observed: Observed[] };

const designs = new Map<string, Design>();

function designOf(name: string): Design {
  const design = designs.get(name);
  if (!design) throw new Error(`no design ${name}`);
  return design;
}

function answer(asked: Asked): unknown {
  switch (asked.ask) {
    case "design":
      designs.set(asked.name, asked.design);
      return null;
    case "plan":
      return makePlan(designOf(asked.name), asked.person).trials;
    case "walk": {
      const design = designOf(asked.name);
      const plan = makePlan(design, asked.person);
      return Array.from({ length: asked.events.length + 1 }, (_, count) => {
        const events = asked.events.slice(0, count);
        const step = nextStep(design, plan, events);
        const next = step.step === "run-trial" ? following(design, plan, events, step.trial) : null;
        return { ...step, following: next?.id ?? null };
      });
    }
    case "levels":
      return Array.from({ length: asked.history.length + 1 }, (_, count) =>
        nextLevel(asked.rule, asked.history.slice(0, count)),
      );
    case "flips": {
      const pacer = new Pacer(asked.refresh_hz);
      return asked.stamps_s.map((t_s) => pacer.flip(t_s));
    }
    case "attempt": {
      let trial = BEGIN;
      return asked.observed.flatMap((observed) => {
        if (isDone(trial, asked.script)) return [];
        const shows = shownFrames(trial, asked.script);
        const told = follows(trial, asked.script)?.of ?? null;
        trial = advance(trial, observed, asked.script);
        return [{ ...trial, shows, told }];
      });
    }
  }
}

for await (const line of createInterface({ input: process.stdin })) {
  let told: unknown;
  try {
    told = { answer: answer(JSON.parse(line) as Asked) };
  } catch (error) {
    told = { error: String(error) };
  }
  process.stdout.write(JSON.stringify(told) + "\n");
}
