"""Takes pictures and videos that were made elsewhere into hashed clips: the recipe `files`."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from functools import cached_property
from pathlib import Path
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from protocols.errors import StudyError
from protocols.hashing import Json
from protocols.recipes.base import Stimulus
from protocols.recipes.files import Files
from protocols.units import Scalar
from stimuli.read_file import file_sha256, read_frames
from stimuli.recipes.frames import FrameBuilder


class FileBuilder(FrameBuilder):
    """Checks, decodes and hashes files; a stimulus is known by the hash of its file."""

    origin: ClassVar[str] = "none: files made elsewhere"
    modules: ClassVar[tuple[str, ...]] = ("stimuli.read_file",)

    @property
    def recipe(self) -> Files:
        """The study's recipe."""
        assert isinstance(self.protocol.stimuli, Files)
        return self.protocol.stimuli

    @cached_property
    def _files(self) -> dict[str, str]:
        return {entry.name: entry.file for entry in self.recipe.entries}

    def check(self) -> None:
        """Refuse files that are not there."""
        if any(not self._path(stimulus).exists() for stimulus in self.stimuli):
            raise StudyError("\n".join(map(str, self.recipe.problems(self.folder))))

    def inputs(self, stimulus: Stimulus) -> Mapping[str, Json]:
        """Return the hash of the file."""
        return {"file": file_sha256(self._path(stimulus))}

    def frames(self, stimulus: Stimulus) -> Iterator[NDArray[np.uint8]]:
        """Read the file."""
        recipe = self.recipe
        size_px = recipe.width_px, recipe.height_px
        return read_frames(self._path(stimulus), size_px, recipe.frames, recipe.fps)

    def parameters(self, stimulus: Stimulus) -> Mapping[str, Scalar]:
        """Return the file's name."""
        return {"file": self._files[stimulus.name]}

    def _path(self, stimulus: Stimulus) -> Path:
        return self.folder / self._files[stimulus.name]
