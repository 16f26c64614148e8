"""Parts of a report: each says all of itself at every door; the runner orders them by need."""

import json
import re
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd
import pytest
from command_line import metamerlab
from fixed_studies import PLAN, TABLES, report_of
from markupsafe import escape
from undrawn_reports import drawn_wide, undrawn

from analysis.parts import Estimate, Part, Presentation, computed, estimates_of, with_added
from analysis.report.write_report import report_decisions
from analysis.tables.table import Table
from analysis.tables.trials import read_times
from analysis.tasks import KINDS, analysis_of
from analysis.tasks.note import write_note
from protocols.blocks import Cautions, Paragraph
from protocols.blocks import TableBlock as Rows
from protocols.errors import StudyError
from protocols.results import read_results

# The door: a report of a fixed table, or a command on one; the parts that it must show.
_RIGHT = ("rates", "sensitivity", "comparisons", "models", "random_effects", "people")
REPORTS = {
    "two-answers": (
        *(*_RIGHT, "thresholds", "goodness"),
        *("learning", "times"),
    ),
    "detection": (*_RIGHT, "typical"),
    "abx": (*_RIGHT, "critical"),
    "ratings": ("ratings", "random_ratings", "learning", "times"),
    "preference": (
        *("preferences", "interaction", "choice_models"),
        *("scale", "bias", "learning", "times"),
    ),
}
_LEVELS = ("--level", "level", "--by", "method", "--falling")
COMMANDS = {
    ("reaction", "--by", "method"): ("two-answers", ("times",)),
    ("ratings", "--by", "method"): ("ratings", ("ratings", "random_ratings")),
    ("psychometric", *_LEVELS, "--guess", "0.25"): (
        "four-answers",
        ("thresholds", "goodness", "psychometric"),
    ),
    ("detection", "--signal", "inconsistent"): ("detection", ("sensitivity", "typical")),
}
SAID = {
    "times": {
        "section": "checks",
        "caption": "Reaction times, s",
        "sentence": "s (median)",
        "methods": "Reaction times are summarised by",
        "tables": {"reaction.csv", "times.csv", "ratios.csv"},
        "figure": "reaction",
    },
    "learning": {
        "section": "checks",
        "caption": "Change from the first to the last trial",
        "sentence": "From the first to the last trial logarithm of the reaction time changed",
        "methods": "Change over the session is the mean",
        "tables": {"learning.csv"},
        "figure": "learning",
    },
    "random_effects": {
        "section": "models",
        "caption": "Random effects of ",
        "sentence": "the SD of participant",
        "methods": "have limits of the profile likelihood",
        "tables": {"random_effects.csv"},
    },
    "random_ratings": {
        "section": "ratings",
        "caption": "Random effects of ratings",
        "sentence": "Random effects of ratings: the SD of participant was",
        "methods": "random effects of ratings have limits",
        "tables": {"random_ratings.csv"},
    },
    "preferences": {
        "section": "preference",
        "caption": "Every comparison, p by",
        "sentence": "Primary comparison: ours was chosen over blur",
        "methods": "Decisions are two-alternative forced choices comparing 3 methods",
        "tables": {"preferences.csv", "shares.csv"},
        "figure": "preference",
    },
    "interaction": {
        "section": "interaction",
        "caption": "Changes between values of size",
        "sentence": "ours / blur: large minus small",
        "methods": "Changes between values of size were tested",
        "tables": {"interaction.csv", "interaction_shares.csv"},
        "figure": "interaction",
    },
    "choice_models": {
        "section": "other",
        "caption": "Logit mixed models: crossed random intercepts",
        "methods": "Logit mixed models had",
        "tables": {"models.csv"},
        "figure": None,
    },
    "scale": {
        "section": "scale",
        "caption": "Thurstone Case V, mean zero",
        "methods": "Quality in just objectionable differences",
        "tables": {"scale.csv", "scale_differences.csv"},
        "figure": "scale",
    },
    "bias": {
        "section": "checks",
        "caption": "Order and side bias, against .5",
        "sentence": "The first interval was picked in",
        "methods": "Choices of the first interval were compared with .5",
        "tables": {"bias.csv"},
        "figure": "bias",
    },
    "ratings": {
        "section": "ratings",
        "caption": "Places on the latent axis",
        "sentence": "was rated",
        "methods": "(rating ~ condition + (1 | participant)",
        "tables": {"ratings.csv", "comparisons.csv", "thresholds.csv"},
        "figure": "ratings",
    },
    "rates": {
        "section": "correct",
        "caption": "Right answers by method",
        "sentence": "answers were correct",
        "methods": "Shares of right answers were tested against chance",
        "tables": {"rates.csv"},
        "figure": "correct",
    },
    "sensitivity": {
        "section": "sensitivity",
        "sentence": ", d' = ",
        "methods": "each condition's",
        "tables": {"sensitivity.csv", "sensitivity_differences.csv"},
        "figure": "sensitivity",
    },
    "typical": {
        "section": "other",
        "caption": "d' and criterion of the typical participant",
        "sentence": "The typical participant's d'",
        "methods": "come from a probit mixed model",
        "tables": {"typical.csv"},
    },
    "comparisons": {
        "section": "sensitivity",
        "sentence": "minus",
        "methods": "Tests are two-sided, alpha = .05",
        "tables": {"sensitivity_differences.csv"},
    },
    "thresholds": {
        "section": "levels",
        "caption": "Thresholds in the population",
        "sentence": "Thresholds (gauss functions of",
        "methods": "Thresholds in the population come from one mixed model",
        "tables": {"levels.csv", "thresholds.csv", "threshold_differences.csv"},
        "figure": "psychometric",
    },
    "psychometric": {
        "section": "levels",
        "caption": "Each participant's curve",
        "sentence": "posterior p",
        "methods": "is the median of a posterior",
        "tables": {"people.csv", "comparisons_of_people.csv"},
        "figure": "own_curves",
    },
    "goodness": {
        "section": "levels",
        "caption": "Goodness of fit, by studies that the model simulates",
        "sentence": "Goodness of fit of ours: deviance",
        "methods": "Goodness of fit was judged by a parametric bootstrap",
        "tables": {"goodness.csv", "residuals.csv"},
        "figure": "goodness",
    },
    "critical": {
        "section": "levels",
        "caption": "The largest scaling that cannot be told apart",
        "sentence": "Critical scaling of condition",
        "methods": "Critical scalings of",
        "tables": {"critical.csv", "critical_differences.csv"},
        "figure": "scaling",
    },
    "models": {
        "section": "other",
        "caption": "Logistic models of right answers",
        "methods": "between them (logit(correct) ~ 1",
        "tables": {"models.csv"},
    },
    "people": {
        "section": "people",
        "sentence": "participants' shares of right answers lay between",
        "methods": "Shares of right answers of single participants",
        "tables": {"shares.csv"},
        "figure": "participants",
    },
}
"""Signs that a part is all there, by its name."""


