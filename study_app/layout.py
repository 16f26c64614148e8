"""What stands where on the screen: clip, fixation target, and what a lab adds to the picture."""

from __future__ import annotations

from dataclasses import dataclass

from protocols.display import Display
from protocols.errors import StudyError
from protocols.manifest import Manifest
from protocols.session_schema import TrialTiming
from study_app.gaze.geometry import Viewing
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

    clip: tuple[int, int]
    patch: tuple[int, int]
    dot_px: tuple[float, float]
    """The middle of the fixation target."""
    dot_diameter_px: float

    @classmethod
    def of(
        cls, display: Display, timing: TrialTiming, manifest: Manifest, extras: Extras
    ) -> Layout:
        """Place everything; all clips of a study have one size.

        Raises
        ------
        StudyError
            If an extra would cover a clip.
        """
        across, down = display.width_px, display.height_px
        width, height = manifest.clips[0].width_px, manifest.clips[0].height_px
        x, y = (across - width) // 2, (down - height) // 2
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
        viewing = Viewing.of(display)
        x_deg, y_deg = timing.fixation_x_deg, timing.fixation_y_deg
        left, _ = viewing.to_px(x_deg - timing.dot_deg / 2, y_deg)
        right, _ = viewing.to_px(x_deg + timing.dot_deg / 2, y_deg)
        return cls((x, y), patch, viewing.to_px(x_deg, y_deg), right - left)

    def beside_clip(self, clip_px: tuple[int, int], reach_px: int) -> bool:
        """Return whether a target of this reach around the dot leaves the clip uncovered."""
        (x, y), (width, height) = self.clip, clip_px
        return not (
            x - reach_px < self.dot_px[0] < x + width + reach_px
            and y - reach_px < self.dot_px[1] < y + height + reach_px
        )
