"""Docstrings, texts below attributes, help texts and comments begin with their noun, or a verb.

A line in a list of functions, keys or options is found by its first word.
"""

import ast
import os
import re
from collections.abc import Iterator
from pathlib import Path

import pytest

PACKAGES = ("analysis", "pipeline", "protocols", "stimuli", "study_app")
FOLDERS = (*PACKAGES, "benchmarks", "script", "tests")

HEADS = "what|where|how|whether|which|who|whom|whose|why|when"
WORDS = rf"(?:(?:the|a|an|of|at|by|in)\s+)?(?:{HEADS})(?:ever)?\b"  # nor "The what", "By how"
VERBS = "return|yield|say|tell|give|compute"  # in packages: "Return what it is" names nothing
HEADLESS = re.compile(rf"\s*{WORDS}", re.IGNORECASE)
NAMELESS = re.compile(rf"\s*(?:of\s|(?:(?:{VERBS})s?\s+)?{WORDS})", re.IGNORECASE)  # nor "Of"
SUSPECT = re.compile(f"[\"']{NAMELESS.pattern}", re.IGNORECASE)  # of these alone we read the syntax
TITLED = {
    *("Column", "ResultColumn", "told"),
    *("ResultTable.of", "TableBlock.each", "TableBlock.of"),
}  # what readers see
COMMENT = re.compile(rf"(?://|\s*/\*\*) (?:{HEADS.title()})\b")


def text_of(node: ast.AST) -> str | None:
    """Return the text that an expression is, or that it begins with; None where it is none."""
    match node:
        case ast.Constant(value=str(text)):
            return text
        case ast.JoinedStr(values=[first, *_]) | ast.BinOp(left=first, op=ast.Add()):
            return text_of(first)
    return None


def first_texts(source: str) -> Iterator[tuple[int, str]]:
    """Yield line and text of docstrings, below attributes, of ``help=``, columns and tables."""
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Call) and ast.unparse(node.func) in TITLED:
            for given in node.args:
                if (text := text_of(given)) is not None:
                    yield given.lineno, text
        if isinstance(node, ast.keyword) and node.arg == "help":
            text = text_of(node.value)
            if text is not None:
                yield node.value.lineno, text
        body = getattr(node, "body", None)
        for statement in body if isinstance(body, list) else ():
            if isinstance(statement, ast.Expr) and (text := text_of(statement.value)) is not None:
                yield statement.lineno, text


def headless(source: str, words: re.Pattern[str] = NAMELESS) -> list[str]:
    """Return line and first words of every text that does not say what the thing is."""
    if not SUSPECT.search(source):
        return []
    return [
        f"{line}: {' '.join(text.split())[:60]}"
        for line, text in first_texts(source)
        if words.match(text)
    ]


def headless_comments(source: str) -> list[str]:
    """Return line and first words of such comments of TypeScript or GLSL, at a line's beginning."""
    return [
        f"{number}: {line.strip()[:60]}"
        for number, line in enumerate(source.splitlines(), 1)
        if COMMENT.match(line)
    ]


def found_in(path: Path, folder: str) -> list[str]:
    """Return the findings in a file of a folder; tests and scripts may return a what."""
    if path.suffix not in {".py", ".ts", ".glsl"}:
        return []
    source = path.read_text(encoding="utf-8")
    if path.suffix == ".py":
        return headless(source, NAMELESS if folder in PACKAGES else HEADLESS)
    return headless_comments(source)


def ours(repository: Path) -> Iterator[Path]:
    yield repository / "metamerlab.py"
    for top in FOLDERS:
        assert (repository / top).is_dir()
        for folder, folders, names in os.walk(repository / top):
            folders[:] = [name for name in folders if name != "node_modules"]
            yield from (Path(folder, name) for name in names)


def test_every_text_begins_with_its_noun(repository):
    found = [
        f"{inside}:{line}"
        for path in ours(repository)
        for inside in [path.relative_to(repository)]
        for line in found_in(path, inside.parts[0])
    ]

    assert not found, "\n".join(["say what it is: 'Share of ...', 'True if ...':", *found])


@pytest.mark.parametrize(
    "source",
    [
        '"""What is shared."""',
        'class Book:\n    """The what of it."""',
        'def _f():\n    """Whether it is so."""',
        'class A:\n    def f(self):\n        """\n        How often.\n        """',
        'class A:\n    b: int\n    """Which of them, from 0."""',
        'LIMIT = 3\n"""When it stops."""',
        'Option(help="where to write")',
        'Option(help=f"How many {name}.")',
        'Option(help="Whose " + name)',
        'Column("void", "text", "", f"Why {it} came again")',
        'TableBlock.each("How often", rows)',
        'def f():\n    """Return what holds."""',
        'def f():\n    """Yield the how of it."""',
        'def f():\n    """Says whether it is so."""',
    ],
)
def test_a_text_without_its_noun_is_caught(source):
    assert len(headless(source)) == 1


@pytest.mark.parametrize(
    "source",
    [
        '"""Share of what is shown."""',
        'def f():\n    """True if it is so."""',
        'def f():\n    """Tell the user which."""\n    print("What?")',
        'def f():\n    """Return True if it is so."""',
        'class A:\n    b: int\n    """Index of the row that is shown."""',
        '"""Whatsit of a bench."""',
        'Option(help="Folder where it is written.")',
    ],
)
def test_a_text_with_its_noun_passes(source):
    assert headless(source) == []


def test_a_comment_without_its_noun_is_caught():
    assert len(headless_comments("// Which vertex.\nint a;\n  /** How often. */\n")) == 2
    assert (
        headless_comments("// Vertex of what.\nint a;  // which\n  // What was kept may be.") == []
    )
