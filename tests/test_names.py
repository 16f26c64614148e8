"""Names of public classes, functions, types and modules stand for one thing each, everywhere."""

import ast
import re
from collections import Counter, defaultdict
from collections.abc import Mapping
from fnmatch import fnmatch
from pathlib import Path

import pytest

PRODUCTION = ("analysis", "pipeline", "protocols", "stimuli", "study_app", "metamerlab.py")

# Name -> (where it may stand, why it stands twice). This list may only shrink.
EXCEPTIONS = {
    "module base": (
        ("analysis/tasks/base.py", "protocols/*/base.py", "stimuli/recipes/base.py"),
        "what a plug-in of the folder is based on; the docs name each",
    ),
    "module errors": (
        ("pipeline/errors.py", "protocols/errors.py"),
        "the docs name both, and a pipeline knows no study",
    ),
    "module gpu": (("pipeline/*/gpu.py",), "each stage of the pipeline has one"),
    "module reference": (("pipeline/*/reference.py",), "each stage of the pipeline has one"),
    "module settings": (("pipeline/*/settings.py",), "a stage has one for both of its twins"),
    "function build": (
        ("stimuli/scenes/*.py", "stimuli/batch/build.py"),
        "the module of a scene has one, and a batch is built",
    ),
    "function measure": (("stimuli/score/*.py",), "the module of a metric has one"),
    "function statements": (("pipeline/video_header/*.py",), "each container has one"),
    "function next_level": (("protocols/adaptive/*.py",), "each adaptive rule has one"),
    "function pull": (("pipeline/*/reference.py",), "each fill by a pyramid defines its own"),
    "function push": (("pipeline/*/reference.py",), "each fill by a pyramid defines its own"),
}
MOST_EXCEPTIONS = 11
COMMANDS = "study_app/cli/"  # a command has the name of the function that it is about


def places_of_names(sources: Mapping[str, str]) -> dict[str, list[str]]:
    """Return where each public name stands, by ``class NAME``, ``function NAME``, ``module NAME``.

    A type, ``type NAME``, may be told in several places: they are those that tell it differently.

    Parameters
    ----------
    sources : mapping
        Text of each source file, by its path in the repository.
    """
    places = defaultdict(list)
    types: dict[str, dict[str, str]] = defaultdict(dict)
    for path, source in sources.items():
        stem = Path(path).stem
        if stem != "__init__":
            places[f"module {stem}"].append(path)
        for node in ast.parse(source).body:
            name = getattr(node, "name", "_")
            if isinstance(node, ast.ClassDef) and not name.startswith("_"):
                places[f"class {name}"].append(path)
            elif isinstance(node, ast.FunctionDef) and not name.startswith(("_", "test_")):
                places[f"function {name}"] += [path] * (not path.startswith(COMMANDS))
            elif told := type_told(node):
                types[told[0]].setdefault(told[1], path)
    return places | {f"type {name}": list(told.values()) for name, told in types.items()}


def type_told(node: ast.stmt) -> tuple[str, str] | None:
    """Return name and meaning of a public type, as ``Floats = NDArray[np.float64]`` tells it."""
    match node:
        case ast.Assign(targets=[ast.Name(id=name)], value=ast.Subscript() | ast.BinOp() as value):
            pass
        case ast.AnnAssign(target=ast.Name(id=name), annotation=ast.Name(id="TypeAlias")):
            value = node.value
        case _:
            return None
    capital = name[0].isupper() and not name.isupper()
    return (name, ast.unparse(value)) if capital else None


def taken_twice(sources: Mapping[str, str]) -> dict[str, list[str]]:
    """Return the places of every name that stands in more than one, the exceptions left out."""
    found = {}
    for name, places in places_of_names(sources).items():
        allowed, _why = EXCEPTIONS.get(name, ((), ""))
        other = [path for path in places if not any(fnmatch(path, one) for one in allowed)]
        if len(places) > 1 and other:
            found[name] = places
    return found


@pytest.fixture(scope="module")
def sources(repository):
    """Text of every production source, by path."""
    paths = [
        path
        for start in (repository / name for name in PRODUCTION)
        for path in (sorted(start.rglob("*.py")) if start.is_dir() else [start])
        if "node_modules" not in path.parts
    ]
    return {p.relative_to(repository).as_posix(): p.read_text(encoding="utf-8") for p in paths}


