"""Executors of jobs: processes on this machine, or a Dask cluster."""

from __future__ import annotations

import asyncio
import importlib
import logging
import multiprocessing
import os
import sys
from collections.abc import Iterator, Mapping
from concurrent.futures import CancelledError, Executor, Future, ProcessPoolExecutor
from contextlib import contextmanager
from types import ModuleType
from typing import Any, cast

from protocols.errors import StudyError
from protocols.outside import visible_line
from stimuli.batch.jobs import start_worker

CONNECT_S = 10.0


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


def _client(distributed: Any, address: str, tls: Mapping[str, str]) -> Any:
    """Return a client of a scheduler that answers; distributed is not typed.

    Its client would hang where something else listens, and for 20 s when it is given up: so who
    listens is asked first.
    """
    security = distributed.Security(**tls)
    arguments = security.get_connection_args("client")

    async def identity() -> Any:
        async with distributed.rpc(address, connection_args=arguments) as other:
            return await other.identity()

    found = asyncio.run(asyncio.wait_for(identity(), CONNECT_S))
    if found["type"] != "Scheduler":
        raise ValueError(f"it is the address of a {found['type'].lower()}")
    return distributed.Client(address, timeout=CONNECT_S, set_as_default=False, security=security)


@contextmanager
def dask_cluster(
    address: str, tls: Mapping[str, str] | None = None
) -> Iterator[tuple[Executor, int]]:
    """The workers of a running Dask cluster, and how many there are.

    Every worker must see the protocol's files and the output folder under the same paths.

    Parameters
    ----------
    address : str
        ``tcp://host:port``, or ``tls://host:port``.
    tls : mapping, optional
        Files of ``distributed.Security``: ``tls_ca_file``, ``tls_client_cert``,
        ``tls_client_key``. What is left out is taken from Dask's configuration.

    Raises
    ------
    StudyError
        If Dask is not installed, no scheduler answers there, or the cluster has no worker.
    """
    try:
        distributed: Any = importlib.import_module("distributed")
    except ImportError:
        raise StudyError(
            "--scheduler needs Dask; install it with: pip install 'metamerlab[dask]'"
        ) from None
    # What it says there is said by exceptions too.
    logging.getLogger("distributed.client").setLevel(logging.CRITICAL)
    try:
        client = _client(distributed, address, tls or {})
    except Exception as error:  # whatever answers may say anything
        cause: BaseException = error
        while cause.__cause__ is not None and not isinstance(cause, TimeoutError):
            cause = cause.__cause__  # "certificate verify failed", not "closed"
        late = f"none answered within {CONNECT_S:g} s"
        reason = late if isinstance(cause, TimeoutError) else str(cause) or type(cause).__name__
        raise StudyError(
            f"--scheduler {address}: must be the address of a running Dask scheduler,"
            " tcp://HOST:PORT or, where it has certificates, tls://HOST:PORT with --tls-ca-file,"
            f" --tls-cert and --tls-key ({visible_line(reason)}); start one with 'dask scheduler',"
            " or leave the option out"
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
    except (CancelledError, distributed.KilledWorker, distributed.comm.CommClosedError):
        raise StudyError(
            f"--scheduler {address}: the cluster was lost; nothing that it finished is: run the"
            " same command again"
        ) from None
    finally:
        client.close()
