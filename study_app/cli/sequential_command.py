"""`metamerlab analysis sequential`: the bounds of planned looks, and their simulated error."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator
from typing import TYPE_CHECKING, Annotated

import typer

from analysis.seed import SEED
from protocols.errors import StudyError
from study_app.cli.assumed import assumed_values, pairs
from study_app.cli.options import ProtocolArgument, ReplaceOption
from study_app.cli.progress import one_line
from study_app.cli.table_commands import OutOption, print_blocks
from study_app.cli.terminal import say

if TYPE_CHECKING:
    from analysis.models.sequential_bounds import SequentialError, SequentialPlan

STUDIES = 2000


def sequential(
    protocol: ProtocolArgument,
    assume: Annotated[
        list[str] | None,
        typer.Option(
            "--set",
            metavar="NAME=NUMBER",
            help="Assumption of the simulation, as in 'analysis power'.",
        ),
    ] = None,
    studies: Annotated[
        int | None, typer.Option(min=100, help="Studies to simulate. Default: 2000.")
    ] = None,
    seed: Annotated[int, typer.Option(min=0, help="Same seed, same numbers.")] = SEED,
    out: OutOption = None,
    replace: ReplaceOption = False,
) -> None:
    """Compute the p at which planned looks stop a study, and how often that is wrong.

    The study file plans the looks in its section analysis.sequential: rule and numbers of
    participants. The study's own design and test are simulated with and without an effect.

    Example: metamerlab analysis sequential study.toml --set rate=0.65
    """
    import numpy as np

    from analysis.models.sequential_bounds import plan_of, sequential_error
    from analysis.parts.interim_looks import looks_frame, looks_table
    from analysis.planning import check_looks
    from analysis.plots import ONE_COLUMN_IN, TWO_COLUMNS_IN, save_figure
    from analysis.plots.sequential_plot import bounds_plot
    from analysis.power import planned_p_values
    from analysis.report.values import as_json
    from analysis.tables.write_table import write_table
    from analysis.tasks import analysis_of
    from protocols.disk.result_folder import check_result, whole_folder
    from protocols.load import load_protocol
    from protocols.outside import json_bytes

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
    simulation = analysis_of(study.analysis.kind).simulation(study)
    families = simulation.families()
    assumed = assumed_values(simulation.assumptions, pairs("--set", assume or ()))
    plan = plan_of(section, study.analysis.alpha)
    rng = np.random.default_rng(seed)
    found = []
    with one_line() as progress:
        for name, null in (("without an effect", True), ("with an effect", False)):
            p = planned_p_values(
                simulation,
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
    taken = ", ".join(f"{name} {value:g}" for name, value in assumed.items() if not np.isnan(value))
    title = (
        f"{plan.rule}, {len(plan.looks)} looks; {nothing.studies} simulated studies; {taken};"
        f" alpha {plan.alpha:g}"
    )
    sentences = [*_sentences(plan, nothing, something)]
    notes = [*_notes(plan, nothing, families[0].uncorrected if families else "")]
    if out is not None:
        said = {
            "title": title,
            "sentences": sentences,
            "notes": notes,
            "result": {"plan": plan, "without_effect": nothing, "with_effect": something},
        }
        with whole_folder(out, replace=replace) as work:
            for name, width_in in (("1-column", ONE_COLUMN_IN), ("2-column", TWO_COLUMNS_IN)):
                save_figure(bounds_plot(plan, width_in=width_in), work, f"looks-{name}")
            stops = {
                "stops_without_effect": nothing.stops,
                "stops_with_effect": something.stops,
            }
            write_table(looks_frame(plan).assign(**stops), work / "looks.csv")
            text = json.dumps(as_json(said), indent=1, sort_keys=True, allow_nan=False)
            (work / "results.json").write_bytes(json_bytes(text + "\n"))
    shares = {"Stops, no effect": nothing.stops, "Stops, effect": something.stops}
    print_blocks(title, [looks_table(plan, shares)], sentences, notes)
    if out is not None:
        say(f"figure, table, numbers: {out}")


def _sentences(
    plan: SequentialPlan, nothing: SequentialError, something: SequentialError
) -> Iterator[str]:
    yield (
        f"Without an effect {nothing.significant:.3f} of studies end as significant (testing each"
        f" look at alpha: {nothing.naive:.3f}), with it {something.significant:.3f}."
    )
    yield (
        f"They end with {nothing.participants:.1f} and {something.participants:.1f} participants on"
        f" average; without looks, {plan.looks[-1]}."
    )
    if any(bound is not None for bound in plan.accept_p):
        yield (
            f"They stop for no difference in {nothing.accepted:.3f} and {something.accepted:.3f}."
        )


def _notes(plan: SequentialPlan, nothing: SequentialError, alone: str) -> Iterator[str]:
    error = math.sqrt(plan.alpha * (1.0 - plan.alpha) / nothing.studies)
    if nothing.significant > plan.alpha + 2.0 * error:
        why = alone or "too few people at the first looks for this test"
        if plan.rule == "bayes-factor":
            why = "a Bayes factor promises no error; raise bayes_factor, or choose another rule"
        yield f"false positives {nothing.significant:.3f} are above alpha {plan.alpha:g}: {why}"


def register(app: typer.Typer) -> None:
    """Add the command to the group `analysis`."""
    app.command()(sequential)
