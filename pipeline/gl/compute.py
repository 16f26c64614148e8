"""Compute shaders that are called by the names their source uses.

A shader declares what it reads and writes; its source holds no binding numbers. This module asks
the driver what is in use, gives out the binding points, and puts a memory barrier behind every
dispatch that writes.
"""

import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cache, partial
from typing import Any, Self, TypeAlias, cast

import moderngl
import numpy as np

from pipeline.gl.context import require_compute
from pipeline.gl.shader import (
    Constant,
    ShaderError,
    ShaderSource,
    compile_source,
    flatten,
    without_comments,
)
from pipeline.gl.texture import image_format

Texture: TypeAlias = moderngl.Texture | moderngl.TextureArray
Resource: TypeAlias = Texture | moderngl.Buffer | Sequence[Texture]

_IMAGE = re.compile(r"\blayout\s*\(\s*(\w+)\s*\)([\w\s]*?)\b[iu]?image\w+\s+(\w+)\s*;")
_SAMPLER = re.compile(r"\buniform\s+[iu]?sampler\w+\s+(\w+)")
_BLOCK = re.compile(r"\blayout\s*\(\s*std\d+\s*\)([\w\s]*?)\b(buffer|uniform)\s+(\w+)\s*\{")
_UNIFORM = re.compile(r"\buniform\s+\w+\s+([^;{}()]+);")
_LOCAL_SIZE = re.compile(r"\blocal_size_([xy])\s*=\s*(\w+)")
_DEFINE = re.compile(r"^\s*#define\s+(\w+)\s+(\d+)\s*$", re.MULTILINE)
_INT = 0x1404  # OpenGL's name of the type
_CAPITAL = re.compile(r"(?<!^)(?=[A-Z])")
_TAKE_ALL_PLACES = """#version 430
layout(local_size_x = 1) in;
// As many as OpenGL grants to every compute shader. Without a binding, each is the first unit.
uniform sampler2D textures[16];
layout(rgba8) uniform image2D images[8];
void main() {
    vec4 sum = vec4(0.0);
    for (int i = 0; i < 16; ++i) sum += texelFetch(textures[i], ivec2(0), 0);
    for (int i = 0; i < 8; ++i) sum += imageLoad(images[i], ivec2(0));
    imageStore(images[0], ivec2(0), sum);
}
"""


@dataclass(frozen=True)
class _Slot:
    """Binding point of a resource, and what the shader does with it."""

    kind: str  # "image", "sampler", "buffer" or "block"
    point: int
    format: str = ""  # of an image
    reads: bool = True
    writes: bool = False


@dataclass(frozen=True, eq=False)
class Dispatch:
    """A dispatch with all that it binds, recorded: `run` looks nothing up and makes no object."""

    prepare: tuple[Callable[[], object], ...]
    program: moderngl.ComputeShader
    groups: tuple[int, int]
    settle: tuple[Callable[[], object], ...]  # the barrier behind it

    def run(self) -> None:
        """Bind and dispatch."""
        for call in self.prepare:
            call()
        self.program.run(*self.groups)
        for call in self.settle:
            call()


class Dispatches:
    """Steps for textures that callers bring, recorded when they first do; the last few are kept."""

    MOST = 8

    def __init__(self, record: Callable[..., Dispatch]) -> None:
        self._record = record
        self._steps: dict[tuple[Texture | None, ...], Dispatch] = {}

    def run(self, *textures: Texture | None) -> None:
        """Run the step for these."""
        step = self._steps.get(textures)
        if step is None:
            if len(self._steps) == self.MOST:
                del self._steps[next(iter(self._steps))]
            step = self._steps[textures] = self._record(*textures)
        step.run()


def of_int(value: int) -> bytes:
    """A whole number, true or false as a shader holds it."""
    return np.int32(value).tobytes()


def let_go(ctx: moderngl.Context) -> None:
    """Free what was released while it was bound.

    Drivers keep that until a shader that is dispatched reads something else in its place.
    """
    shader, pixel = ctx.compute_shader(_TAKE_ALL_PLACES), ctx.texture((1, 1), 4)
    pixel.use()
    pixel.bind_to_image(0)
    shader.run()
    shader.release()
    pixel.release()


