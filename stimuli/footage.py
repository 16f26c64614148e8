"""The frames of one clip before they are filled: warped views with holes, and the true views."""

from __future__ import annotations

from dataclasses import dataclass, replace

import moderngl
import numpy as np
from numpy.typing import NDArray

from pipeline.camera import Camera
from pipeline.errors import InputError
from pipeline.frame import SourceFrame, WarpedFrame
from pipeline.frame_textures import FrameTextures
from pipeline.gl.texture import create_texture, read_back, upload
from pipeline.warp.gpu import WarpPass
from pipeline.warp.settings import WarpSettings, Window
from stimuli.motion import MotionPass, border_gap_px
from stimuli.paths import Path
from stimuli.scenery import RenderedScenery, Scenery

MARGIN_ROUNDS = 8


@dataclass(frozen=True)
class Shot:
    """How a clip is taken: the path at its extent, and the picture's size.

    Parameters
    ----------
    size_px : (width, height)
        Of what is shown.
    margin_share : float
        Least margin around it, in widths; it grows until no hole comes from outside.
    """

    path: Path
    size_px: tuple[int, int]
    extent_m: float
    margin_share: float

    @property
    def frames(self) -> int:
        """Frames of the clip."""
        return len(self.path.poses)


class Footage:
    """Frames of one shot, any of them at any time: frame k alone is frame k in a row.

    Parameters
    ----------
    margin_px : int, optional
        As `margin_px` of an earlier footage of the same shot; left out: it is found, by making
        the margin wider until no shown frame of `probe` has a hole that comes from outside.
    probe : sequence of int, optional
        Frames to find the margin for; all by default.
    holes_only : bool
        Leave holes without depth and motion where the scenery allows it, which is faster where
        only they matter: `holes` alone is meant to be called.

    Raises
    ------
    InputError
        If no margin is enough, or the scene shows nothing.
    """

    def __init__(
        self,
        ctx: moderngl.Context,
        scenery: Scenery,
        shot: Shot,
        *,
        margin_px: int | None = None,
        probe: list[int] | None = None,
        holes_only: bool = False,
    ) -> None:
        self._ctx = ctx
        self._scenery = scenery
        self.shot = shot
        # A rim is found by the holes' motion.
        bare = holes_only and scenery.rim_px == 0
        self._settings = WarpSettings("remove" if bare else "full", rim_px=scenery.rim_px)
        self._passes: (
            tuple[moderngl.Texture, moderngl.Texture, MotionPass, WarpPass, FrameTextures] | None
        ) = None
        self._source_frame: int | None = None
        self._camera: Camera | None = None
        self._frame: SourceFrame | None = None
        if margin_px is None:
            margin_px = scenery.own_margin_px(shot.size_px)
        self.margin_px = self._find_margin(probe) if margin_px is None else margin_px

    def warped(self, frame: int) -> WarpedFrame:
        """Warp the source to `frame`; a real frame of temporal up-sampling has no holes."""
        return replace(self.warped_textures(frame).read_back(), frame_index=frame)

    def warped_textures(self, frame: int) -> FrameTextures:
        """Warp the source to `frame`, on the GPU; the next call overwrites the textures."""
        camera = self._take_source(frame)
        assert self._passes is not None  # the source has been uploaded
        colour, depth, motion, warp, textures = self._passes
        known = self._scenery.motion(
            self.shot.size_px, self.margin_px, self.source_key(frame), frame
        )
        if known is None:
            motion(depth, camera, self._target(frame, camera))
        else:
            upload(motion.flow_px, known[0])
            upload(motion.target_depth_m, known[1])
        warp(colour, motion.target_depth_m, motion.flow_px, textures)
        return textures

    def holes(self, frame: int) -> NDArray[np.bool_]:
        """Return the hole mask of `frame`, shape (H, W)."""
        colour: NDArray[np.float32] = read_back(self.warped_textures(frame).colour)
        return np.asarray(colour[..., 3] == 0)

    def truth(self, frame: int) -> NDArray[np.float32]:
        """Return what the camera of `frame` really sees."""
        path, shot = self.shot.path, self.shot
        rendered = isinstance(self._scenery, RenderedScenery)
        warped = _NOTHING if rendered else self.warped(frame)
        return self._scenery.truth(
            shot.size_px, path.poses[frame], shot.extent_m, warped, self.margin_px
        )

    def source_key(self, frame: int) -> int:
        """The frame that is seen where the source of `frame` is taken, -1 for the centre."""
        sources = self.shot.path.source_frames
        return -1 if sources is None else sources[frame]

    def release(self) -> None:
        """Free what is held on the GPU; the scenery stays."""
        for resource in self._passes or ():
            resource.release()
        self._passes, self._source_frame = None, None

    def _target(self, frame: int, source: Camera) -> Camera:
        """The frame's camera, in the source's pixel grid."""
        path, extent_m = self.shot.path, self.shot.extent_m
        start, end = path.source_pose(frame), path.poses[frame]
        base = source
        if path.source_frames is not None:  # undo the source's own pose first
            pose = source.world_from_camera.copy()
            pose[:3, :3] = pose[:3, :3] @ start.rotation.T
            pose[:3, 3] -= pose[:3, :3] @ (extent_m * start.offset)
            base = replace(source, world_from_camera=pose)
        return end.applied_to(base, extent_m)

    def _take_source(self, frame: int) -> Camera:
        """Put the source of `frame` on the GPU, unless it is there."""
        key = self.source_key(frame)
        if self._source_frame == key and self._camera is not None:
            return self._camera
        shot = self.shot
        source, camera = self._scenery.source(
            shot.size_px, self.margin_px, shot.path.source_pose(frame), shot.extent_m, key
        )
        self._upload(source)
        self._source_frame, self._camera = key, camera
        return camera

    def _upload(self, source: SourceFrame) -> None:
        height, width = source.size
        if self._passes is None or self._passes[2].size != (width, height):
            self.release()
            window = Window.inside_margin(source.size, self.margin_px)
            self._passes = (
                create_texture(self._ctx, (width, height), "rgba32f"),
                create_texture(self._ctx, (width, height), "r32f"),
                MotionPass(self._ctx, (width, height)),
                WarpPass(self._ctx, (width, height), window, self._settings),
                FrameTextures.create(self._ctx, (window.width_px, window.height_px)),
            )
        colour, depth, *_ = self._passes
        upload(colour, np.dstack([source.colour, np.ones((height, width), np.float32)]))
        upload(depth, source.depth_m)

    def _find_margin(self, probe: list[int] | None) -> int:
        shot = self.shot
        frames = list(range(shot.frames)) if probe is None else probe
        margin = round(shot.margin_share * shot.size_px[0])
        for _ in range(MARGIN_ROUNDS):
            gap = -np.inf
            taken: tuple[int, SourceFrame, Camera] | None = None
            for frame in frames:
                key = self.source_key(frame)
                if taken is None or taken[0] != key:
                    taken = (
                        key,
                        *self._scenery.source(
                            shot.size_px,
                            margin,
                            shot.path.source_pose(frame),
                            shot.extent_m,
                            key,
                        ),
                    )
                _, source, camera = taken
                target = self._target(frame, camera)
                gap = max(gap, border_gap_px(camera, target, source.depth_m, margin))
            if gap <= -1.0:
                return margin
            margin += int(np.ceil(1.15 * (gap + 1.0))) + 1
            if margin > 2 * max(shot.size_px):
                break
        raise InputError(
            f"a path of extent {shot.extent_m:.4g} m must show only what a source with a margin"
            f" of {2 * max(shot.size_px)} px saw; ask for fewer holes, or move the camera away"
            " from what is near"
        )


def _nothing() -> WarpedFrame:
    one = np.ones((1, 1), np.float32)
    return WarpedFrame(
        np.zeros((1, 1, 3), np.float32), one, one > 2, np.zeros((1, 1, 2), np.float32)
    )


_NOTHING = _nothing()
