/** The first page: what the study asks of a participant, and whose session it is that goes on. */
import type { WebStudy } from "../kernel/formats";
import type { CopyingStore, JatosStore, LocalStore } from "../store/stores";
import { button, lineOf, showNote, showParts } from "./note";
import type { Device } from "./device";
import { filled, type Words } from "./words";

/** Show the first page; true once a participant begins or goes on, false where nobody does. */
export async function firstPage(
  pages: HTMLElement,
  study: WebStudy,
  language: string,
  words: Words,
  device: Device,
  { store, local }: CopyingStore,
): Promise<boolean> {
  const goesOn = (await store.load()) !== null;
  const over = local?.used === true && !goesOn;
  const known = goesOn ? words.underWay : over ? words.used : null;
  const buttons = document.createElement("nav");
  const place = local ? words.storedHere : words.storedServer;
  showParts(
    pages,
    "gate",
    lineOf(study.title, "h1"),
    known === null ? facts(study, language, words, device, place) : lineOf(known),
    ...(over ? [] : device.told(language).before.map((text) => lineOf(text))),
    buttons,
  );
  const left = local?.left();
  if (left) {
    const forget = () => local?.forget(left);
    const link = copyLink(words.saveLeft, `${study.study}-earlier`, left, words, forget);
    pages.append(lineOf(words.othersLeft), link);
  }
  return new Promise((resolve, reject) => {
    const end = (note: string) => {
      showNote(pages, note);
      resolve(false);
    };
    const start = button(goesOn ? words.resume : words.start, "next", () => {
      resolve(true);
    });
    const other = button(words.someoneElse, "other", () => {
      other.disabled = true;
      const next = () => {
        if (local) location.reload(); // a lab's own screens begin anew, too
        else end(words.openAgain);
      };
      store.leave().then(next, reject);
    });
    const withdraw = withdrawal(words, store, () => {
      end(words.withdrawn);
    });
    buttons.append(...(over ? [other] : goesOn ? [start, other, withdraw] : [start]));
    start.focus({ preventScroll: true });
  });
}

/** A button by which a participant takes back all that was said; it asks once more. */
export function withdrawal(
  words: Words,
  store: LocalStore | JatosStore,
  done: () => void,
): HTMLButtonElement {
  let asked = false;
  const made = button(words.withdraw, "withdraw", () => {
    if (!asked) {
      asked = true;
      made.textContent = words.sure;
      return;
    }
    made.disabled = true;
    store.withdraw().then(done, (error: unknown) => {
      made.disabled = false;
      made.textContent = filled(words.broken, { why: String(error) });
    });
  });
  return made;
}

/** A link that saves lines as a file, and can be used again while the page is open.
 *
 * `forget`: what a browser does once the file is saved; null where it still needs the lines.
 */
export function copyLink(
  label: string,
  name: string,
  lines: string,
  words: Words,
  forget: (() => void) | null,
): HTMLAnchorElement {
  const link = document.createElement("a");
  link.href = URL.createObjectURL(new Blob([lines], { type: "text/plain" }));
  link.download = `${name}.txt`;
  link.textContent = label;
  const told = filled(words.saved, { file: link.download });
  const note = lineOf(forget ? `${told} ${words.forgotten}` : told);
  note.className = "saved";
  link.addEventListener("click", () => {
    forget?.();
    link.after(note);
  });
  return link;
}

/** The study's length, which keys are used, and what is stored. */
function facts(study: WebStudy, language: string, words: Words, device: Device, place: string): HTMLElement {
  const minutes = Math.max(1, Math.round(study.duration_s / 60));
  const names = study.pages[language]?.key_names ?? {};
  const scripts = study.rates[0]?.scripts[language] ?? [];
  const questions = scripts.flatMap(({ phases }) => phases.flatMap(({ question }) => question ?? []));
  const first = (keys: readonly string[]) => keys.slice(0, 1);
  const answers = new Set(questions.flatMap(({ keys }) => keys.flatMap(first)));
  const uses: [readonly string[], string][] = [
    [[...answers], words.keyAnswer],
    [first(study.continue_keys), words.keyNext],
    [first(study.pause_keys), words.keyPause],
    [first(study.quit_keys), words.keyQuit],
  ];
  if (questions.some(({ pointer }) => pointer)) uses.splice(1, 0, [[], words.click]);
  const told = device.told(language).keys?.map((text): [readonly string[], string] => [[], text]);
  const keys = (told ?? uses).map(([used, what]) => {
    const made = document.createElement("span");
    for (const key of used) made.append(lineOf(names[key] ?? key, "kbd"), " ");
    made.append(what);
    return made;
  });
  const { identifier } = study;
  const code = identifier === null ? [] : [filled(words.storedCode, { identifier })];
  const list = document.createElement("dl");
  list.dir = "auto";
  const rows: [string, (string | Node)[]][] = [
    [words.length, [filled(words.about, { minutes })]],
    [words.keys, keys],
    [words.stored, [[words.storedWhat, ...code, place].join(" ")]],
  ];
  for (const [name, told] of rows) {
    const description = document.createElement("dd");
    description.append(...told);
    list.append(lineOf(name, "dt"), description);
  }
  return list;
}
