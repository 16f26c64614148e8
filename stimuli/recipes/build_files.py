"""Takes pictures and videos that were made elsewhere into hashed clips: the recipe `files`."""

from __future__ import annotations

from collections.abc import Iterator
from functools import cached_property
from pathlib import Path
from time import perf_counter

from pipeline.errors import InputError
from pipeline.pictures.stored_frames import (
    StimulusHeader,
    file_sha256,
    read_frames,
    stated,
    wrong_size,
)
from protocols.display import Display
from protocols.errors import Problem, StudyError
from protocols.manifest import Clip, cache_key
from protocols.recipes.files import FileEntry, Files
from protocols.study_file.schema import StudyProtocol
from stimuli.batch.estimate import free_bytes
from stimuli.batch.sources import source_sha256
from stimuli.media.png import encode_bytes
from stimuli.recipes.base import BuildEstimate
from stimuli.recipes.single_stimuli import RESERVED, SingleStimulusBuilder

_TOLD = 3
"""Number of files with a wrong header that are named one by one."""
_SOURCES = ("pipeline.pictures.stored_frames", "stimuli.media.png")


class FileBuilder(SingleStimulusBuilder[FileEntry]):
    """Checks and hashes files, in threads of this process."""

    def __init__(self, study: StudyProtocol, display: Display, folder: Path) -> None:
        super().__init__(study, display, folder)
        assert isinstance(study.stimuli, Files)
        self.recipe = study.stimuli

    def problems(self) -> list[Problem]:
        """Return names that folders of the batch have already, and files whose header is wrong.

        Only headers are read, and missing files are left to whoever needs them.
        """
        return [*self._reserved(), *self._wrong_headers()]

    def notes(self) -> list[Problem]:
        """Return statements of headers that are not followed, each with the first such file."""
        files: dict[str, list[str]] = {}
        for entry in self.recipe.entries:
            header = self._headers.get(entry.name)
            for note in header.notes if isinstance(header, StimulusHeader) else ():
                files.setdefault(note, []).append(entry.file)
        return [
            Problem(said[0] + (f" and {len(said) - 1} more" if len(said) > 1 else ""), note)
            for note, said in files.items()
        ]

    def _wrong_headers(self) -> Iterator[Problem]:
        size_px, wrong = (self.recipe.width_px, self.recipe.height_px), 0
        for index, entry in enumerate(self.recipe.entries):
            header = self._headers.get(entry.name, StimulusHeader(None))
            if isinstance(header, InputError):
                said = str(header)
            elif header.size_px is None or header.size_px == size_px:
                continue
            else:
                said = f"{self.folder / entry.file}: {wrong_size(size_px, header.size_px)}"
            wrong += 1
            if wrong <= _TOLD:
                yield Problem(self.recipe.place(index, "file"), said)
        if wrong > _TOLD:
            yield Problem("stimuli", f"{wrong - _TOLD} more files are of another size, or refused")

    @cached_property
    def _headers(self) -> dict[str, StimulusHeader | InputError]:
        """Header of every file that is here, or why it is refused, by name."""
        found: dict[str, StimulusHeader | InputError] = {}
        for entry in self.recipe.entries:
            path = self.folder / entry.file
            try:
                if path.exists():
                    found[entry.name] = stated(path, self.recipe.fps)
            except InputError as error:
                found[entry.name] = error
        return found

    def _reserved(self) -> list[Problem]:
        return [
            Problem(
                self.recipe.place(index, "name"),
                f"must not be {' or '.join(RESERVED)}, as a folder of every build is called (got"
                f" {entry.name!r}); rename the stimulus",
            )
            for index, entry in enumerate(self.recipe.entries)
            if entry.name in RESERVED
        ]

    @cached_property
    def wanted(self) -> tuple[FileEntry, ...]:
        """The stimuli that the study shows."""
        shown = set(self.protocol.shown())
        return tuple(entry for entry in self.recipe.entries if entry.name in shown)

    def estimate(self, out: Path, workers: int) -> BuildEstimate:
        """Read the first file, time it, and multiply; every other file must be there."""
        self.check_inputs()
        started = perf_counter()
        sizes = [len(data) for data in self.encoded(self.wanted[0])]
        time_s = (perf_counter() - started) * len(self.wanted)
        return BuildEstimate(
            clips=len(self.wanted),
            frames=len(self.wanted) * self.recipe.frames,
            size_px=(self.recipe.width_px, self.recipe.height_px),
            disk_bytes=round(1.05 * sum(sizes) * len(self.wanted)),
            free_bytes=free_bytes(out),
            time_s=time_s / max(1, workers),
            renderer=self.renderer.renderer,
            measured=f"reading {self.wanted[0].file}",
        )

    def check_inputs(self) -> None:
        """Every file that is missing, before anything is written."""
        if any(not (self.folder / entry.file).exists() for entry in self.wanted):
            raise StudyError("\n".join(map(str, self.recipe.problems(self.folder))))

    def key(self, entry: FileEntry) -> str:
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

    def encoded(self, entry: FileEntry) -> Iterator[bytes]:
        recipe = self.recipe
        size_px = recipe.width_px, recipe.height_px
        path = self.folder / entry.file
        return map(encode_bytes, read_frames(path, size_px, recipe.frames, recipe.fps))

    def record(self, entry: FileEntry, key: str, hashes: tuple[str, ...]) -> Clip:
        recipe, header = self.recipe, self._headers.get(entry.name)
        notes = header.notes if isinstance(header, StimulusHeader) else ()
        noted = {"noted": "; ".join(notes)} if notes else {}
        return Clip(
            name=entry.name,
            condition=dict(entry.condition),
            width_px=recipe.width_px,
            height_px=recipe.height_px,
            fps=recipe.frame_hz,
            bit_depth=8,
            seed=0,
            parameters={"file": entry.file, "preview": recipe.frames > 1, **noted},
            cache_key=key,
            frames_sha256=hashes,
        )
