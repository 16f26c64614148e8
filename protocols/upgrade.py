"""Rewrites a study file of format 1 as one of format 2, comments and order kept."""

from __future__ import annotations

import re
import tomllib
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

from protocols.errors import StudyError
from protocols.load import decode_utf8, protocol_of, read_bytes, read_toml

_HEADER = re.compile(r"\s*\[\[?\s*([\w.\- ]+?)\s*\]\]?\s*(#.*)?$")
_KEY = re.compile(r"\s*(#\? )?([\w-]+)\s*=")
_MOVED = {"scenes", "sizes", "methods", "clips"}


@dataclass
class _Part:
    """A header with the entries below it; an entry is a key's lines with the comments above."""

    name: str
    lines: list[str]
    entries: list[tuple[str, list[str]]] = field(default_factory=list)


def upgraded_text(path: Path) -> str:
    """Return a study file in format 2.

    Raises
    ------
    StudyError
        If the file has mistakes, is of format 2 already, or is laid out in a way that cannot be
        rewritten line by line.
    """
    raw = read_toml(path)
    if raw.get("format") != 1:
        raise StudyError(f"{path}: format: must be 1 to be upgraded (got {raw.get('format')!r})")
    before = protocol_of(raw, path)
    text = rewritten(decode_utf8(read_bytes(path, "the study"), path))
    try:
        after = protocol_of(_tuples(tomllib.loads(text)), path)
        same = after.model_copy(update={"format": 1}) == before
    except (tomllib.TOMLDecodeError, StudyError):
        same = False
    if not same:
        raise StudyError(
            f"{path}: cannot be rewritten line by line; give each section its own [header] and"
            " each key its own line, then upgrade again (a file of format 1 works as it is)"
        )
    return text


def rewritten(text: str) -> str:
    """Return a text of format 1 in format 2; what it says is not checked."""
    parts = list(_parts(text.splitlines()))
    named = {part.name: part for part in parts}
    task: list[str] = []
    for section, keys in (("design", ("pairings", "catch")), ("trial", ("gap_s", "kind"))):
        for key in keys:
            for lines in _taken(named.get(section), key):
                if key == "catch":
                    lines[-1] = re.sub(
                        r"\bsize = (\"[^\"]*\")", r"where = { size = \1 }", lines[-1]
                    )
                if key != "kind":
                    task += lines
    _merge(named.get("response"), ("left_keys", "right_keys"), "keys = [{}, {}]")
    done: set[str] = set()
    out: list[str] = []
    for part in parts:
        root, _, rest = part.name.partition(".")
        if re.fullmatch(r"text\.languages\.[\w-]+", part.name):
            _merge(part, ("first", "second"), "answers = {{ first = {}, second = {} }}")
        if root in _MOVED and "stimuli" not in done:
            done.add("stimuli")
            out += _before(part, ["[stimuli]", 'kind = "warped-clips"', ""])
        if part.name == "design":
            out += _before(part, ["[task]", 'kind = "two-interval"', *task, ""])
        if part.name == "design.catch":
            for _, lines in part.entries:
                lines[-1] = re.sub(r"^size = (.*)$", r"where = { size = \1 }", lines[-1])
        out += [_renamed(line, root, rest) for line in part.lines]
        if part.name == "analysis":
            out.append('kind = "preference"')
        for key, lines in part.entries:
            old = part.name == "" and key == "format"
            out += [re.sub(r"=\s*1\b", "= 2", line) for line in lines] if old else lines
    return "\n".join(out).rstrip("\n") + "\n"


def _renamed(line: str, root: str, rest: str) -> str:
    if root in _MOVED:
        return re.sub(rf"(\[\[?\s*){root}", rf"\1stimuli.{root}", line)
    if (root, rest) == ("design", "catch"):
        return line.replace("design.catch", "task.catch")
    return line


def _before(part: _Part, lines: list[str]) -> list[str]:
    """Return `lines`, to stand above a part: below the comments that stand above its header."""
    above = [line for line in part.lines if not _HEADER.match(line)]
    part.lines = part.lines[len(above) :]
    return [*above, *lines]


def _taken(part: _Part | None, key: str) -> list[list[str]]:
    """Take the entries of a key out of a part."""
    if part is None:
        return []
    found = [lines for name, lines in part.entries if name == key]
    part.entries = [entry for entry in part.entries if entry[0] != key]
    return found


def _merge(part: _Part | None, keys: tuple[str, str], form: str) -> None:
    """Make one entry of two, in the place of the first."""
    if part is None or not set(keys) <= {name for name, _ in part.entries}:
        return
    values = {name: lines for name, lines in part.entries if name in keys}
    said = ["\n".join(values[key]).partition("=")[2].strip().partition("  #")[0] for key in keys]
    comments = [line for key in keys for line in values[key] if line.lstrip().startswith("#")]
    place = next(i for i, (name, _) in enumerate(part.entries) if name in keys)
    part.entries[place] = ("merged", [*comments, form.format(*said)])
    part.entries = [entry for entry in part.entries if entry[0] not in keys]


def _parts(lines: list[str]) -> Iterator[_Part]:
    """Split a file at its headers; the comments right above a header belong to it."""
    part, waiting = _Part("", []), list[str]()
    place = 0
    while place < len(lines):
        line = lines[place]
        header, key = _HEADER.match(line), _KEY.match(line)
        if header:
            yield part
            part, waiting = _Part(header[1].replace(" ", ""), [*waiting, line]), []
        elif key and not line.lstrip().startswith("#"):
            size = _length(lines, place)
            part.entries.append((key[2], [*waiting, *lines[place : place + size]]))
            waiting, place = [], place + size - 1
        else:
            waiting.append(line)
        place += 1
    part.entries.append(("", waiting))
    yield part


def _length(lines: list[str], first: int) -> int:
    """Return how many lines the entry that begins at `first` has."""
    for size in range(1, len(lines) - first + 1):
        try:
            tomllib.loads("\n".join(lines[first : first + size]))
        except tomllib.TOMLDecodeError:
            continue
        return size
    return 1


def _tuples(value: dict[str, object]) -> dict[str, object]:
    def frozen(entry: object) -> object:
        if isinstance(entry, dict):
            return {key: frozen(inner) for key, inner in entry.items()}
        return tuple(map(frozen, entry)) if isinstance(entry, list) else entry

    return {key: frozen(entry) for key, entry in value.items()}
