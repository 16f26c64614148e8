/** Names of keys, as protocols write them: those of `study_app/desktop/keys.py`. */
const NAMED: Readonly<Record<string, string>> = {
  ArrowLeft: "left",
  ArrowRight: "right",
  ArrowUp: "up",
  ArrowDown: "down",
  " ": "space",
  Enter: "enter",
  Escape: "escape",
  Tab: "tab",
  Backspace: "backspace",
};

/** A key's name in protocols; empty for keys that have none. */
export function keyName(event: { readonly key: string; readonly code: string }): string {
  const { key, code } = event;
  const pad = /^Numpad([0-9])$/.exec(code);
  if (pad) return `kp_${pad[1] ?? ""}`;
  const named = NAMED[key];
  if (named) return named;
  if (/^F([1-9]|1[0-2])$/.test(key)) return key.toLowerCase();
  const letter = key.toLowerCase();
  if (/^[a-z0-9]$/.test(letter)) return letter;
  // Another alphabet: the letter that the key has on a Latin keyboard.
  const printed = /^(?:Key|Digit)([A-Z0-9])$/.exec(code);
  return printed?.[1]?.toLowerCase() ?? "";
}
