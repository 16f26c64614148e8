"""Opening ONNX networks, and which files one consists of: its weights may lie beside it.

The format is a protocol buffer. Only what leads to tensors is read, by the numbers of the fields
in ``onnx.proto`` (ONNX 1.16); everything else is skipped.
"""

from __future__ import annotations

import os.path
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from pipeline.errors import InputError, MissingExtraError
from protocols.limits import check_within
from protocols.outside import bounded_bytes, reading, visible_line

# Kind of message -> field -> kind of what it holds; "location" is what is looked for.
_LEADS: dict[str, dict[int, str]] = {
    "model": {7: "graph", 20: "training", 25: "function"},
    "training": {1: "graph", 2: "graph"},
    "function": {7: "node", 11: "attribute"},
    "graph": {1: "node", 5: "tensor", 15: "sparse"},
    "node": {5: "attribute"},
    "attribute": {5: "tensor", 6: "graph", 10: "tensor", 11: "graph", 22: "sparse", 23: "sparse"},
    "sparse": {1: "tensor", 2: "tensor"},
    "tensor": {13: "entry"},
}
_DEEPEST = 64


def open_session(path: Path, who_needs: str) -> Any:
    """Open a network with ONNX Runtime, on the CPU.

    Parameters
    ----------
    who_needs : str
        Begins the message where ONNX Runtime is missing: "denoising needs".

    Raises
    ------
    FileNotFoundError
        If there is no such file.
    MissingExtraError
        If ONNX Runtime is not installed.
    InputError
        If the file is no network, or names weights outside its folder.
    """
    if not path.is_file():
        raise FileNotFoundError(2, "No such file", str(path))
    try:
        import onnxruntime
    except ImportError as error:
        raise MissingExtraError(
            f"{who_needs} ONNX Runtime (it is not installed);"
            " install it with: pip install 'metamerlab[onnx]'"
        ) from error
    options = onnxruntime.SessionOptions()
    options.log_severity_level = 4  # what is wrong comes as an exception
    # One order of summation on any number of cores: same input, same bytes.
    options.use_deterministic_compute = True
    network_files(path)  # refuses weights from outside its folder
    try:
        return onnxruntime.InferenceSession(
            str(path), options, providers=["CPUExecutionProvider"], enable_fallback=0
        )  # a second try would print to the terminal
    except Exception as error:  # its own classes are not public
        raise InputError(f"{path}: must be an ONNX model ({on_one_line(error)})") from error


def on_one_line(error: Exception) -> str:
    """Message of a library, on one line, without control characters."""
    return visible_line(str(error) or type(error).__name__)


def network_files(path: Path) -> list[Path]:
    """Return a network's file and every file of weights that it names.

    Raises
    ------
    FileNotFoundError
        If the file, or one that it names, is missing.
    InputError
        If it is no protocol buffer, names a file outside its folder, or is larger than the limit
        of memory with all that it names.
    """
    data = memoryview(bounded_bytes(path, InputError, "memory"))
    with reading(path, "an ONNX model", InputError):
        names = sorted(set(_locations(data, "model", 0)))
    found = [path]
    for name in names:
        found.append(path.parent / name)
        if not _lies_in(path.parent, found[-1]):
            raise InputError(
                f"{path}: must name weights in its own folder ({name[:200]!r} lies outside)"
            )
        if not found[-1].is_file():
            raise FileNotFoundError(2, "No such file", str(found[-1]))
    size = sum(file.stat().st_size for file in found)
    check_within("memory", size, InputError, path, "bytes with its weights")
    return found


def _lies_in(folder: Path, file: Path) -> bool:
    """Return True if a file lies in a folder, as it is named and where its links lead."""
    named = not Path(os.path.relpath(file, folder)).is_relative_to("..")
    if not named or "\0" in str(file):
        return False
    place = Path(os.path.realpath(file))  # Path.resolve fails at links in a circle up to 3.12
    return place.is_relative_to(folder.resolve())


def _locations(data: memoryview, kind: str, depth: int) -> Iterator[str]:
    if depth > _DEEPEST:
        raise ValueError("its graphs lie too deep in each other")
    if kind == "entry":
        entry = {number: bytes(value).decode() for number, value in _fields(data)}
        if entry.get(1) == "location" and 2 in entry:
            yield entry[2]
        return
    for number, value in _fields(data):
        inner = _LEADS[kind].get(number)
        if inner is not None:
            yield from _locations(value, inner, depth + 1)


def _fields(data: memoryview) -> Iterator[tuple[int, memoryview]]:
    """Yield number and bytes of every field that has bytes."""
    place = 0
    while place < len(data):
        tag, place = _varint(data, place)
        wire = tag & 7
        if wire == 0:
            _, place = _varint(data, place)
        elif wire in (1, 5):
            place += 8 if wire == 1 else 4
        elif wire == 2:
            length, place = _varint(data, place)
            if place + length > len(data):
                raise ValueError("it ends too early")
            yield tag >> 3, data[place : place + length]
            place += length
        else:
            raise ValueError(f"it holds a field of an unknown kind, {wire}")


def _varint(data: memoryview, place: int) -> tuple[int, int]:
    value = 0
    for shift in range(0, 70, 7):
        if place >= len(data):
            raise ValueError("it ends too early")
        byte = data[place]
        place += 1
        value |= (byte & 127) << shift
        if byte < 128:
            return value, place
    raise ValueError("it holds a number that is too long")
