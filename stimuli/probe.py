"""Faults of a finished clip over time: flicker inside holes, repeated frames, black frames."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from protocols.errors import StudyError, did_you_mean
from protocols.manifest import Clip, read_manifest
from protocols.recipes.warped_clips import ClipName
from stimuli.batch_folder import HOLES_FOLDER, survey_name
from stimuli.clip import read_mask
from stimuli.media.png import decode

BLACK = 2 / 255  # mean above which a frame is not black
FLICKERS = 2.0  # of the reference's change: a fill that changes more than this is pointed out


@dataclass(frozen=True)
class ClipFault:
    """Findings about one clip.

    Attributes
    ----------
    flicker : float or None
        Mean absolute change from frame to frame of what is a hole in both, in [0, 1]; None
        where no hole stays for two frames.
    flicker_ratio : float or None
        `flicker` over that of the reference in the same holes; None without a reference.
    repeated : list of int
        Frames that equal the one before in every pixel, although holes moved between them, or
        nothing was warped.
    black : list of int
        Frames that are black.
    """

    name: str
    flicker: float | None
    flicker_ratio: float | None
    repeated: list[int]
    black: list[int]

    @property
    def flickers(self) -> bool:
        """True if the holes change far more than the truth does."""
        return self.flicker_ratio is not None and self.flicker_ratio > FLICKERS


def probe_batch(
    out: Path,
    names: Sequence[str] | None = None,
    report: Callable[[int, int], None] | None = None,
) -> list[ClipFault]:
    """Probe the clips called `names`, or all.

    Raises
    ------
    StudyError
        If the folder holds no finished batch, or there is no such clip.
    """
    manifest = read_manifest(out)
    clips = {clip.name: clip for clip in manifest.clips}
    for name in names or []:
        if name not in clips:
            raise StudyError(f"{out}: must hold a clip {name!r}{did_you_mean(name, list(clips))}")
    wanted = [clips[name] for name in names or clips]
    references = {
        (clip.column("scene"), clip.column("size")): clip
        for clip in manifest.clips
        if clip.parameters.get("method") == "reference"
    }
    findings = []
    for done, clip in enumerate(wanted, start=1):
        truth = references.get((clip.column("scene"), clip.column("size")))
        findings.append(_probe(out, clip, truth))
        if report is not None:
            report(done, len(wanted))
    return findings


def _probe(out: Path, clip: Clip, truth: Clip | None) -> ClipFault:
    warped = "hole_masks_sha256" in clip.parameters
    masks = out / HOLES_FOLDER / survey_name(ClipName.of(clip.condition)) if warped else None
    changes, true_changes, repeated, black = [], [], [], []
    last: tuple[NDArray[np.float32], NDArray[np.bool_] | None] | None = None
    last_true: NDArray[np.float32] | None = None
    for index in range(len(clip.frames_sha256)):
        frame = _frame(out, clip, index)
        mask = None if masks is None else read_mask(masks, index)
        # Rescaled clips differ in size.
        usable = mask if mask is not None and mask.shape == frame.shape[:2] else None
        if float(frame.mean()) < BLACK:
            black.append(index)
        # The pixels, not the manifest's hashes: those say what was built.
        same = last is not None and np.array_equal(frame, last[0])
        if same and (masks is None or (read_mask(masks, index - 1) != mask).any()):
            repeated.append(index)
        true = None
        if truth is not None and truth is not clip and usable is not None:
            true = _frame(out, truth, index)
        if last is not None and usable is not None and last[1] is not None:
            both = usable & last[1]
            if both.any():
                changes.append(float(np.abs(frame[both] - last[0][both]).mean()))
                if true is not None and last_true is not None:
                    true_changes.append(float(np.abs(true[both] - last_true[both]).mean()))
        last, last_true = (frame, usable), true
    flicker = float(np.mean(changes)) if changes else None
    ratio = None
    if flicker is not None and true_changes and np.mean(true_changes) > 0:
        ratio = flicker / float(np.mean(true_changes))
    return ClipFault(clip.name, flicker, ratio, repeated, black)


def _frame(out: Path, clip: Clip, index: int) -> NDArray[np.float32]:
    stored = decode(out / clip.frame_path(index))
    return (stored / np.float32(np.iinfo(stored.dtype).max)).astype(np.float32)
