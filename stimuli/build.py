"""A batch: every clip of a study in one folder, resumable, in parallel, manifest last.

`stimuli.batch_folder` says what lies where while it runs.
"""

from __future__ import annotations

from concurrent.futures import FIRST_COMPLETED, Executor, Future, wait
from concurrent.futures.process import BrokenProcessPool
from pathlib import Path
from typing import Any

from pipeline.errors import InputError
from protocols.errors import StudyError
from protocols.folder_hold import only_build
from protocols.manifest import MANIFEST_NAME, Clip, write_manifest
from protocols.recipes.warped_clips import ClipName
from stimuli.batch_folder import (
    BUILD_FOLDER,
    HOLES_FOLDER,
    Outcome,
    Report,
    check_folder,
    claim,
    move_over,
    remove_strangers,
    remove_surveys,
    remove_unfinished,
    survey_name,
    sync,
)
from stimuli.clip import Survey, read_survey
from stimuli.derived import derive
from stimuli.executors import LocalProcesses
from stimuli.orders import Orders
from stimuli.preview import PREVIEW_FOLDER, preview_path
from stimuli.records import Records
from stimuli.worker import clip_job, describe_renderer, preview_job, survey_job

__all__ = ["HOLES_FOLDER", "Outcome", "Report", "build", "survey_name"]

WORDS = {"survey": "path of {1}", "clip": "{0}", "preview": "preview of {0}"}
KINDS = tuple(WORDS)  # of jobs, in the order of their turn
POLL_S = 0.25


def build(
    orders: Orders,
    out: Path,
    executor: Executor,
    *,
    parallel: int = 1,
    report: Report | None = None,
) -> Outcome[ClipName]:
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
        return _Batch(orders, out, executor, parallel, report or (lambda *_: None)).run()


