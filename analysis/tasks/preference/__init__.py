"""The analysis of preferences between pairs, kind `preference`."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from analysis.clustered import least_p
from analysis.pairings import as_numbers, pairing_rows
from analysis.parts import AnyPart
from analysis.parts.bias import BiasPart
from analysis.parts.choice_models import ChoiceModelsPart
from analysis.parts.interaction import PreferenceInteraction
from analysis.parts.joint_scale import JointScalePart
from analysis.parts.learning import ChoiceLearning
from analysis.parts.leaving_out import LeavingOutPart
from analysis.parts.preferences import PreferencesPart
from analysis.parts.scale import BOOTSTRAP_SAMPLES, ScalePart
from analysis.parts.times import TimesPart
from analysis.plans.preference import (
    PreferenceOptions,
    Settings,
    from_decisions,
    from_protocol,
)
from analysis.plots import power_plot, sized
from analysis.seed import SEED
from analysis.tables.decisions import PREFERENCE_COLUMNS, read_decisions
from analysis.tables.table import Source
from analysis.tasks.base import (
    Assumption,
    Counted,
    PowerReport,
    TableOptions,
    TaskAnalysis,
)
from analysis.tasks.preference.pilot import pilot_deviations
from analysis.tasks.preference.power import (
    DEFAULT_PARTICIPANT_SD,
    DEFAULT_SCENE_SD,
    Assumptions,
    PowerCurve,
    power_curve,
    primary_p_values,
)
from analysis.tidy import pwcmp_table
from protocols.columns import Column
from protocols.errors import StudyError
from protocols.schema import StudyProtocol

POWER_STUDIES = 10_000


class PreferenceOfPairs(TaskAnalysis[Settings]):
    """Shares of choices, models, scales in JOD: tasks `two-interval` and `two-alternative`."""

    kind: ClassVar[str] = "preference"
    options: ClassVar[type[TableOptions]] = PreferenceOptions
    parts: ClassVar[tuple[AnyPart, ...]] = (
        PreferencesPart(),
        LeavingOutPart(),
        PreferenceInteraction(),
        ChoiceModelsPart(),
        ScalePart(),
        JointScalePart(),
        BiasPart(),
        ChoiceLearning(),
        TimesPart(),
    )
    constants: ClassVar[Mapping[str, int]] = {"seed": SEED, "bootstrap_samples": BOOTSTRAP_SAMPLES}

    def settings(self, study: StudyProtocol) -> Settings:
        """Return pairings, primary comparison and rules of a protocol."""
        return from_protocol(study)

    def settings_of_table(self, decisions: pd.DataFrame, name: str, options: Any) -> Settings:
        """Return every pairing found, as the options name and turn them."""
        return from_decisions(decisions, name, options)

    def options_of(self, settings: Settings) -> PreferenceOptions:
        """Return what the protocol says of tests."""
        return PreferenceOptions(
            alpha=settings.alpha,
            margin=settings.margin,
            reaction=settings.reaction,
            interaction=settings.interaction,
        )

    def read(self, table: Source, mapping: Mapping[str, str], _options: Any) -> pd.DataFrame:
        """Read decisions: who compared what with what, and chose which."""
        return read_decisions(table, mapping)

    def columns_of(self, _decisions: pd.DataFrame) -> tuple[Column, ...]:
        """Return the columns of preferences."""
        return PREFERENCE_COLUMNS

    def check_table(self, path: Path, decisions: pd.DataFrame, settings: Settings) -> None:
        """Refuse methods that the protocol does not have, and a table without its pairings."""
        unknown = sorted(
            (set(decisions["first"]) | set(decisions["second"])) - set(settings.methods)
        )
        if unknown:
            raise StudyError(
                f"{path}: methods must be those of the protocol"
                f" ({', '.join(settings.methods)}) (got {', '.join(unknown)})"
            )
        if not any(
            len(pairing_rows(decisions, method, against)) for method, against in settings.pairings
        ):
            raise StudyError(f"{path}: must compare at least one of the protocol's pairings")

    def table(self, decisions: pd.DataFrame, _settings: Settings) -> pd.DataFrame:
        """Return decisions with names as categories, which parts group."""
        return as_numbers(decisions)

    def simulated_p(
        self,
        study: StudyProtocol,
        assumed: Mapping[str, float],
        participants: Sequence[int],
        *,
        null: bool,
        rng: np.random.Generator,
        studies: int,
        progress: Counted | None = None,
    ) -> NDArray[np.float64]:
        """Simulate choices, and test the primary comparison."""
        true = _assumptions(assumed)
        return primary_p_values(
            from_protocol(study),
            replace(true, rate=0.5) if null else true,
            participants,
            studies=studies,
            rng=rng,
            progress=progress,
        )

    def least_p(self, study: StudyProtocol, people: int) -> float:
        """Return that of the primary comparison; pooled trials have none worth a name."""
        return 0.0 if from_protocol(study).test == "pooled" else float(least_p(people))

    def family(self, study: StudyProtocol) -> int:
        """Return the number of comparisons."""
        settings = from_protocol(study)
        each = len(settings.comparisons) if settings.correction == "holm" else 1
        return 0 if settings.test == "pooled" else each

    def tidy_tables(self, decisions: pd.DataFrame) -> Mapping[str, pd.DataFrame]:
        """Return the table of the program pwcmp."""
        return {"pwcmp.csv": pwcmp_table(decisions)}

    def counted(self, settings: Settings) -> str:
        """Return how many methods are compared."""
        return f"{len(settings.methods)} methods"

    def assumptions(self, study: StudyProtocol) -> tuple[Assumption, ...]:
        """Return the share to find, and how much people and scenes differ."""
        return (
            Assumption(
                "rate",
                0.5 + from_protocol(study).margin,
                "true share in every comparison, averaged over people and scenes",
                0.01,
                0.99,
            ),
            Assumption(
                "participant_sd",
                DEFAULT_PARTICIPANT_SD,
                "logit deviation between participants",
                0.0,
                5.0,
            ),
            Assumption("scene_sd", DEFAULT_SCENE_SD, "logit deviation between scenes", 0.0, 5.0),
            Assumption(
                "size_correlation",
                1.0,
                "how alike participants' and scenes' deviations are at two sizes",
                0.0,
                1.0,
            ),
        )

    def from_pilot(
        self, _study: StudyProtocol, decisions: pd.DataFrame, _settings: Settings
    ) -> tuple[Mapping[str, float], Sequence[str]]:
        """Return the deviations of a pilot's participants and scenes."""
        return pilot_deviations(decisions)

    def power(
        self,
        study: StudyProtocol,
        assumed: Mapping[str, float],
        *,
        rng: np.random.Generator,
        studies: int | None = None,
        progress: Counted | None = None,
    ) -> PowerReport:
        """Simulate choices with random effects of participants and scenes."""
        true = _assumptions(assumed)
        curve = power_curve(
            from_protocol(study),
            true,
            rng=rng,
            studies=studies or POWER_STUDIES,
            designs=True,
            progress=progress,
        )
        return _power_report(curve, true)


