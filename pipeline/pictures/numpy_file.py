"""Files of numpy (`.npy`, `.npz`): a plane of numbers, or motion, read only if it fits.

Motion has shape (H, W, 2) or (2, H, W); one more edge of 1 before it, a batch of one, is taken
off. An `.npz` may hold more than the motion: that array is taken which alone has such a shape.
"""

from __future__ import annotations

import math
import zipfile
from pathlib import Path
from typing import IO, Any, Final

import numpy as np

from pipeline.errors import InputError, note
from pipeline.frame import AnyArray
from pipeline.pictures.size_limits import check_need, check_values
from protocols.outside import check_zip, reading

NUMPY_FILES: Final = (".npy", ".npz")
FLOW_FILES: Final = (".flo", ".pfm", *NUMPY_FILES, ".png")
FLOW_CURE: Final = "write it as .npy: numpy.save(file, flow), of floats of shape (H, W, 2)"


def plane_array(path: Path) -> AnyArray:
    """Return the one array of a numpy file, of shape (H, W).

    Raises
    ------
    InputError
        If it holds other than that, or does not fit.
    """
    arrays = _arrays(path)
    if len(arrays) != 1:
        raise InputError(f"{path}: must hold one array (holds {', '.join(arrays) or 'none'})")
    (array,) = arrays.values()
    if array.ndim == 3 and array.shape[-1] == 1:
        array = array[..., 0]
    if array.ndim != 2 or array.dtype.kind not in "fui":
        raise InputError(f"{path}: must hold numbers of shape (H, W) (has {_shape(array)})")
    return array.astype(array.dtype.newbyteorder("="), copy=False)


def flow_array(path: Path) -> AnyArray:
    """Return the motion in a numpy file, of shape (H, W, 2).

    Raises
    ------
    InputError
        If no array, or more than one, has such a shape, or it does not fit.
    """
    arrays = _arrays(path)
    found = {name: flow for name, one in arrays.items() if (flow := _as_flow(one)) is not None}
    if len(found) != 1:
        held = ", ".join(f"{name} {_shape(one)}".strip() for name, one in arrays.items())
        raise InputError(
            f"{path}: must hold one motion of each pixel, of shape (H, W, 2) or (2, H, W) (holds"
            f" {held or 'none'}); {FLOW_CURE}"
        )
    ((name, flow),) = found.items()
    if rest := [other for other in arrays if other != name]:
        note(path, f"{name} is the motion; {', '.join(rest)} is not read")
    return flow.astype(flow.dtype.newbyteorder("="), copy=False)


def _as_flow(array: AnyArray) -> AnyArray | None:
    """An array of motion with its two components last; None: it is none."""
    while array.ndim > 3 and array.shape[0] == 1:
        array = array[0]
    if array.ndim != 3 or array.dtype.kind not in "fi":
        return None
    if array.shape[-1] == 2:
        return array
    return np.moveaxis(array, 0, -1) if array.shape[0] == 2 else None


def _shape(array: AnyArray) -> str:
    return f"{array.dtype} of shape {array.shape}"


def _arrays(path: Path) -> dict[str, AnyArray]:
    """Arrays of a numpy file by name, after a look at the sizes that they state."""
    with reading(path, "a numpy file", InputError):
        if not zipfile.is_zipfile(path):
            with path.open("rb") as file:
                _check_array(path, file)
                file.seek(0)
                return {"": np.asarray(np.load(file, allow_pickle=False))}
        with path.open("rb") as file:
            check_zip(path, file, InputError)
            with zipfile.ZipFile(file) as packed:
                for name in packed.namelist():
                    with packed.open(name) as member:
                        _check_array(path, member)
        with np.load(path, allow_pickle=False) as loaded:
            return {name: np.asarray(loaded[name]) for name in loaded.files}


def _check_array(path: Path, file: IO[bytes]) -> None:
    """Refuse an array by the size that it states."""
    first = np.lib.format.read_magic(file) == (1, 0)
    header = np.lib.format.read_array_header_1_0 if first else _later_header
    shape = header(file)[0]
    check_values(path, *shape)
    check_need(path, "read", math.prod(shape), 1)


def _later_header(file: Any) -> tuple[tuple[int, ...], bool, Any]:
    return np.lib.format.read_array_header_2_0(file)
