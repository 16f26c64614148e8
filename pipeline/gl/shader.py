"""Compute shaders from package data: `#include`, compile-time constants, errors by file.

Two directives beside GLSL's own:

``#include "colour.glsl"``
    Puts in that file of `pipeline/shaderlib/`, or with a folder in its name of that folder of
    `pipeline/`, once.
``#constant TILE``
    Becomes ``#define TILE <value>``; the host must give the value, and the shader must use it.
    A bool becomes 1 or 0, for ``#if``; numbers in a tuple become an array, of floats unless all are
    whole.
"""

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass
from importlib import resources
from importlib.resources.abc import Traversable
from numbers import Integral
from typing import TypeAlias

import moderngl
import numpy as np

Constant: TypeAlias = int | float | bool | tuple[float, ...]

_INCLUDE = re.compile(r'^\s*#include\s+"([^"]+)"')
_CONSTANT = re.compile(r"^\s*#constant\s+(\w+)")
_COMMENT = re.compile(r"//[^\n]*|/\*.*?\*/", re.DOTALL)
# Where drivers put the line: Mesa "0:12(3): error", NVIDIA "0(12) : error", others "ERROR: 0:12:".
_LINE_IN_LOG = re.compile(
    r"^((?:ERROR: |WARNING: )?)0(?::(\d+)(?:\(\d+\))?|\((\d+)\))", re.MULTILINE
)


class ShaderError(Exception):
    """A shader of ours is wrong: a bug, named by file and line of the source as written."""


@dataclass(frozen=True)
class ShaderSource:
    """A flattened shader and, for each of its lines, the file and line it came from."""

    text: str
    origin: tuple[tuple[str, int], ...]


def compile_source(ctx: moderngl.Context, source: ShaderSource) -> moderngl.ComputeShader:
    """Compile a flattened shader; its `extra` is the file it is from.

    Raises
    ------
    ShaderError
        If the driver refuses it, with its words and the places in the files as written.
    """
    path = source.origin[0][0] if source.origin else "an empty shader"
    try:
        shader = ctx.compute_shader(source.text)
    except moderngl.Error as error:
        raise ShaderError(f"{path} does not compile:\n{_relocate(str(error), source)}") from error
    shader.extra = path
    return shader


def flatten(
    path: str,
    constants: Mapping[str, Constant],
    root: Traversable | None = None,
    *,
    known: Mapping[str, Constant] | None = None,
) -> ShaderSource:
    """Resolve includes and constants of the shader `path` in `root`, by default the package.

    It must declare all of `constants`; of `known` it takes what else it declares.
    """
    values = {**(known or {}), **constants}
    folder = resources.files("pipeline") if root is None else root
    lines: list[str] = []
    written: list[str] = []  # the same without our own #define lines
    origin: list[tuple[str, int]] = []
    declared: dict[str, tuple[str, int]] = {}
    included: set[str] = set()

    def add(name: str, text: str) -> None:
        for number, line in enumerate(text.splitlines(), start=1):
            if match := _INCLUDE.match(line):
                target = match[1] if "/" in match[1] else f"shaderlib/{match[1]}"
                if target not in included:
                    included.add(target)
                    add(target, _read(folder, target, f"{name}:{number}"))
                continue
            if match := _CONSTANT.match(line):
                key = match[1]
                if key not in values:
                    raise ShaderError(
                        f"{name}:{number}: constant {key} has no value; pass {key}=..."
                    )
                declared[key] = (name, number)
                line = f"#define {key} {_literal(key, values[key])}"
            else:
                written.append(line)
            lines.append(line)
            origin.append((name, number))

    add(path, _read(folder, path, "Shader"))
    code = without_comments("\n".join(written))
    for key in constants:
        if key not in declared:
            raise ShaderError(f"{path}: no '#constant {key}' in it or its includes; remove {key}=")
    for key, (name, number) in declared.items():
        if not re.search(rf"\b{key}\b", code):
            raise ShaderError(f"{name}:{number}: constant {key} is never used")
    return ShaderSource("\n".join(lines) + "\n", tuple(origin))


def without_comments(text: str) -> str:
    """A shader's text without its comments."""
    return _COMMENT.sub(" ", text)


def _read(root: Traversable, path: str, wanted_by: str) -> str:
    file = root.joinpath(path)
    if not file.is_file():
        raise ShaderError(f"{wanted_by}: no shader file pipeline/{path}")
    return file.read_text(encoding="utf-8")


def _literal(key: str, value: Constant) -> str:
    if isinstance(value, tuple):
        kind = int if all(isinstance(number, Integral) for number in value) else float
        return f"{kind.__name__}[]({', '.join(_literal(key, kind(number)) for number in value)})"
    if not math.isfinite(value):
        raise ShaderError(f"constant {key} must be finite (got {value})")
    # Through Python's own types: numpy writes its scalars as "np.float64(0.5)".
    number = int(value) if isinstance(value, Integral | np.bool_) else float(value)
    return f"({number!r})" if number < 0 else repr(number)


def _relocate(log: str, source: ShaderSource) -> str:
    def place(match: re.Match[str]) -> str:
        index = int(match[2] or match[3]) - 1
        if not 0 <= index < len(source.origin):
            return match[0]
        name, number = source.origin[index]
        return f"{match[1]}{name}:{number}"

    return _LINE_IN_LOG.sub(place, log)
