"""Results of a browser study are read: archives of JATOS, texts of lines, folders of such.

What is whole is kept, wherever it stands. A file that cannot be read is named, and costs no other.
"""

from __future__ import annotations

import io
import os
import re
import zipfile
import zlib
from collections import defaultdict
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from json import JSONDecoder
from pathlib import Path

from pydantic import ValidationError

from protocols.browser.shared_links import Mark
from protocols.browser.web_lines import LINE, AnyLine, ResumeLine, StartLine
from protocols.browser.web_study import STUDY_FILE
from protocols.disk.whole_file import decoded_text, read_bytes
from protocols.errors import StudyError
from protocols.limits import LIMITS_VARIABLE, check_within, limit
from protocols.outside import check_zip, reading, shown
from protocols.study_file.problems import in_words
from study_app.web.histories import TreeLine, unpacked_line
from study_app.web.senders import METADATA, Senders

_BEGINNING = re.compile(r'(?=\{"study":)')
"""Beginning of a line: within its texts quotes are escaped."""
_PARTS = re.compile(rb'(?=\{"study":|\xff\xfe\{\0"\0|\xfe\xff\0\{\0"|\xef\xbb\xbf\{")')
"""Beginning of a line in UTF-8, or of a text with a mark: texts are joined however encoded."""
_PIECE = 1 << 16
_SHOWN = 20
"""Damaged lines that are named."""
_LONGEST = 1 << 23
"""Characters of a line: an attempt of six hours."""
_BEGINNINGS = (
    b'{"study":',
    b'{\0"\0s\0',
    b'\0{\0"\0s',
    b"\xff\xfe{\0",
    b"\xfe\xff\0{",
    b'\xef\xbb\xbf{"',
)
_BLANK = "\ufeff\0 \t\r\n\v\f"
_GOES_ON = "trailing characters"
_EXPORTED = (
    "{}: must be results that browsers sent (this is the exported study); name what JATOS exports"
    " as results, or the files that participants saved"
)
_ARCHIVES = (".zip", ".jrzip", ".gz", ".tar", ".7z", ".rar")


class ContradictionError(StudyError):
    """Lines of one participant that cannot be a session of this study."""


@dataclass
class ParticipantLines:
    """All lines of one participant of a study, packed: one archive may hold gigabytes of them."""

    told: dict[int, list[bytes]] = field(default_factory=lambda: defaultdict(list))
    """All different lines of each number."""
    repeated: int = 0
    """Lines that came more than once, and said the same."""
    simulated: bool = False
    """True if a line says that an artificial observer drove the page."""
    places: set[str] = field(default_factory=set)
    """Texts in which they stand."""

    def add(self, line: AnyLine, text: bytes) -> None:
        """Take a line, unless it is there already, or many others have its number."""
        if isinstance(line, StartLine | ResumeLine):
            self.simulated |= line.machine.simulated
        packed, there = zlib.compress(text, 1), self.told[line.n]
        if packed in there:
            self.repeated += 1
        elif len(there) < _SHOWN:
            if any(unpacked_line(one) == line for one in there):
                self.repeated += 1
            else:
                there.append(packed)


