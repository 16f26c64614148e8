"""Compute shaders from package data: `#include`, compile-time constants, errors by file.

Two directives beside GLSL's own:

``#include "colour.glsl"``
    Puts in that file of `pipeline/shaderlib/`, once.
``#constant TILE``
    Becomes ``#define TILE <value>``; the host must give the value, and the shader must use it.
"""

import re
from dataclasses import dataclass
from importlib import resources
from typing import TypeAlias

import moderngl

Constant: TypeAlias = int | float | bool

_INCLUDE = re.compile(r'^\s*#include\s+"([^"]+)"')
_CONSTANT = re.compile(r"^\s*#constant\s+(\w+)")
# Where drivers put the line: Mesa "0:12(3): error", NVIDIA "0(12) : error", others "ERROR: 0:12:".
_LINE_IN_LOG = re.compile(r"\b0(?::(\d+)(?:\(\d+\))?|\((\d+)\))")


class ShaderError(Exception):
    """A shader of ours is wrong: a bug, named by file and line of the source as written."""


@dataclass(frozen=True)
class Source:
    """A flattened shader and, for each of its lines, the file and line it came from."""

    text: str
    origin: tuple[tuple[str, int], ...]


def compile_compute(
    ctx: moderngl.Context, path: str, **constants: Constant
) -> moderngl.ComputeShader:
    """Compile ``pipeline/<path>`` with every ``#constant`` set.

    Raises
    ------
    ShaderError
        If a constant is missing, unknown or unused, an include is missing, or the driver
        refuses the source.
    """
    source = flatten(path, constants)
    try:
        return ctx.compute_shader(source.text)
    except moderngl.Error as error:
        raise ShaderError(f"{path} does not compile:\n{_relocate(str(error), source)}") from error


def flatten(path: str, constants: dict[str, Constant]) -> Source:
    """Resolve includes and constants of ``pipeline/<path>``."""
    lines: list[str] = []
    origin: list[tuple[str, int]] = []
    declared: dict[str, tuple[str, int]] = {}
    included: set[str] = set()

    def add(name: str, text: str) -> None:
        for number, line in enumerate(text.splitlines(), start=1):
            if match := _INCLUDE.match(line):
                target = f"shaderlib/{match[1]}"
                if target not in included:
                    included.add(target)
                    add(target, _read(target, f"{name}:{number}"))
                continue
            if match := _CONSTANT.match(line):
                key = match[1]
                if key not in constants:
                    raise ShaderError(
                        f"{name}:{number}: constant {key} has no value; pass {key}=..."
                    )
                declared[key] = (name, number)
                line = f"#define {key} {_literal(constants[key])}"
            lines.append(line)
            origin.append((name, number))

    add(path, _read(path, "compile_compute"))
    for key in constants:
        if key not in declared:
            raise ShaderError(f"{path}: no '#constant {key}' in it or its includes; remove {key}=")
        uses = sum(bool(re.search(rf"\b{key}\b", line)) for line in lines)
        if uses < 2:
            name, number = declared[key]
            raise ShaderError(f"{name}:{number}: constant {key} is never used")
    return Source("\n".join(lines) + "\n", tuple(origin))


def _read(path: str, wanted_by: str) -> str:
    file = resources.files("pipeline").joinpath(path)
    if not file.is_file():
        raise ShaderError(f"{wanted_by}: no shader file pipeline/{path}")
    return file.read_text(encoding="utf-8")


def _literal(value: Constant) -> str:
    if isinstance(value, bool):
        return "1" if value else "0"
    return repr(value)


def _relocate(log: str, source: Source) -> str:
    def place(match: re.Match[str]) -> str:
        index = int(match[1] or match[2]) - 1
        if not 0 <= index < len(source.origin):
            return match[0]
        name, number = source.origin[index]
        return f"{name}:{number}"

    return _LINE_IN_LOG.sub(place, log)