def check(folder, parts, page: str) -> None:
    numbers = read_results(folder / "results.json").results
    assert set(parts) <= set(numbers)
    methods, sentences = page.split('id="methods"')[1].split('id="apa"')
    # A t is said with its value; degrees of freedom have no digit that says nothing.
    assert not re.search(r"\bt\([\d.]+\)(?! = -?\d)", sentences)
    assert not re.search(r"\(\d+\.0\)", page)
    written = [file.read_bytes() for file in sorted((folder / "tables").glob("*.csv"))]
    assert len({*written}) == len(written)
    # One p decides about each comparison, stands first, and is marked; others are folded.
    first, _, folded = page.partition('<h2 id="other">')
    folded = folded.split("<h2")[0]
    told, beside = (set(re.findall(r"<th [^>]*>(.*?)</th>", part)) for part in (first, folded))
    assert {one for one in told if re.search(r"\bp\b", one)} == {"Deciding p"}
    assert "Deciding p" not in beside
    assert len(re.findall(r"<details><summary>[^<]+</summary>\n<p>[A-Z][^<]+\.</p>", folded)) == (
        folded.count("<details")
    )
    deciding = read_results(folder / "results.json").deciding
    assert deciding
    for name, columns in deciding.items():
        assert {*columns} <= {*pd.read_csv(folder / "tables" / name).columns}
    for name in parts:
        said = SAID[name]
        assert numbers[name]
        section = page.split(f'<h2 id="{said["section"]}">')[1].split("<h2")[0]
        if "caption" in said:
            assert f"<caption>{escape(said['caption'])}" in section
        if said.get("figure"):
            assert f'<figure id="fig-{said["figure"]}">' in section
        assert escape(said.get("sentence", "")) in sentences + folded
        assert escape(said["methods"]) in methods
        assert said["tables"] <= {path.name for path in (folder / "tables").glob("*.csv")}


