"""Eidolons and warped metamers on the GPU. Twin: displacement.py.

The field's noise is halved once per seed; a call pushes it, looks the picture up, and for a match
pulls the moments of both pictures and pushes what the displaced one lacks.
"""

from __future__ import annotations

import moderngl
import numpy as np

from pipeline.features.gpu import band_constants
from pipeline.foveation.chain import chain_length, chain_of
from pipeline.foveation.displacement import (
    CUBIC,
    LEAST_MATCH,
    LEAST_SMOOTHNESS_PX,
    MOST_MATCH,
    REACH,
    DisplacementSettings,
    field_noise,
    white_energies,
)
from pipeline.foveation.geometry import Geometry
from pipeline.foveation.gpu import (
    Call,
    ChainPass,
    FoveationPass,
    Pooled,
    halved,
    resolutions,
)
from pipeline.foveation.lod import FADE_SHARE, HALVED_VARIANCE
from pipeline.foveation.moments import SMALLEST_VARIANCE
from pipeline.foveation.noise_plane import check_seed
from pipeline.foveation.sphere import FINEST, noise_key
from pipeline.gl.shader import set_array

MATCH_CONSTANTS: dict[str, int | float | bool] = {
    "SMALLEST_VARIANCE": SMALLEST_VARIANCE,
    "LEAST_MATCH": LEAST_MATCH,
    "MOST_MATCH": MOST_MATCH,
}


class DisplacementPass(FoveationPass):
    """`eidolon`, and with `match` `warped-metamer`.

    Raises
    ------
    InputError, GLUnavailableError
        If the driver cannot hold pictures of this size.
    """

    carries_noise = False

    def __init__(
        self,
        ctx: moderngl.Context,
        geometry: Geometry,
        settings: DisplacementSettings,
        *,
        match: bool,
    ) -> None:
        super().__init__(ctx, geometry, settings.pooling)
        self.settings = settings
        self._field_pooled = Pooled(geometry, settings.pooling)
        self._levels = min(settings.levels, chain_length(*self.size))
        self._join = self._compile("join", FADE_SHARE=FADE_SHARE, MATCHED=match, **MATCH_CONSTANTS)
        self._warped = self._texture(self.size)
        kind = _SphereField if geometry.on_sphere else _FlatField
        self._field = kind(self, self._field_pooled, settings)
        self._match: _Match | None = _Match(self, self._pooled, self._levels) if match else None

    @property
    def dispatches(self) -> int:
        return self._field.dispatches + 1 + (self._match.dispatches if self._match else 0)

    def set_seed(self, seed: int) -> None:
        """Make the noise of `seed`, unless it is the one at hand."""
        self._field.set_seed(check_seed(seed))

    def _show(self, source: moderngl.Texture, target: moderngl.Texture, call: Call) -> None:
        self.set_seed(call.seed)
        self._field_pooled.look(call.field_gaze_px)
        self._field.displace(source, self._warped)
        if self._match:
            self._match(source, self._warped)
            self._match.lend(self._join)
        self._draw(self._join, target, (source, self._warped), halved(self.size))


class _FlatField:
    """The field of a flat picture: noise, halved once per seed, and pushed for a gaze."""

    def __init__(
        self, owner: DisplacementPass, pooled: Pooled, settings: DisplacementSettings
    ) -> None:
        self._owner = owner
        self._count = count = chain_length(*owner.size)
        least = {"LEAST_VARIANCE": LEAST_SMOOTHNESS_PX**2 / HALVED_VARIANCE}
        self._push = owner._keep(pooled.compile(owner.ctx, "foveation/field.comp.glsl", **least))
        self._displace = owner._keep(
            pooled.compile(
                owner.ctx,
                "foveation/displace.comp.glsl",
                REACH=REACH,
                CUBIC=CUBIC,
                HALVINGS=count,
                **least,
            )
        )
        self._push["smoothness"] = self._displace["smoothness"] = settings.smoothness
        self._displace["reach"] = settings.reach
        set_array(self._displace, "energies", np.array(white_energies(count + 2), np.float32))
        self._sizes = resolutions(owner.size, count)
        self._noise = [owner._texture(size, "rg32f") for size in self._sizes]
        # By resolution less 1: the finest is the look-up's.
        self._chosen = [owner._texture(size, "rg32f") for size in self._sizes[1:-1]]
        self._seed: int | None = None

    @property
    def dispatches(self) -> int:
        return self._count

    def set_seed(self, seed: int) -> None:
        if seed == self._seed:
            return
        white = field_noise(self._owner.size[::-1], seed)
        for texture, noise in zip(
            self._noise, chain_of(white, self._count, wraps=False), strict=True
        ):
            texture.write(np.ascontiguousarray(noise, np.float32).tobytes())
        self._seed = seed

    def displace(self, source: moderngl.Texture, warped: moderngl.Texture) -> None:
        for r in reversed(range(1, self._count)):
            coarse = self._chosen[r] if r + 1 < self._count else self._noise[r + 1]
            self._push["halvings"] = r
            read = [self._noise[r], coarse]
            self._owner._draw(self._push, self._chosen[r - 1], read, self._sizes[r])
        read = [source, self._noise[0], self._chosen[0]]
        self._owner._draw(self._displace, warped, read, self._owner.size)


