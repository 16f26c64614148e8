"""Base of every pass on the GPU: it owns what it made."""

from collections.abc import Callable, Collection, Hashable, Mapping
from functools import partial
from typing import Protocol, TypeVar

import moderngl

from pipeline.gl.compute import Resource, Shader, Tapes, Texture
from pipeline.gl.context import describe
from pipeline.gl.shader import Constant
from pipeline.gl.texture import create_texture, create_texture_array, texture_bytes


class PassPart(Protocol):
    """Another pass, or anything that holds memory of its own."""

    @property
    def held_bytes(self) -> int: ...

    def release(self) -> None: ...


P = TypeVar("P", bound=PassPart)


class Pass:
    """Shaders, textures, buffers and parts of a pass, made through it and freed together.

    Parameters
    ----------
    constants : mapping, optional
        Constants that each shader takes where it declares them: often all names of its twin.
        SOFTWARE, 1 where a processor draws, is there always (see docs/precision.md).
    """

    def __init__(
        self, ctx: moderngl.Context, constants: Mapping[str, Constant] | None = None
    ) -> None:
        self._ctx = ctx
        self._constants = {"SOFTWARE": describe(ctx).software, **(constants or {})}
        self._shaders: list[Shader] = []
        self._textures: list[Texture] = []
        self._buffers: list[moderngl.Buffer] = []
        self._parts: list[PassPart] = []
        self._tapes = Tapes()
        self._told: dict[str, object] = {}

    @property
    def held_bytes(self) -> int:
        """Memory beyond the caller's textures, bytes."""
        textures = sum(map(texture_bytes, self._textures))
        buffers = sum(buffer.size for buffer in self._buffers)
        return textures + buffers + sum(part.held_bytes for part in self._parts)

    def release(self) -> None:
        """Free everything this pass made."""
        self.release_but(())

    def release_but(self, kept: Collection[Texture]) -> None:
        """Free everything this pass made, but some of its own textures, until it is released."""
        self._tapes.clear()
        freed = [texture for texture in self._textures if texture not in kept]
        for item in (*self._parts, *freed, *self._buffers, *self._shaders):
            item.release()
        self._textures = [texture for texture in self._textures if texture in kept]
        for rest in (self._parts, self._buffers, self._shaders):
            rest.clear()

    def _shader(self, path: str, **constants: Constant) -> Shader:
        shader = Shader(self._ctx, path, self._constants, **constants)
        self._shaders.append(shader)
        return shader

    def _set(self, **uniforms: object) -> None:
        """Set uniforms in all shaders made so far that use them."""
        for shader in self._shaders:
            for name, value in uniforms.items():
                if name in shader:
                    shader[name] = value

    def tell(self, **uniforms: object) -> None:
        """Set uniforms that frames may change, in this pass and its parts; no tape has them."""
        if uniforms.items() <= self._told.items():
            return
        self._told.update(uniforms)
        self._set(**uniforms)
        for part in self._parts:
            if isinstance(part, Pass):
                part.tell(**uniforms)

    def _hold(self, **resources: Resource) -> None:
        """Keep resources in all shaders made so far that use them, for the runs to come."""
        for shader in self._shaders:
            shader.hold(**{name: one for name, one in resources.items() if name in shader})

    def _play(self, frame: Callable[..., object], *given: Hashable) -> None:
        """Ask for a frame of what is given, recorded the first time; see `Tapes`."""
        self._tapes.play((frame, given), partial(frame, *given))

    def _texture(self, size: tuple[int, int], format_name: str) -> moderngl.Texture:
        texture = create_texture(self._ctx, size, format_name)
        self._textures.append(texture)
        return texture

    def _array(self, size: tuple[int, int], layers: int, format_name: str) -> moderngl.TextureArray:
        array = create_texture_array(self._ctx, size, layers, format_name)
        self._textures.append(array)
        return array

    def _buffer(self, content: bytes | int) -> moderngl.Buffer:
        """A buffer of bytes, or of so many."""
        if isinstance(content, int):
            buffer = self._ctx.buffer(reserve=content)
        else:
            buffer = self._ctx.buffer(content)
        self._buffers.append(buffer)
        return buffer

    def _part(self, part: P) -> P:
        self._parts.append(part)
        return part
