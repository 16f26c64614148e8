/** Texts and buttons of the page. */

/** Show texts that wait for nothing. */
export function showNote(element: HTMLElement, ...texts: readonly string[]): void {
  element.replaceChildren(...texts.map(paragraph));
  element.hidden = false;
}

export function paragraph(text: string): HTMLParagraphElement {
  const made = document.createElement("p");
  made.dir = "auto";
  made.textContent = text;
  return made;
}

export function button(text: string, kind = "next"): HTMLButtonElement {
  const made = document.createElement("button");
  made.type = "button";
  made.className = kind;
  made.textContent = text;
  return made;
}
