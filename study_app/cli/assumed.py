"""Options of the form NAME=VALUE, and what a simulation takes for true."""

from __future__ import annotations

from collections.abc import Container, Iterable, Mapping, Sequence
from typing import TYPE_CHECKING

from protocols.errors import StudyError, did_you_mean

if TYPE_CHECKING:
    from analysis.power import Assumption


def pairs(option: str, entries: Iterable[str]) -> dict[str, str]:
    """Return entries of the form NAME=VALUE as a dictionary."""
    sides = {"--map": "OURS=THEIRS", "--answer": "THEIRS=OURS,..."}.get(option, "NAME=VALUE")
    found = {}
    for entry in entries:
        name, sign, value = (part.strip() for part in entry.partition("="))
        if not sign or not name or not value:
            raise StudyError(f"{option} must read {sides} (got {entry!r})")
        found[name] = value
    return found


def assumed_values(
    known: Sequence[Assumption], given: Mapping[str, str], own: Container[str] = ()
) -> dict[str, float]:
    """Return a value for every assumption: the one given, or its own.

    Those in `own` may have been given by an option of their name.
    """
    assumptions = {one.name: one for one in known}
    values = {one.name: one.value for one in known}
    for name, text in given.items():
        if name not in assumptions:
            listed = "; ".join(f"{one.name}: {one.meaning}" for one in known)
            raise StudyError(
                f"--set: must name what this task's simulation takes for true ({listed})"
                f" (got {name!r}){did_you_mean(name, list(assumptions))}"
            )
        one = assumptions[name]
        try:
            value = float(text)
        except ValueError:
            value = float("nan")
        if not one.lowest <= value <= one.highest:
            option = f"--{name.replace('_', '-')}" if name in own else f"--set {name}"
            percent = one.highest <= 1 < value <= 100
            cure = f"; {value:g} % is {value / 100:g}" if percent else ""
            raise StudyError(
                f"{option}: must be a number from {one.lowest:g} to {one.highest:g}"
                f" (got {text!r}){cure}"
            )
        values[name] = value
    return values
