"""Files of disparity and depth, with what in them stands for "unknown", and of optical flow.

Numbers are read as they are stored. A number stands for "unknown" for sure if it is 0 in a file of
integers, not finite in a file of floats, or what the file's own header names. Others do where no
picture can have them: StereoSGBM's -1 (its -16 before it is divided by 16), a depth of 0. Where a
number looks like a stand-in, but may be one, the person is asked.

Flow is target minus source position, x to the right, y down, pixels. It is read from Middlebury's
`.flo`: four bytes that read "PIEH" (the float 202021.25), width and height as 32-bit integers, then
two floats for each pixel, row by row, all little-endian (Baker et al. 2011, "A Database and
Evaluation Methodology for Optical Flow"); from PFM as FlyingThings3D has it; from `.npy` and `.npz`
as networks write it; from KITTI's PNG. A component beyond 1e9, or NaN, is unknown motion.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Final, Literal, get_args

import numpy as np
from numpy.typing import NDArray

from pipeline.errors import InputError, note
from pipeline.frame import AnyArray, Bools, Floats, check_depth
from pipeline.pictures.channels import EMPTY_DEPTH, lone_plane
from pipeline.pictures.decode import check_numbers, read_parts, read_pixels
from pipeline.pictures.header import check_fits, count_pictures
from pipeline.pictures.numpy_file import (
    FLOW_CURE,
    FLOW_FILES,
    NUMPY_FILES,
    flow_array,
    plane_array,
)
from pipeline.pictures.size_limits import check_values
from protocols.errors import count_of

DEPTH_UNIT = "metamerlab:depth_unit"


def check_depth_unit(path: Path, attributes: Mapping[str, Any], cure: str = "") -> None:
    """Refuse depth whose header says another unit than metres; `cure` ends the message.

    Raises
    ------
    InputError
        With the unit.
    """
    unit = str(attributes.get(DEPTH_UNIT, "m"))
    if unit != "m":
        raise InputError(f"{path}: depth must be in metres (the header says {unit[:40]!r}){cure}")


DepthIs = Literal["distance", "inverse", "ray"]
DEPTH_IS: Final[tuple[DepthIs, ...]] = get_args(DepthIs)
Unknown = Sequence[float] | None
"""Numbers that stand for "unknown"; none, if it is empty; None where nobody has said."""
_MANY = 1e-3  # share of the pixels from which a number may stand for something
_APART = 1 / 16  # of an integer type's range, between a stand-in and the next number
_APART_PX = 3.0  # the same for a disparity of a pixel less than nothing
_UNITS = "units_per_px (--units-per-px)"
_NEARLY_ALL = 0.9
_LONE = 100.0  # times nearer than all else, from which on a distance is doubted
_LISTED = 6  # numbers that a message lists
_FAR = 2.0  # widths of the picture; a single disparity from there on may be a stand-in
_FLOAT_STAND_INS = (65504.0, 65520.0, 65535.0)
_WRONG_ORDER = 0.5  # share of floats beyond any distance
_ROUGH, _SMOOTHER = 0.05, 4.0  # mean step of integers, of their range; and how much less it was
_SMALLEST, _LARGEST = 1e-12, 1e12  # of any distance, in whatever unit
_FORMATS = "PNG of 16 bits, TIFF, OpenEXR, PGM, PFM, .npy or .npz"


def read_disparity(
    path: Path, *, units_per_px: float, offset_px: float, unknown: Unknown = None
) -> NDArray[np.float32]:
    """Read a disparity in pixels, shape (H, W); NaN where it is unknown.

    Raises
    ------
    FileNotFoundError, InputError
        If the file is not there or holds no such numbers, or if a number may stand for "unknown"
        and nobody has said.
    """
    stored, named = _read(path)
    values = _doubles(stored)
    missing = _unknown(stored, named, unknown)
    missing |= ~np.isfinite(values) | (np.abs(values) >= EMPTY_DEPTH)
    impossible = ~missing & (values / units_per_px + offset_px <= 0)
    if impossible.any():
        _check_sign(path, values[impossible & (values < 0)], int((~missing).sum()))
    if unknown is None:
        lowest = (-1.0, -units_per_px)
        missing |= _impossible_stand_in(path, stored, impossible, lowest)
        _ask(path, stored, missing, (*lowest, -16.0), _APART_PX * units_per_px, units_per_px)
    impossible &= ~missing
    if unknown is None:
        _ask_about_impossible(path, stored, values / units_per_px, missing, impossible)
    if impossible.any():
        held = _held(stored, impossible)
        raise InputError(
            f"{path}: disparity must be greater than {0 - offset_px:g} px, or the depth is not"
            f" positive (holds {held}); if it stands for unknown,"
            f" {_say(*np.unique(stored[impossible]), told=unknown)}; else, is the offset right"
            " (offset_px, --offset-px)?"
        )
    values = np.where(missing, np.nan, values / units_per_px)
    return _some_known(path, values, "disparity").astype(np.float32)


def _read_depth(path: Path, scale: float, is_a: DepthIs, unknown: Unknown) -> Floats:
    """Depth in metres, shape (H, W): NaN where it is unknown, inf where there is nothing."""
    stored, named = _read(path, scale)
    values = _doubles(stored)
    missing = _unknown(stored, named, unknown, zero=is_a != "inverse") | np.isnan(values)
    far = np.isinf(values) & (is_a == "inverse")  # a distance of 0
    impossible = ~missing & (far | (values < 0 if is_a == "inverse" else values <= 0))
    if unknown is None:
        held = np.unique(stored[impossible])[:1].tolist()
        missing |= _impossible_stand_in(path, stored, impossible, held)
        nearest = () if is_a == "inverse" else _lone(values[~missing & ~impossible])
        _ask(path, stored, missing, nearest, 0.0, 1.0)
        impossible &= ~missing
    if impossible.any():
        rule = "at or above 0, and finite" if is_a == "inverse" else "greater than 0"
        raise InputError(
            f"{path}: depth must be {rule} (holds {_held(stored, impossible)}); if it stands for"
            f" unknown, {_say(*np.unique(stored[impossible]), told=unknown)}; else render it again"
        )
    if is_a == "inverse":
        with np.errstate(divide="ignore"):
            depth = scale / values
    else:
        depth = np.where(values >= EMPTY_DEPTH, np.inf, values * scale)
    return _some_known(path, np.where(missing, np.nan, depth), "depth")


def _some_known(path: Path, values: Floats, what: str) -> Floats:
    if np.isnan(values).all():
        raise InputError(
            f"{path}: {what} must be known for at least one pixel (each is NaN, or a number that"
            " stands for unknown); is it the right file?"
        )
    return values


def along_axis(
    depth_m: NDArray[np.float32], intrinsics_px: tuple[float, float, float, float]
) -> NDArray[np.float32]:
    """Return distances along each pixel's ray, shape (H, W), as distances along the optical axis.

    `intrinsics_px` are fx, fy, cx and cy, the centre of the left top pixel being at (0, 0).

    Raises
    ------
    InputError
        If a focal length is not greater than 0.
    """
    fx_px, fy_px, cx_px, cy_px = intrinsics_px
    if not (fx_px > 0 and fy_px > 0):
        raise InputError(f"focal lengths must be greater than 0 (got {fx_px:g} and {fy_px:g})")
    height, width = depth_m.shape
    x = (np.arange(width) - cx_px) / fx_px
    y = (np.arange(height)[:, None] - cy_px) / fy_px
    return np.asarray(depth_m / np.sqrt(1 + x**2 + y**2), np.float32)


def _ask_about_impossible(
    path: Path,
    stored: AnyArray,
    pixels: Floats,
    missing: Bools,
    negative: Bools,
) -> None:
    """Refuse one single disparity that cannot be, with what would say that it stands for unknown.

    Raises
    ------
    InputError
        If all impossible disparities are equal: one below the least that can be, or, at many
        pixels, one far beyond the picture's width.
    """
    width = pixels.shape[1]
    far = ~missing & (pixels >= _FAR * width)
    others = pixels[~missing & ~far]
    many = far.sum() >= max(2, _MANY * pixels.size)
    lonely = bool(many and others.size and others.max() < width)
    for bad, rule, doubt in (
        (negative, "greater than what makes depth infinite", "offset_px (--offset-px)"),
        (far & lonely, f"less than the picture's width, {width} px", _UNITS),
    ):
        held = pixels[bad]
        if held.size and (held == held[0]).all():
            value = stored[bad][0]
            raise InputError(
                f"{path}: disparity must be {rule} (got {held[0]:g} px, stored as"
                f" {_digits(value)}, at"
                f" {held.size} pixels); if it stands for unknown, {_say(value)}; else, is"
                f" {doubt} right?"
            )


def _unknown(stored: AnyArray, named: float | None, told: Unknown, *, zero: bool = True) -> Bools:
    """True where a number stands for "unknown" for sure: by type, header, or what was told."""
    numbers = [*(told or ()), *(() if named is None else (named,))]
    if zero and stored.dtype.kind in "iu":
        numbers.append(0)
    missing = np.zeros(stored.shape, np.bool_)
    for number in numbers:  # 0.1 of half or float is another number than 0.1
        missing |= stored == (stored.dtype.type(number) if stored.dtype.kind == "f" else number)
    return missing


def _impossible_stand_in(
    path: Path, stored: AnyArray, impossible: Bools, numbers: Sequence[float]
) -> Bools:
    """The impossible pixels, where all hold one of `numbers`, which then stands for "unknown"."""
    held = np.unique(stored[impossible])
    if held.size != 1 or float(held[0]) not in [float(number) for number in numbers]:
        return np.zeros(stored.shape, np.bool_)
    note(path, f"{_digits(held[0])}, at {int(impossible.sum())} pixels, is taken for unknown")
    return impossible


def _ask(
    path: Path,
    stored: AnyArray,
    missing: Bools,
    lowest: Sequence[float],
    apart: float,
    units: float,
) -> None:
    """Refuse a number that many pixels hold, far from all others, and that others use for unknown.

    Raises
    ------
    InputError
        With what would say what it is.
    """
    known = _doubles(stored[~missing])
    if not known.size:
        return
    low, high = float(known.min()), float(known.max())
    above, below = known[known > low], known[known < high]
    if low in lowest and above.size and above.min() - low >= apart:
        value, count = stored[~missing].min(), known.size - above.size
    elif (
        high in _highest(stored.dtype, units)
        and below.size
        and high - below.max()
        > (below.max() - low if stored.dtype.kind == "f" else _largest(stored.dtype, high) * _APART)
    ):
        value, count = stored[~missing].max(), known.size - below.size
    else:
        return
    if count < max(2, _MANY * stored.size):
        return
    raise InputError(
        f"{path}: each number must be known or said to be unknown ({count} pixels hold"
        f" {_digits(value)},"
        " far from all others: programs write it where they found nothing); if it stands for"
        f" unknown, {_say(value)}; if it is a number like others, say so by unknown = [] in a"
        " study, or --unknown none"
    )


def _check_sign(path: Path, below: Floats, known: int) -> None:
    """Refuse a disparity below 0 nearly everywhere, which grows the other way.

    Raises
    ------
    InputError
        With what turns it.
    """
    if below.size > _NEARLY_ALL * known and (below != below[0]).any():
        raise InputError(
            f"{path}: disparity must be greater than 0, and the larger the nearer ({below.size} of"
            f" {known} known numbers are below 0: disparity of the other convention); write"
            " it with its sign turned"
        )


def _held(stored: AnyArray, where: Bools) -> str:
    """Numbers at some pixels, and at how many each, in words."""
    numbers, counts = np.unique(stored[where], return_counts=True)
    listed = [
        f"{_digits(number)} at {count} pixels"
        for number, count in zip(numbers[:_LISTED], counts[:_LISTED], strict=True)
    ]
    more = numbers.size - _LISTED
    return ", ".join([*listed, *([f"{more} other such numbers"] if more > 0 else [])])


def _say(*values: Any, told: Unknown = None) -> str:
    """Cure in words: how to say that numbers stand for "unknown", beside those that were told."""
    numbers = [*dict.fromkeys([*map(float, told or ()), *values])]
    if len(numbers) > _LISTED:
        return "store NaN in its place, in a file of floats"
    words = [_digits(number) for number in numbers]
    options = " ".join(f"--unknown {word}" for word in words)
    return f"say so by unknown = [{', '.join(words)}] in a study, or {options}"


def _digits(value: Any) -> str:
    """A stored number in as few digits as name it and no other of its type."""
    if isinstance(value, float | np.floating):
        return np.format_float_positional(value, trim="-")
    return str(value)


def _lone(values: Floats) -> tuple[float, ...]:
    """The least of some numbers, where all others are more than a hundred times as large."""
    others = values[values > values.min(initial=np.inf)]
    return (values.min(),) if others.size and values.min() * _LONE < others.min() else ()


def _highest(dtype: np.dtype[Any], units: float) -> tuple[float, ...]:
    """Large numbers that programs write for "unknown": the largest, and -1 and -16 without sign."""
    if dtype.kind == "f":
        return _FLOAT_STAND_INS
    largest = {_largest(dtype, 0.0), float(np.iinfo(dtype).max)}
    return tuple(stand for most in largest for stand in (most, most + 1 - units, most - 15))


def _largest(dtype: np.dtype[Any], number: float) -> float:
    """The largest integer of a type; of a wide one with numbers of 16 bits, theirs."""
    most = float(np.iinfo(dtype).max)
    return 65535.0 if dtype.itemsize > 2 and number <= 65535 else most


def check_byte_order(path: Path, stored: AnyArray) -> None:
    """Refuse numbers that make sense only with their bytes in the other order.

    Raises
    ------
    InputError
        With the first number in both orders.
    """
    if stored.dtype.itemsize == 1:
        return
    if stored.dtype.kind == "f":
        wrong = _absurd(stored) > _WRONG_ORDER > _absurd(stored.byteswap())
    else:
        rough = _roughness(stored)
        wrong = rough > _ROUGH and _roughness(stored.byteswap()) < rough / _SMOOTHER
    if wrong:
        other = stored.byteswap()
        raise InputError(
            f"{path}: must hold its numbers in the byte order that it states (the first is"
            f" {stored.flat[0]:g}, and {other.flat[0]:g} with its bytes turned round); write it"
            " again, with the order that its numbers have"
        )


def _doubles(stored: AnyArray) -> Floats:
    with np.errstate(invalid="ignore", over="ignore"):  # damaged floats may be signals
        return stored.astype(np.float64)


def _absurd(values: AnyArray) -> float:
    """Share of the numbers other than 0 that are no distance in any unit."""
    size = np.abs(_doubles(values))
    size = size[np.isfinite(size) & (size != 0)]
    return float(((size < _SMALLEST) | (size > _LARGEST)).mean()) if size.size else 0.0


def _roughness(values: AnyArray) -> float:
    """Mean step along the rows, of the whole range."""
    extent = float(values.max()) - float(values.min())
    steps = np.abs(np.diff(values.astype(np.float64), axis=1))
    return float(steps.mean()) / extent if extent > 0 and steps.size else 0.0


def _read(path: Path, scale: float = 0.0) -> tuple[AnyArray, float | None]:
    """Numbers as stored, and the one that the header names for "unknown".

    A `scale` of 1 is that of depth in metres.
    """
    if path.suffix.lower() in NUMPY_FILES:
        array = plane_array(path)
        check_byte_order(path, array)
        return array, None
    check_fits(path, "read")
    pixels = read_pixels(path, stretched=False)
    named = check_numbers(path, pixels)
    if scale == 1:
        cure = "; say how many metres a unit has (--depth-scale, or depth_scale in a study)"
        check_depth_unit(path, pixels.attributes, cure)
    data, names = pixels.data, pixels.channels
    if pixels.kind == "openexr" and (len(names) > 1 or count_pictures(path) > 1):
        planes = read_parts(path, judged=True).planes
        data, names = np.stack(list(planes.values()), axis=-1), tuple(planes)
        if (plane := lone_plane(path, planes)) is not None:
            return plane, named
    if names[-1:] == ("A",) and data.shape[-1] > 1:
        opaque = np.iinfo(data.dtype).max if data.dtype.kind == "u" else 1
        if (data[..., -1] == opaque).all():
            data, names = data[..., :-1], names[:-1]
    if data.shape[-1] == 3 and (data == data[..., :1]).all():
        data = data[..., :1]  # grey, stored as colour
    if data.shape[-1] == 1:
        check_byte_order(path, data[..., 0])
        return data[..., 0], named
    if names == ("R", "G", "B"):
        raise InputError(
            f"{path}: must have one channel, of the numbers themselves (has R, G, B that differ: a"
            " colour-mapped picture of them, or numbers packed in three channels); made grey it"
            f" would be wrong: ask whoever made it for the numbers, as {_FORMATS}"
        )
    raise InputError(
        f"{path}: must have one channel (has {', '.join(names)}); write the one that is"
        f" meant to a file of its own, as {_FORMATS}"
    )


MAGIC = np.float32(202021.25)
UNKNOWN_PX = 1e9
HEADER_BYTES = 12


def read_flow(path: Path) -> tuple[NDArray[np.float32], Bools]:
    """Read a file of flow: Middlebury's, PFM, numpy's, or KITTI's PNG.

    Returns
    -------
    flow_px : ndarray of float32, shape (H, W, 2)
        As stored; 0 where it is unknown.
    known : ndarray of bool, shape (H, W)

    Raises
    ------
    FileNotFoundError
        If there is no such file.
    InputError
        If it is not a whole file of flow, its numbers have the other byte order, or no motion is
        known.
    """
    kind = path.suffix.lower()
    if kind in NUMPY_FILES:
        stored = flow_array(path)
    else:
        stored = _flow_of_picture(path) if kind in (".pfm", ".png") else _flow_of_flo(path)
    check_byte_order(path, stored)
    with np.errstate(invalid="ignore", over="ignore"):
        flow = stored.astype(np.float32)
        within = np.abs(flow) <= UNKNOWN_PX
    known = within[..., 0] & within[..., 1]
    if not known.any():
        raise InputError(f"{path}: must know the motion of at least one pixel (knows none)")
    return np.where(known[..., None], flow, 0).astype(np.float32), known


def _flow_of_picture(path: Path) -> AnyArray:
    """Motion in PFM of three channels, the last 0, or in 16 bits as KITTI's PNG has it."""
    data = read_pixels(path, stretched=False).data
    if data.dtype == np.uint16 and data.shape[-1] == 3 and data[..., 2].max() <= 1:
        return np.where(data[..., 2:] == 1, (data[..., :2] - 32768.0) / 64, np.nan)
    if data.dtype.kind == "f" and data.shape[-1] == 3 and not data[..., 2].any():
        return data[..., :2]
    wanted = "64 x motion + 32768 in 16 bits, and whether" if path.suffix.lower() == ".png" else "0"
    raise InputError(
        f"{path}: must hold motion in two channels, and {wanted} it is known, in a third one"
        f" (has {data.dtype}, {count_of(data.shape[-1], 'channel')}); {FLOW_CURE}"
    )


