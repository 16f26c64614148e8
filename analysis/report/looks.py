"""At which planned look a study stands."""

from collections.abc import Sequence
from dataclasses import dataclass

from analysis.report.source import Source
from analysis.sequential import SequentialPlan, Standing, plan_of, standing
from analysis.tasks.blocks import Block, Box


@dataclass(frozen=True)
class Look:
    """The plan, and where these data stand in it."""

    plan: SequentialPlan
    standing: Standing


def look_of(source: Source, results: object) -> Look | None:
    """Return where the study stands; None where it plans no looks, or there is no protocol."""
    protocol = source.protocol
    if protocol is None or protocol.analysis.sequential is None:
        return None
    plan = plan_of(protocol.analysis.sequential, protocol.analysis.alpha)
    people = int(source.decisions["participant"].nunique())
    return Look(plan, standing(plan, people, source.analysis.planned_p(results)))


def looks_blocks(found: Look | None) -> Sequence[Block]:
    """Return what to read before any p of the page."""
    if found is None:
        return ()
    return (
        Box(
            f"Planned looks: {found.standing.verdict}",
            found.standing.sentence,
            "Other limits and p of this page take no account of looks: until the study has ended,"
            " they decide nothing.",
        ),
    )
