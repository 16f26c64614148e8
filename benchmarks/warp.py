"""Time of the warp against a plain copy of its frame: `python -m benchmarks.warp [EDGE ...]`."""

from __future__ import annotations

import sys
from dataclasses import dataclass

import moderngl
import numpy as np

from benchmarks.shared.copying import Copy
from benchmarks.shared.dispatches import dispatches_of
from pipeline.frame import SourceFrame
from pipeline.frame_textures import FrameTextures
from pipeline.gl.context import create_context, describe, release_context
from pipeline.gl.texture import create_texture, texture_from
from pipeline.gl.timer import measure
from pipeline.warp.gpu import WarpPass

EDGES = (512, 1024, 2048)


@dataclass(frozen=True)
class WarpTiming:
    """One size's result."""

    edge_px: int
    warp_ms: float
    copy_ms: float
    hole_share: float
    bytes_per_pixel: float  # that the pass holds, beyond input and output
    dispatches: int


def discs_over_ground(edge_px: int) -> tuple[SourceFrame, np.ndarray]:
    """Twelve discs over a receding ground, and the motion under a step to the side."""
    rng = np.random.default_rng(1)
    y, x = np.mgrid[:edge_px, :edge_px] + 0.5
    depth_m = 6 - 3 * y / edge_px
    for centre_x, centre_y, size in rng.random((12, 3)) * (edge_px, edge_px, 0.1 * edge_px):
        depth_m[(x - centre_x) ** 2 + (y - centre_y) ** 2 < size**2] = 1.5 + rng.random()
    flow_px = 0.04 * edge_px / depth_m[..., None] * (1, 0.3)
    colour = rng.random((edge_px, edge_px, 3), np.float32)
    return SourceFrame(colour, depth_m.astype(np.float32)), flow_px.astype(np.float32)


def time_warp(ctx: moderngl.Context, edge_px: int, *, repeats: int = 9) -> WarpTiming:
    """Time the warp and a copy of the same frame, in turn."""
    frame, flow_px = discs_over_ground(edge_px)
    size = (edge_px, edge_px)
    sources = (
        texture_from(ctx, np.dstack([frame.colour, frame.depth_m]), "rgba32f"),
        texture_from(ctx, frame.depth_m, "r32f"),
        texture_from(ctx, flow_px, "rg32f"),
    )
    warp, warped = WarpPass(ctx, size), FrameTextures.create(ctx, size)
    formats = ("rgba32f", "r32f", "rg32f")
    copied = tuple(create_texture(ctx, size, name) for name in formats)
    copy = Copy(ctx, *formats)
    pairs = tuple(zip(sources, copied, strict=True))
    copy_ms = measure(ctx, lambda: copy(*pairs), repeats=repeats).median_ms
    warp_ms = measure(ctx, lambda: warp(*sources, warped), repeats=repeats).median_ms
    result = WarpTiming(
        edge_px=edge_px,
        warp_ms=warp_ms,
        copy_ms=copy_ms,
        hole_share=float(warped.read_back().hole.mean()),
        bytes_per_pixel=warp.held_bytes / edge_px**2,
        dispatches=len(dispatches_of(lambda: warp(*sources, warped))),
    )
    for texture in (*sources, *copied):
        texture.release()
    for held in (warp, warped, copy):
        held.release()
    return result


def main(argv: list[str]) -> int:
    """Print a table; `argv` holds edges, pixels."""
    edges = [int(argument) for argument in argv] or list(EDGES)
    ctx = create_context()
    print(describe(ctx))
    print("edge px   warp ms   copy ms   warp/copy   holes %   B/px held   dispatches")
    for edge in edges:
        t = time_warp(ctx, edge)
        print(
            f"{t.edge_px:7d} {t.warp_ms:9.2f} {t.copy_ms:9.2f} {t.warp_ms / t.copy_ms:11.1f}"
            f" {100 * t.hole_share:9.1f} {t.bytes_per_pixel:11.1f} {t.dispatches:12d}"
        )
    release_context(ctx)
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
