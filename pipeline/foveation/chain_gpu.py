"""The chain of a picture and its bands' moments, on the GPU. Twins: chain.py, moments.py."""

from __future__ import annotations

import moderngl

from pipeline.features.gpu import band_constants, low_constants
from pipeline.foveation.chain import chain_length
from pipeline.foveation.passes import TILE, PicturePass, Pooled, resolutions
from pipeline.gl.compute import Resource


class ChainPass(PicturePass):
    """The chain of a picture and its bands' moments, pulled, then chosen for a gaze, in place.

    Parameters
    ----------
    pooled : Pooled
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
        pooled: Pooled,
        levels: int,
        deepest: int,
        *,
        chroma: bool = True,
        finest: int = 2,
    ) -> None:
        geometry = pooled.geometry
        size = geometry.width_px, geometry.height_px
        super().__init__(ctx, size, pooled, wraps=geometry.wraps)
        self.count = chain_length(*size)
        self.sizes = resolutions(size, self.count)
        taps = {"TILE": TILE, "WRAPS": geometry.wraps, **low_constants(), **band_constants()}
        # lows[0] and moments[0] stand for the picture's own, which are not kept.
        self.lows = [self._texture(size) for size in self.sizes[1:]]
        self.moments = [
            self._array(self.sizes[r], 2 * min(r, levels)) if levels else None
            for r in range(1, self.count + 1)
        ]
        # Powers of chroma, of resolutions from 2.
        has_powers = levels > 0 and chroma
        self.powers = [
            self._array(self.sizes[r], 2) if has_powers and r > 1 else None
            for r in range(1, self.count + 1)
        ]
        pulled = [
            (r < levels, min(r, levels), min(r, 2) if has_powers else 0) for r in range(self.count)
        ]
        made = {
            (own, older, powers): self._shader(
                "foveation/pull.comp.glsl",
                CHROMA=chroma,
                OWN=own,
                OLDER=older,
                POWERS=powers,
                **taps,
            )
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
        self._pushes = [(r, pushes[key]) for r, key in pushed.items() if any(key)]

    def pull(self, source: moderngl.Texture) -> None:
        """Make all resolutions of `source`."""
        for r, shader in enumerate(self._pulls):
            fine = self.lows[r - 1] if r else source
            shader.run_over(
                self.sizes[r + 1],
                fine=fine,
                coarse=self.lows[r],
                **self._statistics(r),
            )

    def push(self, last: int, first: int | None = None) -> None:
        """Choose levels of detail at resolutions from `first` (the coarsest) down to `last`."""
        for r, shader in reversed(self._pushes):
            if r < last or (first is not None and r > first):
                continue
            shader["fine_size"] = self.sizes[r]
            shader["halvings"] = r
            shader.run_over(
                self.sizes[r],
                fine=self.lows[r - 1],
                coarse=self.lows[r],
                **self._statistics(r),
            )

    def _statistics(self, r: int) -> dict[str, Resource]:
        """Those of resolutions `r` and r + 1."""
        return given(
            fine_moments=self.moments[r - 1] if r else None,
            coarse_moments=self.moments[r],
            fine_powers=self.powers[r - 1] if r else None,
            coarse_powers=self.powers[r],
        )


def given(**resources: Resource | None) -> dict[str, Resource]:
    """Those that are there."""
    return {name: one for name, one in resources.items() if one is not None}
