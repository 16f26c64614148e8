"""Small, lopsided, degenerate studies: flagged results, never a crash or a silent NaN."""

import math
from collections.abc import Iterator, Mapping
from dataclasses import fields, is_dataclass

import numpy as np
import pandas as pd
import pytest

from analysis.parts import computed
from analysis.plans.preference_plan import preference_plan_of_table
from analysis.plans.table_sections import PreferenceTableSection
from analysis.tasks.preference import PreferenceOfPairs


def odd_study(seed: int) -> pd.DataFrame:
    """Up to six people, three scenes, four methods; preferences up to certainty; rows lost."""
    rng = np.random.default_rng(seed)
    people, scenes, count, repeats = (int(rng.integers(1, top)) for top in (7, 4, 4, 4))
    count += 1
    quality = rng.normal(0, rng.choice([0, 1, 5, 50]), count)
    sides = ("left", "right") if seed % 3 else ("", "")
    rows = []
    for person in range(people):
        own = quality + rng.normal(0, rng.choice([0, 0.5, 5]), count)
        for scene in range(scenes):
            for repeat in range(repeats):
                for i in range(count):
                    for j in range(i + 1, count):
                        first, second = (i, j) if repeat % 2 == 0 else (j, i)
                        gap = float(np.clip(own[first] - own[second], -500, 500))
                        chose = rng.random() < 1 / (1 + np.exp(-gap))
                        rows.append(
                            {
                                "participant": f"p{person}",
                                "session": f"p{person}",
                                "scene": f"s{scene}",
                                "size": "all",
                                "first": f"m{first}",
                                "second": f"m{second}",
                                "chosen": f"m{first if chose else second}",
                                "rejected": f"m{second if chose else first}",
                                "chose_first": int(chose),
                                "chosen_side": sides[rng.integers(2)],
                                "rt_s": float(np.exp(rng.normal())) if seed % 4 else np.nan,
                            }
                        )
    table = pd.DataFrame(rows)
    if seed % 2:
        table = table[rng.random(len(table)) < rng.choice([0.3, 0.6, 0.95])].reset_index(drop=True)
    table["order"] = table.groupby("participant").cumcount() + 1
    return table


WITHHELD = (
    "[learning]",
    "[times]",
    "[random_effects]",
    "[scale].sizes[].contrasts",
    "[preferences].scene_limits",
)
"""Models that say which of their terms the data do not identify; these have no number. A residual
has no intraclass correlation; a scale of too few people, and a scene that one saw, no limits."""


def not_finite(value: object, path: str = "") -> Iterator[str]:
    """Yield where a result holds a number that is not finite, or none though it should.

    Only a limit may be infinite.
    """
    if isinstance(value, float | np.floating):
        endless = math.isinf(value) and not path.endswith(("upper", "lower"))
        if endless or (math.isnan(value) and not path.startswith(WITHHELD)):
            yield path
    elif is_dataclass(value) and not isinstance(value, type):
        for field in fields(value):
            yield from not_finite(getattr(value, field.name), f"{path}.{field.name}")
    elif isinstance(value, Mapping):
        for key, entry in value.items():
            yield from not_finite(entry, f"{path}[{key}]")
    elif isinstance(value, tuple | list):
        for entry in value:
            yield from not_finite(entry, f"{path}[]")
    elif isinstance(value, np.ndarray) and value.dtype.kind == "f" and not np.isfinite(value).all():
        yield from [path] * (not path.startswith(WITHHELD))


@pytest.mark.parametrize(
    "seed", [*range(5), *(pytest.param(seed, marks=pytest.mark.slow) for seed in range(5, 20))]
)
def test_every_number_of_an_odd_study_is_finite(seed, proof_count, monkeypatch):
    """Five studies, twenty with --slow, ten times as many with --full; warnings are errors."""
    monkeypatch.setattr("analysis.parts.scale.BOOTSTRAP_SAMPLES", 60)
    for number in range(proof_count(10)):
        table = odd_study(seed + 20 * number)
        if table.empty:
            continue
        found, notes = computed(
            PreferenceOfPairs.parts,
            table,
            preference_plan_of_table(table, "odd", PreferenceTableSection()),
        )
        assert list(not_finite(found)) == []
        assert notes == ()
        for cell in found["preferences"].table.cells:
            assert 0 <= cell.estimate.lower <= cell.estimate.share <= cell.estimate.upper <= 1
            assert 0 <= cell.test.p <= cell.test.p_adjusted <= 1
            if cell.chosen in (0, cell.trials) and cell.participants > 1:
                assert cell.test.p < 0.99
