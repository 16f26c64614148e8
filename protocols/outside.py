"""Files and texts from outside, met in one way: limits, libraries' messages, hostile text.

Every package shares this module, `pipeline` too; so it imports nothing of ours, and is told which
exception its caller raises.
"""

from __future__ import annotations

import errno
import json
import os
import re
import stat
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import IO, Any

from protocols.gone import moved
from protocols.limits import check_within, limit

CONTROL = re.compile(r"[\x00-\x08\x0b\x0c\x0e-\x1f\x7f]")
"""Characters that no text of a user's needs, and XML does not allow."""
FORMULA = re.compile("'*[-=+@\x00-\x1f\x7f]")
"""Beginning of a cell that a spreadsheet would run, or that looks as if made safe already."""
_ZIP_TAIL = (1 << 16) + 200
"""Bytes at the end of a zip file, of which the last 65,535 may be a comment."""
_ZIP_ENTRY = 46 + 64
"""Bytes of a member in the list of a zip file: its header, and a name."""
OURS = ("protocols", "pipeline", "stimuli", "study_app", "analysis")
"""Packages of ours, whose modules a plug-in may import."""
_KEPT = {0x09, 0x0A}
_TURNS = {*range(0x202A, 0x202F), *range(0x2066, 0x206A), 0x200E, 0x200F, 0x061C}
_HIDDEN = {*range(0x20), *range(0x7F, 0xA0), *_TURNS, 0x2028, 0x2029, 0xFEFF} - _KEPT
_NO_CHARACTERS = {*range(0xD800, 0xE000), 0xFFFE, 0xFFFF}
_NOT_IN_XML = {*range(0x20), *_NO_CHARACTERS} - _KEPT - {0x0D}
_VISIBLE = {code: ascii(chr(code))[1:-1] for code in (*_HIDDEN, *_NO_CHARACTERS)}

_ON_PAGES = {code: ascii(chr(code))[1:-1] for code in _NOT_IN_XML}
_MARKDOWN = re.compile(r"<(?=[A-Za-z/!?])|\](?=[(\[:])|\|")
"""Beginnings of HTML, a link, a picture or another cell in Markdown."""


def bounded_bytes(path: Path, error: type[Exception], name: str = "text") -> bytes:
    """Return the content of a file that has to be read whole, if a limit allows its size.

    Raises
    ------
    error
        If it is larger.
    OSError
        As reading does.
    """
    with path.open("rb") as file:
        found = os.fstat(file.fileno())
        check_within(name, found.st_size, error, path, "bytes")
        if stat.S_ISREG(found.st_mode):
            return file.read()
        data = file.read(limit(name) + 1)  # a device ends nowhere
        check_within(name, len(data), error, path, "bytes")
        return data


def lines_of(text: str) -> Iterator[str]:
    """Yield the lines of a text with their ends, without the copy that takes four times more."""
    place = 0
    while place < len(text):
        end = text.find("\n", place) + 1 or len(text)
        yield text[place:end]
        place = end


def parsed_json(
    path: Path, data: bytes, what: str, error: type[Exception], cure: str = "copy it again"
) -> Any:
    """Return the value of JSON in UTF-8; `path`, `what`, `error` and `cure` as in `reading`."""
    count = sum(data.count(mark) for mark in (b",", b"[", b"{"))
    check_within("cells", count, error, path, "values")
    with reading(path, what, error, cure):
        return json.loads(data)


