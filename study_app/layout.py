"""What stands where on the screen: stimuli, fixation target, and what a lab adds to the picture."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass

from protocols.display import Display
from protocols.errors import StudyError
from protocols.manifest import Manifest
from protocols.phases import Bar, Clip, Image
from protocols.schema import StudyProtocol
from protocols.viewing import Viewing
from study_app.strip import BLOCK_PX, BLOCKS

PATCH_PX = 48
"""Edge of the photodiode's patch, in the lower right corner."""


@dataclass(frozen=True)
class Extras:
    """What a lab may add to the picture."""

    strip: bool = False
    """Frame strip: number and CRC of every flip."""
    photodiode: bool = False
    """Patch that is white at every other clip frame."""


@dataclass(frozen=True)
class Layout:
    """Places in pixels: of upper left corners, from the upper left corner of the screen."""

    stimulus_px: tuple[int, int]
    """Width and height of every stimulus."""
    places: Mapping[tuple[float, float], tuple[int, int]]
    """Of stimuli, by the angles of their middles."""
    bars: Mapping[float, tuple[int, int]]
    """First column and width of bars, by their width in degrees."""
    patch: tuple[int, int]
    dot_px: tuple[float, float]
    """The middle of the fixation target."""
    dot_diameter_px: float

    @classmethod
    def of(
        cls, display: Display, protocol: StudyProtocol, manifest: Manifest, extras: Extras
    ) -> Layout:
        """Place everything; all stimuli of a study have one size.

        Raises
        ------
        StudyError
            If an extra would cover a stimulus.
        """
        across, down = display.width_px, display.height_px
        width, height = manifest.clips[0].width_px, manifest.clips[0].height_px
        viewing = Viewing.of(display)
        places, bars = {}, {}
        for phase in protocol.task.phases(protocol.pool, display):
            for entry in phase.show:
                if isinstance(entry, Bar):
                    edge = math.floor(viewing.to_px(-entry.width_deg / 2, 0.0)[0] + 0.5)
                    bars[entry.width_deg] = edge, across - 2 * edge
                elif isinstance(entry, Clip | Image):
                    x_px, y_px = viewing.to_px(entry.x_deg, entry.y_deg)
                    places[entry.x_deg, entry.y_deg] = (
                        math.floor(x_px - width / 2 + 1e-6),
                        math.floor(y_px - height / 2 + 1e-6),
                    )
        x, y = max(place[0] for place in places.values()), min(p[1] for p in places.values())
        patch = across - PATCH_PX, down - PATCH_PX - BLOCK_PX
        sizes = f"(they are {width}x{height} on {across}x{down})"
        if extras.strip and (y < BLOCK_PX or across < BLOCKS * BLOCK_PX or height > down):
            raise StudyError(
                f"--strip: the frame strip needs {BLOCKS * BLOCK_PX}x{BLOCK_PX} pixels free above"
                f" and below the clips {sizes}; make the clips smaller, or leave the strip out"
            )
        if extras.photodiode and patch[0] < x + width and patch[1] < y + height:
            raise StudyError(
                f"--photodiode: the patch needs {PATCH_PX} pixels beside or below the clips"
                f" {sizes}; make the clips smaller, or leave it out"
            )
        timing = protocol.trial
        x_deg, y_deg = timing.fixation_x_deg, timing.fixation_y_deg
        left, _ = viewing.to_px(x_deg - timing.dot_deg / 2, y_deg)
        right, _ = viewing.to_px(x_deg + timing.dot_deg / 2, y_deg)
        return cls((width, height), places, bars, patch, viewing.to_px(x_deg, y_deg), right - left)

    def beside(self, places: Iterable[tuple[int, int]], reach_px: int) -> bool:
        """Return whether a target of this reach around the dot leaves stimuli uncovered.

        `places` are the upper left corners of the stimuli.
        """
        width, height = self.stimulus_px
        return not any(
            x - reach_px < self.dot_px[0] < x + width + reach_px
            and y - reach_px < self.dot_px[1] < y + height + reach_px
            for x, y in places
        )
