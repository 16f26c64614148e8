"""ColorVideoVDP (Mantiuk et al. 2024) by `cvvdp`.

In processes of its own: it and `pyfvvdp` put modules of the same names onto Python's path.
"""

from __future__ import annotations

from functools import lru_cache
from typing import Any

from stimuli.score.measured import Measured
from stimuli.score.metrics import HOLES
from stimuli.score.pair import Image, ScoredPair
from stimuli.score.torch_parts import VideoSource, load_torchvision, one_thread, quiet_libraries
from stimuli.score.viewing_conditions import STANDARD_FHD, ViewerGaze, ViewingConditions


def measure(pair: ScoredPair, viewing: ViewingConditions, gaze: ViewerGaze) -> Measured:  # noqa: ARG001
    """Compare the whole clip."""
    values: dict[tuple[str, str], float | None] = {}
    with quiet_libraries():
        metric = open_metric(viewing)
        for region in pair.regions:
            jod, _ = metric.predict_video_source(_Frames(pair, region, metric))
            values["cvvdp", region] = float(jod)
    if pair.masks and not any(pair.mask(index).any() for index in range(pair.frames)):
        values["cvvdp", HOLES] = None
    return Measured(values)


@lru_cache(maxsize=1)
def open_metric(viewing: ViewingConditions) -> Any:
    """Return a configured `pycvvdp.cvvdp`."""
    with quiet_libraries():
        load_torchvision()
        import pycvvdp
        import torch

        one_thread()
        photometry = geometry = None
        if viewing.name != STANDARD_FHD:
            photometry = pycvvdp.vvdp_display_photo_eotf(
                viewing.peak_cd_m2,
                contrast=viewing.contrast,
                EOTF="sRGB" if viewing.gamma is None else f"{viewing.gamma:g}",
                E_ambient=viewing.ambient_lux,
                name=viewing.name,
            )
            geometry = pycvvdp.vvdp_display_geometry(
                (viewing.width_px, viewing.height_px),
                distance_m=viewing.distance_m,
                diagonal_size_inches=viewing.diagonal_inches,
            )
        return pycvvdp.cvvdp(
            display_name=STANDARD_FHD,
            display_photometry=photometry,
            display_geometry=geometry,
            quiet=True,
            device=torch.device("cpu"),
        )


class _Frames(VideoSource):
    """A video source of the package."""

    def get_batch_size(self) -> int:
        return 1

    def get_test_frame(self, frame: int, device: Any, colorspace: str) -> Any:
        return self._light(self.pair.test_frame(frame, self.region), device, colorspace)

    def get_reference_frame(self, frame: int, device: Any, colorspace: str) -> Any:
        return self._light(self.pair.truth_frame(frame), device, colorspace)

    def _light(self, colour: Image, device: Any, colorspace: str) -> Any:
        from pycvvdp.video_source import video_source_array

        one = video_source_array(
            colour, colour, 0, dim_order="HWC", display_photometry=self.metric.display_photometry
        )
        return one.get_test_frame(0, device, colorspace)
