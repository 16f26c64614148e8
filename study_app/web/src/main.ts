/** A study in this page: gate, session, thanks. `run` is all that a shell such as jsPsych calls. */
import { conduct, type Ending } from "./kernel/conduct";
import type { WebStudy } from "./kernel/formats";
import { LineLog, type Begun } from "./kernel/lines";
import type { Device, Opened } from "./stage/device";
import { FileError, fetched, Files, sha256 } from "./stage/files";
import { checkBrowser } from "./stage/gate";
import { copyLink, firstPage, withdrawal } from "./stage/first_page";
import { button, lineOf, showNote, showParts } from "./stage/note";
import { screenDevice } from "./stage/screen";
import { filled, wordsOf, type Words } from "./stage/words";
import { holdLink, type Hold } from "./store/one_tab";
import { CopyingStore, JatosStore, LocalStore, insist, UnsentError, type Jatos, type Told } from "./store/stores";

export type { Ending };

/** Most counterbalancing slots from which one is drawn where neither link nor server gives one. */
const SLOTS = 2 ** 20;

export interface Options {
  /** Address of the study's files. Left out: beside the page. */
  readonly base?: string;
  /** The study archive's server, where there is one. */
  readonly jatos?: Jatos;
  /** Parameters of the link. Left out: those of the page. */
  readonly link?: URLSearchParams;
  /** Work between the session's end and the thanks, after which a server takes nothing. */
  readonly rest?: (ending: Ending) => Promise<void>;
}

/** True if a session goes on that was begun before, or came to its end here. */
export function begun(options: Options = {}): Promise<boolean> {
  return overLine(async (told) => {
    const [, study] = await studyOf(options, told);
    const store = storeOf(options, study);
    return store.local?.used === true || (await store.load()) !== null;
  });
}

/** Ask something of the server, over all that the page shows: how the line is, or what went wrong. */
export async function overLine<T>(what: (told: Told) => Promise<T>): Promise<T> {
  const [canvas, pages] = stageElements();
  const words = wordsOf(navigator.language);
  canvas.remove();
  pages.hidden = true;
  try {
    const answer = await what((down) => {
      showNote(pages, words.down);
      pages.hidden = !down;
    });
    pages.remove();
    return answer;
  } catch (error) {
    showNote(pages, filled(words.broken, { why: messageOf(error) }), words.again);
    throw error;
  }
}

/** Run a study to its end; how it ended. */
export async function run(options: Options = {}): Promise<Ending | "refused"> {
  const link = options.link ?? linkOf(options.jatos);
  const base = options.base ?? "";
  const [canvas, pages] = stageElements();
  let words = wordsOf(navigator.language);
  let hold: Hold | null = null;
  let opened: Opened | null = null;
  try {
    const told = (down: boolean) => {
      showNote(pages, down ? words.down : words.wait);
    };
    const [bytes, study] = await studyOf(options, told);
    const store = storeOf(options, study, told);
    hold = await held(store, pages, wordsOf(languageOf(study, link)), options.jatos);
    const past = await store.load();
    const language = past?.begun.language ?? languageOf(study, link);
    const device = await deviceOf(study, base);
    words = device.words(language);
    document.documentElement.lang = language;
    document.title = study.title;
    checkBrowser(study, words);
    await device.check(study, words, pages);
    if (!(await firstPage(pages, study, language, words, device, store))) return "refused";
    const files = new Files(study, base);
    files.heard = () => {
      told(files.down);
    };
    opened = await device.open({ canvas, pages, study, files, words });
    const { stage, rate, machine } = opened;
    const stamps = () => stage.stamps();
    const { refresh_hz } = rate;
    const lines = past
      ? await LineLog.reopened(store, study, stamps, past, refresh_hz, machine)
      : await LineLog.begin(
          store, study, stamps, await drawn(study, language, refresh_hz, link, options.jatos, told), await sha256(bytes), machine,
        );
    const hash = (text: string) => sha256(new TextEncoder().encode(text));
    let ending: Ending;
    try {
      ending = await conduct(study, rate, lines, stage, hash);
    } catch (error) {
      const unsent = error instanceof UnsentError;
      const what = unsent ? words.unsent : filled(words.broken, { why: messageOf(error) });
      showNote(pages, what, words.again);
      pages.append(copyLink(words.save, study.study, store.lines(), words, null));
      throw error;
    }
    await opened.close?.();
    await options.rest?.(ending);
    await thank(study, language, words, pages, ending, store, options.jatos);
    return ending;
  } catch (error) {
    await opened?.close?.();
    const why = messageOf(error);
    const refused = error instanceof Error && error.name === "Refusal";
    const said = refused ? [why] : [filled(words.broken, { why }), words.again];
    if (!pages.querySelector("a")) showNote(pages, ...said);
    if (refused) return "refused";
    if (error instanceof FileError || error instanceof UnsentError) return "error";
    throw error;
  } finally {
    pages.dataset["page"] = "over"; // for whoever drives the page
    hold?.release();
  }
}

async function studyOf(options: Options, told: Told): Promise<[ArrayBuffer, WebStudy]> {
  const bytes = await fetched(`${options.base ?? ""}study.json`, "default", "", told);
  return [bytes, JSON.parse(new TextDecoder().decode(bytes)) as WebStudy];
}

/** The study's device. The part of the page that knows headsets is fetched only where it is used. */
async function deviceOf(study: WebStudy, base: string): Promise<Device> {
  if (!study.headset) return screenDevice;
  const { href } = new URL(`${base}metamerlab-headset.js`, document.baseURI);
  return ((await import(href)) as { headsetDevice: Device }).headsetDevice;
}

