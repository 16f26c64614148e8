"""Measure every clip by every metric: in processes, resumable, with progress and a cache.

The cache goes by the hash of all that decides the numbers.
"""

from __future__ import annotations

import importlib
import io
import json
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ThreadPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass, field
from pathlib import Path
from typing import cast

import numpy as np
from numpy.typing import NDArray

from protocols.disk.hashing import Json, sha256_file, sha256_json
from protocols.disk.whole_file import write_whole
from protocols.errors import StudyError
from stimuli.batch.executors import local_processes
from stimuli.score.available import MissingMetrics, family_versions, split_available
from stimuli.score.batch import Subject, Subjects, check_subjects, usable_regions
from stimuli.score.measured import PairScores, RatioCurve
from stimuli.score.metrics import FAMILIES, RINGS, Family, Metric
from stimuli.score.pair import ScoredPair
from stimuli.score.viewing_conditions import ViewerGaze, ViewingConditions


def hash_files(pairs: Iterable[ScoredPair]) -> dict[Path, str]:
    """Return the SHA-256 of every frame and mask."""
    paths = sorted({path for pair in pairs for path in (*pair.test, *pair.truth, *pair.masks)})
    with ThreadPoolExecutor(2) as pool:
        return dict(zip(paths, pool.map(sha256_file, paths), strict=True))


def measurement_key(
    pair: ScoredPair,
    family: Family,
    viewing: ViewingConditions,
    gaze: ViewerGaze,
    hashes: dict[Path, str],
) -> str:
    """Hash frames, masks, the family's version, its packages' versions, and its settings."""
    inputs: dict[str, Json] = {
        "family": family.name,
        "version": family.version,
        "versions": dict(family_versions(family)),
        "fps": pair.fps,
        "test": [hashes[path] for path in pair.test],
        "truth": [hashes[path] for path in pair.truth],
        "masks": [hashes[path] for path in pair.masks],
        "display": viewing.as_json() if family.uses_display else None,
        "gaze": [list(point) for point in gaze.points_px] if family.uses_gaze else None,
    }
    return sha256_json(inputs)


class Cache:
    """A folder of measurements; one that was written is whole."""

    def __init__(self, folder: Path | None) -> None:
        self.folder = folder

    def read(self, key: str) -> PairScores | None:
        """Return the values under `key`; None if there are none, or they are damaged."""
        if self.folder is None:
            return None
        try:
            raw = json.loads((self.folder / f"{key}.json").read_bytes())
            error_map = None
            if raw["has_map"]:
                data = (self.folder / f"{key}.npy").read_bytes()
                error_map = np.load(io.BytesIO(data), allow_pickle=False)
                if error_map.dtype != np.float32:  # version 0.3 rounded it: measured again
                    return None
            return PairScores(
                {(metric, region): value for metric, region, value in raw["values"]},
                {(metric, region): values for metric, region, values in raw["per_frame"]},
                error_map,
                {
                    name: tuple((float(x), float(y)) for x, y in points)
                    for name, points in raw.get("curves", {}).items()
                },
            )
        except (OSError, ValueError, KeyError, TypeError, RecursionError):
            return None

    def write(self, key: str, measured: PairScores) -> None:
        """Keep `measured`; its numbers are written last."""
        if self.folder is None:
            return
        self.folder.mkdir(parents=True, exist_ok=True)
        if measured.error_map is not None:
            buffer = io.BytesIO()
            np.save(buffer, measured.error_map, allow_pickle=False)
            write_whole(self.folder / f"{key}.npy", buffer.getvalue())
        raw = {
            "values": [[*where, value] for where, value in measured.values.items()],
            "per_frame": [[*where, list(found)] for where, found in measured.per_frame.items()],
            "has_map": measured.error_map is not None,
            "curves": {name: [list(p) for p in points] for name, points in measured.curves.items()},
        }
        write_whole(self.folder / f"{key}.json", json.dumps(raw).encode())


Report = Callable[[int, int, str], None]
"""Called with measurements done, measurements in all, and what is going on."""

TOGETHER = ("pixels", "statistics", "band-ratios", "flicker-rings", "flip")
"""Families that may share a process; each of the others needs processes of its own."""


@dataclass(frozen=True)
class ScoreSettings:
    """Metrics that are wanted, and the display and gaze that they assume."""

    metrics: tuple[Metric, ...]
    viewing: ViewingConditions
    gaze: ViewerGaze = field(default_factory=ViewerGaze)


