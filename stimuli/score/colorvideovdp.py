"""ColorVideoVDP (Mantiuk et al. 2024) by `cvvdp`.

In processes of its own: it and `pyfvvdp` put modules of the same names onto Python's path.
"""

from __future__ import annotations

from functools import lru_cache
from typing import Any

from stimuli.score.measured import PairScores
from stimuli.score.pair import ScoredPair
from stimuli.score.torch_parts import (
    load_torchvision,
    one_thread,
    predicted,
    predictor_settings,
    quiet_libraries,
)
from stimuli.score.viewing_conditions import ViewerGaze, ViewingConditions


def measure(pair: ScoredPair, viewing: ViewingConditions, gaze: ViewerGaze) -> PairScores:  # noqa: ARG001
    """Compare the whole clip."""
    with quiet_libraries():
        metric = open_cvvdp(viewing)
        from pycvvdp.video_source import video_source_array

        return PairScores(predicted(pair, "cvvdp", metric, video_source_array))


@lru_cache(maxsize=1)
def open_cvvdp(viewing: ViewingConditions) -> Any:
    """Return a configured `pycvvdp.cvvdp`."""
    with quiet_libraries():
        load_torchvision()
        import pycvvdp

        one_thread()
        eotf = "sRGB" if viewing.gamma is None else f"{viewing.gamma:g}"
        return pycvvdp.cvvdp(
            **predictor_settings(
                viewing,
                pycvvdp.vvdp_display_photo_eotf,
                pycvvdp.vvdp_display_geometry,
                EOTF=eotf,
            )
        )
