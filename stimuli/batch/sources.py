"""Source files of ours that decide a clip's pixels, as one hash.

The files are those that a module imports, directly or through others of our packages, with
the shaders and tables in their folders. A change to one fill method leaves the hashes of all
others as they are.
"""

from __future__ import annotations

import ast
import hashlib
from functools import cache
from importlib.util import find_spec
from pathlib import Path
from threading import Lock

PACKAGES = ("pipeline", "stimuli")  # what a protocol says is part of every key itself
_DATA = (".glsl", ".json")
# Python before 3.11.8 counts the depth of a tree once for all threads, and refuses what two parse
# at the same time: "AST constructor recursion depth mismatch" (python/cpython#106905).
_PARSING = Lock()


def source_sha256(*modules: str) -> str:
    """Return one hash of everything of ours that `modules` need.

    Parameters
    ----------
    *modules : str
        Dotted names, such as ``stimuli.scenes.garden``.
    """
    digest = hashlib.sha256()
    for name, path in sorted(source_files(*modules).items()):
        digest.update(name.encode() + b"\0" + path.read_bytes() + b"\0")
    return digest.hexdigest()


def source_files(*modules: str) -> dict[str, Path]:
    """Return the files behind `source_sha256`, by a name that is the same on every machine."""
    seen: set[str] = set()
    waiting = list(modules)
    files: dict[str, Path] = {}
    while waiting:
        name = waiting.pop()
        if name in seen:
            continue
        seen.add(name)
        path = _file_of(name)
        if path is None:
            continue
        files[name + path.suffix] = path
        for data in _data_beside(name, path):
            files[f"{name.rpartition('.')[0]}/{data.name}"] = data
        waiting += _imports(path)
    return files


@cache
def _file_of(module: str) -> Path | None:
    try:
        spec = find_spec(module)
    except ModuleNotFoundError:
        return None
    return Path(spec.origin) if spec is not None and spec.origin else None


@cache
def _imports(path: Path) -> tuple[str, ...]:
    """Our modules that a file names; `from package import name` may name a module too."""
    names: list[str] = []
    with _PARSING:
        tree = ast.parse(path.read_text(encoding="utf-8"))
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            names += [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom) and node.module:
            names.append(node.module)
            names += [f"{node.module}.{alias.name}" for alias in node.names]
    return tuple(name for name in names if name.split(".")[0] in PACKAGES)


@cache
def _data_beside(module: str, path: Path) -> tuple[Path, ...]:
    """Shaders and tables of a module: those of its folder, and what those include."""
    package = module.split(".")[0]
    if path.name == "__init__.py":
        return ()
    folder = path.parent
    beside = [at for at in (folder, folder / "shaders") if at.is_dir()]
    found = [file for at in beside for file in at.iterdir() if file.suffix in _DATA]
    if package == "pipeline" and any(file.suffix == ".glsl" for file in found):
        library = (folder.parent / "shaderlib").glob("*.glsl")
        text = "".join(file.read_text(encoding="utf-8") for file in found)
        found += [file for file in library if f'"{file.name}"' in text]
    return tuple(sorted(found))
