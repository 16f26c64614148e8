"""What is made from a batch's frames and can be deleted: old previews go, the contact sheet."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

from protocols.manifest import MANIFEST_NAME, Clip
from protocols.schema import StudyProtocol
from stimuli.batch_folder import remove_previews
from stimuli.contact import SHEET_NAME, write_contact_sheet
from stimuli.preview import preview_path


def derive(
    protocol: StudyProtocol,
    out: Path,
    clips: Sequence[Clip],
    tell: Callable[[str], None],
    *,
    previews: bool,
) -> None:
    """Remove previews of clips that are no more, and write the contact sheet."""
    remove_previews(out, {preview_path(out, clip).name for clip in clips} if previews else ())
    tell("contact sheet")
    if not (out / MANIFEST_NAME).exists() or not (out / SHEET_NAME).exists():
        write_contact_sheet(out, protocol, clips)
