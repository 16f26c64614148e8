"""Stills and videos that are made or taken in one by one, into hashed clips: what builders share.

What matches by the hash of all that decides it is kept. `stimuli.batch.clip_build` does the rest.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from concurrent.futures import Executor, Future, ThreadPoolExecutor
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Generic, Protocol, TypeAlias, TypeVar

from pipeline.errors import InputError
from protocols.disk.hashing import sha256_bytes
from protocols.disk.locks import only_build
from protocols.disk.whole_file import write_whole
from protocols.errors import StudyError
from protocols.manifest import Clip
from protocols.units import Scalar
from stimuli.batch.batch_folder import BUILD_FOLDER, HOLES_FOLDER, remove_unfinished
from stimuli.batch.clip_build import ClipBuild, Job
from stimuli.batch.executors import cores
from stimuli.batch.records import ManifestDraft, is_whole
from stimuli.media.video import PREVIEW_FOLDER
from stimuli.recipes.base import Builder, BuildMachine, BuildOutcome, Report
from stimuli.worker import RendererInfo

_LISTED = 12
RESERVED = (HOLES_FOLDER, PREVIEW_FOLDER)


class WantedStimulus(Protocol):
    """A stimulus that is wanted."""

    @property
    def name(self) -> str: ...

    @property
    def condition(self) -> Mapping[str, Scalar]: ...


E = TypeVar("E", bound=WantedStimulus)
Made: TypeAlias = "tuple[list[bytes | str], RendererInfo]"
"""Result of a job: of each frame the PNG file itself, or the hash of the one that it wrote; and
what drew them."""


class SingleStimulusBuilder(Builder, Generic[E]):
    """Makes stimuli one by one; what they are made of is for each builder to say."""

    renderer = RendererInfo("", "none: files made elsewhere", "")
    """Renderer of this process; bytes repeat on one only."""

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
        """Return its entry of the manifest."""
        raise NotImplementedError

    @contextmanager
    def executor(self, where: BuildMachine) -> Iterator[tuple[Executor, int]]:
        """Executor of the work, and how many jobs it is given at once.

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
        workers = where.workers or cores()
        with ThreadPoolExecutor(workers) as pool:
            yield pool, workers + 1

    def drawn_by(self, executor: Executor) -> RendererInfo:  # noqa: ARG002
        """Renderer of the workers."""
        return self.renderer

    def submit(self, executor: Executor, entry: E, work: Path) -> Future[Made]:
        """Have a stimulus's frames made: by `encoded`, into the folder `work`.

        `work` is the same for the same pixels; an earlier build may have left things beside it.
        """
        return executor.submit(self._write_frames, entry, work)

    def close(self) -> None:
        """Free what the work held."""

    def build(self, out: Path, where: BuildMachine, report: Report) -> BuildOutcome[str]:
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
                    return _TakingBuild(self, out, executor, places, report).run()
                finally:
                    self.close()

    def summary(self, outcome: BuildOutcome[str]) -> tuple[Sequence[str], list[Sequence[str]]]:
        """Return the number of stimuli for each value of each column."""
        rows: list[Sequence[str]] = []
        for column in self.protocol.stimuli.columns():
            values = [clip.condition.get(column) for clip in outcome.manifest.clips]
            counts = {value: values.count(value) for value in self.protocol.stimuli.values(column)}
            said = [f"{value} ({count})" for value, count in counts.items() if count]
            more = f", ... ({len(said)} values)" if len(said) > _LISTED else ""
            rows.append((column, ", ".join(said[:_LISTED]) + more))
        return ("column", "values (stimuli)"), rows

    def _write_frames(self, entry: E, work: Path) -> Made:
        """Write the frames of a stimulus; return their hashes."""
        hashes: list[bytes | str] = []
        for index, data in enumerate(self.encoded(entry)):
            write_whole(work / f"{index:06d}.png", data)
            hashes.append(sha256_bytes(data))
        return hashes, self.renderer


class _TakingBuild(ClipBuild[str]):
    """Every stimulus by itself; all that is wrong is told together, after the last one."""

    def __init__(
        self,
        builder: SingleStimulusBuilder[E],
        out: Path,
        executor: Executor,
        places: int,
        report: Report,
    ) -> None:
        self.entries = {entry.name: entry for entry in builder.wanted}
        frames = builder.protocol.stimuli.frames
        super().__init__(
            builder.protocol, out, executor, places, report, list(self.entries), frames
        )
        self.builder: SingleStimulusBuilder[Any] = builder
        self.previews = frames > 1
        self.hashes: dict[str, str] = {}
        self.wrong: dict[str, str] = {}

    def open_draft(self) -> ManifestDraft:
        builder = self.builder
        draft = ManifestDraft(
            self.study, builder.display, self.out, builder.drawn_by(self.executor)
        )
        self.report(0, self.total, "hashing inputs")
        with ThreadPoolExecutor(cores()) as readers:
            hashed = readers.map(builder.key, self.entries.values())
            self.hashes = dict(zip(self.entries, hashed, strict=True))
        return draft

    def known(self, name: str, old: Clip | None) -> Clip | None:
        if old is None or old.cache_key != self.hashes[name] or not is_whole(self.out / name, old):
            return None
        # What is told of a file may change without its pixels.
        return self.builder.record(self.entries[name], old.cache_key, old.frames_sha256)

    def keys(self, missing: Sequence[str]) -> Iterable[str]:  # noqa: ARG002
        return self.hashes.values()

    def submit(self, kind: str, name: str) -> Future[Any]:  # noqa: ARG002
        work = self.out / BUILD_FOLDER / "clips" / self.hashes[name] / name
        remove_unfinished(self.out, work)
        work.mkdir(parents=True, exist_ok=True)
        self.active[name] = work
        return self.builder.submit(self.executor, self.entries[name], work)

    def finish(self, kind: str, name: str, job: Future[Any]) -> list[Job[str]]:
        if kind == "preview":
            job.result()
            return []
        try:
            frames, renderer = job.result()
        except InputError as error:
            self.wrong[name] = str(error)
            del self.active[name]
            return []
        hashes = _stored(self.active[name], frames)
        record = self.builder.record(self.entries[name], self.hashes[name], hashes)
        return self.place(name, record, renderer)

    def check_all(self) -> None:
        if self.wrong:
            raise InputError(
                "\n".join(self.wrong[name] for name in self.names if name in self.wrong)
            )


def _stored(work: Path, frames: Sequence[bytes | str]) -> tuple[str, ...]:
    """Write frames that came as bytes; return the hashes of all."""
    hashes = []
    for index, frame in enumerate(frames):
        if isinstance(frame, bytes):
            write_whole(work / f"{index:06d}.png", frame)
        hashes.append(sha256_bytes(frame) if isinstance(frame, bytes) else frame)
    return tuple(hashes)
