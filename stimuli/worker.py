"""Renderer of a worker process, and the one thread in it that may touch a GL context."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import Generic, Protocol, TypeVar

import moderngl

from pipeline.errors import GLUnavailableError
from pipeline.gl.context import create_context, describe


@dataclass(frozen=True)
class RendererInfo:
    """Renderer of a worker."""

    vendor: str
    renderer: str
    version: str


NUMPY = RendererInfo("", "none: numpy", "")


class ContextHolder(Protocol):
    """Holder of an OpenGL context."""

    def release(self) -> None:
        """Free the GPU."""


H = TypeVar("H", bound=ContextHolder)
K = TypeVar("K")
T = TypeVar("T")


class GpuThread(Generic[K, H]):
    """The one thread of this process that may touch a context, and what holds it.

    Contexts cannot be sent to workers: each process opens its own, by `hold`, for what is asked.
    """

    def __init__(self, hold: Callable[[K], H]) -> None:
        self._hold = hold
        self._thread = ThreadPoolExecutor(1, thread_name_prefix="gpu")
        self._held: tuple[K, H] | None = None

    def do(self, key: K, job: Callable[[H], T]) -> T:
        """Do a job with what holds the context for `key`; that of another key is freed."""

        def work() -> T:
            if self._held is None or self._held[0] != key:
                self._release()
                self._held = key, self._hold(key)
            return job(self._held[1])

        return self._thread.submit(work).result()

    def close(self) -> None:
        """Free the GPU; the next job opens another context."""
        self._thread.submit(self._release).result()

    def _release(self) -> None:
        if self._held is not None:
            self._held[1].release()
            self._held = None


def context_or_numpy() -> tuple[moderngl.Context | None, RendererInfo]:
    """Open a context where there is OpenGL 4.3; else numpy works."""
    try:
        ctx = create_context()
    except GLUnavailableError:
        return None, NUMPY
    found = describe(ctx)
    return ctx, RendererInfo(found.vendor, found.name, found.version)
