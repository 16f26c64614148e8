"""Places: which sessions ran in participants' own browsers, and what differs from the lab."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from math import hypot
from operator import attrgetter
from typing import ClassVar

import pandas as pd
from numpy.random import Generator

from analysis.parts import (
    AnalysisPlan,
    AnyPart,
    Estimate,
    Part,
    PartNumbers,
    Presentation,
    estimates_of,
    tried,
)
from analysis.report.result_table import (
    ResultColumn,
    ResultTable,
    attribute,
    estimated,
    limits,
    within,
)
from analysis.report.wording import level_text, number_range, placed
from protocols.blocks import Block, Paragraph
from protocols.errors import count_of

LAB, BROWSER = "lab", "browser"
_TABLE_ONLY = "the table does not say"


@dataclass(frozen=True)
class Place:
    """Sessions of one place whose decisions were analysed.

    `refresh_hz`, `timing_evidence`, `gaze_mode` and `headset` count sessions by what they were
    recorded with; empty for a table, which does not say. `time_off_s` is how far a time was from
    the study's at most, where refreshes asked for it. `rate_changes` names sessions that went on at
    another rate. `head_turn_deg` is how far a head turned at most while stimuli were watched.
    """

    name: str
    sessions: int
    participants: int
    decisions: int
    refresh_hz: Mapping[str, int]
    timing_evidence: Mapping[str, int]
    gaze_mode: Mapping[str, int]
    time_off_s: float | None
    rate_changes: tuple[str, ...] = ()
    headset: Mapping[str, int] = field(default_factory=dict)
    head_turn_deg: float | None = None


@dataclass(frozen=True)
class PlaceDifference:
    """One primary result by place, and by how much the browsers' is higher, with limits."""

    what: str
    lab: Estimate
    browser: Estimate
    difference: float
    lower: float
    upper: float


@dataclass(frozen=True)
class Places:
    """Every number; `differences` only where both places have decisions."""

    places: tuple[Place, ...]
    differences: tuple[PlaceDifference, ...]
    notes: tuple[str, ...] = ()


def difference(lab: Estimate, browser: Estimate) -> PlaceDifference:
    """Return the difference of independent estimates, its limits recovered from theirs.

    This is MOVER (Zou and Donner 2008): each estimate's distance to its own limit stands for its
    error at that limit, so that limits need not be symmetric.
    """
    found = browser.value - lab.value
    below = hypot(browser.value - browser.lower, lab.upper - lab.value)
    above = hypot(browser.upper - browser.value, lab.value - lab.lower)
    return PlaceDifference(lab.what, lab, browser, found, found - below, found + above)


class PlacesPart(Part[AnalysisPlan, Places]):
    """Places where sessions ran, and the primary result of other parts by place.

    Parameters
    ----------
    parts : sequence of Part
        Those of the report.
    sessions : DataFrame, optional
        A row per session, as `analysis.tidy` makes it; a table has none.
    """

    name: ClassVar[str] = "places"
    section: ClassVar[tuple[str, str]] = ("places", "Lab and browser")

    def __init__(self, parts: Sequence[AnyPart], sessions: pd.DataFrame | None) -> None:
        self._parts, self._sessions = parts, sessions

    def wanted(self, table: pd.DataFrame, _plan: AnalysisPlan) -> bool:
        """Return True if a session ran in a browser."""
        return "remote" in table and bool((table["remote"] == 1).any())

    def compute(
        self, table: pd.DataFrame, plan: AnalysisPlan, _found: PartNumbers, _chance: Generator
    ) -> Places:
        """Count sessions by place; estimate the primary result at each."""
        by_place = {
            name: table[(table["remote"] == 1) == (name == BROWSER)].reset_index(drop=True)
            for name in (LAB, BROWSER)
        }
        places = tuple(self._place(name, rows) for name, rows in by_place.items() if len(rows))
        if len(places) < 2:
            return Places(places, ())
        notes: list[str] = []
        people = [set(rows["participant"].astype(str)) for rows in by_place.values()]
        if both := sorted(set.intersection(*people)):
            return Places(places, (), (f"no comparison of places: {both[0]} took part at both",))
        lab, browser = (
            tried(
                partial(self._primary, rows, plan),
                f"primary result of the {name}'s sessions alone",
                notes,
            )
            for name, rows in by_place.items()
        )
        if not notes and not (lab and browser):
            notes.append("no comparison of places: the report has no primary number with limits")
        at_home = {one.what: one for one in browser or ()}
        return Places(
            places,
            tuple(difference(one, at_home[one.what]) for one in lab or () if one.what in at_home),
            tuple(notes),
        )

    def show(self, found: Places, plan: AnalysisPlan) -> Presentation:
        """Return the evidence for each place's sessions, and the primary result by place."""
        tables = {"places.csv": _places(found).frame()}
        if found.differences:
            tables["place_differences.csv"] = _differences(found, plan).frame()
        return Presentation(
            blocks=tuple(_blocks(found, plan)),
            sentences=(_counted(found), *(_sentence(one, plan) for one in found.differences)),
            methods=_methods(found),
            tables=tables,
        )

    def _primary(self, rows: pd.DataFrame, plan: AnalysisPlan) -> Sequence[Estimate]:
        """Return the planned result; all main numbers where none is planned, as of a table."""
        planned = estimates_of(self._parts, rows, plan, planned=True)
        return planned or estimates_of(self._parts, rows, plan)

    def _place(self, name: str, rows: pd.DataFrame) -> Place:
        who = "session" if "session" in rows else "participant"
        names = set(rows[who].astype(str))
        every = self._sessions
        own = None if every is None else every[every["session"].isin(names)]

        def counted(column: str) -> Mapping[str, int]:
            if own is None:
                return {}
            texts = own[column].map(lambda it: f"{it:g}" if column == "refresh_hz" else str(it))
            return {str(value): int(count) for value, count in texts.value_counts().items()}

        return Place(
            name,
            len(names),
            int(rows["participant"].nunique()),
            len(rows),
            counted("refresh_hz"),
            counted("timing_evidence"),
            counted("gaze_mode"),
            None if own is None or name == LAB else float(own["time_off_s"].max()),
            () if own is None else _changed(own),
            {kind: count for kind, count in counted("headset").items() if kind},
            None if own is None else _largest(own["head_turn_deg"]),
        )


