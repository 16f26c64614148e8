"""The page of a demonstration: one HTML file that needs nothing else."""

from __future__ import annotations

import base64
import io
import os
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from jinja2 import Environment, PackageLoader, StrictUndefined
from numpy.typing import NDArray
from PIL import Image as PillowImage

from protocols.display import Display
from protocols.load import load_protocol
from protocols.manifest import Clip, Manifest
from protocols.outside import page_bytes
from protocols.recipes.warped_clips import ClipName
from protocols.schema import StudyProtocol
from stimuli.build import HOLES_FOLDER, survey_name
from stimuli.pictures import of_holes
from stimuli.png import decode
from stimuli.preview import preview_path
from stimuli.whole_file import write_whole
from study_app.cli.demo import filmstrip, pictures, studies
from study_app.cli.demo.layout import Layout, Record
from study_app.operator_view import standing
from study_app.sittings import find_sittings

JPEG_QUALITY = 90
SHOT_PX = 300
STRIP_PX = 1600
DETAIL_SCALE = 2
LATE_SHARE = 0.02
"""Of all refreshes: a machine that misses more is too slow or too busy for a real session."""
PHASES = {
    "fixate": "fixation",
    "first": "first clip",
    "gap": "gap",
    "second": "second clip",
    "respond": "answer",
}


@dataclass(frozen=True)
class Facts:
    """What the page says beside the pictures."""

    protocol: StudyProtocol
    study: str
    display: Display
    own_display: str | None
    """The user's display file, where the window stood on their own screen."""
    observers: int
    window: bool
    photographs: pictures.Photographs
    manifest: Manifest
    headline: str
    cores: int
    version: str


def write_page(layout: Layout, record: Record, facts: Facts) -> None:
    """Write ``index.html``, whole or not at all."""
    environment = Environment(
        loader=PackageLoader("study_app.cli.demo", "."), autoescape=True, undefined=StrictUndefined,
        trim_blocks=True, lstrip_blocks=True,
    )  # fmt: skip
    strip = filmstrip.read_strip_file(layout.trial)
    assert strip is not None
    labels = _labels(facts.protocol)
    sittings = find_sittings(layout.sessions, facts.protocol.study.name)
    rows = [_sitting_row(sitting) for sitting in sittings]
    rows.sort(key=lambda row: row["where"] == "virtual display")
    text = environment.get_template("page.html").render(
        facts=facts,
        labels=labels,
        steps=_steps(record, facts),
        photographs=_photographs(layout, facts.photographs),
        clip_rows=_clip_rows(layout, facts),
        strip=strip,
        shots=_shots(layout, strip, facts),
        seen=record.notes("window"),
        sittings=rows,
        late=[row for row in rows if row["missed"] > LATE_SHARE * row["shown"]],
        figures=_figures(layout),
        studies=_studies(layout),
        side_by_side=_side_by_side(layout, facts),
        gaze=_moving_gaze(layout),
        frames=facts.protocol.warped.clips.frames,
        out=os.path.relpath(layout.out),
        places=_places(layout),
    )
    write_whole(layout.page, page_bytes(text))


def _labels(protocol: StudyProtocol) -> dict[str, str]:
    entries = (*protocol.warped.scenes, *protocol.warped.sizes, *protocol.warped.methods)
    return {entry.name: entry.label or entry.name for entry in entries}


def _steps(record: Record, facts: Facts) -> list[dict[str, Any]]:
    protocol, clips = facts.protocol, facts.manifest.clips
    frames = sum(len(clip.frames_sha256) for clip in clips)
    virtual = facts.observers - facts.window
    told = [
        ("pictures", "Filled the holes of one photograph", "warp, push-pull, metameric"),
        (
            "clips",
            "Built the study's clips",
            f"{len(protocol.warped.scenes)} scenes x {len(protocol.warped.sizes)} sizes x"
            f" {len(protocol.warped.methods)} methods = {len(clips)} clips, {frames} frames",
        ),
        ("check", "Checked them", "every frame hashed again and compared with the manifest"),
        (
            "window",
            "Ran one simulated observer before a real window",
            "the real presenter, in real time",
        ),
        (
            "virtual",
            f"Ran {virtual} simulated observers on a virtual display",
            "the same session code on a clock that need not wait",
        ),
        ("report", "Analysed", "statistics, figures, tables and one page"),
        ("studies", "Showed other studies", "a moving gaze; a trial and a report of each study"),
    ]
    rows = [
        {"title": title, "text": text, "seconds": record.seconds(name)}
        for name, title, text in told
        if (name != "window" or facts.window) and (name != "studies" or record.seconds(name))
    ]
    longest = max(float(str(row["seconds"])) for row in rows) or 1.0
    return [{**row, "share": 100 * float(str(row["seconds"])) / longest} for row in rows]


