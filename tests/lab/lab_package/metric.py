"""A metric of clips."""

import numpy as np

from stimuli.score.measured import PairScores
from stimuli.score.metrics import Family, Metric, PluginMetrics


def measure(pair, _viewing, _gaze):
    errors = [float(np.abs(test - truth).mean()) for _, test, truth, _ in pair.walk()]
    return PairScores({("lab-error", region): float(np.mean(errors)) for region in pair.regions})


METRICS = PluginMetrics(
    Family("lab", "lab_package.metric"),
    (
        Metric(
            "lab-error", "lab error", "", "lower", 0.0, "lab", 1, 3,
            "mean absolute difference", "the lab",
        ),
    ),
    {"lab-error": "Where the error is."},
)  # fmt: skip