def _changed(sessions: pd.DataFrame) -> tuple[str, ...]:
    """Return the sessions that went on at another refresh rate, and when."""
    texts = sessions["refresh_changes"].fillna("")
    pairs = zip(sessions["session"], texts, strict=True)
    return tuple(f"{session} ({text})" for session, text in pairs if text)


def _largest(values: pd.Series) -> float | None:
    """Return the largest of values; None where there are none."""
    known = values.dropna()
    return float(known.max()) if len(known) else None


def _places(found: Places) -> ResultTable[Place]:
    def listed(title: str, name: str, unit: str = "") -> ResultColumn[Place]:
        return ResultColumn(
            title, "l", lambda one: _listed(getattr(one, name), one.sessions, unit), name
        )

    return ResultTable.of(
        "Places of sessions",
        found.places,
        attribute("Place", "name", str, "l c"),
        attribute("Sessions", "sessions", str),
        attribute("Participants", "participants", str),
        attribute("Decisions", "decisions", str),
        listed("Refresh rates", "refresh_hz", " Hz"),
        listed("Time stamps by", "timing_evidence"),
        listed("Gaze", "gaze_mode"),
        ResultColumn("", "", None, "time_off_s"),
        ResultColumn("", "", None, "head_turn_deg"),
    )


def _differences(found: Places, plan: AnalysisPlan) -> ResultTable[PlaceDifference]:
    def at(title: str, place: str) -> ResultColumn[PlaceDifference]:
        ends = ("value", "lower", "upper")
        return ResultColumn(
            title,
            "",
            lambda one: placed(getattr(one, place), getattr(one, place).value),
            lambda one: {f"{place}_{end}": getattr(getattr(one, place), end) for end in ends},
        )

    def ends(place: str) -> ResultColumn[PlaceDifference]:
        (column,) = within(attrgetter(place), (limits(plan.limits),))
        return replace(column, csv="")

    return ResultTable.of(
        "Exploratory: the primary result by place",
        found.differences,
        ResultColumn("Result", "l c", lambda one: one.what, lambda one: {"of": one.what}),
        at("Lab", LAB),
        ends(LAB),
        at("Browser", BROWSER),
        ends(BROWSER),
        estimated("Browser - lab", "difference"),
        limits(plan.limits),
    )


def _blocks(found: Places, plan: AnalysisPlan) -> Iterator[Block]:
    yield _places(found).block()
    off_s = found.places[-1].time_off_s or 0.0
    off = f" Times were at most {1000 * off_s:.3g} ms from those stated." if off_s else ""
    yield Paragraph(
        "In a browser every file was hashed before it was decoded, and each refresh was stamped by"
        " the browser's animation frame. No photodiode saw the screen; nothing watched gaze or"
        f" distance.{off}"
    )
    if found.places[-1].headset:
        yield Paragraph(_in_headsets(found.places[-1]))
    if changed := found.places[-1].rate_changes:
        yield Paragraph(f"Gone on at another refresh rate: {', '.join(changed)}.")
    if found.differences:
        yield _differences(found, plan).block()
        yield Paragraph(
            "Nobody was assigned to a place by chance: people, screens and rooms differ with it."
            " Limits that hold 0 do not show that places agree."
        )


def _listed(counts: Mapping[str, int], sessions: int, unit: str = "") -> str:
    """Return the values that sessions were recorded with: ``60 Hz (3), 75 Hz (1)``."""
    if not counts:
        return _TABLE_ONLY
    several = len(counts) > 1 or sum(counts.values()) < sessions
    return ", ".join(
        f"{value or 'not noted'}{unit}" + f" ({count})" * several for value, count in counts.items()
    )


def _counted(found: Places) -> str:
    remote = found.places[-1]
    every = sum(one.sessions for one in found.places)
    rates = _listed(remote.refresh_hz, remote.sessions, " Hz")
    at = f", at {rates}" if remote.refresh_hz else ""
    said = f"{remote.sessions} of {count_of(every, 'session')} ran in participants' browsers{at}."
    return f"{said} {_in_headsets(remote)}" if remote.headset else said


def _in_headsets(remote: Place) -> str:
    count = sum(remote.headset.values())
    most = remote.head_turn_deg
    turned = (
        ""
        if most is None
        else f" The head turned by at most {most:.1f} degrees from straight ahead."
    )
    return (
        f"{count_of(count, 'session')} in headsets ({_listed(remote.headset, count)})."
        f"{turned} The head's pose is not fixation: eyes move in a head that is still."
    )


def _sentence(one: PlaceDifference, plan: AnalysisPlan) -> str:
    return (
        f"Exploratory, {one.what}: browser minus lab {placed(one, one.difference)},"
        f" {level_text(plan.confidence)} {number_range(one.lower, one.upper)}."
    )


def _methods(found: Places) -> str:
    said = (
        "Sessions in browsers showed files that were hashed before they were decoded; their"
        " refreshes were stamped by animation frames, and gaze was not watched."
    )
    if found.differences:
        said += (
            " The primary result was estimated at each place alone. Limits of the difference"
            " follow from those of both (MOVER, Zou and Donner 2008). This comparison is"
            " exploratory."
        )
    return said
