"""Blocks of a text about a study: paragraphs, lists and tables."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TypeAlias


@dataclass(frozen=True)
class Table:
    """Rows under a header."""

    header: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]


Block: TypeAlias = "str | list[str] | Table"


@dataclass(frozen=True)
class Section:
    """A heading with paragraphs, lists and tables."""

    title: str
    blocks: tuple[Block, ...]


def labelled(name: str, label: str | None) -> str:
    """Return a name with its label, where they differ."""
    return f"{label} ({name})" if label and label != name else name


def count_of(number: int, noun: str) -> str:
    """Return a number with its noun: ``1 participant``, ``2 participants``."""
    return f"{number} {noun}" + "s" * (number != 1)