@dataclass(frozen=True)
class ScoreResults:
    """Every number, and what it depends on.

    Attributes
    ----------
    metrics : tuple of Metric
        Those that were computed.
    values : mapping
        By (subject's name, metric's name, region); None where there was nothing to measure.
    per_frame : mapping
        The same, frame by frame, for metrics that have such numbers.
    maps : mapping
        Error of every pixel by subject's name, and in `map_metric` what it means.
    curves : mapping
        Ratios of bands by eccentricity: by subject's name, a line per level of the pyramid.
    """

    subjects: Subjects
    settings: ScoreSettings
    metrics: tuple[Metric, ...]
    missing: tuple[MissingMetrics, ...]
    notes: tuple[str, ...]
    values: dict[tuple[str, str, str], float | None]
    per_frame: dict[tuple[str, str, str], list[float | None]]
    maps: dict[str, NDArray[np.float32]]
    map_metric: str
    curves: dict[str, dict[str, RatioCurve]] = field(default_factory=dict)

    def value(self, subject: Subject, metric: Metric, region: str) -> float | None:
        """Return one number, None where there is none."""
        return self.values.get((subject.name, metric.name, region))

    def places(self, subject: Subject, metric: Metric) -> tuple[str, ...]:
        """Return the regions of one clip that a metric has numbers of, then rings."""
        regions = [region for region in metric.regions if region in subject.pair.regions]
        rings = (ring for ring in RINGS if (subject.name, metric.name, ring) in self.values)
        return *regions, *rings

    def values_of(self, method: str, metric: Metric, region: str) -> list[float | None]:
        """Return a number of each clip of a method."""
        items = (item for item in self.subjects.items if item.method == method)
        return [self.value(item, metric, region) for item in items]


@dataclass(frozen=True)
class _Job:
    subject: Subject
    family: Family
    key: str


def score(
    subjects: Subjects,
    settings: ScoreSettings,
    *,
    cache: Path | None = None,
    workers: int = 1,
    report: Report | None = None,
) -> ScoreResults:
    """Measure all `subjects`; what `cache` knows is not measured again.

    Parameters
    ----------
    cache : Path, optional
        Folder in which every measurement is kept as soon as it is made.
    workers : int
        Processes at work at once.

    Raises
    ------
    StudyError
        If frames are too small or differ in size, the gaze is not on them, no metric can be
        computed, or a process died.
    InputError
        If a frame is damaged.
    """
    say = report or (lambda *_: None)
    metrics, missing = split_available(settings.metrics)
    metrics, notes = _measurable(metrics, missing, subjects, settings.gaze)
    check_subjects(subjects, metrics)
    for subject in subjects.items:
        pair = subject.pair
        settings.gaze.check(pair.frames, pair.width_px, pair.height_px)
    say(0, 0, "hashing frames")
    hashes = hash_files(subject.pair for subject in subjects.items)
    wanted = {metric.family for metric in metrics}
    jobs = [
        _Job(subject, family, measurement_key(
            subject.pair, family, settings.viewing, settings.gaze, hashes))
        for family in FAMILIES.values() if family.name in wanted
        for subject in subjects.items
    ]  # fmt: skip
    found = _measure_all(jobs, settings, Cache(cache), workers, say)
    return _collected(subjects, settings, metrics, missing, notes, jobs, found)


def measure_job(
    family: str, pair: ScoredPair, viewing: ViewingConditions, gaze: ViewerGaze
) -> PairScores:
    """Run one family on one pair; what a worker process does."""
    import cv2

    cv2.setNumThreads(1)
    measure = cast(
        Callable[[ScoredPair, ViewingConditions, ViewerGaze], PairScores],
        importlib.import_module(FAMILIES[family].module).measure,
    )
    return measure(pair, viewing, gaze)


