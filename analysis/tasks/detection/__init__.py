"""The analysis of yes-no tasks, kind `detection`: d', criterion and bias."""

from collections.abc import Mapping, Sequence
from typing import Any, ClassVar

import numpy as np
import pandas as pd
from scipy.special import ndtr

from analysis.detection import d_prime_influence
from analysis.parts import AnyPart
from analysis.parts.graded import GradedPart
from analysis.parts.sensitivity import TypicalPart, YesNoPart
from analysis.plans.rates import RateSettings
from analysis.plans.told import DetectionTold
from analysis.rates import Influence, share_influence
from analysis.tables.table import Source, opened
from analysis.tasks.rates import RatesTask, rate_parts
from analysis.tasks.rates.power import CellDesign, Draw, Floats, Judge, compare_influences
from protocols.errors import StudyError
from protocols.tasks.base import Analysis


class Detection(RatesTask):
    """Sensitivity and criterion by condition: task `yes-no`."""

    kind: ClassVar[str] = "detection"
    options: ClassVar[type[Analysis]] = DetectionTold
    task: ClassVar[str] = "yes-no answers"
    parts: ClassVar[tuple[AnyPart, ...]] = (
        *rate_parts(YesNoPart(), TypicalPart()),
        GradedPart(),
    )
    two: ClassVar[bool] = True

    def read(self, table: Source, mapping: Mapping[str, str], told: Any) -> pd.DataFrame:
        """Read trials; both answers must be there, because d' needs hits and false alarms."""
        table = opened(table, mapping)
        rows = super().read(table, {}, told)
        if "answer" not in rows or (rows["answer"] == "").any():
            raise StudyError(
                f"{table.path}: must have the columns expected and answer: whether answers were"
                " right does not tell hits from correct rejections; say which columns hold them:"
                f" {table.cure('--map expected=COLUMN')} --map answer=COLUMN (one of both is enough"
                " beside correct)"
            )
        return rows

    def table_answers(self, decisions: pd.DataFrame, told: Any) -> tuple[str, ...]:
        """Return the signal's answer and the other.

        Raises
        ------
        StudyError
            If the table does not speak of two answers, one of them the signal's.
        """
        signal = told.signal
        found = sorted({*decisions["expected"].map(str), *decisions["answer"].map(str)})
        if signal not in found or len(found) > 2:
            raise StudyError(
                "--set signal: must be the answer that is right where the signal is, one of two"
                f" that the columns expected and answer hold (got {signal!r}; they hold"
                f" {', '.join(found)})"
            )
        others = [answer for answer in found if answer != signal]
        return (signal, others[0] if others else f"not {signal}")

    def draw(self, _settings: RateSettings) -> Draw:
        """Return the chance of yes by a criterion, equal variances."""
        return chance_of_yes

    def judge(self) -> Judge:
        """Return the test of differences of d'."""
        return judge_d_prime

    def beside(self) -> tuple[str, Judge]:
        """Return the test of differences of bias ([BB] Fig. 20, right)."""
        return "bias", judge_bias


def chance_of_yes(d_prime: Floats, criterion: Floats, design: CellDesign, typical: float) -> Floats:
    """Return the chance of the signal's answer in every cell.

    The criterion 0 lies midway between noise and signal of a condition; where conditions share
    noise, midway between it and the baseline's signal.
    """
    if design.noise_only:
        evidence = np.where(design.signal, d_prime, 0.0) - 0.5 * typical
    else:
        evidence = np.where(design.signal, 0.5, -0.5) * d_prime
    return np.asarray(ndtr(evidence - criterion))


def judge_d_prime(
    events: Floats, design: CellDesign, sizes: Sequence[int], _settings: RateSettings
) -> Floats:
    """Test d' against the first condition's; conditions without noise share that of the others."""
    shown = np.full(events.shape, float(design.repeats))
    shared = np.isin(design.condition, design.noise_only)
    tables = {}
    for k in design.sensed:
        own = design.condition == k
        signal, noise = own & design.signal, own & ~design.signal
        noise = noise if noise.any() else shared
        chosen = ((events, signal), (shown, signal), (events, noise), (shown, noise))
        tables[design.conditions[k]] = [design.grid(counts, cells) for counts, cells in chosen]

    def moved(people: int) -> dict[str, Influence]:
        return {
            name: d_prime_influence(
                hits[:people], signal[:people], alarms[:people], noise[:people], "log-linear"
            )[0]
            for name, (hits, signal, alarms, noise) in tables.items()
        }

    return compare_influences("d'", moved, sizes)


def judge_bias(
    events: Floats, design: CellDesign, sizes: Sequence[int], _settings: RateSettings
) -> Floats:
    """Test shares of the signal's answer against the first condition's, as the report does."""
    shown = np.full(events.shape, float(design.repeats))
    grids = {}
    for k, name in enumerate(design.conditions):
        own = design.condition == k
        grids[name] = design.grid(events, own), design.grid(shown, own)

    def moved(people: int) -> dict[str, Influence]:
        return {
            name: share_influence(said[:people], trials[:people])
            for name, (said, trials) in grids.items()
        }

    return compare_influences("bias", moved, sizes)
