"""References in docstrings, comments and shaders lead to what is there."""

import ast
import re
import subprocess
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from fnmatch import fnmatch
from pathlib import PurePosixPath

import pytest

from protocols.study_file.schema import StudyProtocol

TOPS = ("analysis", "benchmarks", "pipeline", "protocols", "script", "stimuli", "study_app")
REFERENCE = re.compile(r"(?<!`)`([A-Za-z_][\w.]*)`(?!`)")
TWIN = re.compile(r"\bTwins?: (.+?)\.(?=\s|$)", re.DOTALL)
TWIN_WORD = re.compile(r"(\w+)\(\)|([\w*/.]+\.(?:py|glsl))|\bin (\w+/)(?!\w)")
SUFFIXES = ("csv", "exr", "glsl", "html", "json", "jsonl", "md", "png", "py", "toml", "zip")
SECTIONS = {*StudyProtocol.model_fields}
"""Sections of a study, whose keys stand in backticks like names: `response.timeout_s`."""
OUTSIDE = {"scene__size__method", "WIDTHxHEIGHT"}
"""Patterns of names and values, which stand in backticks like a name."""


@pytest.fixture(scope="module")
def sources(repository) -> dict[str, str]:
    """Text of every tracked source of ours, by path."""
    listed = subprocess.run(
        ["git", "-C", str(repository), "ls-files", "--", *TOPS, "metamerlab.py"],
        capture_output=True, text=True,
    )  # fmt: skip
    if listed.returncode:
        pytest.skip("this is no checkout")
    kinds = (".py", ".glsl", ".ts", ".toml", ".jinja", ".html")
    return {
        path: (repository / path).read_text(encoding="utf-8")
        for path in listed.stdout.splitlines()
        if path.endswith(kinds)
    }


@dataclass(frozen=True)
class Source:
    """A Python source, read once."""

    told: tuple[tuple[int, str], ...]
    """Line and text of every docstring, text below a name, and comment."""
    words: frozenset[str]
    """Names of the code, and words of its other texts."""
    members: frozenset[str]
    """Names that it defines or imports, anywhere."""


def read(source: str) -> Source:
    """Return what a source tells, names and defines."""
    told: list[tuple[int, str]] = []
    words: set[str] = set()
    members: set[str] = set()
    texts: dict[int, str] = {}
    for node in ast.walk(ast.parse(source)):  # a parent before its children
        match node:
            case ast.Expr(value=ast.Constant(value=str(text))):
                told.append((node.lineno, text))
                texts[id(node.value)] = ""
            case ast.Constant(value=str(text)):
                words.update(re.findall(r"\w+", texts.get(id(node), text)))
            case ast.Name(id=name, ctx=context):
                words.add(name)
                if isinstance(context, ast.Store):
                    members.add(name)
            case ast.Attribute(attr=name) | ast.arg(arg=name) | ast.keyword(arg=str(name)):
                words.add(name)
            case ast.FunctionDef(name=name) | ast.ClassDef(name=name):
                members.add(name)
            case ast.alias():
                members |= {*node.name.split("."), node.asname or node.name}
    for line, text in enumerate(source.splitlines(), 1):
        if "#" in text and "`" in text:
            told.append((line, text.partition("#")[2]))
    return Source((*told,), frozenset(words | members), frozenset(members))


def leads_nowhere(sources: Mapping[str, str]) -> list[str]:
    """Return every reference, ``file:line: name``, of which a word is nowhere in the code, or
    whose module or class has no such member."""
    python = {path: read(text) for path, text in sources.items() if path.endswith(".py")}
    known = {word for path in sources for word in re.findall(r"\w+", path)}
    known.update(*(one.words for one in python.values()))
    for path, text in sources.items():
        if path not in python:
            known.update(re.findall(r"\w+", text))
    modules = {
        path.removesuffix(".py").removesuffix("/__init__").replace("/", "."): one.members
        for path, one in python.items()
    }
    stems: dict[str, list[str]] = {}
    for name in modules:
        stems.setdefault(name.rpartition(".")[2], []).append(name)

    def is_there(parts: list[str]) -> bool:
        """Return False if the first parts name a module of ours that lacks the next one."""
        for many in range(len(parts), 0, -1):
            name = ".".join(parts[:many])
            homes = [name] if name in modules else stems.get(name, []) if many == 1 else []
            if homes and many < len(parts):
                return any(
                    parts[many] in modules[home] or f"{home}.{parts[many]}" in modules
                    for home in homes
                )
            if homes:
                return True
        return True

    found = []
    for path, source in python.items():
        for line, text in source.told:
            for reference in REFERENCE.findall(text):
                parts = reference.split(".")
                if reference in OUTSIDE or parts[-1] in SUFFIXES or parts[0] in SECTIONS:
                    continue
                if not known.issuperset(parts) or not is_there(parts):
                    found.append(f"{path}:{line}: {reference}")
    return found


