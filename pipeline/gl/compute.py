"""Compute shaders that are called by the names their source uses.

A shader declares what it reads and writes; its source holds no binding numbers. This module asks
the driver what is in use, gives out the binding points, and puts a memory barrier behind every
dispatch that writes.
"""

import re
from collections.abc import Callable, Hashable, Iterator, Mapping, Sequence
from contextvars import ContextVar
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
_BLOCK = re.compile(
    r"\blayout\s*\(\s*std\d+\s*\)([\w\s]*?)\b(buffer|uniform)\s+(\w+)\s*\{([^}]*)\}"
)
_MEMBER = re.compile(r"\b(float|u?int|[iu]?vec([234]))\s+(\w+)\s*(\[?)[^;]*;")
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

    kind: str  # "image", "sampler" or "buffer"
    point: int
    format: str = ""  # of an image
    reads: bool = True
    writes: bool = False


class Tape:
    """Record of what a frame asks of the driver: `play` looks nothing up and makes no object."""

    def __init__(self) -> None:
        self._calls: list[Callable[[], object]] = []
        self._standing: dict[tuple[moderngl.ComputeShader, str], bytes] = {}

    def add(self, call: Callable[[], object]) -> None:
        """Add a call of the driver."""
        self._calls.append(call)

    def tell(self, program: moderngl.ComputeShader, name: str, value: bytes) -> None:
        """Add the value of a uniform, unless it is the one that stands."""
        if self._standing.get((program, name)) != value:
            self._standing[program, name] = value
            uniform = cast(moderngl.Uniform, program[name])
            self.add(partial(uniform.write, value))

    def play(self) -> None:
        """Ask all of it again."""
        for call in self._calls:
            call()


_recording: ContextVar[Tape | None] = ContextVar("recording", default=None)


def ask(call: Callable[[], object]) -> None:
    """Ask the driver for something; it is recorded where a frame is."""
    call()
    if (tape := _recording.get()) is not None:
        tape.add(call)


class Tapes:
    """Tapes of frames, by the textures and numbers that they are for; the last few are kept."""

    MOST = 8

    def __init__(self) -> None:
        self._tapes: dict[Hashable, Tape] = {}

    def play(self, key: Hashable, frame: Callable[[], object]) -> None:
        """Ask for a frame: recorded the first time. Part of another, it is recorded with that."""
        if _recording.get() is not None:
            frame()
        elif tape := self._tapes.get(key):
            tape.play()
        else:
            token = _recording.set(tape := Tape())
            try:
                frame()
            finally:
                _recording.reset(token)
            if len(self._tapes) == self.MOST:
                del self._tapes[next(iter(self._tapes))]
            self._tapes[key] = tape

    def clear(self) -> None:
        """Forget them."""
        self._tapes.clear()


class Launch:
    """A dispatch of a program."""

    def __init__(self, program: moderngl.ComputeShader, run: Callable[[], object]) -> None:
        self.program, self._run = program, run

    def __call__(self) -> None:
        self._run()


@dataclass(frozen=True)
class _Member:
    """Place of a member in a uniform block; of an array, which is last, bytes from row to row."""

    offset: int
    stride: int
    dtype: str


