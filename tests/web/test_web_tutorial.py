"""The ten steps of docs/web.md, from a study to JATOS and to a report: every command, in order."""

import re
import shlex
import zipfile
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from command_line import metamerlab
from PIL import Image
from task_cases import CASES, case_text
from web_browser import served, whole

PAGE = (Path(__file__).resolve().parents[2] / "docs/web.md").read_text(encoding="utf-8")
STEPS = PAGE.split("## From a study to JATOS in ten steps")[1].split("\n## ")[0]
COMMANDS = re.findall(r"(?:\$ |`)(metamerlab [^`\n]*--[^`\n]*|metamerlab session list \w+)", STEPS)
RESULTS = "results.zip"


@pytest.fixture
def lab(tmp_path, monkeypatch):
    """A study as for the desk, with its pictures, and the section that the page adds."""
    monkeypatch.chdir(tmp_path)
    (section,) = re.findall(r"```toml\n(.*?)```", STEPS, re.DOTALL)
    section = re.sub(r"^ +", "", section, flags=re.MULTILINE)
    # Observers answer by chance, in catch trials too.
    rules = 'kind = "detection"\nexclusions = { catch_min_share = 0.0 }'
    text = case_text(replace(CASES["yes-no"], analysis=rules))
    Path("study.toml").write_text(f"{text}\n{section}", encoding="utf-8")
    rng = np.random.default_rng(3)
    for name in re.findall(r'file = "([^"]+)"', text):
        Image.fromarray(rng.integers(0, 256, (64, 64, 3), dtype=np.uint8)).save(name)
    return tmp_path


def sent_by_jatos(chromium, folder: Path) -> None:
    """Let two participants open the archive's page with their links; save as JATOS exports."""
    with zipfile.ZipFile("study.jzip") as archive:
        archive.extractall(folder)
    (page,) = folder.glob("*/index.html")
    batch: dict[str, object] = {}
    with zipfile.ZipFile(RESULTS, "w") as archive:
        for number in (1, 2):
            with served(page.parent) as site:
                site.batch, site.version = batch, number
                whole(chromium, site, page="index.html")
                batch = dict(site.batch)
            for part, text in enumerate(site.results, 1):
                archive.writestr(f"study_result_{number}/comp-result_{part}/data.txt", text)
        archive.writestr("metadata.json", "{}")


@pytest.mark.slow
def test_every_command_of_the_ten_steps_runs_in_their_order(chromium, lab):
    assert [words.split()[1:3] for words in COMMANDS] == [
        ["protocol", "check"], ["stimuli", "build"], ["session", "export-web"],
        ["session", "import-web"], ["session", "import-web"], ["session", "list"],
        ["analysis", "report"],
    ]  # fmt: skip
    said = {}
    for words in COMMANDS:
        if "import-web" in words and not Path(RESULTS).exists():
            sent_by_jatos(chromium, lab / "unpacked")
        done = metamerlab(*shlex.split(words)[1:], terminal_width=200)
        said[words] = " ".join(done.output.split())
        assert ("--check" in words) <= (not Path("sessions").exists())
    check, _, export, look, _, listed, report = said.values()
    assert re.search(r"on screens of at least \d+ x \d+ px, at [\d, ]+ or \d+ Hz", check)
    assert re.search(r"per participant: about [\d.]+ MB .* min", check)
    assert "index.html?slot=0" in export
    assert look.count("imported completed") <= look.count(" completed") == 2
    assert listed.count("browser") == 2
    assert "report/report.html" in report
    page = Path("report/report.html").read_text(encoding="utf-8")
    assert "2 of 2 sessions ran in participants&#39; browsers" in page
    sessions = Path("report/tables/sessions.csv").read_text(encoding="utf-8").splitlines()
    column = sessions[0].split(",").index("slot")
    assert {row.split(",")[column] for row in sessions[1:]} == {"0", "1"}


def test_the_page_says_what_a_browser_study_proves_and_what_not():
    proves = PAGE.split("## What such a study proves")[1].split("\n## ")[0]
    for words in (
        "hashed before it is decoded", "animation frame", "not watched", "never resampled",
        "Luminance and gamma | can be measured | not known",
    ):  # fmt: skip
        assert words in proves
    assert len(re.findall(r"^\d+\. ", STEPS, re.MULTILINE)) == 10
