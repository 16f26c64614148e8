"""Stimuli as browsers fetch them: each as PNG or lossless WebP, and what a scene's share once.

Stimuli of a scene are often alike: a ring on the same picture, two halves of the same two pictures.
Where that saves something, frames are cut into square pieces, and each piece is written once: into
the pack of the stimulus that has it, or of the scene where several do.
"""

from __future__ import annotations

import io
import os
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from itertools import accumulate
from pathlib import Path
from typing import TypeVar

import numpy as np
from PIL import Image, features

from protocols.browser.web_study import PIECE_PX, Pack
from protocols.disk.hashing import sha256_bytes
from protocols.errors import StudyError
from protocols.manifest import Clip
from protocols.recipes.base import SCENE
from study_app.clips import frame_bytes
from study_app.paint import PixelBytes

_COLOUR_CHUNKS = ("cHRM", "cICP", "gAMA", "iCCP", "sRGB")
T = TypeVar("T")
_WORTH = 0.9
"""Share of the pieces that differ, below which frames are cut."""


@dataclass
class Packs:
    """Packs of a study, by the names of stimuli and of what scenes share."""

    stimuli: dict[str, Pack] = field(default_factory=dict)
    shared: dict[str, Pack] = field(default_factory=dict)

    def bytes_of(self, name: str) -> Mapping[str, int]:
        """Return the sizes of the files that a stimulus takes, by name."""
        packs = [self.stimuli[name], *(self.shared[one] for one in self.stimuli[name].shared)]
        return {pack.file: pack.bytes for pack in packs}


def write_packs(
    stimuli: Path, clips: Sequence[Clip], names: Mapping[str, str], folder: Path
) -> Packs:
    """Write the packs of all stimuli.

    Parameters
    ----------
    stimuli : Path
        Folder of the manifest.
    clips : sequence of Clip
        Those to write.
    names : mapping
        Names in the export, by those in the manifest.
    folder : Path
        Where the files go.

    Raises
    ------
    StudyError
        If a frame is not the one that was hashed, or asks a browser for other colours.
    """
    scenes: dict[str, list[Clip]] = {}
    for clip in clips:
        scenes.setdefault(str(clip.condition.get(SCENE, "")), []).append(clip)
    packs = Packs()
    for alike in scenes.values():
        _write_scene(stimuli, alike, names, folder, packs)
    return packs


def _write_scene(
    stimuli: Path, clips: Sequence[Clip], names: Mapping[str, str], folder: Path, packs: Packs
) -> None:
    """Write the stimuli of a scene: whole frames, or pieces of which each is written once."""
    where: dict[str, set[str]] = {}
    cut: dict[str, list[list[str]]] = {}
    for clip in clips:
        frames = [_pixels(_checked(stimuli, clip, n)) for n in range(len(clip.frames_sha256))]
        cut[clip.name] = [
            [sha256_bytes(piece.tobytes()) for piece in pieces_of(pixels)]
            for pixels in frames
            if pixels is not None
        ]
        for key in (key for frame in cut[clip.name] for key in frame):
            where.setdefault(key, set()).add(clip.name)
    count = sum(len(frame) for frames in cut.values() for frame in frames)
    whole = any(len(cut[c.name]) < len(c.frames_sha256) for c in clips)
    if whole or len(where) > _WORTH * count:
        for clip in clips:
            png = [_checked(stimuli, clip, n) for n in range(len(clip.frames_sha256))]
            packs.stimuli[names[clip.name]] = _write(folder, names[clip.name], _each(coded, png))
        return
    shared = {key: at for at, key in enumerate(key for key in where if len(where[key]) > 1)}
    scene = sha256_bytes("".join(shared).encode())[:16]
    several: dict[str, PixelBytes] = {}
    for clip in clips:
        own: dict[str, PixelBytes] = {}
        for n, keys in enumerate(cut[clip.name]):
            pixels = _pixels(_checked(stimuli, clip, n))
            for key, piece in zip(keys, () if pixels is None else pieces_of(pixels), strict=True):
                (several if key in shared else own).setdefault(key, piece)
        at = shared | {key: len(shared) + place for place, key in enumerate(own)}
        pack = _write(folder, names[clip.name], _each(_webp, list(own.values())))
        packs.stimuli[names[clip.name]] = pack.model_copy(
            update={
                "shared": (scene,) if shared else (),
                "frames": tuple(tuple(at[key] for key in frame) for frame in cut[clip.name]),
            }
        )
    if shared:
        ordered = [several[key] for key in shared]
        packs.shared[scene] = _write(folder, scene, _each(_webp, ordered))


def pieces_of(pixels: PixelBytes) -> list[PixelBytes]:
    """Return the square pieces of a frame, row by row; those at the edges are smaller."""
    height, width, _ = pixels.shape
    return [
        np.ascontiguousarray(pixels[top : top + PIECE_PX, left : left + PIECE_PX])
        for top in range(0, height, PIECE_PX)
        for left in range(0, width, PIECE_PX)
    ]


def coded(png: bytes) -> bytes:
    """Return a picture as lossless WebP, where that is smaller and gives the same codes."""
    pixels = _pixels(png)
    webp = png if pixels is None else _webp(pixels)
    return webp if len(webp) < len(png) else png


def _webp(pixels: PixelBytes) -> bytes:
    """Return pixels as lossless WebP, decoded again to be sure."""
    file = io.BytesIO()
    # More effort takes three times as long for 5 % of the bytes.
    Image.fromarray(pixels).save(file, "WEBP", lossless=True, method=2, quality=20, exact=True)
    with Image.open(file) as again:
        if not np.array_equal(np.asarray(again.convert("RGB")), pixels):
            raise AssertionError("lossless WebP must give the same codes again")
    return file.getvalue()


def _pixels(png: bytes) -> PixelBytes | None:
    """Return the codes of a picture without alpha; None where it has it, or Pillow has no WebP."""
    with Image.open(io.BytesIO(png)) as picture:
        if picture.mode not in ("RGB", "L") or not features.check("webp"):
            return None
        return np.asarray(picture.convert("RGB"))


def _each(code: Callable[[T], bytes], given: Sequence[T]) -> list[bytes]:
    """Return the coded pieces, made on all processors: Pillow's coders let other threads run."""
    with ThreadPoolExecutor(os.cpu_count()) as threads:
        return list(threads.map(code, given))


def _write(folder: Path, name: str, pieces: Sequence[bytes]) -> Pack:
    (folder / f"{name}.pack").write_bytes(b"".join(pieces))
    ends = tuple(accumulate(map(len, pieces)))
    return Pack(
        file=f"{name}.pack",
        bytes=ends[-1] if ends else 0,
        sha256=tuple(map(sha256_bytes, pieces)),
        ends=ends,
    )


def _checked(stimuli: Path, clip: Clip, index: int) -> bytes:
    data = frame_bytes(stimuli, clip, index)
    if chunks := colour_chunks(data):
        raise StudyError(
            f"{stimuli / clip.frame_path(index)}: must hold no colour chunk (has"
            f" {', '.join(chunks)}): some browsers show other codes then than those that were"
            " hashed; build the stimuli with 'metamerlab stimuli build', which writes none"
        )
    return data


def colour_chunks(png: bytes) -> list[str]:
    """Return the names of chunks that say how a PNG's codes are meant; they precede its pixels."""
    found, at = [], 8
    while png[at + 4 : at + 8] not in (b"IDAT", b""):
        found += [name for name in _COLOUR_CHUNKS if png[at + 4 : at + 8] == name.encode()]
        at += 12 + int.from_bytes(png[at : at + 4], "big")
    return found
