"""Notes of `protocol check` on what a study or a display may well say by mistake; never refusals.

Each bound is far from what laboratories do, so that a note is worth reading: mostly a number in
another unit.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

from protocols.display import Display
from protocols.errors import Problem, count_of
from protocols.feasibility import clip_size_px, session_duration_s
from protocols.plan import arrival_shows
from protocols.plausible_numbers import hardly_meant
from protocols.recipes.warped_clips import MeshScene, StereoScene, WarpedClips
from protocols.study_file.schema import StudyProtocol

LONGEST_S: Final = {
    "trial.fixation_s": 10,
    "trial.fixation_timeout_s": 600,
    "trial.iti_s": 30,
    "trial.feedback_s": 10,
    "task.stimulus_s": 60,
    "task.gap_s": 10,
    "gaze.violation_s": 1,
    "gaze.blink_s": 2,
    "gaze.blink_margin_s": 1,
    "gaze.silence_s": 5,
    "response.timeout_s": 600,
    "design.break_s": 1800,
    "analysis.exclusions.rt_min_s": 5,
}
"""The longest times that are taken without a word."""
LONGEST_CLIP_S: Final = 120
SHORTEST_CLIP_S: Final = 0.5
"""Two fixations of a quarter second: in less an eye sees once what moves."""
FEWEST_DECISIONS: Final = 16
"""With fewer, 95 % of the shares of who guesses reach further than a quarter from one half."""
LONGEST_SESSION_S: Final = 2 * 60 * 60
WIDEST_DEG: Final = 100
SMALLEST_PX: Final = 32


def display_notes(display: Display) -> list[Problem]:
    """Return notes on possible mistakes in a display's measures."""
    pitch = f"a pixel is {display.pitch_x_mm:.3g} mm wide ({display.width_mm:g} mm for"
    pitch += f" {display.width_px} px)"
    return [
        *_noted("display.distance_mm", display.distance_mm, "the eye is {:g} mm from the screen"),
        *_noted("display.width_mm", display.width_mm, pitch, "pitch_mm", display.width_px),
        *_noted("display.refresh_hz", display.refresh_hz, "the screen is drawn at {:g} Hz"),
    ]


def _noted(place: str, value: float, said: str, of: str = "", per: float = 1.0) -> list[Problem]:
    """Return a note on a number that is hardly meant; `of`: a quantity that its key is not."""
    asked = hardly_meant(of or place.rpartition(".")[2], value, per=per)
    return [Problem(place, said.format(value) + asked)] if asked else []


def study_notes(study: StudyProtocol, display: Display, trials: int) -> list[Problem]:
    """Return notes on possible mistakes in a study on its display.

    Parameters
    ----------
    trials : int
        Of a whole session, practice and catch trials included.
    """
    return [
        *_times(study),
        *_noted("gaze.window_deg", study.gaze.window_deg, "gaze may lie {:g} deg from the dot"),
        *_sizes(study, display),
        *_scenes(study),
        *_true_view(study),
        *_length(study, trials),
        *_shown_little(study, trials),
        *_left_out(study),
        *_arrival(study),
    ]


def _times(study: StudyProtocol) -> Iterator[Problem]:
    for path, longest_s in LONGEST_S.items():
        value: object = study
        for name in path.split("."):
            value = getattr(value, name, None)
        if isinstance(value, (int, float)) and value > longest_s:
            yield _long(path, float(value))
    clip_s = study.stimuli.clip_s
    if clip_s is not None and clip_s > LONGEST_CLIP_S:
        yield _long(f"{study.stimuli.section}.duration_s", clip_s)


def _long(path: str, value_s: float) -> Problem:
    told = f"{value_s / 60:.3g} minutes" if value_s >= 120 else f"{value_s:g} seconds"
    return Problem(
        path, f"{value_s:g} s are {told}; seconds are meant: should it be {value_s / 1000:g}?"
    )


