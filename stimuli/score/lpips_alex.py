"""LPIPS (Zhang et al. 2018) of every frame, by `lpips`, on AlexNet's features.

The package brings its own linear weights, but not those of AlexNet, which torchvision loads
from the network. Where that file is not on the machine, nothing is loaded: `weights_path`
says where it belongs.
"""

from __future__ import annotations

import os
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from stimuli.score.measured import PairScores, mean_of
from stimuli.score.metrics import HOLES
from stimuli.score.pair import Image, ScoredPair, composed_region
from stimuli.score.torch_parts import load_torchvision, one_thread, quiet_libraries
from stimuli.score.viewing_conditions import ViewerGaze, ViewingConditions

WEIGHTS_NAME = "alexnet-owt-7be5be79.pth"
WEIGHTS_URL = f"https://download.pytorch.org/models/{WEIGHTS_NAME}"


def weights_path() -> Path:
    """Return the path where torch looks for AlexNet's weights."""
    home = os.environ.get("TORCH_HOME") or Path(
        os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache", "torch"
    )
    return Path(home, "hub", "checkpoints", WEIGHTS_NAME).expanduser()


def measure(pair: ScoredPair, viewing: ViewingConditions, gaze: ViewerGaze) -> PairScores:  # noqa: ARG001
    """Compare every frame, whole; for `holes` with all other pixels set to the reference."""
    per_frame: dict[tuple[str, str], list[float | None]] = {
        ("lpips", region): [] for region in pair.regions
    }
    with quiet_libraries():
        for _, test, truth, hole in pair.walk():
            for region in pair.regions:
                value = None
                if region != HOLES or hole.any():
                    value = distance(composed_region(test, truth, hole, region), truth)
                per_frame["lpips", region].append(value)
    return PairScores({key: mean_of(found) for key, found in per_frame.items()}, per_frame)


def distance(test: Image, truth: Image) -> float:
    """Return LPIPS of two pictures in [0, 1]."""
    import torch

    model = _open_model()
    with torch.no_grad():
        ours, theirs = (
            torch.from_numpy(np.ascontiguousarray(image.transpose(2, 0, 1)))[None]
            for image in (test, truth)
        )
        return float(model(ours, theirs, normalize=True))


@lru_cache(maxsize=1)
def _open_model() -> Any:
    with quiet_libraries():
        load_torchvision()
        import lpips

        one_thread()
        return lpips.LPIPS(net="alex", verbose=False)
