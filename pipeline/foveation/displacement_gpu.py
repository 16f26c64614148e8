"""Eidolons and warped metamers on the GPU. Twin: displacement.py.

The field's noise is halved once per seed, and pushed where its gaze moves; then the picture is
looked up. For a match the moments of both pictures are pulled where these change; each call pushes
what the displaced one lacks.
"""

from __future__ import annotations

from itertools import pairwise

import moderngl
import numpy as np

from pipeline.features.reference import band_constants, low_constants
from pipeline.foveation.chain import chain_length
from pipeline.foveation.chain_gpu import MomentChainPass
from pipeline.foveation.displacement import (
    CUBIC,
    LEAST_MATCH,
    LEAST_SMOOTHNESS_PX,
    MOST_MATCH,
    REACH,
    DisplacementSettings,
    white_energies,
)
from pipeline.foveation.geometry import Geometry
from pipeline.foveation.gpu import Call, FoveationPass
from pipeline.foveation.picture_pass import PicturePass, PoolUniforms, halved, resolutions
from pipeline.foveation.pooled_moments import SMALLEST_VARIANCE
from pipeline.foveation.pooling import FADE_SHARE, HALVED_VARIANCE
from pipeline.foveation.sphere import FINEST
from pipeline.frame import check_seed
from pipeline.gl.compute import Resource, Shader
from pipeline.gl.shader import Constant
from pipeline.noise.tile import WHITE_BITS, WHITE_DEVIATION, Stream, key_of

MATCH_CONSTANTS: dict[str, Constant] = {
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
        seed: int | None = None,
    ) -> None:
        super().__init__(ctx, geometry, settings.pooling)
        self.settings = settings
        self._field_pooled = PoolUniforms(geometry, settings.pooling)
        self._levels = min(settings.levels, chain_length(*self.size))
        join = self._compile("join", FADE_SHARE=FADE_SHARE, MATCHED=match, **MATCH_CONSTANTS)
        self._join = join
        self._warped = self._texture(self.size)
        self._displaced_for: tuple[int, tuple[float, float]] | None = None
        kind = _SphereField if geometry.on_sphere else _FlatField
        self._field: _SphereField | _FlatField = self._part(
            kind(ctx, self._field_pooled, settings, self._warped)
        )
        if seed is not None:
            self.set_seed(seed)
        self._match: _Match | None = None
        join.hold(warped=self._warped)
        if match:
            self._match = self._part(_Match(ctx, self._eye, self._levels))
            self.chains = self._match.chains
            join.hold(**self._match.lacking)
            join["has_coarse_change"] = self._match.has_change

    def set_seed(self, seed: int, *, carried: bool = False) -> None:  # noqa: ARG002
        """Make the noise of `seed`, unless it is at hand."""
        self._field.set_seed(check_seed(seed))

    def _analyse(self, source: moderngl.Texture) -> None:
        self._displaced_for = None
        if self._match:
            self._match.pull(source)

    def _choose(self, source: moderngl.Texture, call: Call) -> None:
        field = call.seed, call.field_gaze_px
        if self._displaced_for != field:  # else it rests, and so does what it displaces
            self._displace(source, call)
            self._displaced_for = field
        if self._match:
            self._match()

    def _spare(self) -> None:
        self._field.release()

    def _finish(self, source: moderngl.Texture, target: moderngl.Texture, call: Call) -> None:  # noqa: ARG002
        self._play(self._joined, source, target)

    def _joined(self, source: moderngl.Texture, target: moderngl.Texture) -> None:
        self._join.run_over(halved(self.size), source=source, target=target)

    def _displace(self, source: moderngl.Texture, call: Call) -> None:
        self.set_seed(call.seed)
        self._field_pooled.set_gaze(call.field_gaze_px)
        self._field.displace(source)
        if self._match:
            self._match.pull_displaced(self._warped)


class _FlatField(PicturePass):
    """The field of a flat picture: noise, halved once per seed, and pushed for a gaze."""

    def __init__(
        self,
        ctx: moderngl.Context,
        pooled: PoolUniforms,
        settings: DisplacementSettings,
        warped: moderngl.Texture,
    ) -> None:
        count = chain_length(*warped.size)
        constants: dict[str, Constant] = {
            "CUBIC": CUBIC,
            "HALVINGS": count,
            "LEAST_VARIANCE": LEAST_SMOOTHNESS_PX**2 / HALVED_VARIANCE,
            "REACH": REACH,
            "WHITE_BITS": WHITE_BITS,
            "WHITE_DEVIATION": WHITE_DEVIATION,
            **low_constants(),
        }
        super().__init__(ctx, warped.size, pooled, constants)
        self._push, self._displace, self._white, self._halve = (
            self._compile(name) for name in ("field", "displace", "field_white", "field_halve")
        )
        self._set(smoothness=settings.smoothness, reach=settings.reach)
        self._displace["energies"] = np.array(white_energies(count + 2), np.float32)
        sizes = resolutions(self.size, count)
        self._noise = [self._texture(size, "rg32f") for size in sizes]
        # By resolution less 1: the finest is the look-up's.
        self._chosen = [self._texture(size, "rg32f") for size in sizes[1:-1]]
        self._displace.hold(warped=warped, noise=self._noise[0], coarse_field=self._chosen[0])
        self._seed: int | None = None

    def set_seed(self, seed: int) -> None:
        if seed == self._seed:
            return
        self._white["key"] = key_of(seed, Stream.FIELD)
        self._white.run_over(self.size, noise=self._noise[0])
        for fine, coarse in pairwise(self._noise):
            self._halve.run_over(coarse.size, fine=fine, coarse=coarse)
        self._seed = seed

    def displace(self, source: moderngl.Texture) -> None:
        self._play(self._look_up, source)

    def _look_up(self, source: moderngl.Texture) -> None:
        coarser = [*self._chosen[1:], self._noise[-1]]
        for r, coarse in reversed(list(enumerate(coarser, start=1))):
            self._push["halvings"] = r
            chosen = self._chosen[r - 1]
            self._push.run_over(chosen.size, own=self._noise[r], coarse=coarse, chosen=chosen)
        self._displace.run_over(self.size, source=source)


