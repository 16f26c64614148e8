"""A trial as data: a list of phases, counted in refreshes, each with what it draws.

The trial machine interprets the list and the presenter draws it; neither knows a task.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, TypeAlias


@dataclass(frozen=True)
class Fixation:
    """The fixation target at its place."""


@dataclass(frozen=True)
class Image:
    """A still of the trial."""

    stimulus: int
    """Which of the trial's stimuli."""
    x_deg: float = 0.0
    """Place of its middle, right of the screen's centre."""
    y_deg: float = 0.0
    """Place of its middle, below the screen's centre."""
    half: Literal["left", "right"] | None = None
    """Only this half of it is shown, at its place; None: all of it."""


@dataclass(frozen=True)
class Clip:
    """A clip of the trial, from its first frame on."""

    stimulus: int
    refreshes_per_frame: int
    x_deg: float = 0.0
    y_deg: float = 0.0


@dataclass(frozen=True)
class Optotype:
    """A Landolt ring after ISO 8596: gap and stroke are a fifth of its height."""

    gap_deg: float | None
    """Direction of the gap, counter-clockwise from the right; None: the ring is closed."""
    height_deg: float
    x_deg: float
    y_deg: float
    grey: float = 0.0
    """Encoded grey of the ring."""


@dataclass(frozen=True)
class Bar:
    """An upright bar of the background's grey in the middle of the screen, as high as that."""

    width_deg: float


@dataclass(frozen=True)
class Text:
    """A text of the protocol, laid out by the presenter."""

    name: str
    """`answer`: the question, with each answer's label over its key; `feedback`."""


Drawable: TypeAlias = Fixation | Image | Clip | Optotype | Bar | Text
"""What a flip can show; a phase that draws nothing is blank."""

ITI = "iti"
"""Name of the blank phase that ends every trial."""


@dataclass(frozen=True)
class Phase:
    """One phase of a trial."""

    name: str
    frames: int | None
    """Refreshes that it lasts; None: until an action ends it."""
    show: tuple[Drawable, ...] = ()
    """Drawn in this order; empty: blank."""
    gate_frames: int | None = None
    """Where gaze must be held for `frames` before the phase ends: how long it waits for that."""
    watched: bool = False
    """Gaze that leaves the dot voids the attempt; missed refreshes count."""
    ends_on: frozenset[str] = frozenset()
    """Answers that end it."""
    timeout_frames: int | None = None
    """Without an answer for so long, the attempt is void."""

    def clip_frame(self, drawable: Clip | Image, refreshes: int) -> int:
        """Return which frame of a stimulus is shown after so many refreshes of the phase."""
        return refreshes // drawable.refreshes_per_frame if isinstance(drawable, Clip) else 0
