"""Scores of pictures that were made for a gaze, each beside what it is blind to."""

from __future__ import annotations

import math
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pipeline.errors import InputError
from pipeline.foveation.view import SCORED_DEG, around_gaze, scored_view
from pipeline.pictures.write import write_pixels
from protocols.errors import StudyError
from protocols.manifest import Clip, Manifest
from stimuli.score.available import MissingMetrics
from stimuli.score.batch import Subject, Subjects
from stimuli.score.measure_clips import Report, ScoreSettings, score
from stimuli.score.measured import RatioCurve
from stimuli.score.metrics import FRAME, choose_metrics
from stimuli.score.pair import ScoredPair, read_colour
from stimuli.score.viewing_conditions import ViewerGaze, ViewingConditions, standard_fhd

METRICS_OF_FOVEATION = ("statistics", "band-ratio", "fvvdp", "cvvdp")
PANORAMA_NOTE = (
    f"the panorama is scored in the flat view around the gaze, {SCORED_DEG:g} degrees an edge:"
    " metrics know flat pictures, and what lies beyond is not scored"
)


@dataclass(frozen=True)
class FoveatedScores:
    """Scores of a clip or picture under a gaze.

    Attributes
    ----------
    values : mapping
        By metric's name; None where there is nothing to measure.
    blind : mapping
        By metric's name, what it does not see.
    band_ratios : mapping
        By level of the pyramid: (eccentricity in degrees, deviation over the reference's).
    missing : tuple of MissingMetrics
        Metrics that this machine cannot compute, with the cure.
    """

    values: Mapping[str, float | None]
    blind: Mapping[str, str]
    band_ratios: Mapping[str, RatioCurve]
    missing: tuple[MissingMetrics, ...]


def score_foveated(
    test: NDArray[np.float32],
    truth: NDArray[np.float32],
    gaze_px: Sequence[tuple[float, float]],
    viewing: ViewingConditions | None = None,
    *,
    fps: float = 60.0,
    metrics: Sequence[str] = METRICS_OF_FOVEATION,
) -> FoveatedScores:
    """Score pictures with a gaze per frame.

    Parameters
    ----------
    test, truth : ndarray of float32, shape (frames, H, W, 3)
        Encoded R'G'B' in [0, 1]; one frame is a picture.
    gaze_px : sequence of (x, y)
        One for all frames, or one per frame; on the picture.
    viewing : ViewingConditions, optional
        By default FovVideoVDP's `standard_fhd`; see `seen_wide` for a visual angle.
    fps : float
        Of several frames.

    Raises
    ------
    InputError, StudyError
        If shapes or counts do not fit, or a frame is too small for a metric.
    """
    if test.shape != truth.shape or test.ndim != 4 or test.shape[3] != 3:
        raise InputError(
            f"test and truth must both be of shape (frames, H, W, 3) (got {test.shape} and"
            f" {truth.shape})"
        )
    if not gaze_px:
        raise InputError("gaze_px must hold a point for all frames, or one per frame (got none)")
    with tempfile.TemporaryDirectory(prefix="metamerlab-score-") as name:
        files = [
            tuple(_kept(Path(name) / f"{what}{index:06d}.png", frame)
                  for index, frame in enumerate(frames))
            for what, frames in (("test", test), ("truth", truth))
        ]  # fmt: skip
        height, width = test.shape[1:3]
        pair = ScoredPair(
            "test", files[0], files[1], (), width, height, 0.0 if len(test) == 1 else fps
        )
        settings = ScoreSettings(
            choose_metrics(metrics), viewing or standard_fhd(), ViewerGaze(tuple(gaze_px))
        )
        results = score(Subjects((Subject("truth", "", "test", pair),), {}, ()), settings)
    return FoveatedScores(
        {
            metric.name: results.values.get(("test", metric.name, FRAME))
            for metric in results.metrics
        },
        {metric.name: metric.blind for metric in results.metrics},
        results.curves.get("test", {}),
        results.missing,
    )


