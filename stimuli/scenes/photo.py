"""Photographs with depth: stereo pairs, and a picture with a depth image.

A photograph is brought to the clip's size once: enlarged or shrunk until it covers the shown
part and its margin, colour by Lanczos and depth by the nearest pixel, so that no depth lies
between a surface and what is behind it. A wider margin shows a smaller part of it.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image
from scipy import ndimage

from pipeline.camera import UPRIGHT, Camera
from pipeline.errors import InputError
from pipeline.frame import SourceFrame, WarpedFrame, check_file_size
from pipeline.pictures.colour_file import load_colour
from pipeline.pictures.depth_and_flow import (
    centred,
    load_depth,
)
from pipeline.warp.speckle import mends, taken
from protocols.recipes.warped_clips import RgbdScene, StereoPath, StereoScene
from stimuli.rendering.paths import STILL, Pose
from stimuli.rendering.scenery import Scenery, near_depth_m
from stimuli.scenes.stereo import BUILT_IN, StereoPair, built_in_pair, load_pair


@dataclass(frozen=True)
class _Fit:
    """Place of a photograph in the picture: `scale` pixels per pixel, left top corner in it."""

    scale: float
    left: float
    top: float


class PhotoScenery(Scenery):
    """One photograph with depth, and, of a stereo pair, the other photograph as the truth.

    Parameters
    ----------
    frame : SourceFrame
    focal_px : float
        Of the photograph.
    pair : StereoPair, optional
    largest_extent_m : float
        How far a path may reach.
    rim_px : int
        How wide the rim of mixed pixels along silhouettes is.
    depth_speckle : bool
        Whether outliers and silhouettes of depth are mended: once, in the photograph's own pixels.
    """

    def __init__(
        self,
        name: str,
        frame: SourceFrame,
        focal_px: float,
        *,
        pair: StereoPair | None = None,
        largest_extent_m: float = float("inf"),
        rim_px: int = 0,
        depth_speckle: bool = False,
    ) -> None:
        if depth_speckle:
            frame = replace(frame, depth_m=taken(frame.depth_m, *mends(frame)))
        self._name, self._frame, self._focal_px, self._pair = name, frame, focal_px, pair
        self.largest_extent_m, self.rim_px = largest_extent_m, rim_px

    def source(
        self, size_px: tuple[int, int], margin_px: int, pose: Pose, extent_m: float, frame: int
    ) -> tuple[SourceFrame, Camera]:
        """Cut the photograph to size."""
        del extent_m
        if pose is not STILL or frame >= 0:
            raise InputError(
                f"{self._name}: a single photograph has no further real frames; temporal"
                " up-sampling needs a rendered scene or an OpenEXR sequence"
            )
        fit = self._fit(size_px, margin_px)
        width, height = size_px[0] + 2 * margin_px, size_px[1] + 2 * margin_px
        colour = _resized(self._frame.colour, fit, (width, height))
        depth = _nearest(self._frame.depth_m, fit, (width, height))
        focal = self._focal_px * fit.scale
        camera = Camera(width, height, focal, focal, width / 2, height / 2, UPRIGHT)
        return SourceFrame(colour, depth), camera

    def truth(
        self,
        size_px: tuple[int, int],
        pose: Pose,
        extent_m: float,
        warped: WarpedFrame,
        margin_px: int,
    ) -> NDArray[np.float32]:
        """Show, inside the holes, what the other photograph saw there; all else is the warp's.

        A hole's depth is the background's: it says where in the other photograph to look. At
        the other camera itself that is the pixel's own place, whatever the depth.
        """
        pair = self._pair
        if pair is None or pair.right is None:
            raise InputError(
                f"{self._name}: there is no true view of a photograph but on a stereo path; set"
                " reference = false for this scene, or leave the reference out"
            )
        fit = self._fit(size_px, margin_px)
        amount = extent_m * float(pose.offset[0]) / pair.baseline_m
        y, x = np.nonzero(warped.hole)
        parallax = pair.focal_px * pair.baseline_m / warped.depth_m[y, x].astype(np.float64)
        shown_x = (x + 0.5 + margin_px) / fit.scale + fit.left
        shown_y = (y + 0.5 + margin_px) / fit.scale + fit.top
        right_x = shown_x + (amount - 1) * parallax + pair.offset_px
        place = [shown_y - 0.5, right_x - 0.5]
        result = warped.colour.copy()
        for channel in range(3):
            result[y, x, channel] = ndimage.map_coordinates(
                pair.right[..., channel], place, order=1, mode="nearest"
            )
        return result.clip(0, 1)

    @property
    def typical_depth_m(self) -> float:
        """The depth that a twentieth of the photograph is nearer than."""
        return near_depth_m(self._frame)

    def _fit(self, size_px: tuple[int, int], margin_px: int) -> _Fit:
        height, width = self._frame.size
        wanted = (size_px[0] + 2 * margin_px, size_px[1] + 2 * margin_px)
        scale = max(wanted[0] / width, wanted[1] / height)
        return _Fit(scale, (width - wanted[0] / scale) / 2, (height - wanted[1] / scale) / 2)


def open_stereo(scene: StereoScene, folder: Path) -> PhotoScenery:
    """Open a pair; ``left = "motorcycle"`` means the one that comes with scikit-image."""
    pair = read_pair(scene, folder)
    largest = float("inf")
    if isinstance(scene.camera, StereoPath):
        largest = scene.camera.baselines * scene.baseline_m
    else:
        pair = replace(pair, right=None)
    frame = SourceFrame(pair.left, pair.depth_m, pair.known)
    return PhotoScenery(
        scene.name, frame, pair.focal_px, pair=pair, largest_extent_m=largest,
        rim_px=scene.rim_px, depth_speckle=scene.depth_speckle,
    )  # fmt: skip


def read_pair(scene: StereoScene, folder: Path) -> StereoPair:
    """Read a scene's pair; both photographs, whatever its path.

    Raises
    ------
    FileNotFoundError, InputError
        As `load_pair` raises them.
    """
    if is_built_in(scene, folder):
        return replace(
            built_in_pair(scene.left), focal_px=scene.focal_px, baseline_m=scene.baseline_m,
            offset_px=scene.offset_px,
        )  # fmt: skip
    return load_pair(
        folder / scene.left, folder / scene.disparity, folder / scene.right,
        units_per_px=scene.units_per_px, focal_px=scene.focal_px, baseline_m=scene.baseline_m,
        offset_px=scene.offset_px, unknown=scene.unknown,
    )  # fmt: skip


def is_built_in(scene: StereoScene, folder: Path) -> bool:
    """True if the pair comes with a package and not from files."""
    return scene.left in BUILT_IN and not (folder / scene.left).exists()


def open_rgbd(scene: RgbdScene, folder: Path) -> PhotoScenery:
    """Open a picture and its depth; see `load_depth`.

    Raises
    ------
    InputError
        If sizes differ, or a depth is NaN or not positive.
    """
    if isinstance(scene.camera, StereoPath):
        raise InputError(f"{scene.name}: the stereo path needs a stereo pair (this is one picture)")
    colour = load_colour(folder / scene.rgb)
    height, width = colour.shape[:2]
    depth, measured = load_depth(
        folder / scene.depth, scene.depth_scale, is_a=scene.depth_is, unknown=scene.unknown,
        intrinsics_px=centred(scene.focal_px, width, height),
    )  # fmt: skip
    check_file_size(scene.depth, depth, scene.rgb, colour)
    frame = SourceFrame(colour, depth, measured)
    return PhotoScenery(
        scene.name, frame, scene.focal_px, rim_px=scene.rim_px, depth_speckle=scene.depth_speckle
    )


def _resized(
    colour: NDArray[np.float32], fit: _Fit, size_px: tuple[int, int]
) -> NDArray[np.float32]:
    box = (
        fit.left, fit.top, fit.left + size_px[0] / fit.scale, fit.top + size_px[1] / fit.scale
    )  # fmt: skip
    height, width = colour.shape[:2]
    box = (max(box[0], 0), max(box[1], 0), min(box[2], width), min(box[3], height))
    planes = [
        np.asarray(
            Image.fromarray(np.ascontiguousarray(colour[..., c])).resize(
                size_px, Image.Resampling.LANCZOS, box=box
            )
        )
        for c in range(3)
    ]
    return np.stack(planes, axis=-1).clip(0, 1).astype(np.float32)


def _nearest(
    plane: NDArray[np.float32], fit: _Fit, size_px: tuple[int, int]
) -> NDArray[np.float32]:
    height, width = plane.shape
    x = np.floor((np.arange(size_px[0]) + 0.5) / fit.scale + fit.left).astype(int)
    y = np.floor((np.arange(size_px[1]) + 0.5) / fit.scale + fit.top).astype(int)
    return np.ascontiguousarray(plane[y.clip(0, height - 1)][:, x.clip(0, width - 1)])