class Shader:
    """A compiled compute shader.

    Its textures and buffers are arguments of `run`, by name; a buffer goes by its block's name,
    ``OfGroups`` as ``of_groups``. Uniforms are set like items of a dictionary. A name that the
    source declares but the driver found unused is taken and ignored; a name that it does not
    declare is an error.

    Parameters
    ----------
    path : str
        In the package `pipeline`.
    known : mapping, optional
        Constants that it takes where it declares them, as the twin's module has them.
    constants
        Of every other ``#constant``; see `flatten`.

    Raises
    ------
    ShaderError
        If a constant is wrong or the driver refuses the source.
    GLUnavailableError
        If the context has no compute shaders.
    """

    def __init__(
        self,
        ctx: moderngl.Context,
        path: str,
        known: Mapping[str, Constant] | None = None,
        /,
        **constants: Constant,
    ) -> None:
        self._compile(ctx, flatten(path, constants, known=known))

    @classmethod
    def of(cls, ctx: moderngl.Context, source: ShaderSource) -> Self:
        """Compile a flattened source of any package."""
        shader = cls.__new__(cls)
        shader._compile(ctx, source)
        return shader

    def _compile(self, ctx: moderngl.Context, source: ShaderSource) -> None:
        require_compute(ctx)
        self._ctx = ctx
        self._program = compile_source(ctx, source)
        self.path = str(self._program.extra)
        code = without_comments(source.text)
        self._declared = _declared(code)
        self._slots = _slots(self._program, code)
        self._writes = any(slot.writes for slot in self._slots.values())
        self._held: dict[str, Resource] = {}
        self._checked: dict[str, Resource] = {}
        self.group = _group(code)

    def __setitem__(self, name: str, value: Any) -> None:
        """Set a uniform; an array as rows, of which the shader takes as many as it uses."""
        uniform = self._program.get(name, None)
        if uniform is None or name in self._slots:
            self._check_declared(name)
        elif isinstance(value, np.ndarray):
            rows = value[: cast(moderngl.Uniform, uniform).array_length]
            cast(moderngl.Uniform, uniform).write(np.ascontiguousarray(rows).tobytes())
        else:
            cast(moderngl.Uniform, uniform).value = value

    def __contains__(self, name: str) -> bool:
        """Return True if a resource or uniform is in use."""
        return name in self._slots or name in self._program

    def uniform(self, name: str) -> moderngl.Uniform:
        """A uniform that is in use, to be written often."""
        return cast(moderngl.Uniform, self._program[name])

    def hold(self, **resources: Resource) -> None:
        """Keep resources for every run to come; `run` may replace them for once."""
        for name in resources:
            self._check_declared(name)
        self._held.update(resources)

    def run(self, x: int = 1, y: int = 1, /, **resources: Resource) -> None:
        """Dispatch `x` times `y` work groups.

        Raises
        ------
        ShaderError
            If a resource that the shader uses is missing, one is not declared, or a texture has
            not the format of its image.
        """
        for bind in self._bindings(resources):
            bind()
        self._program.run(x, y)
        self._finish()

    def run_over(self, size: tuple[int, int], /, **resources: Resource) -> None:
        """Dispatch so many work groups that each pixel of `size` (width, height) has its own."""
        self.run(*self._groups_over(size), **resources)

    def step_over(
        self,
        size: tuple[int, int],
        uniforms: Mapping[str, bytes] | None = None,
        /,
        **resources: Resource,
    ) -> Dispatch:
        """Record `run_over`, for the same resources as often as you like.

        Parameters
        ----------
        uniforms : mapping, optional
            Set before each run, where other steps of this shader set them otherwise; as the bytes
            that the shader holds.
        """
        setters = [
            partial(self.uniform(name).write, value)
            for name, value in (uniforms or {}).items()
            if name in self._program
        ]
        barrier = (partial(self._ctx.mglo.memory_barrier, moderngl.ALL_BARRIER_BITS, False),)
        return Dispatch(
            (*setters, *self._bindings(resources)),
            self._program,
            self._groups_over(size),
            barrier if self._writes else (),
        )

    def run_indirect(self, groups: moderngl.Buffer, offset: int, /, **resources: Resource) -> None:
        """Dispatch as many work groups as `groups` says at `offset` bytes: x, y, z of uint32."""
        for bind in self._bindings(resources):
            bind()
        self._program.run_indirect(groups, offset)
        self._finish()

    def release(self) -> None:
        """Free the program."""
        self._program.release()

    def _finish(self) -> None:
        if self._writes:
            self._ctx.memory_barrier()

    def _groups_over(self, size: tuple[int, int]) -> tuple[int, int]:
        (width, height), (columns, rows) = size, self.group
        return -(-width // columns), -(-height // rows)

    def _bindings(self, resources: dict[str, Resource]) -> Iterator[Callable[[], object]]:
        """Check the arguments, and yield a call that binds each."""
        for name in resources:
            if name not in self._slots:
                self._check_declared(name)
        given = self._held | resources
        for name, slot in self._slots.items():
            if name not in given:
                raise ShaderError(f"{self.path}: {slot.kind} {name!r} is not given")
            resource: Any = given[name]
            if resource is not self._checked.get(name):
                self._check(name, slot, resource)
                self._checked[name] = resource
            # Through moderngl's inner objects: its own methods only hand on, once more a call each.
            if slot.kind == "image":
                yield partial(resource.mglo.bind, slot.point, slot.reads, slot.writes, 0, 0)
            elif slot.kind == "buffer":
                yield partial(resource.mglo.bind_to_storage_buffer, slot.point, 0, -1)
            elif slot.kind == "block":
                yield partial(resource.mglo.bind_to_uniform_block, slot.point, 0, -1)
            else:
                textures = resource if isinstance(resource, Sequence) else (resource,)
                for point, texture in enumerate(textures, start=slot.point):
                    yield partial(texture.mglo.use, point)

    def _check(self, name: str, slot: _Slot, resource: Resource) -> None:
        """Require a resource that fits its place; the last one that did is not asked again."""
        match slot.kind, resource:
            case "image", moderngl.Texture() | moderngl.TextureArray():
                if image_format(resource) != slot.format:
                    raise ShaderError(
                        f"{self.path}: image {name!r} is {slot.format}"
                        f" (got a texture of {image_format(resource)})"
                    )
            case "sampler", moderngl.Texture() | moderngl.TextureArray() | [*_]:
                pass
            case "buffer" | "block", moderngl.Buffer():
                pass
            case _:
                raise ShaderError(
                    f"{self.path}: {slot.kind} {name!r} cannot be a {type(resource).__name__}"
                )

    def _check_declared(self, name: str) -> None:
        if name not in self._declared:
            raise ShaderError(
                f"{self.path}: there is no {name!r} (declared: {', '.join(sorted(self._declared))})"
            )


@cache
def _declared(code: str) -> frozenset[str]:
    """Every name that a caller may give: uniforms, images, samplers, blocks."""
    names = {match[3] for match in _IMAGE.finditer(code)}
    names |= {match[1] for match in _SAMPLER.finditer(code)}
    names |= {_argument(match[3]) for match in _BLOCK.finditer(code)}
    for match in _UNIFORM.finditer(code):
        names |= {re.split(r"[\s\[=]", part.strip())[0] for part in match[1].split(",")}
    return frozenset(names)


def _slots(program: moderngl.ComputeShader, code: str) -> dict[str, _Slot]:
    """Give every resource in use a binding point of its own, and tell the program."""
    images: dict[str, tuple[str, bool, bool]] = {}
    for match in _IMAGE.finditer(code):  # twice where branches of `#if` differ: what any does
        _, reads, writes = images.get(match[3], ("", False, False))
        words = match[2].split()
        images[match[3]] = (
            match[1],
            reads or "writeonly" not in words,
            writes or "readonly" not in words,
        )
    blocks = {match[3]: (match[2], match[1].split()) for match in _BLOCK.finditer(code)}
    samplers = {match[1] for match in _SAMPLER.finditer(code)}
    slots: dict[str, _Slot] = {}
    taken = dict.fromkeys(("image", "sampler", "buffer", "block"), 0)
    for name in program:
        member: Any = program[name]
        count = 1
        if name in images:
            texel, reads, writes = images[name]
            slot = _Slot("image", taken["image"], texel, reads, writes)
            member.gl_type = _INT  # moderngl writes to no image of integers otherwise
            member.write(np.int32(slot.point).tobytes())
        elif name in samplers:
            slot, count = _Slot("sampler", taken["sampler"]), member.array_length
            first = slot.point
            member.value = first if count == 1 else list(range(first, first + count))
        elif name in blocks:
            kind, words = blocks[name]
            kind = "buffer" if kind == "buffer" else "block"
            writes = kind == "buffer" and "readonly" not in words
            slot = _Slot(kind, taken[kind], writes=writes)
            member.binding = slot.point
            name = _argument(name)
        else:
            continue
        slots[name] = slot
        taken[slot.kind] += count
    return slots


def _argument(block: str) -> str:
    """Name of a block as callers write it: OfGroups is of_groups."""
    return _CAPITAL.sub("_", block).lower()


def _group(code: str) -> tuple[int, int]:
    """Invocations of a work group along x and y."""
    defined = {match[1]: int(match[2]) for match in _DEFINE.finditer(code)}
    edges = {axis: defined.get(edge) or int(edge) for axis, edge in _LOCAL_SIZE.findall(code)}
    return edges.get("x", 1), edges.get("y", 1)
