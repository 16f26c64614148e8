"""OpenGL contexts, off-screen or the one the caller's window made current.

Off-screen ones come through EGL on Linux, through WGL on Windows and through CGL on macOS, which
has no compute shaders: there, and wherever OpenGL 4.3 is missing, numpy does what it can.

A context belongs to the thread that made it, and one is current at a time: work goes to
the current one, whichever object asks. Making a context makes it current.
"""

import ctypes
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

import moderngl

from pipeline.errors import GLUnavailableError

NUMPY_INSTEAD = (
    "no OpenGL 4.3 here ('metamerlab doctor' says why): numpy works instead, up to 30 times slower"
    " than Mesa's renderer"
)
REQUIRED_VERSION = 430  # compute shaders, image atomics
SHOWING_VERSION = 330
_OLDEST_VERSION = 300  # asked for only to learn the name of a driver that is too old
MAX_DEVICES = 16
_LIBEGL = "libEGL.so.1"
_PAST_THE_LAST = "but found"  # glcontext: "requested device index 3, but found 2 devices"
SOFTWARE_RENDERERS = ("llvmpipe", "softpipe", "swrast", "swiftshader", "software")

_HAS_EGL = sys.platform == "linux"
_CURE = {
    "darwin": "macOS has no compute shaders and never will: draw in the container"
    " (Containerfile) or on another machine",
    "win32": "install a graphics driver with OpenGL 4.3 or newer, or put Mesa's opengl32.dll beside"
    " python.exe",
}.get(
    sys.platform,
    "install a driver with OpenGL 4.3 or newer; without a GPU, Mesa's software renderer"
    " will do (Debian, Ubuntu: apt-get install libegl1 libgl1)",
)


@dataclass(frozen=True)
class GraphicsDriver:
    """Graphics card or software that draws: recorded beside every result that came from it."""

    vendor: str
    name: str
    version: str
    version_code: int  # 450 is OpenGL 4.5
    software: bool

    def __str__(self) -> str:
        return f"{self.name} (OpenGL {self.version})"


def describe(ctx: moderngl.Context) -> GraphicsDriver:
    """Name the renderer behind `ctx`."""
    name = str(ctx.info["GL_RENDERER"])
    return GraphicsDriver(
        vendor=str(ctx.info["GL_VENDOR"]),
        name=name,
        version=str(ctx.info["GL_VERSION"]),
        version_code=ctx.version_code,
        software=any(word in name.lower() for word in SOFTWARE_RENDERERS),
    )


def create_context(device_index: int | None = None) -> moderngl.Context:
    """Open an off-screen context and make it current.

    Free it with `release_context`, at the latest before a window's context is made
    current in the same thread.

    Parameters
    ----------
    device_index : int, optional
        Which EGL device, from 0. By default the first hardware renderer, or, where there
        is none, the first software renderer. Windows and macOS choose for themselves.

    Raises
    ------
    GLUnavailableError
        If no device gives OpenGL 4.3, with what each device answered and the cure.
    """
    if not _HAS_EGL:
        try:
            return moderngl.create_context(require=REQUIRED_VERSION, standalone=True)
        except Exception as error:  # moderngl and glcontext raise bare Exception
            raise GLUnavailableError(f"OpenGL 4.3 is needed (found: {error}); {_CURE}") from error
    if device_index is not None:
        try:
            return _open(device_index)
        except _RefusedError as error:
            cure = "choose another device_index" if _PAST_THE_LAST in str(error) else _CURE
            raise GLUnavailableError(
                f"EGL device {device_index} must give OpenGL 4.3 (found: {error}); {cure}"
            ) from error
    refusals: dict[str, int] = {}  # reason: first device; a missing libEGL answers for all
    software: list[int] = []
    for index in range(MAX_DEVICES):
        try:
            ctx = _open(index)
        except _RefusedError as error:
            if _PAST_THE_LAST in str(error):
                break
            refusals.setdefault(str(error), index)
            continue
        if not describe(ctx).software:
            return ctx
        software.append(index)
        ctx.release()
    if software:
        return _open(software[0])
    answers = [f"device {index}: {reason}" for reason, index in refusals.items()]
    found = "; ".join(answers) or "no EGL device"
    raise GLUnavailableError(f"OpenGL 4.3 through EGL is needed (found: {found}); {_CURE}")


def release_context(ctx: moderngl.Context) -> None:
    """Free what `create_context` opened, and leave no EGL context current.

    Without the second step the X server ends the process (BadAccess) as soon as a window
    makes its GLX context current in this thread.
    """
    ctx.release()
    if _HAS_EGL:
        ctypes.CDLL(_LIBEGL).eglReleaseThread()


@contextmanager
def lent_context() -> Iterator[moderngl.Context]:
    """Lend what `create_context` opens, for as long as the block lasts."""
    ctx = create_context()
    try:
        yield ctx
    finally:
        release_context(ctx)


def adopt_context() -> moderngl.Context:
    """Wrap the context that the caller's window made current in this thread.

    It stays the window's: releasing the wrapper leaves the window's context alone.

    Raises
    ------
    GLUnavailableError
        If no context is current, or it is older than OpenGL 3.3, which has all that shows
        pictures; only what makes them needs `REQUIRED_VERSION`.
    """
    try:
        # Not create_context(): that looks for GLX alone once any other context was made,
        # and its release destroys the window's context.
        moderngl.init_context()
        ctx = moderngl.get_context()
    except Exception as error:  # moderngl raises bare Exception
        raise GLUnavailableError(
            f"a window's OpenGL context must be current in this thread (found: {error});"
            " make the window's context current first"
        ) from error
    if ctx.version_code < SHOWING_VERSION:
        raise GLUnavailableError(
            f"the window's context must be OpenGL 3.3 or newer (found: {describe(ctx)});"
            f" ask for 3.3 core when the window is made, or {_CURE}"
        )
    return ctx


def require_compute(ctx: moderngl.Context) -> None:
    """Refuse a context that shows pictures and cannot make them.

    Raises
    ------
    GLUnavailableError
        If it is older than OpenGL 4.3.
    """
    if ctx.version_code < REQUIRED_VERSION:
        raise GLUnavailableError(
            f"what is drawn at this moment needs OpenGL 4.3 (found: {describe(ctx)}); {_CURE}"
        )


class _RefusedError(Exception):
    """Reason why one EGL device gives no context, or has too old a driver."""


def _open(device_index: int) -> moderngl.Context:
    try:
        return _egl_context(device_index, REQUIRED_VERSION)
    except Exception as error:  # moderngl and glcontext raise bare Exception
        raise _RefusedError(_driver_behind(device_index) or str(error)) from error


def _driver_behind(device_index: int) -> str | None:
    try:
        ctx = _egl_context(device_index, _OLDEST_VERSION)
    except Exception:
        return None
    renderer = str(describe(ctx))
    ctx.release()
    return renderer


def _egl_context(device_index: int, version: int) -> moderngl.Context:
    settings: dict[str, Any] = {
        "backend": "egl",
        "device_index": device_index,
        # By name: else a program searches all libraries of the system, twice for every context.
        "libgl": "libGL.so.1",
        "libegl": _LIBEGL,
    }
    return moderngl.create_context(require=version, standalone=True, **settings)
