"""Triangles as a mesh file places them, and their surfaces: what its readers hand on."""

from __future__ import annotations

import io
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from PIL import Image
from scipy import ndimage

from pipeline.errors import InputError
from pipeline.pictures.size_limits import check_values
from stimuli.rendering.world import Material
from stimuli.scenes.mesh_features import Notes

PixelBytes = NDArray[np.uint8]
Wrap = Literal["repeat", "clamp", "mirror"]

LARGEST_TEXTURE_PX = 8192
_WHITE: PixelBytes = np.full((1, 1, 4), 255, np.uint8)
_OPAQUE, _CLEAR = 247, 8
"""Alpha of 255 from which on a surface hides what is behind it, and below which it shows it."""
_RIM_TEXELS = 2
_ROUNDED = 1e-4


@dataclass(frozen=True, eq=False)
class Surface:
    """A material as its file describes it.

    Parameters
    ----------
    name : str
    colour : (r, g, b)
        Linear factor on the picture.
    alpha : float
        Factor on the picture's alpha.
    picture, glow : ndarray of uint8, shape (H, W, 4), optional
        Encoded colour and alpha; row 0 is the picture's top.
    emission : (r, g, b)
        Linear light of its own, a factor on `glow`.
    mode : str
        As glTF's alphaMode.
    wrap : (str, str)
        Along u and v.
    nearest : bool
        Whether enlarged texels keep their edges.
    """

    name: str
    colour: tuple[float, float, float] = (1.0, 1.0, 1.0)
    alpha: float = 1.0
    picture: PixelBytes | None = None
    glow: PixelBytes | None = None
    emission: tuple[float, float, float] = (0.0, 0.0, 0.0)
    mode: Literal["OPAQUE", "MASK", "BLEND"] = "OPAQUE"
    cutoff: float = 0.5
    wrap: tuple[Wrap, Wrap] = ("repeat", "repeat")
    nearest: bool = False
    double_sided: bool = True
    unlit: bool = False


@dataclass(frozen=True, eq=False)
class Shape:
    """Triangles of one surface.

    Parameters
    ----------
    position : ndarray, shape (N, 3)
        In units of the file.
    normal : ndarray, shape (N, 3), optional
        Left out: triangles are flat.
    uv : ndarray, shape (N, 2), optional
        v grows towards the picture's top.
    colour : ndarray, shape (N, 3) or (N, 4), optional
        Linear factor, and of alpha.
    triangles : ndarray of int, shape (M, 3)
    places : sequence of ndarray, shape (4, 4)
        Where it stands: once for each.
    """

    surface: Surface
    position: NDArray[np.float64]
    triangles: NDArray[np.int64]
    normal: NDArray[np.float64] | None = None
    uv: NDArray[np.float64] | None = None
    colour: NDArray[np.float64] | None = None
    places: tuple[NDArray[np.float64], ...] = (np.eye(4),)