def lost_twins(sources: Mapping[str, str]) -> list[str]:
    """Return every ``Twin:`` of a file whose function or file is not there."""
    found = []
    for path, source in sources.items():
        if not path.endswith((".py", ".glsl")):
            continue
        text = re.sub(r"\s*\n(?://)? *", " ", source)
        for said in TWIN.findall(text):
            names: list[str] = []
            words = TWIN_WORD.findall(said)
            folders = [folder for _, _, folder in words if folder]
            for name, place, _ in words:
                if name:
                    names.append(name)
                elif place:
                    homes = twin_files(sources, path, place, folders)
                    lacking = [one for one in names if not defines(one, sources, homes)]
                    names = []
                    if not homes or lacking:
                        found.append(f"{path}: {place} {' '.join(lacking)}".rstrip())
            found += [f"{path}: {one}" for one in names if not defines(one, sources, sources)]
    return found


def defines(name: str, sources: Mapping[str, str], paths: Iterable[str]) -> bool:
    """Return True if one of these files defines a function of that name."""
    defined = re.compile(rf"^ *(?:def|[a-z]\w*) {name}\(", re.MULTILINE)
    return any(defined.search(sources[path]) for path in paths)


def twin_files(sources: Mapping[str, str], path: str, place: str, folders: list[str]) -> list[str]:
    """Return the files that a ``Twin:`` in `path` means by `place`."""
    folder = PurePosixPath(path).parent
    starts = [
        folder,
        *folder.parents,
        PurePosixPath("pipeline"),
        PurePosixPath("pipeline/shaderlib"),
    ]
    for start in (*starts, *(one / named for one in starts for named in folders)):
        pattern = (start / place).as_posix()
        if homes := [one for one in sources if one != path and fnmatch(one, pattern)]:
            return homes
    return []


@pytest.mark.slow
def test_every_name_in_a_docstring_or_comment_is_in_the_code(sources):
    found = leads_nowhere(sources)
    assert not found, "\n".join(found)


def test_every_twin_of_a_shader_is_there(sources):
    assert sum("Twin: " in text for text in sources.values()) > 50
    assert lost_twins(sources) == []


PLANTED = {
    "pipeline/fill.py": '"""See `flow.moved` and `pipeline.flow.Flow.size`."""\n',
    "pipeline/flow.py": "def moved(): ...\nclass Flow:\n    size: int\n",
    "pipeline/shaders/fill.comp.glsl": "// Fill. Twin: moved() in flow.py. Change both.\n",
}


@pytest.mark.parametrize("reference", ["flow.gone", "gone", "pipeline.flow.gone", "Flow.gone"])
def test_a_reference_that_leads_nowhere_is_found(reference):
    assert leads_nowhere(PLANTED) == lost_twins(PLANTED) == []
    planted = PLANTED | {"pipeline/warp.py": f'"""See `{reference}`."""\n'}
    assert leads_nowhere(planted) == [f"pipeline/warp.py:1: {reference}"]


@pytest.mark.parametrize("twin", ["moved() in gone.py", "gone() in flow.py", "gone()", "gone.py"])
def test_a_twin_that_is_not_there_is_found(twin):
    planted = PLANTED | {"pipeline/shaders/warp.comp.glsl": f"// Warp. Twin: {twin}.\n"}
    (found,) = lost_twins(planted)
    assert found.startswith("pipeline/shaders/warp.comp.glsl: ")
