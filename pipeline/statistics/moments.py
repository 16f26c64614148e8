"""Means and second moments of bands, which travel together: to stack and to undo."""

import numpy as np
from numpy.typing import NDArray


def moments(bands: NDArray[np.float64], *, cross: bool) -> NDArray[np.float64]:
    """Stack (H, W, bands, 3) and its second moments into (H, W, bands * 6).

    Second moments are squares, E[X_c^2]; with `cross`, products with the first channel,
    E[X_0 X_c], so that colour can follow luma.
    """
    second = bands * bands[..., :1] if cross else bands**2
    return np.concatenate([bands, second], axis=-1).reshape(*bands.shape[:2], -1)


def means_and_variances(
    values: NDArray[np.float64], *, cross: bool
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Undo `moments`: means and (co)variances, each (H, W, bands, 3).

    ``Var[X] = E[X^2] - E[X]^2``: the paper (3.3.1) prints the sign reversed.
    """
    pairs = values.reshape(*values.shape[:2], -1, 6)
    mean, second = pairs[..., :3], pairs[..., 3:]
    return mean, second - (mean * mean[..., :1] if cross else mean**2)
