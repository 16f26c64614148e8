"""The analysis of yes-no tasks, kind `detection`: d', criterion and bias."""

from collections.abc import Mapping, Sequence
from typing import Any, ClassVar

import numpy as np
import pandas as pd
from scipy.special import ndtr

from analysis.detection import YesNoResults, d_prime_influence, yes_no
from analysis.plans.rates import RateSettings, RatesOptions, baseline_in, prepared
from analysis.rates import Influence, share_influence
from analysis.tables.table import Source, opened
from analysis.tasks.base import Estimate, Step, TableOptions
from analysis.tasks.rates import RatesTask
from analysis.tasks.rates.estimates import difference_estimates, rate_estimates
from analysis.tasks.rates.power import CellDesign, Draw, Floats, Judge, compare_influences
from analysis.tasks.rates.study import RateResults, analyse_rates, with_shared_noise
from analysis.tasks.rates.tables import read_answers
from protocols.errors import StudyError
from protocols.tasks.rates import name_of
from protocols.units import Scalar


class DetectionOptions(RatesOptions):
    """What a table of a yes-no task must be told."""

    signal: Scalar = "yes"
    """The answer that is right where the signal is, as the table writes it."""


class Detection(RatesTask):
    """Sensitivity and criterion by condition: task `yes-no`."""

    kind: ClassVar[str] = "detection"
    options: ClassVar[type[TableOptions]] = DetectionOptions
    task: ClassVar[str] = "yes-no answers"

    def options_of(self, settings: RateSettings) -> DetectionOptions:
        """Return the options that say the same."""
        return DetectionOptions(signal=settings.answers[0], **self._shared_options(settings))

    def read(
        self, table: Source, mapping: Mapping[str, str], options: Any, *, own: bool = True
    ) -> pd.DataFrame:
        """Read trials; both answers must be there, because d' needs hits and false alarms."""
        table = opened(table, mapping)
        rows = read_answers(table, options, own=own, two=True)
        if "answer" not in rows or (rows["answer"] == "").any():
            raise StudyError(
                f"{table.path}: must have the columns expected and answer: whether answers were"
                " right does not tell hits from correct rejections; say which columns hold them:"
                f" {table.cure('--map expected=COLUMN')} --map answer=COLUMN (one of both is enough"
                " beside correct)"
            )
        return rows

    def table_answers(self, decisions: pd.DataFrame, options: Any) -> tuple[str, ...]:
        """Return the signal's answer and the other.

        Raises
        ------
        StudyError
            If the table does not speak of two answers, one of them the signal's.
        """
        signal = name_of(options.signal)
        found = sorted({*decisions["expected"].map(str), *decisions["answer"].map(str)})
        if signal not in found or len(found) > 2:
            raise StudyError(
                "--set signal: must be the answer that is right where the signal is, one of two"
                f" that the columns expected and answer hold (got {signal!r}; they hold"
                f" {', '.join(found)})"
            )
        others = [answer for answer in found if answer != signal]
        return (signal, others[0] if others else f"not {signal}")

    def analyse(self, decisions: pd.DataFrame, settings: RateSettings, step: Step) -> RateResults:
        """Return d', criterion, bias, and what all tasks with right answers have."""
        return analyse_rates(
            decisions,
            settings,
            step,
            lambda rows: sensitivity(rows, settings),
            signal=settings.answers[0],
        )

    def estimates(self, decisions: pd.DataFrame, settings: RateSettings) -> Sequence[Estimate]:
        """Return d' and what they differ by; thresholds where levels adapt."""
        if settings.adaptive:
            return rate_estimates(decisions, settings)
        rows = with_shared_noise(prepared(decisions, settings), settings.answers[0])
        found = sensitivity(rows, settings)
        count = rows["condition"].value_counts()
        measured = [
            Estimate(
                f"d' of {settings.label(one.condition)}",
                one.d_prime.value,
                one.d_prime.lower,
                one.d_prime.upper,
                one.d_prime.p,
                int(count[one.condition]),
            )
            for one in found.conditions
            if one.d_prime is not None
        ]
        return (*measured, *difference_estimates(found.d_prime_contrasts, settings, count))

    def draw(self, _settings: RateSettings) -> Draw:
        """Return the chance of yes by a criterion, equal variances."""
        return chance_of_yes

    def judge(self) -> Judge:
        """Return the test of differences of d'."""
        return judge_d_prime

    def beside(self) -> tuple[str, Judge]:
        """Return the test of differences of bias ([BB] Fig. 20, right)."""
        return "bias", judge_bias


def sensitivity(rows: pd.DataFrame, settings: RateSettings) -> YesNoResults:
    """Return d', criterion and bias of prepared rows by condition, against the baseline."""
    return yes_no(
        rows,
        ("condition",),
        signal=settings.answers[0],
        reference=baseline_in(rows, settings),
        level=settings.confidence,
    )


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
