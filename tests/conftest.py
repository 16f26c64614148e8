"""Fixtures and options that every test may use."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from pathlib import Path

import hypothesis
import moderngl
import numpy as np
import pytest

from pipeline.errors import GLUnavailableError
from pipeline.gl.context import create_context

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
def gl_context() -> Iterator[moderngl.Context]:
    """Yield an off-screen context; without OpenGL skip, or fail where REQUIRE_GL=1."""
    try:
        ctx = create_context()
    except GLUnavailableError as error:
        if os.environ.get("REQUIRE_GL") == "1":
            pytest.fail(f"REQUIRE_GL=1, and there is no usable OpenGL: {error}")
        pytest.skip(f"no usable OpenGL: {error}")
    yield ctx
    ctx.release()
