"""The chain of a picture and its bands' moments, on the GPU. Twins: chain.py, pooled_moments.py."""

from __future__ import annotations

from dataclasses import dataclass

import moderngl

from pipeline.features.reference import band_constants, low_constants
from pipeline.foveation.chain import chain_length
from pipeline.foveation.picture_pass import PicturePass, PoolUniforms, resolutions
from pipeline.gl.compute import Resource

POWERS = 3  # layers of powers


@dataclass(frozen=True, eq=False)
class ResolutionTextures:
    """Textures by resolution less 1; None where there are none. The picture's own are not kept.

    `lows`: the picture halved so often. `moments`: two layers a level, see pull.comp.glsl.
    `powers`: of red, green and blue, from resolution 2 on.
    """

    lows: list[moderngl.Texture]
    moments: list[moderngl.TextureArray | None]
    powers: list[moderngl.TextureArray | None]


class MomentChainPass(PicturePass):
    """The chain of a picture and its bands' moments, pulled once, then chosen for any gaze.

    Attributes
    ----------
    pulled, chosen : ResolutionTextures
        What is never chosen is one texture in both.

    Parameters
    ----------
    pooled : PoolUniforms
        Geometry, law and gaze.
    levels : int
        Pyramid levels whose moments are made; 0 for a blur.
    deepest : int
        The last resolution of the base.
    chroma : bool
        Whether moments of Cb and Cr are made.
    finest : int
        The last resolution at which moments are chosen.
    """

    def __init__(
        self,
        ctx: moderngl.Context,
        pooled: PoolUniforms,
        levels: int,
        deepest: int,
        *,
        chroma: bool = True,
        finest: int = 2,
    ) -> None:
        geometry = pooled.geometry
        size = geometry.width_px, geometry.height_px
        taps = {"WRAPS": geometry.wraps, "CHROMA": chroma, **low_constants(), **band_constants()}
        super().__init__(ctx, size, pooled, taps, wraps=geometry.wraps)
        self.count = chain_length(*size)
        self.sizes = resolutions(size, self.count)
        has_powers = levels > 0 and chroma
        self.pulled = ResolutionTextures(
            [self._texture(size) for size in self.sizes[1:]],
            [
                self._array(self.sizes[r], 2 * min(r, levels)) if levels else None
                for r in range(1, self.count + 1)
            ],
            [
                self._array(self.sizes[r], POWERS) if has_powers and r > 1 else None
                for r in range(1, self.count + 1)
            ],
        )
        pulled = [
            (r < levels, min(r, levels), min(r, 2) if has_powers else 0) for r in range(self.count)
        ]
        made = {
            (own, older, powers): self._compile("pull", OWN=own, OLDER=older, POWERS=powers)
            for own, older, powers in dict.fromkeys(pulled)
        }
        self._pulls = [made[key] for key in pulled]
        pushed = {
            r: (r < deepest, min(r, levels) if r >= finest else 0) for r in range(1, self.count)
        }
        pushes = {
            (base, layers): self._compile(
                "push", BASE=base, LAYERS=layers, POWERS=has_powers and layers > 0
            )
            for base, layers in dict.fromkeys(pushed.values())
            if base or layers
        }
        self.chosen = ResolutionTextures(*(list(kind) for kind in vars(self.pulled).values()))
        for r, (base, layers) in pushed.items():
            if base:
                self.chosen.lows[r - 1] = self._texture(self.sizes[r])
            if layers:
                self.chosen.moments[r - 1] = self._array(self.sizes[r], 2 * layers)
            if layers and has_powers:
                self.chosen.powers[r - 1] = self._array(self.sizes[r], POWERS)
        self._pushes = {r: pushes[key] for r, key in reversed(pushed.items()) if any(key)}

    def pull(self, source: moderngl.Texture) -> None:
        """Make all resolutions of `source`."""
        self._play(self._pull, source)

    def push(self, last: int, first: int | None = None) -> None:
        """Choose levels of detail at resolutions from `first` (the coarsest) down to `last`."""
        self._play(self._push, last, first)

    def _pull(self, source: moderngl.Texture) -> None:
        lows, moments, powers = vars(self.pulled).values()
        for r, shader in enumerate(self._pulls):
            shader.run_over(
                self.sizes[r + 1],
                **given(
                    fine=lows[r - 1] if r else source,
                    coarse=lows[r],
                    fine_moments=moments[r - 1] if r else None,
                    coarse_moments=moments[r],
                    fine_powers=powers[r - 1] if r else None,
                    coarse_powers=powers[r],
                ),
            )

    def _push(self, last: int, first: int | None) -> None:
        own, chosen = self.pulled, self.chosen
        for r, shader in self._pushes.items():
            if r < last or (first is not None and r > first):
                continue
            shader["halvings"] = r
            shader.run_over(
                self.sizes[r],
                **given(
                    fine=own.lows[r - 1],
                    coarse=chosen.lows[r],
                    chosen=chosen.lows[r - 1],
                    fine_moments=own.moments[r - 1],
                    coarse_moments=chosen.moments[r],
                    chosen_moments=chosen.moments[r - 1],
                    fine_powers=own.powers[r - 1],
                    coarse_powers=chosen.powers[r],
                    chosen_powers=chosen.powers[r - 1],
                ),
            )


def given(**resources: Resource | None) -> dict[str, Resource]:
    """Resources that are not None, by name."""
    return {name: one for name, one in resources.items() if one is not None}