/** Without a server, a browser keeps a session for each link of each version of a study. */
function storeOf({ jatos, link }: Options, study: WebStudy, told?: Told): CopyingStore {
  if (jatos) return new CopyingStore(new JatosStore(jatos, told), `jatos:${jatos.studyResultUuid ?? study.study}`);
  const slot = (link ?? linkOf()).get("slot") ?? "";
  const name = [study.study, study.protocol_sha256.slice(0, 12), slot].join(":");
  return new CopyingStore(new LocalStore(name, localStorage), name);
}

/** Wait until no other tab has this link. */
async function held(store: CopyingStore, pages: HTMLElement, words: Words, jatos?: Jatos): Promise<Hold> {
  const waits = (ask: () => void) => {
    const here = button(words.here, "next", () => {
      here.disabled = true;
      ask();
    });
    showParts(pages, "busy", lineOf(words.busy), here);
  };
  const leaves = async () => {
    await store.close();
    document.body.replaceChildren(); // nothing of the session goes on here
    showNote(stageElements()[1], words.moved);
    if (document.fullscreenElement) await document.exitFullscreen().catch(() => undefined);
  };
  const hold = await holdLink(store.name, waits, leaves);
  if (!hold.waited || !jatos) return hold;
  jatos.showBeforeUnloadWarning?.(false);
  location.reload(); // JATOS tells a page what was kept only when it is loaded
  return new Promise(() => undefined);
}

/** Parameters of the participant's link. JATOS leads on to an address without them, and keeps them. */
function linkOf(jatos?: Jatos): URLSearchParams {
  const own = [...new URLSearchParams(location.search)];
  return new URLSearchParams([...Object.entries(jatos?.urlQueryParameters ?? {}), ...own]);
}

function messageOf(error: unknown): string {
  return error instanceof Error ? error.message : String(error);
}

/** The canvas over the whole viewport, and the pages over it. */
function stageElements(): [HTMLCanvasElement, HTMLElement] {
  const canvas = document.createElement("canvas");
  canvas.className = "metamerlab-stage";
  const pages = document.createElement("main");
  pages.className = "metamerlab-pages";
  document.body.append(canvas, pages);
  return [canvas, pages];
}

function languageOf(study: WebStudy, link: URLSearchParams): string {
  const wanted = [link.get("language"), ...navigator.languages];
  const known = Object.keys(study.pages);
  for (const one of wanted) {
    const found = known.find((name) => name === one) ?? known.find((name) => name === one?.split("-")[0]);
    if (found) return found;
  }
  return study.default_language;
}

/** A new participant: code and seed by chance, the slot from the link, the server or by chance. */
async function drawn(
  study: WebStudy,
  language: string,
  rate_hz: number,
  link: URLSearchParams,
  jatos: Jatos | undefined,
  told: Told,
): Promise<Begun> {
  const random = crypto.getRandomValues(new Uint32Array(5));
  const [a = 0, b = 0, c = 0, d = 0, e = 0] = random;
  const code = [c, d].map((part) => part.toString(36).padStart(7, "0")).join("");
  const seed = (a % 2 ** 21) * 2 ** 32 + b;
  const identifier = study.identifier === null ? null : link.get(study.identifier)?.slice(0, 200);
  const named = /^\d{1,9}$/.exec(link.get("slot") ?? "");
  const { places_key } = study.design;
  const of = { participant: `w${code}`, seed, places_key, language, rate_hz, identifier: identifier ?? null };
  if (named) return { ...of, slot: Number(named[0]), slot_from: "link" };
  if (jatos) return { ...of, slot: await nextSlot(jatos, told), slot_from: "batch" };
  return { ...of, slot: e % SLOTS, slot_from: "drawn" };
}

/** The next free slot of a batch: its session's data is changed only if nobody did in between. */
function nextSlot(jatos: Jatos, told: Told): Promise<number> {
  const path = "/metamerlab_slots";
  return insist(async () => {
    if (!jatos.batchSession.defined(path)) {
      await jatos.batchSession.add(path, 1);
      return 0;
    }
    const taken = Number(jatos.batchSession.get("metamerlab_slots"));
    await jatos.batchSession.test(path, taken);
    await jatos.batchSession.replace(path, taken + 1);
    return taken;
  }, told);
}

async function thank(
  study: WebStudy,
  language: string,
  words: Words,
  pages: HTMLElement,
  ending: Ending,
  store: CopyingStore,
  jatos: Jatos | undefined,
): Promise<void> {
  if (document.fullscreenElement) await document.exitFullscreen();
  const thanks = ending === "completed" ? study.pages[language]?.thanks : undefined;
  showNote(pages, thanks ?? (ending === "quit" ? words.left : words.over));
  const code: HTMLElement[] = [];
  if (ending === "completed" && study.completion_code !== null) {
    code.push(lineOf(filled(words.code, { code: study.completion_code })));
  }
  pages.append(...code);
  const quit = ending === "quit";
  const withdraws = withdrawal(words, store.store, () => {
    showNote(pages, words.withdrawn);
    pages.append(...code);
  });
  if (!jatos) {
    const lines = store.lines();
    pages.append(
      copyLink(quit ? words.saveEnds : words.save, study.study, lines, words, () => {
        store.local?.forget(lines);
        withdraws.remove(); // the file is the participant's own
      }),
    );
  }
  if (ending === "completed" && study.completion_url !== null) {
    const back = document.createElement("a");
    back.href = study.completion_url;
    back.textContent = words.go;
    pages.append(back);
  }
  const buttons = document.createElement("nav");
  buttons.append(withdraws);
  if (!jatos || quit) pages.append(buttons);
  else await insist(() => jatos.endStudy(ending === "completed"));
}