@dataclass
class BrowserResults:
    """Lines of results by study and participant, and what is no line."""

    found: dict[tuple[str, str], ParticipantLines] = field(
        default_factory=lambda: defaultdict(ParticipantLines)
    )
    damaged: list[str] = field(default_factory=list)
    """Places where something stands that is no line of ours, and what: the first of them."""
    damages: int = 0
    """Number of such places."""
    unread: list[str] = field(default_factory=list)
    """Files, and parts of archives, that could not be read, and why."""
    notes: list[str] = field(default_factory=list)
    senders: Senders = field(default_factory=Senders)

    def marks(self, found: ParticipantLines) -> set[Mark]:
        """Return the results and workers of JATOS by which a participant's lines came."""
        return set[Mark]().union(*map(self.senders.marks, found.places))

    def read(self, name: str, data: bytes, place: str = "") -> None:
        """Read the lines of one text, by its name for messages and its place.

        Results may be joined without a line feed where a page died in the middle of a line; what is
        whole is kept.

        Raises
        ------
        StudyError
            If there are more lines than the limit allows.
        """
        name = shown(name)
        check_within("events", _most_lines(data), StudyError, Path(name), "lines")
        number, notes = 1, list[str]()
        for part in _PARTS.split(data):
            for row, text in enumerate(_lines_in(part, notes)):
                number += row > 0
                for piece in _BEGINNING.split(text):
                    if line := piece.strip(_BLANK):
                        self._take(line, f"{name}: line {number}", place)
        self.notes += [f"{name}: {note}" for note in notes][: max(0, _SHOWN - len(self.notes))]

    def _take(self, text: str, where: str, place: str) -> None:
        """Take a line. Behind one that is whole may stand the end of another."""
        line, wrong = _line_of(text)
        if line is None and _GOES_ON in wrong:
            text = text[: _end_of_object(text)]
            line = _line_of(text)[0]
        if wrong:
            self.damages += 1
            self.damaged += [f"{where}: {wrong}"][: _SHOWN - len(self.damaged)]
        if line is not None:
            found = self.found[line.study, line.participant]
            found.add(line, text.encode("utf-8"))
            found.places.add(place)


def _most_lines(data: bytes) -> int:
    """Return the number of lines that a text can hold, joined or not."""
    return max(data.count(b"\n"), sum(map(data.count, _BEGINNINGS)))


def _lines_in(part: bytes, notes: list[str]) -> Iterator[str]:
    """Yield the lines of a part; one that is too long is cut, since letters take up to 4 bytes."""
    if 0 in part[:200]:  # UTF-16, or no text
        yield from decoded_text(part, notes).split("\n")
        return
    for line in part.split(b"\n"):
        yield decoded_text(line[: _LONGEST + 1].strip(b"\0"), notes)


def _line_of(text: str) -> tuple[AnyLine | None, str]:
    """Return a line, or why the text is none."""
    if len(text) > _LONGEST:
        return None, f"line: must have at most {_LONGEST:,} characters (has more)"
    try:
        return LINE.validate_json(text), ""
    except ValidationError as error:
        if (count := error.error_count()) > _SHOWN:
            return None, f"line: must be one of the page's ({count:,} faults in it)"
        problem = error.errors(include_url=False)[0]
        place = ".".join(map(str, problem["loc"])) or "line"
        return None, shown(f"{place}: {in_words(problem)}")


def _end_of_object(text: str) -> int:
    """Return the end of the object at the beginning of a text; 0 where there is none."""
    try:
        return JSONDecoder().raw_decode(text)[1]
    except (ValueError, RecursionError):
        return 0


def read_web_results(paths: Iterable[Path]) -> BrowserResults:
    """Read results: archives of JATOS, texts of lines, folders of such.

    Raises
    ------
    StudyError
        If nothing could be read of what is there.
    """
    inbox = BrowserResults()
    for path in paths:
        for file in _files_in(path, inbox) if _surely(path.is_dir) else [path]:
            try:
                _read_file(file, inbox)
            except StudyError as error:
                inbox.unread.append(str(error))
    if inbox.unread and not inbox.found:
        raise StudyError("\n".join(inbox.unread))
    return inbox


def _files_in(folder: Path, inbox: BrowserResults) -> Iterator[Path]:
    """Yield all files below a folder; what cannot be read is named."""

    def refused(error: OSError) -> None:
        what = f"{error.filename}: must be a folder that can be read ({error.strerror})"
        inbox.unread.append(f"{what}; change its permissions")

    for place, folders, names in os.walk(folder, onerror=refused):
        if STUDY_FILE in names:
            inbox.unread.append(_EXPORTED.format(place))
            folders.clear()
            continue
        folders.sort()
        for path in sorted(Path(place, name) for name in (*folders, *names)):
            if path.is_symlink() and _surely(path.is_dir):
                inbox.unread.append(f"{path}: must be no link to a folder; name that folder itself")
            elif _surely(path.is_file):
                yield path
            elif path.name in names:
                inbox.unread.append(
                    f"{path}: must be a file (it is a socket, a device, or a link to nothing);"
                    " move it out of the folder"
                )