class _SphereField:
    """The field of a panorama, or of its pole: worked out where it is wanted, see sphere.py."""

    dispatches = 1

    def __init__(
        self, owner: DisplacementPass, pooled: Pooled, settings: DisplacementSettings
    ) -> None:
        self._owner = owner
        self._displace = owner._keep(
            pooled.compile(
                owner.ctx, "foveation/displace_sphere.comp.glsl", CUBIC=CUBIC, FINEST=FINEST
            )
        )
        self._displace["smoothness"], self._displace["reach"] = settings.smoothness, settings.reach

    def set_seed(self, seed: int) -> None:
        self._displace["key"] = noise_key(seed)

    def displace(self, source: moderngl.Texture, warped: moderngl.Texture) -> None:
        self._owner._draw(self._displace, warped, (source,), self._owner.size)


class _Match:
    """What the displaced picture lacks of the pooled moments of the picture."""

    def __init__(self, owner: DisplacementPass, pooled: Pooled, levels: int) -> None:
        self._owner = owner
        self._true, self._own = (
            ChainPass(owner, pooled, levels, 0, chroma=False) for _ in range(2)
        )
        self._count, self._levels = self._true.count, levels
        # By resolution less 1: the finest is the join's.
        self._difference = [owner._texture(size) for size in self._true.sizes[1:]]
        self._change = [owner._texture(size) for size in self._true.sizes[1:levels]]
        taps = band_constants()
        self._shaders: dict[tuple[bool, bool], moderngl.ComputeShader] = {}
        for r in range(1, self._count + 1):
            key = (r < levels, r == self._count)
            if key not in self._shaders:
                self._shaders[key] = owner._keep(
                    pooled.compile(
                        owner.ctx,
                        "foveation/match.comp.glsl",
                        LEVEL=key[0],
                        DEEPEST=key[1],
                        WRAPS=owner.geometry.wraps,
                        **MATCH_CONSTANTS,
                        ORIENTED_EDGE=taps["ORIENTED_EDGE"],
                        ORIENTED_CORNER=taps["ORIENTED_CORNER"],
                    )
                )

    @property
    def dispatches(self) -> int:
        return self._true.dispatches + self._own.dispatches + self._count

    def __call__(self, source: moderngl.Texture, warped: moderngl.Texture) -> None:
        """Push the difference of pools' means, and what bands add too little, to resolution 1."""
        self._true.pull(source)
        self._own.pull(warped)
        self._true.push(2)
        self._own.push(2)
        for r in range(self._count, 0, -1):
            is_level, deepest = r < self._levels, r == self._count
            shader = self._shaders[is_level, deepest]
            self._true.lows[r - 1].use(0)
            self._own.lows[r - 1].use(1)
            self._difference[r - 1].bind_to_image(0, read=False, write=True)
            if not deepest:
                self._difference[r].use(2)
            if is_level:
                self._change[r - 1].bind_to_image(1, read=False, write=True)
                self._own.lows[r].use(3)
                self._change[min(r, self._levels - 2)].use(4)
                for unit, chain in ((5, self._true), (6, self._own)):
                    moments = chain.moments[r]
                    assert moments is not None
                    moments.use(unit)
                shader["moments_at"] = r + 1
                shader["has_coarse_change"] = r + 1 < self._levels
            if "halvings" in shader:
                shader["halvings"] = r
            self._owner._run(shader, self._true.sizes[r])

    def lend(self, join: moderngl.ComputeShader) -> None:
        """Bind what the last push reads."""
        self._difference[0].use(2)
        self._own.lows[0].use(3)
        (self._change[0] if self._change else self._difference[0]).use(4)
        for unit, chain in ((5, self._true), (6, self._own)):
            moments = chain.moments[1]
            assert moments is not None
            moments.use(unit)
        join["has_coarse_change"] = bool(self._change)
