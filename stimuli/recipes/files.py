"""Takes pictures and videos that were made elsewhere into hashed clips: the recipe `files`.

A stimulus's frames are written as PNG below ``.build``, moved to their folder when all are there,
and noted; the manifest comes last. What matches by the hash of its file is kept.
"""

from __future__ import annotations

import shutil
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor, as_completed
from functools import cached_property
from pathlib import Path

from pipeline.errors import InputError
from protocols.display import Display
from protocols.errors import Problem, StudyError
from protocols.folder_hold import only_build
from protocols.hashing import sha256_bytes
from protocols.manifest import MANIFEST_NAME, Clip, cache_key, write_manifest
from protocols.recipes.files import FileEntry, Files
from protocols.schema import StudyProtocol
from stimuli.batch_folder import (
    BUILD_FOLDER,
    HOLES_FOLDER,
    check_folder,
    claim,
    move_over,
    remove_strangers,
    sync,
)
from stimuli.derived import derive
from stimuli.executors import cores
from stimuli.png import encode_bytes
from stimuli.preview import PREVIEW_FOLDER, preview_path, write_preview
from stimuli.read_file import file_sha256, read_frames
from stimuli.recipes.base import Builder, Estimate, Outcome, Report, Where
from stimuli.records import Book, is_whole
from stimuli.sources import source_sha256
from stimuli.whole_file import write_whole
from stimuli.worker import RendererInfo

NO_RENDERER = RendererInfo("", "none: files made elsewhere", "")
_SOURCES = ("stimuli.read_file", "stimuli.png")
_LISTED = 12
RESERVED = (HOLES_FOLDER, PREVIEW_FOLDER)


