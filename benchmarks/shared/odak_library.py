"""odak, the library of Beyond Blur's authors, where it is installed."""

from __future__ import annotations

import contextlib
import importlib
import importlib.util
import tempfile
from typing import Any

import numpy as np
from numpy.typing import NDArray

ALPHA, WIDTH_DEG = 0.2, 28.0
"""Pools that `gen_metamer` always has: our law `authors`, of a picture as wide as this."""


def perception() -> Any | None:
    """Return ``odak.learn.perception``, or None where odak is not installed.

    torch gets one thread: more of them wait for each other by counting, and on a busy machine that
    alone was five times the CPU time. odak writes a log beside whoever imports it: into a folder
    that goes, here.
    """
    if importlib.util.find_spec("odak") is None:
        return None
    importlib.import_module("torch").set_num_threads(1)
    with tempfile.TemporaryDirectory() as folder, contextlib.chdir(folder):
        return importlib.import_module("odak.learn.perception")


def gen_metamer(shown: NDArray[np.float32], *, orientations: int = 2) -> NDArray[np.float32] | None:
    """odak's metamer of a picture (H, W, 3), the gaze in its middle; None without odak.

    Raises
    ------
    RuntimeError
        Where its pyramid does not fit together for a size.
    """
    odak = perception()
    if odak is None:
        return None
    torch = importlib.import_module("torch")
    loss = odak.MetamerMSELoss(n_pyramid_levels=5, n_orientations=orientations)
    image = torch.from_numpy(shown.transpose(2, 0, 1)[None].copy())
    made = loss.gen_metamer(image, gaze=[0.5, 0.5])[0].numpy().transpose(1, 2, 0)
    return np.ascontiguousarray(made.clip(0, 1), np.float32)
