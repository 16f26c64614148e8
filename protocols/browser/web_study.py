"""A study as a browser runs it: all of it in one file, beside pictures and packs of frames.

`study_app.web.export` fills a folder with it. The page reads this file first, checks every other
file against the hash that stands here, and needs nothing else. No secret of the study is in it.
"""

from __future__ import annotations

import math
from typing import Annotated, Literal, TypeAlias

from pydantic import Field

from protocols.browser.web_design import WebDesign
from protocols.display import Display
from protocols.feasibility import stated_times_s, timing_problems
from protocols.make_script import Scripts
from protocols.script import Fill, Frames, Grey, Place, ScriptQuestion, Size, TrialScript
from protocols.study_file.schema import StudyProtocol
from protocols.study_file.session_schema import ClosingQuestion, Keys
from protocols.units import (
    Count,
    Hertz,
    LanguageCode,
    Model,
    Name,
    Number,
    Sha256,
    Text,
)

MB = 1_000_000
BUDGET_MB = 300.0
"""Largest size of what one participant has to fetch, in MB, unless an option says more."""
DECODED_MB = 500.0
"""Largest size of the decoded stimuli of two trials, in MB, unless an option says more."""
RATES_HZ = (50.0, 60.0, 72.0, 75.0, 90.0, 100.0, 120.0, 144.0, 165.0, 240.0)
"""Refresh rates of participants' displays that a study is made ready for, where it can be."""


class PictureFile(Model):
    """A picture that Python made: a PNG file."""

    file: Text
    """Name in the folder `pictures`."""
    sha256: Sha256
    size_px: Size


class ShownPicture(Model):
    """A picture at its place."""

    kind: Literal["picture"] = "picture"
    of: Sha256
    """Its name among the study's pictures."""
    at: Place


WebEntry: TypeAlias = Annotated[Frames | ShownPicture | Fill, Field(discriminator="kind")]


class WebPhase(Model):
    """A phase of a trial, as `ScriptPhase` has it, with pictures by name."""

    name: Name
    frames: Count | None
    show: tuple[WebEntry, ...]
    gate_frames: Count | None
    watched: bool
    question: ScriptQuestion | None
    timeout_frames: Count | None
    follows: dict[str, ShownPicture]


class WebScript(Model):
    """The script of all trials that have these answers in this order."""

    answers: tuple[Name, ...]
    practice: bool
    phases: tuple[WebPhase, ...]


class RefreshRate(Model):
    """A refresh rate at which the study runs."""

    refresh_hz: Hertz
    deviations_s: dict[str, Number]
    """Excess of each time over the study's, by its place in the study file. Times that are kept are
    left out."""
    scripts: dict[LanguageCode, tuple[WebScript, ...]]


class Pack(Model):
    """The frames of a stimulus: PNG files one after the other in one file."""

    file: Text
    """Name in the folder `packs`."""
    bytes: Count
    sha256: tuple[Sha256, ...]
    """Hash of each frame, as the manifest has it."""
    ends: tuple[Count, ...]
    """End of each frame in the file, in bytes from its beginning."""


class WebPages(Model):
    """Texts that a participant reads beside trials, placeholders of keys filled."""

    consent: Text
    instructions: tuple[Text, ...]
    practice: Text
    start: Text
    break_page: Text
    """`{done}` and `{total}` stand for numbers of blocks."""
    paused: Text
    preparing: Text
    quit_question: Text
    thanks: Text
    questions: tuple[ClosingQuestion, ...]


class WebStudy(Model):
    """The file `study.json` of an exported folder."""

    format: Literal[1]
    """Version of the file format."""
    study: Name
    title: Text
    protocol_sha256: Sha256
    manifest_sha256: Sha256
    revision: Text
    """Version and git revision of metamerlab."""
    default_language: LanguageCode
    pages: dict[LanguageCode, WebPages]
    background: Grey
    window_px: Size
    """Smallest part of the screen, about its middle, that shows all of a trial."""
    screen_px: Size
    """Size of the screen that the study was made for: a click answers by its share of the width."""
    design: WebDesign
    break_s: Annotated[float, Field(ge=0)]
    """Shortest break between two blocks."""
    rates: Annotated[tuple[RefreshRate, ...], Field(min_length=1)]
    dropped_max: Count
    """More missed refreshes than this make an attempt void."""
    continue_keys: Keys
    pause_keys: Keys
    quit_keys: Keys
    stimulus_px: Size
    stimuli: dict[str, Pack]
    """Stimuli by their names in the manifest."""
    pictures: dict[Sha256, PictureFile]
    """Pictures by the hash of what they show."""
    decoded_bytes: Count
    """Largest memory that a trial's stimuli and the next one's take."""
    identifier: str | None
    """Parameter of the link whose value is kept."""
    completion_url: str | None
    completion_code: str | None


def rates_of(study: StudyProtocol, display: Display) -> dict[float, list[str]]:
    """Return for each refresh rate why the study does not run at it; an empty list where it does.

    Parameters
    ----------
    study : StudyProtocol
        With a section `[web]`, whose tolerance counts.
    display : Display
        For which stimuli are built.

    Raises
    ------
    StudyError
        If the study is not meant for browsers.
    """
    study = study.in_a_browser()
    tolerance_s = study.web.tolerance_s if study.web else 0.0

    def problems(rate: float) -> list[str]:
        found = [str(p) for p in timing_problems(study, display.at_rate(rate, tolerance_s))]
        times = stated_times_s(study).values()
        wanted_s = max(abs(round(stated_s * rate) / rate - stated_s) for stated_s in times)
        wanted_s = math.ceil(1e4 * wanted_s) / 1e4
        if found and not timing_problems(study, display.at_rate(rate, wanted_s)):
            found[0] += f"; or declare web.tolerance_s = {wanted_s:g}"
        return found

    return {rate: problems(rate) for rate in sorted({*RATES_HZ, display.refresh_hz})}


def deviations_s(study: StudyProtocol, display: Display) -> dict[str, float]:
    """Return the surplus of each time on a display over the study's, where there is one."""
    found = {
        place: (display.frames(stated_s) or 0) / display.refresh_hz - stated_s
        for place, stated_s in stated_times_s(study).items()
    }
    return {place: round(off_s, 9) for place, off_s in found.items() if abs(off_s) > 1e-9}


def scripts_at(study: StudyProtocol, display: Display, language: str) -> dict[WebKind, TrialScript]:
    """Return the scripts of all kinds of trials: by the order of their answers, and practice."""
    made = Scripts(study.in_a_browser(), display, language)
    answers = study.task.answers()
    return {
        (order, practice): made.script(order, practice)
        for order in dict.fromkeys((answers, answers[::-1]))
        for practice in (False, True)
        if not practice or study.design.practice is not None
    }


WebKind: TypeAlias = tuple[tuple[str, ...], bool]
"""The order of the answers, and whether it is practice."""
