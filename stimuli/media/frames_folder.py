"""Folders of frames and of steps, and the reporter of work on files."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

from pipeline.errors import InputError
from pipeline.pictures.drawing import Picture, fitted, save_picture, sheet
from protocols.disk.result_folder import whole_folder

DrawnStep = tuple[str, str, Picture]  # file name without number and ending, label, picture


def save_steps(
    folder: Path, steps: Sequence[DrawnStep], size: tuple[int, int], columns: int | None = None
) -> list[Path]:
    """Write numbered pictures of every step into `folder`, and ``sheet.png`` of them all.

    Parameters
    ----------
    folder : Path
        New, empty, or with earlier steps, which are replaced; see `whole_folder`.
    size : tuple of int
        Height and width of every picture on the sheet: small ones are enlarged, large ones shrunk.
    columns : int, optional
        Of the sheet; by default about as many as rows.

    Returns
    -------
    list of Path
        What was written, the sheet last.
    """
    names, labelled = [], []
    with whole_folder(folder, replace=True) as work:
        for number, (name, label, picture) in enumerate(steps):
            names.append(f"{number:02d}-{name}.png")
            save_picture(work / names[-1], picture)
            labelled.append((f"{number:02d} {label}", fitted(picture, size)))
        names.append("sheet.png")
        save_picture(work / names[-1], sheet(labelled, columns))
    return [folder / name for name in names]


@dataclass(frozen=True)
class Reporter:
    """Callables that are told; left out, nobody is.

    Parameters
    ----------
    say : callable
        Called with what was decided and written, a line each.
    progress : callable
        Called with what is going on, how much of it is done, and of how much (0: not known).
    """

    say: Callable[[str], None] = lambda _: None
    progress: Callable[[str, int, int], None] = lambda *_: None

    def note(self, notes: Iterable[str]) -> None:
        """Say notes, a line each."""
        for one in notes:
            self.say(f"note: {one}")


SILENT = Reporter()
READ = (".png", ".jpg", ".jpeg", ".tif", ".tiff", ".exr", ".hdr", ".webp", ".bmp", ".avif")
_UNREAD = (".heic", ".heif")


def frames_in(folder: Path) -> list[Path]:
    """The pictures of a folder, in the order of their names; there is one at least.

    Raises
    ------
    InputError
        If there is none, or one that is known and cannot be read.
    """
    files = sorted(path for path in folder.iterdir() if not path.name.startswith("."))
    unread = [path for path in files if path.suffix.lower() in _UNREAD]
    if unread:
        raise InputError(
            f"{folder}: must hold no HEIC pictures, which are not read (has {len(unread)}, the"
            f" first is {unread[0].name}); save them as PNG or JPEG in another folder"
        )
    found = [path for path in files if path.suffix.lower() in READ]
    if not found:
        raise InputError(
            f"{folder}: must hold frames, such as 000000.png, 000001.png, ... (has none)"
        )
    return found
