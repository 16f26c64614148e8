"""Results of a browser study are read: archives of JATOS, texts of lines, folders of such."""

from __future__ import annotations

import io
import re
import zipfile
import zlib
from collections import defaultdict
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from pathlib import Path

from pydantic import ValidationError

from protocols.browser.web_lines import LINE, AnyLine
from protocols.disk.whole_file import read_bytes
from protocols.errors import StudyError
from protocols.limits import check_within
from protocols.study_file.problems import in_words

_BEGINNING = re.compile(rb'(?=\{"study":)')
"""Beginning of a line: within its texts quotes are escaped."""


class ContradictionError(StudyError):
    """Lines of one participant that cannot be a session of this study."""


@dataclass
class ParticipantLines:
    """All lines of one participant of a study."""

    lines: dict[int, AnyLine] = field(default_factory=dict)
    repeated: int = 0
    """Lines that came more than once, and said the same."""
    conflicts: list[str] = field(default_factory=list)

    def add(self, line: AnyLine, where: str) -> None:
        """Take a line, unless it is there already."""
        there = self.lines.setdefault(line.n, line)
        if there is line:
            return
        if there == line:
            self.repeated += 1
        else:
            self.conflicts.append(f"{where}: line number {line.n} says two different things")


@dataclass
class BrowserResults:
    """Lines of results by study and participant, and what is no line."""

    found: dict[tuple[str, str], ParticipantLines] = field(
        default_factory=lambda: defaultdict(ParticipantLines)
    )
    damaged: list[str] = field(default_factory=list)
    """Places where something stands that is no line of ours, and what."""

    def read(self, name: str, data: bytes) -> None:
        """Read the lines of one text.

        Results may be joined without a line feed where a page died in the middle of a line; what is
        whole is kept.
        """
        check_within("events", data.count(b"\n"), StudyError, Path(name), "lines")
        rows = enumerate(data.split(b"\n"), 1)
        for number, text in ((n, text) for n, row in rows for text in _BEGINNING.split(row)):
            if not text.strip():
                continue
            where = f"{name}: line {number}"
            try:
                line = LINE.validate_json(text)
            except ValidationError as error:
                problem = error.errors()[0]
                place = ".".join(map(str, problem["loc"])) or "line"
                self.damaged.append(f"{where}: {place}: {in_words(problem)}")
            else:
                self.found[line.study, line.participant].add(line, where)


def read_web_results(paths: Iterable[Path]) -> BrowserResults:
    """Read results: archives of JATOS, texts of lines, folders of such.

    Raises
    ------
    StudyError
        If a file cannot be read, or an archive is damaged.
    """
    inbox = BrowserResults()
    for path in paths:
        if path.is_dir():
            for inside in sorted(one for one in path.rglob("*") if one.is_file()):
                _read_file(inside, inbox)
        else:
            _read_file(path, inbox)
    return inbox


def whole_lines(found: ParticipantLines) -> list[AnyLine]:
    """Return the lines of a participant in order.

    Raises
    ------
    ContradictionError
        If the first one, or one between, has not come.
    """
    count = max(found.lines) + 1
    missing = [n for n in range(count) if n not in found.lines]
    if missing:
        shown = ", ".join(map(str, missing[:5])) + (", ..." if len(missing) > 5 else "")
        raise ContradictionError(
            f"{len(missing)} of {count} lines have not come (numbers {shown}); ask the server for"
            " the rest of the results, or the participant for the local copy"
        )
    return [found.lines[n] for n in range(count)]


def _read_file(path: Path, inbox: BrowserResults) -> None:
    data = read_bytes(path, "results of a browser study", "table")
    if data[:2] != b"PK":  # as every archive begins, and no line
        inbox.read(path.name, data)
        return
    for name, text in _texts_of(path, data):
        inbox.read(f"{path.name}: {name}", text)


def _texts_of(path: Path, data: bytes) -> Iterator[tuple[str, bytes]]:
    """Yield the results in an archive of JATOS, of either layout.

    Raises
    ------
    StudyError
        If the archive is damaged, or grows too large.
    """
    try:
        with zipfile.ZipFile(io.BytesIO(data)) as archive:
            entries = [one for one in archive.infolist() if one.filename.endswith(".txt")]
            check_within(
                "unpacked", sum(one.file_size for one in entries), StudyError, path, "bytes"
            )
            for entry in entries:
                yield entry.filename, archive.read(entry)
    except (zipfile.BadZipFile, zlib.error, EOFError, NotImplementedError, RuntimeError) as error:
        raise StudyError(
            f"{path}: must be an archive that can be read ({error}); download it again"
        ) from None
