"""Reads files whole; one message says why one is not read."""

from __future__ import annotations

from difflib import get_close_matches
from pathlib import Path

from protocols.errors import StudyError
from protocols.outside import bounded_bytes

_BESIDE_MOST = 1000
"""Files of a folder among which a name is looked for."""


def read_bytes(path: Path, what: str, name: str = "text") -> bytes:
    """Read a file, if the limit `name` allows its size; `StudyError` says why it is not read."""
    try:
        return bounded_bytes(path, StudyError, name)
    except FileNotFoundError:
        cure = _near(path)
        raise StudyError(f"{path}: {what} must exist (there is no such file); {cure}") from None
    except IsADirectoryError:
        inside = [str(file) for file in sorted(path.glob("*.toml"))] if name == "toml" else []
        cure = f"name {' or '.join(inside)}" if inside else "name the file in it"
        raise StudyError(f"{path}: {what} must be a file (this is a folder); {cure}") from None
    except OSError as error:
        raise StudyError(f"{path}: {what} must be readable ({error.strerror})") from None


def _near(path: Path) -> str:
    """Return the cure for a missing file: one beside it may be meant."""
    try:
        beside = [file.name for file in path.parent.iterdir()]
    except OSError:
        beside = []
    near = get_close_matches(path.name, beside[:_BESIDE_MOST], 1)
    return f"did you mean {path.with_name(near[0])}?" if near else "check the path"


def decode_utf8(data: bytes, path: Path) -> str:
    """Decode; `StudyError` names the line and the byte that are not UTF-8, or says it is no text.

    What holds a zero byte is no text, unless it begins as UTF-16 does.
    """
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        if b"\0" in data[:4096] and not data.startswith((b"\xff\xfe", b"\xfe\xff")):
            raise StudyError(
                f"{path}: must be a text file (it holds other data, as pictures and archives do);"
                " check which file is named"
            ) from None
        line = data.count(b"\n", 0, error.start) + 1
        raise StudyError(
            f"{path}: line {line}: must be UTF-8 text (got byte 0x{data[error.start]:02x});"
            " save the file as UTF-8"
        ) from None