def _assumptions(assumed: Mapping[str, float]) -> Assumptions:
    names = ("rate", "participant_sd", "scene_sd", "size_correlation")
    return Assumptions(*(assumed[name] for name in names))


def _power_report(curve: PowerCurve, assumed: Assumptions) -> PowerReport:
    return curve.report(
        {
            "primary": curve.primary,
            "each of family": curve.each,
            "every": curve.every,
            "equivalent at .5": curve.equivalence,
            "false positives": curve.false_positives,
        },
        {
            "primary comparison": curve.primary,
            "every comparison": curve.every,
            "equivalent, if rate is .5": curve.equivalence,
        },
        taken=(
            f"true share {assumed.rate:g}; deviations {assumed.participant_sd:g} (participants) and"
            f" {assumed.scene_sd:g} (scenes) logits, correlated {assumed.size_correlation:g}"
            " between sizes"
        ),
        tested=f"{curve.comparisons} comparisons",
        legend=(
            "primary: the primary comparison is significant, tested alone; each of family: one of"
            " the comparisons, on average, after correction; every: all of them; equivalent at .5:"
            f" were the share one half, it is shown to lie within ±{curve.margin:.2f} of it; false"
            " positives: were it one half, the primary comparison is significant all the same"
        ),
        draw_designs=sized(
            power_plot,
            sorted({one.scenes for one in curve.designs}),
            {
                f"{repeats} {'repeat' if repeats == 1 else 'repeats'}": np.array(
                    [one.primary for one in curve.designs if one.repeats == repeats]
                )
                for repeats in sorted({one.repeats for one in curve.designs})
            },
            x_label=f"Scenes, with {curve.planned or curve.participants[-1]} participants",
        ),
    )
