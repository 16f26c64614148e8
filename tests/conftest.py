"""Fixtures and options that every test may use."""

from __future__ import annotations

import ctypes
import os
from collections.abc import Callable, Iterator
from pathlib import Path

import hypothesis
import moderngl
import numpy as np
import pytest

from pipeline.errors import GLUnavailableError
from pipeline.gl.context import create_context, release_context

REPOSITORY = Path(__file__).resolve().parents[1]

# No deadline: a busy machine is not a failure. The same examples in every run of CI.
hypothesis.settings.register_profile("local", deadline=None)
hypothesis.settings.register_profile("ci", deadline=None, derandomize=True)
hypothesis.settings.load_profile("ci" if os.environ.get("CI") else "local")


def pytest_addoption(parser: pytest.Parser) -> None:
    """Add ``--full``."""
    parser.addoption(
        "--full", action="store_true", help="run long proofs whole (by default a tenth of them)"
    )


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Skip what is marked `full` unless it was asked for."""
    if config.getoption("--full"):
        return
    for item in items:
        if item.get_closest_marker("full"):
            item.add_marker(pytest.mark.skip(reason="a long proof: script/test --full runs it"))


@pytest.fixture(scope="session")
def full(request: pytest.FixtureRequest) -> bool:
    """Whether long proofs run whole."""
    return bool(request.config.getoption("--full"))


@pytest.fixture(scope="session")
def proof_count(full: bool) -> Callable[[int], int]:
    """Give how often to repeat: all of the count asked for with ``--full``, else a tenth."""
    return lambda count: count if full else max(1, count // 10)


@pytest.fixture
def rng() -> np.random.Generator:
    """Return a generator that starts at the same seed in every test."""
    return np.random.default_rng(20_260_101)


@pytest.fixture(scope="session")
def repository() -> Path:
    """Return the folder that holds `pyproject.toml`, also when a wheel is under test."""
    return REPOSITORY


@pytest.fixture(scope="session")
def shared_data() -> Path:
    """Return the folder of large test data, kept beside the repository and not in it."""
    folder = REPOSITORY.parent / "shared" / "data"
    if not folder.is_dir():
        pytest.skip("needs the test data in ../shared/data, which is not here")
    return folder


@pytest.fixture(scope="session")
def shared_gl_context() -> Iterator[moderngl.Context]:
    """Yield one context for all tests; most want `gl_context`, which watches what it leaves."""
    try:
        ctx = create_context()
    except GLUnavailableError as error:
        if os.environ.get("REQUIRE_GL") == "1":
            pytest.fail(f"REQUIRE_GL=1, and there is no usable OpenGL: {error}")
        pytest.skip(f"no usable OpenGL: {error}")
    yield ctx
    release_context(ctx)


@pytest.fixture
def gl_context(shared_gl_context: moderngl.Context) -> Iterator[moderngl.Context]:
    """Yield an off-screen context, current; without OpenGL skip, or fail where REQUIRE_GL=1.

    A test fails if it leaves an object alive in the context, or a GL error unread.
    """
    shared_gl_context.__enter__()  # another test may have made its own context current
    shared_gl_context.clear_errors()
    before = _live_gl_objects()
    yield shared_gl_context
    shared_gl_context.__enter__()
    error = shared_gl_context.error
    left = _live_gl_objects() - before
    assert not left, f"GL objects left alive: {', '.join(sorted(left))}"
    assert error == "GL_NO_ERROR", f"GL error left unread: {error}"


@pytest.fixture
def live_gl_objects(gl_context: moderngl.Context) -> Callable[[], set[str]]:  # noqa: ARG001
    """Give the function that tells which objects the context holds, e.g. ``texture 3``."""
    return _live_gl_objects


GL_DELETE_STATUS = 0x8B80
MOST_GL_NAMES = 512  # drivers hand out the lowest free name


def _live_gl_objects() -> set[str]:
    """Ask the driver which objects the current context holds, e.g. ``texture 3``.

    Python objects would not do: moderngl frees nothing when they are collected. Query
    objects are left out, since moderngl has no call to free them. A program that was
    released but is still bound counts as gone.
    """
    egl = ctypes.CDLL("libEGL.so.1")
    egl.eglGetProcAddress.restype = ctypes.c_void_p

    def function(name: str, *arguments: type, returns: type | None) -> Callable[..., int]:
        return ctypes.CFUNCTYPE(returns, *arguments)(egl.eglGetProcAddress(name.encode()))

    get_program = function(
        "glGetProgramiv",
        *(ctypes.c_uint, ctypes.c_uint, ctypes.POINTER(ctypes.c_int)),
        returns=None,
    )

    def released(program: int) -> bool:
        status = ctypes.c_int()
        get_program(program, GL_DELETE_STATUS, ctypes.byref(status))
        return bool(status.value)

    alive = set()
    kinds = ("Texture", "Program", "Buffer", "Framebuffer", "Renderbuffer", "Sampler")
    for kind in (*kinds, "VertexArray"):
        exists = function(f"glIs{kind}", ctypes.c_uint, returns=ctypes.c_ubyte)
        alive |= {f"{kind.lower()} {name}" for name in range(1, MOST_GL_NAMES) if exists(name)}
    return {name for name in alive if not (name.startswith("program") and released(int(name[8:])))}
