"""The warp on the GPU. Twin: reference.py."""

import math
from functools import partial

import moderngl
import numpy as np
from numpy.typing import NDArray

from pipeline.errors import InputError
from pipeline.frame import SourceFrame, TargetWindow, WarpedFrame
from pipeline.frame_textures import FrameTextures
from pipeline.gl.compute import ask
from pipeline.gl.context import describe
from pipeline.gl.passes import Pass
from pipeline.gl.shader import Constant
from pipeline.gl.texture import format_of, texture_from
from pipeline.warp import reference
from pipeline.warp.settings import WarpSettings, checked_motion

ROW = 64  # work-group size of whole frames: tiles would share cache sets where rows are 2^n bytes
TILE = 8  # work-group edge, pixels, where neighbours in all directions are read
LANES = 32  # work-group size where one group takes one quad; a GPU's warp
SOFTWARE_LANES = 8  # llvmpipe's vector
SMALL = 16  # target pixels in the bounding box of a quad that one invocation draws
GROUPS = 512  # work groups that share what is listed
MOST_GROUPS = 32768  # in a row of work groups: every driver takes that many
PARTS = 8  # of a quad, each of two triangles that may win a pixel
MOST_QUADS = 2**31 // (2 * PARTS) - 1
NOTHING = 0xFF  # every byte of the key of a pixel that no quad reached
COUNTERS = bytes(28)  # see warp_rank.glsl
CONTESTED_GROUPS = 16  # bytes into them
RINGS = 2  # of vertices around the source


class WarpPass(Pass):
    """Warp source textures of one size into one window.

    Compiles and allocates once, on construction: 8 bytes per window pixel and 8 per source
    pixel. A call makes 9 dispatches (7 where holes get no depth, two more
    where they get their rim),
    allocates nothing and reads nothing back. It ends with a memory barrier.

    Parameters
    ----------
    source_size : (width, height)
        Any size from 1x1.
    window : TargetWindow, optional
        What is shown, in the source's pixel grid; all of it by default.
    settings : WarpSettings
        Variant and thresholds.

    Raises
    ------
    InputError
        If source or window is larger than this driver's buffers.
    """

    def __init__(
        self,
        ctx: moderngl.Context,
        source_size: tuple[int, int],
        window: TargetWindow | None = None,
        settings: WarpSettings = WarpSettings(),  # noqa: B008 (frozen)
    ) -> None:
        self.window = window or TargetWindow(0, 0, *source_size)
        _check_fits(ctx, source_size, self.window)
        self.source_size = source_size
        self.settings = settings
        self._mesh = _mesh_size(source_size)
        lanes = SOFTWARE_LANES if describe(ctx).software else LANES
        constants: dict[str, Constant] = {
            "ALIKE_PX": settings.alike_px(self.window),
            "EXTEND": settings.variant == "full",
            "HIDE": settings.variant == "remove",
            "LANES": lanes,
            "MOST_GROUPS": MOST_GROUPS,
            "RIM_PX": settings.rim_px,
            "ROW": ROW,
            "SMALL": SMALL,
            "SMEAR": settings.variant == "smear",
            "SURFACE_PX": settings.surface_px,
            "TILE": TILE,
        }
        super().__init__(ctx, constants)
        self._small, self._classify, self._large, self._continue = (
            self._shader(f"warp/{name}.comp.glsl")
            for name in ("small", "classify", "large", "continue")
        )
        self._resolve, self._left = (
            self._shader("warp/resolve.comp.glsl", GROUP=group, LEFT=left)
            for group, left in ((ROW, False), (lanes, True))
        )
        self._rim = [
            self._shader("warp/rim.comp.glsl", CLEAR=clear)
            for clear in ((False, True) if settings.rim_px > 0 else ())
        ]
        width, height = self.window.width_px, self.window.height_px
        self._set(
            target_size=(width, height),
            target_origin=(self.window.x_px, self.window.y_px),
            stretch=settings.stretch_subpixels(self.window),
        )
        self._lists = self._buffer(_list_bytes(source_size, self.window))
        self._hold(
            ranks=self._buffer(bytes([NOTHING]) * (8 * width * height)),
            lists=self._lists,
            parts=self._buffer(4 * math.prod(self._mesh)),
        )

    def __call__(
        self,
        colour: moderngl.Texture,
        depth_m: moderngl.Texture,
        flow_px: moderngl.Texture,
        warped: FrameTextures,
    ) -> None:
        """Warp `colour`, seen at `depth_m` by the target, along `flow_px` into `warped`.

        Parameters
        ----------
        colour : texture of the source's size, rgba32f
            Encoded R'G'B' in [0, 1]; alpha is not read.
        depth_m : texture of the source's size, r32f
            Depth of each source pixel in the target's view; <= 0 is behind it.
        flow_px : texture of the source's size, rg32f
            Target minus source position; finite.
        warped : FrameTextures of the window's size
            Overwritten.
        """
        self._play(self._warp, colour, depth_m, flow_px, warped)

    def _warp(
        self,
        colour: moderngl.Texture,
        depth_m: moderngl.Texture,
        flow_px: moderngl.Texture,
        warped: FrameTextures,
    ) -> None:
        self._check(colour, depth_m, flow_px, warped)
        motion = {"depth_m": depth_m, "flow_px": flow_px}
        ask(partial(self._lists.write, COUNTERS))
        self._set(round_index=0)
        self._small.run_over(self._mesh, **motion)
        self._classify.run(GROUPS, **motion)
        self._large.run(GROUPS, **motion)
        self._set(round_index=1)
        self._small.run_indirect(self._lists, CONTESTED_GROUPS, **motion)
        self._large.run(GROUPS, **motion)
        size = self.window.width_px, self.window.height_px
        result = {"warped_colour": warped.colour, "warped_flow_px": warped.flow_px}
        depth = {"warped_depth_m": warped.depth_m}
        self._resolve.run_over(size, colour=colour, **motion, **result, **depth)
        self._left.run(GROUPS, colour=colour, **motion, **result, **depth)
        if self.settings.variant == "full":
            for along, lines, fallback in (((1, 0), size[1], 0.0), ((0, 1), size[0], np.inf)):
                self._continue["along"] = along
                self._continue["fallback"] = fallback
                self._continue.run_over((lines, 1), warped_flow_px=warped.flow_px, **depth)
        for shader in self._rim:
            shader.run_over(size, **result)

    def _check(
        self,
        colour: moderngl.Texture,
        depth_m: moderngl.Texture,
        flow_px: moderngl.Texture,
        warped: FrameTextures,
    ) -> None:
        shown = (self.window.width_px, self.window.height_px)
        for name, texture, size, format_name in (
            ("colour", colour, self.source_size, "rgba32f"),
            ("depth_m", depth_m, self.source_size, "r32f"),
            ("flow_px", flow_px, self.source_size, "rg32f"),
            ("warped.colour", warped.colour, shown, "rgba32f"),
            ("warped.depth_m", warped.depth_m, shown, "r32f"),
            ("warped.flow_px", warped.flow_px, shown, "rg32f"),
        ):
            found = format_of(texture).name
            if texture.size != size or found != format_name:
                raise InputError(
                    f"{name} must be {format_name} of {size[0]}x{size[1]} for this pass"
                    f" (got {found} of {texture.width}x{texture.height})"
                )