def test_no_name_is_taken_twice(sources):
    assert {path.partition("/")[0] for path in sources} == set(PRODUCTION)
    found = taken_twice(sources)
    assert not found, "\n".join(f"{name}: {', '.join(at)}" for name, at in found.items())


def test_every_exception_is_still_needed_and_none_was_added(sources):
    places = places_of_names(sources)

    assert [name for name in EXCEPTIONS if len(places[name]) < 2] == []
    for name, (allowed, _why) in EXCEPTIONS.items():
        for pattern in allowed:
            assert any(fnmatch(path, pattern) for path in places[name]), f"{name}: {pattern}"
    assert len(EXCEPTIONS) == MOST_EXCEPTIONS <= 20


def test_no_folder_has_more_files_than_can_be_seen_at_once(repository):
    files = Counter(
        path.parent.relative_to(repository).as_posix()
        for top in (*PRODUCTION, "benchmarks", "script", "tests")
        for path in (repository / top).rglob("*.py")
    )

    assert files["benchmarks"], "the folders of the repository are those that are counted"
    assert {folder: many for folder, many in files.items() if many > 30} == {}


def names_of_studies(source: str) -> set[str]:
    """Return the names of parameters and fields that hold a study, without a leading underscore."""
    arguments = [node for node in ast.walk(ast.parse(source)) if isinstance(node, ast.arg)]
    fields = [node for node in ast.walk(ast.parse(source)) if isinstance(node, ast.AnnAssign)]
    named = [(node.arg, node.annotation) for node in arguments]
    named += [(ast.unparse(node.target), node.annotation) for node in fields]
    return {
        name.lstrip("_")
        for name, stated in named
        if stated and ast.unparse(stated).removesuffix(" | None").strip("'") == "StudyProtocol"
    }


def test_a_study_is_called_study_everywhere(sources):
    named = {path: names_of_studies(source) for path, source in sources.items()}

    assert {path: names for path, names in named.items() if names - {"study"}} == {}
    assert any(named.values()), "a study is named somewhere"


@pytest.mark.parametrize("home", ["analysis/arrays.py", "pipeline/frame.py"])
def test_an_array_type_has_one_name_in_a_package(sources, home):
    named = re.compile(r"NDArray\[np\.(float64|int64|bool_)\]")
    package = {path for path in sources if path.startswith(f"{home.partition('/')[0]}/")}

    assert [path for path in sorted(package) if named.search(sources[path])] == [home]


@pytest.mark.parametrize(
    ("path", "source", "name"),
    [
        ("study_app/lens.py", "class Camera: ...", "class Camera"),
        ("study_app/camera.py", "", "module camera"),
        ("study_app/lens.py", "def focus(): ...", "function focus"),
        ("study_app/lens.py", "Size = tuple[float, float]", "type Size"),
        ("study_app/gpu.py", "", "module gpu"),  # an exception for stages alone
        ("protocols/phases.py", "class Clip: ...", "class Clip"),
    ],
)
def test_a_name_that_is_taken_is_caught(path, source, name):
    known = {
        "pipeline/camera.py": "class Camera: ...\nSize = tuple[int, int]\ndef focus(): ...",
        "pipeline/warp/gpu.py": "",
        "protocols/manifest.py": "class Clip: ...",
    }
    assert not taken_twice(known)
    assert list(taken_twice(known | {path: source})) == [name]


@pytest.mark.parametrize(
    ("path", "source"),
    [
        ("study_app/lens.py", "class _Lens: ...\ndef f():\n    class Camera: ..."),
        ("study_app/lens.py", "Size = tuple[int, int]"),
        ("study_app/cli/focus.py", "def focus(): ..."),
        ("study_app/__init__.py", ""),
        ("pipeline/fill/gpu.py", ""),
    ],
)
def test_a_private_name_a_package_a_stage_a_command_and_the_same_type_take_none(path, source):
    camera = "class Camera: ...\nclass _Lens: ...\nSize = tuple[int, int]\ndef focus(): ..."
    known = {"pipeline/camera.py": camera, "a/__init__.py": ""}

    assert not taken_twice(known | {"pipeline/warp/gpu.py": "", path: source})