def seen_wide(width_px: int, height_px: int, fov_deg: float) -> ViewingConditions:
    """A standard display on which so many pixels span `fov_deg` degrees across."""
    plain = standard_fhd()
    width_m = 2 * plain.distance_m * math.tan(math.radians(fov_deg / 2))
    return ViewingConditions(
        f"{fov_deg:.4g} degrees wide", width_px, height_px, width_m,
        width_m * height_px / width_px, plain.distance_m,
        plain.peak_cd_m2, plain.contrast, plain.ambient_lux, plain.gamma,
    )  # fmt: skip


def subjects_of_conditions(
    name: str,
    truth: Path,
    tests: Mapping[str, Path],
    size: tuple[int, int],
    notes: tuple[str, ...] = (),
) -> Subjects:
    """One picture, and what several conditions made of it.

    Parameters
    ----------
    tests : mapping
        Files by condition.
    size : (height, width)
    notes : tuple of str
        What the page has to say of them.
    """
    height, width = size
    items = tuple(
        Subject(name, "", condition, ScoredPair(
            f"{name}__{condition}", (path,), (truth,), (), width, height, 0.0))
        for condition, path in tests.items()
    )  # fmt: skip
    return Subjects(items, {"picture": name}, notes)


def subjects_of_panoramas(
    subjects: Subjects, gaze: ViewerGaze, folder: Path
) -> tuple[Subjects, ViewerGaze, ViewingConditions]:
    """Return panoramas as the flat views around the gaze, which metrics can measure.

    Parameters
    ----------
    subjects : Subjects
        Pictures or clips that are equirectangular, 2:1.
    gaze : ViewerGaze
        In pixels of the panorama; on it.
    folder : Path
        Where the views are written, in 16 bits; it must be there.

    Raises
    ------
    StudyError, InputError
        If the gaze is not on the panorama, or that is not 2:1.
    """
    items = []
    for number, subject in enumerate(subjects.items):
        pair = subject.pair
        gaze.check(pair.frames, pair.width_px, pair.height_px)
        views: list[tuple[Path, ...]] = []
        for what, files in (("test", pair.test), ("truth", pair.truth)):
            place = folder / f"{number:03d}-{what}"
            place.mkdir(exist_ok=True)
            views.append(
                tuple(
                    _kept(
                        place / f"{index:06d}.png",
                        around_gaze(
                            read_colour(path), gaze.at(index, pair.width_px, pair.height_px)
                        ),
                    )
                    for index, path in enumerate(files)
                )
            )
        edge = scored_view((pair.width_px, pair.height_px)).width_px
        seen = ScoredPair(pair.name, views[0], views[1], (), edge, edge, pair.fps)
        items.append(Subject(subject.scene, subject.size, subject.method, seen))
    edge = items[0].pair.width_px
    notes = (*subjects.notes, PANORAMA_NOTE)
    viewing = seen_wide(edge, edge, SCORED_DEG)
    return (
        Subjects(tuple(items), subjects.origin, notes),
        ViewerGaze(((edge / 2, edge / 2),)),
        viewing,
    )


def is_foveated(manifest: Manifest) -> bool:
    """True if a batch was made by the recipe `foveated-images`."""
    return not manifest.simulated and all(
        "gaze_x_px" in clip.parameters and clip.hole_share is None for clip in manifest.clips
    )


def made_for(manifest: Manifest) -> tuple[ViewerGaze, ViewingConditions] | None:
    """Return the dot of warped clips with a true view, and their distance; None: without one."""
    clip = next((clip for clip in manifest.clips if "gaze_x_px" in clip.parameters), None)
    return None if clip is None else (ViewerGaze((_gaze_of(clip),)), _viewing_of(clip))


