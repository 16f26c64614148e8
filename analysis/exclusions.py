"""Applies the exclusion rules a protocol fixed before the data, and counts what they cost."""

from collections.abc import Callable
from dataclasses import dataclass

import pandas as pd

from protocols.study_file.session_schema import Exclusions


@dataclass(frozen=True)
class FlowStep:
    """One line of the flow table: what was left out, and what remained."""

    step: str
    sittings_out: int
    decisions_out: int
    sittings_left: int
    decisions_left: int


def apply_exclusions(
    sessions: pd.DataFrame, decisions: pd.DataFrame, rules: Exclusions
) -> tuple[pd.DataFrame, pd.DataFrame, tuple[FlowStep, ...]]:
    """Mark sessions and decisions that the rules leave out.

    Nothing is deleted: ``sessions.excluded``, ``decisions.included`` and ``decisions.exclusion``
    say what happened. Practice and catch trials never count as main decisions.

    Returns
    -------
    sessions, decisions : DataFrame
        Marked copies.
    flow : tuple of FlowStep
        From all sessions to the decisions analysed; every rule has its line, also where it
        left nothing out; that on catch trials only where there were some.
    """
    sessions, decisions = sessions.copy(), decisions.copy()
    decisions["included"] = 0
    main = decisions["kind"] == "main"
    decisions.loc[main, "included"] = 1
    decisions.loc[~main, "exclusion"] = decisions.loc[~main, "kind"] + " trial"
    flow = [_step("sessions read, main decisions", 0, 0, sessions, decisions)]
    for text, out in _session_rules(rules, decisions):
        broken = sessions["session"][(sessions["excluded"] == "") & sessions.apply(out, axis=1)]
        sessions.loc[sessions["session"].isin(broken), "excluded"] = text
        hit = decisions["session"].isin(broken) & (decisions["included"] == 1)
        _leave_out(decisions, hit, text)
        flow.append(_step(text, len(broken), int(hit.sum()), sessions, decisions))
    for text, late in _trial_rules(rules):
        hit = (decisions["included"] == 1) & late(decisions["rt_s"]).fillna(False)
        _leave_out(decisions, hit, text)
        flow.append(_step(text, 0, int(hit.sum()), sessions, decisions))
    decisions["included"] = decisions["included"].astype("Int64")
    return sessions, decisions, tuple(flow)


def _session_rules(
    rules: Exclusions, decisions: pd.DataFrame
) -> list[tuple[str, Callable[[pd.Series], bool]]]:
    main = decisions[decisions["kind"] == "main"]
    places = main.groupby("session")["key_place"]
    one_side = places.apply(lambda keys: keys.value_counts(normalize=True).max()).to_dict()
    one_sided = f"more than {_percent(rules.same_side_max_share)} of answers on one side"
    if rules.same_side_max_share >= 1.0:
        one_sided = "answers on one side: the protocol sets no limit"
    caught = (
        f"fewer than {_percent(rules.catch_min_share)} of catch trials right",
        lambda row: bool(
            pd.notna(row["catch_correct"]) and row["catch_correct"] < rules.catch_min_share - 1e-9
        ),
    )
    return [
        (
            f"fewer than {_percent(rules.completed_min_share)} of the planned trials decided",
            lambda row: row["decided"] < rules.completed_min_share * row["planned"] - 1e-9,
        ),
        *([caught] if (decisions["kind"] == "catch").any() else []),
        (
            one_sided,
            lambda row: one_side.get(row["session"], 0.0) > rules.same_side_max_share + 1e-9,
        ),
    ]


def _trial_rules(rules: Exclusions) -> list[tuple[str, Callable[[pd.Series], pd.Series]]]:
    found: list[tuple[str, Callable[[pd.Series], pd.Series]]] = [
        (f"answered faster than {rules.rt_min_s:g} s", lambda rt: rt < rules.rt_min_s)
    ]
    slowest = rules.rt_max_s
    if slowest is not None:
        found.append((f"answered slower than {slowest:g} s", lambda rt: rt > slowest))
    return found


def _leave_out(decisions: pd.DataFrame, hit: pd.Series, text: str) -> None:
    decisions.loc[hit, "included"] = 0
    decisions.loc[hit, "exclusion"] = text


def _step(
    text: str, left_out: int, out: int, sessions: pd.DataFrame, decisions: pd.DataFrame
) -> FlowStep:
    return FlowStep(
        step=text,
        sittings_out=left_out,
        decisions_out=out,
        sittings_left=int((sessions["excluded"] == "").sum()),
        decisions_left=int(decisions["included"].sum()),
    )


def _percent(share: float) -> str:
    return f"{100 * share:g} %"