class _Batch:
    def __init__(
        self, orders: Orders, out: Path, executor: Executor, parallel: int, report: Report
    ) -> None:
        self.orders, self.out, self.executor, self.report = orders, out, executor, report
        self.parallel = parallel
        self.work = out / BUILD_FOLDER
        self.records: dict[ClipName, Clip] = {}
        self.running: dict[Future[Any], tuple[str, ClipName]] = {}
        self.active: dict[ClipName, Path] = {}
        self.surveys: dict[str, Survey] = {}

    def run(self) -> Outcome[ClipName]:
        orders = self.orders
        names = [str(name) for name in orders.clip_names]
        check_folder(self.out, names)
        try:
            self.renderer = self.executor.submit(describe_renderer).result()
        except BrokenProcessPool:
            raise _worker_died() from None
        self.book = Records(orders, self.out, self.renderer)
        old = self.book.old()
        missing = []
        for name in orders.clip_names:
            if self.book.is_done(name, old.get(str(name))):
                self.records[name] = old[str(name)]
            else:
                missing.append(name)
        kept = list(self.records)
        manifest_path = self.out / MANIFEST_NAME
        if missing or self.book.is_stale(self._in_order()):
            keys = [key(name) for name in missing for key in (orders.survey_key, orders.clip_key)]
            claim(self.out, names, keys, exr=orders.protocol.warped.clips.exr)
            for record in self.records.values():
                self.book.store(record)  # what an old manifest says, before it goes
            manifest_path.unlink(missing_ok=True)  # from here on nothing looks finished
            sync(self.out)
        self._make(missing)
        remove_strangers(self.out, names)
        remove_surveys(self.out, [survey_name(name) for name in orders.clip_names])
        derive(
            orders.protocol,
            self.out,
            self._in_order(),
            lambda now: self.report(self._total, self._total, now),
            previews=orders.protocol.warped.clips.preview,
        )
        manifest = self.book.manifest(self._in_order())
        if not manifest_path.exists():
            write_manifest(self.out, manifest)
            sync(self.out)
        remove_unfinished(self.out)
        return Outcome(manifest, missing, kept)

    def _in_order(self) -> list[Clip]:
        """Return the clips that are there, in the order of the study."""
        return [self.records[name] for name in self.orders.clip_names if name in self.records]

    def _make(self, missing: list[ClipName]) -> None:
        """Survey, make clips, then previews, a few jobs ahead of the workers, scenes together.

        A worker keeps the scene that it opened last, so what belongs to the first scene comes
        before what belongs to the second.
        """
        self._total = len(self.orders.clip_names) * self.orders.protocol.warped.clips.frames
        self._rank = {name: rank for rank, name in enumerate(self.orders.clip_names)}
        groups: dict[str, list[ClipName]] = {}
        for name in missing:
            groups.setdefault(survey_name(name), []).append(name)
        ready = [("survey", names[0]) for names in groups.values()]
        ready += [("preview", name) for name in self.records if self._lacks_preview(name)]
        try:
            while ready or self.running:
                while ready and len(self.running) < self.parallel + 1:
                    ready.sort(key=self._order)
                    self._submit(*ready.pop(0))
                done, _ = wait(self.running, timeout=POLL_S, return_when=FIRST_COMPLETED)
                for future in done:
                    kind, name = self.running.pop(future)
                    try:
                        result = future.result()
                    except InputError as error:
                        raise InputError(_placed(name, str(error))) from None
                    if kind == "survey":
                        survey, renderer = result
                        self.book.check_renderer(renderer)
                        self._place_survey(name, survey)
                        self.surveys[survey_name(name)] = survey
                        ready += [("clip", member) for member in groups[survey_name(name)]]
                    elif kind == "clip":
                        hashes, renderer = result
                        self.book.check_renderer(renderer)
                        self._finish_clip(name, hashes)
                        ready += [("preview", name)] if self._lacks_preview(name) else []
                self._tell(len(ready))
        except BrokenProcessPool:
            raise _worker_died() from None
        finally:
            self._stop()

    def _stop(self) -> None:
        """After an error: no worker may write into the folder once it is let go."""
        for future in self.running:
            future.cancel()
        if self.running and isinstance(self.executor, LocalProcesses):
            self.executor.stop()
        wait([future for future in self.running if not future.cancelled()])

    def _order(self, job: tuple[str, ClipName]) -> tuple[int, int, int]:
        kind, name = job
        scenes = [scene.name for scene in self.orders.protocol.warped.scenes]
        return scenes.index(name.scene), KINDS.index(kind), self._rank[name]

    def _lacks_preview(self, name: ClipName) -> bool:
        wanted = self.orders.protocol.warped.clips.preview
        return wanted and not preview_path(self.out, self.records[name]).exists()

    def _submit(self, kind: str, name: ClipName) -> None:
        if kind == "survey":
            key = self.orders.survey_key(name)
            finished = self.out / HOLES_FOLDER / survey_name(name)
            unfinished = self.work / "surveys" / key
            folder = finished if read_survey(finished, key) is not None else unfinished
            future: Future[Any] = self.executor.submit(survey_job, self.orders, name, folder)
        elif kind == "preview":
            (self.out / PREVIEW_FOLDER).mkdir(exist_ok=True)
            future = self.executor.submit(preview_job, self.out, self.records[name])
        else:
            survey = self.surveys[survey_name(name)]
            folder = self.work / "clips" / self.orders.clip_key(name)
            self.active[name] = folder
            future = self.executor.submit(clip_job, self.orders, name, survey, folder)
        self.running[future] = (kind, name)

    def _place_survey(self, name: ClipName, survey: Survey) -> None:
        made = self.work / "surveys" / survey.key
        if made.exists():
            move_over(made, self.out / HOLES_FOLDER / survey_name(name), self.out)

    def _finish_clip(self, name: ClipName, hashes: list[str]) -> None:
        record = self.book.record(name, self.surveys[survey_name(name)], hashes)
        move_over(self.active.pop(name), self.out / str(name))
        self.book.store(record)
        self.records[name] = record

    def _tell(self, waiting: int) -> None:
        """Count frames on the disk: it is the same for processes here and elsewhere."""
        done = len(self.records) * self.orders.protocol.warped.clips.frames
        for folder in self.active.values():
            if folder.exists():
                done += sum(entry.suffix == ".png" for entry in folder.iterdir())
        now = [WORDS[kind].format(name, survey_name(name)) for kind, name in self.running.values()]
        shown = now[0] if now else "finishing"
        self.report(done, self._total, shown + (f" (+{len(now) + waiting - 1})" if now else ""))


def _placed(name: ClipName, said: str) -> str:
    """Say once where a mistake is, whatever of it the message says by itself."""
    where = f"{name.scene}, {name.size}"
    for known in (where, str(name)):
        if said.startswith(f"{known}: "):
            where, said = known, said.removeprefix(f"{known}: ")
    return f"{where}: {said.removeprefix(f'{name.scene}: ')}"


def _worker_died() -> StudyError:
    return StudyError(
        "a worker process was killed (out of memory?); nothing that it finished is lost:"
        " run the same command again, with fewer --workers if memory is short"
    )
