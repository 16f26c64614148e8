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
from pipeline.image_file import check_fits, check_flat, in_display_window
from pipeline.picture_limits import check_values
from pipeline.statements.check_statements import check_statements
from protocols.outside import reading, visible_line
from stimuli.media.channels import Planes


@dataclass(frozen=True)
class ExrParts:
    """Every channel of a file by name, half and float alike, and its first part's header.

    A channel of a part may be called by its own name or by ``PART.CHANNEL``; where several parts
    have a channel of that name, only by the second.
    """

    planes: Planes
    attributes: Mapping[str, Any]


def read_parts(path: Path, *, encoded: bool = False, judged: bool = False) -> ExrParts:
    """Read an OpenEXR file; all its parts count as one picture.

    Parameters
    ----------
    path : Path
    encoded : bool
        It was said to hold encoded colour.
    judged : bool
        What its header says has been looked at.

    Raises
    ------
    FileNotFoundError
        If there is no such file.
    InputError
        If it is not a whole image, its parts differ in size, or its header says what no reader
        honours (`pipeline.statements`).
    """
    if not path.is_file():
        raise FileNotFoundError(2, "No such file", str(path))
    with reading(path, "a whole image", InputError):  # names in its header may be no UTF-8
        check_fits(path, "read")
        file, kind = _read_parts(path)
        if not judged:
            check_statements(path, kind, file.attributes, ("colour", "numbers"), encoded=encoded)
        return file


def display_size(path: Path) -> tuple[int, int]:
    """Width and height of a file's display window, from its header alone.

    Raises
    ------
    InputError
        If it is no image.
    """
    with reading(path, "a whole image", InputError):
        source = oiio.ImageInput.open(str(path))
        if source is None:
            raise InputError(f"{path}: must be an image ({visible_line(oiio.geterror())})")
        spec = source.spec()
        source.close()
        return spec.full_width, spec.full_height


def _read_parts(path: Path) -> tuple[ExrParts, str]:
    source = oiio.ImageInput.open(str(path))
    if source is None:
        reason = visible_line(oiio.geterror())
        raise InputError(f"{path}: must be an image in OpenEXR format ({reason})")
    stored: list[tuple[str, str, NDArray[np.float32]]] = []  # of each channel: part, name, numbers
    attributes: dict[str, Any] = {}
    try:
        kind = source.format_name()
        part = values = 0
        while source.seek_subimage(part, 0):
            spec = source.spec()
            values += spec.width * spec.height * spec.nchannels
            check_values(path, values)
            check_flat(path, spec)
            label = spec.get_string_attribute("oiio:subimagename") or spec.get_string_attribute(
                "name"
            )
            attributes = attributes or {item.name: item.value for item in spec.extra_attribs}
            data = in_display_window(path, spec, kind, _part(path, source, spec, part))
            if stored and data.shape[:2] != stored[0][2].shape:
                height, width = stored[0][2].shape
                raise InputError(
                    f"{path}: its parts must have one size (got {width}x{height} and"
                    f" {data.shape[1]}x{data.shape[0]})"
                )
            taken = {entry[0] for entry in stored}
            label = label if label and label not in taken else f"part{part}"
            stored += [
                (label, name, np.ascontiguousarray(data[..., index]))
                for index, name in enumerate(spec.channelnames)
            ]
            part += 1
    finally:
        source.close()
    return ExrParts(_planes(stored), attributes), kind


def _part(path: Path, source: Any, spec: oiio.ImageSpec, part: int) -> NDArray[np.float32]:
    """Numbers of a part, shape (H, W, C); those of whole numbers as they are, not as shares."""
    data: Any = source.read_image(part, 0, 0, spec.nchannels, "float")
    whole = [
        index
        for index in range(spec.nchannels)
        if str(spec.channelformats[index] if spec.channelformats else spec.format) == "uint"
    ]
    plain = [source.read_image(part, 0, index, index + 1, "uint") for index in whole]
    if data is None or source.geterror() or any(plane is None for plane in plain):
        raise InputError(
            f"{path}: must be a whole image; the file is damaged or was cut short: copy or make it"
            " again"
        )
    data = np.asarray(data, np.float32).reshape(spec.height, spec.width, spec.nchannels)
    for index, plane in zip(whole, plain, strict=True):
        data[..., index] = np.asarray(plane).reshape(spec.height, spec.width)
    return np.asarray(data, np.float32)


def _planes(stored: list[tuple[str, str, NDArray[np.float32]]]) -> Planes:
    names = [name for _, name, _ in stored]
    several = len({part for part, _, _ in stored}) > 1
    planes = Planes()
    for part, name, plane in stored:
        full = f"{part}.{name}"
        key = full if names.count(name) > 1 else name
        planes[key] = planes.aliases[full] = plane
        if several:
            planes.parts[key] = part
    return planes


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
            f" {max(numbered)} ({len(missing)} missing, the first is {missing[0]});"
            " render what is missing, or copy the frames of one part into a folder of their own"
        )
    return [numbered[number] for number in sorted(numbered)]
