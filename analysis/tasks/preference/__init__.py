"""The analysis of preferences between pairs, kind `preference`."""

from collections.abc import Mapping
from pathlib import Path
from typing import ClassVar

import pandas as pd

from analysis import SEED
from analysis.models.compared_methods import as_numbers, pairing_rows
from analysis.parts.bias import BiasPart
from analysis.parts.choice_models import ChoiceModelsPart
from analysis.parts.interaction import PreferenceInteraction
from analysis.parts.learning import ChoiceLearning
from analysis.parts.preferences import PreferencesPart
from analysis.parts.scale import BOOTSTRAP_SAMPLES, ScalePart
from analysis.parts.times import TimesPart
from analysis.plans.preference_plan import (
    PreferencePlan,
    preference_plan,
    preference_plan_of_table,
)
from analysis.plans.table_sections import PreferenceTableSection
from analysis.simulations import Choices
from analysis.tables.decisions import preference_columns, read_decisions
from analysis.tables.table import Source
from analysis.tasks.base import TaskAnalysis
from analysis.tidy import pwcmp_table
from protocols.columns import Column
from protocols.errors import StudyError
from protocols.study_file.schema import StudyProtocol
from protocols.tasks.base import Analysis


class PreferenceOfPairs(TaskAnalysis[PreferenceTableSection, PreferencePlan]):
    """Shares of choices, models, scales in JOD: tasks `two-interval` and `two-alternative`."""

    kind = "preference"
    options = PreferenceTableSection
    parts = (
        PreferencesPart(),
        PreferenceInteraction(),
        ChoiceModelsPart(),
        ScalePart(),
        BiasPart(),
        ChoiceLearning(),
        TimesPart(),
    )
    constants: ClassVar[Mapping[str, int]] = {"seed": SEED, "bootstrap_samples": BOOTSTRAP_SAMPLES}

    def plan(self, study: StudyProtocol) -> PreferencePlan:
        """Return pairings, primary comparison and rules of a protocol."""
        return preference_plan(study)

    def plan_of_table(
        self, decisions: pd.DataFrame, name: str, section: PreferenceTableSection
    ) -> PreferencePlan:
        """Return every pairing found, as named and turned."""
        return preference_plan_of_table(decisions, name, section)

    def section_of_table(self, plan: PreferencePlan) -> Analysis:
        """Return rules and names; a table with what is compared declares no primary comparison."""
        return super().section_of_table(plan.but(primary=None))

    def read(self, table: Source, _section: PreferenceTableSection) -> pd.DataFrame:
        """Read decisions: who compared what with what, and chose which."""
        return read_decisions(table)

    def columns_of(self, decisions: pd.DataFrame) -> tuple[Column, ...]:
        """Return the columns of preferences."""
        return preference_columns(decisions)

    def check_table(self, path: Path, decisions: pd.DataFrame, plan: PreferencePlan) -> None:
        """Refuse methods that the protocol does not have, and a table without its pairings."""
        unknown = sorted((set(decisions["first"]) | set(decisions["second"])) - set(plan.methods))
        if unknown:
            raise StudyError(
                f"{path}: methods must be those of the protocol"
                f" ({', '.join(plan.methods)}) (got {', '.join(unknown)})"
            )
        if not any(
            len(pairing_rows(decisions, method, against)) for method, against in plan.pairings
        ):
            raise StudyError(f"{path}: must compare at least one of the protocol's pairings")

    def table(self, decisions: pd.DataFrame, _plan: PreferencePlan) -> pd.DataFrame:
        """Return decisions with names as categories, which parts group."""
        return as_numbers(decisions)

    def tidy_tables(self, decisions: pd.DataFrame) -> Mapping[str, pd.DataFrame]:
        """Return the table of the program pwcmp."""
        return {"pwcmp.csv": pwcmp_table(decisions)}

    def simulation(self, study: StudyProtocol) -> Choices:
        """Return the simulation of choices, with random effects of participants and scenes."""
        plan = self.plan(study)
        return Choices(plan, self.parts_of(plan))