def test_every_shipped_part_is_among_those_that_are_checked():
    shipped = {part.name for kind in KINDS for part in analysis_of(kind).parts}
    assert shipped == set(SAID)


@pytest.mark.parametrize(
    "name",
    [one if one == "ratings" else pytest.param(one, marks=pytest.mark.slow) for one in REPORTS],
)
def test_a_report_shows_all_of_each_part(name, tmp_path, write_journals):
    with drawn_wide():
        folder = report_of(name, tmp_path, write_journals)
    check(folder, REPORTS[name], (folder / "report.html").read_text(encoding="utf-8"))


@pytest.mark.slow
@pytest.mark.parametrize("words", COMMANDS)
def test_a_command_of_one_table_prints_and_writes_all_of_its_part(words, tmp_path):
    study, parts = COMMANDS[words]
    TABLES[study][2]().to_csv(tmp_path / "rows.csv", index=False)
    command, *rest = words
    arguments = ["analysis", command, str(tmp_path / "rows.csv"), *rest]
    with drawn_wide():
        done = metamerlab(*arguments, "--out", str(tmp_path / "out"), env={"COLUMNS": "200"})

    page = (tmp_path / "out" / "report.html").read_text(encoding="utf-8")
    check(tmp_path / "out", parts, page)
    for name in parts:
        assert SAID[name].get("caption", "") in done.output
        assert SAID[name].get("sentence", "") in done.output
        figure = SAID[name].get("figure")
        drawn = tmp_path / "out" / "figures" / f"{figure}-2-column.svg"
        assert drawn.is_file() or not figure


def test_simulated_times_are_marked_on_terminal_page_and_figure(tmp_path):
    rows = TABLES["ratings"][2]().assign(simulated=1)
    rows.to_csv(tmp_path / "rows.csv", index=False)
    arguments = ["analysis", "reaction", str(tmp_path / "rows.csv"), "--out", str(tmp_path / "out")]
    with drawn_wide():
        done = metamerlab(*arguments, env={"COLUMNS": "200"}, status=None)

    assert "108 reaction times of 6 participants · all together (SIMULATED)" in done.output
    page = (tmp_path / "out" / "report.html").read_text(encoding="utf-8")
    assert "SIMULATED DATA" in page
    assert "SIMULATED" in re.findall(r"<svg.*?</svg>", page, flags=re.DOTALL)[0]


# Reading times.


@pytest.fixture(scope="module")
def trials() -> pd.DataFrame:
    return TABLES["two-answers"][2]()


def times_of(folder, rows: pd.DataFrame) -> Any:
    rows.to_csv(folder / "rows.csv", index=False)
    write_note(folder / "rows.csv", analysis_of("reaction").options(by="method"))
    with undrawn():
        made = report_decisions(folder / "rows.csv", folder / "out", replace=True)
    return json.loads(made.json.read_text())["results"]["times"]


def test_reaction_reads_right_answers_as_all_other_readers_do(trials, tmp_path):
    table = tmp_path / "rows.csv"

    def correct(rows: pd.DataFrame) -> list[int]:
        rows.to_csv(table, index=False)
        return list(read_times(table, by="method")["correct"])

    judged = correct(trials.drop(columns=["expected", "answer"]))
    assert correct(trials.drop(columns="correct")) == judged
    wrong = trials.assign(correct=1)
    wrong.to_csv(tmp_path / "wrong.csv", index=False)
    with pytest.raises(StudyError, match="correct must agree with expected and answer"):
        read_times(tmp_path / "wrong.csv", by="method")


