"""Re-hash a finished batch and name what is missing, changed or extra, and faults over time.

Faults are flicker inside holes, repeated frames and black frames.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pipeline.errors import InputError
from protocols.disk.hashing import sha256_bytes, sha256_file
from protocols.errors import StudyError, did_you_mean
from protocols.manifest import MANIFEST_NAME, Clip, Manifest, read_manifest
from protocols.recipes.warped_clips import ClipName
from stimuli.batch.batch_folder import BUILD_FOLDER, HOLES_FOLDER, SURVEY_NAME, survey_name
from stimuli.batch.clip import read_mask
from stimuli.batch.contact import SHEET_NAME
from stimuli.media.png import decode_in_unit, decode_png
from stimuli.media.video import preview_path

_ENDS = ("least", "most")


@dataclass
class Verdict:
    """Result of a check; paths are relative to the folder."""

    manifest: Manifest
    missing: list[str] = field(default_factory=list)
    changed: list[str] = field(default_factory=list)
    extra: list[str] = field(default_factory=list)
    frames: int = 0

    @property
    def in_order(self) -> bool:
        """True if every file is as the manifest says."""
        return not (self.missing or self.changed or self.extra)


def check_batch(out: Path, report: Callable[[int, int], None] | None = None) -> Verdict:
    """Compare every file under `out` with the manifest.

    Frames are compared by their SHA-256, hole masks by one hash of all masks of a scene and
    size. Size and depth of a clip are compared with its first frame, hole shares with the masks.
    Previews and the contact sheet are made from the frames and only looked for.

    Raises
    ------
    StudyError
        If there is no manifest, or it is damaged.
    """
    manifest = read_manifest(out)
    verdict = Verdict(manifest)
    hashed: dict[str, str] = {}
    present: set[str] = {MANIFEST_NAME, SHEET_NAME}
    masks: dict[str, str] = {}
    for clip in manifest.clips:
        for index, sha in enumerate(clip.frames_sha256):
            hashed[clip.frame_path(index)] = sha
            if clip.parameters.get("exr"):
                present.add(clip.frame_path(index).removesuffix("png") + "exr")
        if clip.parameters.get("preview"):
            present.add(str(preview_path(out, clip).relative_to(out)))
        if "hole_masks_sha256" not in clip.parameters:
            continue  # nothing was warped
        name = survey_name(ClipName.of(clip.condition))
        masks[name] = str(clip.parameters.get("hole_masks_sha256"))
        frames = len(clip.frames_sha256)
        present |= {f"{HOLES_FOLDER}/{name}/{index:06d}.png" for index in range(frames)}
        present.add(f"{HOLES_FOLDER}/{name}/{SURVEY_NAME}")
    found = {
        str(path.relative_to(out))
        for path in out.rglob("*")
        if path.is_symlink() or not path.is_dir()
    }
    # What a build left that was killed after its manifest: the next one clears it away.
    found = {name for name in found if not name.startswith(f"{BUILD_FOLDER}/")}
    verdict.missing = sorted((hashed.keys() | present) - found)
    verdict.extra = sorted(found - hashed.keys() - present)
    links = {name for name in found - set(verdict.extra) if (out / name).is_symlink()}
    verdict.changed = [f"{name} (a symbolic link in its place)" for name in sorted(links)]
    names = sorted(hashed.keys() & found - links)
    with ThreadPoolExecutor(2) as pool:
        for done, (name, sha) in enumerate(
            zip(names, pool.map(lambda n: sha256_file(out / n), names), strict=True), start=1
        ):
            if sha != hashed[name]:
                verdict.changed.append(name)
            if report is not None:
                report(done, len(names))
    verdict.frames = len(names)
    whole = _whole_masks(out, masks, verdict)
    _check_statements(out, whole, verdict)
    return verdict


def _whole_masks(out: Path, masks: Mapping[str, str], verdict: Verdict) -> set[str]:
    """Return the surveys whose masks are there as their hash says; note those that are not."""
    whole = set()
    for name, wanted in sorted(masks.items()):
        files = sorted((out / HOLES_FOLDER / name).glob("*.png"))
        joined = "".join(sha256_file(path) for path in files)
        if any(m.startswith(f"{HOLES_FOLDER}/{name}/") for m in verdict.missing):
            continue
        if sha256_bytes(joined.encode()) == wanted:
            whole.add(name)
        else:
            verdict.changed.append(f"{HOLES_FOLDER}/{name} (one or more of its masks)")
    return whole


def _check_statements(out: Path, masks: Collection[str], verdict: Verdict) -> None:
    """Compare what the manifest says of clips with their first frames, and with whole masks."""
    damaged = {*verdict.missing, *verdict.changed}
    shares: dict[str, tuple[float, float, float]] = {}
    for clip in verdict.manifest.clips:
        if clip.frame_path(0) not in damaged and (said := _wrong_frame(out, clip)):
            verdict.changed.append(f"{MANIFEST_NAME} ({clip.name}: {said})")
        name = survey_name(ClipName.of(clip.condition)) if masks else ""
        if name in masks and "hole_masks_sha256" in clip.parameters:
            if name not in shares:
                shares[name] = _hole_shares(out / HOLES_FOLDER / name)
            stated = (
                clip.hole_share, *(clip.parameters.get(f"hole_share_{end}") for end in _ENDS),
            )  # fmt: skip
            if stated != shares[name]:
                verdict.changed.append(
                    f"{MANIFEST_NAME} ({clip.name}: hole_share must be {shares[name][0]:g},"
                    f" {shares[name][1]:g} to {shares[name][2]:g}, as its masks have it; it says"
                    f" {', '.join(map(str, stated))})"
                )


def _wrong_frame(out: Path, clip: Clip) -> str | None:
    """Return the statement of the manifest that a clip's first frame contradicts."""
    try:
        frame = decode_png(out / clip.frame_path(0))
    except InputError:
        return "its first frame must be a PNG"
    found = frame.shape[1], frame.shape[0], 8 * frame.dtype.itemsize
    stated = clip.width_px, clip.height_px, clip.bit_depth
    if found == stated:
        return None
    return "its first frame has {} x {} px of {} bits; it says {} x {} of {}".format(
        *found, *stated
    )


def _hole_shares(folder: Path) -> tuple[float, float, float]:
    """Return the mean, least and most share of hole pixels, as a survey writes them."""
    shares = [float((decode_png(path) > 0).mean()) for path in sorted(folder.glob("*.png"))]
    mean = float(np.mean(shares))
    return float(f"{mean:.6g}"), float(f"{min(shares):.6g}"), float(f"{max(shares):.6g}")


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


def is_true_view(clip: Clip) -> bool:
    """True if a clip shows what others are compared with."""
    return clip.parameters.get("method") == "reference"


def true_views(manifest: Manifest) -> dict[tuple[str, str], Clip]:
    """Return the clips of the true views, by scene and size."""
    shown = filter(is_true_view, manifest.clips)
    return {(clip.column("scene"), clip.column("size")): clip for clip in shown}


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
    references = true_views(manifest)
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
    return decode_in_unit(out / clip.frame_path(index))
