"""Cures for misspelt keys of a keyboard and of a file, for error messages."""

from __future__ import annotations

import re
from collections.abc import Iterable

from protocols.errors import did_you_mean
from protocols.study_file.session_schema import KEY_PATTERN
from protocols.units import CONVERSIONS, UNIT_OF_SUFFIX

_KEYS = ("left", "right", "up", "down", "space", "enter", "escape", "tab", "backspace")
_ALSO_CALLED = {
    "": "space",
    "blank": "space",
    "return": "enter",
    "esc": "escape",
    "back": "backspace",
    "bksp": "backspace",
}
_NUMBER_BLOCK = re.compile(r"(?:num|numpad|numlock|kp|keypad|numerickeypad|np|pad)([0-9]|enter)")
_MODIFIERS = re.compile(r"[lr]?(left|right)?(shift|ctrl|control|alt|option|cmd|command|meta)[lr]?")


def cure_for_key_name(name: str) -> str:
    """Return the cure for a key that other programs call `name`: ``num_4`` is our ``kp_4``."""
    low = name.strip().lower()
    plain = re.sub(r"[^a-z0-9]", "", low) if len(low) > 1 else low
    if _MODIFIERS.fullmatch(plain.removesuffix("key")):
        return "; shift, control and alt give no answer: take letters, such as 'z' and 'm'"
    if re.search("pointer|mouse|click|touch|tap$|^lmb|^rmb", plain):
        return "; a click or a touch is no key: pointer = true in [response] takes them"
    block = _NUMBER_BLOCK.fullmatch(plain) or re.fullmatch(r"\[([0-9])\]", low)
    if block:
        return f"; did you mean {'enter' if block[1] == 'enter' else f'kp_{block[1]}'!r}?"
    for meant in (low, plain, re.sub("arrow|key|bar|digit", "", plain)):
        meant = _ALSO_CALLED.get(meant, meant)
        if re.match(KEY_PATTERN, meant):
            return f"; did you mean {meant!r}?"
    return did_you_mean(plain, _KEYS)


def split_unit(name: str) -> tuple[str, str]:
    """Split ``gap_s`` into ``gap`` and ``s``; the unit is empty where there is none."""
    stem, _, last = name.rpartition("_")
    return (stem, last) if stem and last in UNIT_OF_SUFFIX else (name, "")


def cure_for_key(key: str, value: object, known: Iterable[str]) -> str:
    """Return the cure for an unknown key: another unit, a missing unit, or a near name."""
    stem, unit = split_unit(key)
    names = list(known)
    for name in names:
        right_stem, right_unit = split_unit(name)
        if right_unit and right_unit != unit and right_stem in {stem, key}:
            factor = CONVERSIONS.get((unit, right_unit))
            example = ""
            if factor and isinstance(value, (int, float)) and not isinstance(value, bool):
                example = f": {name} = {value * factor:.6g}"
            return f"; did you mean {name!r} ({UNIT_OF_SUFFIX[right_unit]}){example}?"
    return did_you_mean(key, names)
