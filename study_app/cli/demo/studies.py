"""A gaze that moves, trials of every task as filmstrips, and simulated observers' reports."""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import as_completed
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from analysis.report.build import report_sessions
from pipeline.foveation.geometry import Flat
from pipeline.gl.context import lent_context
from protocols.display import Display
from protocols.feasibility import virtual_manifest
from protocols.load import load_study
from protocols.plan import PlannedTrial, make_plan
from protocols.recipes.foveated_images import REFERENCE, FoveatedImages
from protocols.schema import StudyProtocol
from protocols.script import Picture as Drawing
from protocols.script import example_scripts
from protocols.tasks.two_alternative import TwoAlternative
from protocols.units import Scalar
from stimuli.choice import Choice
from stimuli.executors import cores, local_processes
from stimuli.foveated.moving import FRAMES, wander
from stimuli.pictures import save_picture, sheet
from stimuli.recipes.foveated_work import Bench, Order
from stimuli.scenes.stereo import built_in_pair
from study_app.cli.demo.steps import Step
from study_app.gaze.simulated import STEADY
from study_app.paint import paint
from study_app.simulate import Simulation, simulate_study

STUDIES: dict[str, dict[str, Scalar]] = {
    "beyond-blur-task": {"scene": "tunnel", "method": "ours", "eccentricity_deg": 10.0},
    "beyond-blur-preference": {"scene": "notices", "first": "ours", "second": "blur"},
    "beyond-blur-detection": {"scene": "notices", "method": "ours", "cut": "inconsistent"},
    "critical-scaling": {"scene": "notices", "metamer": "noise", "scaling": 0.5},
    "critical-scaling-halves": {"scene": "notices", "metamer": "noise", "scaling": 0.5},
}
"""The studies, and of which condition a trial is drawn."""
STRIP_NAME = "trial.png"
GAZE_NAME = "gaze.webp"
OBSERVERS = 3
SHOT_PX = 480

Picture = NDArray[np.uint8]


def show_studies(folder: Path, step: Step) -> None:
    """Write `gaze.webp` and fill a folder per study: `trial.png`, `sessions/`, `report/`.

    What is there is kept. Studies share the processors.
    """
    missing = unfinished(folder)
    still = not (folder / GAZE_NAME).is_file()
    if not missing and not still:
        step.result = "kept"
        return
    tasks = len(missing) + still
    step(0, tasks)
    with local_processes(min(cores(), tasks)) as pool:
        futures = [pool.submit(show_study, name, folder / name) for name in missing]
        if still:
            futures.append(pool.submit(show_moving_gaze, folder / GAZE_NAME))
        for done, future in enumerate(as_completed(futures), 1):
            future.result()
            step(done, tasks)
    step.result = f"{len(STUDIES)} studies, {OBSERVERS} observers each"


def unfinished(folder: Path) -> list[str]:
    """Return the studies that are not there, or not whole."""
    return [name for name in STUDIES if not (folder / name / STRIP_NAME).is_file()]


def show_moving_gaze(path: Path, frames: int = FRAMES) -> None:
    """Write an animation: a photograph as a metamer for a gaze that wanders."""
    path.parent.mkdir(parents=True, exist_ok=True)
    with lent_context() as ctx:
        picture = built_in_pair("motorcycle").left
        choice = Choice("metamer", {"law": "authors"})
        wander(path, picture, Flat(width_deg=40), choice, frames=frames, ctx=ctx)


def show_study(name: str, folder: Path, observers: int = OBSERVERS) -> None:
    """Simulate a shipped study and report it; last, draw one trial of it."""
    study, display = load_study(Path(name), None)
    sessions, report = folder / "sessions", folder / "report"
    folder.mkdir(parents=True)
    simulation = Simulation(study, display, gaze=STEADY, gaze_rate_hz=60.0)
    simulate_study(simulation, sessions, observers)
    report_sessions(sessions, study, report, figure_files=False)
    save_picture(folder / STRIP_NAME, trial_strip(study, display, chosen_trial(study, display)))


