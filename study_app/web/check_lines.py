"""Lines are held against what a page of this export can send: machine, texts and clocks.

What follows from the plan is checked where a session is made again. A participant's clock may be
set, a laptop may sleep, and a page may be opened again and again: all this is accepted.
"""

from __future__ import annotations

import math
from datetime import UTC, datetime, timedelta
from itertools import accumulate

from protocols.browser.web_lines import (
    AnyLine,
    AttemptLine,
    BreakLine,
    ConsentLine,
    EndLine,
    PauseLine,
    ResumeLine,
    StartLine,
)
from protocols.disk.hashing import sha256_bytes
from protocols.errors import must_be_one_of
from protocols.journal import Machine, SlotFrom
from protocols.outside import shown
from protocols.study_file.session_schema import POINTER
from study_app.web.export import WebBuild
from study_app.web.read_results import ContradictionError

NEAR_SHARE = 0.005
"""Largest distance of a measured refresh rate from one of the study's, as in the page's gate."""
SLOTS: dict[SlotFrom, int] = {"drawn": 2**20, "batch": 10**9, "link": 10**9}
"""Slots below this are given, by where they come from."""
PAGE_MOST_S = 1e7
"""Longest time for which a page is open: a season."""
SET_MOST = timedelta(days=1)
"""Most by which a participant's clock is set back."""
SLACK_S = 2.0
"""Most by which stamps of refreshes, of keys and of lines may differ on one page."""
EARLY_S = 0.1
"""Most by which a browser ends a wait too early."""
_WORDS_MOST = 200


