"""Layers: the imports of each package, read from the sources without running them."""

import ast
import sys
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import pytest

NOT_OURS = {"__pycache__", "node_modules"}
PACKAGES = ("analysis", "pipeline", "protocols", "stimuli", "study_app")

# The importer (a package, or a part of one) -> what it may import of ours beside
# its own package. The longest name that fits the importing module counts.
ALLOWED = {
    "protocols": (),
    "pipeline": (
        "protocols.outside",
        "protocols.disk.whole_file",
        "protocols.errors",
        "protocols.limits",
    ),
    "stimuli": ("pipeline", "protocols"),
    "study_app": ("protocols", "pipeline.gl", "pipeline.errors"),
    "study_app.cli": PACKAGES,  # the front door
    "analysis": ("protocols",),
}

# `metamerlab --help` has half a second: only these load before a command is chosen.
LIGHT = (
    "typer",
    "click",
    "rich",
    "protocols.errors",
    "protocols.limits",
    "protocols.outside",
    "pipeline.errors",
)
EAGER = ("study_app", "study_app.cli")


class Import(NamedTuple):
    """One import statement, as absolute module names."""

    line: int
    names: tuple[str, ...]  # the module, and each name taken from it, dotted
    at_start: bool  # runs when the module is imported


def imports_of(source: str, module: str, *, is_package: bool) -> Iterator[Import]:
    """Yield every import in `source`, also those inside functions, and by `import_module`."""
    package = module if is_package else module.rpartition(".")[0]
    tree = ast.parse(source)
    later = {
        id(inner)
        for outer in ast.walk(tree)
        if isinstance(outer, ast.FunctionDef | ast.AsyncFunctionDef | ast.Lambda)
        or (isinstance(outer, ast.If) and "TYPE_CHECKING" in ast.unparse(outer.test))
        for inner in ast.walk(outer)
    }
    for node in ast.walk(tree):
        at_start = id(node) not in later
        match node:
            case ast.Import():
                yield Import(node.lineno, tuple(alias.name for alias in node.names), at_start)
            case ast.ImportFrom():
                base = node.module or ""
                if node.level:
                    parts = package.split(".")
                    above = ".".join(parts[: len(parts) - node.level + 1])
                    base = f"{above}.{base}" if base else above
                names = tuple(f"{base}.{alias.name}" for alias in node.names)
                yield Import(node.lineno, names, at_start)
            case ast.Call(func=function, args=[ast.Constant(value=str(name)), *_]) if ast.unparse(
                function
            ).rpartition(".")[2] in {"import_module", "__import__"}:
                yield Import(node.lineno, (name,), at_start)


def inside(name: str, package: str) -> bool:
    """Tell whether `name` is `package` or lies in it."""
    return name == package or name.startswith(f"{package}.")


def violations(source: str, module: str, *, is_package: bool = False) -> list[str]:
    """Return one line for each import in `source` that the layers forbid."""
    rule = max((part for part in ALLOWED if inside(module, part)), key=len)
    own = module.partition(".")[0]
    found = []
    for statement in imports_of(source, module, is_package=is_package):
        for name in statement.names:
            ours = name.partition(".")[0] in PACKAGES
            if not ours or any(inside(name, part) for part in ALLOWED[rule]):
                continue
            if inside(name, own) and (rule == "study_app.cli" or not inside(name, "study_app.cli")):
                continue
            found.append(f"{module}:{statement.line}: {rule} may not import {name}")
    return found


def heavy_at_start(source: str, module: str, *, is_package: bool = False) -> list[str]:
    """Return what `source` imports when it is loaded that is neither light nor built in."""
    own = (module, *LIGHT, *sys.stdlib_module_names)
    return [
        f"{module}:{statement.line}: {name} loads at start"
        for statement in imports_of(source, module, is_package=is_package)
        if statement.at_start
        for name in statement.names
        if not any(inside(name, part) for part in own)
    ]


