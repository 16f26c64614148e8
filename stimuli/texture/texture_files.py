"""Textures to baked files, and scenes to sheets: `metamerlab texture`."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import moderngl
import numpy as np
from numpy.typing import NDArray

from pipeline.errors import InputError
from pipeline.foveation.catalogue import Metamer
from pipeline.foveation.conditions import create_condition
from pipeline.foveation.pooling import MetamerSettings
from pipeline.frame import AnyArray
from pipeline.pictures import drawing
from pipeline.pictures.decode import read_pixels, three_channels
from pipeline.pictures.header import check_fits
from pipeline.textures.bake import MOMENT_BYTES, BakedTexture, Layout, bake, strips
from pipeline.textures.baked_file import read_baked, write_baked
from pipeline.textures.footprints import COLOUR_BYTES, saved, touched
from protocols.disk.whole_file import whole_file
from stimuli.foveate.condition_sheet import draw_gaze
from stimuli.media.frames_folder import SILENT, Reporter
from stimuli.media.gaze_and_display import AS_ASSUMED, StatedViewing, gaze_words, read_gaze
from stimuli.media.moving import save_moving
from stimuli.texture.draw_globes import GLOBE_CONDITIONS, TexturedRenderer
from stimuli.texture.scenes import TexturedScene, open_textured_scene, planet_map

PLANET_PX = 1024
"""Height of the map that scenes show unless another is given."""
TURN_FRAMES, TURN_STEP_DEG, TURN_FRAME_MS = 36, 1.0, 60

_WORDS = {
    "reference": "reference",
    "blur": "foveated blur",
    "metamer": "ours: noise of what is lost",
}


def bake_file(
    source: Path, out: Path, *, wraps: bool = False, reporter: Reporter = SILENT
) -> Layout:
    """Bake a texture file, a few rows at a time.

    Parameters
    ----------
    source : Path
        A picture of 8 or 16 bits a channel, encoded R'G'B' or grey.
    out : Path
        The file to write, `ENDING`; replaced if it is there.
    wraps : bool
        Its right border goes on at its left one.

    Raises
    ------
    InputError, OSError
        Before anything is written.
    """
    tell = reporter.say
    check_fits(source, "texture bake")
    texture = three_channels(source, read_pixels(source))
    if texture.dtype.kind != "u":
        raise InputError(
            f"{source}: must hold 8 or 16 bits a channel, encoded for a display (holds"
            f" {texture.dtype}); convert it first, with 'metamerlab foveate' for one"
        )
    height, width = texture.shape[:2]
    try:
        layout = Layout(width, height, wraps)
    except InputError as error:
        raise InputError(f"{source}: {error}") from None
    if texture.dtype.itemsize > 1:
        tell("note: 16 bits a channel are rounded to 8")
    with whole_file(out) as file:
        write_baked(file, layout, _eight_bits(texture))
        size = file.seek(0, 2)
    round_words = ", goes round" if wraps else ""
    tell(
        f"wrote {out}: {width} x {height} px{round_words}, {layout.halvings} levels of moments,"
        f" {size / 1e6:.1f} MB ({size / (width * height):.1f} bytes a texel)"
    )
    return layout


def _eight_bits(texture: AnyArray) -> Iterator[NDArray[np.uint8]]:
    largest = int(np.iinfo(texture.dtype).max)
    for rows in strips(texture):
        yield rows if largest == 255 else np.rint(rows * (255 / largest)).astype(np.uint8)


def open_texture(baked: Path | None) -> BakedTexture:
    """Read a baked file; without one bake our planet's map."""
    return bake(planet_map(PLANET_PX), wraps=True) if baked is None else read_baked(baked)


def metamer_settings(parameters: dict[str, Any]) -> MetamerSettings:
    """Settings by the parameters of the condition ``metamer``, as far as textures have them.

    Raises
    ------
    InputError
        If one is unknown or out of range.
    """
    made = create_condition("metamer", parameters)
    assert isinstance(made, Metamer)
    if made.settings.chroma != "follow" or made.settings.residual != "kept":
        raise InputError(
            "a baked texture has moments for chroma=follow and residual=kept; leave these out"
        )
    return made.settings