def chosen_trial(study: StudyProtocol, display: Display) -> PlannedTrial:
    """Return the first trial of the condition that is shown."""
    wanted = STUDIES[study.study.name]
    plan = make_plan(study, virtual_manifest(study, display), "S001", 0)
    for trial in plan.trials:
        if all(trial.condition.get(column) == value for column, value in wanted.items()):
            return trial
    raise AssertionError(f"{study.study.name}: no trial of {wanted}")


def trial_strip(study: StudyProtocol, display: Display, trial: PlannedTrial) -> Picture:
    """Return the strip of a trial, whose stimuli are made in small at the display's angles."""
    recipe = study.stimuli
    assert isinstance(recipe, FoveatedImages)
    shrunk = recipe.width_px / SHOT_PX
    small = {"width_px": SHOT_PX, "height_px": round(recipe.height_px / shrunk / 2) * 2}
    distance_px = display.distance_mm / display.pitch_x_mm / shrunk
    bench = Bench(Order(recipe.model_copy(update=small), distance_px, Path()))
    entries = {one.name: one for one in recipe.stimuli()}
    try:
        # The reference last: what came before is not foveated twice.
        order = sorted(set(trial.stimuli), key=lambda name: entries[name].shown.name == REFERENCE)
        made = {name: np.rint(255 * bench.colour(entries[name])).astype(np.uint8) for name in order}
    finally:
        bench.release()
    return strip(study, display, [made[name] for name in trial.stimuli], distance_px)


def side_by_side(study: StudyProtocol, display: Display, stimuli: Sequence[Picture]) -> Picture:
    """Return the strip of a trial of `two-alternative`, with stimuli of another task's study."""
    distance_px = display.distance_mm / display.pitch_x_mm
    half_deg = float(np.degrees(np.arctan(0.55 * stimuli[0].shape[1] / distance_px)))
    task = TwoAlternative(kind="two-alternative", separation_deg=2 * half_deg)
    answers = dict.fromkeys(task.answers(), "-")  # no words are drawn
    texts = {
        language: one.model_copy(update={"answers": answers})
        for language, one in study.text.languages.items()
    }
    text = study.text.model_copy(update={"languages": texts})
    other = study.model_copy(update={"task": task, "text": text})
    return strip(other, display, stimuli, distance_px)


def strip(
    study: StudyProtocol, display: Display, stimuli: Sequence[Picture], distance_px: float
) -> Picture:
    """Return every phase of a trial, labelled, on a screen just as wide as it needs."""
    high, wide, _ = stimuli[0].shape
    screen = display.model_copy(
        update={
            "width_px": wide, "height_px": high, "distance_mm": distance_px,
            "width_mm": float(wide), "height_mm": float(high),
        }
    )  # fmt: skip
    script = example_scripts(study, screen, stimulus_px=(wide, high))[0]
    aside = max(-entry.at[0] for shown in script.frames for entry in shown)
    script = script.model_copy(update={"size_px": (2 * aside, high)})
    frames = {index: [stimulus] for index, stimulus in enumerate(stimuli)}
    shots = []
    last = max(index for index, phase in enumerate(script.phases) if phase.question)
    for phase in script.phases[: last + 1]:
        long = (
            "" if phase.frames is None else f", {1000 * phase.frames / display.refresh_hz:.0f} ms"
        )
        answers = f": {' / '.join(study.task.answers())}" if phase.question else ""
        words = {one for one in phase.show if isinstance(one, Drawing) and one.of.kind == "words"}
        show = tuple(entry for entry in phase.show if entry not in words)
        shown = paint(script, phase.model_copy(update={"show": show}), frames, {})
        shots.append((f"{phase.name}{long}{answers}", shown))
    return sheet(shots, columns=len(shots))
