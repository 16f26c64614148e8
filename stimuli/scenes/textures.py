"""Surfaces for the built-in scenes: photographs that come with scikit-image, and noise.

Every texture repeats without a seam, is uint8 of shape (N, N, 4) in encoded R'G'B' with
coverage, and is a pure function of the generator it is given.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw
from scipy import fft, ndimage

Plane = NDArray[np.float64]
Colour = tuple[float, float, float]
Texture = NDArray[np.uint8]

SIZE_PX = 1024


def fractal(
    rng: np.random.Generator, size: int = SIZE_PX, slope: float = 1.2, coarsest: float = 2.0
) -> Plane:
    """Noise whose amplitude falls as frequency ** -slope; zero mean, unit variance, periodic.

    Waves longer than ``size / coarsest`` are left out, so that repeats do not show.
    """
    return _noise(rng, size, slope, coarsest, 1.0)


def photograph(name: str, size: int = SIZE_PX) -> Plane:
    """One of scikit-image's grey photographs, made to repeat; zero mean, unit variance.

    Uneven light is taken out. The seam is hidden by fading into the picture shifted by
    half, as stones or blades end anywhere.
    """
    from skimage import data

    grey = np.asarray(getattr(data, name)(), np.float64)[:512, :512]
    grey = grey - ndimage.gaussian_filter(grey, 48, mode="reflect")
    shifted = np.roll(grey, (256, 256), (0, 1))
    ramp = np.minimum(np.arange(512), 511 - np.arange(512)) / 48.0
    weight = np.clip(np.minimum(ramp[:, None], ramp[None, :]), 0, 1)
    mixed = weight * grey + (1 - weight) * shifted
    mixed /= np.sqrt(weight**2 + (1 - weight) ** 2)  # two pictures averaged lose contrast
    if size > 512:
        mixed = np.tile(mixed, (size // 512, size // 512))
    elif size < 512:
        mixed = mixed.reshape(size, 512 // size, size, 512 // size).mean(axis=(1, 3))
    return np.asarray((mixed - mixed.mean()) / mixed.std())


def ramp(plane: Plane, colours: Sequence[Colour]) -> NDArray[np.float64]:
    """Colour by value: `plane` in [0, 1] along `colours` (encoded, 0 to 255)."""
    stops = np.linspace(0, 1, len(colours))
    table = np.asarray(colours, np.float64)
    return np.stack([np.interp(plane, stops, table[:, c]) for c in range(3)], axis=-1)


def finish(colour: NDArray[np.float64], coverage: Plane | None = None) -> Texture:
    """Round to bytes; where there is no coverage, colour goes on, so that edges do not fringe."""
    if coverage is None:
        alpha = np.full(colour.shape[:2], 255.0)
    else:
        alpha = 255 * coverage
        solid = coverage > 0.5
        if solid.any():
            nearest = ndimage.distance_transform_edt(
                ~solid, return_distances=False, return_indices=True
            )
            colour = np.where(solid[..., None], colour, colour[tuple(nearest)])
    rgba = np.concatenate([colour, alpha[..., None]], axis=-1)
    result: Texture = np.rint(rgba.clip(0, 255)).astype(np.uint8)
    return result


def lawn(rng: np.random.Generator, dry: float = 0.0) -> Texture:
    """Short grass seen from above; `dry` in [0, 1] turns it yellow."""
    blades = photograph("grass")
    patches = fractal(rng, slope=1.6)
    value = np.clip(0.46 + 0.17 * blades + 0.05 * patches, 0, 1)
    green = ramp(value, [(22, 32, 10), (62, 84, 28), (104, 128, 48), (160, 172, 92)])
    straw = ramp(value, [(42, 34, 16), (112, 98, 48), (164, 148, 84), (214, 202, 150)])
    share = np.clip(dry + 0.22 * patches + 0.08 * fractal(rng, slope=0.8), 0, 1)[..., None]
    return finish(green * (1 - share) + straw * share)


def pebbles(rng: np.random.Generator, colours: Sequence[Colour] | None = None) -> Texture:
    """Gravel."""
    stones = photograph("gravel")
    value = np.clip(0.45 + 0.19 * stones + 0.04 * fractal(rng), 0, 1)
    base = ramp(value, colours or [(28, 24, 20), (98, 90, 80), (150, 141, 128), (226, 220, 210)])
    warmth = 9 * fractal(rng, slope=0.9)[..., None] * np.array([1.0, 0.3, -0.8])
    return finish(base + warmth)


def earth(rng: np.random.Generator) -> Texture:
    """Forest floor: soil, needles, and dead leaves."""
    fine = photograph("grass") * 0.6 + fractal(rng, slope=0.7) * 0.6
    value = np.clip(0.42 + 0.17 * fine, 0, 1)
    colour = ramp(value, [(20, 14, 8), (66, 48, 30), (108, 82, 52), (160, 132, 90)])
    litter, mask = _scatter(
        rng, SIZE_PX, 900, (14, 26), [(128, 82, 40), (150, 104, 54), (96, 62, 32), (168, 130, 72)]
    )
    colour = np.where(mask[..., None] > 0.5, litter, colour)
    moss = np.clip(fractal(rng, slope=1.5) - 0.7, 0, 1)[..., None]
    return finish(colour * (1 - 0.6 * moss) + 0.6 * moss * np.array([64.0, 84.0, 30.0]))


def masonry(
    rng: np.random.Generator,
    rows: int,
    columns: int,
    colours: Sequence[Colour],
    mortar: Colour = (150, 142, 130),
    *,
    joint: float = 0.06,
    rough: float = 1.0,
    size: int = SIZE_PX,
) -> Texture:
    """Courses of blocks in running bond: brick for many rows, ashlar for few."""
    y, x = np.mgrid[:size, :size] / size
    wobble = 0.006 * rough
    y = y + wobble * fractal(rng, size, 1.4) * 0.5
    x = x + wobble * fractal(rng, size, 1.4) * 0.5
    row = np.floor(y * rows).astype(int) % rows
    offset = 0.5 * (row % 2) + 0.12 * rough * rng.uniform(-1, 1, rows)[row]
    across = x * columns + offset
    column = np.floor(across).astype(int) % columns
    down, along = y * rows % 1.0, across % 1.0
    block_ratio = rows / columns
    edge = np.minimum(np.minimum(down, 1 - down), np.minimum(along, 1 - along) * block_ratio)
    edge = edge + 0.012 * rough * fractal(rng, size, 0.9)
    inside = np.clip((edge - joint) / (0.35 * joint), 0, 1)
    tone = rng.uniform(0, 1, (rows, columns))[row, column]
    dark = rng.normal(0, 1, (rows, columns))[row, column]
    grain = fractal(rng, size, 0.75, 8)
    stain = fractal(rng, size, 1.5)
    colour = (
        ramp(tone, colours) * (1 + 0.07 * dark + 0.09 * rough * grain + 0.05 * stain)[..., None]
    )
    rim = np.clip((edge - joint) / (3 * joint), 0, 1)
    colour *= (0.86 + 0.14 * rim)[..., None]
    filler = np.asarray(mortar) * (1 + 0.10 * grain + 0.05 * stain)[..., None]
    return finish(inside[..., None] * colour + (1 - inside[..., None]) * filler)


def planks(rng: np.random.Generator, boards: int = 6, tone: Colour = (128, 98, 68)) -> Texture:
    """Weathered boards, upright (along v)."""
    size = SIZE_PX
    y, x = np.mgrid[:size, :size] / size
    board = np.floor(x * boards).astype(int)
    within = x * boards % 1.0
    shift = rng.uniform(0, 1, boards)[board]
    bend = ndimage.map_coordinates(
        fractal(rng, size, 1.6),
        [(0.25 * y + shift) % 1.0 * size, (0.5 * x) * size],
        order=1,
        mode="grid-wrap",
    )
    rings = np.sin(2 * np.pi * (9 * within + 1.2 * bend + 3 * shift))
    fibres = _stretched(rng, size, 40)
    value = 1 + 0.10 * rings + 0.13 * fibres + 0.14 * rng.normal(0, 1, boards)[board]
    grey = np.clip(0.35 + 0.2 * _stretched(rng, size, 12), 0, 1)[..., None]
    colour = np.asarray(tone) * (1 - grey) + np.array([138.0, 132.0, 122.0]) * grey
    colour = colour * value[..., None]
    gap = np.minimum(within, 1 - within)
    colour *= np.clip(0.18 + (gap - 0.012) / 0.03, 0.18, 1)[..., None]
    for _ in range(2 * boards):  # knots and nail heads
        cx, cy, radius = rng.uniform(0, 1), rng.uniform(0, 1), rng.uniform(0.006, 0.016)
        far = np.hypot((x - cx + 0.5) % 1 - 0.5, ((y - cy + 0.5) % 1 - 0.5) * 0.6) / radius
        colour *= (1 - 0.55 * np.exp(-(far**2)))[..., None]
    return finish(colour)


def bark(rng: np.random.Generator, tone: Colour = (92, 74, 58)) -> Texture:
    """Furrowed bark, upright (along v)."""
    plates = _stretched(rng, SIZE_PX, 7) + 0.35 * _stretched(rng, SIZE_PX, 3)
    furrow = np.exp(-((plates / 0.35) ** 2))
    fine = fractal(rng, slope=0.7, coarsest=12)
    value = 1.05 - 0.62 * furrow + 0.16 * fine + 0.08 * fractal(rng, slope=1.5)
    colour = np.asarray(tone) * value[..., None]
    lichen = np.clip(fractal(rng, slope=1.2) - 1.1, 0, 1)[..., None]
    return finish(colour * (1 - 0.5 * lichen) + 0.5 * lichen * np.array([128.0, 136.0, 104.0]))


def plaster(rng: np.random.Generator, tone: Colour = (206, 190, 164)) -> Texture:
    """Rendered wall with stains and fine cracks."""
    cracks = np.exp(-((fractal(rng, slope=1.3) / 0.018) ** 2))
    value = 1 + 0.045 * fractal(rng, slope=0.8) + 0.07 * fractal(rng, slope=1.5) - 0.18 * cracks
    return finish(np.asarray(tone) * value[..., None])


def stone(rng: np.random.Generator, tone: Colour = (176, 166, 148)) -> Texture:
    """Smooth cut stone with veins, pits and rain marks."""
    veins = np.exp(-((fractal(rng, slope=1.4) / 0.06) ** 2))
    pits = np.clip(fractal(rng, slope=0.5, coarsest=20) - 1.6, 0, 1)
    rain = _stretched(rng, SIZE_PX, 18)
    value = 1 + 0.06 * fractal(rng, slope=0.9) - 0.10 * veins - 0.28 * pits + 0.05 * rain
    hue = 4 * fractal(rng, slope=1.3)[..., None] * np.array([1.0, 0.4, -0.6])
    return finish(np.asarray(tone) * value[..., None] + hue)


def roof_tiles(rng: np.random.Generator) -> Texture:
    """Clay tiles in rows, each lapping over the next."""
    rows, columns, size = 8, 12, SIZE_PX
    y, x = np.mgrid[:size, :size] / size
    row = np.floor(y * rows).astype(int)
    across = x * columns + 0.5 * (row % 2)
    column = np.floor(across).astype(int) % columns
    down, along = y * rows % 1.0, across % 1.0
    bulge = np.sin(np.pi * along)
    tone = rng.normal(0, 1, (rows, columns))[row, column]
    value = (0.55 + 0.5 * bulge) * (0.5 + 0.5 * np.clip(down / 0.22, 0, 1))
    value *= 1 + 0.10 * tone + 0.10 * fractal(rng, slope=0.8)
    return finish(np.array([168.0, 92.0, 64.0]) * value[..., None])


def iron(rng: np.random.Generator) -> Texture:
    """Dark painted iron with rust."""
    rust = np.clip(0.3 + 0.5 * fractal(rng, slope=1.1), 0, 1)[..., None]
    colour = (1 - rust) * np.array([44.0, 46.0, 48.0]) + rust * np.array([104.0, 62.0, 38.0])
    return finish(colour * (1 + 0.12 * fractal(rng, slope=0.6))[..., None])


def leaves(
    rng: np.random.Generator,
    count: int = 120,
    length_px: tuple[int, int] = (90, 150),
    colours: Sequence[Colour] | None = None,
    *,
    size: int = SIZE_PX,
    slender: float = 0.42,
) -> Texture:
    """A spray of leaves on nothing: for cut-out cards. It does not repeat: edges stay empty."""
    tones = colours or [(52, 84, 26), (74, 108, 36), (96, 126, 48), (118, 142, 62)]
    colour, mask = _scatter(
        rng, size, count, length_px, tones, wrap=False, slender=slender, towards_centre=True
    )
    return finish(colour, mask)


def blades(
    rng: np.random.Generator,
    count: int = 46,
    colours: Sequence[Colour] | None = None,
    *,
    heads: Colour | None = None,
    size: int = 512,
) -> Texture:
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


def panorama(
    rng: np.random.Generator,
    zenith: Colour = (82, 128, 190),
    horizon: Colour = (196, 212, 226),
    cloud: Colour = (246, 246, 244),
    cover: float = 0.45,
) -> NDArray[np.uint8]:
    """A sky with clouds, longitude x latitude, shape (1024, 2048, 3)."""
    height, width = 1024, 2048
    y = (np.arange(height) + 0.5) / height
    up = np.clip(np.cos(np.pi * y), 0, 1)[:, None, None]
    colour = np.asarray(horizon) + (np.asarray(zenith) - horizon) * up**0.55
    # Clouds lie on a level sheet: they crowd towards the horizon.
    lift = np.maximum(np.cos(np.pi * y), 0.06)[:, None]
    turn = 2 * np.pi * (np.arange(width) + 0.5)[None, :] / width
    reach = np.sqrt(1 - np.minimum(lift, 1) ** 2) / lift
    sheet = fractal(rng, 1024, 1.55)
    place = [(reach * np.sin(turn)) * 110 % 1024, (reach * np.cos(turn)) * 110 % 1024]
    dense = ndimage.map_coordinates(sheet, place, order=1, mode="grid-wrap")
    thick = np.clip((dense + 2.2 * cover - 1.0) / 1.1, 0, 1)[..., None] ** 0.8
    thick *= np.clip((up - 0.07) * 7, 0, 1)
    shade = np.clip(1.02 - 0.16 * thick + 0.05 * dense[..., None], 0, 1.05)
    colour = colour * (1 - thick) + np.asarray(cloud) * shade * thick
    whole = np.broadcast_to(colour, (height, width, 3)).clip(0, 255)
    result: Texture = np.rint(whole).astype(np.uint8)
    return result


def _stretched(rng: np.random.Generator, size: int, ratio: float) -> Plane:
    """Noise drawn out along v; unit variance, periodic."""
    return _noise(rng, size, 0.95, 3.0, ratio)


def _noise(
    rng: np.random.Generator, size: int, slope: float, coarsest: float, ratio: float
) -> Plane:
    """White noise, shaped in the frequency domain; single precision, for speed."""
    fx = (fft.rfftfreq(size)[None, :] * size).astype(np.float32)
    fy = (fft.fftfreq(size)[:, None] * size * ratio).astype(np.float32)
    squared = fx**2 + fy**2
    gain = np.maximum(squared, 1.0) ** np.float32(-slope / 2)
    gain[squared < coarsest**2] = 0.0
    waves = fft.rfft2(rng.standard_normal((size, size), np.float32)) * gain
    noise = fft.irfft2(waves, (size, size))
    return np.asarray((noise - noise.mean()) / noise.std(), np.float64)


def _scatter(
    rng: np.random.Generator,
    size: int,
    count: int,
    length_px: tuple[int, int],
    tones: Sequence[Colour],
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
        if wrap:
            shifts = [(dx, dy) for dx in (-size, 0, size) for dy in (-size, 0, size)]
        for dx, dy in shifts:
            base = np.array([x0 + dx, y0 + dy])
            for outline, factor in ((near, 1.06), (far, 0.86)):
                fill = (*np.clip(tone * factor, 0, 255).astype(int).tolist(), 255)
                points = np.concatenate([base + outline, (base + spine)[::-1]])
                draw.polygon([tuple(point) for point in points.tolist()], fill=fill)
            rib = (*np.clip(tone * 1.25 + 8, 0, 255).astype(int).tolist(), 255)
            draw.line([tuple(p) for p in (base + spine).tolist()], fill=rib, width=2)
    pixels = np.asarray(image, np.float64)
    grain = 1 + 0.07 * fractal(rng, size, 0.6, 16)
    return pixels[..., :3] * grain[..., None], pixels[..., 3] / 255


TextureMaker = Callable[[np.random.Generator], Texture]
