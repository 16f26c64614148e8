"""The analysis of yes-no tasks, kind `detection`: d', criterion and bias."""

from collections.abc import Mapping
from typing import Any, ClassVar

import pandas as pd

from analysis.parts import AnyPart
from analysis.parts.sensitivity import TypicalPart, YesNoPart
from analysis.plans.table_settings import DetectionTableSettings
from analysis.tables.table import Source, opened
from analysis.tasks.rates import RatesTask, rate_parts
from protocols.errors import StudyError
from protocols.tasks.base import Analysis


class DetectionRates(RatesTask):
    """Sensitivity and criterion by condition: task `yes-no`."""

    kind: ClassVar[str] = "detection"
    options: ClassVar[type[Analysis]] = DetectionTableSettings
    task: ClassVar[str] = "yes-no answers"
    parts: ClassVar[tuple[AnyPart, ...]] = rate_parts(YesNoPart(), TypicalPart())
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
