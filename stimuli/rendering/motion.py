"""The motion of a source picture towards another camera, on the GPU.

Twin: `pipeline.camera.flow_between`.
"""

from __future__ import annotations

from importlib import resources

import moderngl
import numpy as np
from numpy.typing import NDArray

from pipeline.camera import Camera
from pipeline.gl.compute import Shader
from pipeline.gl.shader import flatten
from pipeline.gl.texture import check_texture, create_texture


class MotionPass:
    """Flow and target depth of every pixel of a source of `size` (width, height).

    Compiles and allocates on construction; a call makes one dispatch and ends with a barrier.

    Attributes
    ----------
    flow_px : rg32f
        Target minus source position.
    target_depth_m : r32f
        Depth of the same points as the target sees them; 0 behind it.
    """

    def __init__(self, ctx: moderngl.Context, size: tuple[int, int]) -> None:
        self.size = size
        self._shader = Shader.of(
            ctx, flatten("shaders/motion.comp.glsl", {}, resources.files("stimuli.rendering"))
        )
        self.flow_px = create_texture(ctx, size, "rg32f")
        self.target_depth_m = create_texture(ctx, size, "r32f")

    def __call__(self, depth_m: moderngl.Texture, source: Camera, target: Camera) -> None:
        """Work out the motion from `source`, which saw `depth_m` (r32f), to `target`."""
        check_texture(depth_m, "depth_m", self.size, "r32f")
        from_world = np.linalg.inv(target.world_from_camera[:3, :3])
        turn = from_world @ source.world_from_camera[:3, :3]
        shift = from_world @ (source.world_from_camera[:3, 3] - target.world_from_camera[:3, 3])
        same_lens = (source.fx_px, source.fy_px) == (target.fx_px, target.fy_px)
        still = same_lens and bool(np.abs(turn - np.eye(3)).max() < 1e-9)
        for name, value in (
            ("turn", tuple(turn.T.ravel())),
            ("shift_m", tuple(shift)),
            ("source_focal", (source.fx_px, source.fy_px)),
            ("source_centre", (source.cx_px, source.cy_px)),
            ("target_focal", (target.fx_px, target.fy_px)),
            ("target_centre", (target.cx_px, target.cy_px)),
            ("still", still),
        ):
            self._shader[name] = value
        self._shader.run_over(
            self.size, depth_m=depth_m, flow_px=self.flow_px, target_depth_m=self.target_depth_m
        )

    def release(self) -> None:
        """Free textures and shader."""
        for resource in (self.flow_px, self.target_depth_m, self._shader):
            resource.release()


def border_gap_px(
    source: Camera, target: Camera, depth_m: NDArray[np.float32], margin_px: int
) -> float:
    """Distance (pixels) by which the source's outermost pixels fall short of the window's border.

    The window is the source without `margin_px` on every side. At most 0 means that every
    hole in it was uncovered by something, and none comes from outside the source.

    Parameters
    ----------
    depth_m : ndarray of float32, shape (H, W)
        The source's depth.
    """
    height, width = depth_m.shape
    x, y = np.arange(width), np.arange(height)
    gaps = []
    for rows, columns, axis, limit, sign in (
        (y, np.zeros_like(y), 0, margin_px, 1.0),
        (y, np.full_like(y, width - 1), 0, width - margin_px, -1.0),
        (np.zeros_like(x), x, 1, margin_px, 1.0),
        (np.full_like(x, height - 1), x, 1, height - margin_px, -1.0),
    ):
        place = np.stack([columns + 0.5, rows + 0.5], axis=-1)
        moved, depth = _moved(source, target, place, depth_m[rows, columns])
        in_front = depth > 0
        gaps.append(np.max(sign * (moved[in_front, axis] - limit), initial=-np.inf))
    return float(max(gaps))


def _moved(
    source: Camera, target: Camera, place_px: NDArray[np.float64], depth_m: NDArray[np.float32]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    ray = np.stack(
        [
            (place_px[:, 0] - source.cx_px) / source.fx_px,
            (place_px[:, 1] - source.cy_px) / source.fy_px,
            np.ones(len(place_px)),
        ],
        axis=-1,
    )
    from_world = np.linalg.inv(target.world_from_camera[:3, :3])
    shift = from_world @ (source.world_from_camera[:3, 3] - target.world_from_camera[:3, 3])
    turned = ray @ (from_world @ source.world_from_camera[:3, :3]).T
    moved = turned + shift / depth_m.astype(np.float64)[:, None]
    with np.errstate(divide="ignore", invalid="ignore"):
        image = np.stack(
            [
                target.fx_px * moved[:, 0] / moved[:, 2] + target.cx_px,
                target.fy_px * moved[:, 1] / moved[:, 2] + target.cy_px,
            ],
            axis=-1,
        )
    return image, moved[:, 2]
