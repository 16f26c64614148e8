"""Scripts of a report repeat its main models with lme4, ordinal, statsmodels and scipy."""

import os
import re
import runpy
import shutil
import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from functools import cache
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from fixed_studies import TABLES, report_of
from undrawn_reports import undrawn

from analysis.models.mixed.inference import Inference
from analysis.models.mixed.reaction_model import time_model
from analysis.parts.times import Times, TimesPart
from analysis.plans.table_sections import TimeTableSection
from analysis.repeat import lme4_effects, scripts
from analysis.report.write_report import report_decisions
from analysis.tasks import analysis_of
from analysis.tasks.note import write_note

ALONG_LEVELS = {"right.R", "right.py"}
HELD = {
    "preference": {"choices.R", "choices.py", "times.R", "times.py"},
    "detection": {"right.R", "right.py", "times.R", "times.py"},
    "two-answers": {*ALONG_LEVELS, "times.R", "times.py"},
    "rising": ALONG_LEVELS,
    "ratings": {"ratings.R", "ratings.py", "times.R", "times.py"},
    "graded-pairs": set(),
}
"""Fixed studies, and the scripts of their reports; no package has graded pairs' random effects."""
IN_R = ("preference", "two-answers", "ratings")
QUICK = ("ratings",)
ODD = ("=bl\"ur's", "5.0", "\N{GREEK SMALL LETTER BETA}, \\x", "True")
"""Conditions that spreadsheets, R and Python all read in their own ways."""


def cases() -> list[object]:
    return [n if n in QUICK else pytest.param(n, marks=pytest.mark.slow) for n in HELD]


@pytest.fixture(scope="module")
def report(tmp_path_factory) -> Callable[[str], Path]:
    """Return a maker of the reports of fixed studies, each once."""
    made: dict[str, Path] = {}

    def of(name: str) -> Path:
        if name not in made:
            with undrawn():
                made[name] = report_of(name, tmp_path_factory.mktemp(name))
        return made[name]

    return of


def scripts_in(folder: Path, end: str = "") -> list[Path]:
    return sorted((folder / "scripts").glob(f"*{end}"))


def status(script: Path) -> int:
    """Run a script of Python here; return its exit status."""
    with pytest.raises(SystemExit) as ended:
        runpy.run_path(str(script), run_name="__main__")
    return int(ended.value.code or 0)


@cache
def needed_r() -> None:
    """Skip where R or its packages are missing; fail where they must be there."""
    asked = "library(lme4); library(ordinal)"
    found = (
        shutil.which("Rscript")
        and not subprocess.run(
            ["Rscript", "-e", asked], capture_output=True, check=False
        ).returncode
    )
    if not found:
        why = "R with lme4 and ordinal is not here: script/setup --tools installs it"
        if os.environ.get("REQUIRE_R") == "1":
            pytest.fail(why)
        pytest.skip(why)


def run_r(script: Path) -> subprocess.CompletedProcess[str]:
    return subprocess.run(["Rscript", str(script)], capture_output=True, text=True, check=False)


def odd_report(folder: Path, kind: str, rows: pd.DataFrame, **options: object) -> Path:
    """Write the report of a table whose conditions have odd names."""
    names = dict(zip(sorted(rows["method"].unique()), ODD, strict=False))
    rows = rows.assign(**{'the "way"': rows["method"].map(names)}).drop(columns="method")
    rows.to_csv(folder / "odd.csv", index=False)
    write_note(folder / "odd.csv", analysis_of(kind).options(by='the "way"', **options))
    with undrawn():
        report_decisions(folder / "odd.csv", folder / "report", figure_files="none")
    return folder / "report"


@pytest.mark.parametrize("name", cases())
def test_a_report_holds_the_scripts_of_its_models_and_says_so(name, report):
    folder = report(name)
    page = (folder / "report.html").read_text(encoding="utf-8")

    assert {one.name for one in scripts_in(folder)} == HELD[name]
    assert (folder / "scripts").is_dir() == bool(HELD[name])
    assert set(re.findall(r"scripts/(\w+\.\w+)", page)) == HELD[name]
    for script in scripts_in(folder):
        text = script.read_text(encoding="utf-8")
        assert "Not repeated" in text or name == "ratings"
        assert str(folder.parent) not in text
        assert "{{" not in text


