"""Our built-in scenes path-traced by Mitsuba 3: any number of samples a pixel, most at the gaze.

A view is rendered with 1, 1, 2, 4, 8 and 16 samples a pixel, which add up to 1, 2, 4, ... 32; so a
noisy picture for any gaze takes each pixel from the sum with its number of samples. The clean
picture has samples of its own.

Triangles, textures, sun and sky are those of our own renderer; light is really followed here, so
pictures are noisy until many samples are averaged. Left out are haze, light through leaves, and
tints that change within a part (their mean counts).

Needs mitsuba, the extra `denoise`; without it the module imports and `PathTracer` refuses.
"""

from __future__ import annotations

from dataclasses import dataclass
from importlib.util import find_spec
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from pipeline.camera import Camera
from pipeline.colour import decode_srgb, encode_srgb
from pipeline.denoising.maps import Sampling
from pipeline.errors import InputError, MissingExtraError
from stimuli.rendering.world import Light, MeshPart, Viewpoint, World, vector
from stimuli.scenes.builtin_scenes import scene_entry

_Described: TypeAlias = dict[str, Any]
"""A part of a scene, as Mitsuba takes it."""

INSTALL = (
    "install it with: pip install 'metamerlab[denoise]' (in a checkout: script/setup --denoise)"
)
VARIANT = "scalar_rgb"
"""Variant of Mitsuba: runs everywhere, and gives equal bytes on any number of threads."""
BOUNCES = 4
"""Bounces of light at most, the one to the eye included."""
WHITE = 3.2  # of tone_map, as in stimuli/rendering/shaders/light.glsl
FARTHEST_SEED = 2**31
WIDTH_DEG = 40.0
"""Width of all pictures, on the eye."""
SCENE_SEED = 1
# How far views lie from where a scene begins: in distances to what it looks at, and degrees.
SHIFT = (0.16, 0.05, 0.12)  # right, down, forward
TURN_DEG = (22.0, 7.0)  # sideways, up


