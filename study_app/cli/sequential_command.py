"""`metamerlab analysis sequential`: the bounds of planned looks, and their simulated error."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated

import typer

from analysis.seed import SEED
from protocols.errors import StudyError
from study_app.cli.assumed import assumed_values, pairs
from study_app.cli.errors import user_errors
from study_app.cli.options import ProtocolArgument, ReplaceOption
from study_app.cli.progress import one_line
from study_app.cli.table_commands import OutOption, hand_over

if TYPE_CHECKING:
    from analysis.from_csv.found import Found
    from analysis.sequential import SequentialError, SequentialPlan

STUDIES = 2000


def sequential(
    protocol: ProtocolArgument,
    assume: Annotated[
        list[str] | None,
        typer.Option(
            "--set",
            metavar="NAME=NUMBER",
            help="What the simulation assumes, as in 'analysis power'.",
        ),
    ] = None,
    studies: Annotated[
        int | None, typer.Option(min=100, help="Studies to simulate. Default: 2000.")
    ] = None,
    seed: Annotated[int, typer.Option(min=0, help="Same seed, same numbers.")] = SEED,
    out: OutOption = None,
    replace: ReplaceOption = False,
) -> None:
    """Compute at which p the planned looks stop a study, and how often that is wrong.

    The study file plans the looks in its section analysis.sequential: rule and numbers of
    participants. The study's own design and test are simulated with and without an effect.

    Example: metamerlab analysis sequential study.toml --set rate=0.65
    """
    import numpy as np

    from analysis.planning import check_looks
    from analysis.sequential import plan_of, sequential_error
    from analysis.tasks import analysis_of
    from protocols.load import load_protocol
    from protocols.result_folder import check_result

    with user_errors():
        if out is not None:
            check_result(out, replace=replace)
        study = load_protocol(protocol)
        section = study.analysis.sequential
        if section is None:
            raise StudyError(
                f"{protocol}: must plan looks to be asked about them: add [analysis.sequential]"
                f' with rule = "obrien-fleming" and looks = [..., {study.study.participants}]'
            )
        check_looks(protocol, study)
        analysis = analysis_of(study.analysis.kind)
        assumed = assumed_values(analysis.assumptions(study), pairs("--set", assume or ()))
        plan = plan_of(section, study.analysis.alpha)
        rng = np.random.default_rng(seed)
        found = []
        with one_line() as progress:
            for name, null in (("without an effect", True), ("with an effect", False)):
                p = analysis.simulated_p(
                    study,
                    assumed,
                    plan.looks,
                    null=null,
                    rng=rng,
                    studies=studies or STUDIES,
                    progress=lambda done, total, name=name: progress(  # type: ignore[misc]
                        f"simulating studies {name}", done, total
                    ),
                )
                found.append(sequential_error(plan, p))
        nothing, something = found
        hand_over(_found(plan, nothing, something, assumed), out, replace=replace)


def _found(
    plan: SequentialPlan,
    nothing: SequentialError,
    something: SequentialError,
    assumed: dict[str, float],
) -> Found:
    """Return bounds and errors, ready to print."""
    import numpy as np
    import pandas as pd

    from analysis.from_csv.found import Found
    from analysis.plots.sequential import bounds_plot

    taken = ", ".join(f"{name} {value:g}" for name, value in assumed.items())
    lines = [
        {
            "participants": str(people),
            "significant if p <=": f"{plan.reject_p[k]:.5f}",
            "no difference if p >=": _none(plan.accept_p[k], 3),
            "alpha spent": _none(plan.spent[k], 5),
            "stops, no effect": f"{nothing.stops[k]:.3f}",
            "stops, effect": f"{something.stops[k]:.3f}",
        }
        for k, people in enumerate(plan.looks)
    ]
    notes = []
    error = float(np.sqrt(plan.alpha * (1.0 - plan.alpha) / nothing.studies))
    if nothing.significant > plan.alpha + 2.0 * error:
        notes.append(
            f"false positives {nothing.significant:.3f} are above alpha {plan.alpha:g}"
            + (
                ": a Bayes factor promises no error; raise bayes_factor, or choose another rule"
                if plan.rule == "bayes-factor"
                else ": too few people at the first looks for this test"
            )
        )
    return Found(
        title=f"{plan.rule}, {len(plan.looks)} looks; {nothing.studies} simulated studies; {taken};"
        f" alpha {plan.alpha:g}",
        shown=pd.DataFrame(lines),
        sentences=(
            f"Without an effect {nothing.significant:.3f} of studies end as significant"
            f" (testing each look at alpha: {nothing.naive:.3f}), with it"
            f" {something.significant:.3f}.",
            f"They end with {nothing.participants:.1f} and {something.participants:.1f}"
            f" participants on average; without looks, {plan.looks[-1]}.",
            *(
                [
                    f"They stop for no difference in {nothing.accepted:.3f} and"
                    f" {something.accepted:.3f}."
                ]
                if any(bound is not None for bound in plan.accept_p)
                else []
            ),
        ),
        notes=tuple(notes),
        tables={
            "looks.csv": pd.DataFrame(
                {
                    "participants": plan.looks,
                    "reject_p": plan.reject_p,
                    "accept_p": plan.accept_p,
                    "spent": plan.spent,
                    "stops_without_effect": nothing.stops,
                    "stops_with_effect": something.stops,
                }
            )
        },
        figures={"looks": lambda width: bounds_plot(plan, width_in=width)},
        result={"plan": plan, "without_effect": nothing, "with_effect": something},
    )


def _none(value: float | None, digits: int) -> str:
    return "none" if value is None else f"{value:.{digits}f}"


def register(app: typer.Typer) -> None:
    """Add the command to the group `analysis`."""
    app.command()(sequential)
