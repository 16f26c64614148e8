"""Shaders of this package: text with includes, compiled programs, uniforms."""

from __future__ import annotations

import re
from importlib import resources
from typing import Any

import moderngl
import numpy as np
from numpy.typing import NDArray

_INCLUDE = re.compile(r'^\s*#include\s+"([^"]+)"\s*$', re.MULTILINE)


def program(ctx: moderngl.Context, vertex: str, fragment: str) -> moderngl.Program:
    """Compile two shaders of this package."""
    return ctx.program(vertex_shader=shader_text(vertex), fragment_shader=shader_text(fragment))


def shader_text(name: str) -> str:
    """Return a shader of this package with its includes."""
    folder = resources.files("stimuli") / "shaders"
    text = (folder / name).read_text(encoding="utf-8")
    return _INCLUDE.sub(lambda match: shader_text(match[1]), text)


def columns(matrix: NDArray[np.float64]) -> tuple[float, ...]:
    """A matrix as OpenGL wants it, column by column."""
    return tuple(matrix.T.ravel().astype(float))


def set_uniform(shader: Any, name: str, value: object) -> None:
    """Set a uniform, unless the compiler found it unused in this shader."""
    uniform = shader.get(name, None)
    if isinstance(uniform, moderngl.Uniform):
        uniform.value = value
