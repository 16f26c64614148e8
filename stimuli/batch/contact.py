"""One self-contained HTML page of all clips: thumbnails, and any two side by side."""

from __future__ import annotations

import base64
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from protocols.blocks import html_page
from protocols.disk.whole_file import write_whole
from protocols.manifest import Clip
from protocols.outside import page_bytes
from protocols.recipes.base import SCENE
from protocols.recipes.warped_clips import WarpedClips
from protocols.study_file.schema import StudyProtocol
from stimuli.media.png import decode_in_8_bits

SHEET_NAME = "contact-sheet.html"
SHOWN_FRAMES = 12
TILE_PX = 320
COLUMNS = 8


def write_contact_sheet(out: Path, study: StudyProtocol, clips: Sequence[Clip]) -> Path:
    """Write the page into `out`; it needs no other file."""
    first = clips[0]
    count = len(first.frames_sha256)
    shown = sorted({int(k) for k in np.linspace(0, count - 1, min(SHOWN_FRAMES, count))})
    scale = min(1.0, TILE_PX / first.width_px)
    tile = (max(1, round(scale * first.width_px)), max(1, round(scale * first.height_px)))
    groups: dict[str, dict[str, Any]] = {}
    entries = []
    for index, clip in enumerate(clips):
        title, caption, facts = _described(study, clip)
        label = f"{title}: {caption}" if title else caption
        entries.append({"label": label, "method": caption, "folder": clip.name})
        group = groups.setdefault(title, {"title": title, "facts": facts, "members": []})
        group["members"].append(index)
    size = f"{first.width_px} x {first.height_px} px"
    counted, small = (
        (f"{len(clips)} stills, {size}.", "made small")
        if count == 1
        else (
            f"{len(clips)} clips of {count} frames, {size} at {first.fps:g} frames a second.",
            f"{len(shown)} of the frames, made small",
        )
    )
    text = html_page(
        f"{study.study.title}: clips",
        "stimuli/batch/contact.html",
        heading=study.study.title,
        under=f"{counted} Shown here: {small}; what participants see are the PNG files.",
        clips=entries,
        groups=list(groups.values()),
        columns=min(COLUMNS, max(len(group["members"]) for group in groups.values())),
        frames=count,
        fps=f"{first.fps:g}",
        shown=shown,
        strips=[_strip(out, clip, shown, tile) for clip in clips],
        tile_width=tile[0],
        tile_height=tile[1],
    )
    path = out / SHEET_NAME
    write_whole(path, page_bytes(text))
    return path


def _strip(out: Path, clip: Clip, shown: Sequence[int], tile: tuple[int, int]) -> str:
    """Small frames below each other, as a WebP in a data address: a third less than JPEG."""
    tiles = []
    for index in shown:
        frame = decode_in_8_bits(out / clip.frame_path(index))
        tiles.append(cv2.resize(frame, tile, interpolation=cv2.INTER_AREA))
    strip = np.concatenate(tiles)[..., ::-1]
    _, data = cv2.imencode(".webp", np.ascontiguousarray(strip), [cv2.IMWRITE_WEBP_QUALITY, 70])
    return "data:image/webp;base64," + base64.b64encode(bytes(data)).decode()


def _described(study: StudyProtocol, clip: Clip) -> tuple[str, str, str]:
    """Return the group that a clip stands in, its caption there, and what holds for the group."""
    recipe = study.stimuli
    if not isinstance(recipe, WarpedClips):
        rest = [f"{name} {value}" for name, value in clip.condition.items() if name != SCENE]
        return clip.column(SCENE), ", ".join(rest) or clip.name, ""
    scene, size, method = (
        next(e.label or e.name for e in entries if e.name == clip.column(column))
        for column, entries in (
            ("scene", recipe.scenes),
            ("size", recipe.sizes),
            ("method", recipe.methods),
        )
    )
    least, most = (
        100 * float(str(clip.parameters[f"hole_share_{end}"])) for end in ("least", "most")
    )
    facts = (
        f"holes {100 * (clip.hole_share or 0):.2f} % of the frame on average ({least:.2f} to"
        f" {most:.2f} %); path {clip.parameters['path']}, extent"
        f" {extent_text(clip)}"
    )
    return f"{scene}, {size}", method, facts


def extent_text(clip: Clip) -> str:
    """Return the extent of a clip's path as people read it."""
    extent_m = float(str(clip.parameters["extent_m"]))
    return f"{extent_m:.4g} m" if extent_m else "own motion"
