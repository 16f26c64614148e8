"""Shows pictures to a gaze, with rings or a cut drawn in: the recipe `foveated-images`.

On the GPU where there is one, in one process: a condition's passes are built once. The symbol is
drawn into the picture first; the condition is worked out for the very picture that holds it.
"""

from __future__ import annotations

import shutil
from collections.abc import Callable, Iterator
from concurrent.futures import Executor, Future
from functools import cached_property, lru_cache
from pathlib import Path
from time import perf_counter
from typing import Any, TypeVar

import cv2
import moderngl
import numpy as np
from numpy.typing import NDArray

from pipeline.errors import GLUnavailableError, InputError
from pipeline.foveation.condition import Look
from pipeline.foveation.conditions import Foveator, create_condition
from pipeline.foveation.drawn import bisected, draw_ring, ring_pixels
from pipeline.foveation.energy import EnergyMetamer
from pipeline.foveation.geometry import Flat, FlatGeometry
from pipeline.gl.context import create_context, describe, release_context
from pipeline.image_file import stated_size_px
from protocols.display import Display
from protocols.errors import Problem, StudyError
from protocols.manifest import Clip, cache_key
from protocols.recipes.foveated_images import (
    REFERENCE,
    FoveatedImages,
    FoveatedStimulus,
    Rings,
    Shown,
)
from protocols.schema import StudyProtocol
from stimuli.batch_folder import BUILD_FOLDER, Outcome, Report
from stimuli.foveated.any_picture import read_any
from stimuli.foveated.looking import read_gaze
from stimuli.png import encode_frame
from stimuli.read_file import file_sha256
from stimuli.recipes.base import Estimate, Where
from stimuli.recipes.taken import RESERVED, TakingBuilder
from stimuli.sources import source_sha256
from stimuli.worker import RendererInfo

NUMPY = RendererInfo("", "none: numpy", "")
_SOURCES = ("stimuli.recipes.foveated_images", "pipeline.foveation.catalogue")

T = TypeVar("T")


class _Here(Executor):
    """Works at once, in this thread: a context of OpenGL belongs to one."""

    def submit(self, work: Callable[..., T], /, *arguments: Any, **named: Any) -> Future[T]:
        future: Future[T] = Future()
        try:
            future.set_result(work(*arguments, **named))
        except InputError as error:
            future.set_exception(error)
        return future


