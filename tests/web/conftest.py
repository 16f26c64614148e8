"""Browsers and built studies, each made once for all tests of a process."""

from collections.abc import Callable

import pytest
from chromium import chromium_for_tests
from study_texts import short_study
from task_cases import PREFERENCE, TRIAL
from web_browser import running_firefox
from web_study import BuiltWebStudy, alike_in, built, cases_in, for_browsers

from protocols.load import load_study


@pytest.fixture(scope="session")
def case(tmp_path_factory):
    """Give a built case by its name, made once."""
    return cases_in(tmp_path_factory)


@pytest.fixture(scope="session")
def alike(case, tmp_path_factory):
    """A study whose stimuli share most of their pixels, with a share of its scenes for each."""
    return alike_in(case("which-half"), tmp_path_factory.mktemp("alike"))


@pytest.fixture(scope="session")
def pairs(tmp_path_factory) -> Callable[..., BuiltWebStudy]:
    """Build a study with a trial for each scene, of a letter each, and keys of `[web]`."""

    def made(scenes: str, language: str = "en", **web: str) -> BuiltWebStudy:
        folder = tmp_path_factory.mktemp("pairs")
        entries = ", ".join(
            f'{{ name = "{scene}{method}", file = "{scene}{method}.png",'
            f' condition = {{ scene = "{scene}", method = "{method}" }} }}'
            for scene in scenes
            for method in ("one", "two")
        )
        text = short_study(
            stimuli=f'kind = "files"\nwidth_px = 64\nheight_px = 64\nentries = [{entries}]',
            task='kind = "two-interval"\nstimulus_s = 0.1\ngap_s = 0.1',
            answers=("first", "second"),
            analysis=PREFERENCE,
            design="repeats = 1\nblocks = 1",
            trial=TRIAL,
            texts='key_names = { space = "Leertaste" }',
        ).replace('"en"', f'"{language}"')
        text = text.replace("languages.en", f"languages.{language}")
        (folder / "study.toml").write_text(text, encoding="utf-8")
        study, _ = load_study(folder / "study.toml")
        return built(for_browsers(study, tolerance_s=0.01, **web), folder)

    return made


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