class _Block:
    """A uniform block, whose members are told by name. What was told once keeps its buffer."""

    def __init__(
        self, ctx: moderngl.Context, point: int, size: int, members: Mapping[str, _Member]
    ) -> None:
        self.members = members
        self._ctx, self._point = ctx, point
        self._told = bytearray(size)
        self._buffers: dict[bytes, moderngl.Buffer] = {}

    def tell(self, name: str, value: Any) -> None:
        """Set a member, for the dispatches to come."""
        member = self.members[name]
        rows = np.array(value, member.dtype)
        for index, row in enumerate(rows if member.stride else [rows]):
            first = member.offset + index * member.stride
            self._told[first : first + row.nbytes] = row.tobytes()

    def bind(self) -> Callable[[], object]:
        """Return the call that binds what is told."""
        told = bytes(self._told)
        if told not in self._buffers:
            self._buffers[told] = self._ctx.buffer(told)
        return partial(self._buffers[told].mglo.bind_to_uniform_block, self._point, 0, -1)

    def release(self) -> None:
        """Free the buffers."""
        for buffer in self._buffers.values():
            buffer.release()
        self._buffers.clear()


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
    ``OfGroups`` as ``of_groups``. Uniforms are set like items of a dictionary, and so are members
    of uniform blocks: what changes from dispatch to dispatch of a frame stands in one, which is
    bound by one call. A name that the source declares but the driver found unused is taken and
    ignored; a name that it does not declare is an error.

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
        self._blocks = _blocks(ctx, self._program, code)
        self._writes = any(slot.writes for slot in self._slots.values())
        self._held: dict[str, Resource] = {}
        self._checked: dict[str, Resource] = {}
        self.group = _group(code)

    def __setitem__(self, name: str, value: Any) -> None:
        """Set a uniform; an array as rows, of which the shader takes as many as it uses."""
        for block in self._blocks:
            if name in block.members:
                block.tell(name, value)
                return
        uniform = self._program.get(name, None)
        if uniform is None or name in self._slots:
            self._check_declared(name)
            return
        uniform = cast(moderngl.Uniform, uniform)
        if isinstance(value, np.ndarray):
            rows = value[: uniform.array_length]
            uniform.write(np.ascontiguousarray(rows).tobytes())
        else:
            uniform.value = value
        if (tape := _recording.get()) is not None:
            tape.tell(self._program, name, uniform.read())

    def __contains__(self, name: str) -> bool:
        """Return True if a resource or uniform is in use."""
        told = any(name in block.members for block in self._blocks)
        return told or name in self._slots or name in self._program

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
        self._launch(partial(self._program.mglo.run, x, y, 1), resources)

    def run_over(self, size: tuple[int, int], /, **resources: Resource) -> None:
        """Dispatch so many work groups that each pixel of `size` (width, height) has its own."""
        self.run(*self._groups_over(size), **resources)

    def run_indirect(self, groups: moderngl.Buffer, offset: int, /, **resources: Resource) -> None:
        """Dispatch as many work groups as `groups` says at `offset` bytes: x, y, z of uint32."""
        self._launch(partial(self._program.mglo.run_indirect, groups.mglo, offset), resources)

    def release(self) -> None:
        """Free the program."""
        self._program.release()
        for block in self._blocks:
            block.release()

    def _launch(self, run: Callable[[], object], resources: dict[str, Resource]) -> None:
        for bind in (*self._bindings(resources), *(block.bind() for block in self._blocks)):
            ask(bind)
        ask(Launch(self._program, run))
        if self._writes:
            ask(partial(self._ctx.mglo.memory_barrier, moderngl.ALL_BARRIER_BITS, False))

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
            case "buffer", moderngl.Buffer():
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
    """Every name that a caller may give: uniforms, images, samplers, buffers."""
    names = {match[3] for match in _IMAGE.finditer(code)}
    names |= {match[1] for match in _SAMPLER.finditer(code)}
    for match in _BLOCK.finditer(code):
        of_block = {member[3] for member in _MEMBER.finditer(match[4])}
        names |= {_argument(match[3])} if match[2] == "buffer" else of_block
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
    buffers = {m[3]: m[1].split() for m in _BLOCK.finditer(code) if m[2] == "buffer"}
    samplers = {match[1] for match in _SAMPLER.finditer(code)}
    slots: dict[str, _Slot] = {}
    taken = dict.fromkeys(("image", "sampler", "buffer"), 0)
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
        elif name in buffers:
            slot = _Slot("buffer", taken["buffer"], writes="readonly" not in buffers[name])
            member.binding = slot.point
            name = _argument(name)
        else:
            continue
        slots[name] = slot
        taken[slot.kind] += count
    return slots


def _blocks(ctx: moderngl.Context, program: moderngl.ComputeShader, code: str) -> list[_Block]:
    """Give the uniform blocks in use their binding points."""
    blocks: list[_Block] = []
    for match in _BLOCK.finditer(code):
        block = program.get(match[3], None)
        if match[2] == "uniform" and isinstance(block, moderngl.UniformBlock):
            block.binding = len(blocks)
            blocks.append(_Block(ctx, block.binding, block.size, _members(match[4])))
    return blocks


def _members(text: str) -> dict[str, _Member]:
    """Members of a block by name, laid out as std140 has it."""
    members, end = {}, 0
    for kind, width, name, array in _MEMBER.findall(text):
        count = int(width or 1)
        edge = 16 if array else 4 * {1: 1, 2: 2}.get(count, 4)
        first = -(-end // edge) * edge
        number = {"i": "i4", "u": "u4"}.get(kind[0], "f4")
        members[name] = _Member(first, 16 if array else 0, number)
        end = first + 4 * count
    return members


def _argument(block: str) -> str:
    """Name of a block as callers write it: OfGroups is of_groups."""
    return _CAPITAL.sub("_", block).lower()


def _group(code: str) -> tuple[int, int]:
    """Invocations of a work group along x and y."""
    defined = {match[1]: int(match[2]) for match in _DEFINE.finditer(code)}
    edges = {axis: defined.get(edge) or int(edge) for axis, edge in _LOCAL_SIZE.findall(code)}
    return edges.get("x", 1), edges.get("y", 1)
