"""A batch: every clip of a study in one folder, resumable, in parallel, manifest last.

While it runs, unfinished work lies in ``.build``, named by its hash:

- ``.build/surveys/HASH/``: hole masks, and ``survey.json`` when they are complete
- ``.build/clips/HASH/``: frames of a clip
- ``.build/records/NAME.json``: the manifest's entry of a clip that is complete

A clip's folder is moved to its name when it is complete, the manifest is written when all
are, and ``.build`` is removed after that. So whatever is found after a kill is either whole
or in ``.build``, and the same command goes on from there.
"""

from __future__ import annotations

import fcntl
import json
import os
import platform
import shutil
from collections.abc import Callable, Iterator
from concurrent.futures import FIRST_COMPLETED, Executor, Future, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from dataclasses import asdict, dataclass, field
from importlib import metadata
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from protocols.errors import StudyError
from protocols.hashing import sha256_file
from protocols.manifest import MANIFEST_NAME, Clip, Manifest, read_manifest, write_manifest
from protocols.manifest import Renderer as RendererEntry
from protocols.revision import code_revision, package_version
from protocols.schema import ClipName
from protocols.units import Scalar
from stimuli.clip import Survey, read_survey
from stimuli.contact import SHEET_NAME, write_contact_sheet
from stimuli.executors import LocalProcesses
from stimuli.orders import Orders
from stimuli.png import write_whole
from stimuli.preview import PREVIEW_FOLDER, preview_path, write_preview
from stimuli.worker import RendererInfo, clip_job, describe_renderer, survey_job

BUILD_FOLDER = ".build"
HOLES_FOLDER = "holes"
VERSIONED = (
    "moderngl", "numpy", "scipy", "scikit-image", "opencv-python-headless", "OpenImageIO",
    "pillow", "trimesh",
)  # fmt: skip
POLL_S = 0.25

Report = Callable[[int, int, str], None]
"""Called with frames done, frames in all, and what is going on."""


@dataclass
class Outcome:
    """What a build did."""

    manifest: Manifest
    built: list[ClipName] = field(default_factory=list)
    kept: list[ClipName] = field(default_factory=list)


def survey_name(clip: ClipName) -> str:
    """Return the folder of a scene's hole masks at a size, ``scene__size``."""
    return f"{clip.scene}__{clip.size}"


def build(
    orders: Orders,
    out: Path,
    executor: Executor,
    *,
    parallel: int = 1,
    report: Report | None = None,
) -> Outcome:
    """Build what is missing of a study's clips in `out`, then write the manifest.

    Parameters
    ----------
    executor : Executor
        Of local processes or a Dask cluster; `parallel` is how many jobs it runs at once.

    Raises
    ------
    StudyError
        If another build works in the folder, it holds other things, a worker died, or the
        workers draw with different renderers.
    InputError, OSError
        As scenes, methods and the disk raise them. What was finished stays for the next run;
        there is no manifest then.
    """
    out.mkdir(parents=True, exist_ok=True)
    with _only_build(out):
        return _Batch(orders, out, executor, parallel, report or (lambda *_: None)).run()


