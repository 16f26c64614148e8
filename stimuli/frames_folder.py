"""A folder that a command fills with the frames of one clip."""

from pathlib import Path

from pipeline.errors import InputError


def make_frames_folder(out: Path) -> None:
    """Make the folder.

    Raises
    ------
    InputError
        If it is a file, or holds anything: old frames among new ones look like one clip.
    """
    if out.exists() and not out.is_dir():
        raise InputError(f"{out}: must be a folder, as the frames lie in one (it is a file)")
    out.mkdir(parents=True, exist_ok=True)
    held = min(out.iterdir(), default=None)
    if held is not None:
        raise InputError(
            f"{out}: must be empty or new, as it is to hold the frames of one clip (it holds"
            f" {held.name}); choose another folder, or empty it"
        )
