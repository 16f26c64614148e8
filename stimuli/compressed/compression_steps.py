"""Parts of a compressed picture, as pictures to look at.

Beyond Blur, Fig. 9 (the picture in polar cells, the maps, and what is made of them) and Fig. 10
(how dense the cells are, and how many each level has).
"""

from __future__ import annotations

import io
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from pipeline.compression import image_codecs
from pipeline.compression.codec import decoded_base, decoded_cells, decompress
from pipeline.compression.compressed_file import CompressedPicture, atlas_shape
from pipeline.compression.grid import PolarGrid
from stimuli import pictures
from stimuli.pictures import Picture

_MAP_COLOURS = ("#67000d", "#b11218", "#e32f27", "#f6583e", "#fc8a6a")
_PICTURE_COLOUR = "#0072B2"


def write_steps(
    folder: Path, picture: NDArray[np.float32], held: CompressedPicture, *, seed: int = 0
) -> list[Path]:
    """Write the first frame's parts as `pictures.save_steps` does, and return what it returns.

    Parameters
    ----------
    picture : ndarray of shape (H, W, 3)
        What was compressed, encoded R'G'B' in [0, 1].
    seed : int
        Of the noise in what is shown.
    """
    grids, base = held.map_grids(), held.bases[0]
    steps = [
        ("picture", "picture", pictures.of_colour(picture)),
        (
            "cells",
            "colour in polar cells: rows are angles, columns distances from the gaze",
            decoded_cells(base, held.grid, held.codec),
        ),
    ]
    if grids:
        atlas = image_codecs.decode(
            held.statistics[0].atlas, held.codec, atlas_shape(grids), "the maps in it"
        )
        label = "maps, level by level: rows are luma's deviation in 3 bands, slopes of Cb and Cr"
        steps.append(("maps", label, np.repeat(atlas[..., None], 3, axis=2)))
    steps += [
        ("density", "density, its integral, and cells", density_picture(held.grid, grids)),
        ("base", "colour alone", pictures.of_colour(decoded_base(base, held.grid, held.codec))),
        ("shown", f"with noise, seed {seed}", pictures.of_colour(decompress(held, seed=seed))),
    ]
    height = max(picture.shape[0], 240)
    size = (height, max(picture.shape[1], height))
    return pictures.save_steps(folder, steps, size, columns=3)


def density_picture(base: PolarGrid, maps: list[PolarGrid]) -> Picture:
    """Draw Fig. 10: columns per pixel, their share up to a distance, and each level's cells."""
    from stimuli.score.plots import figure_style, new_figure, png_bytes

    grids = [base, *maps]
    names = ["colour", *(f"map {level}" for level in range(len(maps)))]
    colours = [_PICTURE_COLOUR, *_MAP_COLOURS]
    radius_px = np.linspace(0, base.farthest_px, 600)
    with figure_style():
        figure = new_figure(7.6, 5.0)
        along, whole, counts = figure.subplot_mosaic([["a", "b"], ["c", "c"]]).values()
        for grid, name, colour in zip(grids, names, colours, strict=False):
            columns = np.maximum(grid.density.columns(radius_px), 0)
            along.plot(radius_px, grid.density.per_px(radius_px), color=colour, label=name)
            whole.plot(radius_px, columns / columns[-1], color=colour)
        along.axhline(1, color="black", linestyle=":", label="a plain file")
        whole.plot(radius_px, radius_px / radius_px[-1], ":", color="black")
        along.set(yscale="log", ylim=(0.005, 1.5), ylabel="columns per pixel")
        whole.set(ylabel="share of columns up to there")
        for axes in (along, whole):
            axes.set_xlabel("distance from the gaze, px")
        cells = [grid.shape[0] * grid.shape[1] for grid in grids]
        bars = counts.barh(names, cells, color=colours[: len(grids)])
        counts.bar_label(bars, [f" {count / sum(cells):.1%}" for count in cells])
        counts.invert_yaxis()
        counts.set(xlabel="cells")
        counts.margins(x=0.1)
        figure.legend(loc="outside upper center", ncols=4)
        with Image.open(io.BytesIO(png_bytes(figure))) as drawn:
            return np.asarray(drawn.convert("RGB"))
