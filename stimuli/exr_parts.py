"""Reading OpenEXR files with every part, and finding the files of a sequence."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import OpenImageIO as oiio  # noqa: N813  its own documentation calls it so
from numpy.typing import NDArray

from pipeline.errors import InputError
from pipeline.image_file import check_fits
from pipeline.limits import check_values
from protocols.outside import reading, visible_line


@dataclass(frozen=True)
class Parts:
    """Every channel of a file by name, half and float alike, and its first part's header.

    A channel of a part may be called by its own name or by ``PART.CHANNEL``.
    """

    planes: dict[str, NDArray[np.float32]]
    attributes: Mapping[str, Any]


def read_parts(path: Path) -> Parts:
    """Read an OpenEXR file; all its parts count as one picture.

    Raises
    ------
    FileNotFoundError
        If there is no such file.
    InputError
        If it is not a whole image, or its parts differ in size.
    """
    if not path.is_file():
        raise FileNotFoundError(2, "No such file", str(path))
    with reading(path, "a whole image", InputError):  # names in its header may be no UTF-8
        check_fits(path, "read")
        return _read_parts(path)


def _read_parts(path: Path) -> Parts:
    source = oiio.ImageInput.open(str(path))
    if source is None:
        reason = visible_line(oiio.geterror())
        raise InputError(f"{path}: must be an image in OpenEXR format ({reason})")
    planes: dict[str, NDArray[np.float32]] = {}
    attributes: dict[str, Any] = {}
    size: tuple[int, int] | None = None
    try:
        part = values = 0
        while source.seek_subimage(part, 0):
            spec = source.spec()
            values += spec.width * spec.height * spec.nchannels
            check_values(path, values)
            data: Any = source.read_image(part, 0, 0, spec.nchannels, "float")
            if data is None or source.geterror():
                raise InputError(
                    f"{path}: must be a whole image; the file is damaged or was cut short:"
                    " copy or make it again"
                )
            if size is not None and (spec.height, spec.width) != size:
                raise InputError(
                    f"{path}: its parts must have one size (got {size[1]}x{size[0]} and"
                    f" {spec.width}x{spec.height})"
                )
            size = (spec.height, spec.width)
            attributes = attributes or {item.name: item.value for item in spec.extra_attribs}
            stored = np.asarray(data, np.float32).reshape(*size, spec.nchannels)
            label = spec.get_string_attribute("oiio:subimagename") or spec.get_string_attribute(
                "name"
            )
            for index, name in enumerate(spec.channelnames):
                plane = np.ascontiguousarray(stored[..., index])
                planes.setdefault(name, plane)
                if label:
                    planes.setdefault(f"{label}.{name}", plane)
            part += 1
    finally:
        source.close()
    return Parts(planes, attributes)


def frame_files(file: str, folder: Path) -> list[Path]:
    """Return the files of a sequence in order; ``####`` in `file` stands for the number.

    Raises
    ------
    FileNotFoundError
        If there is none.
    InputError
        If a number is missing in between.
    """
    match = re.search(r"#+", file)
    if match is None:
        if not (folder / file).is_file():
            raise FileNotFoundError(2, "No such file", str(folder / file))
        return [folder / file]
    head, tail = file[: match.start()], file[match.end() :]
    place = folder / Path(head).parent if "/" in head else folder
    name = re.compile(
        re.escape(Path(head).name if not head.endswith("/") else "")
        + rf"(\d{{{len(match[0])},}})" + re.escape(tail) + "$"
    )  # fmt: skip
    entries = sorted(place.iterdir()) if place.is_dir() else []
    numbered = {int(m[1]): e for e in entries if (m := name.fullmatch(e.name))}
    if not numbered:
        raise FileNotFoundError(2, "No such file", str(folder / file))
    missing = sorted(set(range(min(numbered), max(numbered) + 1)) - numbered.keys())
    if missing:
        raise InputError(
            f"{folder / file}: must have every frame from {min(numbered)} to"
            f" {max(numbered)} ({len(missing)} missing, the first is {missing[0]})"
        )
    return [numbered[number] for number in sorted(numbered)]
