"""A batch: every warped and filled clip of a study in one folder."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from concurrent.futures import Executor, Future
from pathlib import Path
from typing import Any, ClassVar

from pipeline.errors import InputError
from protocols.disk.locks import only_build
from protocols.manifest import Clip
from protocols.recipes.warped_clips import ClipName
from stimuli.batch.batch_folder import (
    BUILD_FOLDER,
    HOLES_FOLDER,
    BuildOutcome,
    Report,
    move_over,
    remove_surveys,
    survey_name,
)
from stimuli.batch.build_plan import BuildPlan
from stimuli.batch.clip import Survey, read_survey
from stimuli.batch.clip_build import ClipBuild, Job
from stimuli.batch.jobs import clip_job, describe_renderer, survey_job
from stimuli.batch.records import WarpedDraft

__all__ = ["HOLES_FOLDER", "BuildOutcome", "Report", "build", "survey_name"]


def build(
    plan: BuildPlan,
    out: Path,
    executor: Executor,
    *,
    parallel: int = 1,
    report: Report | None = None,
) -> BuildOutcome[ClipName]:
    """Build what is missing of a study's clips in `out`, then write the manifest.

    Parameters
    ----------
    executor : Executor
        Of local processes or a Dask cluster; `parallel` is how many jobs it runs at once.

    Raises
    ------
    StudyError
        If another build or a session uses the folder, it holds other things, a worker died, or the
        workers draw with different renderers.
    InputError, OSError
        As scenes, methods and the disk raise them. What was finished stays for the next run;
        there is no manifest then.
    """
    out.mkdir(parents=True, exist_ok=True)
    with only_build(out):
        return _WarpedBuild(plan, out, executor, parallel, report or (lambda *_: None)).run()


class _WarpedBuild(ClipBuild[ClipName]):
    """A survey of each scene and size, then its clips."""

    words: ClassVar = {"survey": "path of {0.scene}__{0.size}", **ClipBuild.words}

    def __init__(
        self, plan: BuildPlan, out: Path, executor: Executor, parallel: int, report: Report
    ) -> None:
        clips, names = plan.study.warped.clips, plan.clip_names
        super().__init__(plan.study, out, executor, parallel + 1, report, names, clips.frames)
        self.plan, self.previews, self.exr = plan, clips.preview, clips.exr
        self.draft: WarpedDraft
        self.surveys: dict[str, Survey] = {}
        self.groups: dict[str, list[ClipName]] = {}
        """Missing clips by their survey."""
        scenes = [scene.name for scene in plan.study.warped.scenes]
        self.scene_rank = {name: scenes.index(name.scene) for name in names}
        self.rank = {name: rank for rank, name in enumerate(names)}

    def open_draft(self) -> WarpedDraft:
        return WarpedDraft(self.plan, self.out, self.executor.submit(describe_renderer).result())

    def known(self, name: ClipName, old: Clip | None) -> Clip | None:
        return old if self.draft.is_done(name, old) else None

    def keys(self, missing: Sequence[ClipName]) -> Iterable[str]:
        plan = self.plan
        return [key(name) for name in missing for key in (plan.survey_key, plan.clip_key)]

    def first_jobs(self, missing: Sequence[ClipName]) -> list[Job[ClipName]]:
        for name in missing:
            self.groups.setdefault(survey_name(name), []).append(name)
        return [("survey", names[0]) for names in self.groups.values()]

    def turn(self, job: Job[ClipName]) -> tuple[int, ...]:
        kind, name = job
        return self.scene_rank[name], list(self.words).index(kind), self.rank[name]

    def submit(self, kind: str, name: ClipName) -> Future[Any]:
        work = self.out / BUILD_FOLDER
        if kind == "survey":
            key = self.plan.survey_key(name)
            finished = self.out / HOLES_FOLDER / survey_name(name)
            unfinished = work / "surveys" / key
            folder = finished if read_survey(finished, key) is not None else unfinished
            return self.executor.submit(survey_job, self.plan, name, folder)
        self.active[name] = work / "clips" / self.plan.clip_key(name)
        survey = self.surveys[survey_name(name)]
        return self.executor.submit(clip_job, self.plan, name, survey, self.active[name])

    def finish(self, kind: str, name: ClipName, job: Future[Any]) -> list[Job[ClipName]]:
        try:
            result = job.result()
        except InputError as error:
            raise InputError(_placed(name, str(error))) from None
        if kind == "preview":
            return []
        made, renderer = result
        if kind == "clip":
            record = self.draft.record(name, self.surveys[survey_name(name)], made)
            return self.place(name, record, renderer)
        self.draft.check_renderer(renderer)
        folder = self.out / BUILD_FOLDER / "surveys" / made.key
        if folder.exists():
            move_over(folder, self.out / HOLES_FOLDER / survey_name(name), self.out)
        self.surveys[survey_name(name)] = made
        return [("clip", member) for member in self.groups[survey_name(name)]]

    def check_all(self) -> None:
        remove_surveys(self.out, [survey_name(name) for name in self.names])


def _placed(name: ClipName, said: str) -> str:
    """Say once where a mistake is, whatever of it the message says by itself."""
    where = f"{name.scene}, {name.size}"
    for known in (where, str(name)):
        if said.startswith(f"{known}: "):
            where, said = known, said.removeprefix(f"{known}: ")
    return f"{where}: {said.removeprefix(f'{name.scene}: ')}"