@pytest.mark.parametrize("lost", ["rt_s", "correct"])
def test_rows_without_a_time_or_without_an_answer_are_left_out_and_counted(trials, tmp_path, lost):
    rows = trials.drop(columns=["expected", "answer"]).astype({lost: object})
    rows.loc[[3, 5], lost] = ""
    rows.to_csv(tmp_path / "rows.csv", index=False)
    table = Table(tmp_path / "rows.csv")
    assert len(read_times(table, by="method")) == len(rows) - 2
    assert "left out without an answer: 2 rows (lines 5, 7)" in table.notes


def shown(kind, options, rows, part) -> Presentation:
    """Blocks that a part shows of rows."""
    analysis = analysis_of(kind)
    plan = analysis.plan_of_table(rows, "rows", analysis.options(**options))
    found, _ = computed(analysis.parts, analysis.table(rows, plan), plan)
    (own,) = (one for one in analysis.parts if one.name == part)
    return own.show(found[part], plan)


def texts(blocks) -> str:
    return " ".join(block.text for block in blocks if isinstance(block, Paragraph))


def test_scenes_that_are_none_have_no_deviation(trials):
    options = {"by": "method"}
    assert "scenes" not in texts(shown("reaction", options, trials, "times").blocks)
    told = shown("reaction", options, TABLES["ratings"][2](), "times")
    assert "scenes " in texts(told.blocks)
    effects = "participants, scenes, participants x conditions, scenes x conditions"
    assert f"random over {effects} (log(rt_s) ~ condition + (1 | participant)" in told.methods
    assert "scenes x conditions 0" in texts(told.blocks)


@pytest.mark.slow
def test_widths_of_logarithmic_levels_are_headed_as_ratios():
    rows = TABLES["two-answers"][2]().query("participant < 'P003'")
    for log, head in ((True, "Width, as a ratio"), (False, "Width")):
        options = {"level": "level", "by": "method", "falling": True, "log": log}
        for part in ("psychometric", "thresholds"):
            drawn = shown("psychometric", options, rows.assign(order=1), part)
            tables = [block for block in drawn.blocks if isinstance(block, Rows)]
            assert head in {column.title for table in tables for column in table.columns}
    assert "t with degrees of freedom of participants - 1" in drawn.methods


def test_what_holds_p_of_d_prime_and_of_differences_is_said():
    rows = pd.DataFrame(
        [
            (f"P{p}", method, expected, expected if (k + p + extra) % 8 or not k else "no", 1)
            for p in range(4)
            for method, extra in (("a", 0), ("b", 4))
            for k in range(12)
            for expected in ("yes", "no")
        ],
        columns=["participant", "method", "expected", "answer", "kind"],
    )
    rows["correct"] = (rows["expected"] == rows["answer"]).astype(int)
    drawn = shown("detection", {"signal": "yes", "by": "method"}, rows, "sensitivity")
    (cautions,) = (b for b in drawn.blocks if isinstance(b, Cautions) and "sensit" in b.title)
    assert any("d': p is held at 0.12, the least that 4 participants" in n for n in cautions.notes)


# The runner.


@dataclass(frozen=True)
class Number:
    value: float
    notes: tuple[str, ...] = ()


class Draws(Part[Any, Number]):
    name = "draws"
    section = ("own", "Own")

    def __init__(self, name: str = "draws", needs: tuple[str, ...] = (), problem: str = "") -> None:
        self.name, self.needs, self.problem = name, needs, problem  # type: ignore[misc]

    def compute(self, _table, _plan, found, chance):
        if self.problem:
            raise ValueError(self.problem)
        return Number(sum(one.value for one in found.values()) or chance.random())

    def show(self, found, _plan):
        return Presentation(sentences=(f"{found.value}",))


NOTHING = pd.DataFrame({"participant": []})


def test_a_part_sees_the_numbers_of_those_that_it_needs_whatever_their_order():
    asked: list[str] = []
    parts = (Draws("sum", needs=("a", "b", "absent")), Draws("b"), Draws("a"))
    found, notes = computed(parts, NOTHING, PLAN, asked.append)

    assert list(found) == ["sum", "b", "a"]
    assert asked.index("sum") == 2
    assert found["sum"].value == found["a"].value + found["b"].value
    assert notes == ()