class _Batch:
    def __init__(
        self, orders: Orders, out: Path, executor: Executor, parallel: int, report: Report
    ) -> None:
        self.orders, self.out, self.executor, self.report = orders, out, executor, report
        self.parallel = parallel
        self.work = out / BUILD_FOLDER
        self.records: dict[ClipName, Clip] = {}
        self.running: dict[Future[Any], tuple[str, ClipName]] = {}
        self.active: dict[ClipName, Path] = {}
        self.surveys: dict[str, Survey] = {}

    def run(self) -> Outcome:
        orders = self.orders
        self._check_folder()
        try:
            self.renderer = self.executor.submit(describe_renderer).result()
        except BrokenProcessPool:
            raise _worker_died() from None
        old = self._old_records()
        missing = []
        for name in orders.clip_names:
            if self._is_done(name, old.get(name)):
                self.records[name] = old[name]
            else:
                missing.append(name)
        kept = list(self.records)
        manifest_path = self.out / MANIFEST_NAME
        if missing or self._is_stale(manifest_path):
            self._keep_records()
            manifest_path.unlink(missing_ok=True)  # from here on nothing looks finished
            _sync(self.out)
        self._make(missing)
        self._remove_strangers()
        self._derive()
        manifest = self._manifest()
        if not manifest_path.exists():
            write_manifest(self.out, manifest)
            _sync(self.out)
        shutil.rmtree(self.work, ignore_errors=True)
        return Outcome(manifest, missing, kept)

    # What is there already

    def _check_folder(self) -> None:
        """Refuse a folder with things that no build made: they would be deleted."""
        known = {BUILD_FOLDER, MANIFEST_NAME, MANIFEST_NAME + ".part", HOLES_FOLDER,
                 PREVIEW_FOLDER, SHEET_NAME}  # fmt: skip
        ours = (self.out / MANIFEST_NAME).exists() or self.work.exists()
        for entry in sorted(self.out.iterdir()):
            if entry.name in known or (ours and entry.is_dir() and entry.name.count("__") == 2):
                continue
            raise StudyError(
                f"{self.out}: must be an empty folder or one that a build made (it holds"
                f" {entry.name}); choose another --out, or move that file away"
            )

    def _old_records(self) -> dict[ClipName, Clip]:
        records: dict[ClipName, Clip] = {}
        try:
            manifest = read_manifest(self.out)
            old = manifest.renderer
            if RendererInfo(old.vendor, old.renderer, old.version) == self.renderer:
                records = {clip.clip_name: clip for clip in manifest.clips}
        except StudyError:
            pass
        for path in (self.work / "records").glob("*.json"):
            try:
                raw = json.loads(path.read_bytes())
                clip = Clip.model_validate_json(json.dumps(raw["clip"]))
            except (ValueError, KeyError, ValidationError):
                continue
            if raw["renderer"] == asdict(self.renderer):
                records[clip.clip_name] = clip
        return records

    def _is_done(self, name: ClipName, record: Clip | None) -> bool:
        """Whether `name` is there whole, made from what is wanted now."""
        if record is None or record.cache_key != self.orders.clip_key(name):
            return False
        masks = self.out / HOLES_FOLDER / survey_name(name)
        if read_survey(masks, self.orders.survey_key(name)) is None:
            return False
        folder = self.out / str(name)
        endings = (".png", ".exr") if self.orders.protocol.clips.exr else (".png",)
        frames = range(len(record.frames_sha256))
        wanted = {f"{index:06d}{ending}" for index in frames for ending in endings}
        try:
            if {entry.name for entry in folder.iterdir()} != wanted:
                return False
            return all(
                sha256_file(folder / f"{index:06d}.png") == sha
                for index, sha in enumerate(record.frames_sha256)
            )
        except OSError:
            return False

    def _is_stale(self, manifest_path: Path) -> bool:
        if not manifest_path.exists():
            return True
        # Not for the revision: it says who made the clips, and sittings cite the manifest's hash.
        made_by = {"revision": "", "versions": {}}
        try:
            old = read_manifest(self.out).model_copy(update=made_by)
        except StudyError:
            return True
        return old != self._manifest().model_copy(update=made_by)

    # Making what is missing

    def _make(self, missing: list[ClipName]) -> None:
        """Survey, then make clips, a few jobs ahead of the workers, scenes together.

        A worker keeps the scene that it opened last, so what belongs to the first scene comes
        before what belongs to the second.
        """
        self._total = len(self.orders.clip_names) * self.orders.protocol.clips.frames
        self._rank = {name: rank for rank, name in enumerate(self.orders.clip_names)}
        groups: dict[str, list[ClipName]] = {}
        for name in missing:
            groups.setdefault(survey_name(name), []).append(name)
        ready = [("survey", names[0]) for names in groups.values()]
        try:
            while ready or self.running:
                while ready and len(self.running) < self.parallel + 1:
                    ready.sort(key=self._order)
                    self._submit(*ready.pop(0))
                done, _ = wait(self.running, timeout=POLL_S, return_when=FIRST_COMPLETED)
                for future in done:
                    kind, name = self.running.pop(future)
                    result, renderer = future.result()
                    self._check_renderer(renderer)
                    if kind == "survey":
                        self._place_survey(name, result)
                        self.surveys[survey_name(name)] = result
                        ready += [("clip", member) for member in groups[survey_name(name)]]
                    else:
                        self._finish_clip(name, result)
                self._tell(len(ready))
        except BrokenProcessPool:
            raise _worker_died() from None
        finally:
            self._stop()

    def _stop(self) -> None:
        """After an error: no worker may write into the folder once it is let go."""
        for future in self.running:
            future.cancel()
        if self.running and isinstance(self.executor, LocalProcesses):
            self.executor.stop()
        wait([future for future in self.running if not future.cancelled()])

    def _order(self, job: tuple[str, ClipName]) -> tuple[int, bool, int]:
        kind, name = job
        scenes = [scene.name for scene in self.orders.protocol.scenes]
        return scenes.index(name.scene), kind == "clip", self._rank[name]

    def _submit(self, kind: str, name: ClipName) -> None:
        if kind == "survey":
            key = self.orders.survey_key(name)
            finished = self.out / HOLES_FOLDER / survey_name(name)
            unfinished = self.work / "surveys" / key
            folder = finished if read_survey(finished, key) is not None else unfinished
            future: Future[Any] = self.executor.submit(survey_job, self.orders, name, folder)
        else:
            survey = self.surveys[survey_name(name)]
            folder = self.work / "clips" / self.orders.clip_key(name)
            self.active[name] = folder
            future = self.executor.submit(clip_job, self.orders, name, survey, folder)
        self.running[future] = (kind, name)

    def _place_survey(self, name: ClipName, survey: Survey) -> None:
        made = self.work / "surveys" / survey.key
        if made.exists():
            _move_over(made, self.out / HOLES_FOLDER / survey_name(name))

    def _finish_clip(self, name: ClipName, hashes: list[str]) -> None:
        record = self._record(name, self.surveys[survey_name(name)], hashes)
        _move_over(self.active.pop(name), self.out / str(name))
        self._store_record(record)
        self.records[name] = record

    def _store_record(self, record: Clip) -> None:
        folder = self.work / "records"
        folder.mkdir(parents=True, exist_ok=True)
        content = {"clip": record.model_dump(mode="json"), "renderer": asdict(self.renderer)}
        write_whole(
            folder / f"{record.clip_name}.json", json.dumps(content, sort_keys=True).encode()
        )

    def _keep_records(self) -> None:
        """Keep what an old manifest says of clips that stay, before it goes."""
        for record in self.records.values():
            self._store_record(record)

    def _record(self, name: ClipName, survey: Survey, hashes: list[str]) -> Clip:
        orders = self.orders
        clips, (width, height) = orders.protocol.clips, orders.shown_px
        parameters: dict[str, Scalar | tuple[Scalar, ...]] = {
            "path": orders.scene(name).camera.kind,
            "extent_m": survey.extent_m,
            "margin_px": survey.margin_px,
            "hole_share_least": survey.hole_share_least,
            "hole_share_most": survey.hole_share_most,
            "hole_masks_sha256": survey.masks_hash,
            "scene_seed": orders.scene(name).seed,
            "method": orders.method(name).registry_name,
            "exr": clips.exr,
            "preview": clips.preview,
        }
        for key, value in orders.parameters(name).items():
            if value is not None:
                parameters[f"method.{key}"] = tuple(value) if isinstance(value, list) else value
        return Clip(
            scene=name.scene,
            size=name.size,
            method=name.method,
            width_px=width,
            height_px=height,
            fps=clips.fps,
            bit_depth=clips.bit_depth,
            seed=clips.seed,
            parameters=parameters,
            hole_share=survey.hole_share,
            cache_key=orders.clip_key(name),
            frames_sha256=tuple(hashes),
        )

    def _check_renderer(self, renderer: RendererInfo) -> None:
        if renderer != self.renderer:
            raise StudyError(
                "all workers must draw with one renderer, or their clips are not comparable"
                f" (found {self.renderer.renderer} {self.renderer.version} and"
                f" {renderer.renderer} {renderer.version}); leave the odd machine out"
            )

    def _tell(self, waiting: int) -> None:
        """Count frames on the disk: it is the same for processes here and elsewhere."""
        done = len(self.records) * self.orders.protocol.clips.frames
        for folder in self.active.values():
            if folder.exists():
                done += sum(entry.suffix == ".png" for entry in folder.iterdir())
        now = [f"{name}" if kind == "clip" else f"path of {survey_name(name)}"
               for kind, name in self.running.values()]  # fmt: skip
        shown = now[0] if now else "finishing"
        self.report(done, self._total, shown + (f" (+{len(now) + waiting - 1})" if now else ""))

    # The end

    def _remove_strangers(self) -> None:
        """Clips and masks of an older protocol that this one does not have."""
        wanted = {str(name) for name in self.orders.clip_names}
        for entry in self.out.iterdir():
            if entry.is_dir() and entry.name.count("__") == 2 and entry.name not in wanted:
                shutil.rmtree(entry)
        surveys = {survey_name(name) for name in self.orders.clip_names}
        for entry in (self.out / HOLES_FOLDER).iterdir():
            if entry.name not in surveys:
                shutil.rmtree(entry)

    def _derive(self) -> None:
        """Previews and the contact sheet, made from the frames."""
        folder = self.out / PREVIEW_FOLDER
        wanted = set()
        if self.orders.protocol.clips.preview:
            folder.mkdir(exist_ok=True)
            for name in self.orders.clip_names:
                path = preview_path(self.out, self.records[name])
                wanted.add(path.name)
                if not path.exists():
                    self.report(self._total, self._total, f"preview of {name}")
                    write_preview(self.out, self.records[name], path)
        if folder.exists():
            for entry in folder.iterdir():
                if entry.name not in wanted:
                    entry.unlink()
            if not wanted:
                folder.rmdir()
        self.report(self._total, self._total, "contact sheet")
        manifest_path = self.out / MANIFEST_NAME
        if not manifest_path.exists() or not (self.out / SHEET_NAME).exists():
            clips = [self.records[name] for name in self.orders.clip_names]
            write_contact_sheet(self.out, self.orders.protocol, clips)

    def _manifest(self) -> Manifest:
        orders = self.orders
        return Manifest(
            format=1,
            study=orders.protocol.study.name,
            stimuli_sha256=orders.protocol.stimuli_sha256,
            display=orders.display.name,
            revision=f"{package_version()}, revision {code_revision()}",
            renderer=RendererEntry(**asdict(self.renderer)),
            versions=versions(),
            clips=tuple(self.records[name] for name in orders.clip_names if name in self.records),
        )


def versions() -> dict[str, str]:
    """Return Python's version and those of the packages that take part in making pixels."""
    found = {"python": platform.python_version()}
    for package in VERSIONED:
        try:
            found[package] = metadata.version(package)
        except metadata.PackageNotFoundError:
            continue
    return found


@contextmanager
def _only_build(out: Path) -> Iterator[None]:
    """Hold the folder for one build; the system lets go of it if the build is killed."""
    handle = os.open(out, os.O_RDONLY)
    try:
        try:
            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            raise StudyError(
                f"{out}: another build is at work in this folder; wait for it to end, or choose"
                " another --out"
            ) from None
        yield
    finally:
        os.close(handle)


def _move_over(source: Path, target: Path) -> None:
    """Move a folder to its place; what was there goes first."""
    target.parent.mkdir(parents=True, exist_ok=True)
    if target.exists():
        shutil.rmtree(target)
    _sync(source)
    source.replace(target)
    _sync(target.parent)


def _sync(folder: Path) -> None:
    handle = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)


def _worker_died() -> StudyError:
    return StudyError(
        "a worker process was killed (out of memory?); nothing that it finished is lost:"
        " run the same command again, with fewer --workers if memory is short"
    )
