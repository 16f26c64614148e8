"""Cures for misspelt names and wrong units, for error messages."""

from __future__ import annotations

from collections.abc import Iterable
from difflib import get_close_matches

from protocols.units import CONVERSIONS, UNIT_OF_SUFFIX


def did_you_mean(name: str, known: Iterable[str]) -> str:
    """Return ``; did you mean 'x'?`` for the nearest known name, or nothing."""
    close = get_close_matches(name, list(known), n=1, cutoff=0.6)
    return f"; did you mean {close[0]!r}?" if close else ""


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
