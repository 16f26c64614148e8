/** Texts and buttons of the page. */

/** Show texts that wait for nothing. */
export function showNote(element: HTMLElement, ...texts: readonly string[]): void {
  element.replaceChildren(...texts.map((text) => lineOf(text)));
  element.hidden = false;
}

/** Show a page of such parts, which whoever drives it knows by its name. */
export function showParts(element: HTMLElement, name: string, ...parts: readonly Node[]): void {
  element.replaceChildren(...parts);
  element.dataset["page"] = name;
  element.hidden = false;
}

/** A line of text, in the direction of its script. */
export function lineOf(text: string, tag: "p" | "h1" | "kbd" | "dt" | "span" = "p"): HTMLElement {
  const line = document.createElement(tag);
  line.dir = "auto";
  line.textContent = text;
  return line;
}

/** A button of one of the kinds that the style sheet knows; `press` is what it does. */
export function button(text: string, kind: string, press: () => void): HTMLButtonElement {
  const made = document.createElement("button");
  made.type = "button";
  made.className = kind;
  made.textContent = text;
  made.addEventListener("click", press);
  return made;
}
