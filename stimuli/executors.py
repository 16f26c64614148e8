"""Where jobs run: processes on this machine, or a Dask cluster."""

from __future__ import annotations

import importlib
import multiprocessing
import os
from collections.abc import Iterator
from concurrent.futures import Executor, ProcessPoolExecutor
from contextlib import contextmanager
from typing import Any, cast

from protocols.errors import StudyError
from stimuli.worker import start_worker

CONNECT_S = 10.0


def cores() -> int:
    """Return how many cores this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


class LocalProcesses(ProcessPoolExecutor):
    """Processes of our own; what they have written stays good when they are stopped."""

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


def _client(make: Any, address: str) -> Any:
    """Distributed is not typed."""
    return make(address, timeout=CONNECT_S, set_as_default=False)


@contextmanager
def dask_cluster(address: str) -> Iterator[tuple[Executor, int]]:
    """The workers of a running Dask cluster, and how many there are.

    Every worker must see the protocol's files and the output folder under the same paths.

    Raises
    ------
    StudyError
        If Dask is not installed, nothing answers, or the cluster has no worker.
    """
    try:
        from distributed import Client
    except ImportError:
        raise StudyError(
            "--scheduler needs Dask; install it with: pip install 'metamerlab[dask]'"
        ) from None
    try:
        client: Any = _client(Client, address)
    except (OSError, ValueError, TimeoutError) as error:
        raise StudyError(
            f"--scheduler {address}: must be the address of a running Dask scheduler"
            f" ({type(error).__name__}); start one with 'dask scheduler', or leave the option out"
        ) from None
    try:
        workers = len(client.scheduler_info(n_workers=-1)["workers"])
        if workers == 0:
            raise StudyError(
                f"--scheduler {address}: the cluster must have workers (it has none);"
                f" start some with 'dask worker {address}'"
            )
        try:  # so that workers, too, look for our packages in our folder first
            client.run(importlib.import_module, "metamerlab")
        except ImportError as error:
            raise StudyError(
                f"--scheduler {address}: every worker must have metamerlab ({error});"
                " install the version that runs here where they run"
            ) from None
        yield cast(Executor, client.get_executor(pure=False, retries=1)), workers
    finally:
        client.close()
