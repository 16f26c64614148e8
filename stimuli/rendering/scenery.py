"""Sceneries that a camera can be pointed at, and those that are drawn."""
# ruff: noqa: ARG002 - each scenery uses what it needs of what all are told

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pipeline.camera import Camera
from pipeline.frame import SourceFrame, TargetWindow, WarpedFrame
from stimuli.rendering.paths import Pose
from stimuli.rendering.render import WorldRenderer, check_view


@dataclass(frozen=True)
class CameraStep:
    """Way of the camera from the picture that is warped to a frame.

    Parameters
    ----------
    source, frame : int
        Frame that is seen where the picture is taken, -1 for the path's centre; and the frame.
    start, end : Pose
        Camera of both.
    extent_m : float
        Of the path.
    """

    source: int
    frame: int
    start: Pose
    end: Pose
    extent_m: float


class Scenery:
    """Scenery that a camera can be pointed at; unless it says else, a path moves the camera."""

    rim_px = 0
    """Width of the rim of mixed pixels along silhouettes; 0 where edges are exact."""
    is_drawn = False
    """True if a true view is drawn, and needs no warped frame."""
    largest_extent_m = float("inf")
    """Largest reach of a path; inf where nothing limits it."""

    def source(
        self, size_px: tuple[int, int], margin_px: int, pose: Pose, extent_m: float, frame: int
    ) -> tuple[SourceFrame, Camera]:
        """Return the RGBZ picture at `pose` with a margin, and its camera.

        `size_px` (width, height) is the shown part, in the picture's middle; `frame` is the
        frame that is seen at `pose`, -1 for the path's centre.
        """
        raise NotImplementedError

    def truth(
        self,
        size_px: tuple[int, int],
        pose: Pose,
        extent_m: float,
        warped: WarpedFrame,
        margin_px: int,
    ) -> NDArray[np.float32]:
        """Return the true view of the camera at `pose`, of `size_px`."""
        raise NotImplementedError

    def motion(
        self, size_px: tuple[int, int], margin_px: int, step: CameraStep
    ) -> tuple[NDArray[np.float32], NDArray[np.float32]] | None:
        """Return flow and target depth of a step, where they are not those between two cameras."""
        return None

    def window(self, size_px: tuple[int, int], margin_px: int) -> TargetWindow:
        """Return the window of what is shown, in the pixel grid of `source`."""
        return TargetWindow(margin_px, margin_px, *size_px)

    def own_margin_px(self, size_px: tuple[int, int]) -> int | None:
        """Return the margin around `size_px` that the files bring, where they bring all motion.

        None: a path moves the camera, and any margin can be made.

        Raises
        ------
        InputError
            If the files are smaller than `size_px`.
        """
        return None

    @property
    def typical_depth_m(self) -> float:
        """The depth of what is near, to begin the search for a path's extent."""
        raise NotImplementedError

    def release(self) -> None:
        """Free what is held on the GPU."""


def near_depth_m(frame: SourceFrame) -> float:
    """Return the depth that a twentieth of a picture is nearer than."""
    return float(np.percentile(frame.depth_m[np.isfinite(frame.depth_m)], 5))


class RenderedScenery(Scenery):
    """A world of triangles: every view of it is true."""

    is_drawn = True

    def __init__(self, renderer: WorldRenderer, name: str) -> None:
        self._renderer = renderer
        self._name = name
        self._near_m: float | None = None

    def source(
        self, size_px: tuple[int, int], margin_px: int, pose: Pose, extent_m: float, frame: int
    ) -> tuple[SourceFrame, Camera]:
        """Draw the view with its margin."""
        del frame
        viewpoint = self._renderer.world.viewpoint
        camera = pose.applied_to(viewpoint.camera(*size_px, margin_px), extent_m)
        seen = self._renderer.render(camera)
        check_view(camera, seen, self._name)
        return seen, camera

    def truth(
        self,
        size_px: tuple[int, int],
        pose: Pose,
        extent_m: float,
        warped: WarpedFrame,
        margin_px: int,
    ) -> NDArray[np.float32]:
        """Draw the view from where the camera is."""
        viewpoint = self._renderer.world.viewpoint
        return self._renderer.render(pose.applied_to(viewpoint.camera(*size_px), extent_m)).colour

    @property
    def typical_depth_m(self) -> float:
        """The depth that a twentieth of the picture is nearer than."""
        if self._near_m is None:
            camera = self._renderer.world.viewpoint.camera(96, 72)
            frame = self._renderer.render(camera)
            check_view(camera, frame, self._name)
            self._near_m = near_depth_m(frame)
        return self._near_m

    def release(self) -> None:
        """Free the world."""
        self._renderer.release()