@pytest.mark.parametrize("name", cases())
def test_scripts_of_python_find_the_numbers_of_the_report(name, report, capsys):
    for script in scripts_in(report(name), ".py"):
        assert status(script) == 0, capsys.readouterr().out
        assert re.search(r"^0 of [1-9]\d* numbers differ$", capsys.readouterr().out, re.MULTILINE)


@pytest.mark.slow
@pytest.mark.parametrize("name", IN_R)
def test_scripts_of_r_find_the_numbers_of_the_report(name, report):
    needed_r()
    for script in scripts_in(report(name), ".R"):
        done = run_r(script)
        assert done.returncode == 0, done.stdout + done.stderr
        assert re.search(r"^0 of [1-9]\d* numbers differ$", done.stdout, re.MULTILINE)


CHANGED: dict[str, tuple[Any, ...]] = {
    "choices.py": ("preferences.csv", "share"),
    "right.py": ("models.csv", "estimate", 0),
    "times.py": ("times.csv", "median_s"),
    "ratings.py": ("ratings.csv", "share_1"),
    "right.R": ("models.csv", "standard_error"),
}
"""The number that is changed, of the last row if not said; scripts of R share their comparison."""


@pytest.mark.parametrize(
    "script",
    [
        one if one in ("ratings.py", "times.py") else pytest.param(one, marks=pytest.mark.slow)
        for one in CHANGED
    ],
)
def test_a_number_that_differs_ends_a_script_with_status_1(script, report, tmp_path, capsys):
    study = {"choices": "preference", "right": "two-answers"}
    folder = tmp_path / "report"
    shutil.copytree(report(study.get(script.split(".")[0], "ratings")), folder)
    name, column, *row = CHANGED[script]
    table = pd.read_csv(folder / "tables" / name)
    table[column] = table[column] + 0.2 * (np.arange(len(table)) == (row or [len(table) - 1])[0])
    table.to_csv(folder / "tables" / name, index=False)
    if script.endswith(".R"):
        needed_r()
        done = run_r(folder / "scripts" / script)
        assert done.returncode == 1
        assert "DIFFERS" in done.stdout
    else:
        assert status(folder / "scripts" / script) == 1
        assert "DIFFERS" in capsys.readouterr().out


@pytest.mark.slow
def test_odd_names_are_found_by_both_languages(tmp_path, capsys):
    kind, options, make = TABLES["two-answers"]
    folder = odd_report(tmp_path, kind, make(), **options)

    assert len(scripts_in(folder)) == 4
    for script in scripts_in(folder, ".py"):
        assert status(script) == 0, capsys.readouterr().out
    needed_r()
    for script in scripts_in(folder, ".R"):
        done = run_r(script)
        assert done.returncode == 0, (script.name, done.stdout + done.stderr)


@pytest.mark.slow
def test_shares_of_six_scenes_are_repeated_with_their_clustered_t(make_decisions, tmp_path, capsys):
    make_decisions(people=8).to_csv(tmp_path / "six.csv", index=False)
    with undrawn():
        report_decisions(tmp_path / "six.csv", tmp_path / "report", figure_files="none")

    assert status(tmp_path / "report" / "scripts" / "choices.py") == 0
    assert capsys.readouterr().out.count(" t  ") == 6


@pytest.mark.slow
def test_r_finds_errors_of_choices_where_people_and_scenes_differ(tmp_path):
    """With its usual tolerance lme4's own second derivative is off by 4 % here."""
    needed_r()
    rng = np.random.default_rng(25)
    rows = pd.DataFrame(product(range(9), range(6)), columns=["participant", "scene"])
    turned = rng.random(len(rows)) < 0.5
    liked = rows["participant"].map(dict(enumerate(rng.normal(-0.5, 1.0, 9))))
    liked += rows["scene"].map(dict(enumerate(rng.normal(0.0, 1.0, 6))))
    ours = rng.random(len(rows)) < 1.0 / (1.0 + np.exp(-liked))
    first, second, chosen = (
        np.where(one, "ours", "blur") for one in (turned, ~turned, ours.to_numpy())
    )
    rows = rows.assign(first=first, second=second, chosen=chosen, size="all")
    rows.to_csv(tmp_path / "pair.csv", index=False)
    with undrawn():
        report_decisions(tmp_path / "pair.csv", tmp_path / "report", figure_files="none")
    done = run_r(tmp_path / "report" / "scripts" / "choices.R")

    assert done.returncode == 0, done.stdout + done.stderr
    assert "0 of 4 numbers differ" in done.stdout