class LineCheck:
    """Checks the lines of one participant, one after the other."""

    def __init__(self, build: WebBuild, begun: StartLine) -> None:
        self._build, self._begun = build, begun
        self._before: AnyLine | None = None
        self._at = datetime.min.replace(tzinfo=UTC)

    def check(self, line: AnyLine) -> None:
        """Refuse a line that no page of the export sends at this place.

        Raises
        ------
        ContradictionError
            Naming the line, what must hold, and what was found.
        """
        self._order(line)
        before_s = self._clock(line)
        if isinstance(line, StartLine):
            self._start(line)
        if isinstance(line, StartLine | ResumeLine):
            self._machine(line, line.machine)
        elif isinstance(line, ConsentLine):
            text = self._build.page(self._begun.language).consent
            must = sha256_bytes(text.encode("utf-8"))
            if line.text_sha256 != must:
                raise wrong(line, f"text_sha256 must be {must[:12]}..., of the consent page",
                    line.text_sha256)  # fmt: skip
        elif isinstance(line, BreakLine | PauseLine):
            least_s = self._build.study.design.break_s if isinstance(line, BreakLine) else 0.0
            if line.duration_s < least_s - EARLY_S:
                raise wrong(line, f"duration_s must be at least {least_s:g}", line.duration_s)
            if line.duration_s > line.t_s - before_s + SLACK_S:
                most = f"{line.t_s - before_s:g}, the time since the line before"
                raise wrong(line, f"duration_s must be at most {most}", line.duration_s)
        elif isinstance(line, AttemptLine):
            self._stamps(line, before_s)
        self._before = line

    def _order(self, line: AnyLine) -> None:
        """Runs never fall; a run ends with its end."""
        before, resumes = self._before, isinstance(line, ResumeLine)
        if before is None:
            if line.run != 0:
                raise wrong(line, "run must be 0 at the start", line.run)
        elif isinstance(line, StartLine):
            raise wrong(line, "kind must be another, the start is the first line", line.kind)
        elif isinstance(before, EndLine) and not resumes:
            raise wrong(line, "after the end must come a resume", line.kind)
        elif (line.run <= before.run) if resumes else (line.run != before.run):
            what = f"more than {before.run}" if resumes else f"{before.run}, as in the line before"
            raise wrong(line, f"run must be {what}", line.run)

    def _clock(self, line: AnyLine) -> float:
        """Check both clocks; return the time of the line before on the page's, s."""
        before = self._before
        same_run = before is not None and before.run == line.run
        before_s = before.t_s if before and same_run else 0.0
        if not before_s <= line.t_s <= PAGE_MOST_S:
            raise wrong(line, f"t_s must lie between {before_s:g} and {PAGE_MOST_S:g}", line.t_s)
        try:
            at = datetime.fromisoformat(line.at)
        except ValueError:
            raise wrong(line, "at must be a date and a time", line.at) from None
        since = timedelta(seconds=line.t_s - before_s if same_run else 0.0)
        if before and at - self._at < since - SET_MOST:
            must = f"at must not fall by more than {SET_MOST.days} day: {before.at} was before,"
            raise wrong(line, f"{must} {since.total_seconds():g} s ago", line.at)
        self._at = at
        return before_s

    def _start(self, line: StartLine) -> None:
        languages, most = self._build.study.text.languages, SLOTS[line.slot_from]
        identifier = self._build.study.web.identifier if self._build.study.web else None
        if line.language not in languages:
            raise wrong(line, must_be_one_of("language", line.language, languages))
        if line.slot >= most:
            raise wrong(line, f"slot must be below {most:,} ({line.slot_from})", line.slot)
        if line.identifier is not None and identifier is None:
            must = "identifier must be left out: the study keeps no parameter of the link"
            raise wrong(line, must, line.identifier)
        if len(line.revision) > _WORDS_MOST:
            raise wrong(line, f"revision must have at most {_WORDS_MOST} characters", line.revision)

    def _machine(self, line: StartLine | ResumeLine, machine: Machine) -> None:
        rates = [f"{rate:g}" for rate in self._build.rates_hz]
        if f"{line.rate_hz:g}" not in rates:
            raise wrong(line, must_be_one_of("rate_hz", f"{line.rate_hz:g}", rates))
        if abs(machine.refresh_hz / line.rate_hz - 1) > NEAR_SHARE:
            must = f"machine.refresh_hz must be near rate_hz, {line.rate_hz:g}"
            raise wrong(line, must, machine.refresh_hz)
        if machine.scale > max(1, math.floor(machine.device_pixel_ratio + 0.5)):
            must = f"machine.scale must be that of a ratio of {machine.device_pixel_ratio:g}"
            raise wrong(line, must, machine.scale)
        if (machine.headset is None) != (self._build.study.headset is None):
            must = "machine.headset must be given of a headset, and only of one"
            raise wrong(line, must, "none" if machine.headset is None else "one")
        if len(machine.browser) > _WORDS_MOST:
            must = f"machine.browser must have at most {_WORDS_MOST} characters"
            raise wrong(line, must, machine.browser)

    def _stamps(self, line: AttemptLine, before_s: float) -> None:
        """Flips lie between this line and the one before, and each key beside its flip."""
        stamps_s = [us / 1e6 for us in accumulate(line.flips_us)]
        if not stamps_s:
            raise wrong(line, "flips_us must have entries", "none")
        if not before_s - SLACK_S <= stamps_s[0]:
            raise wrong(line, f"flips must come after the line before, {before_s:g} s", stamps_s[0])
        if not stamps_s[-1] <= line.t_s + SLACK_S:
            raise wrong(line, f"flips must come before t_s, {line.t_s:g} s", stamps_s[-1])
        flips = [press.flip for press in line.presses]
        if flips != sorted(flips) or (flips and flips[-1] >= len(stamps_s)):
            must = f"presses must come in order, after one of {len(stamps_s)} flips"
            raise wrong(line, must, ", ".join(map(str, flips)))
        for press in line.presses:
            least_s, most_s = stamps_s[max(press.flip - 1, 0)], stamps_s[press.flip]
            if not least_s - SLACK_S <= press.at_us / 1e6 <= most_s + SLACK_S:
                must = f"a press before flip {press.flip} must lie about {most_s:g} s"
                raise wrong(line, must, f"{press.at_us / 1e6:g}")
            if (press.x is None) == (press.key == POINTER):
                raise wrong(line, "x must be given for the pointer, and only for it", press.x)


def wrong(line: AnyLine, what: str, found: object = None) -> ContradictionError:
    """Return the refusal of a line: what must hold, and what was found."""
    got = "" if found is None else f" (got {shown(found)})"
    return ContradictionError(f"line number {line.n}: {what}{got}")
