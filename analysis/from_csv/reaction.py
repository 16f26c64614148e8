"""Reaction times of a CSV file: a log-normal mixed model, and EZ diffusion."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import pandas as pd

from analysis.cells import conditions
from analysis.columns import frame_of
from analysis.diffusion import MEASURES, DiffusionResults, diffusion_by_condition
from analysis.from_csv.found import Found, limits, number, unique
from analysis.guessing import below_guessing
from analysis.plots import reaction_plot, sized
from analysis.rates import Difference
from analysis.reaction import ReactionTimes, participant_medians, reaction_times
from analysis.reaction_model import TimeModel, TimeRatio, time_model
from analysis.report.wording import p_number, p_text
from analysis.tables.table import Source, Table, opened
from protocols.errors import StudyError
from protocols.suggest import did_you_mean


@dataclass(frozen=True)
class ReactionFound:
    """Every number of the analysis.

    Attributes
    ----------
    model : TimeModel or None
        None of one participant.
    diffusion : DiffusionResults or None
        None without a column ``correct``.
    """

    summary: tuple[ReactionTimes, ...]
    model: TimeModel | None
    diffusion: DiffusionResults | None


def reaction_of_csv(
    source: Source,
    mapping: Mapping[str, str] | None = None,
    *,
    by: str | None = None,
    baseline: str | None = None,
    level: float = 0.95,
) -> Found:
    """Model the reaction times of a table.

    Parameters
    ----------
    source : Table or Path
        With ``participant`` and ``rt_s`` (seconds; empty: none); ``scene`` if scenes are
        several, ``correct`` (1/0) of a task with two answers for EZ diffusion.

    Raises
    ------
    StudyError
        If the table lacks a column, or holds what cannot be.
    """
    table = opened(source, mapping)
    rows = _read(table, by)
    columns = () if by is None else (by,)
    names = [name for name, _ in conditions(rows, columns)]
    if baseline is not None and baseline not in names:
        raise StudyError(
            f"--baseline {baseline}: must be a value of {by!r} ({', '.join(names)})"
            f"{did_you_mean(baseline, names)}"
        )
    notes = list(table.notes)
    model, diffusion = None, None
    try:
        model = time_model(rows, columns, reference=baseline, level=level)
        notes += model.warnings
    except ValueError as problem:
        notes.append(f"no mixed model: {problem}")
    if "correct" in rows:
        notes += below_guessing(rows, 0.5)
        try:
            diffusion = diffusion_by_condition(rows, columns, reference=baseline, level=level)
            notes += diffusion.warnings
        except ValueError as problem:
            notes.append(f"no diffusion model: {problem}")
    else:
        notes.append("no column correct: EZ diffusion needs to know which answers were right")
    summary = reaction_times(rows, columns, level=level)
    for one in summary:
        notes += [f"{one.condition}: {note}" for note in one.warnings]
    result = ReactionFound(summary, model, diffusion)
    simulated = "simulated" in rows and bool((rows["simulated"].astype(str) == "1").any())
    medians = participant_medians(rows, by, summary)
    people = rows["participant"].nunique()
    return Found(
        title=f"{len(rows)} reaction times of {people} participant{'s' * (people != 1)}"
        + (" (SIMULATED)" if simulated else ""),
        shown=_shown(result, names),
        sentences=_sentences(result),
        notes=unique(notes),
        tables=_tables(result),
        figures={"reaction": sized(reaction_plot, summary, medians, simulated=simulated)},
        result=result,
    )


def _read(table: Table, by: str | None) -> pd.DataFrame:
    table.known(("participant", "scene", "rt_s", "correct", "order", by))
    wanted = ["rt_s", *([by] if by is not None else [])]
    table.need([name for name in wanted if name not in table.rows])
    table.only_main()
    judged = ("correct",) if "correct" in table.rows else ()
    table.answered(("rt_s", *judged), each=True)
    rows = pd.DataFrame({name: table.take(name) for name in ("participant", "rt_s")})
    table.order(rows["participant"])
    for column in ("scene", by):
        if column is not None and column in table.rows:
            rows[column] = table.text(column)
    if judged:
        rows["correct"] = table.take("correct")
    if "simulated" in table.rows:
        rows["simulated"] = table.rows["simulated"]
    return rows.reset_index(drop=True)


def _shown(result: ReactionFound, names: list[str]) -> pd.DataFrame:
    times = {one.condition: one for one in result.model.times} if result.model else {}
    fits = {one.condition: one for one in result.diffusion.conditions} if result.diffusion else {}
    lines = []
    for name, one in zip(names, result.summary, strict=True):
        line = {"condition": name, "answers": str(one.answers), "median s": number(one.median)}
        if name in times:
            line["typical s"] = number(times[name].median_s)
            line["limits"] = limits(times[name].lower, times[name].upper)
        if name in fits:
            means = fits[name].means
            line |= {"drift": number(means["drift"]), "boundary": number(means["boundary"])}
            line["other time s"] = number(means["nondecision_s"])
        lines.append(line)
    return pd.DataFrame(lines).fillna("none")


def _sentences(result: ReactionFound) -> tuple[str, ...]:
    found = []
    if result.model is not None:
        found += [apa_ratio(one) for one in result.model.ratios]
    if result.diffusion is not None:
        found += [
            f"EZ diffusion, {one.first} minus {one.second}: {one.difference:.3g} in {one.measure},"
            f" {100 * one.level:g}% CI [{one.lower:.3g}, {one.upper:.3g}], t({one.df:.1f}) ="
            f" {one.difference / one.standard_error:.2f}, {p_text(one.p)}"
            f" ({p_number(one.p_adjusted)} Holm-adjusted)."
            for one in result.diffusion.contrasts
        ]
    return tuple(found)


def apa_ratio(one: TimeRatio) -> str:
    """Return how much longer one condition's answers take as a sentence."""
    return (
        f"Answers to {one.first} took {one.ratio:.2f} times as long as those to {one.second},"
        f" {100 * one.level:g}% CI [{one.lower:.2f}, {one.upper:.2f}], t({one.df:.0f}),"
        f" {p_text(one.p)} ({p_number(one.p_adjusted)} Holm-adjusted; log-normal mixed model)."
    )


def _tables(result: ReactionFound) -> dict[str, pd.DataFrame]:
    tables = {}
    if result.model is not None:
        tables["times.csv"] = pd.DataFrame([vars(one) for one in result.model.times])
        tables["ratios.csv"] = frame_of(TimeRatio, result.model.ratios)
    if result.diffusion is not None:
        tables["diffusion.csv"] = pd.DataFrame(
            [
                {"participant": one.participant, "condition": one.condition, "trials": one.trials}
                | {name: getattr(one.fit, name) for name in (*MEASURES, "share")}
                | {"corrected": int(one.fit.corrected)}
                for one in result.diffusion.people
            ]
        )
        tables["diffusion_comparisons.csv"] = frame_of(Difference, result.diffusion.contrasts)
    return {name: table.replace([np.inf, -np.inf], np.nan) for name, table in tables.items()}
