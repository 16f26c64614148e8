"""Browsers and built studies, each made once for all tests of a process."""

import pytest
from chromium import chromium_for_tests
from web_browser import running_firefox
from web_study import alike_in, cases_in


@pytest.fixture(scope="session")
def case(tmp_path_factory):
    """Give a built case by its name, made once."""
    return cases_in(tmp_path_factory)


@pytest.fixture(scope="session")
def alike(case, tmp_path_factory):
    """A study whose stimuli share most of their pixels, with a share of its scenes for each."""
    return alike_in(case("which-half"), tmp_path_factory.mktemp("alike"))


@pytest.fixture(scope="session")
def chromium():
    """Chromium, in which the host `lab.test` is this machine."""
    with chromium_for_tests("--host-resolver-rules=MAP lab.test 127.0.0.1") as browser:
        yield browser


@pytest.fixture(scope="session")
def firefox(tmp_path_factory):
    """Firefox."""
    with running_firefox(tmp_path_factory.mktemp("firefox")) as browser:
        yield browser
