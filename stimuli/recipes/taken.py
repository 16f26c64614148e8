"""Stills and videos that one process makes or takes in, into hashed clips: what builders share.

A stimulus's frames are written as PNG below ``.build``, moved to their folder when all are there,
and noted; the manifest comes last. What matches by the hash of all that decides it is kept.
"""

from __future__ import annotations

import shutil
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import Executor, Future, ThreadPoolExecutor, as_completed
from pathlib import Path
from typing import Generic, Protocol, TypeVar

from pipeline.errors import InputError
from protocols.errors import StudyError
from protocols.folder_hold import only_build
from protocols.hashing import sha256_bytes
from protocols.manifest import MANIFEST_NAME, Clip, write_manifest
from protocols.recipes.base import Recipe
from protocols.units import Scalar
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
from stimuli.preview import PREVIEW_FOLDER, preview_path, write_preview
from stimuli.recipes.base import Builder, Outcome, Report, Where
from stimuli.records import Book, is_whole
from stimuli.whole_file import write_whole
from stimuli.worker import RendererInfo

_LISTED = 12
RESERVED = (HOLES_FOLDER, PREVIEW_FOLDER)


class Entry(Protocol):
    """A stimulus that is wanted."""

    @property
    def name(self) -> str: ...

    @property
    def condition(self) -> Mapping[str, Scalar]: ...


E = TypeVar("E", bound=Entry)


class TakingBuilder(Builder, Generic[E]):
    """Makes stimuli one by one, in this process; what they are made of is for each builder to say.

    Attributes
    ----------
    renderer : RendererInfo
        What draws; bytes repeat on one only.
    """

    renderer: RendererInfo

    @property
    def recipe_of_all(self) -> Recipe:
        """The recipe."""
        return self.protocol.stimuli

    @property
    def wanted(self) -> tuple[E, ...]:
        """The stimuli that the study shows."""
        raise NotImplementedError

    def check_inputs(self) -> None:
        """Refuse before anything is written what could not be made."""

    def key(self, entry: E) -> str:
        """Return the hash of all that decides a stimulus's pixels."""
        raise NotImplementedError

    def encoded(self, entry: E) -> Iterator[bytes]:
        """Yield a stimulus's frames as PNG files."""
        raise NotImplementedError

    def record(self, entry: E, key: str, hashes: tuple[str, ...]) -> Clip:
        """Return what the manifest says of it."""
        raise NotImplementedError

    def executor(self, workers: int) -> Executor:
        """Where the work is done."""
        return ThreadPoolExecutor(workers)

    def close(self) -> None:
        """Free what the work held."""

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
                "--scheduler is for clips that are rendered; stimuli of this kind are made on this"
                " machine: leave the option out"
            )
        self.check_inputs()
        out.mkdir(parents=True, exist_ok=True)
        with only_build(out):
            try:
                return self._build(out, where.workers or cores(), report)
            finally:
                self.close()

    def summary(self, outcome: Outcome[str]) -> tuple[Sequence[str], list[Sequence[str]]]:
        """Return how many stimuli each value of each column has."""
        rows: list[Sequence[str]] = []
        for column in self.recipe_of_all.columns():
            values = [clip.condition[column] for clip in outcome.manifest.clips]
            counts = {value: values.count(value) for value in self.recipe_of_all.values(column)}
            said = [f"{value} ({count})" for value, count in counts.items() if count]
            more = f", ... ({len(said)} values)" if len(said) > _LISTED else ""
            rows.append((column, ", ".join(said[:_LISTED]) + more))
        return ("column", "values (stimuli)"), rows

    def _build(self, out: Path, workers: int, report: Report) -> Outcome[str]:
        check_folder(out)
        book = Book(self.protocol, self.display, out, self.renderer)
        total = len(self.wanted) * self.recipe_of_all.frames
        report(0, total, "hashing inputs")
        with self.executor(workers) as pool:
            keys = dict(
                zip(
                    [entry.name for entry in self.wanted],
                    pool.map(self.key, self.wanted),
                    strict=True,
                )
            )
            old = book.old()
            records: dict[str, Clip] = {}
            for entry in self.wanted:
                known = old.get(entry.name)
                if (
                    known is not None
                    and known.cache_key == keys[entry.name]
                    and is_whole(out / entry.name, known)
                ):
                    # What is told of a file may change without its pixels.
                    records[entry.name] = self.record(entry, known.cache_key, known.frames_sha256)
            kept = list(records)
            missing = [entry for entry in self.wanted if entry.name not in records]
            manifest_path = out / MANIFEST_NAME
            if missing or book.is_stale(self._in_order(records)):
                claim(out, [entry.name for entry in self.wanted])
                for record in records.values():
                    book.store(record)
                manifest_path.unlink(missing_ok=True)  # from here on nothing looks finished
                sync(out)
            jobs: dict[Future[Clip], E] = {
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
                    report(len(records) * self.recipe_of_all.frames, total, entry.name)
            finally:
                for job in jobs:
                    job.cancel()
        if wrong:
            raise InputError(
                "\n".join(wrong[entry.name] for entry in missing if entry.name in wrong)
            )
        remove_strangers(out, [entry.name for entry in self.wanted])
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
        return self.recipe_of_all.frames > 1

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
        return [records[entry.name] for entry in self.wanted if entry.name in records]

    def _take_in(self, entry: E, key: str, out: Path, book: Book) -> Clip:
        """Write the frames of a stimulus, move them to their folder, and note it."""
        work = out / BUILD_FOLDER / "clips" / key / entry.name
        shutil.rmtree(work, ignore_errors=True)
        work.mkdir(parents=True)
        hashes = []
        for index, data in enumerate(self.encoded(entry)):
            write_whole(work / f"{index:06d}.png", data)
            hashes.append(sha256_bytes(data))
        move_over(work, out / entry.name)
        record = self.record(entry, key, tuple(hashes))
        book.store(record)
        return record
