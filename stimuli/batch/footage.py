"""The frames of one clip before they are filled: warped views with holes, and the true views."""

from __future__ import annotations

from dataclasses import dataclass, replace

import moderngl
import numpy as np
from numpy.typing import NDArray

from pipeline.camera import Camera, flow_between
from pipeline.errors import InputError
from pipeline.frame import SourceFrame, TargetWindow, WarpedFrame
from pipeline.frame_textures import FrameTextures
from pipeline.gl.texture import create_texture, read_back, upload
from pipeline.warp.gpu import CompletePass, WarpPass
from pipeline.warp.reference import completed, warp
from pipeline.warp.settings import WarpSettings
from stimuli.rendering.motion import MotionPass, border_gap_px
from stimuli.rendering.paths import Path
from stimuli.rendering.scenery import CameraStep, Scenery

MARGIN_ROUNDS = 8


@dataclass(frozen=True)
class CameraShot:
    """Path of a clip's camera at its extent, and the picture's size.

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


class _SourceOnGpu:
    """A picture on the GPU, and what warps pictures of its size."""

    def __init__(
        self,
        ctx: moderngl.Context,
        size: tuple[int, int],
        window: TargetWindow,
        settings: WarpSettings,
    ) -> None:
        self.size = size
        height, width = size
        self._colour = create_texture(ctx, (width, height), "rgba32f")
        self._depth_m = create_texture(ctx, (width, height), "r32f")
        self._motion = MotionPass(ctx, (width, height))
        self._warp = WarpPass(ctx, (width, height), window, settings)
        self._warped = FrameTextures.create(ctx, (window.width_px, window.height_px))

    def load(self, key: int, picture: SourceFrame, camera: Camera) -> None:
        """Upload the picture taken at `key`."""
        self.key, self.camera = key, camera
        opaque = np.ones(picture.size, np.float32)
        upload(self._colour, np.dstack([picture.colour, opaque]))
        upload(self._depth_m, picture.depth_m)

    def warp_to(self, target: Camera) -> FrameTextures:
        """Warp to what another camera sees."""
        self._motion(self._depth_m, self.camera, target)
        return self._warped_now()

    def warp_along(
        self, flow_px: NDArray[np.float32], target_depth_m: NDArray[np.float32]
    ) -> FrameTextures:
        """Warp along a motion that is known."""
        upload(self._motion.flow_px, flow_px)
        upload(self._motion.target_depth_m, target_depth_m)
        return self._warped_now()

    def release(self) -> None:
        """Free everything."""
        for held in (self._colour, self._depth_m, self._motion, self._warp, self._warped):
            held.release()

    def _warped_now(self) -> FrameTextures:
        motion = self._motion
        self._warp(self._colour, motion.target_depth_m, motion.flow_px, self._warped)
        return self._warped


class _SourceInNumpy:
    """The same where no GPU is. Twin: `_SourceOnGpu`."""

    def __init__(self, size: tuple[int, int], window: TargetWindow, settings: WarpSettings) -> None:
        self.size = size
        self._window, self._settings = window, settings

    def load(self, key: int, picture: SourceFrame, camera: Camera) -> None:
        """Keep the picture taken at `key`."""
        self.key, self.camera, self._picture = key, camera, picture

    def warp_to(self, target: Camera) -> WarpedFrame:
        """Warp to what another camera sees."""
        return self.warp_along(*flow_between(self.camera, target, self._picture.depth_m))

    def warp_along(
        self, flow_px: NDArray[np.float32], target_depth_m: NDArray[np.float32]
    ) -> WarpedFrame:
        """Warp along a motion that is known."""
        return warp(
            self._picture, flow_px,
            target_depth_m=target_depth_m, window=self._window, settings=self._settings,
        )  # fmt: skip

    def release(self) -> None:
        """Free the GPU: nothing."""


_Source = _SourceOnGpu | _SourceInNumpy


class Footage:
    """Frames of one shot, any of them at any time: frame k alone is frame k in a row.

    Parameters
    ----------
    ctx : moderngl.Context or None
        Where it warps; None: in numpy.
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
        ctx: moderngl.Context | None,
        scenery: Scenery,
        shot: CameraShot,
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
        self._first: _Source | None = None
        self._second: _Source | None = None
        self._complete: CompletePass | None = None
        self._taken: tuple[int, SourceFrame, Camera] | None = None
        if margin_px is None:
            margin_px = scenery.own_margin_px(shot.size_px)
        self.margin_px = self._find_margin(probe) if margin_px is None else margin_px

    def warped(self, frame: int) -> WarpedFrame:
        """Warp the source to `frame`; a real frame of temporal up-sampling has no holes."""
        seen = self._seen(frame)
        warped = seen if isinstance(seen, WarpedFrame) else seen.read_back()
        return replace(warped, frame_index=frame)

    def warped_textures(self, frame: int) -> FrameTextures:
        """Warp the source to `frame`, on the GPU; the next call overwrites the textures."""
        seen = self._seen(frame)
        assert isinstance(seen, FrameTextures)  # who asks for textures has a context
        return seen

    def holes(self, frame: int) -> NDArray[np.bool_]:
        """Return the hole mask of `frame`, shape (H, W)."""
        seen = self._seen(frame)
        if isinstance(seen, WarpedFrame):
            return seen.hole
        colour: NDArray[np.float32] = read_back(seen.colour)
        return np.asarray(colour[..., 3] == 0)

    def _seen(self, frame: int) -> FrameTextures | WarpedFrame:
        """Warp to `frame`; a second source, where the path has one, completes the first."""
        path = self.shot.path
        self._first, result = self._warp(self._first, path.source(frame), frame)
        if (second := path.second(frame)) is None:
            return result
        self._second, other = self._warp(self._second, second, frame)
        if isinstance(result, WarpedFrame):
            assert isinstance(other, WarpedFrame)
            return completed(result, other)
        assert isinstance(other, FrameTextures)
        assert self._ctx is not None
        self._complete = self._complete or CompletePass(self._ctx)
        self._complete(result, other)
        return result

    def truth(self, frame: int) -> NDArray[np.float32]:
        """Return the true view of the camera of `frame`."""
        path, shot = self.shot.path, self.shot
        warped = _NOTHING if self._scenery.is_drawn else self.warped(frame)
        return self._scenery.truth(
            shot.size_px, path.poses[frame], shot.extent_m, warped, self.margin_px
        )

    def source_key(self, frame: int) -> int:
        """The frame that is seen where the source of `frame` is taken, -1 for the centre."""
        return self.shot.path.source(frame)

    def release(self) -> None:
        """Free what is held on the GPU; the scenery stays."""
        for held in (self._first, self._second, self._complete):
            if held is not None:
                held.release()
        self._first = self._second = self._complete = None

    def _warp(
        self, source: _Source | None, key: int, frame: int
    ) -> tuple[_Source, FrameTextures | WarpedFrame]:
        """Warp the picture taken at `key` to `frame`, with the passes of `source` if they fit."""
        if source is None or source.key != key:
            picture, camera = self._picture(key)
            if source is None or source.size != picture.size:
                if source is not None:
                    source.release()
                window = self._scenery.window(self.shot.size_px, self.margin_px)
                source = (
                    _SourceInNumpy(picture.size, window, self._settings)
                    if self._ctx is None
                    else _SourceOnGpu(self._ctx, picture.size, window, self._settings)
                )
            source.load(key, picture, camera)
        path, shot = self.shot.path, self.shot
        step = CameraStep(key, frame, path.pose_of(key), path.poses[frame], shot.extent_m)
        known = self._scenery.motion(shot.size_px, self.margin_px, step)
        if known is not None:
            return source, source.warp_along(*known)
        return source, source.warp_to(self._target(key, frame, source.camera))

    def _picture(self, key: int) -> tuple[SourceFrame, Camera]:
        """Return the source at `key`: the last one that the margin was found with, or anew."""
        taken, self._taken = self._taken, None
        if taken is None or taken[0] != key:
            return self._take(key, self.margin_px)
        return taken[1:]

    def _take(self, key: int, margin_px: int) -> tuple[SourceFrame, Camera]:
        shot = self.shot
        pose = shot.path.pose_of(key)
        return self._scenery.source(shot.size_px, margin_px, pose, shot.extent_m, key)

    def _target(self, key: int, frame: int, source: Camera) -> Camera:
        """The frame's camera, in the pixel grid of the source at `key`."""
        path, extent_m = self.shot.path, self.shot.extent_m
        start, end = path.pose_of(key), path.poses[frame]
        base = source
        if key >= 0:  # undo the source's own pose first
            pose = source.world_from_camera.copy()
            pose[:3, :3] = pose[:3, :3] @ start.rotation.T
            pose[:3, 3] -= pose[:3, :3] @ (extent_m * start.offset)
            base = replace(source, world_from_camera=pose)
        return end.applied_to(base, extent_m)

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
                    taken = (key, *self._take(key, margin))
                _, source, camera = taken
                target = self._target(key, frame, camera)
                gap = max(gap, border_gap_px(camera, target, source.depth_m, margin))
            if gap <= -1.0:
                self._taken = taken
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
