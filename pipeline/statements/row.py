"""Row of the table of statements: what a file may say, and what is done about it.

A statement is *honoured* as its format defines it, *refused*, or *noted* and left out. The last two
happen only where it differs from its default. What is in no row is noted. Pictures and videos have
their rows in `rows`, meshes in `stimuli.scenes.mesh_features`; the pages of docs show them all.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from pipeline.errors import InputError

Treatment = Literal["honoured", "refused", "noted"]
Use = Literal["colour", "numbers"]
Judge = Callable[[Any, Mapping[str, Any]], str | None]


@dataclass(frozen=True)
class Row:
    """A line of the table.

    Parameters
    ----------
    of : str
        Format, or part of one, whose statements these are.
    names : str
        Pattern of whole names of statements.
    verdict : Verdict
        What is done where it is not at its default.
    words : str
        Of what is refused, what must hold, and behind a semicolon the cure; of the rest, what it
        says or what happens. Empty: it changes nothing, and the page of docs leaves it out.
    judge : optional
        From a value and all statements beside it to what they say, in words; None at the default.
        Without one, a statement is never at its default.
    use : sequence of Use
        What a file is read for, where this row counts.
    """

    of: str
    names: str
    verdict: Treatment
    words: str = ""
    judge: Judge | None = None
    use: Sequence[Use] = ("colour", "numbers")

    def said(self, path: Path, found: str, cure: str = "") -> str:
        """Return the note of what a file says; `cure` stands for the row's.

        Raises
        ------
        InputError
            If the row refuses it.
        """
        if self.verdict == "refused":
            raise self.error(path, found, cure)
        return f"{found}: {self.words}"

    def error(self, path: Path, found: str, cure: str = "") -> InputError:
        """Return the error of what must not be said; `cure` stands for the row's."""
        must, _, own = self.words.partition("; ")
        return InputError(f"{path}: {must} ({found}); {cure or own}")


def but(words: str, *defaults: object) -> Judge:
    """Return the judge of a value that has these defaults."""
    return lambda value, _all: None if value in defaults else words.format(value)


def rows_about(rows: Iterable[Row], of: str, name: str) -> list[Row]:
    """Return the rows about a statement; none about one that is not known."""
    return [row for row in rows if row.of == of and re.fullmatch(row.names, name)]


def table(rows: Iterable[Row]) -> str:
    """Return rows as a table in Markdown, but those that change nothing."""
    lines = ["| of | statement | is | what |", "| --- | --- | --- | --- |"]
    for row in rows:
        if row.words:
            names = ", ".join(_shown(row.of, name) for name in row.names.split("|"))
            use = f" in {row.use[0]}" if len(row.use) == 1 else ""
            words = row.words.partition("; ")[0] if row.verdict == "refused" else row.words
            lines.append(f"| {row.of} | {names} | {row.verdict}{use} | {words} |")
    return "\n".join(lines)


def _shown(of: str, name: str) -> str:
    """Return a name as people write it: those of machines as code, with n for a number."""
    plain = name.replace(r"\d+", "n").replace(".*", "*")
    return plain if " " in plain or of.startswith("video") else f"`{plain}`"