def shares(path: Path, what: str, values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return numbers within 0 and 1, which they must be but for rounding.

    Raises
    ------
    InputError
        If they are not.
    """
    low, high = values.min(initial=0), values.max(initial=0)
    if low < -_ROUNDED or high > 1 + _ROUNDED:
        raise InputError(
            f"{path}: {what} must be from 0 to 1 (got {low:.6g} to {high:.6g}); write them so"
            " (bytes divided by 255), or export it again"
        )
    return values.clip(0, 1)


def decoded(data: bytes | memoryview, name: str, what: str) -> PixelBytes:
    """Return a picture as 8-bit RGBA; 16 bits are rounded.

    Raises
    ------
    InputError
        If it cannot be read.
    """
    try:
        with Image.open(io.BytesIO(data)) as picture:
            check_values(Path(name), *picture.size, len(picture.getbands()))
            if getattr(picture, "n_frames", 1) > 1 and picture.format != "MPO":
                raise ValueError("it holds several pictures")
            if picture.mode == "F":
                raise ValueError("its numbers are no integers")
            if picture.mode.startswith("I"):  # 16 bits of grey, which Pillow cuts off at 255
                grey = np.asarray(picture).astype(np.float64)
                clear = grey == picture.info.get("transparency", -1)
                grey = np.rint(grey * (255 / 65535)).clip(0, 255)
                return np.dstack([grey, grey, grey, 255.0 * ~clear]).astype(np.uint8)
            return np.asarray(picture.convert("RGBA"), np.uint8)
    except InputError:
        raise
    except Exception as error:  # Pillow's formats raise what they meet
        reason = (str(error) or type(error).__name__).splitlines()[0]
        raise InputError(
            f"{name}: {what}, must be a picture that can be read ({reason}); save it as PNG"
        ) from None


def material_of(surface: Surface, notes: Notes, lit: bool) -> Material | None:
    """Return the material with which a surface is drawn; None where it is clear throughout.

    Raises
    ------
    InputError
        If it blends with what is behind it.
    """
    pixels = _WHITE if surface.picture is None else surface.picture
    alpha = pixels[..., 3] / 255 * surface.alpha
    coverage = _coverage(surface, notes, alpha)
    if coverage is not None and not (coverage >= 0.5).any():
        return None
    solid = coverage is None or bool((coverage >= 0.5).all() and surface.mode != "MASK")
    if solid or coverage is None:
        pixels = np.concatenate([pixels[..., :3], np.full_like(pixels[..., :1], 255)], axis=-1)
    else:
        from stimuli.scenes.textures import finish

        pixels, coverage = _fitting(surface, notes, pixels, coverage)
        pixels = finish(pixels[..., :3].astype(np.float64), coverage)
    glow = _WHITE if surface.glow is None else surface.glow
    return Material(
        _laid(surface, notes, pixels),
        cutout=not solid,
        lit=lit,
        clamp=(surface.wrap[0] == "clamp", surface.wrap[1] == "clamp"),
        nearest=surface.nearest,
        double_sided=surface.double_sided,
        emission=surface.emission,
        glow=_laid(surface, notes, glow) if any(surface.emission) else None,
    )


def _coverage(
    surface: Surface, notes: Notes, alpha: NDArray[np.float64]
) -> NDArray[np.float64] | None:
    """Return coverage, which is cut at one half; None where all is opaque."""
    if surface.mode == "OPAQUE":
        return None
    if surface.mode == "MASK":
        if surface.cutoff <= 0:
            return None
        # In single precision, as renderers do, or an alpha that is the cutoff might be below it.
        share = alpha.astype(np.float32) / np.float32(surface.cutoff)
        found: NDArray[np.float64] = np.clip(0.5 * share, 0, 1).astype(np.float64)
        return found
    levels = np.rint(alpha * 255).clip(0, 255).astype(np.uint8)
    # A picture may be inexact; one number is not.
    opaque, clear = (_OPAQUE, _CLEAR) if np.ptp(levels) else (255, 1)
    if (levels >= opaque).all():
        return None
    if (levels < clear).all():
        return np.zeros_like(alpha)
    between = (levels >= clear) & (levels < opaque)
    size = 2 * _RIM_TEXELS + 1
    rim = (ndimage.maximum_filter(levels, size, mode="wrap") >= opaque) & (
        ndimage.minimum_filter(levels, size, mode="wrap") < clear
    )
    soft = between & ~rim
    if soft.any():
        where = "throughout" if soft.all() else f"in {soft.mean():.1%} of its picture"
        raise InputError(
            f"{notes.path}: material {surface.name!r} must be opaque or cut out (it blends with"
            f" what is behind it, {where}), because a pixel of a warp has one depth; make it opaque"
            " (alphaMode OPAQUE) or cut out (alphaMode MASK), or delete its faces"
        )
    if between.any():
        notes.say(f"the soft rim of material {surface.name!r} is cut where its alpha is below .5")
    return alpha


def _fitting(
    surface: Surface, notes: Notes, pixels: PixelBytes, coverage: NDArray[np.float64]
) -> tuple[PixelBytes, NDArray[np.float64]]:
    small = _smaller(surface, notes, pixels)
    if small is pixels:
        return pixels, coverage
    height, width = small.shape[:2]
    scaled = Image.fromarray(coverage.astype(np.float32)).resize((width, height))
    return small, np.asarray(scaled, np.float64)


def _smaller(surface: Surface, notes: Notes, pixels: PixelBytes) -> PixelBytes:
    height, width = pixels.shape[:2]
    mirrored = [1 + (wrap == "mirror") for wrap in surface.wrap]
    share = LARGEST_TEXTURE_PX / max(width * mirrored[0], height * mirrored[1])
    if share >= 1:
        return pixels
    size = max(1, round(share * width)), max(1, round(share * height))
    notes.say(
        f"a picture of material {surface.name!r} is {width} x {height} px and is drawn from"
        f" {size[0]} x {size[1]}"
    )
    return np.asarray(Image.fromarray(pixels).resize(size), np.uint8)


def _laid(surface: Surface, notes: Notes, pixels: PixelBytes) -> PixelBytes:
    """Return a picture with row 0 at v = 0; mirrors are laid beside it, and the whole repeats."""
    pixels = _smaller(surface, notes, pixels)[::-1]
    for axis, wrap in ((1, surface.wrap[0]), (0, surface.wrap[1])):
        if wrap == "mirror":
            pixels = np.concatenate([pixels, np.flip(pixels, axis)], axis)
    return np.ascontiguousarray(pixels)


def laid_uv(surface: Surface, uv: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return texture coordinates in units of what `material_of` lays down."""
    return uv * [0.5 if wrap == "mirror" else 1.0 for wrap in surface.wrap]


def with_alpha(shape: Shape, notes: Notes) -> Surface:
    """Return a shape's surface with the alpha of its vertices, which must be one.

    Raises
    ------
    InputError
        If it varies, where it counts.
    """
    surface, colour = shape.surface, shape.colour
    if surface.mode == "OPAQUE" or colour is None or colour.shape[1] < 4:
        return surface
    used = colour[shape.triangles.ravel(), 3]
    if np.ptp(used) > 0.5 / 255:
        raise InputError(
            f"{notes.path}: material {surface.name!r} must have one alpha at all vertices of a mesh"
            f" (it has {used.min():.3g} to {used.max():.3g}); put the alpha into its picture, or"
            " export COLOR_0 without alpha"
        )
    return surface if used[0] == 1 else replace(surface, alpha=surface.alpha * float(used[0]))