def _flow_of_flo(path: Path) -> AnyArray:
    size = path.stat().st_size
    with path.open("rb") as file:
        data = file.read(HEADER_BYTES)
    if len(data) < HEADER_BYTES or np.frombuffer(data, "<f4", 1)[0] != MAGIC:
        raise InputError(
            f"{path}: must be flow, {', '.join(FLOW_FILES)} (it does not begin with"
            f" PIEH, as a .flo does); {FLOW_CURE}"
        )
    width, height = (int(edge) for edge in np.frombuffer(data, "<i4", 2, offset=4))
    wanted = HEADER_BYTES + 8 * width * height
    if width < 1 or height < 1 or size != wanted:
        raise InputError(
            f"{path}: must hold {width}x{height} px of motion in {wanted} bytes"
            f" (has {size}); is it cut off?"
        )
    check_values(path, width, height, 2)
    return np.fromfile(path, "<f4", offset=HEADER_BYTES).reshape(height, width, 2)


ASSUMED_FIELD_OF_VIEW = 1.0  # focal length over image width, where a pair does not say


def fill_unknown(
    disparity_px: NDArray[np.float32],
) -> tuple[NDArray[np.float32], Bools]:
    """Set each unknown disparity to that of the farther of its known neighbours in the row.

    Unknown pixels are mostly those that only one camera sees: they belong to the background.

    Parameters
    ----------
    disparity_px : ndarray of float32, shape (H, W)
        NaN or infinite where unknown.

    Returns
    -------
    filled : ndarray of float32, shape (H, W)
        Finite. A row without any known pixel takes the nearest row that has one.
    known : ndarray of bool, shape (H, W)

    Raises
    ------
    InputError
        If no pixel is known.
    """
    known = np.isfinite(disparity_px)
    if not known.any():
        raise InputError("at least one pixel must be known (none is finite)")
    rows_known = np.flatnonzero(known.any(axis=1))
    nearest = rows_known[
        np.abs(np.arange(len(known))[:, None] - rows_known[None, :]).argmin(axis=1)
    ]
    # Far means small: the smaller of the two neighbours, one of which may be missing.
    finite = np.where(known, disparity_px, np.inf)
    left = _carry(finite, known)
    right = _carry(finite[:, ::-1], known[:, ::-1])[:, ::-1]
    filled = np.where(known, disparity_px, np.minimum(left, right))[nearest]
    return filled.astype(np.float32), known


