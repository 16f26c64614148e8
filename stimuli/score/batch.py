"""Subjects to score: the clips of a finished batch, or two clips or pictures."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from pipeline.errors import InputError
from protocols.errors import StudyError
from protocols.manifest import Clip, read_manifest
from protocols.outside import visible
from protocols.recipes.warped_clips import ClipName
from stimuli.batch.build import HOLES_FOLDER, survey_name
from stimuli.batch.check import is_true_view, true_views
from stimuli.media.frames_folder import frames_in
from stimuli.score.metrics import HOLES, Metric
from stimuli.score.pair import ScoredPair, read_colour


@dataclass(frozen=True)
class Subject:
    """One thing to score, and its place in the tables."""

    scene: str
    size: str
    method: str
    pair: ScoredPair

    @property
    def name(self) -> str:
        """Name of the clip's folder."""
        return self.pair.name


@dataclass(frozen=True)
class Subjects:
    """All that is scored together, in the order of the tables.

    Attributes
    ----------
    origin : mapping
        Where the clips come from: study, display, revision, manifest.
    notes : tuple of str
        What was left out, and why.
    labels : mapping
        What people read in place of names of methods, sizes and scenes. Files for programs keep
        the names.
    """

    items: tuple[Subject, ...]
    origin: dict[str, str]
    notes: tuple[str, ...]
    labels: Mapping[str, str] = field(default_factory=dict)

    def shown(self, name: str) -> str:
        """Return the words that people read for a name: its label where it has one."""
        return self.labels.get(name, name)

    def alike(self) -> dict[tuple[str, str], list[Subject]]:
        """Return the subjects of each scene and size, by these."""
        found: dict[tuple[str, str], list[Subject]] = {}
        for item in self.items:
            found.setdefault((item.scene, item.size), []).append(item)
        return found


def subjects_of_batch(folder: Path) -> Subjects:
    """Return every clip of a finished batch that has a reference.

    Raises
    ------
    StudyError
        If the folder holds no finished batch, no reference, or clips of other lengths or sizes
        than their reference.
    """
    manifest = read_manifest(folder)
    if manifest.simulated:
        raise StudyError(f"{folder}: must hold clips with pixels (this manifest is simulated)")
    if all(clip.hole_share is None for clip in manifest.clips):
        raise StudyError(
            f"{folder}: a batch is scored in the holes of warped clips (these were made from"
            " files); give two clips or pictures: metamerlab stimuli score TEST REFERENCE"
        )
    references = true_views(manifest)
    items, without = [], set()
    for clip in manifest.clips:
        if is_true_view(clip):
            continue
        truth = references.get((clip.column("scene"), clip.column("size")))
        if truth is None:
            without.add(f"{clip.column('scene')}, {clip.column('size')}")
            continue
        scene, size, method = (clip.column(column) for column in ("scene", "size", "method"))
        items.append(Subject(scene, size, method, _batch_pair(folder, clip, truth)))
    if not items:
        found = ", ".join(sorted({clip.column("method") for clip in manifest.clips}))
        raise StudyError(
            f"{folder}: clips must have a reference to be scored against (there are clips of"
            f" {found or 'nothing'}, and none whose scene and size has both a reference and"
            " another method); add a method 'reference' to the protocol and build again"
        )
    order = [clip.column("method") for clip in manifest.clips]
    items.sort(key=lambda item: order.index(item.method))
    notes = tuple(f"{name}: no reference clip, so nothing to score against"
                  for name in sorted(without))  # fmt: skip
    origin = {
        "folder": folder.name,
        "study": manifest.study,
        "display of the clips": manifest.display,
        "clips made by": manifest.revision,
        "renderer": f"{manifest.renderer.renderer}, {manifest.renderer.version}",
        "manifest": manifest.sha256,
    }
    return Subjects(tuple(items), origin, notes)


def subjects_of_two(test: Path, truth: Path, mask: Path | None, fps: float) -> Subjects:
    """Return one pair: two folders of frames, or two pictures.

    Raises
    ------
    StudyError
        If one is missing, they differ in kind, length or size, or a clip has one frame.
    """
    for path, what in ((test, "the clip or picture to score"), (truth, "the reference")):
        if not path.exists():
            raise StudyError(f"{path}: {what} must exist (there is no such file or folder)")
    if test.is_dir() != truth.is_dir():
        raise StudyError(
            f"{test} and {truth}: must both be folders of frames or both be pictures"
            f" (got a {'folder' if test.is_dir() else 'picture'} and a"
            f" {'folder' if truth.is_dir() else 'picture'})"
        )
    pictures = not test.is_dir()
    ours, theirs = ((test,), (truth,)) if pictures else (scored_frames(test), scored_frames(truth))
    masks: tuple[Path, ...] = ()
    if mask is not None:
        if not mask.exists():
            raise StudyError(f"{mask}: the mask must exist (there is no such file or folder)")
        masks = scored_frames(mask) if mask.is_dir() else (mask,)
    _check_lengths(test.name, len(ours), len(theirs), len(masks))
    if not pictures and len(ours) == 1:
        raise StudyError(
            f"{test}: a clip must have at least two frames (it has one); to compare pictures,"
            f" give the files: {ours[0]} {theirs[0]}"
        )
    width_px, height_px = _size(ours[0])
    name, rival = visible(test.name), visible(truth.name)  # nobody vouches for them
    pair = ScoredPair(name, ours, theirs, masks, width_px, height_px, 0.0 if pictures else fps)
    items = (Subject(rival, "", name, pair),)
    return Subjects(items, {"test": name, "reference": rival}, ())


