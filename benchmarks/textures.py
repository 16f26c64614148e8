"""Bytes of a texture that foveation saves: `script/bench textures --help`.

A quad that fills the picture, and the planet of `metamerlab texture show`; textures of 8192 texels,
pictures of 512 and 4096 pixels a side, 40 degrees wide. For each pooling law, and with pools of at
most so many halvings of a pixel: one less the bytes of distinct texels (and of the memory lines
that hold them) that the picture touches, over those that it touches unfoveated. For several numbers
of bytes that moments may take: our file has 16 a level and texel. Beyond Blur reports 52 and 79 %.
"""

from __future__ import annotations

import argparse
import dataclasses
from collections.abc import Iterator

import numpy as np
from rich.console import Console
from rich.table import Table
from scipy.interpolate import griddata

from benchmarks.shared.output import conditions, file_to_write, write_record
from pipeline.foveation.geometry import Flat, FlatGeometry
from pipeline.foveation.pooling import MetamerSettings, Pools, make_pooling
from pipeline.gl.context import create_context, release_context
from pipeline.textures.bake import Layout, bake
from pipeline.textures.footprints import saved, touched
from pipeline.textures.reference import Fragments
from stimuli.texture.draw_globes import TexturedRenderer
from stimuli.texture.scenes import SCENES, WIDTH_DEG
from stimuli.texture.texture_files import open_texture

TEXTURE_PX = 8192
SMALL_PX = 64  # of the map that is drawn in its place: only its coordinates matter
SIZES_PX = (512, 4096)
LAWS = ("v1", "v2", "authors")
CAPS = (5, 2)
BYTES = (16, 8, 4)
TURNING_PX, TURNS_DEG = 256, (0.5, 2.0, 8.0)
PAPER = {512: 0.52, 4096: 0.79}

View = tuple[str, Layout, Fragments]
"""A scene's name, its texture, and what is drawn of it, with no cap of pools."""


def main(argv: list[str]) -> int:
    """Count, print a table, write JSON."""
    parser = argparse.ArgumentParser(prog="script/bench textures", description=__doc__)
    parser.add_argument("--sizes", type=int, nargs="+", default=SIZES_PX, metavar="PX")
    parser.add_argument("--laws", nargs="+", default=LAWS)
    parser.add_argument("--json", type=file_to_write)
    parser.add_argument(
        "--turn", action="store_true", help="only: does noise stay on a planet that turns?"
    )
    arguments = parser.parse_args(argv)
    if arguments.turn:
        _print_turning()
        return 0
    found = []
    for size_px in arguments.sizes:
        whole: dict[str, dict[str, int]] = {}
        for law in arguments.laws:
            for name, layout, fragments in _views(size_px, law):
                if name not in whole:
                    bare = Fragments(fragments.place_px, fragments.rho, 0 * fragments.eta)
                    seen = touched(layout, bare, noise=False)
                    whole[name] = {
                        "texels": seen.bytes_of_texels(16), "lines": seen.bytes_of_lines(16)
                    }  # fmt: skip
                found += [
                    _row(name, size_px, law, cap, layout, fragments, whole[name]) for cap in CAPS
                ]
    Console(width=120).print(_table(found))
    if arguments.json is not None:
        record = {
            "machine": conditions("numpy", "moderngl"),
            "texture_px": TEXTURE_PX,
            "width_deg": WIDTH_DEG,
            "paper": {str(size): share for size, share in PAPER.items()},
            "results": found,
        }
        write_record(arguments.json, record)
    return 0


def _row(
    name: str,
    size_px: int,
    law: str,
    cap: int,
    layout: Layout,
    fragments: Fragments,
    whole: dict[str, int],
) -> dict[str, object]:
    capped = Fragments(fragments.place_px, fragments.rho, np.minimum(fragments.eta, cap))
    seen = touched(layout, capped, noise=True)
    row: dict[str, object] = {"scene": name, "size_px": size_px, "law": law, "most_lod": cap}
    for count in BYTES:
        row[f"texels_{count}"] = saved(seen.bytes_of_texels(count), whole["texels"])
        row[f"lines_{count}"] = saved(seen.bytes_of_lines(count), whole["lines"])
    return row


