"""How spectral_gains.glsl reads what mixed bands measure.

Twin: `mixing.spectral_gains`.
"""

import numpy as np
from numpy.typing import NDArray


def overlap_by_levels(overlap: NDArray[np.float64]) -> NDArray[np.float32]:
    """`Mixing.overlap` as spectral_gains.glsl reads it: by high bands, sums and differences of
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
