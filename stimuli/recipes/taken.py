"""Stills and videos that are made or taken in one by one, into hashed clips: what builders share.

A stimulus's frames are written as PNG below ``.build``, moved to their folder when all are there,
and noted; the manifest comes last. What matches by the hash of all that decides it is kept. Jobs
run in threads, processes or on a cluster, a few ahead of the workers; moving and noting is done
here.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import FIRST_COMPLETED, Executor, Future, ThreadPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import AbstractContextManager, contextmanager
from pathlib import Path
from typing import Generic, Protocol, TypeAlias, TypeVar

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
    remove_unfinished,
    sync,
)
from stimuli.derived import derive
from stimuli.executors import LocalProcesses, cores
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
Made: TypeAlias = "tuple[list[bytes | str], RendererInfo]"
"""What a job returns: of each frame the PNG file itself, or the hash of the one that it wrote; and
what drew them."""


class TakingBuilder(Builder, Generic[E]):
    """Makes stimuli one by one; what they are made of is for each builder to say."""

    renderer = RendererInfo("", "none: files made elsewhere", "")
    """What draws in this process; bytes repeat on one only."""

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

    def executor(self, where: Where) -> AbstractContextManager[tuple[Executor, int]]:
        """Where the work is done, and how many jobs it is given at once.

        Raises
        ------
        StudyError
            If a cluster is asked for: threads of this process do it, unless a builder says more.
        """
        if where.scheduler is not None:
            raise StudyError(
                "--scheduler is for stimuli that are computed; those of this kind are taken in on"
                " this machine: leave the option out"
            )
        return _threads(where.workers or cores())

    def drawn_by(self, executor: Executor) -> RendererInfo:  # noqa: ARG002
        """What the workers draw with."""
        return self.renderer

    def submit(self, executor: Executor, entry: E, work: Path) -> Future[Made]:
        """Have a stimulus's frames made: by `encoded`, into the folder `work`.

        `work` is the same for the same pixels; an earlier build may have left things beside it.
        """
        return executor.submit(self._write_frames, entry, work)

    def close(self) -> None:
        """Free what the work held."""

    def build(self, out: Path, where: Where, report: Report) -> Outcome[str]:
        """Take in what is missing or changed.

        Raises
        ------
        StudyError
            If another build or a session uses the folder, it holds other things, there is no such
            cluster, a worker died, or workers draw with different renderers.
        InputError
            With a line for every file that is not what the study says.
        """
        self.check_inputs()
        with self.executor(where) as (executor, places):
            out.mkdir(parents=True, exist_ok=True)
            with only_build(out):
                try:
                    return self._build(out, executor, places, report)
                except BrokenProcessPool:
                    raise StudyError(
                        "a worker process was killed (out of memory?); nothing that it finished is"
                        " lost: run the same command again, with fewer --workers if memory is short"
                    ) from None
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

    def _build(self, out: Path, executor: Executor, places: int, report: Report) -> Outcome[str]:
        check_folder(out, [entry.name for entry in self.wanted])
        book = Book(self.protocol, self.display, out, self.drawn_by(executor))
        frames = self.recipe_of_all.frames
        total = len(self.wanted) * frames
        report(0, total, "hashing inputs")
        with ThreadPoolExecutor(cores()) as readers:
            hashed = readers.map(self.key, self.wanted)
            keys = {entry.name: key for entry, key in zip(self.wanted, hashed, strict=True)}
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
            claim(out, [entry.name for entry in self.wanted], keys.values())
            for record in records.values():
                book.store(record)
            manifest_path.unlink(missing_ok=True)  # from here on nothing looks finished
            sync(out)
        wrong: dict[str, str] = {}
        for entry, made in self._made(missing, keys, out, executor, places):
            if isinstance(made, InputError):
                wrong[entry.name] = str(made)
                continue
            hashes, renderer = made
            book.check_renderer(renderer)
            move_over(_work(out, keys[entry.name], entry), out / entry.name)
            records[entry.name] = self.record(entry, keys[entry.name], hashes)
            book.store(records[entry.name])
            report(len(records) * frames, total, entry.name)
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
        remove_unfinished(out)
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

    def _made(
        self,
        missing: Sequence[E],
        keys: Mapping[str, str],
        out: Path,
        executor: Executor,
        places: int,
    ) -> Iterator[tuple[E, tuple[tuple[str, ...], RendererInfo] | InputError]]:
        """Have stimuli made, `places` at a time; yield each with its hashes, or what is wrong."""
        waiting = deque(missing)
        running: dict[Future[Made], E] = {}
        try:
            while waiting or running:
                while waiting and len(running) < places:
                    entry = waiting.popleft()
                    work = _work(out, keys[entry.name], entry)
                    remove_unfinished(out, work)
                    work.mkdir(parents=True, exist_ok=True)
                    running[self.submit(executor, entry, work)] = entry
                done, _ = wait(running, return_when=FIRST_COMPLETED)
                for job in done:
                    entry = running.pop(job)
                    try:
                        frames, renderer = job.result()
                    except InputError as error:
                        yield entry, error
                        continue
                    yield entry, (_stored(_work(out, keys[entry.name], entry), frames), renderer)
        finally:
            for job in running:
                job.cancel()
            if running and isinstance(executor, LocalProcesses):
                executor.stop()
            # No worker may write into the folder once it is let go.
            wait([job for job in running if not job.cancelled()])

    def _write_frames(self, entry: E, work: Path) -> Made:
        """Write the frames of a stimulus; return their hashes."""
        hashes: list[bytes | str] = []
        for index, data in enumerate(self.encoded(entry)):
            write_whole(work / f"{index:06d}.png", data)
            hashes.append(sha256_bytes(data))
        return hashes, self.renderer


@contextmanager
def _threads(workers: int) -> Iterator[tuple[Executor, int]]:
    with ThreadPoolExecutor(workers) as pool:
        yield pool, workers + 1


def _work(out: Path, key: str, entry: Entry) -> Path:
    """Where a stimulus lies while it is not whole."""
    return out / BUILD_FOLDER / "clips" / key / entry.name


def _stored(work: Path, frames: Sequence[bytes | str]) -> tuple[str, ...]:
    """Write frames that came as bytes; return the hashes of all."""
    hashes = []
    for index, frame in enumerate(frames):
        if isinstance(frame, bytes):
            write_whole(work / f"{index:06d}.png", frame)
        hashes.append(sha256_bytes(frame) if isinstance(frame, bytes) else frame)
    return tuple(hashes)
