/** Stores of lines: JATOS, or the browser's own storage, from where they are saved as a file. */
import type { History, Store } from "../kernel/lines";

/** Part of `jatos.js` that the page uses. */
export interface Jatos {
  /** Of the participant's link. */
  readonly urlQueryParameters?: Readonly<Record<string, string>>;
  readonly studySessionData: Record<string, unknown> | undefined;
  readonly studyResultUuid?: string;
  readonly batchSession: {
    get(name: string): unknown;
    add(path: string, value: unknown): Promise<unknown>;
    replace(path: string, value: unknown): Promise<unknown>;
    test(path: string, value: unknown): Promise<unknown>;
    defined(path: string): boolean;
  };
  onLoad(callback: () => void): void;
  showBeforeUnloadWarning?(shows: boolean): void;
  setStudySessionData(data: object): Promise<unknown>;
  appendResultData(data: string): Promise<unknown>;
  endStudy(successful: boolean): Promise<unknown>;
  abortStudy(message?: string): Promise<unknown>;
  uploadResultFile(data: string, name: string): Promise<unknown>;
}

/** Request that a server did not take, though it was asked again and again. */
export class UnsentError extends Error {}

/** Told that a request is tried anew (true), and that it came through, or was given up (false). */
export type Told = (down: boolean) => void;

/** Tries of a request: four minutes, where each fails at once. */
const TRIES = 14;
const MOST_WAIT_MS = 30_000;

/** Ask until it is done, ever more slowly; then give up. */
export async function insist<T>(what: () => Promise<T>, told?: Told, tries = TRIES): Promise<T> {
  let left = tries;
  try {
    for (let wait_ms = 500; ; wait_ms = Math.min(2 * wait_ms, MOST_WAIT_MS)) {
      try {
        return await what();
      } catch (error) {
        if (left === tries) told?.(true);
        if (--left <= 0) throw new UnsentError(String(error), { cause: error });
        await new Promise((resolve) => setTimeout(resolve, wait_ms));
      }
    }
  } finally {
    if (left < tries) told?.(false);
  }
}

export class JatosStore implements Store {
  /** The server takes no more results of this run, 5 MB by default: further lines are files. */
  private full = false;
  /** A line was given up: whoever waits for the next one is not kept for minutes again. */
  private gone = false;

  constructor(
    private readonly jatos: Jatos,
    private readonly told?: Told,
  ) {}

  load(): Promise<History | null> {
    const past = this.jatos.studySessionData?.["metamerlab"];
    return Promise.resolve((past as History | undefined) ?? null);
  }

  async keep(history: History): Promise<void> {
    const all = { ...this.jatos.studySessionData, metamerlab: history };
    await this.insist(() => this.jatos.setStudySessionData(all));
  }

  async send(line: string): Promise<void> {
    await this.insist(async () => {
      try {
        // Joined without a separator.
        if (!this.full) await this.jatos.appendResultData(line);
        else await this.upload(line);
      } catch (error) {
        if (this.full) throw error;
        await this.upload(line); // fails, too, where the line is down
        this.full = true;
      }
    });
  }

  private async insist(what: () => Promise<unknown>): Promise<void> {
    try {
      await insist(what, this.told, this.gone ? 1 : TRIES);
      this.gone = false;
    } catch (error) {
      this.gone = true;
      throw error;
    }
  }

  /** Make place for another participant: this run of the study ends, since who withdraws deletes all of it. */
  async leave(): Promise<void> {
    const past = await this.load();
    if (past) await this.send(past.last);
    await insist(() => this.jatos.endStudy(false));
  }

  /** Delete all that was said. */
  async withdraw(): Promise<void> {
    await insist(() => this.jatos.abortStudy("withdrawn by the participant"), undefined, 6);
  }

  private upload(line: string): Promise<unknown> {
    const { run, n } = JSON.parse(line) as { run: number; n: number };
    return this.jatos.uploadResultFile(line, `lines-${run}-${n}.txt`);
  }
}

/** The browser's own storage: for folders on a plain web server. Lines are saved as a file. */
export class LocalStore implements Store {
  /** Participant of this page. */
  private who: string | null = null;

