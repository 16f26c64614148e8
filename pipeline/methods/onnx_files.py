"""Opening ONNX networks, and which files one consists of: its weights may lie beside it.

The format is a protocol buffer. Only what leads to tensors is read, by the numbers of the fields
in ``onnx.proto`` (ONNX 1.16); everything else is skipped.
"""

from __future__ import annotations

import importlib.util
import math
import os.path
import pickle
import subprocess
import sys
import threading
import time
import weakref
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import psutil
from numpy.typing import NDArray

from pipeline.errors import InputError, MissingExtraError
from protocols.limits import LIMITS_VARIABLE, check_within, limit, network_limits
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
_START_S = 60.0
"""Seconds that a process may take to start, on a machine with other work."""


class Tensor(NamedTuple):
    """An input or output of a network, as ONNX Runtime describes it."""

    name: str
    type: str
    shape: Sequence[int | str | None] | None


class NetworkError(Exception):
    """Message of ONNX Runtime about a network."""


class BoundedNetwork:
    """Network that runs in a process of its own, within `network_limits`.

    A file of 100 bytes can ask for any memory, or never end, and ONNX Runtime bounds neither.
    """

    inputs: list[Tensor]
    outputs: list[Tensor]
    metadata: dict[str, str]

    def __init__(self, path: Path, packed: int) -> None:
        self._path, self._packed, self._asking = path, packed, threading.Lock()
        child = subprocess.Popen(
            [sys.executable, "-P", str(Path(__file__).with_name("onnx_child.py"))],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
        )
        self._child, self.end = child, weakref.finalize(self, _end, child)
        try:
            inputs, outputs, self.metadata = self._answer(None, str(path.absolute()), 0, _START_S)
        except BaseException:
            self.end()
            raise
        self.inputs, self.outputs = ([Tensor(*one) for one in side] for side in (inputs, outputs))

    def run(
        self, outputs: Sequence[str], feed: Mapping[str, NDArray[np.float32]]
    ) -> list[NDArray[Any]]:
        """Return outputs for inputs, whose pixels bound what the network may take.

        Raises
        ------
        InputError
            If it takes more memory or time than it may.
        NetworkError
            With what ONNX Runtime says.
        """
        pixels = max((math.prod(one.shape[2:]) for one in feed.values()), default=0)
        found = self._answer(list(outputs), dict(feed), pixels)
        return [np.asarray(one) for one in found]

    def _answer(self, outputs: object, feed: object, pixels: int, start_s: float = 0) -> Any:
        most = network_limits(pixels, self._packed)
        seconds = most["seconds"] + start_s
        ended, over = threading.Event(), list[str]()
        watched = (self._child, most["memory"], seconds, ended, over)
        watch = threading.Thread(target=_watch, args=watched, daemon=True)
        with self._asking:
            watch.start()
            try:
                assert self._child.stdin is not None
                assert self._child.stdout is not None
                pickle.dump((outputs, feed, seconds), self._child.stdin, protocol=5)
                self._child.stdin.flush()
                well, found = pickle.load(self._child.stdout)
            except (EOFError, OSError, ValueError, pickle.UnpicklingError):
                self.end()
                if not over:
                    raise NetworkError(f"it ended with status {self._child.returncode}") from None
                raise InputError(
                    f"{self._path}: the network must take at most {most['memory'] / 1e9:.3g} GB of"
                    f" memory and {seconds:.0f} s on {pixels:,} pixels (it takes more); if it is"
                    f" right, raise the limit with {LIMITS_VARIABLE}={over[0]}="
                    f"{10 * limit(over[0])}"
                ) from None
            except BaseException:  # Ctrl-C: the answer would be that of the next question
                self.end()
                raise
            finally:
                ended.set()
                watch.join()
        if not well:
            raise NetworkError(found)
        return found


def _watch(
    child: subprocess.Popen[bytes],
    memory: float,
    seconds: float,
    ended: threading.Event,
    over: list[str],
) -> None:
    """End a process that takes more memory or time than it may, and say of what."""
    until_s = time.monotonic() + seconds
    with suppress(psutil.Error):  # it is gone
        process = psutil.Process(child.pid)
        while not ended.wait(0.02):
            late = time.monotonic() > until_s
            if late or process.memory_info().rss > memory:
                over.append("seconds" if late else "memory")
                child.kill()
                return


def _end(child: subprocess.Popen[bytes]) -> None:
    child.kill()
    with suppress(OSError):  # what was not sent is lost with it
        child.communicate()


def open_session(path: Path, who_needs: str) -> BoundedNetwork:
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
        If the file is no network, names weights outside its folder, or takes too much.
    """
    if not path.is_file():
        raise FileNotFoundError(2, "No such file", str(path))
    if importlib.util.find_spec("onnxruntime") is None:
        raise MissingExtraError(
            f"{who_needs} ONNX Runtime (it is not installed);"
            " install it with: pip install 'metamerlab[onnx]'"
        )
    files = network_files(path)  # refuses weights from outside its folder
    try:
        return BoundedNetwork(path, sum(file.stat().st_size for file in files))
    except NetworkError as error:
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
