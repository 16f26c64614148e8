"""OpenGL contexts: off-screen through EGL, or the one the caller's window made current."""

from dataclasses import dataclass
from typing import Any

import moderngl

from pipeline.errors import GLUnavailableError

REQUIRED_VERSION = 430  # compute shaders, image atomics
MAX_DEVICES = 16
_PAST_THE_LAST = "but found"  # glcontext: "requested device index 3, but found 2 devices"
SOFTWARE_RENDERERS = ("llvmpipe", "softpipe", "swrast", "swiftshader", "software")

_CURE = (
    "install a driver with OpenGL 4.3 or newer; without a GPU, Mesa's software renderer"
    " will do (Debian, Ubuntu: apt-get install libegl1 libgl1)"
)


@dataclass(frozen=True)
class Renderer:
    """What draws: recorded beside every result that came from it."""

    vendor: str
    name: str
    version: str
    version_code: int  # 450 is OpenGL 4.5
    software: bool

    def __str__(self) -> str:
        return f"{self.name} (OpenGL {self.version})"


def describe(ctx: moderngl.Context) -> Renderer:
    """Name the renderer behind `ctx`."""
    name = str(ctx.info["GL_RENDERER"])
    return Renderer(
        vendor=str(ctx.info["GL_VENDOR"]),
        name=name,
        version=str(ctx.info["GL_VERSION"]),
        version_code=ctx.version_code,
        software=any(word in name.lower() for word in SOFTWARE_RENDERERS),
    )


def create_context(device_index: int | None = None) -> moderngl.Context:
    """Open an off-screen context on an EGL device.

    Parameters
    ----------
    device_index : int, optional
        Which EGL device. By default the first hardware renderer, or, where there is
        none, the first software renderer.

    Raises
    ------
    GLUnavailableError
        If no device gives OpenGL 4.3, with what each device answered and the cure.
    """
    if device_index is not None:
        return _open(device_index)
    refusals: list[str] = []
    software: list[int] = []
    for index in range(MAX_DEVICES):
        try:
            ctx = _open(index)
        except GLUnavailableError as error:
            if _PAST_THE_LAST in str(error):
                break
            refusals.append(f"device {index}: {error}")
            continue
        if not describe(ctx).software:
            return ctx
        software.append(index)
        ctx.release()
    if software:
        return _open(software[0])
    found = "; ".join(refusals) or "no EGL device"
    raise GLUnavailableError(f"OpenGL 4.3 through EGL is needed (found: {found}); {_CURE}")


def adopt_context() -> moderngl.Context:
    """Wrap the context that the caller's window made current in this thread.

    Raises
    ------
    GLUnavailableError
        If no context is current, or it is older than OpenGL 4.3.
    """
    try:
        ctx = moderngl.create_context()
    except Exception as error:  # moderngl raises bare Exception
        raise GLUnavailableError(
            f"a window's OpenGL context must be current in this thread (found: {error});"
            " make the window's context current first"
        ) from error
    return _checked(ctx)


def _open(device_index: int) -> moderngl.Context:
    settings: dict[str, Any] = {"backend": "egl", "device_index": device_index}
    try:
        ctx = moderngl.create_context(standalone=True, **settings)
    except Exception as error:  # moderngl and glcontext raise bare Exception
        raise GLUnavailableError(
            f"EGL device {device_index} must give an OpenGL context (found: {error}); {_CURE}"
        ) from error
    return _checked(ctx)


def _checked(ctx: moderngl.Context) -> moderngl.Context:
    if ctx.version_code < REQUIRED_VERSION:
        found = str(describe(ctx))
        ctx.release()
        raise GLUnavailableError(f"OpenGL 4.3 is needed (found: {found}); {_CURE}")
    return ctx