def _measurable(
    metrics: tuple[Metric, ...],
    missing: tuple[MissingMetrics, ...],
    subjects: Subjects,
    gaze: ViewerGaze,
) -> tuple[tuple[Metric, ...], tuple[str, ...]]:
    """Leave out what nothing here can be measured by; say so."""
    pairs = [subject.pair for subject in subjects.items]
    usable = tuple(
        metric for metric in metrics if any(usable_regions(metric, pair) for pair in pairs)
    )
    left_out = [metric for metric in metrics if metric not in usable]
    notes = list(subjects.notes)
    if gaze.points_px and any(metric.name == "fvvdp-1.0" for metric in usable):
        usable = tuple(metric for metric in usable if metric.name != "fvvdp-1.0")
        notes.append(
            "fvvdp-1.0: left out, since pyfvvdp has no foveated tables for these parameters;"
            " leave --gaze out to compute it"
        )
    blind = [metric for metric in usable if metric.needs_gaze and not gaze.points_px]
    if blind:
        usable = tuple(metric for metric in usable if metric not in blind)
        names = ", ".join(metric.name for metric in blind)
        notes.append(f"{names}: left out, measures only around a gaze (--gaze)")
    if left_out:
        needs = "clips with a mask of holes (--mask)" if not pairs[0].is_picture else "clips"
        names = ", ".join(metric.name for metric in left_out)
        notes.append(f"{names}: left out, measures only {needs}")
    if not usable:
        reasons = [f"{', '.join(entry.metrics)}: {entry.reason}" for entry in missing] + notes
        raise StudyError("no metric that was asked for can be computed\n" + "\n".join(reasons))
    return usable, tuple(notes)


def _measure_all(
    jobs: Sequence[_Job], settings: ScoreSettings, cache: Cache, workers: int, say: Report
) -> dict[str, PairScores]:
    by_key = {job.key: job for job in jobs}
    known = {key: cache.read(key) for key in by_key}
    found = {key: measured for key, measured in known.items() if measured is not None}
    groups: dict[str, list[_Job]] = {}
    for job in (job for key, job in by_key.items() if key not in found):
        name = "together" if job.family.name in TOGETHER else job.family.name
        groups.setdefault(name, []).append(job)
    keys = {job.key for job in jobs}

    def finish(job: _Job, measured: PairScores) -> None:
        cache.write(job.key, measured)
        found[job.key] = measured
        say(len(found), len(keys), f"{job.family.name}: {job.subject.name}")

    say(len(found), len(keys), "measuring")
    for name, group in groups.items():
        if name == "together" and min(workers, len(group)) == 1:
            for job in group:
                finish(job, measure_job(*_arguments(job, settings)))
        else:
            _in_processes(group, settings, min(workers, len(group)), finish)
    return found


def _in_processes(
    jobs: Sequence[_Job],
    settings: ScoreSettings,
    workers: int,
    finish: Callable[[_Job, PairScores], None],
) -> None:
    with local_processes(workers) as pool:
        try:
            running: dict[Future[PairScores], _Job] = {
                pool.submit(measure_job, *_arguments(job, settings)): job for job in jobs
            }
            while running:
                for future in wait(running, return_when=FIRST_COMPLETED).done:
                    finish(running.pop(future), future.result())
        except BrokenProcessPool:
            raise StudyError(
                "a worker process was killed (out of memory?); nothing that was measured is lost:"
                " run the same command again, with fewer --workers if memory is short"
            ) from None
        except BaseException:
            pool.stop()
            raise


def _arguments(
    job: _Job, settings: ScoreSettings
) -> tuple[str, ScoredPair, ViewingConditions, ViewerGaze]:
    return job.family.name, job.subject.pair, settings.viewing, settings.gaze


def _collected(
    subjects: Subjects,
    settings: ScoreSettings,
    metrics: tuple[Metric, ...],
    missing: tuple[MissingMetrics, ...],
    notes: tuple[str, ...],
    jobs: Sequence[_Job],
    found: dict[str, PairScores],
) -> ScoreResults:
    names = {metric.name for metric in metrics}
    made = [(job, found[job.key]) for job in jobs]
    maps: dict[str, dict[str, NDArray[np.float32]]] = {}
    for job, measured in made:
        if measured.error_map is not None:
            maps.setdefault(job.family.name, {})[job.subject.name] = measured.error_map
    kind = "flip" if "flip" in maps else "pixels"
    return ScoreResults(
        subjects=subjects,
        settings=settings,
        metrics=metrics,
        missing=missing,
        notes=notes,
        values={
            (job.subject.name, name, region): value
            for job, measured in made
            for (name, region), value in measured.values.items()
            if name in names
        },
        per_frame={
            (job.subject.name, name, region): numbers
            for job, measured in made
            for (name, region), numbers in measured.per_frame.items()
            if name in names
        },
        maps=maps.get(kind, {}),
        map_metric="FLIP" if kind == "flip" else "root-mean-square error",
        curves={
            job.subject.name: dict(measured.curves) for job, measured in made if measured.curves
        },
    )
