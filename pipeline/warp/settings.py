"""Settings of the warp for both twins: the target's window and how quads are treated."""

from dataclasses import dataclass
from typing import Literal, TypeAlias, get_args

import numpy as np
from numpy.typing import NDArray

from pipeline.errors import InputError
from pipeline.frame import SourceFrame, TargetWindow, check_flow, check_same_size
from pipeline.warp.speckle import mends, taken
from protocols.errors import must_be_one_of

Variant: TypeAlias = Literal["full", "smear", "remove"]
VARIANTS: tuple[Variant, ...] = get_args(Variant)

SUBPIXELS = 256  # positions are rounded to this part of a pixel
STRETCH_SHARE = 0.005  # of the window's width
LEAST_STRETCH_PX = 2.0
SURFACE_PX = 8
MOST_RIM_PX = 4


@dataclass(frozen=True)
class WarpSettings:
    """Treatment of quads by the warp.

    Parameters
    ----------
    variant : {"full", "smear", "remove"}
        ``full``: torn quads leave holes with background depth (the method).
        ``smear``: every quad is a surface. ``remove``: torn quads are left out, and
        holes have no depth (inf). The last two are [MI] Fig. 5's rivals.
    stretch_px : float, optional
        A quad's side longer than this may be torn; by default 0.005 of the window's width
        (the authors' release), and at least 2.
    surface_px : int
        So many sides in line that stretch alike are one surface and are not torn, however
        long they are. A number beyond the image's size leaves the length alone to decide, as
        in [MI].
    rim_px : int
        So many pixels of the background along a hole, 0 to 4, are taken to be mixed with what
        uncovered it, as a photograph's are, and are hole too. Needs variant ``full``.
    depth_speckle : bool
        Whether outliers and silhouettes of depth are mended first, as measured depth needs it: see
        `pipeline.warp.speckle`. A `WarpPass` takes sources that are mended.

    Raises
    ------
    InputError
        If a value is out of range.
    """

    variant: Variant = "full"
    stretch_px: float | None = None
    surface_px: int = SURFACE_PX
    rim_px: int = 0
    depth_speckle: bool = False

    def __post_init__(self) -> None:
        if self.variant not in VARIANTS:
            raise InputError(must_be_one_of("variant", self.variant, VARIANTS))
        if self.stretch_px is not None and not 1 <= self.stretch_px < np.inf:
            raise InputError(
                f"stretch_px must be at least 1, the length at rest (got {self.stretch_px})"
            )
        if self.surface_px < 2:
            raise InputError(f"surface_px must be at least 2 (got {self.surface_px})")
        whole = isinstance(self.rim_px, int) and not isinstance(self.rim_px, bool)
        if not whole or not 0 <= self.rim_px <= MOST_RIM_PX:
            raise InputError(
                f"rim_px must be a whole number from 0 to {MOST_RIM_PX} (got {self.rim_px!r})"
            )
        if self.rim_px > 0 and self.variant != "full":
            raise InputError(
                f"rim_px must be 0 for variant {self.variant}: only full gives holes the motion of"
                f" what lies behind (got {self.rim_px})"
            )

    def alike_px(self, window: TargetWindow) -> float:
        """Motions that differ by no more do not tear two neighbours apart: they are one surface."""
        return self.stretch_subpixels(window) / SUBPIXELS - 1

    def stretch_subpixels(self, window: TargetWindow) -> int:
        """The threshold in the unit of positions."""
        stretch_px = self.stretch_px
        if stretch_px is None:
            stretch_px = max(LEAST_STRETCH_PX, STRETCH_SHARE * window.width_px)
        return min(round(stretch_px * SUBPIXELS), 2**30)


def checked_motion(
    frame: SourceFrame,
    flow_px: NDArray[np.float32],
    target_depth_m: NDArray[np.float32] | None,
    settings: WarpSettings,
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Check motion and depth against `frame`; return motion and each pixel's depth in the target.

    Both are mended where `settings` say so.

    Raises
    ------
    InputError
        If sizes or types differ, the flow is not finite, or `target_depth_m` is NaN.
    """
    depth_m = _checked_depth(frame, flow_px, target_depth_m)
    if not settings.depth_speckle:
        return flow_px, depth_m
    pixel, source = mends(frame)
    return taken(flow_px, pixel, source), taken(depth_m, pixel, source)


def _checked_depth(
    frame: SourceFrame, flow_px: NDArray[np.float32], target_depth_m: NDArray[np.float32] | None
) -> NDArray[np.float32]:
    check_flow(flow_px, "flow_px")
    if target_depth_m is None:
        check_same_size(colour=frame.colour, flow_px=flow_px)
        return frame.depth_m
    if target_depth_m.dtype != np.float32 or target_depth_m.ndim != 2:
        raise InputError(
            "target_depth_m must be float32 of shape (H, W)"
            f" (got {target_depth_m.dtype} of shape {target_depth_m.shape})"
        )
    check_same_size(colour=frame.colour, flow_px=flow_px, target_depth_m=target_depth_m)
    if (bad := np.isnan(target_depth_m)).any():
        row, column = np.argwhere(bad)[0]
        raise InputError(
            "target_depth_m must be a number (not positive behind the camera)"
            f" (got nan at row {row}, column {column}, and {int(bad.sum()) - 1} more such pixels)"
        )
    return target_depth_m
