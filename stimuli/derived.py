"""Previews and the contact sheet of a batch, made from its frames; they can be deleted."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path

from protocols.manifest import MANIFEST_NAME, Clip
from protocols.schema import ClipName
from stimuli.contact import SHEET_NAME, write_contact_sheet
from stimuli.orders import Orders
from stimuli.preview import PREVIEW_FOLDER, preview_path, write_preview


def derive(
    orders: Orders, out: Path, records: Mapping[ClipName, Clip], tell: Callable[[str], None]
) -> None:
    """Make what is missing, and remove previews of clips that are no more."""
    folder = out / PREVIEW_FOLDER
    wanted = set()
    if orders.protocol.clips.preview:
        folder.mkdir(exist_ok=True)
        for name in orders.clip_names:
            path = preview_path(out, records[name])
            wanted.add(path.name)
            if not path.exists():
                tell(f"preview of {name}")
                write_preview(out, records[name], path)
    if folder.exists():
        for entry in folder.iterdir():
            if entry.name not in wanted:
                entry.unlink()
        if not wanted:
            folder.rmdir()
    tell("contact sheet")
    manifest_path = out / MANIFEST_NAME
    if not manifest_path.exists() or not (out / SHEET_NAME).exists():
        clips = [records[name] for name in orders.clip_names]
        write_contact_sheet(out, orders.protocol, clips)