class FoveatedBuilder(TakingBuilder[FoveatedStimulus]):
    """Makes the stills of `foveated-images` one after the other."""

    def __init__(self, protocol: StudyProtocol, display: Display, folder: Path) -> None:
        super().__init__(protocol, display, folder)
        assert isinstance(protocol.stimuli, FoveatedImages)
        self.recipe = protocol.stimuli
        self._ctx: moderngl.Context | None = None
        self._foveators: dict[str, Foveator] = {}
        self._pictures: dict[str, NDArray[np.float32]] = {}
        self._out = Path()
        self._report: Report | None = None
        self._made = 0

    @cached_property
    def geometry(self) -> FlatGeometry:
        """The picture in the middle of the display, pixel for pixel."""
        distance_px = self.display.distance_mm / self.display.pitch_x_mm
        return Flat(distance_px=distance_px).of(self.recipe.width_px, self.recipe.height_px)

    @cached_property
    def renderer(self) -> RendererInfo:  # type: ignore[override]
        """The GPU, or numpy where there is no OpenGL."""
        if self._ctx is None:
            try:
                self._ctx = create_context()
            except GLUnavailableError:
                return NUMPY
        found = describe(self._ctx)
        return RendererInfo(found.vendor, found.name, found.version)

    def problems(self) -> list[Problem]:
        """Return conditions and parameters that are unknown, and rings that lie off the picture."""
        found = []
        for index, shown in enumerate(self.recipe.methods):
            try:
                create_condition(shown.condition, self._parameters(shown))
            except (InputError, OSError) as error:
                found.append(Problem(f"stimuli.methods[{index}]", str(error)))
        for index, picture in enumerate(self.recipe.pictures):
            if picture.name in RESERVED:
                found.append(
                    Problem(f"stimuli.pictures[{index}].name", f"must not be {picture.name!r}")
                )
        if self.recipe.fit == "exact":
            found += self._wrong_sizes()
        if self.recipe.rings is not None:
            found += self._rings_off(self.recipe.rings)
        return found

    def _wrong_sizes(self) -> Iterator[Problem]:
        """Yield a problem for every picture whose header says another size."""
        wanted = self.recipe.width_px, self.recipe.height_px
        for index, picture in enumerate(self.recipe.pictures):
            path = self.folder / picture.file
            got = stated_size_px(path)
            # Sides the other way around: it may be stored turned, which reading it settles.
            if got is not None and got not in (wanted, wanted[::-1]):
                yield Problem(
                    f"stimuli.pictures[{index}].file", f"{path}: {_wrong_size(wanted, got)}"
                )

    def _rings_off(self, rings: Rings) -> list[Problem]:
        for one in self.wanted:
            if one.eccentricity_deg is None or one.polar_deg is None:
                continue
            try:
                ring_pixels(
                    self.geometry, self._gaze_px(one), one.eccentricity_deg, one.polar_deg,
                    rings.height_deg,
                )  # fmt: skip
            except InputError as error:
                return [Problem("stimuli.rings", f"{one.name}: {error}")]
        return []

    @cached_property
    def wanted(self) -> tuple[FoveatedStimulus, ...]:
        """The stimuli that the study shows."""
        shown = set(self.protocol.shown())
        return tuple(one for one in self.recipe.stimuli() if one.name in shown)

    def estimate(self, out: Path, workers: int) -> Estimate:  # noqa: ARG002
        """Make the first stimulus of every method, time them, and multiply."""
        self.check_inputs()
        try:
            renderer = self.renderer.renderer
            sizes: dict[str, float] = {}
            times: dict[str, float] = {}
            for one in self.wanted:
                if one.shown.name not in times:
                    # The second one: the first also builds passes.
                    data = list(self.encoded(one)) if self._is_quick(one.shown) else []
                    started = perf_counter()
                    data = list(self.encoded(one)) if data else [b""]
                    times[one.shown.name] = perf_counter() - started
                    sizes[one.shown.name] = len(data[0])
        finally:
            self.close()
        there = next(place for place in (out, *out.absolute().parents) if place.exists())
        return Estimate(
            clips=len(self.wanted),
            frames=len(self.wanted),
            size_px=(self.recipe.width_px, self.recipe.height_px),
            disk_bytes=round(1.05 * sum(sizes[one.shown.name] for one in self.wanted)),
            free_bytes=shutil.disk_usage(there).free,
            time_s=sum(times[one.shown.name] for one in self.wanted),
            renderer=renderer,
        )

    def build(self, out: Path, where: Where, report: Report) -> Outcome[str]:
        """Make what is missing or changed; see `TakingBuilder.build`."""
        self._out, self._report, self._made = out, report, 0
        return super().build(out, where, report)

    def check_inputs(self) -> None:
        """Refuse unknown conditions, files that are missing, rings that lie off the picture."""
        wrong = [*self.recipe.problems(self.folder), *self.problems()]
        if wrong:
            raise StudyError("\n".join(map(str, wrong)))

    def executor(self, _workers: int) -> Executor:
        """This thread."""
        return _Here()

    def close(self) -> None:
        """Free the GPU."""
        for foveator in self._foveators.values():
            foveator.release()
        self._foveators.clear()
        if self._ctx is not None:
            release_context(self._ctx)
            self._ctx = None
            self.__dict__.pop("renderer", None)

    def key(self, entry: FoveatedStimulus) -> str:
        """Return the hash of all that decides a stimulus's pixels."""
        recipe, shown = self.recipe, entry.shown
        rings, cuts = recipe.rings, recipe.cuts
        return cache_key(
            {
                "file": _file_hash(self.folder / entry.picture.file),
                "size_px": [recipe.width_px, recipe.height_px],
                "fit": recipe.fit,
                "distance_px": self.geometry.distance_px,
                "gaze_deg": [entry.gaze.x_deg, entry.gaze.y_deg],
                "condition": shown.condition,
                "parameters": shown.model_dump(mode="json")["parameters"],
                "seed": entry.seed,
                "ring": None
                if rings is None
                else [
                    entry.eccentricity_deg, entry.polar_deg, entry.gap_deg, rings.height_deg,
                    rings.grey,
                ],
                "cut": None if cuts is None else [entry.cut_deg, cuts.ramp_deg],
                "sources": source_sha256(*_SOURCES),
            }
        )  # fmt: skip

    def encoded(self, entry: FoveatedStimulus) -> Iterator[bytes]:
        """Make a still."""
        yield encode_frame(self.colour(entry), 8)
        self._made += 1
        if self._report is not None:
            self._report(self._made, len(self.wanted), entry.name)

    def colour(self, entry: FoveatedStimulus) -> NDArray[np.float32]:
        """Return the still: encoded R'G'B', shape (H, W, 3)."""
        plain = self._with_ring(self._picture(entry.picture.file), entry)
        if entry.shown.condition == REFERENCE:
            return plain
        shown = self._foveated(plain, entry)
        if entry.cut_deg is None or self.recipe.cuts is None:
            return shown
        return bisected(
            shown, plain, self.geometry, self._gaze_px(entry),
            angle_deg=entry.cut_deg, ramp_deg=self.recipe.cuts.ramp_deg,
        )  # fmt: skip

    def record(self, entry: FoveatedStimulus, key: str, hashes: tuple[str, ...]) -> Clip:
        """Return what the manifest says of it."""
        x_px, y_px = self._gaze_px(entry)
        return Clip(
            name=entry.name,
            condition=dict(entry.condition),
            width_px=self.recipe.width_px,
            height_px=self.recipe.height_px,
            fps=1.0,
            bit_depth=8,
            seed=entry.seed,
            parameters={
                "file": entry.picture.file,
                "method": entry.shown.condition,
                "gaze_x_px": round(x_px, 3),
                "gaze_y_px": round(y_px, 3),
                "distance_px": round(self.geometry.distance_px, 3),
                "preview": False,
                **entry.shown.parameters,
            },
            cache_key=key,
            frames_sha256=hashes,
        )

    def _gaze_px(self, entry: FoveatedStimulus) -> tuple[float, float]:
        return read_gaze(f"{entry.gaze.x_deg}deg,{entry.gaze.y_deg}deg", self.geometry)

    def _parameters(self, shown: Shown) -> dict[str, Any]:
        return dict(shown.parameters)

    def _is_quick(self, shown: Shown) -> bool:
        return shown.condition != "energy-metamer"

    def _with_ring(
        self, picture: NDArray[np.float32], entry: FoveatedStimulus
    ) -> NDArray[np.float32]:
        rings = self.recipe.rings
        if rings is None or entry.eccentricity_deg is None or entry.polar_deg is None:
            return picture
        return draw_ring(
            picture, self.geometry, self._gaze_px(entry),
            eccentricity_deg=entry.eccentricity_deg, polar_deg=entry.polar_deg,
            height_deg=rings.height_deg, gap_deg=entry.gap_deg, grey=rings.grey,
        )  # fmt: skip

    def _foveated(
        self, picture: NDArray[np.float32], entry: FoveatedStimulus
    ) -> NDArray[np.float32]:
        shown = entry.shown
        foveator = self._foveators.get(shown.name)
        if foveator is None:
            _ = self.renderer
            foveator = Foveator(
                (self.recipe.height_px, self.recipe.width_px),
                viewing=Flat(distance_px=self.geometry.distance_px),
                method=shown.condition,
                ctx=self._ctx,
                **self._parameters(shown),
            )
            self._foveators[shown.name] = foveator
        condition = foveator.condition
        if isinstance(condition, EnergyMetamer):
            state = self._out / BUILD_FOLDER / f"{self.key(entry)}.npz"
            state.parent.mkdir(parents=True, exist_ok=True)
            look = Look(self.geometry, self._gaze_px(entry), entry.seed)
            made = condition.descend(picture, look, state=state)
            state.unlink(missing_ok=True)
            return made
        return foveator(picture, self._gaze_px(entry), seed=entry.seed)

    def _picture(self, file: str) -> NDArray[np.float32]:
        if file not in self._pictures:
            self._pictures.clear()  # scene by scene
            self._pictures[file] = self._fitted(self.folder / file)
        return self._pictures[file]

    def _fitted(self, path: Path) -> NDArray[np.float32]:
        colour = read_any(path).colour
        height, width = self.recipe.height_px, self.recipe.width_px
        if colour.shape[:2] == (height, width):
            return colour
        if self.recipe.fit == "exact":
            got = colour.shape[1], colour.shape[0]
            raise InputError(f"{path}: {_wrong_size((width, height), got)}")
        share = max(height / colour.shape[0], width / colour.shape[1])
        across, down = (round(share * edge) for edge in colour.shape[1::-1])
        size = max(width, across), max(height, down)
        how = cv2.INTER_AREA if share < 1 else cv2.INTER_CUBIC
        scaled = np.clip(np.asarray(cv2.resize(colour, size, interpolation=how)), 0, 1)
        top, left = (size[1] - height) // 2, (size[0] - width) // 2
        return np.ascontiguousarray(scaled[top : top + height, left : left + width], np.float32)


@lru_cache(maxsize=256)
def _hashed(path: Path, _changed_ns: int, _size: int) -> str:
    return file_sha256(path)


def _file_hash(path: Path) -> str:
    """A file's hash, read once while it does not change."""
    found = path.stat()
    return _hashed(path, found.st_mtime_ns, found.st_size)


def _wrong_size(wanted: tuple[int, int], got: tuple[int, int]) -> str:
    return (
        f"must be {wanted[0]} x {wanted[1]} px, as the study says (is {got[0]} x {got[1]}); cut it,"
        ' or write fit = "cover"'
    )
