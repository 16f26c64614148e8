"""Stage of a session: a display that flips, keys, and pages of text.

The presenter's window is one stage; the virtual display of simulated sessions is another. The
session, the trial machine and the recorder are the same over both.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple, Protocol

from protocols.plan import PlannedTrial
from protocols.script import Picture as Notice
from protocols.script import ScriptPhase, TrialScript
from study_app.live.in_trials import KeptPixels, LiveFrame, SessionGaze


class KeyPress(NamedTuple):
    """One key that went down."""

    key: str
    """Named as in `protocols.study_file.session_schema`: a `KeyName`, or `POINTER`."""
    t_s: float
    """Time on the stage's clock."""
    at: float = 0.0
    """Place of the pointer: share of the screen's width, from the left."""


class FlipReport(NamedTuple):
    """Facts about one flip."""

    t_s: float
    """Time on the stage's clock."""
    number: int
    """Number of the flip, from 0 where the window opened: what the frame strip says."""
    evidence: str
    """Evidence for the stamp; see `protocols.journal.SessionStart.timing_evidence`."""
    live: LiveFrame | None = None
    """Frame that was drawn to the gaze, with that gaze; None: nothing was."""


class FlipPicture(NamedTuple):
    """Picture of one flip."""

    phase: ScriptPhase
    refreshes: int = 0
    """Refreshes for which the phase has been on the screen."""
    rests: bool = False
    """Nothing moves any more: the next stimuli may load."""
    notice: Notice | None = None
    """Notice of how the attempt stands, drawn first: feedback, or why it is void."""


@dataclass(frozen=True)
class Page:
    """A page of text that waits for a key."""

    name: str
    """`consent`, `instructions`, `practice`, `start`, `break`, `paused`, `quit`, `question`,
    `thanks`."""
    text: str
    keys: tuple[str, ...]
    """Keys that end it; empty: it is shown without waiting."""
    least_s: float = 0.0
    """Keys before that are ignored."""
    choices: tuple[str, ...] = ()
    """A question's answers; empty: free text is typed."""
    draft: str = ""
    """Text that was typed or chosen before the question was left."""
    done_share: float = 0.0
    """Share of the session that is done, shown as a bar; 0: nothing is shown."""


class PageResult(NamedTuple):
    """End of a page."""

    key: str
    answer: str
    """Answer that a question's page collected; what it had so far, if a quit key ended it."""
    duration_s: float


class FlipStage(Protocol):
    """Part of a stage that an attempt needs: flips, a clock, keys."""

    @property
    def refresh_hz(self) -> float:
        """The rate against which flips are judged."""

    def now(self) -> float:
        """Return the monotonic clock, in seconds."""

    def show(self, picture: FlipPicture) -> FlipReport:
        """Draw, flip, and return what is known of the flip. No disk, no decoding."""

    def key_presses(self) -> Sequence[KeyPress]:
        """Return the keys that went down since the last call. Never waits."""

    def disturbed(self) -> str:
        """Return the disturbance between participant and display since the last call; empty: none.

        Another window has the keyboard, the machine slept, the monitor is gone.
        """


class Stage(FlipStage, Protocol):
    """The display with its clock and its keys."""

    def prepare(self, trial: PlannedTrial, script: TrialScript, attempt: int, /) -> None:
        """Make all that the script shows ready; may take as long as it needs.

        Raises `StudyError` if one is missing or is not what was hashed.
        """

    def expect(self, trial: PlannedTrial) -> None:
        """Announce the trial after the one that runs; may load it while nothing moves."""

    def follow(self, gaze: SessionGaze, *, polled: bool) -> None:
        """Set the gaze that live pictures follow; `polled`: as `SourceInfo.polled`."""

    def kept(self) -> Mapping[int, KeptPixels]:
        """Return the pixels that are kept of an attempt's live frames, by `LiveFrame.flip.number`.

        Called while nothing moves: reading pixels back takes longer than a refresh.
        """

    def page(self, page: Page) -> PageResult:
        """Show a page until one of its keys goes down."""
