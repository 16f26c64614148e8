"""Stored gaze of one run as a BIDS eye-tracking recording."""

import csv
import gzip
import math
from collections.abc import Iterator
from contextlib import contextmanager
from io import TextIOWrapper
from itertools import pairwise
from pathlib import Path, PurePosixPath

from analysis.export.bids_events import NOTHING
from analysis.export.export_content import ExportedStudy, Person, Run, write_json
from analysis.export.public import gaze_source
from protocols.disk.hashing import Json, sha256_bytes
from protocols.disk.whole_file import read_bytes
from protocols.errors import StudyError
from protocols.journal import Attempt, Calibration, GazeInfo, SessionResume, SessionStart, SideFile
from protocols.limits import check_cells
from protocols.outside import lines_of

_COLUMNS = ("timestamp", "x_coordinate", "y_coordinate")
HEADER = ["t_s", "raw_t", "x_px", "y_px"]
_METHODS = {
    "mouse": "The cursor stood in for an eye",
    "simulated": "An artificial eye; nobody was recorded",
    "replay": "A recording was replayed",
}
Sample = tuple[float, float, float | None, float | None]
"""Session clock and tracker's clock, both as stored; pixels from the upper left, or None: lost."""


def write_gaze(content: ExportedStudy, beh: Path, stem: str, person: Person, run: Run) -> list[str]:
    """Write ``_physio`` and ``_physioevents`` of a run that stored gaze; return what is odd.

    A gaze file that is missing, was changed, or cannot be read is left out, and said so.
    """
    stored = [(attempt, attempt.gaze_file) for attempt in run.attempts if attempt.gaze_file]
    folder, notes, first_s, used = person.reading.journal.path.parent, [], None, []
    path = beh / f"{stem}_recording-eye1_physio.tsv.gz"
    with _compressed(path) as file:
        for attempt, side in stored:
            try:
                samples = read_samples(folder, side)
            except StudyError as error:
                notes.append(f"{person.reading.name}: {error}; its samples are left out")
                continue
            shift_s = (content.shifts or {}).get(person.reading.name, {}).get(attempt.n, 0.0)
            samples = [(t_s + shift_s, raw_t, x, y) for t_s, raw_t, x, y in samples]
            for t_s, raw_t, x_px, y_px in samples:
                place = f"{x_px:.2f}\t{y_px:.2f}" if x_px is not None else f"{NOTHING}\t{NOTHING}"
                own = "" if content.public else f"\t{raw_t!r}"
                file.write(f"{t_s:.6f}\t{place}{own}\n")
            if samples:
                first_s = samples[0][0] if first_s is None else first_s
                used.append(attempt)
    if first_s is None:
        path.unlink()
        return notes
    sidecar = beh / f"{stem}_recording-eye1_physio.json"
    write_json(sidecar, _sidecar(content, person, run, first_s))
    _write_messages(beh / f"{stem}_recording-eye1_physioevents", content, used)
    return notes


def read_samples(folder: Path, side: SideFile) -> list[Sample]:
    """Read one attempt's stored gaze.

    Raises
    ------
    StudyError
        If the file is not there, is not the one that was recorded, or is no table of samples.
    """
    name = PurePosixPath(side.file)
    if name.is_absolute() or ".." in name.parts:
        raise StudyError("a gaze file must lie in the folder of its journal")
    data = read_bytes(folder / name, "the gaze file")
    if sha256_bytes(data) != side.sha256:
        raise StudyError(f"{name}: must be as it was recorded (its hash is another)")
    try:
        text = data.decode("ascii")
        check_cells(folder / name, text)
        header, *rows = csv.reader(lines_of(text))
        if header != HEADER:
            raise ValueError
        samples: list[Sample] = [
            (float(t_s), float(raw_t), float(x) if x else None, float(y) if y else None)
            for t_s, raw_t, x, y in rows
        ]
        if not all(math.isfinite(value) for row in samples for value in row if value is not None):
            raise ValueError
    except (ValueError, csv.Error):
        raise StudyError(
            f"{name}: must be a table of {', '.join(HEADER)}, all finite numbers"
        ) from None
    if any(after[0] < before[0] for before, after in pairwise(samples)):
        raise StudyError(f"{name}: t_s must not fall from line to line")
    return samples


def _sidecar(content: ExportedStudy, person: Person, run: Run, first_s: float) -> dict[str, Json]:
    opening: SessionStart | SessionResume = run.opening
    gaze: GazeInfo | None = opening.gaze or person.reading.start.gaze
    source = gaze_source(gaze.source, public=content.public) if gaze else NOTHING
    checks = [event for event in run.events if isinstance(event, Calibration)]
    found: dict[str, Json] = {
        "TaskName": content.study.study.name,
        "SamplingFrequency": gaze.rate_hz if gaze else content.study.gaze.rate_min_hz,
        "StartTime": first_s,
        "Columns": list(_COLUMNS),
        "PhysioType": "eyetrack",
        "RecordedEye": content.options.recorded_eye,
        "SampleCoordinateSystem": "gaze-on-screen",
        "EyeTrackingMethod": _METHODS.get(source, source),
        "timestamp": {
            "Description": "On the clock of the events file. Samples were stored during attempts"
            " only, so there are gaps between them",
            "Units": "s",
        },
        "x_coordinate": {
            "Description": "Gaze on the screen, from its left edge; n/a: the eye was lost",
            "Units": "pixel",
        },
        "y_coordinate": {
            "Description": "Gaze on the screen, from its upper edge; n/a: the eye was lost",
            "Units": "pixel",
        },
    }
    if not content.public:  # a tracker's clock may be the wall clock
        found["Columns"] = [*_COLUMNS, "tracker_timestamp"]
        found["tracker_timestamp"] = {
            "Description": "The tracker's own stamp, on its clock and in its unit"
        }
        if gaze and gaze.description:
            found["GazeSourceDescription"] = gaze.description
    if checks:
        found["CalibrationCount"] = len(checks)
        found["AverageCalibrationError"] = round(
            sum(check.accuracy_deg for check in checks) / len(checks), 4
        )
    return found


def _write_messages(stem: Path, content: ExportedStudy, attempts: list[Attempt]) -> None:
    """Write the phases of the recorded attempts on the samples' own time line."""
    with _compressed(stem.with_name(stem.name + ".tsv.gz")) as file:
        for attempt in attempts:
            for phase in attempt.phases:
                lasted_s = phase.offset_s - phase.onset_s
                file.write(
                    f"{phase.onset_s:.6f}\t{lasted_s:.6f}\t{phase.phase}\t"
                    f"{attempt.trial} attempt {attempt.attempt}\n"
                )
    write_json(
        stem.with_name(stem.name + ".json"),
        {
            "TaskName": content.study.study.name,
            "Columns": ["onset", "duration", "trial_type", "message"],
            "Description": "Phases of the attempts during which gaze was stored",
            "OnsetSource": "timestamp",
            "onset": {"Description": "On the clock of `timestamp`", "Units": "s"},
            "duration": {"Description": "Duration of the phase", "Units": "s"},
            "trial_type": {"Description": "Phase, as in the events file"},
            "message": {"Description": "Trial of the plan, and number of the attempt"},
        },
    )


@contextmanager
def _compressed(path: Path) -> Iterator[TextIOWrapper]:
    """Open a gzip file that holds neither name nor time: same samples, same bytes."""
    with (
        path.open("wb") as raw,
        gzip.GzipFile(filename="", mode="wb", fileobj=raw, mtime=0) as packed,
        TextIOWrapper(packed, encoding="ascii", newline="\n") as text,
    ):
        yield text
