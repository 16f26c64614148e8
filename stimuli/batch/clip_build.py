"""A build of clips in one folder, whatever they are made of: resumable, parallel, manifest last.

`stimuli.batch.batch_folder` says what lies where while it runs. Jobs run in threads, processes or
on a cluster, one more than there are workers; moving and noting is done here.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from concurrent.futures import FIRST_COMPLETED, Executor, Future, wait
from concurrent.futures.process import BrokenProcessPool
from pathlib import Path
from typing import Any, ClassVar, Generic, TypeVar

from protocols.disk.whole_file import remove, sync_folder
from protocols.errors import StudyError
from protocols.manifest import MANIFEST_NAME, Clip, write_manifest
from protocols.study_file.schema import StudyProtocol
from stimuli.batch.batch_folder import (
    BuildOutcome,
    Report,
    check_batch_folder,
    claim,
    move_over,
    remove_previews,
    remove_strangers,
    remove_unfinished,
)
from stimuli.batch.contact import SHEET_NAME, write_contact_sheet
from stimuli.batch.executors import LocalProcesses
from stimuli.batch.jobs import preview_job
from stimuli.batch.records import ManifestDraft
from stimuli.media.video import PREVIEW_FOLDER, preview_path
from stimuli.worker import RendererInfo

POLL_S = 0.25

N = TypeVar("N")
Job = tuple[str, N]
"""Kind, ``clip``, ``preview`` or one of a recipe's own, and the clip."""