def check_zip(path: Path, file: IO[bytes], error: type[Exception]) -> None:
    """Refuse a zip file whose list of members is too long to be read; it stands at its end.

    Raises
    ------
    error
        With the count, the limit and how to raise it.
    """
    size = file.seek(0, os.SEEK_END)
    file.seek(-min(size, _ZIP_TAIL), os.SEEK_END)
    tail = file.read()
    file.seek(0)
    place, place_64 = tail.rfind(b"PK\x05\x06"), tail.rfind(b"PK\x06\x06")
    stated = int.from_bytes(tail[place + 12 : place + 16], "little") if place >= 0 else 0
    if place_64 >= 0:
        stated = max(stated, int.from_bytes(tail[place_64 + 40 : place_64 + 48], "little"))
    # What it states may be more than there is, and then it is damaged.
    check_within("files", min(stated, size) // _ZIP_ENTRY, error, path, "files", "hold")


@contextmanager
def reading(
    path: Path, what: str, error: type[Exception], cure: str = "export or copy it again"
) -> Iterator[None]:
    """Turn whatever a library raises about a user's file into one message.

    Parameters
    ----------
    path : Path
        The file.
    what : str
        What it must be: ``a glTF 2.0 file``.
    error : type of Exception
        What is raised in place of everything but what says enough by itself: this exception,
        and those of the file system.
    """
    try:
        yield
    except error:
        raise
    except RecursionError:
        raise error(f"{path}: must be {what} (its brackets lie too deep)") from None
    except MemoryError:
        raise error(f"{path}: is too large for this machine's memory") from None
    except Exception as found:
        if isinstance(found, OSError) and (found.filename or found.errno == errno.EIO):
            raise  # what libraries make of a file's contents names no file
        reason = visible_line(str(found) or type(found).__name__)
        raise error(f"{path}: must be {what} (its reader says: {reason}); {cure}") from found


@contextmanager
def plug_in(owner: str, name: str, group: str, error: type[Exception]) -> Iterator[None]:
    """Turn whatever a plug-in raises while it is loaded into one message; only Ctrl-C goes on."""
    try:
        yield
    except KeyboardInterrupt:
        raise
    except BaseException as found:
        lost = isinstance(found, ImportError) and (found.name or "").split(".")[0] in OURS
        cure = " it by docs/from-0.3-to-0.4.md, which says what went or moved," * lost
        raise error(
            f"package {owner!r}: its plug-in {name!r} of metamerlab.{group} must load"
            f" ({type(found).__name__}: {visible_line(str(found))}{moved(found)}); mend{cure} or"
            " uninstall the package"
        ) from found


def visible(text: str) -> str:
    """Return a text with control characters, turns of direction and half characters spelt out."""
    return text.translate(_VISIBLE)


def visible_line(message: str) -> str:
    """Return the first line of what a library says, without what no terminal can show."""
    return shown(next(iter(message.strip().splitlines()), "no reason given")).rstrip(".")


def shown(found: object) -> str:
    """Return a value that was found as one line of a message: nothing hidden, cut short."""
    text = str(found)[:200]
    return "".join(c if c.isprintable() else ascii(c)[1:-1] for c in text)[:200]


def page_bytes(text: str) -> bytes:
    """Return a page, SVG or Markdown as UTF-8, with what XML and UTF-8 cannot hold spelt out."""
    return text.translate(_ON_PAGES).encode("utf-8")


def inline_svg(svg: bytes, name: str, title: str) -> str:
    """Return an SVG file as an element for HTML: own names inside, a title for screen readers."""
    text = svg.decode("utf-8")
    text = text[text.index("<svg") :]
    # Names must differ between the figures of one page.
    text = re.sub(r'\bid="', f'id="{name}-', text)
    text = re.sub(r"url\(#", f"url(#{name}-", text)
    text = re.sub(r'(xlink:href|href)="#', rf'\1="#{name}-', text)
    text = re.sub(r"<metadata>.*?</metadata>", "", text, flags=re.DOTALL)
    escaped = title.replace("&", "&amp;").replace("<", "&lt;").replace('"', "&quot;")
    return text.replace("<svg ", f'<svg role="img" aria-label="{escaped}" ', 1)


def json_bytes(text: str) -> bytes:
    """Return JSON as UTF-8; half characters, as file names may have them, become escapes."""
    return text.encode("utf-8", "backslashreplace")


def markdown(text: str) -> str:
    """Return a text as a part of Markdown that is no HTML, link, picture or cell there."""
    return _MARKDOWN.sub(r"\\\g<0>", text)


def safe_cell(value: object) -> object:
    """Return a cell that no spreadsheet takes for a formula; what is no text stays as it is."""
    return "'" + value if isinstance(value, str) and FORMULA.match(value) else value


def original_cell(text: str) -> str:
    """Return the text that `safe_cell` was given."""
    return text[1:] if text.startswith("'") and FORMULA.match(text) else text
