"""FovVideoVDP (Mantiuk et al. 2021) by `pyfvvdp`, with two sets of parameters.

Frames are read when the metric asks for them, so that memory does not grow with the clip.

The package ships the parameters of version 1.0 but not their tables of sensitivity, which
differ by the exponent of cortical magnification, ``k_cm``. Magnification relative to the fovea,
raised to any power, is 1 in the fovea: without a gaze, where the metric takes every pixel as
foveal, the current tables are those of version 1.0. With a gaze, 1.0 is not offered.
"""

from __future__ import annotations

import json
import tempfile
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from stimuli.score.measured import PairScores
from stimuli.score.pair import ScoredPair
from stimuli.score.torch_parts import one_thread, predicted, predictor_settings, quiet_libraries
from stimuli.score.viewing_conditions import ViewerGaze, ViewingConditions

CURRENT = "fvvdp_parameters.json"
VERSION_1_0 = "fvvdp_parameters_1_0.json"
NAMES = {"fvvdp": None, "fvvdp-1.0": VERSION_1_0}


def measure(pair: ScoredPair, viewing: ViewingConditions, gaze: ViewerGaze) -> PairScores:
    """Compare the whole clip; foveated where the gaze is known."""
    values: dict[tuple[str, str], float | None] = {}
    with quiet_libraries():
        for name, parameters in NAMES.items():
            if parameters is not None and gaze.points_px:
                continue
            metric = open_fvvdp(viewing, parameters, foveated=bool(gaze.points_px))
            from pyfvvdp.video_source import fvvdp_video_source_array

            at = _points(gaze)
            values |= predicted(pair, name, metric, fvvdp_video_source_array, fixation_point=at)
    return PairScores(values)


@lru_cache(maxsize=4)
def open_fvvdp(viewing: ViewingConditions, parameters: str | None, *, foveated: bool) -> Any:
    """Return a configured `pyfvvdp.fvvdp`.

    Parameters
    ----------
    parameters : str or None
        Name of a file of parameters that the package ships; None: its current one.
    """
    with quiet_libraries():
        import pyfvvdp
        from pyfvvdp import utils

        one_thread()
        settings = predictor_settings(
            viewing,
            pyfvvdp.fvvdp_display_photo_eotf,
            pyfvvdp.fvvdp_display_geometry,
            EOTF="sRGB" if viewing.gamma is None else "gamma",
            gamma=viewing.gamma or 2.2,
        )
        with tempfile.TemporaryDirectory(prefix="metamerlab-fvvdp-") as folder:
            if parameters is not None:
                shipped = Path(pyfvvdp.__file__).parent / "fvvdp_data"
                current = json.loads((shipped / CURRENT).read_bytes())
                wanted = json.loads((shipped / parameters).read_bytes())
                wanted["k_cm"] = current["k_cm"]
                (Path(folder) / CURRENT).write_text(
                    json.dumps(wanted), encoding="utf-8", newline="\n"
                )
                utils.config_files.set_config_dir(folder)
            try:
                return pyfvvdp.fvvdp(**settings, foveated=foveated)
            finally:
                utils.config_files.set_config_dir(None)


def _points(gaze: ViewerGaze) -> Any:
    if not gaze.points_px:
        return None
    points = np.asarray(gaze.points_px, np.float32)
    return points[0] if len(points) == 1 else points
