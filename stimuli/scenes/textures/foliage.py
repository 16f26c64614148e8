"""Leaves and grass, drawn and not photographed, and textures of ground and sky."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw
from scipy import ndimage

from stimuli.scenes.textures.surface_noise_and_photographs import (
    SIZE_PX,
    ByteTexture,
    Plane,
    Rgb,
    finish,
    fractal,
    photograph,
    ramp,
    shaded,
)


def leaves(
    rng: np.random.Generator,
    count: int = 120,
    length_px: tuple[int, int] = (90, 150),
    colours: Sequence[Rgb] | None = None,
    *,
    size: int = SIZE_PX,
    slender: float = 0.42,
) -> ByteTexture:
    """A spray of leaves on nothing: for cut-out cards. It does not repeat: edges stay empty."""
    tones = colours or [(52, 84, 26), (74, 108, 36), (96, 126, 48), (118, 142, 62)]
    colour, mask = scatter(
        rng, size, count, length_px, tones, wrap=False, slender=slender, towards_centre=True
    )
    return finish(colour, mask)


def blades(
    rng: np.random.Generator,
    count: int = 46,
    colours: Sequence[Rgb] | None = None,
    *,
    heads: Rgb | None = None,
    size: int = 512,
) -> ByteTexture:
    """A tuft of grass or reed that stands on the edge v = 0; `heads` adds flowers."""
    tones = np.asarray(colours or [(58, 80, 26), (92, 112, 42), (130, 140, 66), (150, 146, 84)])
    scale = 2
    image = Image.new("RGBA", (size * scale, size * scale))
    draw = ImageDraw.Draw(image)
    for _ in range(count):
        foot = rng.uniform(0.3, 0.7)
        lean = rng.normal(0, 0.16) + 0.6 * (foot - 0.5)
        height = rng.uniform(0.45, 0.97)
        bow = rng.normal(0, 0.12)
        t = np.linspace(0, 1, 16)
        x = foot + lean * t + bow * t**2
        y = height * t * (1 - 0.12 * abs(bow) * t)
        half = 0.007 * rng.uniform(0.6, 1.4) * (1 - t) + 0.0012
        tone = tones[rng.integers(len(tones))] * rng.uniform(0.75, 1.15)
        outline = np.concatenate([np.stack([x - half, y], 1), np.stack([x + half, y], 1)[::-1]])
        fill = (*np.clip(tone, 0, 255).astype(int).tolist(), 255)
        draw.polygon([(px * size * scale, py * size * scale) for px, py in outline], fill=fill)
        if heads is not None and rng.random() < 0.4:
            radius = rng.uniform(0.02, 0.035)
            for petal in range(6):
                turn = petal * np.pi / 3
                px, py = x[-1] + radius * np.cos(turn), y[-1] + radius * np.sin(turn)
                petal_tone = np.asarray(heads) * rng.uniform(0.8, 1.1)
                box = [
                    (px - 0.7 * radius) * size * scale, (py - 0.7 * radius) * size * scale,
                    (px + 0.7 * radius) * size * scale, (py + 0.7 * radius) * size * scale,
                ]  # fmt: skip
                draw.ellipse(box, fill=(*np.clip(petal_tone, 0, 255).astype(int).tolist(), 255))
            core = [
                (x[-1] - 0.45 * radius) * size * scale, (y[-1] - 0.45 * radius) * size * scale,
                (x[-1] + 0.45 * radius) * size * scale, (y[-1] + 0.45 * radius) * size * scale,
            ]  # fmt: skip
            draw.ellipse(core, fill=(210, 170, 60, 255))
    small = np.asarray(image.resize((size, size), Image.Resampling.BOX), np.float64)
    return finish(small[..., :3], (small[..., 3] > 110).astype(np.float64))


def scatter(
    rng: np.random.Generator,
    size: int,
    count: int,
    length_px: tuple[int, int],
    tones: Sequence[Rgb],
    *,
    wrap: bool = True,
    slender: float = 0.42,
    towards_centre: bool = False,
) -> tuple[NDArray[np.float64], Plane]:
    """Leaves lying about, each with a midrib and a bright and a dark half."""
    image = Image.new("RGBA", (size, size))
    draw = ImageDraw.Draw(image)
    palette = np.asarray(tones, np.float64)
    t = np.linspace(0, 1, 13)
    profile = np.sin(np.pi * t**0.8) ** 0.9
    for _ in range(count):
        length = rng.uniform(*length_px)
        turn = rng.uniform(0, 2 * np.pi)
        if towards_centre:
            radius = 0.44 * size * np.sqrt(rng.uniform(0, 1)) - 0.3 * length
            where = rng.uniform(0, 2 * np.pi)
            x0 = size / 2 + max(radius, 0) * np.cos(where)
            y0 = size / 2 + max(radius, 0) * np.sin(where)
        else:
            x0, y0 = rng.uniform(0, size, 2)
        tone = palette[rng.integers(len(palette))] * rng.uniform(0.72, 1.18)
        bend = rng.normal(0, 0.12)
        along = np.stack([np.cos(turn) * t - np.sin(turn) * bend * t**2,
                          np.sin(turn) * t + np.cos(turn) * bend * t**2], 1)  # fmt: skip
        side = np.array([-np.sin(turn), np.cos(turn)])
        half = slender * rng.uniform(0.75, 1.1) / 2
        spine = along * length
        near = spine + np.outer(profile * half * length, side)
        far = spine - np.outer(profile * half * length, side)
        shifts = [(0.0, 0.0)]
        if wrap:  # those that reach into the picture
            shifts = [
                (dx, dy) for dx in (-size, 0, size) for dy in (-size, 0, size)
                if -2 * length < min(x0 + dx, y0 + dy)
                and max(x0 + dx, y0 + dy) < size + 2 * length
            ]  # fmt: skip
        for dx, dy in shifts:
            base = np.array([x0 + dx, y0 + dy])
            for outline, factor in ((near, 1.06), (far, 0.86)):
                fill = (*np.clip(tone * factor, 0, 255).astype(int).tolist(), 255)
                points = np.concatenate([base + outline, (base + spine)[::-1]])
                draw.polygon([tuple(point) for point in points.tolist()], fill=fill)
            rib = (*np.clip(tone * 1.25 + 8, 0, 255).astype(int).tolist(), 255)
            draw.line([tuple(p) for p in (base + spine).tolist()], fill=rib, width=2)
    pixels = np.moveaxis(np.moveaxis(np.asarray(image), -1, 0).astype(np.float64, "C"), 0, -1)
    grain = 1 + 0.07 * fractal(rng, size, 0.6, 16)
    return pixels[..., :3] * grain[..., None], pixels[..., 3] / 255


def lawn(rng: np.random.Generator, dry: float = 0.0) -> ByteTexture:
    """Short grass seen from above; `dry` in [0, 1] turns it yellow."""
    blades = photograph("grass")
    patches = fractal(rng, slope=1.6)
    value = np.clip(0.46 + 0.17 * blades + 0.05 * patches, 0, 1)
    green = ramp(value, [(22, 32, 10), (62, 84, 28), (104, 128, 48), (160, 172, 92)])
    straw = ramp(value, [(42, 34, 16), (112, 98, 48), (164, 148, 84), (214, 202, 150)])
    share = np.clip(dry + 0.22 * patches + 0.08 * fractal(rng, slope=0.8), 0, 1)[..., None]
    return finish(green * (1 - share) + straw * share)


def pebbles(rng: np.random.Generator, colours: Sequence[Rgb] | None = None) -> ByteTexture:
    """Gravel."""
    stones = photograph("gravel")
    value = np.clip(0.45 + 0.19 * stones + 0.04 * fractal(rng), 0, 1)
    base = ramp(value, colours or [(28, 24, 20), (98, 90, 80), (150, 141, 128), (226, 220, 210)])
    return finish(base + shaded((1.0, 0.3, -0.8), 9 * fractal(rng, slope=0.9)))


def earth(rng: np.random.Generator) -> ByteTexture:
    """Forest floor: soil, needles, and dead leaves."""
    fine = photograph("grass") * 0.6 + fractal(rng, slope=0.7) * 0.6
    value = np.clip(0.42 + 0.17 * fine, 0, 1)
    colour = ramp(value, [(20, 14, 8), (66, 48, 30), (108, 82, 52), (160, 132, 90)])
    litter, mask = scatter(
        rng, SIZE_PX, 900, (14, 26), [(128, 82, 40), (150, 104, 54), (96, 62, 32), (168, 130, 72)]
    )
    colour = np.where(mask[..., None] > 0.5, litter, colour)
    moss = 0.6 * np.clip(fractal(rng, slope=1.5) - 0.7, 0, 1)
    return finish(colour * (1 - moss)[..., None] + shaded((64.0, 84.0, 30.0), moss))


def panorama(
    rng: np.random.Generator,
    zenith: Rgb = (82, 128, 190),
    horizon: Rgb = (196, 212, 226),
    cloud: Rgb = (246, 246, 244),
    cover: float = 0.45,
) -> NDArray[np.uint8]:
    """A sky with clouds, longitude x latitude, shape (1024, 2048, 3)."""
    height, width = 1024, 2048
    y = (np.arange(height) + 0.5) / height
    up = np.clip(np.cos(np.pi * y), 0, 1)
    clear = np.asarray(horizon) + np.subtract(zenith, horizon) * up[:, None] ** 0.55
    sky = np.repeat(np.rint(clear.clip(0, 255)).astype(np.uint8)[:, None], width, axis=1)
    # Clouds lie on a level sheet: they crowd towards the horizon, and end above it.
    up = up[up > 0.07, None]
    turn = 2 * np.pi * (np.arange(width) + 0.5)[None, :] / width
    reach = np.sqrt(1 - up**2) / up
    sheet = fractal(rng, 1024, 1.55)
    place = [(reach * np.sin(turn)) * 110 % 1024, (reach * np.cos(turn)) * 110 % 1024]
    dense = ndimage.map_coordinates(sheet, place, order=1, mode="grid-wrap")
    thick = np.clip((dense + 2.2 * cover - 1.0) / 1.1, 0, 1) ** 0.8
    thick *= np.clip((up - 0.07) * 7, 0, 1)
    shade = thick * np.clip(1.02 - 0.16 * thick + 0.05 * dense, 0, 1.05)
    for channel, tone in enumerate(cloud):
        colour = clear[: len(up), None, channel] * (1 - thick) + tone * shade
        sky[: len(up), :, channel] = np.rint(colour.clip(0, 255))
    return sky
