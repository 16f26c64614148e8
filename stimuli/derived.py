"""What is made from a batch's frames and can be deleted: old previews go, the contact sheet."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path

from protocols.manifest import MANIFEST_NAME, Clip
from protocols.recipes.warped_clips import ClipName
from stimuli.contact import SHEET_NAME, write_contact_sheet
from stimuli.orders import Orders
from stimuli.preview import PREVIEW_FOLDER, preview_path


def derive(
    orders: Orders, out: Path, records: Mapping[ClipName, Clip], tell: Callable[[str], None]
) -> None:
    """Remove previews of clips that are no more, and write the contact sheet."""
    folder = out / PREVIEW_FOLDER
    if folder.exists():
        wanted = set()
        if orders.protocol.warped.clips.preview:
            wanted = {preview_path(out, record).name for record in records.values()}
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
