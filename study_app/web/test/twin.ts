/** Answers questions about the kernel, a JSON line each: how Python's tests compare both sides. */
import { createHash } from "node:crypto";
import { createInterface } from "node:readline";
import type { AttemptRun, Disturbance, Press } from "../src/kernel/attempt";
import { Chance } from "../src/kernel/chance";
import { conduct, type Page, type PageResult, type Stage } from "../src/kernel/conduct";
import type { BrowserWindow, Machine, QuestPlusRule, UpDownRule, WebDesign, WebStudy } from "../src/kernel/formats";
import { LineLog, type Begun, type History, type Store } from "../src/kernel/lines";
import { at } from "../src/kernel/list";
import { nextLevel, type Answered } from "../src/kernel/adaptive";
import { Pacer } from "../src/kernel/pacing";
import { makePlan, type Person } from "../src/kernel/plan";
import { encoded, poseOf, turnedAway } from "../src/kernel/poses";
import { frameOf, type TrialScript } from "../src/kernel/script";
import { following, nextStep, type SessionEvent } from "../src/kernel/session";
import { showsAll } from "../src/kernel/window";
import { advance, BEGIN, follows, isDone, type Observed, type Trial } from "../src/kernel/trial";

type Asked =
  | { ask: "design"; name: string; design: WebDesign }
  | { ask: "plan"; name: string; person: Person }
  | { ask: "walk"; name: string; person: Person; events: SessionEvent[] }
  | { ask: "levels"; rule: QuestPlusRule | UpDownRule; history: Answered[] }
  | { ask: "flips"; refresh_hz: number; stamps_s: number[] }
  | { ask: "attempt"; script: TrialScript; observed: Observed[] }
  | { ask: "poses"; quaternions: [number, number, number, number][]; most_deg: number }
  | { ask: "window"; window: BrowserWindow; need_px: [number, number] }
  | { ask: "session"; study: WebStudy; begun: Begun; faults: Faults; luck: number; page: Opened };

/** Openings of pages: when the first is, its history, the rates, of which the last one goes on. */
interface Opened {
  readonly opened_s: number;
  readonly past: History | null;
  readonly rates_hz: readonly number[];
  /** Lines after which nobody opens the page again. Null: it is opened until the end. */
  readonly most: number | null;
}

/** Shares at which something happens: refreshes missed, pauses, disturbances, deaths of the page. */
interface Faults {
  readonly missed: number;
  readonly paused: number;
  readonly disturbed: number;
  /** Of all moments at which a store was asked something. */
  readonly killed: number;
}

/** [stimulus, frame] of everything of the trial's that the next flip shows. */
function framesOf(trial: Trial, script: TrialScript): [number, number][] {
  const { show } = at(script.phases, trial.phase);
  const shown = show.filter((entry) => entry.kind === "frames");
  return shown.map((entry) => [entry.stimulus, frameOf(entry, trial.frames)]);
}

const designs = new Map<string, WebDesign>();

function designOf(name: string): WebDesign {
  const design = designs.get(name);
  if (!design) throw new Error(`no design ${name}`);
  return design;
}

/** A page that dies: nothing of it goes on. */
class Killed extends Error {}

/** A server that keeps what it was told, and kills the page at random around each write. */
class Server implements Store {
  readonly results: string[] = [];
  private dead = false;

  constructor(
    public history: History | null,
    private readonly dies: () => boolean,
  ) {}

  load(): Promise<History | null> {
    this.dead = false; // another page
    return Promise.resolve(this.history);
  }

  keep(history: History): Promise<void> {
    return this.write(() => {
      this.history = JSON.parse(JSON.stringify(history)) as History;
    });
  }

  send(line: string): Promise<void> {
    return this.write(() => this.results.push(line));
  }

  private write(done: () => unknown): Promise<void> {
    this.dead ||= this.dies();
    if (!this.dead) done();
    this.dead ||= this.dies();
    return this.dead ? Promise.reject(new Killed()) : Promise.resolve();
  }
}

/** A screen and a participant that exist in numbers only. */
class Screen implements Stage {
  now_us = 0;

  constructor(
    private readonly study: WebStudy,
    private readonly rate_hz: number,
    private readonly opened_ms: number,
    private readonly chance: (share: number) => boolean,
    private readonly pick: <T>(of: readonly T[]) => T,
    private readonly faults: Faults,
  ) {}

  stamps(): { t_s: number; at: string; opening: number } {
    const at = new Date(this.opened_ms + this.now_us / 1e3).toISOString();
    return { t_s: Math.round(this.now_us) / 1e6, at, opening: this.opened_ms };
  }

