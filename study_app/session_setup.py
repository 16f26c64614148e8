"""The two bags of a session: what it is (`SessionSetup`), and who is told (`SessionListener`)."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

from protocols.display import Display
from protocols.errors import StudyError, must_be_one_of
from protocols.journal import AnyEvent, Attempt, DisplayReport
from protocols.manifest import Manifest
from protocols.study_file.schema import StudyProtocol
from protocols.study_file.session_schema import Texts
from study_app.desktop.strip import FlipMarks
from study_app.pacing import Pacing
from study_app.recorder import utc_now
from study_app.session_folders import session_folder

if TYPE_CHECKING:  # sessions without a screen load no graphics
    import moderngl

    from study_app.desktop.display_check import DisplayCheck
    from study_app.gaze.source import CalibrationResult
    from study_app.gaze.validation import PointQuality
    from study_app.live.renderer import Studio

LATE_MOST = 3
"""So many attempts in a row that a late display made void end the run."""


@dataclass(frozen=True)
class SessionSetup:
    """Everything that a session depends on, but the stage and the gaze source that are open."""

    study: StudyProtocol
    display: Display
    manifest: Manifest
    root: Path
    """Folder of all sessions."""
    participant: str
    language: str | None = None
    """Language of the texts; None: the protocol's default. A session that goes on keeps its own."""
    stimuli: Path = Path()
    """Folder of the clips; nothing reads it where none has pixels."""
    gaze: str | None = None
    """``lsl:NAME``, ``mouse``, ``replay:FILE``; None: no source."""
    pacing: Pacing = "vsync"
    marks: FlipMarks = field(default_factory=FlipMarks)
    markers: bool = False
    """True if phases are sent as LSL markers."""
    markers_code: bool = False
    """True if the markers' stream names the participant's code, too."""
    validate: bool = True
    """Validate the gaze source before each block; left out, the journal says so."""
    simulated: bool = False
    seed: int = 0
    """Seed of the artificial observer."""
    studio: Callable[[moderngl.Context], Studio] | None = None
    """Makes what draws stimuli that follow the gaze."""
    late_most: int = LATE_MOST
    """So many attempts in a row may be void because the display was late."""
    wall_clock: Callable[[], str] = utc_now
    """UTC as ``2026-01-31T12:00:00Z``."""
    simulation: str = ""
    """Options of artificial observers besides; recorded, and the same when they go on."""
    display_report: DisplayReport | None = None
    timing_evidence: str = ""
    drawn_by: Mapping[str, str] = field(default_factory=dict)
    """Renderer and driver of the window, by the names that `versions` has."""

    @property
    def folder(self) -> Path:
        """Folder of the participant's journal; `StudyError` as `session_folder` says."""
        return session_folder(self.root, self.study, self.participant)

    @property
    def spoken(self) -> str:
        """Language of the texts."""
        given = self.language
        return self.study.text.default_language if given is None else given

    @property
    def texts(self) -> Texts:
        """Everything a participant reads; `StudyError` if the language is missing."""
        languages = self.study.text.languages
        try:
            return languages[self.spoken]
        except KeyError:
            raise StudyError(must_be_one_of("language:", self.spoken, languages)) from None


@dataclass(frozen=True)
class SessionListener:
    """Told how a session goes."""

    on_check: Callable[[DisplayCheck], None] = lambda _: None
    on_validation: Callable[[list[PointQuality], CalibrationResult], None] = lambda _p, _r: None
    on_attempt: Callable[[Attempt, Sequence[AnyEvent]], None] = lambda _a, _e: None
    """Told every attempt once it is on the disk, and the journal so far."""
    on_note: Callable[[str], None] = lambda _: None
    on_mark: Callable[[str, float], None] = lambda _text, _t_s: None
    """Told the onset of every phase, and when blocks begin, for recordings elsewhere."""