def _photographs(layout: Layout, made: pictures.Photographs) -> list[dict[str, Any]]:
    told = (
        (pictures.WARPED, "Warped to the other eye", "what the left camera did not see, marked"),
        ("push-pull", "Push-pull", "smooth colour"),
        ("push-pull-depth", "Push-pull, guided by depth", "colour of the background alone"),
        ("metameric", "Metameric", "colour and texture of the background"),
        (pictures.TRUTH, "The truth", "the photograph taken there"),
    )
    (top, left), (height, width) = made.detail, pictures.DETAIL_PX
    rows = []
    for name, title, text in told:
        picture = _read(layout.pictures / f"{name}.png")
        detail = picture[top : top + height, left : left + width]
        large = np.repeat(np.repeat(detail, DETAIL_SCALE, 0), DETAIL_SCALE, 1)
        rows.append(
            {
                "title": title,
                "text": text,
                "quality": made.quality.get(name, ""),
                "file": f"pictures/{name}.png",
                "whole": _jpeg(picture),
                "detail": _png(large),
            }
        )
    return rows


def _clip_rows(layout: Layout, facts: Facts) -> list[dict[str, Any]]:
    """One row per scene and size: holes, then every method, at the frame with most holes."""
    methods = [method.name for method in facts.protocol.warped.methods]
    order = [name for name in methods if name != "reference"]
    order += [name for name in methods if name == "reference"]
    groups: dict[tuple[str, str], dict[str, Clip]] = {}
    for clip in facts.manifest.clips:
        groups.setdefault((clip.column("scene"), clip.column("size")), {})[
            clip.column("method")
        ] = clip
    last_size = facts.protocol.warped.sizes[-1].name
    rows = []
    for (scene, size), clips in groups.items():
        some = next(iter(clips.values()))
        folder = layout.clips / HOLES_FOLDER / survey_name(ClipName.of(some.condition))
        masks = [
            decode(folder / f"{index:06d}.png") > 0 for index in range(len(some.frames_sha256))
        ]
        index = int(np.argmax([mask.mean() for mask in masks]))
        frames = {
            name: _read(layout.clips / clips[name].frame_path(index))
            for name in order
            if name in clips
        }
        warped = frames.get("push-pull", next(iter(frames.values())))
        rows.append(
            {
                "scene": scene,
                "size": size,
                "hole_share": some.hole_share,
                "frame": index,
                "extent_m": float(str(some.parameters["extent_m"])),
                "holes": _jpeg(of_holes(warped.astype(np.float64) / 255, masks[index])),
                "frames": [
                    {
                        "method": name,
                        "still": _jpeg(frame),
                        "video": _video(layout, clips[name]) if size == last_size else "",
                    }
                    for name, frame in frames.items()
                ],
            }
        )
    return rows


def _video(layout: Layout, clip: Clip) -> str:
    path = preview_path(layout.clips, clip)
    if not path.is_file():
        return ""
    return "data:video/webm;base64," + base64.b64encode(path.read_bytes()).decode()


def _shots(layout: Layout, strip: filmstrip.Strip, facts: Facts) -> list[dict[str, Any]]:
    """Pictures of the strip: the middle of the screen, so that the clip can be seen."""
    width, height = facts.protocol.warped.size_px(facts.display)
    rows = []
    for shot in strip.shots:
        picture = _read(layout.trial / shot.file)
        # A little of the grey around the clip.
        around = 1.75 if shot.phase == "respond" else 1.25
        rows_px = min(picture.shape[0], round(around * height))
        columns_px = min(picture.shape[1], round(around * width))
        top, left = (picture.shape[0] - rows_px) // 2, (picture.shape[1] - columns_px) // 2
        cut = picture[top : top + rows_px, left : left + columns_px]
        rows.append(
            {
                "phase": PHASES[shot.phase],
                "t_s": shot.t_s,
                "flip": shot.flip,
                "frame": shot.frame[:8],
                "picture": _jpeg(_at_width(cut, SHOT_PX)),
                "file": f"trial/{shot.file}",
            }
        )
    return rows