@pytest.mark.slow
def test_a_script_runs_by_itself_from_any_folder(report, tmp_path):
    script = report("ratings") / "scripts" / "ratings.py"
    done = subprocess.run(
        [sys.executable, str(script)], cwd=tmp_path, capture_output=True, text=True, check=False
    )

    assert done.returncode == 0, done.stderr


def test_random_effects_are_written_as_lme4_takes_them():
    assert lme4_effects(["participant", "scene x way", "level from its mean | scene"]) == [
        "(1 | participant)",
        "(1 | scene:condition)",
        "(0 + centred | scene)",
    ]


@pytest.mark.slow
def test_r_says_why_ratings_of_two_scenes_are_not_repeated(report, tmp_path):
    needed_r()
    shutil.copytree(report("ratings"), tmp_path / "report")
    decisions = tmp_path / "report" / "tables" / "decisions.csv"
    rows = pd.read_csv(decisions)
    rows[rows["scene"].isin(sorted(rows["scene"].unique())[:2])].to_csv(decisions, index=False)
    done = run_r(tmp_path / "report" / "scripts" / "ratings.R")

    assert done.returncode == 0, done.stdout + done.stderr
    assert "not repeated: clmm takes no random effect of fewer than three (scene)" in done.stdout


@pytest.mark.slow
def test_statsmodels_finds_limits_of_times_where_a_deviation_is_small(tmp_path, capsys):
    """Its usual search ends far from the maximum here."""
    rng = np.random.default_rng([5, 5])
    for least, most in ((4, 14), (2, 9), (1, 5), (2, 4)):
        rng.integers(least, most)
    own, taste, place, fit = (
        rng.normal(0.0, rng.choice([0.0, 0.3, 0.8]), shape) for shape in (9, (9, 3), 6, (6, 3))
    )
    shift = np.linspace(0.0, rng.choice([0.0, 1.0]), 3)
    who, scene, method, _ = np.array(list(product(range(9), range(6), range(3), range(4)))).T
    latent = shift[method] + own[who] + taste[who, method] + place[scene] + fit[scene, method]
    rt_s = np.exp(0.3 * latent + rng.normal(0.0, 0.4, len(latent)))
    rows = pd.DataFrame({"participant": who, "scene": scene, "method": method, "rt_s": rt_s})
    rows = rows.assign(method=rows["method"].map({0: "ours", 1: "blur", 2: "none"}))
    rows.to_csv(tmp_path / "times.csv", index=False)
    write_note(tmp_path / "times.csv", analysis_of("reaction").options(by="method"))
    with undrawn():
        report_decisions(tmp_path / "times.csv", tmp_path / "report", figure_files="none")

    assert status(tmp_path / "report" / "scripts" / "times.py") == 0, capsys.readouterr().out


def test_no_name_ends_a_text_of_a_script():
    name = '"); quit() #\n\\\N{GRINNING FACE}'
    (text,) = scripts("ratings", "py", by=[name], link="probit", effects=[]).values()

    assert name not in text
    assert compile(text, "ratings.py", "exec")
    (literal,) = re.findall(r"conditions\(rows, \[(.*)\]\)", text)
    assert eval(literal) == name


def test_times_that_nobody_and_no_scene_varies_in_have_scripts(rng):
    """lme4 and statsmodels take a participant's deviation of 0, so the fixed part is checked."""
    rows = pd.DataFrame(product(range(8), "abc", ("blur", "ours"), range(4)),
                        columns=["participant", "scene", "method", "again"])  # fmt: skip
    rows["rt_s"] = np.exp(rng.normal(0.0, 0.3, len(rows)))
    model = time_model(rows, ("method",), inference=Inference(profile=True))
    flat = replace(model, participant_sd=0.0, interaction_sd=0.0, scene_sd=0.0,
                   scene_interaction_sd=0.0)  # fmt: skip
    plan = analysis_of("reaction").plan_of_table(rows, "rows", TimeTableSection(by="method"))
    found = Times((), {}, flat, ())

    assert {*TimesPart().show(found, plan).scripts} == {"times.R", "times.py"}
    assert "(1 | participant)" in TimesPart().show(found, plan).scripts["times.R"]