def our_modules(repository: Path) -> Iterator[tuple[Path, str, bool]]:
    """Yield every source file of the five packages with its module name."""
    for package in PACKAGES:
        for path in sorted((repository / package).rglob("*.py")):
            parts = path.relative_to(repository).with_suffix("").parts
            is_package = parts[-1] == "__init__"
            yield path, ".".join(parts[:-1] if is_package else parts), is_package


def test_every_import_keeps_to_the_layers(repository):
    found = [
        line
        for path, module, is_package in our_modules(repository)
        for line in violations(path.read_text(encoding="utf-8"), module, is_package=is_package)
    ]

    assert not found, "\n".join(found)


def folders_above(repository: Path) -> dict[str, set[str]]:
    """Folders that each folder of the pipeline imports from, its own left out."""
    above: dict[str, set[str]] = {}
    for path, module, is_package in our_modules(repository):
        parts = module.split(".")
        if parts[0] != "pipeline" or len(parts) + is_package < 3:
            continue
        source = path.read_text(encoding="utf-8")
        names = [n for i in imports_of(source, module, is_package=is_package) for n in i.names]
        folders = {n.split(".")[1] for n in names if n.startswith("pipeline.")}
        found = {name for name in folders if (repository / "pipeline" / name).is_dir()}
        above.setdefault(parts[1], set()).update(found - {parts[1]})
    return above


def in_circles(above: dict[str, set[str]]) -> dict[str, set[str]]:
    """Rest when those that import none of the rest are taken away, one by one."""
    left = dict(above)
    while free := [name for name, others in left.items() if not others & set(left)]:
        for name in free:
            del left[name]
    return {name: others & set(left) for name, others in left.items()}


def test_no_folder_of_the_pipeline_imports_what_imports_it(repository):
    above = folders_above(repository)
    assert {"features", "inpaint", "statistics", "synthesis"} <= set(above)

    assert not in_circles(above)


def modules_above(sources: dict[str, tuple[str, bool]]) -> dict[str, set[str]]:
    """Modules that each of these imports, with the packages above what it imports.

    Imports in functions and for type hints count.
    """
    above = {}
    for module, (source, is_package) in sources.items():
        names = [n for i in imports_of(source, module, is_package=is_package) for n in i.names]
        parts = [name.split(".") for name in names]
        loaded = {".".join(part[:length]) for part in parts for length in range(1, len(part) + 1)}
        above[module] = loaded & set(sources) - {module}
    return above


def test_no_module_of_the_protocols_imports_what_imports_it(repository):
    sources = {
        module: (path.read_text(encoding="utf-8"), is_package)
        for path, module, is_package in our_modules(repository)
        if inside(module, "protocols")
    }
    above = modules_above(sources)
    assert "protocols.tasks.base" in above["protocols.plan"]

    assert not in_circles(above)


@pytest.mark.slow
def test_no_module_imports_what_imports_it(repository):
    """A package that lists its modules is no circle: what it loads for them is left out."""
    sources = {
        module: (path.read_text(encoding="utf-8"), is_package)
        for path, module, is_package in our_modules(repository)
    }
    above = {
        module: {other for other in others if not inside(module, other)}
        for module, others in modules_above(sources).items()
    }
    assert "analysis.plots.style" in above["analysis.plots.preference_plots"]

    assert not in_circles(above)


@pytest.mark.parametrize(
    "source",
    [
        "import protocols.plan",
        "from protocols.plan import chosen",
        "from protocols import plan",
        "from .plan import chosen",
        "def f():\n    from protocols.plan import chosen",
        "from typing import TYPE_CHECKING\nif TYPE_CHECKING:\n    from protocols.plan import Plan",
        "from importlib import import_module\nimport_module('protocols.plan')",
        "import protocols.tasks.base",  # whose package imports the plan
    ],
)
def test_a_circle_is_caught(source):
    plan = "from protocols.places import place"
    sources = {
        "protocols": ("", True),
        "protocols.errors": ("", False),
        "protocols.plan": (plan, False),
        "protocols.places": (source, False),
        "protocols.tasks": ("import protocols.plan", True),
        "protocols.tasks.base": ("from protocols.errors import StudyError", False),
    }
    assert {"protocols.places", "protocols.plan"} <= set(in_circles(modules_above(sources)))
    assert not in_circles(modules_above(sources | {"protocols.places": ("", False)}))