def _sitting_row(sitting: Any) -> dict[str, Any]:
    start = sitting.journal.start
    now = standing(sitting.journal.events)
    return {
        "code": sitting.participant,
        "where": "virtual display" if start.timing_evidence == "virtual" else "real window",
        "evidence": start.timing_evidence,
        "decisions": sitting.main_done,
        "planned": start.trials,
        "attempts": now.attempts,
        "voids": ", ".join(f"{count} {reason}" for reason, count in now.voids),
        "missed": now.missed,
        "shown": now.shown,
        "simulated": start.simulated,
        "state": sitting.state,
    }


def _figures(layout: Layout) -> list[dict[str, str]]:
    told = (
        ("preference", "How often each method was chosen over another, with 95 % limits."),
        ("scale", "All methods on one scale of just-objectionable differences (JOD)."),
    )
    found = []
    for name, caption in told:
        path = layout.report / "figures" / f"{name}-2-column.svg"
        if path.is_file():
            data = base64.b64encode(path.read_bytes()).decode()
            found.append({"caption": caption, "data": f"data:image/svg+xml;base64,{data}"})
    return found


def _studies(layout: Layout) -> list[dict[str, str]]:
    """Return what was drawn of each study on foveated pictures, if any was."""
    found = []
    for name in studies.STUDIES:
        strip = layout.studies / name / studies.STRIP_NAME
        if strip.is_file():
            study = load_protocol(Path(name)).study
            found.append(
                {
                    "name": name,
                    "title": study.title,
                    "what": study.description,
                    "strip": _jpeg(_at_width(_read(strip), STRIP_PX)),
                    "report": f"studies/{name}/report/report.html",
                }
            )
    return found


def _side_by_side(layout: Layout, facts: Facts) -> str:
    """Return a trial of the task `two-alternative`, with clips of the last scene and size."""
    clips = {clip.column("method"): clip for clip in facts.manifest.clips}
    methods = [entry.name for entry in facts.protocol.warped.methods][-2:]
    stimuli = [_read(layout.clips / clips[name].frame_path(0)) for name in methods]
    made = studies.side_by_side(facts.protocol, facts.display, stimuli)
    return _jpeg(_at_width(made, STRIP_PX))


def _moving_gaze(layout: Layout) -> str:
    path = layout.studies / studies.GAZE_NAME
    if not path.is_file():
        return ""
    return "data:image/webp;base64," + base64.b64encode(path.read_bytes()).decode()


def _places(layout: Layout) -> list[tuple[str, str]]:
    told = (
        ("report/report.html", "the report: every test, figure and caution"),
        ("report/results.json", "every number of it"),
        ("report/tables/", "one row per attempt and per decision, with a data dictionary"),
        ("clips/contact-sheet.html", "all clips, any two side by side with a slider"),
        ("clips/manifest.json", "hash, seed and parameters of every frame"),
        ("sessions/", "the journals of all observers, from which everything else is derived"),
        ("trial/", "the pictures of the filmstrip, as the screen showed them"),
        ("studies/", "the studies on foveated pictures: journals, reports and a trial of each"),
        ("pictures/before-and-after.png", "the photograph and its fills on one sheet"),
        ("screen.toml", "the screen that the window was shown on, as a display file"),
    )
    return [(name, what) for name, what in told if (layout.out / name).exists()]


def _read(path: Path) -> NDArray[np.uint8]:
    with PillowImage.open(path) as image:
        return np.asarray(image.convert("RGB"))


def _at_width(picture: NDArray[np.uint8], width: int) -> NDArray[np.uint8]:
    if picture.shape[1] <= width:
        return picture
    height = round(picture.shape[0] * width / picture.shape[1])
    image = PillowImage.fromarray(picture)
    return np.asarray(image.resize((width, height), PillowImage.Resampling.LANCZOS))


def _jpeg(picture: NDArray[np.uint8]) -> str:
    buffer = io.BytesIO()
    PillowImage.fromarray(picture).save(
        buffer, "JPEG", quality=JPEG_QUALITY, subsampling=0, optimize=True
    )
    return "data:image/jpeg;base64," + base64.b64encode(buffer.getvalue()).decode()


def _png(picture: NDArray[np.uint8]) -> str:
    buffer = io.BytesIO()
    PillowImage.fromarray(picture).save(buffer, "PNG", optimize=True)
    return "data:image/png;base64," + base64.b64encode(buffer.getvalue()).decode()
