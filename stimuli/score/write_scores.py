"""Scores as files: CSV and JSON with all that the numbers depend on."""

from __future__ import annotations

import csv
import io
import json
import math
from collections.abc import Iterable
from dataclasses import asdict
from pathlib import Path

from protocols.disk.hashing import Json
from protocols.disk.result_folder import check_result
from protocols.disk.whole_file import write_whole
from protocols.outside import page_bytes, safe_cell
from protocols.revision import code_revision, package_version
from stimuli.score.available import metric_versions
from stimuli.score.measure_clips import ScoreResults

CACHE_FOLDER = ".cache"
CSV_NAME, FRAMES_NAME, TABLES_NAME = "scores.csv", "frames.csv", "tables.md"
JSON_NAME, HTML_NAME = "scores.json", "scores.html"
BANDS_NAME = "bands.csv"
LATEX_NAME, TABLES_CSV_NAME = "tables.tex", "tables.csv"


def check_out(out: Path, reads: Iterable[Path] = ()) -> None:
    """Require a folder that is new, empty, or holds earlier scores, which will be replaced.

    Raises
    ------
    StudyError
        Naming what is in it.
    """
    check_result(out, replace=True, reads=reads, keeps=CACHE_FOLDER)


def scores_csv(results: ScoreResults) -> str:
    """One line per clip, region and metric; `inf` is a perfect PSNR, empty is nothing there."""
    rows = [
        [item.scene, item.size, item.method, region, metric.name,
         _number(results.value(item, metric, region)), metric.unit, metric.better]
        for item in results.subjects.items
        for metric in results.metrics
        for region in results.places(item, metric)
    ]  # fmt: skip
    return _csv(("scene", "size", "method", "region", "metric", "value", "unit", "better"), rows)


def frames_csv(results: ScoreResults) -> str:
    """One line per frame, for metrics that are measured frame by frame."""
    rows = []
    for item in results.subjects.items:
        for metric in results.metrics:
            for region in metric.regions:
                numbers = results.per_frame.get((item.name, metric.name, region), [])
                first = item.pair.frames - len(numbers)  # flicker begins with the second frame
                rows += [
                    [item.scene, item.size, item.method, region, metric.name, str(index),
                     _number(value)]
                    for index, value in enumerate(numbers, start=first)
                ]  # fmt: skip
    return _csv(("scene", "size", "method", "region", "metric", "frame", "value"), rows)


def bands_csv(results: ScoreResults) -> str:
    """One line per clip, level of the pyramid and ring around the gaze."""
    rows = [
        [item.scene, item.size, item.method, name, _number(x), _number(y)]
        for item in results.subjects.items
        for name, points in results.curves.get(item.name, {}).items()
        for x, y in points
    ]
    return _csv(("scene", "size", "method", "level", "eccentricity_deg", "ratio"), rows)


def scores_json(results: ScoreResults) -> dict[str, Json]:
    """Return every number and all that it depends on; an infinite one as the text "inf"."""
    settings = results.settings
    return {
        "format": 1,
        "made_with": f"{package_version()}, revision {code_revision()}",
        "versions": dict(metric_versions(results.metrics)),
        "origin": dict(results.subjects.origin),
        "display": settings.viewing.as_json(),
        "gaze_px": [list(point) for point in settings.gaze.points_px],
        "metrics": [
            {key: _json(value) for key, value in asdict(metric).items()}
            for metric in results.metrics
        ],
        "missing": [
            {"metrics": list(entry.metrics), "reason": entry.reason} for entry in results.missing
        ],
        "notes": list(results.notes),
        "clips": [
            {
                "scene": item.scene,
                "size": item.size,
                "method": item.method,
                "frames": item.pair.frames,
                "size_px": [item.pair.width_px, item.pair.height_px],
                "scores": {
                    f"{metric.name} {region}": _json(results.value(item, metric, region))
                    for metric in results.metrics
                    for region in results.places(item, metric)
                },
                "band_ratios": {
                    name: [[round(x, 3), round(y, 5)] for x, y in points]
                    for name, points in results.curves.get(item.name, {}).items()
                },
            }
            for item in results.subjects.items
        ],
    }


def write_text(path: Path, text: str) -> None:
    """Write a text file whole."""
    path.parent.mkdir(parents=True, exist_ok=True)
    write_whole(path, page_bytes(text))


def json_text(content: dict[str, Json]) -> str:
    """Return readable JSON that every reader takes."""
    return json.dumps(content, indent=1, ensure_ascii=False, allow_nan=False) + "\n"


def _csv(heads: tuple[str, ...], rows: Iterable[list[str]]) -> str:
    buffer = io.StringIO()
    writer = csv.writer(buffer, lineterminator="\n")
    writer.writerow(heads)
    writer.writerows([*map(safe_cell, row[:3]), *row[3:]] for row in rows)  # names, then numbers
    return buffer.getvalue()


def _number(value: float | None) -> str:
    return "" if value is None else f"{value:.8g}"


def _json(value: object) -> Json:
    if isinstance(value, float) and not math.isfinite(value):
        return "inf"
    if isinstance(value, tuple):
        return [_json(entry) for entry in value]
    if value is None or isinstance(value, bool | int | float | str):
        return value
    raise TypeError(f"{type(value).__name__} has no place in scores")