def _surely(ask: Callable[[], bool]) -> bool:
    """Return True if the disk says so; False, too, where it says nothing."""
    with suppress(OSError):
        return ask()
    return False


def _read_file(path: Path, inbox: BrowserResults) -> None:
    data = read_bytes(path, "results of a browser study", "table")
    if data[:1] == b"{" and b'"default_language":' in data:
        raise StudyError(_EXPORTED.format(path))
    if data[:2] != b"PK":  # as every archive begins, and no line
        _take_text(inbox, path.name, data, path.as_posix())
        return
    with reading(path, "an archive that can be read", StudyError, "download it again"):
        check_zip(path, io.BytesIO(data), StudyError)
        archive = zipfile.ZipFile(io.BytesIO(data))
    left, lines = limit("unpacked"), 0
    if any(re.fullmatch(r"[^/]+\.jas", entry.filename) for entry in archive.infolist()):
        raise StudyError(_EXPORTED.format(path))
    refused = list[str]()
    for entry in sorted(archive.infolist(), key=lambda one: one.file_size):  # floods come last
        if not entry.filename.lower().endswith((".txt", METADATA, *_ARCHIVES)):
            continue
        place = Path(f"{path}: {shown(entry.filename)}")
        try:
            text = _unpacked(archive, entry, place, min(left, limit("table")))
            left, more = left - len(text), lines + _most_lines(text)
            check_within("events", more, StudyError, place, "lines with those before")
            _take_text(inbox, f"{path.name}: {entry.filename}", text, entry.filename)
            lines = more
        except StudyError as error:
            refused.append(str(error))
    inbox.unread += refused[:_SHOWN]
    if len(refused) > _SHOWN:
        inbox.unread.append(f"{path}: {len(refused) - _SHOWN:,} more parts were not read")


def _take_text(inbox: BrowserResults, name: str, text: bytes, place: str) -> None:
    if not place.endswith(METADATA) or "comp-result_" in place:  # who takes part sends files, too
        inbox.read(name, text, place)
    elif not inbox.senders.read(text):
        inbox.notes.append(f"{shown(name)}: not as JATOS writes it; workers are not known")


def _unpacked(archive: zipfile.ZipFile, entry: zipfile.ZipInfo, place: Path, most: int) -> bytes:
    """Return an entry of an archive, as long as it does not grow beyond `most` bytes.

    Raises
    ------
    StudyError
        If it is damaged, grows larger, or is no text.
    """
    if entry.filename.lower().endswith(_ARCHIVES):
        raise StudyError(f"{place}: must be a text (it is an archive); unpack it, and name it")
    deflated = entry.compress_type in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED)
    if entry.flag_bits & 1 or not deflated:  # others cannot be unpacked piece by piece
        raise StudyError(
            f"{place}: must be deflated, and not encrypted, as JATOS does it; unpack the archive,"
            " and name the folder"
        )
    text, must = bytearray(), "a whole text"
    cure = "download the archive again"
    with reading(place, must, StudyError, cure), archive.open(entry) as file:
        while (piece := file.read(_PIECE)) and len(text) <= most:
            text += piece
    if len(text) > most:
        raise StudyError(
            f"{place}: must unpack to at most {most:,} bytes (it holds more); if it is right,"
            f" unpack the archive, name the folder, and allow more by"
            f" {LIMITS_VARIABLE}=table=NUMBER"
        )
    return bytes(text)


def whole_lines(history: Sequence[TreeLine]) -> Iterator[AnyLine]:
    """Return the lines of a history in order.

    Raises
    ------
    ContradictionError
        If the first one, or one between, has not come.
    """
    count = history[-1].n + 1
    gaps: list[str] = []
    due = 0
    for n in (place.n for place in history):
        if n > due:
            gaps.append(f"{due}" if n == due + 1 else f"{due} to {n - 1}")
        due = n + 1
    if gaps:
        some = ", ".join(gaps[:5]) + (", ..." if len(gaps) > 5 else "")
        raise ContradictionError(
            f"{count - len(history):,} of {count:,} lines have not come (numbers {some}); ask"
            " the server for the rest of the results, or the participant for the local copy"
        )
    return (unpacked_line(place.packed) for place in history)
