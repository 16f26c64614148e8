"""The base of builders whose frames come as arrays, one stimulus after the other, in threads here.

A stimulus's frames are written as PNG below ``.build``, moved to their folder when all are there,
and noted; the manifest comes last. What matches by the hash of its inputs is kept.
"""

from __future__ import annotations

import shutil
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor, as_completed
from functools import cached_property
from pathlib import Path
from time import perf_counter
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from pipeline.errors import InputError
from protocols.errors import Problem, StudyError
from protocols.folder_hold import only_build
from protocols.hashing import Json, sha256_bytes
from protocols.manifest import MANIFEST_NAME, Clip, cache_key, write_manifest
from protocols.recipes.base import Stimulus
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
from stimuli.png import encode_bytes
from stimuli.preview import PREVIEW_FOLDER, preview_path, write_preview
from stimuli.recipes.base import Builder, Estimate, Outcome, Report, Where
from stimuli.records import Book, is_whole
from stimuli.sources import source_sha256
from stimuli.whole_file import write_whole
from stimuli.worker import RendererInfo

RESERVED = (HOLES_FOLDER, PREVIEW_FOLDER)
_LISTED = 12


class FrameBuilder(Builder):
    """Writes frames that come as arrays. A recipe's builder says `inputs` and `frames`."""

    origin: ClassVar[str]
    """Where the frames come from: stands in the manifest in the renderer's place."""
    modules: ClassVar[tuple[str, ...]]
    """Modules whose code decides the pixels: with another code, all is built again."""

    def inputs(self, stimulus: Stimulus) -> Mapping[str, Json]:
        """Return all that decides a stimulus's pixels, beside size, length and our own code.

        Raises
        ------
        OSError
            If a file cannot be read.
        """
        raise NotImplementedError

    def frames(self, stimulus: Stimulus) -> Iterator[NDArray[np.uint8]]:
        """Yield the frames of a stimulus, shape (H, W, 3).

        Raises
        ------
        InputError
            If they cannot be made; stimuli that can are finished all the same.
        """
        raise NotImplementedError

    def parameters(self, _stimulus: Stimulus) -> Mapping[str, Scalar]:
        """Return what the manifest says of how a stimulus was made."""
        return {}

    def check(self) -> None:
        """Refuse what is wrong before anything is written; `StudyError` says what."""

    def problems(self) -> list[Problem]:
        """Return names that folders of the batch have already."""
        return [
            Problem(
                f"stimuli.entries[{index}].name",
                f"must not be {' or '.join(RESERVED)}, as a folder of every build is called (got"
                f" {stimulus.name!r}); rename the stimulus",
            )
            for index, stimulus in enumerate(self.protocol.stimuli.pool())
            if stimulus.name in RESERVED
        ]

    @cached_property
    def stimuli(self) -> tuple[Stimulus, ...]:
        """What the study shows."""
        shown = set(self.protocol.shown())
        return tuple(entry for entry in self.protocol.stimuli.pool() if entry.name in shown)

    def estimate(self, out: Path, workers: int) -> Estimate:
        """Make the first stimulus, time it, and multiply."""
        self.check()
        count = len(self.stimuli)
        started = perf_counter()
        size = sum(len(encode_bytes(frame)) for frame in self.frames(self.stimuli[0]))
        time_s = (perf_counter() - started) * count
        there = next(place for place in (out, *out.absolute().parents) if place.exists())
        return Estimate(
            clips=count,
            frames=count * self.protocol.stimuli.frames,
            size_px=self.protocol.stimuli.size_px(self.display),
            disk_bytes=round(1.05 * size * count),
            free_bytes=shutil.disk_usage(there).free,
            time_s=time_s / max(1, workers),
            renderer=self.origin,
        )

    def build(self, out: Path, where: Where, report: Report) -> Outcome[str]:
        """Build what is missing or changed.

        Raises
        ------
        StudyError
            If another build or a sitting uses the folder, it holds other things, or a cluster is
            asked for.
        InputError
            With a line for every stimulus that cannot be made.
        """
        if where.scheduler is not None:
            raise StudyError(
                "--scheduler is for clips that are rendered; these are made on this machine: leave"
                " the option out"
            )
        self.check()
        out.mkdir(parents=True, exist_ok=True)
        with only_build(out):
            return self._build(out, where.workers or cores(), report)

    def summary(self, outcome: Outcome[str]) -> tuple[Sequence[str], list[Sequence[str]]]:
        """Return how many stimuli each value of each column has."""
        recipe = self.protocol.stimuli
        rows: list[Sequence[str]] = []
        for column in recipe.columns():
            values = [clip.condition[column] for clip in outcome.manifest.clips]
            counts = {value: values.count(value) for value in recipe.values(column)}
            said = [f"{value} ({count})" for value, count in counts.items() if count]
            more = f", ... ({len(said)} values)" if len(said) > _LISTED else ""
            rows.append((column, ", ".join(said[:_LISTED]) + more))
        return ("column", "values (stimuli)"), rows

    def _build(self, out: Path, workers: int, report: Report) -> Outcome[str]:
        check_folder(out)
        book = Book(self.protocol, self.display, out, RendererInfo("", self.origin, ""))
        each = self.protocol.stimuli.frames
        total = len(self.stimuli) * each
        report(0, total, "hashing")
        with ThreadPoolExecutor(workers) as pool:
            made = pool.map(self._key, self.stimuli)
            keys = {entry.name: key for entry, key in zip(self.stimuli, made, strict=True)}
            records = self._kept(out, book, keys)
            kept = list(records)
            missing = [entry for entry in self.stimuli if entry.name not in records]
            manifest_path = out / MANIFEST_NAME
            if missing or book.is_stale(self._in_order(records)):
                claim(out, [entry.name for entry in self.stimuli])
                for record in records.values():
                    book.store(record)
                manifest_path.unlink(missing_ok=True)  # from here on nothing looks finished
                sync(out)
            jobs: dict[Future[Clip], Stimulus] = {
                pool.submit(self._make, entry, keys[entry.name], out, book): entry
                for entry in missing
            }
            wrong: dict[str, str] = {}
            try:
                for job in as_completed(jobs):
                    name = jobs[job].name
                    try:
                        records[name] = job.result()
                    except InputError as error:
                        wrong[name] = str(error)
                        continue
                    report(len(records) * each, total, name)
            finally:
                for job in jobs:
                    job.cancel()
        if wrong:
            raise InputError("\n".join(wrong[s.name] for s in missing if s.name in wrong))
        remove_strangers(out, [entry.name for entry in self.stimuli])
        clips = self._in_order(records)

        def tell(now: str) -> None:
            report(total, total, now)

        self._write_previews(out, clips, tell)
        derive(self.protocol, out, clips, tell, previews=self._has_previews)
        manifest = book.manifest(clips)
        if not manifest_path.exists():
            write_manifest(out, manifest)
            sync(out)
        shutil.rmtree(out / BUILD_FOLDER, ignore_errors=True)
        return Outcome(manifest, [entry.name for entry in missing], kept)

    def _kept(self, out: Path, book: Book, keys: Mapping[str, str]) -> dict[str, Clip]:
        """Return the entries of what is there whole, made from what is wanted now."""
        old = book.old()
        found = {}
        for stimulus in self.stimuli:
            known = old.get(stimulus.name)
            if known is None or known.cache_key != keys[stimulus.name]:
                continue
            if is_whole(out / stimulus.name, known):
                # What is told of a stimulus may change without its pixels.
                found[stimulus.name] = self._record(stimulus, known.cache_key, known.frames_sha256)
        return found

    @property
    def _has_previews(self) -> bool:
        return self.protocol.stimuli.frames > 1

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

    def _in_order(self, records: Mapping[str, Clip]) -> list[Clip]:
        return [records[entry.name] for entry in self.stimuli if entry.name in records]

    def _key(self, stimulus: Stimulus) -> str:
        recipe = self.protocol.stimuli
        return cache_key(
            {
                **self.inputs(stimulus),
                "size_px": list(recipe.size_px(self.display)),
                "fps": recipe.frame_hz,
                "frames": recipe.frames,
                "sources": source_sha256("stimuli.png", *self.modules),
            }
        )

    def _make(self, stimulus: Stimulus, key: str, out: Path, book: Book) -> Clip:
        """Write the frames of a stimulus, move them to their folder, and note it."""
        work = out / BUILD_FOLDER / "clips" / key / stimulus.name
        shutil.rmtree(work, ignore_errors=True)
        work.mkdir(parents=True)
        hashes = []
        recipe = self.protocol.stimuli
        width, height = recipe.size_px(self.display)
        for index, frame in enumerate(self.frames(stimulus)):
            if frame.shape != (height, width, 3) or frame.dtype != np.uint8:
                raise InputError(
                    f"{stimulus.name}: frames must be 8-bit of {height} x {width} x 3 (got"
                    f" {frame.dtype} of {' x '.join(map(str, frame.shape))})"
                )
            data = encode_bytes(frame)
            write_whole(work / f"{index:06d}.png", data)
            hashes.append(sha256_bytes(data))
        if len(hashes) != recipe.frames:
            raise InputError(
                f"{stimulus.name}: must have {recipe.frames} frames (got {len(hashes)})"
            )
        move_over(work, out / stimulus.name)
        record = self._record(stimulus, key, tuple(hashes))
        book.store(record)
        return record

    def _record(self, stimulus: Stimulus, key: str, hashes: tuple[str, ...]) -> Clip:
        recipe = self.protocol.stimuli
        width, height = recipe.size_px(self.display)
        return Clip(
            name=stimulus.name,
            condition=dict(stimulus.condition),
            width_px=width,
            height_px=height,
            fps=recipe.frame_hz,
            bit_depth=8,
            seed=recipe.seed,
            parameters={**self.parameters(stimulus), "preview": self._has_previews},
            cache_key=key,
            frames_sha256=hashes,
        )
