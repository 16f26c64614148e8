"""Loading what the torch metrics need, quietly and on the CPU's share of this process."""

from __future__ import annotations

import sys
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

from stimuli.score.metrics import HOLES
from stimuli.score.pair import Image, ScoredPair
from stimuli.score.viewing_conditions import STANDARD_FHD, ViewingConditions


@dataclass(frozen=True)
class VideoSource:
    """Video source as the packages of visual difference predictors ask for it.

    `light` is the package's own source of arrays, which makes light of encoded colours.
    """

    pair: ScoredPair
    region: str
    metric: Any
    light: Callable[..., Any]

    def get_video_size(self) -> tuple[int, int, int]:
        return self.pair.height_px, self.pair.width_px, self.pair.frames

    def get_frames_per_second(self) -> float:
        return self.pair.fps

    def get_batch_size(self) -> int:
        return 1

    def get_test_frame(self, frame: int, **wanted: Any) -> Any:
        return self._light(self.pair.test_frame(frame, self.region), wanted)

    def get_reference_frame(self, frame: int, **wanted: Any) -> Any:
        return self._light(self.pair.truth_frame(frame), wanted)

    def _light(self, colour: Image, wanted: dict[str, Any]) -> Any:
        one = self.light(
            colour, colour, 0, dim_order="HWC", display_photometry=self.metric.display_photometry
        )
        return one.get_test_frame(0, **wanted)


def predicted(
    pair: ScoredPair, name: str, metric: Any, light: Callable[..., Any], **asked: Any
) -> dict[tuple[str, str], float | None]:
    """Return a predictor's number of each region of a pair; None where no frame has a hole."""
    found: dict[tuple[str, str], float | None] = {}
    for region in pair.regions:
        source = VideoSource(pair, region, metric, light)
        jod = (
            None
            if region == HOLES and pair.holeless
            else metric.predict_video_source(source, **asked)
        )
        found[name, region] = None if jod is None else float(jod[0])
    return found


def predictor_settings(
    viewing: ViewingConditions,
    photometry: Callable[..., Any],
    geometry: Callable[..., Any],
    **eotf: Any,
) -> dict[str, Any]:
    """Return the settings of a predictor: the display, by the package's own models, on the CPU.

    `eotf` is how the package names the display's curve.
    """
    import torch

    found = {"display_name": STANDARD_FHD, "quiet": True, "device": torch.device("cpu")}
    if viewing.name != STANDARD_FHD:
        found["display_photometry"] = photometry(
            viewing.peak_cd_m2,
            contrast=viewing.contrast,
            E_ambient=viewing.ambient_lux,
            name=viewing.name,
            **eotf,
        )
        found["display_geometry"] = geometry(
            (viewing.width_px, viewing.height_px),
            distance_m=viewing.distance_m,
            diagonal_size_inches=viewing.diagonal_inches,
        )
    return found


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
