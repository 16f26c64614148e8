"""Make crossed.csv: answers of 12 made-up participants to 8 items under two conditions.

Run from the repository: python tests/stats/oracles/crossed.py
"""

from pathlib import Path

import numpy as np

rng = np.random.default_rng(20_260_101)
person, item = rng.normal(0.0, 0.7, 12), rng.normal(0.0, 0.5, 8)
lines = ["y,cond,participant,item"]
for p in range(12):
    for i in range(8):
        for cond in "ab":
            for _ in range(2):
                logit = -0.3 + 0.9 * (cond == "b") + person[p] + item[i]
                answer = int(rng.random() < 1.0 / (1.0 + np.exp(-logit)))
                lines.append(f"{answer},{cond},p{p:02d},i{i}")
Path(__file__).with_suffix(".csv").write_text("\n".join(lines) + "\n")