def test_what_a_part_draws_does_not_hang_on_other_parts():
    alone, _ = computed((Draws("a"),), NOTHING, PLAN)
    both, _ = computed((Draws("b"), Draws("a")), NOTHING, PLAN)
    assert alone["a"] == both["a"]


def test_a_part_that_can_say_nothing_says_why_and_stops_no_other():
    parts = (Draws("of_one", problem="found 1"), Draws("b"), Draws("c", needs=("of_one",)))
    found, notes = computed(parts, NOTHING, PLAN)
    assert set(found) == {"b", "c"}
    assert notes == ("no of one: found 1",)


@pytest.mark.parametrize(
    ("parts", "said"),
    [((Draws("a", ("b",)), Draws("b", ("a",))), "circle"), ((Draws("a"), Draws("a")), "names")],
)
def test_parts_in_a_circle_and_of_one_name_are_a_fault_of_the_program(parts, said):
    with pytest.raises(RuntimeError, match=said):
        computed(parts, NOTHING, PLAN)


def test_medians_are_those_of_the_table(trials, tmp_path):
    found = times_of(tmp_path, trials)
    wanted = trials.groupby(["method", "participant"])["rt_s"].median()
    for name, medians in found["medians"].items():
        assert medians == pytest.approx(wanted[name].to_list())
        assert np.exp(np.mean(np.log(medians))) == pytest.approx(
            next(one["mean_of_medians"] for one in found["summary"] if one["condition"] == name)
        )


def test_a_table_along_a_level_can_be_imported_and_reported(tmp_path):
    """The same parts as the command `psychometric`, by the door of reports."""
    TABLES["four-answers"][2]().query("participant < 'P003'").to_csv(
        tmp_path / "rows.csv", index=False
    )
    told = ("level=level", "by=method", "falling=true", "guess=0.25")
    asked = [word for one in told for word in ("--set", one)]
    for words in (
        (
            "import",
            tmp_path / "rows.csv",
            "--task",
            "psychometric",
            *asked,
            "--out",
            tmp_path / "i",
        ),
        ("report", tmp_path / "i" / "decisions.csv", "--out", tmp_path / "out", "--no-figures"),
    ):
        with undrawn():
            metamerlab("analysis", *map(str, words))

    numbers = json.loads((tmp_path / "out" / "results.json").read_text())
    assert len(numbers["results"]["psychometric"]["people"]) == 4
    assert numbers["settings"]["guess"] == 0.25


@pytest.mark.parametrize(
    ("content", "said"),
    [
        (
            {"format": 1, "results": {}},
            "format must be 2 (got 1, of another metamerlab); write the",
        ),
        ({"title": "t", "result": {}}, "must be the results.json of a report"),
        ([], "must be the results.json of a report"),
        ({"format": 2, "simulated": False}, "(settings is not as its format says)"),
    ],
)
def test_results_of_before_or_of_something_else_get_one_message(tmp_path, content, said):
    (tmp_path / "results.json").write_text(json.dumps(content))
    with pytest.raises(StudyError, match=re.escape(said)):
        read_results(tmp_path / "results.json")


def test_what_exclusions_change_is_told_of_a_labs_part_too(monkeypatch):
    """Before, only shipped parts told their main numbers without exclusions."""

    class Told(Draws):
        def wanted(self, _table, _plan):
            return True

        def estimates(self, found, _plan):
            return (Estimate("a lab's number", found.value, 0.0, 1.0, 0.5, 3),)

    monkeypatch.setattr("analysis.parts.ADDED", {"lab": lambda: Told("lab", needs=("times",))})
    table = TABLES["ratings"][2]().assign(rt_s=1.0)
    monkeypatch.setattr(Draws, "compute", lambda *_: Number(0.25))
    analysis = analysis_of("reaction")
    found = estimates_of(with_added(analysis.parts), analysis.table(table, PLAN), PLAN)
    assert [one.what for one in found] == ["a lab's number"]
