"""Builds scenes, warped along camera paths and filled: the recipe `warped-clips`."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack
from functools import cached_property
from pathlib import Path

from pipeline.errors import InputError
from pipeline.foveation.conditions import create_condition
from pipeline.methods.registry import check_method, check_method_name
from protocols.errors import Problem, StudyError
from protocols.recipes.warped_clips import BuiltinScene, ClipName, FillMethod
from stimuli.batch.build_plan import BuildPlan
from stimuli.recipes.base import Builder, BuildEstimate, BuildMachine, BuildOutcome, Report
from stimuli.recipes.warped_checks import SceneFindings, look_at_fills, look_at_scenes
from stimuli.scenes.builtin_scenes import scene_entry


class WarpedClipBuilder(Builder):
    """Renders, warps and fills in processes of its own, or on a cluster."""

    @cached_property
    def plan(self) -> BuildPlan:
        """Clips to make."""
        return BuildPlan(self.protocol, self.display, self.folder)

    def problems(self) -> list[Problem]:
        """Return methods and scenes that are not known, and files that cannot be used."""
        return [*self._names(), *self._scenes.wrong, *self._fills.wrong]

    def _names(self) -> Iterator[Problem]:
        """Yield methods and built-in scenes that are not known, and parameters that are not so."""
        recipe = self.protocol.warped
        for index, method in enumerate(recipe.methods):
            place, left = f"stimuli.methods[{index}]", dict(method.parameters)
            if not method.is_reference:
                try:
                    check_method_name(method.registry_name)
                except InputError as error:
                    place += ".method" if method.method else ".name"
                    yield Problem(place, f"{error}; the true view is 'reference'")
                    continue
            while said := _amiss(method, left):
                at_fault = (k for k in left if _amiss(method, _without(left, k)) != said)
                if (key := next(at_fault, None)) is None:
                    break  # a file of the method's, which has a check of its own
                yield Problem(f"{place}.parameters.{key}", said)
                del left[key]
        around = recipe.clips.periphery
        if around is not None:
            try:
                create_condition(around.condition, around.parameters)
            except InputError as error:
                yield Problem("stimuli.clips.periphery", str(error))
        for index, scene in enumerate(recipe.scenes):
            if isinstance(scene, BuiltinScene):
                try:
                    scene_entry(scene.builtin)
                except InputError as error:
                    yield Problem(f"stimuli.scenes[{index}].builtin", str(error))

    def notes(self) -> list[Problem]:
        """Return pairs that agree less than they should, and what files say and is not followed."""
        return [*self._scenes.doubtful, *self._fills.doubtful]

    def lacking(self) -> list[Problem]:
        """Return folders of frames and networks that are not here."""
        return self._fills.missing

    @cached_property
    def _scenes(self) -> SceneFindings:
        return look_at_scenes(self.plan)

    @cached_property
    def _fills(self) -> SceneFindings:
        return look_at_fills(self.plan)

    def _need_all(self) -> None:
        if self.lacking():
            raise StudyError("\n".join(map(str, self.lacking())))

    def estimate(self, out: Path, workers: int) -> BuildEstimate:
        """Make one frame of the first scene by every method, and multiply."""
        from stimuli.batch.estimate import estimated_build

        self._need_all()
        return estimated_build(self.plan, out, workers)

    def build(self, out: Path, where: BuildMachine, report: Report) -> BuildOutcome[ClipName]:
        """Build what is missing of the clips."""
        from stimuli.batch.build import build
        from stimuli.batch.executors import cores, dask_cluster, local_processes

        self._need_all()
        with ExitStack() as stack:
            if where.scheduler is not None:
                executor, parallel = stack.enter_context(dask_cluster(where.scheduler, where.tls))
            else:
                parallel = where.workers or min(cores(), len(self.plan.clip_names))
                executor = stack.enter_context(local_processes(parallel))
            return build(self.plan, out, executor, parallel=parallel, report=report)

    def summary(self, outcome: BuildOutcome[ClipName]) -> tuple[Sequence[str], list[Sequence[str]]]:
        """Return extent and holes of every scene and size."""
        from stimuli.batch.contact import extent_text

        rows: dict[str, Sequence[str]] = {}
        for clip in outcome.manifest.clips:
            least, most = (
                float(str(clip.parameters[f"hole_share_{end}"])) for end in ("least", "most")
            )
            rows.setdefault(
                f"{clip.column('scene')}, {clip.column('size')}",
                (
                    extent_text(clip),
                    f"{100 * (clip.hole_share or 0):.2f} %",
                    f"{100 * least:.2f} %",
                    f"{100 * most:.2f} %",
                    f"{clip.parameters['margin_px']} px",
                ),
            )
        header = ("scene, size", "extent", "holes", "least", "most", "margin")
        return header, [(name, *row) for name, row in rows.items()]


def _without(parameters: Mapping[str, object], key: str) -> dict[str, object]:
    return {name: value for name, value in parameters.items() if name != key}


def _amiss(method: FillMethod, parameters: Mapping[str, object]) -> str:
    """Return the first fault of a method's parameters; empty: none."""
    if method.is_reference:
        return f"the true view takes none (got {', '.join(parameters)})" if parameters else ""
    try:
        check_method(method.registry_name, parameters)
    except InputError as error:
        return str(error)
    return ""
