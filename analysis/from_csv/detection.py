"""Detection theory of a CSV file: d', criterion and bias by condition, and what differs."""

from collections.abc import Mapping
from dataclasses import dataclass

import pandas as pd

from analysis.columns import frame_of
from analysis.detection import YesNoResults
from analysis.from_csv.found import Found, limits, number, unique
from analysis.plans.rates import prepared
from analysis.plots import d_prime_plot, detection_plot, sized
from analysis.rates import Difference
from analysis.report.wording import p_number
from analysis.tables.table import Source, opened
from analysis.tasks.detection import Detection, DetectionOptions, sensitivity
from analysis.tasks.rates.study import with_shared_noise
from analysis.tasks.rates.wording import apa_difference, apa_yes_no


@dataclass(frozen=True)
class DetectionFound:
    """Every number of the analysis."""

    sensitivity: YesNoResults


def detection_of_csv(
    source: Source,
    mapping: Mapping[str, str] | None = None,
    *,
    signal: str = "yes",
    by: str | None = None,
    baseline: str | None = None,
    level: float = 0.95,
) -> Found:
    """Return what observers of a yes-no task could tell, and how they were inclined.

    Parameters
    ----------
    source : Table or Path
        With ``participant``, ``expected`` and ``answer``; ``scene`` if scenes are several.
    signal : str
        The answer that is right where the signal is, as the table writes it.
    by, baseline : str, optional
        Column of conditions, and the one that the others are compared with: the first, if left
        out. Conditions without noise trials share those of the others.

    Raises
    ------
    StudyError
        If the table lacks a column, or holds what cannot be.
    """
    analysis = Detection()
    options = DetectionOptions(
        signal=signal, by=by, baseline=baseline, alpha=round(1.0 - level, 12)
    )
    table = opened(source, mapping)
    decisions = analysis.read(table, {}, options, own=False)
    settings = analysis.settings_of_table(decisions, table.path.stem, options)
    rows = prepared(decisions, settings)
    notes = [*table.notes, *analysis.table_notes(decisions, settings)]
    tabled = with_shared_noise(rows, settings.answers[0])
    if tabled is not rows:
        notes.append("conditions without noise trials of their own share those of the others")
    found = sensitivity(tabled, settings)
    for one in found.conditions:
        notes += [f"{one.condition}: {note}" for note in one.warnings]
        if one.d_prime is None:
            notes.append(f"{one.condition}: signal and noise were not both shown; no d'")
    simulated = bool((decisions["simulated"].astype(str) == "1").any())
    contrasts = (*found.d_prime_contrasts, *found.criterion_contrasts, *found.bias_contrasts)
    known = any(one.d_prime is not None for one in found.conditions)
    figures = {"detection": sized(detection_plot, found, simulated=simulated)}
    if known:
        figures["sensitivity"] = sized(d_prime_plot, found, simulated=simulated)
    people = decisions["participant"].nunique()
    if people == 1:
        contrasts = ()
        notes.append("one participant only: conditions are not compared")
    return Found(
        title=f"{len(decisions)} yes-no answers of {people} participant{'s' * (people != 1)},"
        f" signal: {settings.answers[0]}" + (" (SIMULATED)" if simulated else ""),
        shown=_shown(found),
        sentences=(
            *(apa_yes_no(one) for one in found.conditions),
            *(apa_difference(one) for one in contrasts),
        ),
        notes=unique(notes),
        tables={
            "conditions.csv": _conditions(found),
            "comparisons.csv": frame_of(Difference, contrasts),
        },
        figures=figures,
        result=DetectionFound(found),
    )


def _shown(found: YesNoResults) -> pd.DataFrame:
    return pd.DataFrame(
        [
            {
                "condition": one.condition,
                "hits": f"{one.hits} / {one.hits + one.misses}",
                "false alarms": f"{one.false_alarms} / {one.false_alarms + one.correct_rejections}",
                "d'": number(one.d_prime.value if one.d_prime else None),
                "limits": limits(
                    *((one.d_prime.lower, one.d_prime.upper) if one.d_prime else (None, None))
                ),
                "p": p_number(one.d_prime.p) if one.d_prime else "none",
                "c": number(one.criterion.value if one.criterion else None),
                "limits of c": limits(
                    *((one.criterion.lower, one.criterion.upper) if one.criterion else (None, None))
                ),
            }
            for one in found.conditions
        ]
    )


def _conditions(found: YesNoResults) -> pd.DataFrame:
    lines: list[dict[str, object]] = []
    for one in found.conditions:
        line: dict[str, object] = {
            "condition": one.condition,
            "hits": one.hits,
            "misses": one.misses,
            "false_alarms": one.false_alarms,
            "correct_rejections": one.correct_rejections,
        }
        for name, measure in (("d_prime", one.d_prime), ("criterion", one.criterion)):
            for key in ("value", "lower", "upper", "p"):
                column = name if key == "value" else f"{name}_{key}"
                line[column] = None if measure is None else getattr(measure, key)
        line |= {"correct": one.correct.share, f"share_{one.bias_answer}": one.bias.share}
        line["warnings"] = "; ".join(one.warnings)
        lines.append(line)
    return pd.DataFrame(lines)