class ClipBuild(Generic[N]):
    """A build of the clips `names`; what they are made of is for each recipe to say.

    Parameters
    ----------
    executor : Executor
        Of threads, local processes or a Dask cluster; `places` is how many jobs it is given at
        once.
    names : sequence
        The clips, in the order of the study; ``str`` gives the name of a clip's folder.
    frames : int
        Of each clip.
    """

    words: ClassVar = {"clip": "{}", "preview": "preview of {}"}
    """Report of each kind of job."""

    def __init__(
        self, study: StudyProtocol, out: Path, executor: Executor, places: int, report: Report,
        names: Sequence[N], frames: int,
    ) -> None:  # fmt: skip
        self.study, self.out, self.executor, self.places = study, out, executor, places
        self.report, self.names, self.frames = report, names, frames
        self.total = len(names) * frames
        self.draft: ManifestDraft
        self.records: dict[N, Clip] = {}
        self.running: dict[Future[Any], Job[N]] = {}
        self.active: dict[N, Path] = {}
        """Folders in which clips grow."""
        self.previews, self.exr = False, False

    # For a recipe to say

    def open_draft(self) -> ManifestDraft:
        """Return the records, for the renderer of the workers."""
        raise NotImplementedError

    def known(self, name: N, old: Clip | None) -> Clip | None:
        """Return the record of a clip that is there whole, made from what is wanted now."""
        raise NotImplementedError

    def keys(self, missing: Sequence[N]) -> Iterable[str]:
        """Return the hashes that unfinished work on these clips is named by."""
        raise NotImplementedError

    def first_jobs(self, missing: Sequence[N]) -> list[Job[N]]:
        """Return the jobs that wait for no other."""
        return [("clip", name) for name in missing]

    def turn(self, job: Job[N]) -> tuple[int, ...]:  # noqa: ARG002
        """Return the key by which a waiting job is next: the least, the earliest of equals.

        Clips that share a scene should come in a row: a worker keeps the one that it opened last.
        """
        return ()

    def submit(self, kind: str, name: N) -> Future[Any]:
        """Hand a job to the workers, with its folder in `active`."""
        raise NotImplementedError

    def finish(self, kind: str, name: N, job: Future[Any]) -> list[Job[N]]:
        """Take the result of a job, and return the jobs that waited for it."""
        raise NotImplementedError

    def check_all(self) -> None:
        """Refuse after the last job what could not be made; remove what is no more."""

    # What every build does

    def run(self) -> BuildOutcome[N]:
        """Build what is missing, then write the manifest.

        Raises
        ------
        StudyError
            If the folder holds other things, a worker died, or the workers draw with different
            renderers.
        InputError, OSError
            As the jobs raise them. What was finished stays for the next run; there is no manifest
            then.
        """
        try:
            return self._run()
        except BrokenProcessPool:
            raise StudyError(
                "a worker process was killed (out of memory?); nothing that it finished is lost:"
                " run the same command again, with fewer --workers if memory is short"
            ) from None

    def _run(self) -> BuildOutcome[N]:
        names = [str(name) for name in self.names]
        check_batch_folder(self.out, names)
        self.draft = self.open_draft()
        old = self.draft.old()
        for name in self.names:
            if record := self.known(name, old.get(str(name))):
                self.records[name] = record
        kept = list(self.records)
        missing = [name for name in self.names if name not in self.records]
        manifest_path = self.out / MANIFEST_NAME
        if missing or self.draft.is_stale(self.clips()):
            claim(self.out, names, self.keys(missing), exr=self.exr)
            for record in self.records.values():
                self.draft.store(record)  # what an old manifest says, before it goes
            remove(manifest_path)  # from here on nothing looks finished
            sync_folder(self.out)
        self._work(missing)
        self.check_all()
        remove_strangers(self.out, names)
        clips = self.clips()
        kept_previews = {preview_path(self.out, clip).name for clip in clips if self.previews}
        remove_previews(self.out, kept_previews)
        self.report(self.total, self.total, "contact sheet")
        if not manifest_path.exists() or not (self.out / SHEET_NAME).exists():
            write_contact_sheet(self.out, self.study, clips)
        manifest = self.draft.manifest(clips)
        if not manifest_path.exists():
            write_manifest(self.out, manifest)
            sync_folder(self.out)
        remove_unfinished(self.out)
        return BuildOutcome(manifest, missing, kept)

    def clips(self) -> list[Clip]:
        """Return the clips that are there, in the order of the study."""
        return [self.records[name] for name in self.names if name in self.records]

    def place(self, name: N, record: Clip, renderer: RendererInfo) -> list[Job[N]]:
        """Move a clip that is whole to its folder and note it; return the job of its preview."""
        self.draft.check_renderer(renderer)
        move_over(self.active.pop(name), self.out / str(name))
        self.draft.store(record)
        self.records[name] = record
        return self._preview(name)

    def _preview(self, name: N) -> list[Job[N]]:
        there = not self.previews or preview_path(self.out, self.records[name]).exists()
        return [] if there else [("preview", name)]

    def _work(self, missing: Sequence[N]) -> None:
        ready = self.first_jobs(missing)
        for name in list(self.records):
            ready += self._preview(name)
        try:
            while ready or self.running:
                while ready and len(self.running) < self.places:
                    ready.sort(key=self.turn)
                    kind, name = ready.pop(0)
                    if kind == "preview":
                        (self.out / PREVIEW_FOLDER).mkdir(exist_ok=True)
                        job = self.executor.submit(preview_job, self.out, self.records[name])
                    else:
                        job = self.submit(kind, name)
                    self.running[job] = kind, name
                done, _ = wait(self.running, timeout=POLL_S, return_when=FIRST_COMPLETED)
                for job in done:
                    kind, name = self.running.pop(job)
                    ready += self.finish(kind, name, job)
                self._tell(len(ready))
        finally:
            for job in self.running:
                job.cancel()
            if self.running and isinstance(self.executor, LocalProcesses):
                self.executor.stop()
            # No worker may write into the folder once it is let go.
            wait([job for job in self.running if not job.cancelled()])

    def _tell(self, waiting: int) -> None:
        """Count frames on the disk: it is the same for processes here and elsewhere."""
        done = len(self.records) * self.frames
        for folder in self.active.values():
            if folder.exists():
                done += sum(entry.suffix == ".png" for entry in folder.iterdir())
        now = [self.words[kind].format(name) for kind, name in self.running.values()]
        shown = now[0] if now else "finishing"
        self.report(done, self.total, shown + (f" (+{len(now) + waiting - 1})" if now else ""))