class _SphereField(PicturePass):
    """The field of a panorama, or of its pole: worked out where it is wanted, see sphere.py."""

    def __init__(
        self,
        ctx: moderngl.Context,
        pooled: PoolUniforms,
        settings: DisplacementSettings,
        warped: moderngl.Texture,
    ) -> None:
        super().__init__(ctx, warped.size, pooled)
        self._displace = self._compile("displace_sphere", CUBIC=CUBIC, FINEST=FINEST)
        self._displace.hold(warped=warped)
        self._set(smoothness=settings.smoothness, reach=settings.reach)

    def set_seed(self, seed: int) -> None:
        self._displace["key"] = key_of(seed, Stream.LATTICE)

    def displace(self, source: moderngl.Texture) -> None:
        self._play(self._look_up, source)

    def _look_up(self, source: moderngl.Texture) -> None:
        self._displace.run_over(self.size, source=source)


class _Match(PicturePass):
    """Pooled moments of the picture that the displaced picture lacks.

    Both are pulled when they change, and pushed for each gaze. `lacking` is what the join reads.
    """

    def __init__(self, ctx: moderngl.Context, pooled: PoolUniforms, levels: int) -> None:
        geometry = pooled.geometry
        size = geometry.width_px, geometry.height_px
        constants = {**MATCH_CONSTANTS, **band_constants(), "WRAPS": geometry.wraps}
        super().__init__(ctx, size, pooled, constants, wraps=geometry.wraps)
        self._true, self._own = (
            self._part(MomentChainPass(ctx, pooled, levels, 0, chroma=False)) for _ in range(2)
        )
        self.chains = [self._true, self._own]
        self._count, self._levels = self._true.count, levels
        # By resolution less 1: the finest is the join's.
        self._difference = [self._texture(size, "rgba16f") for size in self._true.sizes[1:]]
        self._change = [self._texture(size, "rgba16f") for size in self._true.sizes[1:levels]]
        keys = [(r < levels, r == self._count) for r in range(1, self._count + 1)]
        made = {
            (is_level, deepest): self._compile("match", LEVEL=is_level, DEEPEST=deepest)
            for is_level, deepest in dict.fromkeys(keys)
        }
        self._shaders_of = [made[key] for key in keys]
        self.lacking: dict[str, Resource] = {
            "coarse_difference": self._difference[0],
            "coarse_own": self._own.pulled.lows[0],
            "coarse_change": (self._change or self._difference)[0],
            **self._moments(1),
        }

    def _match(self, shader: Shader, r: int) -> None:
        given: dict[str, Resource] = {
            "true_low": self._true.pulled.lows[r - 1],
            "own_low": self._own.pulled.lows[r - 1],
            "difference": self._difference[r - 1],
        }
        if r < self._count:
            given["coarse_difference"] = self._difference[r]
        if r < self._levels:
            given["change"] = self._change[r - 1]
            given["coarse_own"] = self._own.pulled.lows[r]
            given["coarse_change"] = self._change[min(r, self._levels - 2)]
            given |= self._moments(r)
        shader["halvings"] = r
        shader["moments_at"] = r + 1
        shader["has_coarse_change"] = r + 1 < self._levels
        shader.run_over(self._true.sizes[r], **given)

    @property
    def has_change(self) -> bool:
        """True if the join finds a change of bands one resolution down."""
        return bool(self._change)

    def pull(self, source: moderngl.Texture) -> None:
        """Analyse the picture."""
        self._true.pull(source)

    def pull_displaced(self, warped: moderngl.Texture) -> None:
        """Analyse the displaced picture."""
        self._own.pull(warped)

    def __call__(self) -> None:
        """Push the difference of pools' means, and what bands add too little, to resolution 1."""
        self._play(self._push)

    def _push(self) -> None:
        self._true.push(2)
        self._own.push(2)
        for r, shader in reversed(list(enumerate(self._shaders_of, start=1))):
            self._match(shader, r)

    def _moments(self, r: int) -> dict[str, moderngl.TextureArray]:
        """Both pictures' moments of resolution r + 1, chosen."""
        true, own = self._true.chosen.moments[r], self._own.chosen.moments[r]
        assert true is not None
        assert own is not None
        return {"true_moments": true, "own_moments": own}