def subjects_of_stills(
    folder: Path, manifest: Manifest, gaze: ViewerGaze
) -> tuple[Subjects, ViewerGaze, ViewingConditions]:
    """Return the stills of a batch of `foveated-images` around one gaze, each with its reference.

    Parameters
    ----------
    gaze : ViewerGaze
        Which of the batch's; may be left empty where there is one.

    Raises
    ------
    StudyError
        If there are several gazes and none is named, or nothing has a reference.
    """
    places = dict.fromkeys(_gaze_of(clip) for clip in manifest.clips)
    chosen = gaze.points_px[0] if gaze.points_px else next(iter(places))
    if (len(places) > 1 and not gaze.points_px) or chosen not in places:
        listed = "; ".join(f"{x:g},{y:g}" for x, y in places)
        raise StudyError(f"--gaze: must be one of this batch's: {listed}")
    there = [clip for clip in manifest.clips if _gaze_of(clip) == chosen]
    truths = {_rest(c): c for c in there if c.parameters["method"] == "reference"}
    plain = {c.column("scene"): c for c in truths.values()}  # of cut pictures, any will do
    items, without = [], set()
    for clip in there:
        if clip.parameters["method"] == "reference":
            continue
        truth = truths.get(_rest(clip)) or (plain.get(clip.column("scene")) if "cut" in
                                            clip.condition else None)  # fmt: skip
        if truth is None:
            without.add(f"{clip.name}: no reference, so nothing to score against")
            continue
        more = ", ".join(value for name, value in _rest(clip) if name not in ("scene", "gaze"))
        scene = clip.column("scene") + (f", {more}" if more else "")
        files = [(folder / one.frame_path(0),) for one in (clip, truth)]
        pair = ScoredPair(clip.name, files[0], files[1], (), clip.width_px, clip.height_px, 0.0)
        items.append(Subject(scene, "", clip.column("method"), pair))
    if not items:
        raise StudyError(
            f"{folder}: stills must have a reference to be scored against; add a method"
            " 'reference' to the protocol and build again"
        )
    origin = {
        "folder": folder.name,
        "study": manifest.study,
        "display of the stills": manifest.display,
        "stills made by": manifest.revision,
        "manifest": manifest.sha256,
    }
    subjects = Subjects(tuple(items), origin, tuple(sorted(without)))
    return subjects, ViewerGaze((chosen,)), _viewing_of(there[0])


def _gaze_of(clip: Clip) -> tuple[float, float]:
    x, y = (float(str(clip.parameters[f"gaze_{axis}_px"])) for axis in "xy")
    return x, y


def _viewing_of(clip: Clip) -> ViewingConditions:
    half = clip.width_px / 2 / float(str(clip.parameters["distance_px"]))
    return seen_wide(clip.width_px, clip.height_px, 2 * math.degrees(math.atan(half)))


def _rest(clip: Clip) -> tuple[tuple[str, str], ...]:
    """All of its condition but the method."""
    return tuple((name, str(value)) for name, value in clip.condition.items() if name != "method")


def score_conditions(
    subjects: Subjects,
    viewing: ViewingConditions,
    gaze_px: tuple[float, float],
    out: Path,
    cache: Path,
    *,
    report: Report | None = None,
) -> Path:
    """Score them by the metrics that know a gaze, and write tables, plots and one page.

    What was measured before is in the folder `cache`.
    """
    from stimuli.score.report import write_pages

    least = min(subjects.items[0].pair.width_px, subjects.items[0].pair.height_px)
    fit = [metric for metric in choose_metrics(METRICS_OF_FOVEATION) if metric.least_px <= least]
    if not fit:
        raise InputError(f"a picture to score must have at least 4 px an edge (has {least})")
    settings = ScoreSettings(tuple(fit), viewing, ViewerGaze((gaze_px,)))
    results = score(subjects, settings, cache=cache, workers=1, report=report)
    return write_pages(results, out)


def _kept(path: Path, frame: NDArray[np.float32]) -> Path:
    write_pixels(path, np.rint(65535.0 * np.clip(frame, 0, 1)).astype(np.uint16), ("R", "G", "B"))
    return path
