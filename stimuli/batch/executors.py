"""Executors of jobs: processes on this machine."""

from __future__ import annotations

import multiprocessing
import os
import sys
from collections.abc import Iterator
from concurrent.futures import Future, ProcessPoolExecutor
from contextlib import contextmanager
from types import ModuleType
from typing import Any

from stimuli.batch.jobs import start_worker


def cores() -> int:
    """Return the number of cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


class LocalProcesses(ProcessPoolExecutor):
    """Processes of our own; what they have written stays good when they are stopped.

    They run functions of modules, so they do not begin with the script that asks: without a main
    guard it would begin anew in each.
    """

    def submit(self, *call: Any, **named: Any) -> Future[Any]:
        """Start a process where one is missing, and hand it a call."""
        script, sys.modules["__main__"] = sys.modules["__main__"], ModuleType("__main__")
        try:
            return super().submit(*call, **named)
        finally:
            sys.modules["__main__"] = script

    def stop(self) -> None:
        """Kill them at once: a clip may take minutes, and nobody wants to wait for Ctrl-C."""
        for process in list((self._processes or {}).values()):
            process.kill()


@contextmanager
def local_processes(workers: int) -> Iterator[LocalProcesses]:
    """Processes that share the cores and die with this one."""
    pool = LocalProcesses(
        workers,
        mp_context=multiprocessing.get_context("spawn"),
        initializer=start_worker,
        initargs=(max(1, cores() // workers), os.getpid()),
    )
    try:
        yield pool
    finally:
        pool.shutdown(cancel_futures=True)