def scored_frames(folder: Path) -> tuple[Path, ...]:
    """Return the frames of a folder; a batch with `exr` keeps both of each, and PNG counts."""
    found = frames_in(folder)
    if {".png", ".exr"} <= {path.suffix for path in found}:
        found = [path for path in found if path.suffix == ".png"]
    return tuple(found)


def check_subjects(subjects: Subjects, metrics: Sequence[Metric]) -> None:
    """Read every frame's size and refuse what the metrics cannot take.

    Raises
    ------
    StudyError
        Naming the frame, or the metrics and the least size that they need.
    """
    seen: dict[Path, tuple[int, int]] = {}
    for subject in subjects.items:
        pair = subject.pair
        for path in (*pair.test, *pair.truth):
            if path not in seen:
                seen[path] = _size(path)
            if seen[path] != (pair.width_px, pair.height_px):
                raise StudyError(
                    f"{path}: all frames must have one size, {pair.width_px} x"
                    f" {pair.height_px} px as {pair.test[0]} (got {seen[path][0]} x"
                    f" {seen[path][1]} px)"
                )
        small = min(pair.width_px, pair.height_px)
        too_small = [metric for metric in metrics if metric.least_px > small]
        if too_small:
            needs = ", ".join(f"{metric.name} {metric.least_px} px" for metric in too_small)
            fit = ",".join(metric.name for metric in metrics if metric not in too_small)
            raise StudyError(
                f"{subject.name}: frames of {pair.width_px} x {pair.height_px} px are too small"
                f" for some metrics (they need at least: {needs});"
                + (f" leave these out with --metrics {fit}" if fit else " give larger frames")
            )


def usable_regions(metric: Metric, pair: ScoredPair) -> tuple[str, ...]:
    """Return regions where a metric can measure a pair; none if it needs time and none is there."""
    if metric.over_time and pair.is_picture:
        return ()
    return tuple(region for region in metric.regions if region in pair.regions)


def _batch_pair(folder: Path, clip: Clip, truth: Clip) -> ScoredPair:
    name, frames = clip.name, len(clip.frames_sha256)
    _check_lengths(name, frames, len(truth.frames_sha256), 0)
    if frames == 1:
        raise StudyError(
            f"{folder / name}: a clip must have at least two frames (it has one); to compare"
            f" pictures, give the files: {folder / clip.frame_path(0)}"
            f" {folder / truth.frame_path(0)}"
        )
    sizes = [(entry.width_px, entry.height_px) for entry in (clip, truth)]
    if sizes[0] != sizes[1]:
        raise StudyError(
            f"{folder / name}: must have the size of its reference (got {sizes[0][0]} x"
            f" {sizes[0][1]} px, and {sizes[1][0]} x {sizes[1][1]} px); build again"
        )
    holes = folder / HOLES_FOLDER / survey_name(ClipName.of(clip.condition))
    test, true = (
        tuple(folder / entry.frame_path(k) for k in range(frames)) for entry in (clip, truth)
    )
    masks = tuple(holes / f"{k:06d}.png" for k in range(frames))
    for path in (*test, *true, *masks):
        if not path.is_file():
            raise StudyError(
                f"{path}: must be there, as the manifest says (it is missing); 'metamerlab"
                f" stimuli check {folder}' names all that is missing, 'stimuli build' makes it"
            )
    return ScoredPair(name, test, true, masks, clip.width_px, clip.height_px, clip.fps)


def _check_lengths(name: str, ours: int, theirs: int, masks: int) -> None:
    if ours != theirs:
        raise StudyError(
            f"{name}: must have as many frames as its reference (got {ours} and {theirs})"
        )
    if masks not in (0, 1, ours):
        raise StudyError(
            f"{name}: must have one {HOLES} mask, or one per frame (got {masks} masks and"
            f" {ours} frames)"
        )


def _size(path: Path) -> tuple[int, int]:
    """Width and height, from the file's head where it is a PNG."""
    if path.suffix.lower() == ".png":
        with path.open("rb") as file:
            head = file.read(24)
        if head[:8] == b"\x89PNG\r\n\x1a\n" and len(head) == 24:
            return int.from_bytes(head[16:20]), int.from_bytes(head[20:24])
        raise InputError(f"{path}: must be a whole PNG file (it is damaged or cut short)")
    height, width = read_colour(path).shape[:2]
    return width, height
