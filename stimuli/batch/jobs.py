"""Jobs of a worker process: surveys, clips and previews, one at a time, with one GL context.

The same functions run in local processes and on a Dask cluster; folders lie on a disk that
all of them see.
"""

from __future__ import annotations

import ctypes
import os
import signal
import sys
from pathlib import Path

from pipeline.errors import print_notes
from pipeline.gl.context import release_context
from protocols.manifest import Clip
from protocols.recipes.warped_clips import ClipName
from stimuli.batch.build_plan import BuildPlan
from stimuli.batch.clip import Survey, make_frames, take_survey
from stimuli.media.video import preview_path, write_preview
from stimuli.rendering.open_scene import open_scenery
from stimuli.rendering.scenery import Scenery
from stimuli.worker import GpuThread, RendererInfo, context_or_numpy

_PR_SET_PDEATHSIG = 1


class SceneContext:
    """A context and the scene that was opened last: clips of one scene come together."""

    def __init__(self) -> None:
        self.ctx, self.renderer = context_or_numpy()
        self._key: tuple[str, str] | None = None
        self._scenery: Scenery | None = None

    def scenery(self, plan: BuildPlan, clip: ClipName) -> Scenery:
        """Return the clip's scene, opened."""
        scene = plan.scene(clip)
        key = (str(plan.folder), scene.model_dump_json())
        if self._scenery is None or self._key != key:
            self._drop()
            self._scenery, self._key = open_scenery(self.ctx, scene, plan.folder), key
        return self._scenery

    def release(self) -> None:
        """Free everything."""
        self._drop()
        if self.ctx is not None:
            release_context(self.ctx)

    def _drop(self) -> None:
        if self._scenery is not None:
            self._scenery.release()
        self._scenery, self._key = None, None


SCENES: GpuThread[None, SceneContext] = GpuThread(lambda _: SceneContext())


def start_worker(threads_per_worker: int, parent: int) -> None:
    """Prepare a local worker: it dies with its parent, and leaves Ctrl-C to it."""
    if sys.platform == "linux":
        ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGKILL)
    if os.getppid() != parent:  # the parent was gone before the line above
        os._exit(1)
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    if sys.platform != "win32":  # a terminal that closes tells all, and the parent ends them
        signal.signal(signal.SIGHUP, signal.SIG_IGN)
    os.environ.setdefault("LP_NUM_THREADS", str(threads_per_worker))
    print_notes(lambda line: print(line, file=sys.stderr))


def describe_renderer() -> RendererInfo:
    """Name this worker's renderer."""
    return SCENES.do(None, lambda scenes: scenes.renderer)


def survey_job(plan: BuildPlan, clip: ClipName, folder: Path) -> tuple[Survey, RendererInfo]:
    """Survey a scene and size into `folder`."""

    def job(scenes: SceneContext) -> tuple[Survey, RendererInfo]:
        scenery = scenes.scenery(plan, clip)
        return take_survey(scenes.ctx, scenery, plan, clip, folder), scenes.renderer

    return SCENES.do(None, job)


def clip_job(
    plan: BuildPlan, clip: ClipName, survey: Survey, folder: Path
) -> tuple[list[str], RendererInfo]:
    """Make the frames of a clip in `folder`; return their hashes."""

    def job(scenes: SceneContext) -> tuple[list[str], RendererInfo]:
        scenery = scenes.scenery(plan, clip)
        return make_frames(scenes.ctx, scenery, plan, clip, survey, folder), scenes.renderer

    return SCENES.do(None, job)


def preview_job(out: Path, clip: Clip) -> None:
    """Write the preview of a finished clip."""
    write_preview(out, clip, preview_path(out, clip))
