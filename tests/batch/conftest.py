"""A study so small that it builds in seconds: a box before a wall, and the stereo pair."""

from concurrent.futures import Executor, Future
from pathlib import Path

import pytest
from built_study import write_small_study

from protocols.load import load_display, load_protocol
from stimuli.batch.build import build
from stimuli.batch.build_plan import BuildPlan
from stimuli.batch.jobs import SCENES


class Inline(Executor):
    """Does a job when it is handed in, in this process."""

    def submit(self, fn, /, *args, **kwargs):
        future = Future()
        try:
            future.set_result(fn(*args, **kwargs))
        except BaseException as error:
            future.set_exception(error)
        return future


@pytest.fixture(scope="session")
def inline_class():
    """Give the class of executors without processes."""
    return Inline


@pytest.fixture
def inline():
    """Return an executor without processes."""
    return Inline()


@pytest.fixture(scope="session")
def read_plan():
    """Give the function that reads a protocol as a build plan."""
    return plan_of


@pytest.fixture(scope="session")
def small_study(tmp_path_factory) -> Path:
    """Write the study's protocol and its files; return the protocol."""
    return write_small_study(tmp_path_factory.mktemp("study"))


@pytest.fixture
def plan(small_study) -> BuildPlan:
    """Return the small study as a build plan."""
    return plan_of(small_study)


@pytest.fixture(scope="session")
def batch(small_study, tmp_path_factory) -> Path:
    """Build the small study once; tests that change anything copy it."""
    out = tmp_path_factory.mktemp("built") / "clips"
    build(plan_of(small_study), out, Inline())
    return out


def plan_of(path: Path) -> BuildPlan:
    """Read a protocol as a build plan."""
    protocol = load_protocol(path)
    return BuildPlan(protocol, load_display(protocol.display.display), path.parent)


@pytest.fixture(scope="session", autouse=True)
def bench():
    """Free the process's GL bench at the end."""
    yield
    SCENES.close()
