"""The passes of a metamer as a page draws them by WebGL2, from a picture that was pulled before.

Twin: `MetamerPass` in gpu.py, whose shaders these are. The pull is done by numpy.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pipeline.errors import InputError
from pipeline.foveation.catalogue import Condition, Metamer
from pipeline.foveation.chain import chain_length, chain_of
from pipeline.foveation.chain_gpu import POWERS
from pipeline.foveation.geometry import FlatGeometry
from pipeline.foveation.noise_plane import GRAIN, MOST_STEPS, tile_edge
from pipeline.foveation.picture_pass import (
    TILE,
    PoolUniforms,
    gains_constants,
    halved,
    noise_constants,
    resolutions,
    weight_layers,
)
from pipeline.foveation.pooled_moments import moment_chain, power_chain
from pipeline.frame import Floats
from pipeline.gl.fragment import fragment_of
from pipeline.gl.shader import Constant, flatten
from pipeline.noise.gpu import (
    HALVE_SHADER,
    MIX_SHADER,
    RAISE_SHADER,
    WHITE_SHADER,
    WORK_EDGE,
    filter_constants,
    layers_of,
    mix_constants,
)
from pipeline.noise.tile import (
    WHITE_BITS,
    Stream,
    key_of,
    mixing_weights,
    split,
    square_sum,
    white_steps,
)
from pipeline.pictures.decode import as_floats

# Of a level's moments and of powers, packed: the four values of each layer, as pull.comp.glsl has.
_MOMENT_LAYERS = ((0, 1, 2, 6), (3, 4, 5, 7))
_POWER_LAYERS = ((0, 1, 2, 10), (3, 4, 5, 11), (6, 7, 8, 9))


class PageShader(NamedTuple):
    """A compute shader, its constants, and the image of it that a fragment shader draws."""

    path: str
    constants: Mapping[str, Constant]
    image: str
    shared: int = 1
    known: Mapping[str, list[int]] | None = None


@dataclass(eq=False)
class PagePasses:
    """Picture, textures and shaders with which a page draws a metamer for any gaze.

    Attributes
    ----------
    source : ndarray of uint8, shape (H, W, 3)
        The picture: texture ``source``.
    pulled : dict
        Textures whose texels are known, float32 of shape (layers, h, w, 4).
    textures : dict
        Of the others: format of OpenGL, width, height, layers (0: no array).
    programs : list of str
        Fragment shaders.
    once, always : list of dict
        What is drawn once, and for each gaze: `program`, the texture `to`, those that it reads by
        the sampler's name, and what uniforms are `told`. The last one makes ``target``.
    """

    source: NDArray[np.uint8]
    pulled: dict[str, NDArray[np.float32]] = field(default_factory=dict)
    textures: dict[str, tuple[str, int, int, int]] = field(default_factory=dict)
    programs: list[str] = field(default_factory=list)
    once: list[dict[str, Any]] = field(default_factory=list)
    always: list[dict[str, Any]] = field(default_factory=list)

    def add(
        self,
        steps: list[dict[str, Any]],
        shader: PageShader,
        to: str,
        reads: Mapping[str, str],
        told: Mapping[str, Any] | None = None,
    ) -> None:
        """Add a step that draws the image of a shader into the texture `to`."""
        path, constants, image, shared, known = shader
        program = fragment_of(flatten(path, constants), image, shared=shared, known=known)
        if program not in self.programs:
            self.programs.append(program)
        _, *size, layers = self.textures[to]
        size = [*size, layers] if layers else size
        steps.append(
            {
                "program": self.programs.index(program),
                "to": to,
                "reads": dict(reads),
                "told": {**(told or {}), f"{image}_size": size},
            }
        )


def check_condition(condition: Condition, name: str) -> Metamer:
    """Return a condition that a page can draw.

    Raises
    ------
    InputError
        If it is another one.
    """
    if not isinstance(condition, Metamer) or condition.settings.chroma == "full":
        given = f"{name}, chroma full" if isinstance(condition, Metamer) else name
        raise InputError(
            "a page shows the method metamer, with chroma follow or luma"
            f" (got {given}); give --methods metamer"
        )
    return condition


def page_passes(
    picture: NDArray[np.uint8], geometry: FlatGeometry, condition: Metamer, seed: int
) -> PagePasses:
    """Pull a picture, and say how a page goes on.

    Parameters
    ----------
    picture : ndarray of shape (H, W, 3)
        Encoded R'G'B' of 8 bits.
    """
    settings = condition.settings
    size = geometry.width_px, geometry.height_px
    count = chain_length(*size)
    levels = min(settings.levels, count)
    chroma = settings.chroma != "luma"
    deepest = levels if settings.residual == "kept" else count
    page = PagePasses(picture)
    pooled = PoolUniforms(geometry, condition.pooling)
    sizes = resolutions(size, count)
    _pull(page, levels, deepest, count, chroma)
    _add_noise(page, seed, levels, tile_edge(size[1], size[0]))

    def chosen(kind: str, r: int) -> str:
        return f"chosen_{kind}_{r}" if f"chosen_{kind}_{r}" in page.textures else f"{kind}_{r}"

    def push(r: int) -> None:
        base, layers = r < deepest, min(r, levels) if r > 2 else 0
        powers = chroma and layers > 0
        kinds = {"lows": base, "moments": layers > 0, "powers": powers}
        names = {"lows": "", "moments": "_moments", "powers": "_powers"}
        depth = {"lows": 0, "moments": 2 * layers, "powers": POWERS}
        constants = {
            "TILE": TILE, **pooled.constants, "BASE": base, "LAYERS": layers, "POWERS": powers
        }  # fmt: skip
        made = [kind for kind, wanted in kinds.items() if wanted]
        # WebGL wants a texture for each sampler, also where what is read of it is not kept.
        reads = {
            f"{end}{names[kind]}": texture
            for kind in made
            for end, texture in (("fine", f"{kind}_{r}"), ("coarse", chosen(kind, r + 1)))
        }
        for kind in made:
            page.textures[f"chosen_{kind}_{r}"] = ("RGBA32F", *sizes[r], depth[kind])
            shader = PageShader(
                "foveation/shaders/push.comp.glsl", constants, f"chosen{names[kind]}"
            )
            page.add(
                page.always, shader, f"chosen_{kind}_{r}", reads,
                {**pooled.fixed, "halvings": r, "chosen_size": sizes[r],
                 "chosen_moments_size": (*sizes[r], 2 * layers)},
            )  # fmt: skip

    for r in range(count - 1, 1, -1):
        push(r)
    bands = weight_layers(levels, bent=chroma)
    page.textures["weights"] = ("RGBA32F", *sizes[2], bands)
    last = min(max(3, levels), count)
    page.add(
        page.always,
        PageShader(
            "foveation/shaders/gains.comp.glsl",
            {"TILE": TILE, **pooled.constants,
             **gains_constants(levels, chroma=chroma, count=count)},
            "weights", shared=2,
        ),
        "weights",
        {**{f"moments[{r - 1}]": chosen("moments", r) for r in range(1, last + 1)},
         **{f"powers[{r - 2}]": chosen("powers", r) for r in range(2, last + 1)[:2] if chroma}},
        pooled.fixed,
    )  # fmt: skip
    push(1)
    page.textures["target"] = ("RGBA8", *size, 0)
    page.add(
        page.always,
        PageShader(
            "foveation/shaders/finish_screen.comp.glsl",
            {"TILE": TILE, **pooled.constants, **noise_constants(levels, BENT=chroma)},
            "target", shared=2,
        ),
        "target",
        {"source": "source", "coarse": chosen("lows", 1), "weights": "weights", "noise": "noise"},
        {**pooled.fixed, "strength": settings.noise},
    )  # fmt: skip
    return page


def _pull(page: PagePasses, levels: int, deepest: int, count: int, chroma: bool) -> None:
    pulled: dict[str, Floats] = {}
    lows = chain_of(as_floats(page.source).astype(np.float64), count, wraps=False)
    for r in range(1, deepest + 1):
        pulled[f"lows_{r}"] = np.pad(lows[r], ((0, 0), (0, 0), (0, 1)))[None]
    chains = [moment_chain(lows[level], count - level, wraps=False) for level in range(levels)]
    for r in range(1, count + 1):
        pulled[f"moments_{r}"] = np.stack(
            [
                chains[level][r - level - 1][..., layer]
                for level in range(min(r, levels))
                for layer in _MOMENT_LAYERS
            ]
        )
    if chroma:
        for r, powers in enumerate(power_chain(lows, wraps=False), start=2):
            pulled[f"powers_{r}"] = np.stack([powers[..., one] for one in _POWER_LAYERS])
    page.pulled |= {name: one.astype(np.float32) for name, one in pulled.items()}


def _add_noise(page: PagePasses, seed: int, levels: int, edge: int) -> None:
    """Add what makes the noise of a seed, from its key and how its bands are mixed."""
    bands = split(white_steps(seed, (edge, edge), 1), levels).reshape(3 * levels, edge, edge)
    weights = mixing_weights([square_sum(band) for band in bands], edge * edge)
    sizes = [(edge >> level, edge >> level) for level in range(levels + 1)]
    taps = filter_constants()
    for level, size in enumerate(sizes):
        page.textures |= {f"{name}_{level}": ("R32I", *size, 0) for name in ("low", "soft")}
    white = PageShader(WHITE_SHADER, {"TILE": WORK_EDGE, "WHITE_BITS": WHITE_BITS}, "white")
    page.add(
        page.once, white, "low_0", {},
        {"key": key_of(seed, Stream.BANDS), "first": (0, 0), "period": sizes[0]},
    )  # fmt: skip
    for level in range(levels):
        reads = {"low": f"low_{level}"}
        told = {"soft_size": sizes[level]}
        soft = PageShader(HALVE_SHADER, taps["halve"], "soft", shared=2)
        page.add(page.once, soft, f"soft_{level}", reads, told)
        after = PageShader(HALVE_SHADER, taps["halve"], "next")
        page.add(page.once, after, f"low_{level + 1}", reads, told)
    for older, level in enumerate(reversed(range(levels))):
        page.textures[f"raised_{level}"] = ("RGBA32UI", *sizes[level], layers_of(older + 1))
        reads = {"low": f"low_{level}", "soft": f"soft_{level}"}
        if older:
            reads["coarse"] = f"raised_{level + 1}"
        raised = PageShader(RAISE_SHADER, {"OLDER": older, **taps["raise"]}, "raised", shared=2)
        page.add(page.once, raised, f"raised_{level}", reads)
    page.textures["noise"] = ("RGBA32UI", *halved(sizes[0]), -(-3 * levels // 4))
    mix = PageShader(
        MIX_SHADER, mix_constants(levels, GRAIN, MOST_STEPS), "noise",
        known={"weights": weights.ravel().tolist()},
    )  # fmt: skip
    page.add(page.once, mix, "noise", {"raised": "raised_0"}, {"margin": 0})
