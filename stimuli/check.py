"""Re-hash a finished batch and name everything that is missing, changed or extra."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from pathlib import Path

from protocols.hashing import sha256_bytes, sha256_file
from protocols.manifest import MANIFEST_NAME, Manifest, read_manifest
from protocols.recipes.warped_clips import ClipName
from stimuli.batch_folder import BUILD_FOLDER, HOLES_FOLDER, survey_name
from stimuli.clip import SURVEY_NAME
from stimuli.contact import SHEET_NAME
from stimuli.preview import preview_path


@dataclass
class Verdict:
    """What a check found; paths are relative to the folder."""

    manifest: Manifest
    missing: list[str] = field(default_factory=list)
    changed: list[str] = field(default_factory=list)
    extra: list[str] = field(default_factory=list)
    frames: int = 0

    @property
    def in_order(self) -> bool:
        """Whether every file is as the manifest says."""
        return not (self.missing or self.changed or self.extra)


def check_batch(out: Path, report: Callable[[int, int], None] | None = None) -> Verdict:
    """Compare every file under `out` with the manifest.

    Frames are compared by their SHA-256, hole masks by one hash of all masks of a scene and
    size. Previews and the contact sheet are made from the frames and only looked for.

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
    for name, wanted in sorted(masks.items()):
        folder = out / HOLES_FOLDER / name
        files = sorted(folder.glob("*.png"))
        joined = "".join(sha256_file(path) for path in files)
        complete = not any(m.startswith(f"{HOLES_FOLDER}/{name}/") for m in verdict.missing)
        if complete and sha256_bytes(joined.encode()) != wanted:
            verdict.changed.append(f"{HOLES_FOLDER}/{name} (one or more of its masks)")
    return verdict