def test_no_folder_holds_more_files_than_a_reader_can_take_in(repository):
    files = (path for package in PACKAGES for path in (repository / package).rglob("*.*"))
    held = Counter(path.parent for path in files if path.is_file())
    ours = {folder: n for folder, n in held.items() if not NOT_OURS & {*folder.parts}}

    assert len(ours) > 80
    assert not {folder: n for folder, n in ours.items() if n > 31}  # __init__.py, too


def test_no_function_is_excused_from_taking_settings(repository):
    """More than eight parameters are settings: ruff's rule, which no comment switches off."""
    modules = [path for path, *_ in our_modules(repository)]
    assert [str(path) for path in modules if "PLR0913" in path.read_text(encoding="utf-8")] == []


def test_the_front_door_loads_nothing_heavy_before_a_command_is_chosen(repository):
    found = [
        line
        for path, module, is_package in our_modules(repository)
        if module in EAGER
        for line in heavy_at_start(path.read_text(encoding="utf-8"), module, is_package=is_package)
    ]

    assert not found, "\n".join(found)


def test_every_package_is_examined(repository):
    seen = {module.partition(".")[0] for _, module, _ in our_modules(repository)}

    assert seen == set(PACKAGES)
    listed = (repository / "pyproject.toml").read_text(encoding="utf-8")
    assert all(f'"{package}"' in listed for package in PACKAGES)


@pytest.mark.parametrize(
    ("module", "source"),
    [
        ("pipeline.warp.gpu", "import protocols"),
        ("pipeline.warp.gpu", "from protocols.load import load"),
        ("pipeline.warp.gpu", "from stimuli.batch import clip"),
        ("protocols.plan", "from pipeline import frame"),
        ("protocols.plan", "def f():\n    import analysis.tidy"),
        ("analysis.tidy", "import importlib\nimportlib.import_module('pipeline.quality')"),
        ("analysis.tidy", "from study_app.recorder import Recorder"),
        ("stimuli.batch.build", "from study_app import cli"),
        ("study_app.desktop.draw", "import pipeline"),
        ("study_app.desktop.draw", "from pipeline import quality"),
        ("study_app.desktop.draw", "from pipeline.warp import reference"),
        ("study_app.session", "from . import cli"),
        ("study_app.gaze.lsl", "from ..cli import errors"),
        ("study_app.session", "import analysis"),
    ],
)
def test_a_forbidden_import_is_caught(module, source):
    assert len(violations(source, module)) == 1


@pytest.mark.parametrize(
    ("module", "source"),
    [
        ("pipeline.warp.gpu", "from pipeline.frame import Frame\nimport numpy"),
        ("pipeline.warp.gpu", "from ..gl import context"),
        ("stimuli.batch.build", "import protocols.manifest, pipeline.quality"),
        (
            "study_app.desktop.draw",
            "from pipeline.gl.texture import upload\nfrom pipeline import gl",
        ),
        ("study_app.cli.demo", "from stimuli import exr\nimport analysis, study_app.trial"),
        ("study_app.cli", "from study_app.cli.terminal import say"),
        ("analysis.tidy", "from protocols import journal"),
        ("analysis.tidy", "import protocols_of_mine"),
    ],
)
def test_an_allowed_import_passes(module, source):
    assert violations(source, module) == []


@pytest.mark.parametrize(
    ("source", "caught"),
    [
        ("import numpy", 1),
        ("from rich.console import Console", 0),
        ("if True:\n    from analysis import tidy", 1),
        ("def command():\n    import numpy", 0),
        ("from typing import TYPE_CHECKING\nif TYPE_CHECKING:\n    import numpy", 0),
        ("from study_app.cli.terminal import say", 0),
    ],
)
def test_a_heavy_import_at_the_front_door_is_caught(source, caught):
    assert len(heavy_at_start(source, "study_app.cli", is_package=True)) == caught