def warp_frame(
    frame: SourceFrame,
    flow_px: NDArray[np.float32],
    *,
    target_depth_m: NDArray[np.float32] | None = None,
    window: TargetWindow | None = None,
    settings: WarpSettings = WarpSettings(),  # noqa: B008 (frozen)
    ctx: moderngl.Context | None = None,
) -> WarpedFrame:
    """Show `frame` as the target view sees it. For many frames build a `WarpPass`.

    Parameters
    ----------
    frame : SourceFrame of size (H, W)
        Colour and depth.
    flow_px : ndarray of float32, shape (H, W, 2)
        Target minus source position, x then y; finite. `camera.flow_between` computes it.
    target_depth_m : ndarray of float32, shape (H, W), optional
        Depth of each source pixel as the target camera sees it, where the camera moves along
        its axis; not positive behind it. By default the source's depth.
    window : TargetWindow, optional
        What is shown, in the source's pixel grid; all of it by default.
    settings : WarpSettings
        Variant and thresholds.
    ctx : moderngl.Context, optional
        Work on the GPU; without it numpy does.

    Raises
    ------
    InputError
        If sizes or types differ, the flow is not finite, or `target_depth_m` is NaN.
    """
    if ctx is None:
        return reference.warp(
            frame, flow_px, target_depth_m=target_depth_m, window=window, settings=settings
        )
    flow_px, depth_m = checked_motion(frame, flow_px, target_depth_m, settings)
    height, width = frame.size
    padded = np.concatenate([frame.colour, np.ones((height, width, 1), np.float32)], axis=-1)
    warp = WarpPass(ctx, (width, height), window, settings)
    sources = (
        texture_from(ctx, padded, "rgba32f"),
        texture_from(ctx, depth_m, "r32f"),
        texture_from(ctx, flow_px, "rg32f"),
    )
    warped = FrameTextures.create(ctx, (warp.window.width_px, warp.window.height_px))
    try:
        warp(*sources, warped)
        return warped.read_back()
    finally:
        for resource in (*sources, warped, warp):
            resource.release()


def _mesh_size(source_size: tuple[int, int]) -> tuple[int, int]:
    return source_size[0] + 2 * RINGS - 1, source_size[1] + 2 * RINGS - 1


def _list_bytes(source_size: tuple[int, int], window: TargetWindow) -> int:
    """Room for every quad, or for every pixel: overflow cannot happen."""
    return len(COUNTERS) + 4 * max(
        math.prod(_mesh_size(source_size)), window.width_px * window.height_px
    )


def _check_fits(ctx: moderngl.Context, source_size: tuple[int, int], window: TargetWindow) -> None:
    limit = int(ctx.info["GL_MAX_SHADER_STORAGE_BLOCK_SIZE"])
    limit = min(limit, 4 * MOST_QUADS)  # a part's number stands above its quad's
    ranks_bytes = 8 * window.width_px * window.height_px
    if max(_list_bytes(source_size, window), ranks_bytes) > limit:
        raise InputError(
            f"source and window must fit the warp's shader buffers of {limit} bytes: 4 for"
            f" each pixel of the source, 8 of the window (got {source_size[0]}x{source_size[1]}"
            f" and {window.width_px}x{window.height_px}); use smaller images"
        )


class CompletePass(Pass):
    """Take from a second warped picture what is a hole in the first. One dispatch."""

    def __init__(self, ctx: moderngl.Context) -> None:
        super().__init__(ctx)
        self._complete = self._shader("warp/complete.comp.glsl", TILE=8)

    def __call__(self, first: FrameTextures, second: FrameTextures) -> None:
        """Complete `first` in place; both have one size."""
        self._play(self._take, first, second)

    def _take(self, first: FrameTextures, second: FrameTextures) -> None:
        self._complete.run_over(
            first.size,
            colour=first.colour,
            depth_m=first.depth_m,
            flow_px=first.flow_px,
            second_colour=second.colour,
            second_depth_m=second.depth_m,
            second_flow_px=second.flow_px,
        )
