"""Loading what the torch metrics need, quietly and on the CPU's share of this process."""

from __future__ import annotations

import sys
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

from stimuli.score.pair import ScoredPair


@dataclass(frozen=True)
class VideoSource:
    """Video source as the packages of visual difference predictors ask for it."""

    pair: ScoredPair
    region: str
    metric: Any

    def get_video_size(self) -> tuple[int, int, int]:
        return self.pair.height_px, self.pair.width_px, self.pair.frames

    def get_frames_per_second(self) -> float:
        return self.pair.fps


@contextmanager
def quiet_libraries() -> Iterator[None]:
    """Silence what the metrics' packages say about their own use of other packages.

    They are used as they are; their deprecations are for their authors.
    """
    with warnings.catch_warnings():
        for category in (DeprecationWarning, FutureWarning, SyntaxWarning):
            warnings.simplefilter("ignore", category)
        warnings.filterwarnings("ignore", category=UserWarning, module=r"torch(vision)?\.")
        yield


def one_thread() -> None:
    """Leave the other cores to the other workers."""
    import torch

    torch.set_num_threads(1)


def load_torchvision() -> None:
    """Import torchvision, also one that was built for another torch.

    The common package has compiled operators for CUDA, which do not load beside a torch for
    the CPU, and then its import fails. The metrics only use its Python parts: where these
    operators are missing, they are declared, so that the import goes through; a call of one
    would still say that it does not exist.
    """
    try:
        import torchvision
    except RuntimeError as error:
        if "operator torchvision::" not in str(error):
            raise
    else:
        return
    import torch

    for name in [name for name in sys.modules if name.split(".")[0] == "torchvision"]:
        del sys.modules[name]
    library = torch.library.Library("torchvision", "FRAGMENT")
    for operator in ("nms", "qnms"):
        library.define(f"{operator}(Tensor dets, Tensor scores, float iou_threshold) -> Tensor")
    _KEPT.append(library)
    import torchvision  # noqa: F401


_KEPT: list[object] = []  # torch takes the declarations back when the library is collected
