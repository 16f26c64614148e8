"""Texts that participants read: placeholders filled, keys named."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping

from protocols.errors import did_you_mean
from protocols.study_file.session_schema import PLACEHOLDERS, Response, Texts

_DEVICES = {"kp": "num", "pad": "pad"}
_SHOWN = {"left": "←", "right": "→", "up": "↑", "down": "↓"}


def fill(text: str, response: Response, *, done: int = 0, total: int = 0) -> str:
    """Return `text` with `{left}`, `{done}` and so on replaced; other braces stay as they are.

    Parameters
    ----------
    text : str
        As the protocol has it.
    response : Response
        Its first key of each action is named.
    done, total : int
        Blocks done, and in all.
    """
    values = {
        "left": response.keys[0][0],
        "right": response.keys[-1][0],
        "continue": response.continue_keys[0],
        "quit": response.quit_keys[0],
        "done": str(done),
        "total": str(total),
    }
    for name in PLACEHOLDERS:
        text = text.replace("{" + name + "}", values[name])
    return text


def unknown_placeholders(text: str) -> Iterator[str]:
    """Yield the fault of each `{...}` of a text that stands for nothing."""
    for word in re.findall(r"\{(\w*)\}", text):
        if word not in PLACEHOLDERS:
            yield (
                f"{{...}} must be one of {', '.join(PLACEHOLDERS)} (got {{{word}}})"
                f"{did_you_mean(word, PLACEHOLDERS)}"
            )


def consent_text(texts: Texts, contact: str) -> str:
    """Return the text of the consent page, placeholders included: the text, and whom to ask."""
    return texts.consent + (f"\n\n{contact}" if contact else "")


def key_label(name: str, names: Mapping[str, str] | None = None) -> str:
    """Return the participant's name of a key: ``←``, ``F``, ``space``, ``num 4``.

    `names` has the words of the participant's language.
    """
    if names and name in names:
        return names[name]
    kind, joined, rest = name.partition("_")
    if joined and kind in _DEVICES:
        return f"{_DEVICES[kind]} {key_label(rest)}"
    return _SHOWN.get(name, name.upper() if len(name) == 1 else name)