class FileBuilder(Builder):
    """Checks and hashes files, in threads of this process."""

    def __init__(self, protocol: StudyProtocol, display: Display, folder: Path) -> None:
        super().__init__(protocol, display, folder)
        assert isinstance(protocol.stimuli, Files)
        self.recipe = protocol.stimuli

    def problems(self) -> list[Problem]:
        """Return names that folders of the batch have already."""
        return [
            Problem(
                f"stimuli.entries[{index}].name",
                f"must not be {' or '.join(RESERVED)}, as a folder of every build is called (got"
                f" {entry.name!r}); rename the stimulus",
            )
            for index, entry in enumerate(self.recipe.entries)
            if entry.name in RESERVED
        ]

    @cached_property
    def entries(self) -> tuple[FileEntry, ...]:
        """The stimuli that the study shows."""
        shown = set(self.protocol.shown())
        return tuple(entry for entry in self.recipe.entries if entry.name in shown)

    def estimate(self, out: Path, workers: int) -> Estimate:
        """Read the first file, time it, and multiply; every other file must be there."""
        from time import perf_counter

        self._check_files()
        started = perf_counter()
        sizes = [len(data) for data in self._encoded(self.entries[0])]
        time_s = (perf_counter() - started) * len(self.entries)
        there = next(place for place in (out, *out.absolute().parents) if place.exists())
        return Estimate(
            clips=len(self.entries),
            frames=len(self.entries) * self.recipe.frames,
            size_px=(self.recipe.width_px, self.recipe.height_px),
            disk_bytes=round(1.05 * sum(sizes) * len(self.entries)),
            free_bytes=shutil.disk_usage(there).free,
            time_s=time_s / max(1, workers),
            renderer="none: files made elsewhere",
        )

    def build(self, out: Path, where: Where, report: Report) -> Outcome[str]:
        """Take in what is missing or changed.

        Raises
        ------
        StudyError
            If another build or a sitting uses the folder, it holds other things, or a cluster is
            asked for.
        InputError
            With a line for every file that is not what the study says.
        """
        if where.scheduler is not None:
            raise StudyError(
                "--scheduler is for clips that are rendered; files are read on this machine: leave"
                " the option out"
            )
        self._check_files()
        out.mkdir(parents=True, exist_ok=True)
        with only_build(out):
            return self._build(out, where.workers or cores(), report)

    def summary(self, outcome: Outcome[str]) -> tuple[Sequence[str], list[Sequence[str]]]:
        """Return how many stimuli each value of each column has."""
        rows: list[Sequence[str]] = []
        for column in self.recipe.columns():
            values = [clip.condition[column] for clip in outcome.manifest.clips]
            counts = {value: values.count(value) for value in self.recipe.values(column)}
            said = [f"{value} ({count})" for value, count in counts.items() if count]
            more = f", ... ({len(said)} values)" if len(said) > _LISTED else ""
            rows.append((column, ", ".join(said[:_LISTED]) + more))
        return ("column", "values (stimuli)"), rows

    def _check_files(self) -> None:
        """Every file that is missing, before anything is written."""
        if any(not (self.folder / entry.file).exists() for entry in self.entries):
            raise StudyError("\n".join(map(str, self.recipe.problems(self.folder))))

    def _build(self, out: Path, workers: int, report: Report) -> Outcome[str]:
        check_folder(out)
        book = Book(self.protocol, self.display, out, NO_RENDERER)
        total = len(self.entries) * self.recipe.frames
        report(0, total, "hashing files")
        with ThreadPoolExecutor(workers) as pool:
            keys = dict(
                zip(
                    [entry.name for entry in self.entries],
                    pool.map(self._key, self.entries),
                    strict=True,
                )
            )
            old = book.old()
            records: dict[str, Clip] = {}
            for entry in self.entries:
                known = old.get(entry.name)
                if (
                    known is not None
                    and known.cache_key == keys[entry.name]
                    and is_whole(out / entry.name, known)
                ):
                    # What is told of a file may change without its pixels.
                    records[entry.name] = self._record(entry, known.cache_key, known.frames_sha256)
            kept = list(records)
            missing = [entry for entry in self.entries if entry.name not in records]
            manifest_path = out / MANIFEST_NAME
            if missing or book.is_stale(self._in_order(records)):
                claim(out, [entry.name for entry in self.entries])
                for record in records.values():
                    book.store(record)
                manifest_path.unlink(missing_ok=True)  # from here on nothing looks finished
                sync(out)
            jobs: dict[Future[Clip], FileEntry] = {
                pool.submit(self._take_in, entry, keys[entry.name], out, book): entry
                for entry in missing
            }
            wrong: dict[str, str] = {}
            try:
                for job in as_completed(jobs):
                    entry = jobs[job]
                    try:
                        records[entry.name] = job.result()
                    except InputError as error:
                        wrong[entry.name] = str(error)
                        continue
                    report(len(records) * self.recipe.frames, total, entry.name)
            finally:
                for job in jobs:
                    job.cancel()
        if wrong:
            raise InputError(
                "\n".join(wrong[entry.name] for entry in missing if entry.name in wrong)
            )
        remove_strangers(out, [entry.name for entry in self.entries])
        clips = self._in_order(records)
        self._write_previews(out, clips, lambda now: report(total, total, now))
        derive(
            self.protocol,
            out,
            clips,
            lambda now: report(total, total, now),
            previews=self._has_previews,
        )
        manifest = book.manifest(clips)
        if not manifest_path.exists():
            write_manifest(out, manifest)
            sync(out)
        shutil.rmtree(out / BUILD_FOLDER, ignore_errors=True)
        return Outcome(manifest, [entry.name for entry in missing], kept)

    @property
    def _has_previews(self) -> bool:
        return self.recipe.frames > 1

    def _write_previews(
        self, out: Path, clips: Sequence[Clip], tell: Callable[[str], None]
    ) -> None:
        if not self._has_previews:
            return
        (out / PREVIEW_FOLDER).mkdir(exist_ok=True)
        for clip in clips:
            path = preview_path(out, clip)
            if not path.exists():
                tell(f"preview of {clip.name}")
                write_preview(out, clip, path)

    def _in_order(self, records: dict[str, Clip]) -> list[Clip]:
        return [records[entry.name] for entry in self.entries if entry.name in records]

    def _key(self, entry: FileEntry) -> str:
        """Return the hash of all that decides a stimulus's pixels."""
        recipe = self.recipe
        return cache_key(
            {
                "file": file_sha256(self.folder / entry.file),
                "size_px": [recipe.width_px, recipe.height_px],
                "fps": recipe.fps,
                "frames": recipe.frames,
                "sources": source_sha256(*_SOURCES),
            }
        )

    def _encoded(self, entry: FileEntry) -> Iterator[bytes]:
        recipe = self.recipe
        size_px = recipe.width_px, recipe.height_px
        path = self.folder / entry.file
        return map(encode_bytes, read_frames(path, size_px, recipe.frames, recipe.fps))

    def _take_in(self, entry: FileEntry, key: str, out: Path, book: Book) -> Clip:
        """Write the frames of a stimulus, move them to their folder, and note it."""
        work = out / BUILD_FOLDER / "clips" / key / entry.name
        shutil.rmtree(work, ignore_errors=True)
        work.mkdir(parents=True)
        hashes = []
        for index, data in enumerate(self._encoded(entry)):
            write_whole(work / f"{index:06d}.png", data)
            hashes.append(sha256_bytes(data))
        move_over(work, out / entry.name)
        record = self._record(entry, key, tuple(hashes))
        book.store(record)
        return record

    def _record(self, entry: FileEntry, key: str, hashes: tuple[str, ...]) -> Clip:
        recipe = self.recipe
        return Clip(
            name=entry.name,
            condition=dict(entry.condition),
            width_px=recipe.width_px,
            height_px=recipe.height_px,
            fps=recipe.frame_hz,
            bit_depth=8,
            seed=0,
            parameters={"file": entry.file, "preview": self._has_previews},
            cache_key=key,
            frames_sha256=hashes,
        )
