"""Spectral gains on the GPU: noise is corrected for what its bands would measure.

Twins: `mixing.spectral_gains`, `reference.variances_of_blocks`.
"""

import moderngl
import numpy as np
from numpy.typing import NDArray

from pipeline.gl.shader import compile_compute, set_array
from pipeline.gl.texture import create_texture, texture_bytes
from pipeline.inpaint.gpu import GuidedBasePass
from pipeline.synthesis.lacking import SHARED_FROM_LEVEL
from pipeline.synthesis.mixing import (
    AIM,
    LEAST_GAIN,
    MOST_GAIN,
    RESTLESS,
    UNEVEN,
    UNSEEN_VARIANCE,
    fitted_mixing,
)
from pipeline.synthesis.settings import MetamericSettings
from pipeline.synthesis.variances import VariancePass

# float32 tells so many whole numbers apart; then a block that held a hole pixel in just that call,
# and in none since, is taken for one of this call's.
MOST_TURNS = 1 << 24


def overlap_by_levels(overlap: NDArray[np.float64]) -> NDArray[np.float32]:
    """`Mixing.overlap` as gains.comp.glsl reads it: by high bands and by sums and differences of
    oriented ones.

    What bands measure does not change when rows and columns change places. So the high band's
    variance, and half the sum of the oriented ones', take no product of one difference, and half
    their difference takes no other: that halves the sums.

    Returns
    -------
    ndarray of shape (levels, pairs, 4, 4)
        Of a level: for each two levels i <= j four rows. The first three are of products, a
        number for the high band and one for half the oriented bands' sum: of the high band of i
        with that and the sum of j, of the sum of i with the same two, of differences; two zeros.
        The last is for half the oriented bands' difference: high with difference, difference with
        high, sum with difference, difference with sum.
    """
    levels = len(overlap) // 3
    # Deviations from theirs, the sum and the difference: 2 x = u + v, 2 y = u - v.
    parts = np.array([[1, 0, 0], [0, 0.5, 0.5], [0, 0.5, -0.5]])
    forms = overlap.reshape(levels, 3, levels, 3, levels, 3)
    forms = np.einsum("bc,kcipjq,pr,qs->kbirjs", parts, forms, parts, parts)
    high, total, difference = 0, 1, 2
    even, odd = (high, total), difference
    rows = []
    for i, j in pairs_of(levels):
        # (level, own, of i, of j)
        form = (1 if i == j else 2) * forms[:, :, i, :, j]
        both = form[:, even].transpose(0, 2, 3, 1)  # (level, of i, of j, own)
        crossed = [(high, odd), (odd, high), (total, odd), (odd, total)]
        rows.append(
            np.stack(
                [
                    both[:, high, even].reshape(levels, 4),
                    both[:, total, even].reshape(levels, 4),
                    np.pad(both[:, odd, odd], ((0, 0), (0, 2))),
                    np.stack([form[:, odd, p, q] for p, q in crossed], axis=-1),
                ],
                axis=1,
            )
        )
    return np.stack(rows, axis=1).astype(np.float32)


def pairs_of(levels: int) -> list[tuple[int, int]]:
    """Each two levels, and each with itself, as the shader goes through them."""
    return [(i, j) for i in range(levels) for j in range(i, levels)]


class GainPass:
    """Say by what to multiply the noise's deviations in each 4x4 pixels that hold a hole pixel.

    The result is `texels`, an image: of each block the levels side by side, their channels below
    each other; in w, `turn`, by which the last call's are known from earlier ones'.

    Parameters
    ----------
    base, variances : GuidedBasePass, VariancePass
        They must have run on the frame.
    """

    dispatches = 1

    def __init__(
        self,
        ctx: moderngl.Context,
        base: GuidedBasePass,
        variances: VariancePass,
        settings: MetamericSettings,
    ) -> None:
        self._base, self._variances = base, variances
        levels, channels = settings.levels, 1 if settings.channels == "correlated" else 3
        overlap = overlap_by_levels(fitted_mixing(levels).overlap)
        self._overlap = ctx.buffer(overlap.tobytes())
        columns, rows = base.resolutions.sizes[2]
        self.texels = create_texture(ctx, (columns * levels, rows * channels), "rgba32f")
        self._shader = compile_compute(
            ctx,
            "synthesis/gains.comp.glsl",
            LEVELS=levels,
            CHANNELS=channels,
            LEAST_GAIN=LEAST_GAIN,
            MOST_GAIN=MOST_GAIN,
            AIM=AIM,
            UNSEEN_VARIANCE=UNSEEN_VARIANCE,
            SHARED_FROM_LEVEL=SHARED_FROM_LEVEL,
            RESTLESS=RESTLESS,
            UNEVEN=UNEVEN,
        )
        self._shader["depth_threshold"] = settings.depth_threshold
        set_array(self._shader, "level_size", variances.places)
        self.texels.write(bytes(texture_bytes(self.texels)))  # of no turn
        self.turn = 0

    @property
    def held_bytes(self) -> int:
        """Memory, bytes."""
        return texture_bytes(self.texels) + self._overlap.size

    def __call__(self) -> None:
        """Write `texels`."""
        self.turn = self.turn % MOST_TURNS + 1
        self._shader["turn"] = float(self.turn)
        self._variances.texels.bind_to_image(4, read=True, write=False)
        self.texels.bind_to_image(6, read=False, write=True)
        self._overlap.bind_to_uniform_block(0)
        self._base.lists.run(self._shader, ("holes", 2))

    def release(self) -> None:
        """Free everything this pass made."""
        self._overlap.release()
        self.texels.release()
        self._shader.release()
