"""Posteriors of psignifit for counts of ours, written to oracle_psignifit.json.

Run, with psignifit 4.3 of PyPI installed anywhere (it is no dependency of ours):
``python tests/stats/oracles/oracle_psignifit.py tests/stats/oracles``
"""

import json
import sys
from pathlib import Path

import numpy as np
import psignifit

LEVELS = [0.1, 0.2, 0.4, 0.6, 0.8, 1.0, 1.3]
SHOWN = 40
CASES = {
    "two_alternatives": ([19, 23, 24, 31, 36, 38, 40], "2AFC", "norm"),
    "strayed": ([17, 28, 19, 37, 29, 40, 36], "2AFC", "norm"),
    "lapsing": ([20, 18, 27, 30, 36, 37, 36], "2AFC", "logistic"),
}

out = {"levels": LEVELS, "shown": SHOWN, "cases": {}}
for name, (right, experiment, sigmoid) in CASES.items():
    data = np.column_stack([LEVELS, right, np.full(len(LEVELS), SHOWN)]).astype(float)
    found = psignifit.psignifit(
        data,
        experiment_type=experiment,
        sigmoid=sigmoid,
        grid_steps={"threshold": 50, "width": 50, "lambda": 25, "eta": 25},
        verbose=False,
    )
    out["cases"][name] = {
        "right": right,
        "experiment": experiment,
        "sigmoid": sigmoid,
        "mean": found.parameter_estimate_mean,
        "limits": {k: v["0.95"] for k, v in found.confidence_intervals.items()},
    }
folder = Path(sys.argv[1])
text = json.dumps(out, indent=1)
(folder / "oracle_psignifit.json").write_text(text + "\n")
