"""Phases of a trial as a task states them: in refreshes, with what each draws, in degrees.

`protocols.script` makes of it what machine and stages read; neither knows a task.
"""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal, TypeAlias


@dataclass(frozen=True)
class Fixation:
    """The fixation target at its place."""


@dataclass(frozen=True)
class Image:
    """A still of the trial."""

    stimulus: int
    """Number of the trial's stimulus, from 0."""
    x_deg: float = 0.0
    """Place of its middle, right of the screen's centre."""
    y_deg: float = 0.0
    """Place of its middle, below the screen's centre."""
    half: Literal["left", "right"] | None = None
    """Only this half of it is shown, at its place; None: all of it."""


@dataclass(frozen=True)
class MovingImage:
    """A clip of the trial, from its first frame on."""

    stimulus: int
    refreshes_per_frame: int
    x_deg: float = 0.0
    y_deg: float = 0.0


@dataclass(frozen=True)
class LiveImage:
    """A still of the trial that is drawn to the gaze, frame by frame."""

    stimulus: int
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
class QuestionText:
    """The question of the phase, with each answer's label over its key."""


@dataclass(frozen=True)
class Bitmap:
    """A picture that the task draws itself, for the pixels of the display; shown one to one."""

    width_px: int
    height_px: int
    rgba: bytes = field(repr=False)
    """Rows from the top, four bytes a pixel; alpha is straight."""
    x_deg: float = 0.0
    """Place of its middle, right of the screen's centre."""
    y_deg: float = 0.0
    """Place of its middle, below the screen's centre."""

    @property
    def sha256(self) -> str:
        """Hash of size and pixels."""
        return rgba_sha256(self.width_px, self.height_px, self.rgba)


def rgba_sha256(width_px: int, height_px: int, rgba: bytes) -> str:
    """Return the name of a picture by its pixels: SHA-256 of ``WIDTHxHEIGHT`` and its RGBA."""
    return hashlib.sha256(f"{width_px}x{height_px}".encode() + rgba).hexdigest()


Drawable: TypeAlias = (
    Fixation | Image | MovingImage | LiveImage | Optotype | Bar | QuestionText | Bitmap
)
"""Drawables of a flip; a phase that draws nothing is blank. Anything else is refused: a task of
your own draws it as a `Bitmap`."""


@dataclass(frozen=True)
class Question:
    """Question of a phase. A key of an answer ends the phase."""

    name: str
    answers: tuple[str, ...] = ()
    """Names, from left to right."""
    keys: tuple[tuple[str, ...], ...] = ()
    """A list of keys per answer."""
    text: Mapping[str, str] = field(default_factory=dict)
    """Text of the question, by language."""
    labels: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    """A label per answer, by language."""


STUDY_QUESTION = Question("answer")
"""The study's own, with the answers of the task and the keys, texts and labels of the study. Its
answer is the attempt's; those to all other questions are its further ones."""

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
    """Longest wait, in refreshes, for gaze to be held for `frames`; None: no such wait."""
    watched: bool = False
    """Gaze that leaves the dot voids the attempt; missed refreshes count."""
    asks: Question | None = None
    """The question whose answer ends it. A question may last over several phases in a row, such as
    a stimulus and a blank: an answer ends them all."""
    timeout_frames: int | None = None
    """Without an answer for so long, the attempt is void. Default for the study's question in a
    phase without a length: the study's `response.timeout_s`."""
