"""The report of an imported table leads with the comparison that was asked for, in the order and
with the names that were asked for."""

import json
import re
from itertools import combinations

import numpy as np
import pandas as pd
import pytest
from command_line import result_of

from analysis.parts import computed
from analysis.plans.preference_plan import preference_plan_of_table
from analysis.plans.table_sections import PreferenceTableSection
from analysis.tasks import analysis_of
from analysis.tasks.note import options_from
from analysis.tasks.preference import PreferenceOfPairs
from protocols.blocks import grouped
from protocols.errors import StudyError

METHODS = {"blur": 0.0, "dithered": 0.2, "none": 0.5, "ours": 1.2}
run = result_of("analysis", env={"COLUMNS": "200"})


@pytest.fixture(scope="module")
def choices() -> pd.DataFrame:
    rng = np.random.default_rng(3)
    rows = []
    for person in range(5):
        for scene in "AB":
            for first, second in (*combinations(METHODS, 2), ("ours", "none")):
                won = rng.random() < 1 / (1 + np.exp(METHODS[second] - METHODS[first]))
                rows.append((f"P{person}", scene, first, second, first if won else second))
    return pd.DataFrame(rows, columns=["participant", "scene", "first", "second", "chosen"])


@pytest.fixture(scope="module")
def decisions(choices, tmp_path_factory) -> pd.DataFrame:
    file = tmp_path_factory.mktemp("choices") / "choices.csv"
    choices.to_csv(file, index=False)
    return analysis_of("preference").read(file, PreferenceTableSection())


def settings(decisions: pd.DataFrame, **texts: str):
    return preference_plan_of_table(decisions, "table", options_from("preference", texts))


def test_the_primary_comparison_leads_and_its_method_is_counted(decisions):
    plain, asked = settings(decisions), settings(decisions, primary="ours / none")

    assert plain.primary is None
    assert plain.pairings[0] == ("blur", "dithered")
    assert asked.primary == ("ours", "none", "all")
    assert asked.pairings[0] == ("ours", "none")
    assert {pair[0] for pair in asked.pairings[:3]} == {"ours"}
    assert len(asked.pairings) == 6


def test_methods_come_in_the_order_that_was_asked_for(decisions):
    asked = settings(decisions, order="ours, none")

    assert asked.methods == ("ours", "none", "blur", "dithered")
    assert asked.pairings[:3] == (("ours", "none"), ("ours", "blur"), ("ours", "dithered"))


@pytest.mark.parametrize(
    ("key", "value", "message"),
    [
        ("primary", "ours/nothing", r"--set primary=ours/nothing: must be a comparison.*did you"),
        ("primary", "ours", "METHOD/AGAINST"),
        ("primary", "ours/none/big", "METHOD/AGAINST"),
        ("order", "ours,nome", r"--set order: .*got 'nome'.; did you mean 'none'"),
        ("label.blurr", "Blur", r"--set label: .*got 'blurr'.; did you mean 'blur'"),
        ("labels", "ours=Ours", r"got 'labels'.; did you mean 'label'"),
    ],
)
def test_names_that_the_table_does_not_have_are_refused(decisions, key, value, message):
    with pytest.raises(StudyError, match=message):
        settings(decisions, **{key: value})


@pytest.mark.slow
def test_an_imported_table_keeps_what_was_asked_for(choices, tmp_path):
    choices.to_csv(tmp_path / "c.csv", index=False)
    run(
        "import", tmp_path / "c.csv", "--set", "primary=ours/none", "--set", "order=none",
        "--set", "label.ours=Our method, new", "--set", "label.none='Original'",
        "--out", tmp_path / "in",
    )  # fmt: skip
    result = run("report", tmp_path / "in" / "decisions.csv", "--out", tmp_path / "out",
                 "--no-figures")  # fmt: skip
    numbers = json.loads((tmp_path / "out" / "results.json").read_text())["results"]

    assert "Our method, new was chosen over Original" in result.output
    both = choices[choices[["first", "second"]].isin(["ours", "none"]).all(axis=1)]
    assert numbers["preferences"]["primary"]["chosen"] == (both["chosen"] == "ours").sum()
    assert numbers["preferences"]["primary"]["trials"] == len(both)

    # A report says otherwise what is noted, key by key.
    result = run(
        "report", tmp_path / "in" / "decisions.csv", "--out", tmp_path / "again", "--no-figures",
        "--set", "label.ours=Mine", "--set", "test=participant",
    )  # fmt: skip
    assert "Mine was chosen over Original" in result.output
    settings = json.loads((tmp_path / "again" / "results.json").read_text())["settings"]
    assert (settings["test"], settings["primary"]) == ("participant", ["ours", "none", "all"])


def test_a_table_of_answers_takes_order_and_labels():
    table = pd.DataFrame({"participant": "P", "method": ["a", "b", "c"] * 2, "correct": [1, 0] * 3})
    analysis = analysis_of("identification")
    texts = {"alternatives": "2", "order": "c,b", "label.c": "Ours", "baseline": "b"}
    asked = analysis.plan_of_table(table, "t", options_from("identification", texts))

    assert asked.values == ("b", "c", "a")
    assert asked.label("c") == "Ours"
    with pytest.raises(
        StudyError, match=r"--set order: must name conditions of the table .a, b, c"
    ):
        analysis.plan_of_table(table, "t", options_from("identification", texts | {"order": "d"}))


def test_a_table_without_sizes_speaks_of_none(decisions):
    rules = settings(decisions)
    parts = {part.name: part for part in PreferenceOfPairs.parts}
    found, _ = computed(tuple(parts.values()), decisions.assign(rt_s=1.5), rules)
    shown = [parts[name].show(one, rules) for name, one in found.items()]
    said = repr([(one.lead, one.blocks, one.further) for one in shown])

    assert "Size" not in said
    assert "': " not in said
    assert "all sizes" not in said.lower()


def test_a_note_about_nothing_in_particular_has_no_prefix():
    assert grouped([("", ("some participants were even",)), ("a", ())]) == (
        "some participants were even",
    )


def test_an_import_names_the_comparisons_that_a_report_may_lead_with(choices, tmp_path):
    choices.to_csv(tmp_path / "rows.csv", index=False)
    done = run("import", tmp_path / "rows.csv", "--out", tmp_path / "out")
    (pair,) = re.findall(r"--set primary=(\S+) --out report", done.output)
    table, out = tmp_path / "out" / "decisions.csv", tmp_path / "r"
    run("report", table, "--set", f"primary={pair}", "--out", out, "--figures", "none")
    first, _, quality = (out / "report.html").read_text().partition('<h2 id="quality">')
    assert "Primary comparison" in first
    assert "no record of timing" not in first
    assert "<h3>What was read</h3>" in quality
