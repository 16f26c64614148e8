"""Writes paired.csv: 10 made-up participants compare 3 methods in 6 scenes, twice."""

from pathlib import Path

import numpy as np
import pandas as pd

rng = np.random.default_rng(2)
person, scene, repeat, pair = (
    axis.ravel() for axis in np.meshgrid(range(10), range(6), range(2), range(3), indexing="ij")
)
low, high = np.array([[0, 1], [0, 2], [1, 2]])[pair].T
first, second = np.where(repeat, high, low), np.where(repeat, low, high)
taste = np.array([0.9, 0.3, -0.6]) + 0.7 * rng.standard_normal((10, 3))
place = 0.5 * rng.standard_normal((6, 3))
eta = 0.2 + taste[person, first] - taste[person, second]
eta = eta + place[scene, first] - place[scene, second]
chose_first = (rng.random(eta.size) < 1 / (1 + np.exp(-eta))).astype(int)
names = np.array(["a", "b", "c"])
table = pd.DataFrame(
    {
        "participant": [f"P{n}" for n in person],
        "scene": [f"s{n}" for n in scene],
        "first": names[first],
        "second": names[second],
        "chosen": np.where(chose_first == 1, names[first], names[second]),
        "chose_first": chose_first,
    }
)
table.to_csv(Path(__file__).parent / "paired.csv", index=False, lineterminator="\n")