def _sizes(study: StudyProtocol, display: Display) -> Iterator[Problem]:
    size_px = clip_size_px(study, display)
    angles_deg = display.angles_deg(*size_px)
    section = study.stimuli.section
    if min(size_px) < SMALLEST_PX:
        yield Problem(
            section,
            f"stimuli are {size_px[0]} x {size_px[1]} px on this display, which shows little;"
            " should they be larger?",
        )
    if max(angles_deg) > WIDEST_DEG:
        yield Problem(
            section,
            f"stimuli are {angles_deg[0]:.0f} x {angles_deg[1]:.0f} deg on this display, more than"
            " an eye sees at rest; are the display's measures and distance right?",
        )


def _scenes(study: StudyProtocol) -> Iterator[Problem]:
    if not isinstance(study.stimuli, WarpedClips):
        return
    for index, scene in enumerate(study.stimuli.scenes):
        place = f"stimuli.scenes[{index}]"
        if isinstance(scene, StereoScene):
            said = "the cameras are {:g} m apart"
            yield from _noted(f"{place}.baseline_m", scene.baseline_m, said)
        view = scene.view if isinstance(scene, MeshScene) else None
        if view is not None and view.vertical_fov_deg is not None:
            key = f"{place}.view.vertical_fov_deg"
            yield from _noted(key, view.vertical_fov_deg, "the camera sees {:g} deg", "view_deg")


def _true_view(study: StudyProtocol) -> Iterator[Problem]:
    view = study.stimuli.clips.true_view if isinstance(study.stimuli, WarpedClips) else None
    dot_deg = study.trial.fixation_x_deg, study.trial.fixation_y_deg
    if view is not None and (view.x_deg, view.y_deg) != dot_deg:
        yield Problem(
            "stimuli.clips.true_view",
            f"the true view is around ({view.x_deg:g}, {view.y_deg:g}) deg, and the dot at"
            f" ({dot_deg[0]:g}, {dot_deg[1]:g}) deg (trial.fixation_x_deg, fixation_y_deg); should"
            " they be the same place?",
        )


def _length(study: StudyProtocol, trials: int) -> Iterator[Problem]:
    length_s = session_duration_s(study, trials)
    if length_s > LONGEST_SESSION_S:
        yield Problem(
            "design",
            f"a session takes about {length_s / 60:.0f} minutes ({trials} trials), answers in"
            " 1.5 s; people tire. Use fewer repeats, scenes or sizes, or several sessions",
        )


def _shown_little(study: StudyProtocol, trials: int) -> Iterator[Problem]:
    clip_s, practice = study.stimuli.clip_s, study.design.practice
    if clip_s is not None and clip_s < SHORTEST_CLIP_S:
        yield Problem(
            f"{study.stimuli.section}.duration_s",
            f"what moves is shown for {clip_s:.2g} s, hardly long enough to be looked at; use more"
            " frames, or fewer a second",
        )
    decisions = trials - study.task.catch_trials - (0 if practice is None else practice.trials)
    if 0 < decisions < FEWEST_DECISIONS:
        yield Problem(
            "design.repeats",
            f"each participant makes {count_of(decisions, 'decision')}, which say little about one"
            " person; use more repeats or scenes",
        )


def _left_out(study: StudyProtocol) -> Iterator[Problem]:
    """Yield a note on methods whose stimuli are in no trial, so that no comparison has them."""
    column, pool = getattr(study.task, "compare", "method"), study.stimuli.pool()
    cells = study.task.cells(study.pool)
    shown = {name for cell in cells for each in cell.arrangements for name in each.stimuli}
    met = {one.condition.get(column) for one in pool if one.name in shown}
    for value in study.stimuli.values(column):
        if met and value not in met:
            yield Problem(
                "task",
                f"no planned comparison has the {column} {value!r}, and no trial shows it; name it"
                " where the task names what it compares, or leave it out of the stimuli",
            )


def _arrival(study: StudyProtocol) -> Iterator[Problem]:
    if study.privacy.secret_sha256 is not None and arrival_shows(study):
        yield Problem(
            "design.places",
            "the order in which participants arrive shows in the order of their trials, in what"
            " comes first and in the keys, although the study has a secret; so public exports"
            ' leave these out. If nobody took part yet, add places = "drawn" to [design]',
        )
