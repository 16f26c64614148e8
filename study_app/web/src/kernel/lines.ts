/** The lines that go home, as `protocols/browser/web_lines.py` defines them. */
import type { AttemptLog } from "./attempt";
import type { SessionEvent } from "./session";
import type { VoidReason } from "./script";

/** Machine as the gate found it: nothing that tells one person from another. */
export interface Machine {
  readonly browser: string;
  readonly refresh_hz: number;
  readonly missed_share: number;
  readonly window_px: readonly [number, number];
  readonly device_pixel_ratio: number;
  readonly scale: number;
  readonly color_gamut: "srgb" | "p3" | "rec2020" | "unknown";
  readonly full_screen: boolean;
  readonly touch: boolean;
  /** An artificial observer drives the page. */
  readonly simulated: boolean;
}

/** Participant of a session, and the source of its numbers. */
export interface Begun {
  readonly participant: string;
  readonly slot: number;
  readonly slot_from: "link" | "batch" | "drawn";
  readonly seed: number;
  readonly language: string;
  readonly rate_hz: number;
  readonly identifier: string | null;
}

export interface AttemptSaid extends AttemptLog {
  readonly kind: "attempt";
  readonly trial: string;
  readonly attempt: number;
  readonly position: number;
  readonly outcome: "completed" | "void";
  readonly void_reason: VoidReason | null;
  readonly answer: string | null;
}

export type Said =
  | (Begun & {
      readonly kind: "start";
      readonly format: 1;
      readonly protocol_sha256: string;
      readonly manifest_sha256: string;
      readonly study_file_sha256: string;
      readonly revision: string;
      readonly machine: Machine;
    })
  | { readonly kind: "resume"; readonly rate_hz: number; readonly machine: Machine }
  | { readonly kind: "consent"; readonly agreed: boolean; readonly text_sha256: string }
  | { readonly kind: "block-start"; readonly block: number }
  | { readonly kind: "block-end"; readonly block: number }
  | { readonly kind: "break"; readonly after_block: number; readonly duration_s: number }
  | { readonly kind: "pause"; readonly duration_s: number }
  | AttemptSaid
  | { readonly kind: "answer"; readonly question: string; readonly text: string }
  | { readonly kind: "note"; readonly text: string }
  | {
      readonly kind: "end";
      readonly reason: "completed" | "quit" | "consent-refused" | "error";
    };

export type Line = Said & {
  readonly study: string;
  readonly participant: string;
  /** Number of the opening of the page that wrote it, from 0. */
  readonly run: number;
  /** Number of the line, from 0, over all runs. */
  readonly n: number;
  readonly t_s: number;
  readonly at: string;
};

/** Memory of a page that is opened again; small enough for a server's memory of a session. */
export interface History {
  readonly begun: Begun;
  readonly run: number;
  /** Number of the next line. */
  readonly next: number;
  readonly events: readonly SessionEvent[];
  /** The last line, which may not have arrived. */
  readonly last: string;
}

/** Store of lines. `keep` ends when the history is safe, `send` when the line has arrived. */
export interface Store {
  load(): Promise<History | null>;
  keep(history: History): Promise<void>;
  send(line: string): Promise<void>;
}

/** Numbers lines and hands them to a store: the history with the line first, the line second.
 *
 * So a page that dies in between costs nothing: `reopened` sends the last line again, and no number
 * is ever given to two lines.
 */
export class LineLog {
  private constructor(
    private readonly store: Store,
    private readonly study: string,
    private readonly stamps: () => { t_s: number; at: string },
    readonly begun: Begun,
    readonly run: number,
    private next: number,
    private events: readonly SessionEvent[],
  ) {}

  static begin(
    store: Store,
    study: string,
    stamps: () => { t_s: number; at: string },
    begun: Begun,
  ): LineLog {
    return new LineLog(store, study, stamps, begun, 0, 0, []);
  }

  /** Go on where a page stopped. */
  static async reopened(
    store: Store,
    study: string,
    stamps: () => { t_s: number; at: string },
    past: History,
  ): Promise<LineLog> {
    await store.send(past.last);
    return new LineLog(store, study, stamps, past.begun, past.run + 1, past.next, past.events);
  }

  /** Events so far, of all that decides what comes next. */
  get history(): readonly SessionEvent[] {
    return this.events;
  }

  async say(said: Said, event: SessionEvent | null = null): Promise<void> {
    const { study, run, begun } = this;
    const n = this.next++;
    if (event) this.events = [...this.events, event];
    const line: Line = { study, participant: begun.participant, run, n, ...this.stamps(), ...said };
    const text = JSON.stringify(line) + "\n";
    await this.store.keep({ begun, run, next: this.next, events: this.events, last: text });
    await this.store.send(text);
  }
}
