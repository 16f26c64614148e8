/** Pages of text with buttons, in the browser's window. */
import type { Page, PageResult } from "../kernel/conduct";
import type { WebStudy } from "../kernel/formats";
import { keyName } from "./keys";
import { button, lineOf, showParts } from "./note";
import type { Words } from "./words";

/** Show a page until the participant goes on, or leaves. */
export function showPage(
  element: HTMLElement,
  page: Page,
  study: WebStudy,
  words: Words,
): Promise<PageResult> {
  const began_ms = performance.now();
  const texts = page.text.split("\n").map((line) => lineOf(line));
  const field = page.question ? answerField(page.question.choices, page.draft) : null;
  const labels: Partial<Record<string, string>> = { consent: words.agree, quit: words.stay };
  return new Promise((resolve) => {
    const next = button(labels[page.name] ?? words.next, "next", () => {
      end(false);
    });
    const leave = button(words.leave, "leave", () => {
      end(true);
    });
    const buttons = document.createElement("nav");
    buttons.append(next, leave);
    const bar = page.done_share > 0 ? [doneBar(page.done_share)] : [];
    const fields = field ? [field.element] : [];
    showParts(element, page.name, ...bar, ...texts, ...fields, buttons);
    (field?.first ?? next).focus();
    const waits_ms = page.least_s * 1000;
    next.disabled = waits_ms > 0;
    const timer = setTimeout(() => {
      next.disabled = false;
      if (!field) next.focus();
    }, waits_ms);
    const end = (leaves: boolean) => {
      if (!leaves && (next.disabled || (field && !field.value()))) return;
      clearTimeout(timer);
      removeEventListener("keydown", down);
      element.hidden = true;
      element.replaceChildren();
      const duration_s = Math.round((performance.now() - began_ms) * 1e3) / 1e6;
      resolve({ leaves, answer: field?.value() ?? "", duration_s });
    };
    const down = (event: KeyboardEvent) => {
      const typing = event.target instanceof HTMLTextAreaElement;
      const key = keyName(event);
      if (event.repeat || typing) return;
      if (study.quit_keys.includes(key)) end(true);
      else if (study.continue_keys.includes(key)) end(false);
      else return;
      event.preventDefault();
    };
    addEventListener("keydown", down);
  });
}

function doneBar(share: number): HTMLProgressElement {
  const made = document.createElement("progress");
  made.value = share;
  return made;
}

interface Field {
  readonly element: HTMLElement;
  readonly first: HTMLElement;
  value(): string;
}

/** Field in which an answer is typed, or one of several is chosen. */
function answerField(choices: readonly string[], draft: string): Field {
  if (!choices.length) {
    const text = document.createElement("textarea");
    text.dir = "auto";
    text.maxLength = 20_000;
    text.value = draft;
    return { element: text, first: text, value: () => text.value.trim() };
  }
  const list = document.createElement("fieldset");
  const options = choices.map((choice) => {
    const label = document.createElement("label");
    const option = document.createElement("input");
    Object.assign(option, { type: "radio", name: "choice", checked: choice === draft });
    label.append(option, lineOf(choice, "span"));
    list.append(label);
    return option;
  });
  const value = () => choices[options.findIndex((option) => option.checked)] ?? "";
  return { element: list, first: options[0] ?? list, value };
}