  constructor(
    private readonly name: string,
    private readonly storage: Storage,
  ) {}

  load(): Promise<History | null> {
    const text = this.storage.getItem(`${this.name}:history`);
    const history = text === null ? null : (JSON.parse(text) as History);
    this.who = history?.begun.participant ?? null;
    return Promise.resolve(history);
  }

  keep(history: History): Promise<void> {
    this.who = history.begun.participant;
    this.storage.setItem(`${this.name}:history`, JSON.stringify(history));
    return Promise.resolve();
  }

  send(line: string): Promise<void> {
    this.storage.setItem(`${this.name}:lines`, this.lines() + line);
    return Promise.resolve();
  }

  /** All lines so far. */
  lines(): string {
    return this.storage.getItem(`${this.name}:lines`) ?? "";
  }

  /** True if the last session came to its end here and was forgotten. */
  get used(): boolean {
    return this.storage.getItem(`${this.name}:used`) !== null;
  }

  /** Lines that participants before have left, and nobody has saved. */
  left(): string {
    return this.storage.getItem(`${this.name}:left`) ?? "";
  }

  /** Make place for another participant, and lose nothing of this one's. */
  async leave(): Promise<void> {
    const last = (await this.load())?.last ?? "";
    const lines = this.lines();
    const all = lines.endsWith(last) ? lines : lines + last;
    if (all) this.storage.setItem(`${this.name}:left`, this.left() + all); // first: nothing is lost
    for (const what of ["history", "lines", "used"]) this.storage.removeItem(`${this.name}:${what}`);
  }

  /** Forget lines that were saved, of a session at its end or of participants before. */
  forget(saved: string): void {
    const own = this.lines() !== "";
    this.remove((line) => saved.includes(line));
    if (own && !this.lines()) this.storage.setItem(`${this.name}:used`, "1");
  }

  /** Delete all that this page's participant said. */
  withdraw(): Promise<void> {
    const { who } = this;
    if (who) this.remove((line) => line.includes(`"participant":"${who}"`));
    return Promise.resolve();
  }

  /** Remove lines. Another participant's stay: a second tab may have begun a session since. */
  private remove(which: (line: string) => boolean): void {
    for (const what of ["lines", "left"]) {
      const lines = (this.storage.getItem(`${this.name}:${what}`) ?? "").split(/(?<=\n)/);
      const others = lines.filter((line) => !which(line)).join("");
      if (others) this.storage.setItem(`${this.name}:${what}`, others);
      else this.storage.removeItem(`${this.name}:${what}`);
    }
    const history = this.storage.getItem(`${this.name}:history`);
    if (history && which((JSON.parse(history) as History).last)) {
      this.storage.removeItem(`${this.name}:history`);
    }
  }
}

/** Keeps a copy of every line, so that a participant can save them where sending fails. */
export class CopyingStore implements Store {
  private readonly copy = new Set<string>();
  private kept = Promise.resolve();
  private closed = false;

  /** `name` tells this link's store from all others of the browser. */
  constructor(
    readonly store: LocalStore | JatosStore,
    readonly name: string,
  ) {}

  /** The browser's own storage, where no server is. */
  get local(): LocalStore | null {
    return this.store instanceof LocalStore ? this.store : null;
  }

  load(): Promise<History | null> {
    return this.store.load();
  }

  keep(history: History): Promise<void> {
    if (this.closed) return new Promise(() => undefined); // another tab goes on
    this.copy.add(history.last); // before anything can fail
    return (this.kept = this.store.keep(history));
  }

  /** Take no more; ends when what was taken is safe, or was refused. */
  async close(): Promise<void> {
    this.closed = true;
    await this.kept.catch(() => undefined);
  }

  send(line: string): Promise<void> {
    this.copy.add(line);
    return this.store.send(line);
  }

  /** All lines so far; of JATOS, those since the page was opened. */
  lines(): string {
    const before = this.local?.lines() ?? "";
    return before + [...this.copy].filter((line) => !before.includes(line)).join("");
  }
}