def _carry(values: NDArray[np.floating], known: Bools) -> NDArray[np.floating]:
    """Each pixel's last known value to the left, inf where there is none."""
    column = np.where(known, np.arange(values.shape[1]), -1)
    last = np.maximum.accumulate(column, axis=1)
    carried = np.take_along_axis(values, last.clip(min=0), axis=1)
    return np.where(last >= 0, carried, np.inf)


def load_depth(
    path: Path,
    scale: float,
    *,
    is_a: DepthIs = "distance",
    unknown: Unknown = None,
    intrinsics_px: tuple[float, float, float, float] | None = None,
) -> tuple[NDArray[np.float32], Bools]:
    """Read depth in metres along the optical axis, and where it was measured, (H, W) each.

    The module says which numbers stand for "unknown": such a pixel takes the depth of the farther
    neighbour in the row.

    Parameters
    ----------
    path : Path
        One number a pixel, in a format that this module names.
    scale : float
        Metres per unit; for ``"inverse"``, what 1 stands for.
    is_a : {"distance", "inverse", "ray"}
        Distance along the axis, 1 / distance, or distance along the pixel's ray.
    unknown : sequence of float, optional
        Further stored numbers that stand for "unknown"; empty, if there are none.
    intrinsics_px : (fx, fy, cx, cy), optional
        Of the camera, for rays; by default the middle of a field of view of 53 degrees.

    Raises
    ------
    FileNotFoundError
        If there is no such file.
    InputError
        If it holds other than one number a pixel, a depth is not positive, or a number may stand
        for "unknown" and nobody has said.
    """
    if not scale > 0:
        raise InputError(f"metres per unit of depth must be greater than 0 (got {scale})")
    stored = _read_depth(path, scale, is_a, unknown)
    measured = ~np.isnan(stored)
    if not measured.all():
        with np.errstate(divide="ignore", over="ignore"):
            inverse = (1 / stored).astype(np.float32)
            depth = (1 / fill_unknown(inverse)[0]).astype(np.float32)
    else:
        with np.errstate(over="ignore", under="ignore"):
            depth = stored.astype(np.float32)
    check_depth(depth, f"{path}: depth")
    if is_a == "ray":
        height, width = depth.shape
        focal_px = ASSUMED_FIELD_OF_VIEW * width
        depth = along_axis(depth, intrinsics_px or centred(focal_px, width, height))
    return depth, measured


def centred(focal_px: float, width: int, height: int) -> tuple[float, float, float, float]:
    """Intrinsics (fx, fy, cx, cy) of a camera that looks at the middle of its picture."""
    return focal_px, focal_px, (width - 1) / 2, (height - 1) / 2