@dataclass(frozen=True)
class SceneSettings:
    """Texture, size and turn of a scene that is drawn.

    Parameters
    ----------
    baked : Path, optional
        A texture that `bake_file` made; by default our planet's map.
    size_px : int
        Edge of the square pictures.
    turn_deg : float
        All globes turned by so much.
    animate : Path, optional
        A moving picture (.webp or .png) of the turning globes.
    """

    baked: Path | None = None
    size_px: int = 768
    turn_deg: float = 0.0
    animate: Path | None = None


def show_scene(
    name: str,
    out: Path,
    ctx: moderngl.Context,
    *,
    asked: SceneSettings = SceneSettings(),
    viewing: StatedViewing = AS_ASSUMED,
    settings: MetamerSettings | None = None,
    seed: int = 0,
    reporter: Reporter = SILENT,
) -> None:
    """Draw a scene as it is, with a foveated blur, and with noise of what that lost, on one sheet.

    Parameters
    ----------
    name : str
        One of `scenes.SCENES`.
    out : Path
        The sheet, .png or .jpg.
    asked : SceneSettings
        What is drawn.
    viewing : StatedViewing
        Without a gaze the eye rests where the scene says.

    Raises
    ------
    InputError, StudyError, OSError, GLUnavailableError
        Before anything is written.
    """
    tell, settings = reporter.say, settings or MetamerSettings()
    size_px, turn_deg = asked.size_px, asked.turn_deg
    scene = open_textured_scene(name)
    looking = viewing.of((size_px, size_px))
    x, y = (size_px * share for share in scene.gaze_share)
    gaze_px = (x, y) if viewing.gaze is None else read_gaze(viewing.gaze, looking.geometry)
    texture = open_texture(asked.baked)
    layout = texture.layout
    tell(f"{scene.name}: {scene.what}; texture of {layout.width} x {layout.height} px")
    tell(looking.words)
    tell(gaze_words(gaze_px, looking.geometry))
    tell(f"pooling: {settings.pooling}")
    renderer = TexturedRenderer(ctx, texture, looking.geometry, settings, seed=seed)  # type: ignore[arg-type]
    try:
        tiles = []
        for condition in GLOBE_CONDITIONS:
            shown = renderer.picture(scene, condition, gaze_px, turn_deg=turn_deg)
            tiles.append(
                (_WORDS[condition], draw_gaze(drawing.of_colour(shown), gaze_px, size_px / 90))
            )
        share = saved_share(renderer, layout, scene, gaze_px, turn_deg=turn_deg)
        if asked.animate is not None:
            frames = [
                drawing.of_colour(renderer.picture(scene, "metamer", gaze_px, turn_deg=turn))
                for turn in turn_deg + TURN_STEP_DEG * np.arange(TURN_FRAMES)
            ]
            save_moving(asked.animate, frames, TURN_FRAME_MS)
            tell(f"wrote {asked.animate}")
    finally:
        renderer.release()
    drawing.save_picture(out, drawing.sheet(tiles, len(tiles)))
    tell(
        f"texture read: {100 * share:.0f} % fewer bytes than unfoveated (distinct texels,"
        f" {COLOUR_BYTES} bytes of colour, {MOMENT_BYTES} of moments a level)"
    )
    tell(f"wrote {out}")


def saved_share(
    renderer: TexturedRenderer,
    layout: Layout,
    scene: TexturedScene,
    gaze_px: tuple[float, float],
    *,
    turn_deg: float = 0.0,
) -> float:
    """Share of the texture's bytes that a foveated picture does not touch."""
    found = []
    for foveated in (True, False):
        fragments, shown = renderer.fragments(scene, gaze_px, foveated=foveated, turn_deg=turn_deg)
        found.append(touched(layout, fragments.where(shown), noise=foveated))
    return saved(*(one.bytes_of_texels(MOMENT_BYTES) for one in found))
