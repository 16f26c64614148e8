"""Shows pictures to a gaze, with rings or a cut drawn in: the recipe `foveated-images`.

By itself it works in one process, where a GPU, or the threads of a software renderer, do the most;
with several workers in processes of its own, or on a cluster. `foveated_work` is what is done.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from concurrent.futures import Executor, Future
from contextlib import contextmanager
from functools import cached_property, lru_cache
from pathlib import Path
from time import perf_counter
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from pipeline.errors import InputError, MissingExtraError
from pipeline.foveation.conditions import check_condition_name, check_live, create_condition
from pipeline.foveation.drawn import ring_pixels
from pipeline.foveation.geometry import FlatGeometry
from pipeline.pictures.header import stated_size_px
from pipeline.pictures.stored_frames import file_sha256
from protocols.disk.hashing import Json
from protocols.display import Display
from protocols.errors import Problem, StudyError
from protocols.manifest import Clip, cache_key
from protocols.recipes.foveated_images import (
    BUILTIN,
    FoveatedImages,
    FoveatedStimulus,
    Rings,
    ShownMethod,
)
from protocols.study_file.schema import StudyProtocol
from stimuli.batch.estimate import free_bytes
from stimuli.batch.executors import dask_cluster, local_processes
from stimuli.batch.sources import source_sha256
from stimuli.recipes.base import BuildEstimate, BuildMachine
from stimuli.recipes.foveated_work import (
    STILLS,
    StillsPlan,
    colour_job,
    describe_job,
    still_job,
    wrong_picture_size,
)
from stimuli.recipes.single_stimuli import RESERVED, Made, SingleStimulusBuilder
from stimuli.scenes.builtin_pictures import NOTICES, check_picture_name, picture_modules
from stimuli.worker import RendererInfo

_SOURCES = ("stimuli.recipes.foveated_work", "pipeline.foveation.catalogue")
_SLOW = ("energy-metamer",)  # not tried for an estimate

T = TypeVar("T")


class _Here(Executor):
    """Works at once, in this process."""

    def submit(self, work: Callable[..., T], /, *arguments: Any, **named: Any) -> Future[T]:
        future: Future[T] = Future()
        try:
            future.set_result(work(*arguments, **named))
        except InputError as error:
            future.set_exception(error)
        return future


class FoveatedBuilder(SingleStimulusBuilder[FoveatedStimulus]):
    """Makes the stills of `foveated-images`."""

    def __init__(self, study: StudyProtocol, display: Display, folder: Path) -> None:
        super().__init__(study, display, folder)
        assert isinstance(study.stimuli, FoveatedImages)
        self.recipe = study.stimuli
        self.order = StillsPlan(self.recipe, display.distance_mm / display.pitch_x_mm, folder)

    @property
    def geometry(self) -> FlatGeometry:
        """The picture in the middle of the display, pixel for pixel."""
        return self.order.geometry

    def problems(self) -> list[Problem]:
        """Return conditions and parameters that are unknown, and rings that lie off the picture."""
        found = []
        for index, shown in enumerate(self.recipe.methods):
            where = f"stimuli.methods[{index}]"
            try:
                if self.recipe.live:
                    check_live(shown.condition, shown.parameters)
                create_condition(self.order.condition(shown), shown.parameters)
            except MissingExtraError:
                continue  # see `lacking`
            except (InputError, OSError) as error:
                found.append(Problem(where, str(error)))
                continue
            if self._takes_path(shown) and (self.recipe.rings or self.recipe.draws > 1):
                found.append(
                    Problem(
                        where,
                        "must not be made elsewhere where rings are drawn in or draws differ (a"
                        " file holds neither); leave them out, or choose another method",
                    )
                )
        for index, picture in enumerate(self.recipe.pictures):
            if picture.name in RESERVED:
                found.append(
                    Problem(f"stimuli.pictures[{index}].name", f"must not be {picture.name!r}")
                )
        found += self._unknown_pictures()
        if self.recipe.fit == "exact":
            wanted = self.recipe.width_px, self.recipe.height_px
            found += [
                Problem(where, f"{path}: {wrong_picture_size(wanted, got)}")
                for where, path, got in self._other_sizes()
            ]
        if self.recipe.rings is not None:
            found += self._rings_off(self.recipe.rings)
        return found

    def lacking(self) -> list[Problem]:
        """Return the conditions that need a package which is not installed."""
        found = []
        for index, shown in enumerate(self.recipe.methods):
            try:
                create_condition(self.order.condition(shown), shown.parameters)
            except MissingExtraError as error:
                found.append(
                    Problem(
                        f"stimuli.methods[{index}]",
                        f"{error}; to do without, leave {shown.name!r} out, here and where the"
                        " study names it",
                    )
                )
            except (InputError, OSError):
                continue  # see `problems`
        return found

    def _unknown_pictures(self) -> Iterator[Problem]:
        """Yield a problem for every built-in picture that does not exist."""
        for index, picture in enumerate(self.recipe.pictures):
            name = picture.file.removeprefix(BUILTIN)
            if name == picture.file:
                continue
            try:
                check_picture_name(name)
                if name == NOTICES and picture.view is not None:
                    raise InputError(f"{NOTICES!r} is a flat picture; leave view out")
            except InputError as error:
                yield Problem(f"stimuli.pictures[{index}].file", str(error))

    def notes(self) -> list[Problem]:
        """Return the pictures that `fit` enlarges."""
        found = []
        width, height = self.recipe.width_px, self.recipe.height_px
        for where, path, got in self._other_sizes() if self.recipe.fit == "cover" else ():
            share = max(width / got[0], height / got[1])
            if share > 1:
                found.append(
                    Problem(
                        where,
                        f"{path}: is {got[0]} x {got[1]} px and stills are {width} x {height}, so"
                        f" it is enlarged {share:.2f} times and lacks fine detail; take a larger"
                        " picture",
                    )
                )
        return found

    def _other_sizes(self) -> Iterator[tuple[str, Path, tuple[int, int]]]:
        """Yield each picture whose header says another size than the study: where, file, size."""
        wanted = self.recipe.width_px, self.recipe.height_px
        for index, picture in enumerate(self.recipe.pictures):
            if picture.view is not None or picture.file.startswith(BUILTIN):
                continue  # it is drawn in the study's size
            path = self.folder / picture.file
            got = stated_size_px(path, upright=True)
            if got is not None and got != wanted:
                yield f"stimuli.pictures[{index}].file", path, got

    def _rings_off(self, rings: Rings) -> list[Problem]:
        for one in self.wanted:
            if one.eccentricity_deg is None or one.polar_deg is None:
                continue
            try:
                ring_pixels(
                    self.geometry, self.order.gaze_px(one), one.eccentricity_deg, one.polar_deg,
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

    def estimate(self, out: Path, workers: int) -> BuildEstimate:  # noqa: ARG002
        """Make the first stimulus of every method twice, time the second, and multiply."""
        self.check_inputs()
        try:
            renderer = describe_job(self.order).renderer
            sizes: dict[str, float] = {}
            times: dict[str, float] = {}
            for one in self.wanted:
                if one.shown.name in times:
                    continue
                data: list[bytes | str] = [b""]
                started = perf_counter()
                for _ in range(0 if one.shown.condition in _SLOW else 2):
                    started = perf_counter()  # the first also builds passes
                    data, _ = still_job(self.order, one, None)
                times[one.shown.name] = perf_counter() - started
                sizes[one.shown.name] = len(data[0])
        finally:
            self.close()
        left_out = {one.shown.name for one in self.wanted if one.shown.condition in _SLOW}
        tried = " and ".join(name for name in times if name not in left_out)
        return BuildEstimate(
            clips=len(self.wanted),
            frames=len(self.wanted),
            size_px=(self.recipe.width_px, self.recipe.height_px),
            disk_bytes=round(1.05 * sum(sizes[one.shown.name] for one in self.wanted)),
            free_bytes=free_bytes(out),
            time_s=sum(times[one.shown.name] for one in self.wanted),
            renderer=renderer,
            measured=f"one stimulus by {tried or 'no method'}"
            + (f"; not counted: {' and '.join(sorted(left_out))}" if left_out else ""),
        )

    def check_inputs(self) -> None:
        """Refuse unknown conditions, files that are missing, rings that lie off the picture."""
        wrong = [*self.recipe.problems(self.folder), *self.problems(), *self.lacking()]
        if wrong:
            raise StudyError("\n".join(map(str, wrong)))

    @contextmanager
    def executor(self, where: BuildMachine) -> Iterator[tuple[Executor, int]]:
        """Executor: this process, several, or a cluster; and how many jobs it takes at once."""
        if where.scheduler is not None:
            with dask_cluster(where.scheduler, where.tls) as (cluster, workers):
                yield cluster, workers + 1
        elif where.workers is not None and where.workers > 1 and len(self.wanted) > 1:
            workers = min(where.workers, len(self.wanted))
            with local_processes(workers) as processes:
                yield processes, workers + 1
        else:
            yield _Here(), 1

    def drawn_by(self, executor: Executor) -> RendererInfo:
        """Ask a worker what it draws with."""
        return executor.submit(describe_job, self.order).result()

    def submit(self, executor: Executor, entry: FoveatedStimulus, work: Path) -> Future[Made]:
        """Have a still made; what takes minutes keeps its state beside the folder `work`."""
        return executor.submit(still_job, self.order, entry, work.with_suffix(".npz"))

    def close(self) -> None:
        """Free the GPU."""
        STILLS.close()

    def key(self, entry: FoveatedStimulus) -> str:
        """Return the hash of all that decides a stimulus's pixels."""
        recipe, shown = self.recipe, entry.shown
        rings, cuts = recipe.rings, recipe.cuts
        view = entry.picture.view
        return cache_key(
            {
                "file": self._picture_hash(entry),
                "view": None if view is None else [view.right_deg, view.down_deg],
                "size_px": [recipe.width_px, recipe.height_px],
                "fit": recipe.fit,
                "crop": list(recipe.kept(entry.picture)),
                "distance_px": self.geometry.distance_px,
                "gaze_deg": [entry.gaze.x_deg, entry.gaze.y_deg],
                "condition": shown.condition,
                "made_elsewhere": self._files(shown),
                "parameters": shown.model_dump(mode="json")["parameters"],
                "seed": entry.seed,
                "ring": None
                if rings is None
                else [
                    entry.eccentricity_deg, entry.polar_deg, entry.gap_deg, rings.height_deg,
                    rings.grey, rings.background, rings.rim_deg,
                ],
                "cut": None if cuts is None else [entry.cut_deg, cuts.ramp_deg],
                **({"live": True} if recipe.live else {}),
                "sources": source_sha256(*_SOURCES),
            }
        )  # fmt: skip

    def _picture_hash(self, entry: FoveatedStimulus) -> str:
        """Hash of what decides the scene: the file's bytes, or our sources of a built-in one."""
        name = entry.picture.file.removeprefix(BUILTIN)
        if name == entry.picture.file:
            return _file_hash(self.folder / entry.picture.file)
        return f"{name} {source_sha256(*picture_modules(name))}"

    def colour(self, entry: FoveatedStimulus) -> NDArray[np.float32]:
        """Return the still: encoded R'G'B', shape (H, W, 3)."""
        return colour_job(self.order, entry)

    @staticmethod
    def _takes_path(shown: ShownMethod) -> bool:
        return check_condition_name(shown.condition).takes_path

    def _files(self, shown: ShownMethod) -> dict[str, Json] | None:
        """Hashes of pictures that were made elsewhere; None where none are."""
        if not self._takes_path(shown):
            return None
        folder = Path(self.order.condition(shown).partition(":")[2])
        return {file.name: _file_hash(file) for file in sorted(folder.iterdir()) if file.is_file()}

    def record(self, entry: FoveatedStimulus, key: str, hashes: tuple[str, ...]) -> Clip:
        """Return its entry of the manifest."""
        x_px, y_px = self.order.gaze_px(entry)
        view = entry.picture.view
        looked = {} if view is None else {"right_deg": view.right_deg, "down_deg": view.down_deg}
        rings = self.recipe.rings
        around = {} if rings is None else {"background": rings.background}
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
                **looked,
                **around,
                "method": entry.shown.condition,
                "gaze_x_px": round(x_px, 3),
                "gaze_y_px": round(y_px, 3),
                "distance_px": round(self.geometry.distance_px, 3),
                "preview": False,
                **({"live": True} if self.recipe.live else {}),
                **entry.shown.parameters,
            },
            cache_key=key,
            frames_sha256=hashes,
        )


@lru_cache(maxsize=256)
def _hashed(path: Path, _changed_ns: int, _size: int) -> str:
    return file_sha256(path)


def _file_hash(path: Path) -> str:
    """A file's hash, read once while it does not change."""
    found = path.stat()
    return _hashed(path, found.st_mtime_ns, found.st_size)