class PathTracer:
    """One world as Mitsuba's scene; loads on construction, a call renders.

    Parameters
    ----------
    world : World

    Raises
    ------
    MissingExtraError
        If Mitsuba is not installed.
    """

    def __init__(self, world: World) -> None:
        if find_spec("mitsuba") is None:
            raise MissingExtraError(f"path tracing needs mitsuba (it is not installed); {INSTALL}")
        import mitsuba

        mitsuba.set_variant(VARIANT)
        mitsuba.set_log_level(mitsuba.LogLevel.Error)
        self._mitsuba = mitsuba
        light = world.light or Light()
        self._exposure = light.exposure
        scene: _Described = {
            "type": "scene",
            "integrator": {"type": "path", "max_depth": BOUNCES, "rr_depth": 99},
            "sun": {
                "type": "directional",
                "direction": [-value for value in light.sun_direction],
                "irradiance": {"type": "rgb", "value": [float(np.pi * v) for v in light.sun]},
            },
            "sky": self._sky(world, light),
        }
        for index, part in enumerate(world.parts):
            if len(part.mesh.triangles):
                scene[f"part{index}"] = self._mesh(f"part{index}", part)
        self._scene = mitsuba.load_dict(scene)

    def render(self, camera: Camera, samples: int, seed: int) -> NDArray[np.float32]:
        """Linear light that reaches the camera: (H, W, 3), the mean of `samples` a pixel.

        Pixels share no samples: what one pixel shows does not depend on its neighbours.
        """
        mitsuba = self._mitsuba
        place = camera.world_from_camera
        origin, ahead, up = place[:3, 3], place[:3, 2], -place[:3, 1]
        sensor = mitsuba.load_dict(
            {
                "type": "perspective",
                "fov": float(np.degrees(2 * np.arctan(camera.width_px / 2 / camera.fx_px))),
                "fov_axis": "x",
                "near_clip": 0.01,
                "far_clip": 1e5,
                "to_world": mitsuba.ScalarTransform4f().look_at(
                    origin.tolist(), (origin + ahead).tolist(), up.tolist()
                ),
                "film": {
                    "type": "hdrfilm",
                    "width": camera.width_px,
                    "height": camera.height_px,
                    "rfilter": {"type": "box"},
                    "pixel_format": "rgb",
                },
                "sampler": {"type": "independent", "sample_count": samples},
            }
        )
        found = mitsuba.render(
            self._scene, sensor=sensor, spp=samples, seed=int(seed) % FARTHEST_SEED
        )
        return np.array(found, np.float32)[..., :3]

    def shown(self, light: NDArray[np.floating]) -> NDArray[np.float32]:
        """Encode light as our renderer does: exposure, its tone curve, sRGB; within [0, 1]."""
        return encoded(self._exposure * light.astype(np.float64))

    def _sky(self, world: World, light: Light) -> _Described:
        """The panorama, as bright on average as the sky's light."""
        mitsuba = self._mitsuba
        if world.sky is None:
            return {"type": "constant", "radiance": {"type": "rgb", "value": list(light.sky)}}
        linear = decode_srgb(world.sky.astype(np.float64) / 255)
        rows = len(linear)
        above = linear[: rows // 2]
        weights = np.sin((np.arange(rows // 2) + 0.5) / rows * np.pi)
        mean = (above.mean(axis=1) * weights[:, None]).sum(axis=0) / weights.sum()
        radiance = np.roll(linear * (np.asarray(light.sky) / mean), linear.shape[1] // 2, axis=1)
        return {"type": "envmap", "bitmap": mitsuba.Bitmap(radiance.astype(np.float32))}

    def _mesh(self, name: str, part: MeshPart) -> Any:
        mitsuba, mesh = self._mitsuba, part.mesh
        properties = mitsuba.Properties()
        properties["bsdf"] = mitsuba.load_dict(self._surface(part))
        made = mitsuba.Mesh(
            name,
            len(mesh.position_m),
            len(mesh.triangles),
            has_vertex_normals=True,
            has_vertex_texcoords=True,
            props=properties,
        )
        held = mitsuba.traverse(made)
        held["vertex_positions"] = mesh.position_m.ravel()
        held["vertex_normals"] = mesh.normal.ravel()
        held["vertex_texcoords"] = mesh.uv.ravel()
        held["faces"] = mesh.triangles.ravel()
        held.update()
        return made

    def _surface(self, part: MeshPart) -> _Described:
        mitsuba, material = self._mitsuba, part.material
        colour = decode_srgb(material.texture[..., :3].astype(np.float64) / 255)
        tinted = np.clip(colour * part.mesh.colour.mean(axis=0), 0, 0.99).astype(np.float32)

        def texture(values: NDArray[np.float32]) -> _Described:
            return {"type": "bitmap", "bitmap": mitsuba.Bitmap(values), "raw": True}

        surface: _Described = {
            "type": "twosided",
            "bsdf": {"type": "diffuse", "reflectance": texture(np.ascontiguousarray(tinted))},
        }
        if material.cutout:
            covered = (material.texture[..., 3:] >= 128).astype(np.float32)
            surface = {
                "type": "mask",
                "bsdf": surface,
                "opacity": texture(np.ascontiguousarray(covered)),
            }
        return surface


def encoded(light: NDArray[np.float64]) -> NDArray[np.float32]:
    """Tone-map and encode linear light. Twin: stimuli/rendering/shaders/light.glsl."""
    mapped = light * (1 + light / WHITE**2) / (1 + 0.45 * light)
    return encode_srgb(np.clip(mapped, 0, 1)).astype(np.float32)


@dataclass(frozen=True)
class SceneView:
    """One camera in one built-in scene.

    Parameters
    ----------
    number : int
        Index of the view; 0 is the scene's own.
    """

    scene: str
    number: int

    def __post_init__(self) -> None:
        scene_entry(self.scene)
        if self.number < 0:
            raise InputError(f"a view's number must be at least 0 (got {self.number})")

    def camera(self, world: World, edge_px: int) -> Camera:
        """A square camera near where the scene begins; that of view 0 is there."""
        rng = np.random.default_rng((SCENE_SEED, self.number))
        start = world.viewpoint
        first = Viewpoint(start.position_m, start.look_at_m, WIDTH_DEG).camera(edge_px, edge_px)
        if self.number == 0:
            return first
        ahead_m = np.subtract(start.look_at_m, start.position_m)
        away_m = float(np.linalg.norm(ahead_m))
        moved = first.moved(away_m * np.multiply(SHIFT, rng.uniform(-1, 1, 3)))
        aside, up = np.radians(np.multiply(TURN_DEG, rng.uniform(-1, 1, 2)))
        pose = moved.world_from_camera
        forward = (
            np.cos(aside) * np.cos(up) * pose[:3, 2]
            + np.sin(aside) * np.cos(up) * pose[:3, 0]
            - np.sin(up) * pose[:3, 1]
        )
        position = pose[:3, 3]
        there = position + away_m * forward
        return Viewpoint(vector(position), vector(there), WIDTH_DEG).camera(edge_px, edge_px)


@dataclass(frozen=True)
class Rendering:
    """Settings by which views are rendered.

    Parameters
    ----------
    edge_px : int
        Of the square pictures; a multiple of 8.
    clean_samples : int
        A pixel of the clean picture has so many.
    """

    edge_px: int = 256
    clean_samples: int = 128

    def __post_init__(self) -> None:
        if not (64 <= self.edge_px <= 1024 and self.edge_px % 8 == 0):
            raise InputError(
                "path-traced pictures must have a multiple of 8 from 64 to 1024 px an edge"
                f" (got {self.edge_px})"
            )
        if not 1 <= self.clean_samples <= 65536:
            raise InputError(
                f"clean pictures must have 1 to 65536 samples a pixel (got {self.clean_samples})"
            )


def render_pair(
    tracer: PathTracer, world: World, view: SceneView, rendering: Rendering
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Trace one view, noisy and clean: encoded R'G'B' in [0, 1].

    Returns
    -------
    renders : ndarray of float32, shape (Sampling.halvings + 1, H, W, 3)
        With 1, 2, 4, ... samples a pixel.
    clean : ndarray of float32, shape (H, W, 3)
    """
    camera = view.camera(world, rendering.edge_px)
    seeds = np.random.default_rng((SCENE_SEED, view.number, 7)).integers(0, 2**31, 16)
    total = np.zeros((rendering.edge_px, rendering.edge_px, 3))
    renders, so_far = [], 0
    for index in range(Sampling.halvings + 1):
        wanted = 1 << index
        more = wanted - so_far
        total += more * tracer.render(camera, more, int(seeds[index]))
        so_far = wanted
        renders.append(tracer.shown(total / wanted))
    clean = tracer.shown(tracer.render(camera, rendering.clean_samples, int(seeds[-1])))
    return np.stack(renders), clean
