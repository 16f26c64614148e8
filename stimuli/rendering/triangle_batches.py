"""The triangles of a world on the GPU, joined by material, and the programs that draw them."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from importlib import resources
from typing import Any

import moderngl
import numpy as np
from numpy.typing import NDArray

from pipeline.gl.texture import check_size
from stimuli.rendering.world import Material, Mesh, MeshPart

_INCLUDE = re.compile(r'^\s*#include\s+"([^"]+)"\s*$', re.MULTILINE)


def program(ctx: moderngl.Context, vertex: str, fragment: str) -> moderngl.Program:
    """Compile two shaders of this package."""
    return ctx.program(vertex_shader=shader_text(vertex), fragment_shader=shader_text(fragment))


def shader_text(name: str) -> str:
    """Return a shader of this package with its includes."""
    folder = resources.files("stimuli.rendering") / "shaders"
    text = (folder / name).read_text(encoding="utf-8")
    return _INCLUDE.sub(lambda match: shader_text(match[1]), text)


def columns(matrix: NDArray[np.float64]) -> tuple[float, ...]:
    """A matrix as OpenGL wants it, column by column."""
    return tuple(matrix.T.ravel().astype(float))


def projection(
    size_px: tuple[int, int], lens_px: tuple[float, float, float, float], near_m: float
) -> NDArray[np.float64]:
    """Clip space from camera axes: x right, y down as rows of an array, far plane at infinity.

    Parameters
    ----------
    size_px : (width, height)
    lens_px : (fx, fy, cx, cy)
        Focal lengths, and the place of the axis.
    """
    (width, height), (fx, fy, cx, cy) = size_px, lens_px
    return np.array(
        [
            [2 * fx / width, 0, 2 * cx / width - 1, 0],
            [0, 2 * fy / height, 2 * cy / height - 1, 0],
            [0, 0, 1, -2 * near_m],
            [0, 0, 1, 0],
        ]
    )


def set_uniform(shader: Any, name: str, value: object) -> None:
    """Set a uniform, unless the compiler found it unused in this shader."""
    uniform = shader.get(name, None)
    if isinstance(uniform, moderngl.Uniform):
        uniform.value = value


ANISOTROPY = 4.0
_SRGB8_ALPHA8 = 0x8C43
_VERTEX = "3f 3f 2f 4f"
_NAMES = ("in_position", "in_normal", "in_uv", "in_colour")


@dataclass(eq=False)
class TriangleBatch:
    """All triangles of one material on the GPU."""

    material: Material
    vertices: moderngl.Buffer
    indices: moderngl.Buffer
    texture: moderngl.Texture
    glow: moderngl.Texture
    surface: moderngl.VertexArray
    depth: moderngl.VertexArray

    def set_openness(
        self, mesh: Mesh, openness: NDArray[np.floating], origin_m: NDArray[np.float64]
    ) -> None:
        """Set the share of the sky that each vertex of `mesh`, the batch's own, sees: in [0, 1]."""
        self.vertices.write(_vertex_bytes(mesh, origin_m, openness))

    def release(self) -> None:
        """Free it all."""
        for resource in (self.surface, self.depth, self.vertices, self.indices, self.texture):
            resource.release()
        if self.glow is not self.texture:
            self.glow.release()


class DepthShaders:
    """Shaders that draw depth alone: one looks for gaps, and one that does not is faster."""

    def __init__(self, ctx: moderngl.Context) -> None:
        self._solid = program(ctx, "surface.vert.glsl", "solid_depth.frag.glsl")
        self._cutout = program(ctx, "surface.vert.glsl", "cutout_depth.frag.glsl")
        set_uniform(self._cutout, "albedo", 0)

    def of(self, material: Material) -> moderngl.Program:
        """Return the shader that `material` needs."""
        return self._cutout if material.cutout else self._solid

    def draw(
        self,
        batches: Iterable[TriangleBatch],
        clip_from_world: NDArray[np.float64],
        cull: Callable[[Material], None] = lambda _: None,
    ) -> None:
        """Draw the depth of `batches` into the framebuffer in use; `cull` is told of each."""
        for shader in (self._solid, self._cutout):
            set_uniform(shader, "clip_from_world", columns(clip_from_world))
        for batch in batches:
            cull(batch.material)
            batch.texture.use(0)
            set_uniform(self._cutout, "clamped", batch.material.clamp)
            batch.depth.render(moderngl.TRIANGLES)

    def release(self) -> None:
        """Free both."""
        self._solid.release()
        self._cutout.release()


def upload_triangles(
    ctx: moderngl.Context,
    parts: tuple[MeshPart, ...],
    origin_m: NDArray[np.float64],
    surface: moderngl.Program,
    depth: DepthShaders,
) -> list[tuple[TriangleBatch, Mesh]]:
    """Put the triangles of `parts` on the GPU, places counted from `origin_m`.

    Raises
    ------
    InputError
        If a texture is larger than the driver can hold.
    """
    groups: dict[int, tuple[Material, list[Mesh]]] = {}
    for part in parts:
        if len(part.mesh.triangles):
            groups.setdefault(id(part.material), (part.material, []))[1].append(part.mesh)
    batches = []
    for material, meshes in groups.values():
        mesh = Mesh.joined(meshes)
        texture = _texture(ctx, material, material.texture)
        glow = texture if material.glow is None else _texture(ctx, material, material.glow)
        vertices = ctx.buffer(_vertex_bytes(mesh, origin_m, np.ones(len(mesh.position_m))))
        indices = ctx.buffer(mesh.triangles.tobytes())
        arrays = [
            ctx.vertex_array(shader, [(vertices, _VERTEX, *_NAMES)], indices, skip_errors=True)
            for shader in (surface, depth.of(material))
        ]
        batches.append((TriangleBatch(material, vertices, indices, texture, glow, *arrays), mesh))
    return batches


def _vertex_bytes(
    mesh: Mesh, origin_m: NDArray[np.float64], openness: NDArray[np.floating]
) -> bytes:
    packed = np.concatenate(
        [
            (mesh.position_m - origin_m).astype(np.float32),
            mesh.normal,
            mesh.uv,
            mesh.colour,
            openness.astype(np.float32)[:, None],
        ],
        axis=1,
    )
    return packed.astype(np.float32).tobytes()


def _texture(
    ctx: moderngl.Context, material: Material, pixels: NDArray[np.uint8]
) -> moderngl.Texture:
    height, width, _ = pixels.shape
    check_size(ctx, (width, height))
    data = np.ascontiguousarray(pixels)
    texture = ctx.texture((width, height), 4, data, internal_format=_SRGB8_ALPHA8)
    texture.repeat_x, texture.repeat_y = (not clamp for clamp in material.clamp)
    texture.build_mipmaps()
    enlarged = moderngl.NEAREST if material.nearest else moderngl.LINEAR
    texture.filter = (moderngl.LINEAR_MIPMAP_LINEAR, enlarged)
    if not material.nearest:  # some drivers filter linearly where it is set
        texture.anisotropy = min(ANISOTROPY, float(ctx.max_anisotropy))
    return texture
