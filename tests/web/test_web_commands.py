"""Studies leave for browsers and come home by commands; what a browser cannot do is said first."""

from __future__ import annotations

import json
import zipfile
from pathlib import Path

import pytest
from forked import run
from task_cases import CASES, case_text
from web_kernel import running_kernel
from web_study import FHD, built, for_browsers, with_pixels

from protocols.errors import StudyError
from protocols.load import load_protocol, load_study
from protocols.web_study import WebStudy
from study_app.web import jzip
from study_app.web.export import WebBuild

WEB = '\n[web]\ngaze = "none"\ntolerance_s = 0.01\n'


@pytest.fixture(scope="module")
def lab(short_study, tmp_path_factory):
    """A folder with a study for browsers and its stimuli."""
    folder = tmp_path_factory.mktemp("lab")
    text = case_text(short_study, CASES["yes-no"])
    (folder / "study.toml").write_text(text + WEB, encoding="utf-8")
    (folder / "desk.toml").write_text(text, encoding="utf-8")
    study, _ = load_study(folder / "study.toml")
    with_pixels(study, folder / "clips")
    return folder


def metamerlab(*words: object, cwd: Path):
    return run(["-c", "from study_app.cli import main; main()", *map(str, words)], cwd=cwd)