  page(page: Page): Promise<PageResult> {
    const duration_s = page.least_s + 1.5;
    this.now_us += duration_s * 1e6;
    const answer = page.question ? at([...page.question.choices, "free <b>text</b> ü"], 0) : "";
    return Promise.resolve({ leaves: false, answer, duration_s });
  }

  prepare(): Promise<null> {
    this.now_us += 2e5;
    return Promise.resolve(null);
  }

  attempt(run: AttemptRun): Promise<void> {
    const { window_px, device_pixel_ratio, scale, full_screen } = machineAt(this.rate_hz);
    run.window = { window_px, device_pixel_ratio, scale, full_screen };
    const period_us = 1e6 / this.rate_hz;
    let grid_us = this.now_us;
    while (!run.done) {
      const { phase } = run.shows();
      this.now_us = grid_us += period_us * (this.chance(this.faults.missed) ? 5 : 1);
      const presses: Press[] = [];
      const press = (key: string) => {
        presses.push({ key, at_us: Math.round(grid_us + 100), x: key === "pointer" ? 0.3 : null });
      };
      if (phase.question && this.chance(0.05)) press(this.pick(phase.question.keys.flat()));
      if (phase.question?.pointer && this.chance(0.02)) press("pointer");
      if (this.chance(0.01)) press("z");
      if (this.chance(this.faults.paused)) press(at(this.study.pause_keys, 0));
      const what: Disturbance | null = this.chance(this.faults.disturbed) ? "hidden" : null;
      run.flipped(Math.round(grid_us), presses, what);
    }
    return Promise.resolve();
  }
}

const machineAt = (rate_hz: number): Machine => ({
  browser: "Made up 1",
  refresh_hz: rate_hz * 0.9995,
  missed_share: 0.003,
  window_px: [1920, 1080],
  device_pixel_ratio: 1.25,
  scale: 1,
  color_gamut: "srgb",
  full_screen: true,
  touch: false,
  simulated: false,
  headset: null,
});

/** A whole session by the kernel: the results as a server has them, and how often the page died. */
async function session(asked: Extract<Asked, { ask: "session" }>): Promise<unknown> {
  const { study, begun, faults } = asked;
  const { past: first, rates_hz, most } = asked.page;
  const luck = new Chance(asked.luck, "luck");
  const chance = (share: number) => share > 0 && luck.below(1_000_000) < share * 1e6;
  const pick = <T>(of: readonly T[]): T => at(of, luck.below(of.length));
  const enough = (): boolean => most !== null && server.results.length >= most;
  const server: Server = new Server(first, () => enough() || chance(faults.killed));
  let opened_ms = 1000 * asked.page.opened_s;
  const hash = (text: string) => Promise.resolve(createHash("sha256").update(text).digest("hex"));
  for (let deaths = 0; ; deaths++) {
    const rate_hz = rates_hz[Math.min(deaths, rates_hz.length - 1)] ?? begun.rate_hz;
    const rate = at(study.rates, study.rates.findIndex((one) => one.refresh_hz === rate_hz));
    const screen = new Screen(study, rate_hz, opened_ms, chance, pick, faults);
    const stamps = () => screen.stamps();
    try {
      const past = await server.load();
      const lines = past
        ? await LineLog.reopened(server, study, stamps, past, rate.refresh_hz, machineAt(rate.refresh_hz))
        : await LineLog.begin(server, study, stamps, begun, await hash(JSON.stringify(study)), machineAt(rate.refresh_hz));
      const ending = await conduct(study, rate, lines, screen, hash);
      return { ending, deaths, results: server.results };
    } catch (error) {
      if (!(error instanceof Killed)) throw error;
      if (enough()) return { ending: null, deaths, results: server.results, past: server.history };
      opened_ms += Math.ceil(screen.now_us / 1e3) + 1000;
    }
  }
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
    case "poses": {
      const poses = asked.quaternions.map(([x, y, z, w]) => poseOf({ x, y, z, w }));
      return { text: encoded(poses), away: poses.map((pose) => turnedAway(pose, asked.most_deg)) };
    }
    case "window":
      return showsAll(asked.window, asked.need_px);
    case "session":
      return session(asked);
    case "attempt": {
      let trial = BEGIN;
      return asked.observed.flatMap((observed) => {
        if (isDone(trial, asked.script)) return [];
        const shows = framesOf(trial, asked.script);
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
    told = { answer: await answer(JSON.parse(line) as Asked) };
  } catch (error) {
    told = { error: String(error) };
  }
  process.stdout.write(JSON.stringify(told) + "\n");
}
