"""What a worker process does: surveys, clips and previews, one at a time, with one GL
context.

The same functions run in local processes and on a Dask cluster; folders lie on a disk that
all of them see.
"""

from __future__ import annotations

import ctypes
import os
import signal
import sys
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

import moderngl

from pipeline.errors import print_notes
from pipeline.gl.context import create_context, describe, release_context
from protocols.manifest import Clip
from protocols.recipes.warped_clips import ClipName
from stimuli.clip import Survey, make_frames, take_survey
from stimuli.open_scene import open_scenery
from stimuli.orders import Orders
from stimuli.preview import preview_path, write_preview
from stimuli.scenery import Scenery

_PR_SET_PDEATHSIG = 1


@dataclass(frozen=True)
class RendererInfo:
    """What draws in a worker."""

    vendor: str
    renderer: str
    version: str


class Bench:
    """A context and the scene that was opened last: clips of one scene come together."""

    def __init__(self) -> None:
        self.ctx: moderngl.Context = create_context()
        self._key: tuple[str, str] | None = None
        self._scenery: Scenery | None = None

    def scenery(self, orders: Orders, clip: ClipName) -> Scenery:
        """Return the clip's scene, opened."""
        scene = orders.scene(clip)
        key = (str(orders.folder), scene.model_dump_json())
        if self._scenery is None or self._key != key:
            self._drop()
            self._scenery, self._key = open_scenery(self.ctx, scene, orders.folder), key
        return self._scenery

    def release(self) -> None:
        """Free everything."""
        self._drop()
        release_context(self.ctx)

    def _drop(self) -> None:
        if self._scenery is not None:
            self._scenery.release()
        self._scenery, self._key = None, None


class _Station:
    """The one bench of this process, and the one thread that may touch its context."""

    def __init__(self) -> None:
        self.thread = ThreadPoolExecutor(1, thread_name_prefix="bench")
        self.bench: Bench | None = None

    def open_bench(self) -> Bench:
        if self.bench is None:
            self.bench = Bench()
        return self.bench


_station: list[_Station] = []  # per process: contexts cannot be sent to workers


def _here() -> _Station:
    if not _station:
        _station.append(_Station())
    return _station[0]


def close_bench() -> None:
    """Free this process's bench, if it has one; the next job opens another."""
    station = _here()
    if station.bench is not None:
        station.thread.submit(station.bench.release).result()
        station.bench = None


def start_worker(threads_per_worker: int, parent: int) -> None:
    """Prepare a local worker: it dies with its parent, and leaves Ctrl-C to it."""
    if sys.platform == "linux":
        ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGKILL)
    if os.getppid() != parent:  # the parent was gone before the line above
        os._exit(1)
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    os.environ.setdefault("LP_NUM_THREADS", str(threads_per_worker))
    print_notes(lambda line: print(line, file=sys.stderr))


def describe_renderer() -> RendererInfo:
    """Name this worker's renderer."""

    def job() -> RendererInfo:
        found = describe(_here().open_bench().ctx)
        return RendererInfo(found.vendor, found.name, found.version)

    return _here().thread.submit(job).result()


def survey_job(orders: Orders, clip: ClipName, folder: Path) -> tuple[Survey, RendererInfo]:
    """Survey a scene and size into `folder`."""

    def job() -> Survey:
        bench = _here().open_bench()
        return take_survey(bench.ctx, bench.scenery(orders, clip), orders, clip, folder)

    return _here().thread.submit(job).result(), describe_renderer()


def clip_job(
    orders: Orders, clip: ClipName, survey: Survey, folder: Path
) -> tuple[list[str], RendererInfo]:
    """Make the frames of a clip in `folder`; return their hashes."""

    def job() -> list[str]:
        bench = _here().open_bench()
        scenery = bench.scenery(orders, clip)
        return make_frames(bench.ctx, scenery, orders, clip, survey, folder)

    return _here().thread.submit(job).result(), describe_renderer()


def preview_job(out: Path, clip: Clip) -> None:
    """Write the preview of a finished clip."""
    write_preview(out, clip, preview_path(out, clip))