def _views(size_px: int, law: str) -> Iterator[View]:
    geometry = Flat(WIDTH_DEG).of(size_px, size_px)
    yield "quad", *_quad(geometry, law)
    yield "planet", *_planet(geometry, law)


def _quad(geometry: FlatGeometry, law: str) -> tuple[Layout, Fragments]:
    size_px = geometry.width_px
    step = TEXTURE_PX / size_px
    y, x = np.mgrid[:size_px, :size_px].astype(np.float32) + np.float32(0.5)
    place = np.float32(step) * np.stack([x, y], axis=-1)
    pools = Pools(geometry, (size_px / 2, size_px / 2), make_pooling(law))
    eta = pools.lod().astype(np.float32)
    rho = np.full(eta.shape, np.log2(step), np.float32)
    return Layout(TEXTURE_PX, TEXTURE_PX), Fragments(place, rho, eta)  # type: ignore[arg-type]


def _planet(geometry: FlatGeometry, law: str) -> tuple[Layout, Fragments]:
    ctx = create_context()
    small = bake(np.zeros((SMALL_PX // 2, SMALL_PX, 3), np.uint8), wraps=True)
    settings = MetamerSettings(make_pooling(law), levels=6)
    renderer = TexturedRenderer(ctx, small, geometry, settings)
    scene = SCENES["planet"]
    gaze_px = tuple(geometry.width_px * share for share in scene.gaze_share)
    drawn, shown = renderer.fragments(scene, (gaze_px[0], gaze_px[1]), foveated=True)
    renderer.release()
    release_context(ctx)
    larger = TEXTURE_PX // SMALL_PX
    drawn = drawn.where(shown)
    scaled = Fragments(drawn.place_px * larger, drawn.rho + np.log2(larger), drawn.eta)
    return Layout(TEXTURE_PX, TEXTURE_PX // 2, wraps=True), scaled


def _print_turning() -> None:
    """Correlate the noise of two frames: at the same places of the surface, at the same pixels."""
    ctx = create_context()
    geometry = Flat(WIDTH_DEG).of(TURNING_PX, TURNING_PX)
    renderer = TexturedRenderer(ctx, open_texture(None), geometry, MetamerSettings())
    dark = dataclasses.replace(SCENES["planet"], light=(0.0, 0.0, 0.0))
    gaze_px = TURNING_PX * dark.gaze_share[0], TURNING_PX * dark.gaze_share[1]
    seen = []
    for turn_deg in (0.0, *TURNS_DEG):
        fragments, shown = renderer.fragments(dark, gaze_px, foveated=True, turn_deg=turn_deg)
        metamer, blur = (
            renderer.picture(dark, condition, gaze_px, turn_deg=turn_deg)
            for condition in ("metamer", "blur")
        )
        seen.append((fragments.place_px, (metamer - blur)[..., 1], shown & (fragments.rho < 3)))
    renderer.release()
    release_context(ctx)
    place, noise, there = seen[0]
    table = Table("turned by, degrees", "noise at the same place", "at the same pixel")
    for turn_deg, (other_place, other_noise, also) in zip(TURNS_DEG, seen[1:], strict=True):
        carried = griddata(place[there], noise[there], other_place[also], method="cubic")
        both = np.isfinite(carried)
        on_surface = np.corrcoef(carried[both], other_noise[also][both])[0, 1]
        same = there & also
        on_screen = np.corrcoef(noise[same], other_noise[same])[0, 1]
        table.add_row(f"{turn_deg:g}", f"{on_surface:.2f}", f"{on_screen:.2f}")
    Console().print(table)


def _table(found: list[dict[str, object]]) -> Table:
    table = Table("scene", "picture", "law", "LOD at most", title="bytes saved, texels (lines)")
    for count in BYTES:
        table.add_column(f"{count} bytes a level", justify="right")
    table.add_column("paper")
    for row in found:
        shares = [f"{row[f'texels_{c}']:.2f} ({row[f'lines_{c}']:.2f})" for c in BYTES]
        size_px = int(str(row["size_px"]))
        paper = f"{PAPER[size_px]:.2f}" if size_px in PAPER else "-"
        table.add_row(
            str(row["scene"]), f"{size_px}²", str(row["law"]), str(row["most_lod"]), *shares, paper
        )
    return table
