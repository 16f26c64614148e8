/** Before consent: can this browser and screen run the study? Refusals say what to do. */
import type { BrowserWindow, Machine, RefreshRate, WebStudy } from "../kernel/formats";
import { Pacer } from "../kernel/pacing";
import { keyName } from "./keys";
import { button, lineOf, showParts } from "./note";
import { filled, type Words } from "./words";

const REFRESHES = 300;
/** Largest distance of a measured rate from one of the study's, as a share. */
const NEAR_SHARE = 0.005;
const LEAST_MEMORY_GB = 2;

type Measured = Pick<Machine, "refresh_hz" | "missed_share">;

/** Reason why the study does not run here, in the participant's language. */
export class Refusal extends Error {
  override name = "Refusal"; // the headset's file has a class of its own
}

export function checkPhone(words: Words): void {
  const phone = matchMedia("(pointer: coarse) and (hover: none)").matches;
  if (phone && Math.min(screen.width, screen.height) < 600) throw new Refusal(words.phone);
}

/** Refuse a browser by what is known before anything is measured. */
export function checkBrowser(study: WebStudy, words: Words): void {
  if (!isSecureContext) throw new Refusal(words.insecure);
  const memory = (navigator as { deviceMemory?: number }).deviceMemory ?? 8;
  const wanted_gb = (4 * study.decoded_bytes) / 1e9; // browsers keep several copies
  if (memory < Math.min(LEAST_MEMORY_GB, wanted_gb)) throw new Refusal(words.memory);
}

/** True if clicks and touches answer whatever a trial asks; pages have buttons. */
function takesPointer(study: WebStudy): boolean {
  const phases = study.rates.flatMap(({ scripts }) => Object.values(scripts).flat().flatMap((script) => script.phases));
  return phases.every(({ question }) => question?.pointer ?? true);
}

/** Ask a device that may have no keyboard for one key, where the study needs keys. */
export async function checkKeys(study: WebStudy, words: Words, pages: HTMLElement): Promise<void> {
  if (takesPointer(study) || !matchMedia("(pointer: coarse)").matches) return;
  const here = new AbortController();
  await new Promise<void>((resolve, reject) => {
    const down = (event: KeyboardEvent) => {
      if (keyName(event)) resolve();
    };
    addEventListener("keydown", down, here);
    const none = button(words.noKeyboard, "leave", () => {
      reject(new Refusal(words.phone));
    });
    showParts(pages, "keys", lineOf(words.keyboard), none);
  }).finally(() => {
    here.abort();
  });
}

/** Screen pixels per pixel of a stimulus: whole, near the device's own ratio, and all is seen; 0: none is. */
export function scaleFor(
  [wide, high]: readonly [number, number],
  [width, height]: readonly [number, number],
  ratio: number,
): number {
  const fits = Math.floor(Math.min(width / wide, height / high));
  return Math.min(fits, Math.max(1, Math.round(ratio)));
}

/** Measure how often a screen refreshes; `refresh` calls at its next refresh. */
export async function measuredRate(refresh: (call: (now_ms: number) => void) => void): Promise<Measured> {
  const stamps_ms: number[] = [];
  await new Promise<void>((resolve) => {
    const frame = (now_ms: number) => {
      if (stamps_ms.push(now_ms) > REFRESHES) resolve();
      else refresh(frame);
    };
    refresh(frame);
  });
  return rateOf(stamps_ms);
}

/** The refresh rate of such stamps, and the share of refreshes without one. */
export function rateOf(stamps_ms: readonly number[]): Measured {
  const since = stamps_ms.slice(1).map((stamp, index) => stamp - (stamps_ms[index] ?? stamp));
  const sorted = [...since].sort((a, b) => a - b);
  const median_ms = sorted[Math.floor(sorted.length / 2)] ?? 1000 / 60;
  const pacer = new Pacer(1000 / median_ms);
  let refreshes = 0;
  for (const stamp of stamps_ms) refreshes += pacer.flip(stamp / 1000);
  const whole_ms = (stamps_ms.at(-1) ?? 0) - (stamps_ms[0] ?? 0);
  return {
    refresh_hz: Math.round((1e6 * refreshes) / whole_ms) / 1e3,
    missed_share: Math.max(0, 1 - since.length / refreshes),
  };
}

/** The study's rate nearest to a measured one. */
export function nearestRate(study: WebStudy, words: Words, refresh_hz: number): RefreshRate {
  const off = (rate: RefreshRate) => Math.abs(refresh_hz / rate.refresh_hz - 1);
  const [nearest] = [...study.rates].sort((a, b) => off(a) - off(b));
  if (nearest && off(nearest) <= NEAR_SHARE) return nearest;
  const rates = study.rates.map((rate) => rate.refresh_hz).join(", ");
  throw new Refusal(filled(words.rate, { rates, got: Math.round(refresh_hz) }));
}

/** Name and main version of the browser, and nothing else of what it says of itself. */
export function browserName(agent: string): string {
  const known = [/(Firefox)\/(\d+)/, /(Edg)\/(\d+)/, /(Chrome)\/(\d+)/, /Version\/(\d+).*(Safari)/];
  for (const pattern of known) {
    const found = pattern.exec(agent);
    if (found) {
      const [, first = "", second = ""] = found;
      return /\d/.test(first) ? `${second} ${first}` : `${first} ${second}`;
    }
  }
  return "unknown";
}

export function machineOf(measured: Measured, window: BrowserWindow, headset: Machine["headset"] = null): Machine {
  const gamuts = ["rec2020", "p3", "srgb"] as const;
  return {
    browser: browserName(navigator.userAgent),
    ...measured,
    ...window,
    color_gamut: gamuts.find((name) => matchMedia(`(color-gamut: ${name})`).matches) ?? "unknown",
    touch: navigator.maxTouchPoints > 0,
    simulated: "metamerlabSimulated" in globalThis, // set by what drives the page: no link can
    headset,
  };
}
