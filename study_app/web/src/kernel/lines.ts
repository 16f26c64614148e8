/** The lines that go home, as `protocols/browser/web_lines.py` defines them. */
import type { Machine, Sent, StartLine, WebLine, WebStudy } from "./formats";
import type { SessionEvent } from "./session";

/** Participant of a session, and the source of its numbers. */
export type Begun = Pick<
  StartLine,
  "participant" | "slot" | "slot_from" | "seed" | "places_key" | "language" | "rate_hz" | "identifier"
>;

type Without<L, K extends keyof L> = L extends unknown ? Omit<L, K> : never;

/** Event of a line, without number, times and sender. */
export type Said = Without<WebLine, keyof Sent>;

/** Clocks of the page, when a line is made, and which opening of it this is. */
type Stamps = () => Pick<Sent, "t_s" | "at" | "opening">;

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
    private readonly stamps: Stamps,
    readonly begun: Begun,
    readonly run: number,
    private next: number,
    private events: readonly SessionEvent[],
  ) {}

  /** Begin with a new participant's first line. */
  static async begin(
    store: Store, study: WebStudy, stamps: Stamps, begun: Begun, study_file_sha256: string, machine: Machine,
  ): Promise<LineLog> {
    const lines = new LineLog(store, study.study, stamps, begun, 0, 0, []);
    const { protocol_sha256, manifest_sha256, revision } = study;
    const of = { study_file_sha256, protocol_sha256, manifest_sha256, revision, machine };
    await lines.say({ kind: "start", format: 1, ...of, ...begun });
    return lines;
  }

  /** Go on where a page stopped. */
  static async reopened(
    store: Store, study: WebStudy, stamps: Stamps, past: History, rate_hz: number, machine: Machine,
  ): Promise<LineLog> {
    await store.send(past.last);
    const { begun, run, next, events } = past;
    const { opening } = JSON.parse(past.last) as Partial<Sent>; // earlier pages said none
    const lines = new LineLog(store, study.study, stamps, begun, run + 1, next, events);
    await lines.say({ kind: "resume", rate_hz, machine, continues: opening ?? null });
    return lines;
  }

  /** Events so far, of all that decides what comes next. */
  get history(): readonly SessionEvent[] {
    return this.events;
  }

  async say(said: Said, event: SessionEvent | null = null): Promise<void> {
    const { study, run, begun } = this;
    const n = this.next++;
    if (event) this.events = [...this.events, event];
    const line = { study, participant: begun.participant, run, n, ...this.stamps(), ...said };
    const text = JSON.stringify(line) + "\n";
    await this.store.keep({ begun, run, next: this.next, events: this.events, last: text });
    await this.store.send(text);
  }
}
