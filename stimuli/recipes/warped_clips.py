"""Builds scenes, warped along camera paths and filled: the recipe `warped-clips`."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack
from functools import cached_property
from pathlib import Path

from pipeline.errors import InputError
from pipeline.methods.registry import RETIRED, check_method, method_names
from protocols.errors import Problem, StudyError
from protocols.recipes.warped_clips import ClipName, Method
from protocols.registries import check_methods, check_scenes
from stimuli.orders import Orders
from stimuli.recipes.base import Builder, Estimate, Outcome, Report, Where
from stimuli.recipes.warped_checks import Findings, look_at_fills, look_at_scenes
from stimuli.scenes.registry import scene_names


class WarpedClipBuilder(Builder):
    """Renders, warps and fills in processes of its own, or on a cluster."""

    @cached_property
    def orders(self) -> Orders:
        """What is to be made."""
        return Orders(self.protocol, self.display, self.folder)

    def problems(self) -> list[Problem]:
        """Return methods and scenes that are not known, and files that cannot be used."""
        return [
            *check_methods(self.protocol, method_names(), RETIRED),
            *self._parameters(),
            *check_scenes(self.protocol, scene_names()),
            *self._scenes.wrong,
            *self._fills.wrong,
        ]

    def _parameters(self) -> Iterator[Problem]:
        """Yield parameters that methods do not take, or not with such values."""
        for index, method in enumerate(self.protocol.warped.methods):
            left = dict(method.parameters)
            while said := _amiss(method, left):
                at_fault = (
                    key
                    for key in left
                    if _amiss(method, {k: v for k, v in left.items() if k != key}) != said
                )
                if (key := next(at_fault, None)) is None:
                    break  # its name or a file of it, which have checks of their own
                yield Problem(f"stimuli.methods[{index}].parameters.{key}", said)
                del left[key]

    def notes(self) -> list[Problem]:
        """Return pairs that agree less than they should, and what files say and is not followed."""
        return [*self._scenes.doubtful, *self._fills.doubtful]

    def lacking(self) -> list[Problem]:
        """Return folders of frames and networks that are not here."""
        return self._fills.missing

    @cached_property
    def _scenes(self) -> Findings:
        return look_at_scenes(self.orders)

    @cached_property
    def _fills(self) -> Findings:
        return look_at_fills(self.orders)

    def _need_all(self) -> None:
        if self.lacking():
            raise StudyError("\n".join(map(str, self.lacking())))

    def estimate(self, out: Path, workers: int) -> Estimate:
        """Make one frame of the first scene by every method, and multiply."""
        from stimuli.estimate import estimate

        self._need_all()
        return estimate(self.orders, out, workers)

    def build(self, out: Path, where: Where, report: Report) -> Outcome[ClipName]:
        """Build what is missing of the clips."""
        from stimuli.build import build
        from stimuli.executors import cores, dask_cluster, local_processes

        self._need_all()
        with ExitStack() as stack:
            if where.scheduler is not None:
                executor, parallel = stack.enter_context(dask_cluster(where.scheduler, where.tls))
            else:
                parallel = where.workers or min(cores(), len(self.orders.clip_names))
                executor = stack.enter_context(local_processes(parallel))
            return build(self.orders, out, executor, parallel=parallel, report=report)

    def summary(self, outcome: Outcome[ClipName]) -> tuple[Sequence[str], list[Sequence[str]]]:
        """Return extent and holes of every scene and size."""
        from stimuli.contact import extent_text

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


def _amiss(method: Method, parameters: Mapping[str, object]) -> str:
    """Return what is wrong with a method's parameters first; empty: nothing."""
    if method.is_reference:
        return f"the true view takes none (got {', '.join(parameters)})" if parameters else ""
    try:
        check_method(method.registry_name, parameters)
    except InputError as error:
        return str(error)
    return ""
