"""One self-contained HTML page of all clips: thumbnails, and any two side by side."""

from __future__ import annotations

import base64
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from jinja2 import Environment, PackageLoader, StrictUndefined

from protocols.manifest import Clip
from protocols.schema import StudyProtocol
from stimuli.png import decode
from stimuli.whole_file import write_whole

SHEET_NAME = "contact-sheet.html"
SHOWN_FRAMES = 12
TILE_PX = 320


def write_contact_sheet(out: Path, protocol: StudyProtocol, clips: Sequence[Clip]) -> Path:
    """Write the page into `out`; it needs no other file."""
    first = clips[0]
    count = len(first.frames_sha256)
    shown = sorted({int(k) for k in np.linspace(0, count - 1, min(SHOWN_FRAMES, count))})
    scale = min(1.0, TILE_PX / first.width_px)
    tile = (max(1, round(scale * first.width_px)), max(1, round(scale * first.height_px)))
    labels = _labels(protocol)
    groups: dict[tuple[str, str], dict[str, Any]] = {}
    entries = []
    for index, clip in enumerate(clips):
        scene, size = labels["scene", clip.column("scene")], labels["size", clip.column("size")]
        method = labels["method", clip.column("method")]
        entries.append({"label": f"{scene}, {size}: {method}", "method": method})
        group = groups.setdefault(
            (clip.column("scene"), clip.column("size")),
            {
                "title": f"{scene}, {size}",
                "holes": f"{100 * (clip.hole_share or 0):.2f} %",
                "range": f"{100 * float(str(clip.parameters['hole_share_least'])):.2f} to"
                f" {100 * float(str(clip.parameters['hole_share_most'])):.2f} %",
                "path": clip.parameters["path"],
                "extent": f"{float(str(clip.parameters['extent_m'])):.4g} m",
                "members": [],
            },
        )
        group["members"].append(index)
    environment = Environment(
        loader=PackageLoader("stimuli", "."), autoescape=True, undefined=StrictUndefined
    )
    text = environment.get_template("contact.html").render(
        title=protocol.study.title,
        clips=entries,
        groups=list(groups.values()),
        columns=max(len(group["members"]) for group in groups.values()),
        frames=count,
        width=first.width_px,
        height=first.height_px,
        fps=f"{first.fps:g}",
        shown=shown,
        strips=[_strip(out, clip, shown, tile) for clip in clips],
        tile_width=tile[0],
        tile_height=tile[1],
    )
    path = out / SHEET_NAME
    write_whole(path, text.encode())
    return path


def _strip(out: Path, clip: Clip, shown: Sequence[int], tile: tuple[int, int]) -> str:
    """Small frames below each other, as a WebP in a data address: a third less than JPEG."""
    tiles = []
    for index in shown:
        frame = decode(out / clip.frame_path(index))
        if frame.dtype == np.uint16:
            frame = (frame >> 8).astype(np.uint8)
        tiles.append(cv2.resize(np.ascontiguousarray(frame), tile, interpolation=cv2.INTER_AREA))
    strip = np.concatenate(tiles)[..., ::-1]
    _, data = cv2.imencode(".webp", np.ascontiguousarray(strip), [cv2.IMWRITE_WEBP_QUALITY, 70])
    return "data:image/webp;base64," + base64.b64encode(bytes(data)).decode()


def _labels(protocol: StudyProtocol) -> dict[tuple[str, str], str]:
    labels = {("scene", entry.name): entry.label or entry.name for entry in protocol.warped.scenes}
    labels |= {("size", entry.name): entry.label or entry.name for entry in protocol.warped.sizes}
    labels |= {
        ("method", entry.name): entry.label or entry.name for entry in protocol.warped.methods
    }
    return labels
