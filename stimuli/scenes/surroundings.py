"""All that is around a place: a panorama with distance, warped into flat views.

A built-in scene is drawn all around, from any place; a file was seen from one.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pipeline.camera import Camera
from pipeline.errors import InputError
from pipeline.foveation.geometry import Flat, FlatGeometry
from pipeline.foveation.view import turn
from pipeline.frame import Floats, PanoramaFrame, SourceFrame, TargetWindow, WarpedFrame
from pipeline.pictures.panorama_file import load_panorama
from pipeline.warp.around import GridPart, Outlook, panorama_motion
from pipeline.warp.speckle import mends, taken
from protocols.recipes.warped_clips import AroundScene
from stimuli.rendering.paths import Pose
from stimuli.rendering.render import WorldRenderer
from stimuli.rendering.render_panorama import surroundings_of, view_camera
from stimuli.rendering.scenery import CameraStep, Scenery, near_depth_m


class AroundScenery(Scenery):
    """A panorama with distance, and the world that it was drawn of, where it was.

    All of its pixel grid is the source, so one source serves all frames; it needs no margin.

    Parameters
    ----------
    frame : PanoramaFrame
        Seen from the path's centre.
    renderer : WorldRenderer, optional
        Of its world.
    """

    def __init__(
        self, scene: AroundScene, frame: PanoramaFrame, renderer: WorldRenderer | None = None
    ) -> None:
        if scene.depth_speckle:
            plain = SourceFrame(frame.colour, frame.distance_m, frame.measured)
            frame = replace(frame, distance_m=taken(frame.distance_m, *mends(plain)))
        self._scene, self.frame, self._renderer = scene, frame, renderer
        self.is_drawn, self.rim_px = renderer is not None, scene.rim_px
        self._turned = turn(scene.right_deg, scene.down_deg)
        still = Outlook(self._geometry((1, 1)), self._turned, np.zeros(3))
        self._whole = GridPart.around(frame.distance_m.shape, still)
        self._distance_m = frame.distance_m  # of the last source

    def source(
        self, size_px: tuple[int, int], margin_px: int, pose: Pose, extent_m: float, frame: int
    ) -> tuple[SourceFrame, Camera]:
        """Return the panorama, seen from where the camera is."""
        del margin_px
        seen = self.frame
        if frame >= 0:
            if self._renderer is None:
                raise InputError(f"{self._scene.name}: a file was seen from one place")
            move_m = self._move_m(extent_m * pose.offset)
            seen = surroundings_of(self._renderer, self._scene.height_px, move_m=move_m)
        self._distance_m = self._whole.read(seen.distance_m)
        view = self._geometry(size_px)
        lens = (view.distance_px, view.distance_px, *view.centre_px)
        camera = pose.applied_to(Camera(*size_px, *lens, np.eye(4)), extent_m)
        return SourceFrame(self._whole.read(seen.colour), self._distance_m), camera

    def motion(
        self, size_px: tuple[int, int], margin_px: int, step: CameraStep
    ) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """Motion of every pixel of the panorama into the view."""
        del margin_px
        move_m = self._move_m(step.extent_m * (step.end.offset - step.start.offset))
        outlook = Outlook(self._geometry(size_px), self._turned @ step.end.rotation, move_m)
        return panorama_motion(self._distance_m, self._whole, outlook)

    def truth(
        self,
        size_px: tuple[int, int],
        pose: Pose,
        extent_m: float,
        warped: WarpedFrame,
        margin_px: int,
    ) -> NDArray[np.float32]:
        """Draw the view from where the camera is."""
        del warped, margin_px
        if self._renderer is None:
            raise InputError(
                f"{self._scene.name}: there is no true view of a panorama from a file; set"
                " reference = false for this scene, or leave the reference out"
            )
        return self.view(size_px, self._move_m(extent_m * pose.offset), pose.rotation)

    def view(
        self, size_px: tuple[int, int], move_m: Floats, rotation: Floats | None = None
    ) -> NDArray[np.float32]:
        """Draw the view of an eye that moved along the panorama's axes."""
        assert self._renderer is not None
        turned = self._turned if rotation is None else self._turned @ rotation
        camera = view_camera(self._renderer.world, self._geometry(size_px), turned, move_m)
        return self._renderer.render(camera).colour

    def window(self, size_px: tuple[int, int], margin_px: int) -> TargetWindow:
        """Return the view, for motions from the panorama's pixels."""
        del margin_px
        still = Outlook(self._geometry(size_px), self._turned, np.zeros(3))
        return self._whole.window(still)

    def own_margin_px(self, size_px: tuple[int, int]) -> int:
        """Return none: a panorama shows all that comes from aside."""
        del size_px
        return 0

    @property
    def typical_depth_m(self) -> float:
        """Near distance of the panorama."""
        return near_depth_m(SourceFrame(self.frame.colour, self.frame.distance_m))

    def release(self) -> None:
        """Free the world."""
        if self._renderer is not None:
            self._renderer.release()

    def _geometry(self, size_px: tuple[int, int]) -> FlatGeometry:
        return Flat(width_deg=self._scene.view_deg).of(*size_px)

    def _move_m(self, offset_m: Floats) -> Floats:
        """Along the panorama's axes, from the view's."""
        return np.asarray(self._turned @ offset_m)


def open_around(scene: AroundScene, folder: Path, renderer: WorldRenderer | None) -> AroundScenery:
    """Draw a built-in scene's panorama, or read one.

    Raises
    ------
    InputError, OSError
        If a file is missing or broken.
    """
    if renderer is None:
        return AroundScenery(scene, read_around(scene, folder))
    return AroundScenery(scene, surroundings_of(renderer, scene.height_px), renderer)


def read_around(scene: AroundScene, folder: Path) -> PanoramaFrame:
    """Read the panorama of a scene's files; see `load_panorama`."""
    if scene.file is not None:
        return load_panorama(folder / scene.file)
    assert scene.rgb is not None
    assert scene.depth is not None
    return load_panorama(
        folder / scene.rgb, folder / scene.depth, depth_scale=scene.depth_scale,
        depth_is=scene.depth_is, unknown=scene.unknown,
    )  # fmt: skip
