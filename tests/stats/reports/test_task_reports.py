"""Reports of tasks with right answers: from sessions and from tables, numbers and page alike."""

import json
import re
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest
from command_line import result_of
from made_up_trials import TaskDesign, simulate_abx, simulate_identification, simulate_yes_no
from scipy import stats
from study_texts import files_recipe, short_study
from undrawn_reports import drawn_wide, undrawn
from well_formed import check_well_formed

from analysis.export.write_export import export_study
from analysis.models.detection import YesNoResults
from analysis.parts import computed
from analysis.power import power
from analysis.report.report_source import TableSettings
from analysis.report.wording import share
from analysis.report.write_report import report_decisions, report_sessions
from analysis.tasks import KINDS, analysis_of, analysis_of_task
from analysis.tasks.note import note_path, read_note, write_note
from analysis.tidy import read_sessions
from protocols.answer_rules import answer_rule
from protocols.errors import StudyError
from protocols.load import load_display, load_protocol
from protocols.study_file.schema import StudyProtocol
from study_app.observers import default_model
from study_app.simulate import SimulatedStudy, simulate_study

pytestmark = pytest.mark.slow
VALIDATOR = Path(sys.executable).parent / "bids-validator-deno"

SCENES = ("park", "house", "lane")
ECCENTRICITIES = (5, 10, 15, 20)
SCALINGS = (0.1, 0.2, 0.4, 0.8)
GAPS = ("up", "down", "left", "right")
QUEST = """
[task.adaptive]
rule = "quest-plus"
column = "ecc_deg"
by = ["method"]
trials = 24
threshold = [5.0, 10.0, 15.0, 20.0]
width = [10.0, 20.0]
guess = [0.25]
shape = "weibull"
falling = true
"""


def study_text(
    kind: str,
    answers: tuple[str, ...],
    shown: list[dict[str, object]],
    *,
    task: str,
    repeats: int,
    analysis: str,
) -> str:
    """Return a study of pictures that are named by what they show."""
    names = ("-".join(re.sub(r"\W", "-", str(value)) for value in one.values()) for one in shown)
    return short_study(
        name=kind,
        title="Made up <b>&amp;",
        participants=6,
        stimuli=files_recipe(dict(zip(names, shown, strict=True))),
        task=f"stimulus_s = 0.2\n{task}",
        answers=answers,
        design=f"repeats = {repeats}",
        trial="fixation_s = 0.1\niti_s = 0.1",
        analysis=analysis,
    )


def yes_no_text(methods: tuple[str, ...] = ("reference", "ours"), *, repeats: int = 2) -> str:
    shown = [
        {"scene": scene, "method": method, "cut": cut}
        for scene in SCENES
        for method in methods
        for cut in ("consistent", "inconsistent")
    ]
    return yes_no_study(shown, repeats)


def yes_no_study(shown: list[dict[str, object]], repeats: int) -> str:
    return study_text(
        "yes-no",
        ("yes", "no"),
        shown,
        task='kind = "yes-no"\nsignal = { cut = ["inconsistent"] }',
        repeats=repeats,
        analysis='kind = "detection"\nbaseline = "reference"',
    )


def shared_noise_text() -> str:
    """Methods that always hold the signal, beside a reference that never does."""
    cuts = {"reference": "consistent", "blur": "inconsistent", "ours": "inconsistent"}
    shown = [
        {"scene": scene, "method": method, "cut": cut}
        for scene in (*SCENES, "pier", "wood", "lawn")
        for method, cut in cuts.items()
    ]
    return yes_no_study(shown, 6)


def identification_text(*, adaptive: str = "", repeats: int = 1) -> str:
    shown = [
        {"method": method, "ecc_deg": eccentricity, "gap": gap}
        for method in ("reference", "ours")
        for eccentricity in ECCENTRICITIES
        for gap in GAPS
    ]
    return study_text(
        "identification",
        GAPS,
        shown,
        task='kind = "identification"\nalternatives = ["up", "down", "left", "right"]\n'
        f'named_by = "gap"\n{adaptive}',
        repeats=repeats,
        analysis='kind = "identification"\nbaseline = "reference"\n'
        'level = "ecc_deg"\nfalling = true',
    )


def abx_text(*, repeats: int = 4) -> str:
    shown = [
        {"scene": scene, "method": "ours", "scaling": scaling}
        for scene in SCENES[:2]
        for scaling in SCALINGS
    ]
    standards = [{"scene": scene, "method": "reference", "scaling": 0.0} for scene in SCENES[:2]]
    return study_text(
        "abx",
        ("a", "b"),
        [*shown, *standards],
        task='kind = "abx"\nstandard = { method = "reference" }',
        repeats=repeats,
        analysis='kind = "abx"\nlevel = "scaling"',
    )


TEXTS = {
    "yes-no": yes_no_text(),
    "identification": identification_text(),
    "adaptive": identification_text(adaptive=QUEST),
    "abx": abx_text(),
}
SECTIONS = {
    "yes-no": ("correct", "sensitivity", "models", "people", "checks"),
    "identification": ("correct", "sensitivity", "levels", "models", "people", "checks"),
    "adaptive": ("levels", "correct", "sensitivity", "models", "people", "checks"),
    "abx": ("levels", "correct", "sensitivity", "models", "people", "checks"),
}
FIGURES = {
    "yes-no": {
        "correct", "detection", "sensitivity", "participants", "scenes", "learning", "reaction",
    },
    "identification": {
        "correct", "sensitivity", "confusion", "psychometric", "goodness", "people",
        "participants", "learning", "reaction",
    },
    "adaptive": {
        "correct", "sensitivity", "confusion", "psychometric", "goodness", "people",
        "participants", "reaction",
    },
    "abx": {
        "correct", "sensitivity", "psychometric", "goodness", "people", "scaling",
        "participants", "scenes", "learning", "reaction",
    },
}  # fmt: skip


def protocol_of(text: str, folder: Path) -> StudyProtocol:
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "study.toml").write_text(text)
    return load_protocol(folder / "study.toml")


@pytest.fixture(scope="module", params=TEXTS)
def reported(request, tmp_path_factory) -> SimpleNamespace:
    """A study of each task: simulated, and reported."""
    folder = tmp_path_factory.mktemp(request.param)
    protocol = protocol_of(TEXTS[request.param], folder)
    model = replace(default_model(protocol), strength={"reference": 0.8, "ours": 2.2})
    simulate_study(SimulatedStudy(protocol, load_display("fhd27-60hz"), 3, model), folder / "s", 6)
    made = report_sessions(folder / "s", protocol, folder / "r", figure_files="none")
    return SimpleNamespace(
        task=request.param,
        protocol=protocol,
        sessions=folder / "s",
        folder=folder / "r",
        made=made,
        html=made.html.read_text(encoding="utf-8"),
        numbers=json.loads(made.json.read_text()),
    )


def test_every_section_and_figure_of_the_task_is_on_the_page(reported):
    links = re.findall(r'<a href="#([^"]+)">', reported.html)
    drawn = set(re.findall(r'<figure id="fig-([^"]+)">', reported.html))

    assert tuple(links[: len(SECTIONS[reported.task])]) == SECTIONS[reported.task]
    assert drawn == FIGURES[reported.task]
    assert reported.html.count("<strong>Simulated data.</strong>") == len(drawn)


def test_the_page_is_well_formed_whole_and_escaped(reported):
    check_well_formed(reported.html)
    assert "<h1>Made up &lt;b&gt;&amp;amp;</h1>" in reported.html
    assert "<script" not in reported.html
    visible = re.sub(r"<(style|svg).*?</\1>", "", reported.html, flags=re.DOTALL)
    assert not re.search(r"\b(nan|NaN|inf|None|null|undefined)\b", visible)


def test_numbers_of_the_page_are_those_of_the_json_and_of_the_trials(reported):
    rows = read_sessions(reported.sessions, reported.protocol).analysed
    results = reported.numbers["results"]

    text = reported.made.json.read_text()
    assert "NaN" not in text
    assert "Infinity" not in text
    assert reported.numbers["simulated"] is True
    assert reported.numbers["settings"]["kind"] == reported.protocol.analysis.kind
    assert results["rates"]["conditions"]
    for rate in results["rates"]["conditions"]:
        part = rows[rows["method"] == rate["condition"]]
        assert (rate["count"], rate["trials"]) == (part["correct"].sum(), len(part))
        assert f"{rate['count']} / {rate['trials']}" in reported.html
        assert share(rate["share"]) in reported.html
        assert rate["chance"] == pytest.approx(1 / len(reported.protocol.task.answers()))
    for name, counts in results.get("thresholds", {"counts": {}})["counts"].items():
        part = rows[rows["method"] == name]
        assert sum(counts["trials"]) == len(part)


def test_tables_beside_the_page_hold_every_decision_and_what_columns_mean(reported):
    tables = reported.folder / "tables"
    rows = pd.read_csv(tables / "decisions.csv")
    meanings = pd.read_csv(tables / "dictionary.csv")

    assert len(rows) == sum(
        rate["trials"] for rate in reported.numbers["results"]["rates"]["conditions"]
    )
    named = meanings[meanings["table"] == "decisions"]["column"]
    assert list(rows.columns) == list(named)
    assert not named.duplicated().any()
    assert not (tables / "pwcmp.csv").exists()
    rates = pd.read_csv(tables / "rates.csv")
    assert list(rates["trials"]) == [
        r["trials"] for r in reported.numbers["results"]["rates"]["conditions"]
    ]


@pytest.mark.parametrize("reported", ["abx"], indirect=True)
def test_run_again_every_number_is_the_same(reported, tmp_path):
    """Figures, too, come out the same: `test_report.py` and `test_plots.py` see to it."""
    with undrawn():
        report_sessions(reported.sessions, reported.protocol, tmp_path / "r", figure_files="none")

    for name in ("results.json", "tables/decisions.csv", "tables/rates.csv"):
        assert (tmp_path / "r" / name).read_bytes() == (reported.folder / name).read_bytes(), name


def test_the_baseline_comes_first_and_comparisons_are_with_it(reported):
    settings, results = reported.numbers["settings"], reported.numbers["results"]

    order = [rate["condition"] for rate in results["rates"]["conditions"]]
    assert order == settings["values"]
    assert [one["condition"] for one in results["sensitivity"]["conditions"]] == order
    assert all(one["second"] == order[0] for one in results["comparisons"]["differences"])
    assert len(results["comparisons"]["differences"]) == len(order) - 1
    measure = {"yes-no": "d'", "identification": "share correct", "adaptive": "ln threshold"}
    if reported.task in measure:
        (one,) = results["comparisons"]["differences"]
        assert one["measure"] == measure[reported.task]
        assert one["difference"] > 0
        assert f"ours minus reference: {one['difference']:.2f}" in reported.made.headline


def test_psychometric_functions_have_the_shape_that_the_rule_plans_with(reported):
    results = reported.numbers["results"]
    shape = "weibull" if reported.task == "adaptive" else "gauss"

    assert reported.numbers["settings"]["shape"] == shape
    assert results.get("thresholds", {"shape": shape})["shape"] == shape
    for said in ("Shape: Weibull", "natural logarithms of thresholds"):
        assert (said in reported.html) == (reported.task == "adaptive")


def test_levels_chosen_from_answers_are_said_to_spoil_shares(reported):
    said = any("levels were chosen from the answers" in note for note in reported.made.warnings)

    assert said == (reported.task == "adaptive")


def test_tidy_tables_say_their_task_and_give_the_same_numbers_again(reported, tmp_path):
    toml = reported.folder.parent / "study.toml"
    run("tidy", reported.sessions, "--protocol", toml, "--out", tmp_path / "t", status=None)
    with undrawn():
        made = report_decisions(tmp_path / "t" / "decisions.csv", tmp_path / "r")
    found = json.loads(made.json.read_text())

    kind = read_note(tmp_path / "t" / "decisions.csv").kind
    assert kind == reported.protocol.analysis.kind
    assert found["simulated"] is True
    for part, numbers in (("rates", "conditions"), ("comparisons", None), ("thresholds", "counts")):
        before, after = (one["results"].get(part) for one in (found, reported.numbers))
        assert before == after or before[numbers] == after[numbers], part


def test_exports_of_every_task_are_valid(reported, tmp_path):
    with pytest.raises(StudyError, match="pwcmp takes preferences between pairs"):
        export_study(reported.sessions, reported.protocol, tmp_path / "w", "pwcmp")
    assert not (tmp_path / "w").exists()
    if not VALIDATOR.is_file():
        pytest.skip("bids-validator-deno is not installed (it is in the extra `dev`)")
    toml = reported.folder.parent / "study.toml"
    run(
        "export", reported.sessions, "--protocol", toml, "--format", "bids",
        "--out", tmp_path / "b",
    )  # fmt: skip
    checked = subprocess.run(
        [VALIDATOR, "--format", "json", "--max-rows", "-1", tmp_path / "b"],
        capture_output=True,
        text=True,
        timeout=200,
    )
    issues = json.loads(checked.stdout)["issues"]["issues"]
    assert [issue for issue in issues if issue["severity"] == "error"] == []


# Strength of simulated observers, recovered.


def analysed(kind: str, trials: pd.DataFrame, folder: Path, **options: object):
    """Return settings and numbers by part of a table that went through a file."""
    analysis = analysis_of(kind)
    trials.to_csv(folder / "t.csv", index=False)
    chosen = analysis.options(**options)
    rows = analysis.read(folder / "t.csv", chosen)
    settings = analysis.plan_of_table(rows, "t", chosen)
    return settings, computed(analysis.parts, analysis.table(rows, settings), settings)[0]


def test_d_prime_and_criterion_of_simulated_observers_come_out(tmp_path):
    trials = simulate_yes_no(
        TaskDesign(12, 4, 12),
        {"reference": 0.8, "ours": 2.0},
        np.random.default_rng(1),
        criterion=0.3,
        criterion_sd=(0.2, 0.1),
        d_prime_sd=(0.2, 0.1),
    )
    settings, results = analysed(
        "detection", trials, tmp_path, signal="inconsistent", baseline="reference"
    )

    assert settings.answers == ("inconsistent", "consistent")
    assert isinstance(results["sensitivity"], YesNoResults)
    for one, true in zip(results["sensitivity"].conditions, (0.8, 2.0), strict=True):
        assert one.d_prime.value == pytest.approx(true, abs=0.25)
        assert one.criterion.value == pytest.approx(0.3, abs=0.15)
    (gap,) = results["comparisons"].differences
    assert gap.lower < 1.2 < gap.upper
    assert gap.p < 0.01
    typical = dict(results["typical"].fits)["ours"]["signal"]
    assert abs(typical.estimate - 2.0) < 3 * typical.standard_error


def test_thresholds_of_simulated_observers_come_out_without_naming_answers(tmp_path):
    trials = simulate_identification(
        TaskDesign(10, 1, 8),
        {"reference": 12.0, "ours": 18.0},
        np.random.default_rng(2),
        levels=(4.0, 8.0, 12.0, 16.0, 20.0, 24.0),
        width=-12.0,
        alternatives=4,
        participant_sd=1.5,
    ).drop(columns=["expected", "answer", "scene"])
    settings, results = analysed(
        "identification", trials, tmp_path,
        level="level", falling=True, alternatives=4, baseline="reference",
    )  # fmt: skip

    assert settings.chance == 0.25
    assert [one.condition for one in results["thresholds"].thresholds] == ["reference", "ours"]
    for one, true in zip(results["thresholds"].thresholds, (12.0, 18.0), strict=True):
        assert one.lower < true < one.upper
    slope = results["models"].independent["level"].estimate
    assert slope < 0
    assert results["models"].independent["method[T.ours]"].estimate > 0


def test_critical_scalings_of_simulated_observers_come_out(tmp_path):
    trials = simulate_abx(
        TaskDesign(10, 2, 10),
        {"blur": 0.15, "ours": 0.3},
        np.random.default_rng(3),
        scalings=(0.1, 0.2, 0.3, 0.4, 0.6, 0.8),
    )
    settings, results = analysed("abx", trials, tmp_path, level="scaling", test="participant")

    assert settings.answers == ("A", "B")
    for one, true in zip(results["critical"].fits, (0.15, 0.3), strict=True):
        assert one.critical_limits[0] < true < one.critical_limits[1]
    (gap,) = results["critical"].contrasts
    assert gap.p < 0.01
    assert results["sensitivity"].answered.share == pytest.approx(0.5, abs=0.1)


def test_conditions_that_always_hold_the_signal_share_the_noise_of_the_reference(tmp_path):
    both = simulate_yes_no(
        TaskDesign(8, 3, 12), {"ours": 1.0, "blur": 2.0}, np.random.default_rng(4)
    )
    noise = both["expected"] == "consistent"
    both.loc[noise, "method"] = "reference"
    settings, results = analysed("detection", both, tmp_path, signal="inconsistent")

    shown = [one.condition for one in results["sensitivity"].conditions]
    assert shown == ["blur", "ours"]
    for one in results["sensitivity"].conditions:
        assert one.false_alarms + one.correct_rejections == int(noise.sum())
    assert [one.condition for one in results["rates"].conditions] == ["blur", "ours", "reference"]
    (gap,) = results["comparisons"].differences
    assert (gap.first, gap.second) == ("ours", "blur")
    assert any("share those of the others" in note for note in results["sensitivity"].notes)
    assert settings.values[0] == "blur"


def test_a_test_over_participants_alone_leaves_scenes_out(tmp_path):
    trials = simulate_yes_no(TaskDesign(6, 4, 4), {"ours": 1.0}, np.random.default_rng(5))
    _, both = analysed("detection", trials, tmp_path, signal="inconsistent")
    _, people = analysed("detection", trials, tmp_path, signal="inconsistent", test="participant")

    assert both["rates"].conditions[0].scenes == 4
    assert people["rates"].conditions[0].scenes == 1
    assert people["people"].scenes == {}
    assert both["rates"].conditions[0].share == people["rates"].conditions[0].share


def unanimous(trials: pd.DataFrame) -> pd.DataFrame:
    return trials.assign(answer=trials["expected"], correct=1)


def never_said(trials: pd.DataFrame) -> pd.DataFrame:
    there = trials["expected"] == "inconsistent"
    return trials.assign(answer="consistent", correct=(~there).astype(int))


def only_signal(trials: pd.DataFrame) -> pd.DataFrame:
    return trials[trials["expected"] == "inconsistent"]


def bare(trials: pd.DataFrame) -> pd.DataFrame:
    return trials.drop(columns=["rt_s", "order", "scene"])


def unnamed(trials: pd.DataFrame) -> pd.DataFrame:
    return trials.drop(columns=["expected", "answer"])


def one_person(trials: pd.DataFrame) -> pd.DataFrame:
    return trials[trials["participant"] == "P001"]


def odd_names(trials: pd.DataFrame) -> pd.DataFrame:
    people = trials["participant"].replace({"P001": "$x$ <b>", "P002": "{{ 7*7 }}"})
    return trials.assign(participant=people, method=r"$\\frac{$ <img src=x>").drop(columns="order")


@pytest.mark.parametrize(
    ("kind", "change"),
    [
        *[("detection", one) for one in (never_said, only_signal, one_person)],
        *[("identification", one) for one in (bare, odd_names)],
        *[("abx", one) for one in (unanimous, unnamed, one_person)],
    ],
)
def test_odd_studies_give_reports_without_nonsense(tmp_path, kind, change):
    design, rng = TaskDesign(3, 2, 3), np.random.default_rng(9)
    made = {
        "detection": (lambda: simulate_yes_no(design, {"a": 1.0, "b": 2.0}, rng)),
        "identification": (
            lambda: simulate_identification(
                design, {"a": 1.5, "b": 2.0}, rng, levels=(1, 2, 3), width=2.0, alternatives=3
            )
        ),
        "abx": (lambda: simulate_abx(design, {"a": 0.1, "b": 0.2}, rng, scalings=(0.1, 0.2, 0.4))),
    }
    options: dict[str, dict[str, object]] = {
        "detection": {"signal": "inconsistent"},
        "identification": {"level": "level", "alternatives": 3},
        "abx": {"level": "scaling"},
    }
    table = tmp_path / "t.csv"
    change(made[kind]()).to_csv(table, index=False)
    write_note(table, analysis_of(kind).options(**options[kind]))
    with drawn_wide():
        html = report_decisions(table, tmp_path / "r", figure_files="none").html.read_text()

    assert "not to trust" in html
    visible = re.sub(r"<(style|svg).*?</\1>", "", html, flags=re.DOTALL)
    assert not re.search(r"\b(nan|NaN|inf|None)\b", visible)
    assert "<img" not in html
    if change is one_person:
        assert "one participant only" in html
        assert (
            json.loads((tmp_path / "r" / "results.json").read_text())["results"]["comparisons"][
                "differences"
            ]
            == []
        )


# Tables of other tools.


run = result_of("analysis")


@pytest.fixture
def hits(tmp_path) -> Path:
    """Write a table of another tool: who, which method, how far out, hit or miss."""
    rng = np.random.default_rng(6)
    rows = [
        {"who": f"<p{p}>", "how": how, "ecc": ecc, "hit": int(rng.random() < 0.95 - 0.025 * ecc)}
        for p in range(5)
        for how in ("a", "b")
        for ecc in (5, 10, 15, 20)
        for _ in range(4)
    ]
    pd.DataFrame(rows).to_csv(tmp_path / "hits.csv", index=False)
    return tmp_path / "hits.csv"


def test_a_table_of_another_tool_gives_psychometric_functions_without_a_program(hits, tmp_path):
    made = run(
        "import", hits, "--task", "identification", "--map", "participant=who", "--map",
        "method=how", "--map", "correct=hit", "--set", "level=ecc", "--set", "falling=true",
        "--set", "alternatives=2", "--set", "baseline=b", "--out", tmp_path / "i",
    )  # fmt: skip
    assert "160 decisions of 5 participants" in made.output
    run("report", tmp_path / "i" / "decisions.csv", "--out", tmp_path / "r", "--no-figures")

    found = json.loads((tmp_path / "r" / "results.json").read_text())
    assert found["settings"]["values"] == ["b", "a"]
    thresholds = found["results"]["thresholds"]["thresholds"]
    assert {one["condition"] for one in thresholds} == {"a", "b"}
    widths = [one["width"] for one in thresholds]
    assert any(widths)  # a curve whose threshold the answers do not place has none
    assert all(width < 0 for width in widths if width is not None)
    titled = ("--title", "Acuity <1>", "--no-figures")
    with undrawn():
        assert run(
            "report",
            tmp_path / "i" / "decisions.csv",
            "--out",
            tmp_path / "t",
            *titled,
            status=None,
        )
    assert "<title>Acuity &lt;1&gt;" in (tmp_path / "t" / "report.html").read_text()
    html = (tmp_path / "r" / "report.html").read_text()
    assert "&lt;p0&gt;" in html
    assert "<p0>" not in html
    assert "SIMULATED" not in html
    columns = pd.read_csv(tmp_path / "i" / "decisions.csv").columns
    assert "who" not in columns
    assert list(pd.read_csv(tmp_path / "i" / "dictionary.csv")["column"]) == list(columns)


@pytest.mark.parametrize(
    ("arguments", "wanted"),
    [
        (["--task", "abc"], "did you mean 'abx'"),
        (["--task", "abx", "--set", "levels=ecc"], "did you mean 'level'"),
        (["--task", "abx", "--set", "level=eccc"], r"eccc.*did you mean 'ecc'|'eccc'"),
        (["--task", "abx", "--set", "alpha=2"], r"--set alpha: must be at most 0.5 \(got 2\)"),
        (["--task", "abx", "--set", "shape=cauchy"], "--set shape: must be 'gauss', 'logistic'"),
        (["--task", "abx", "--set", "alpha.a=2"], "--set alpha: must be a number"),
        (
            ["--task", "abx", "--set", "alpha=0.1", "--set", "alpha.a=2"],
            "--set alpha: must be a num",
        ),
        (["--task", "abx", "--set", "exclusions=x"], "must have keys of the analysis 'abx'"),
        (["--task", "abx", "--set", "level"], "--set must read NAME=VALUE"),
        (["--task", "abx", "--set", "by=how", "--set", "baseline=c"], "must be a value of 'how'"),
        (["--task", "yes-no"], "must have the columns expected and answer"),
        (["--task", "identification"], "--set alternatives: must say how many answers"),
    ],
)
def test_a_table_that_does_not_fit_its_task_is_refused_whole(hits, tmp_path, arguments, wanted):
    maps = ["--map", "participant=who", "--map", "correct=hit"]
    done = run("import", hits, *maps, *arguments, "--out", tmp_path / "i", status=2)

    assert re.search(wanted, re.sub(r"\s+", " ", done.output)), done.output
    assert not (tmp_path / "i").exists()


def test_a_table_of_right_answers_without_a_note_asks_for_its_task(hits, tmp_path):
    pd.read_csv(hits).rename(columns={"hit": "correct"}).to_csv(hits, index=False)
    done = run("report", hits, "--out", tmp_path / "r", status=2)

    assert "analysis import --task TASK" in re.sub(r"\s+", " ", done.output)


@pytest.mark.parametrize(
    ("content", "wanted"),
    [
        ("[]", "must be what 'metamerlab analysis import' notes"),
        ("not json", "must be what 'metamerlab analysis import' notes"),
        ('{"format": 9, "analysis": {"kind": "abx"}}', "format must be 2"),
        ('{"format": 1, "analysis": {"kind": "abx"}}', "make it anew: metamerlab analysis import"),
        ('{"format": 2, "analysis": {"kind": "abc"}}', "analysis 'abc': must be one of"),
        ('{"format": 2, "analysis": {"kind": "abx", "bye": "x"}}', "did you mean 'by'"),
        ('{"format": 2, "analysis": {"kind": "abx", "exclusions": {}}}', "must have keys of"),
    ],
)
def test_a_file_beside_a_table_that_is_no_note_is_named(tmp_path, content, wanted):
    table = tmp_path / "d.csv"
    note_path(table).write_text(content)

    with pytest.raises(StudyError, match=wanted):
        read_note(table)


def test_a_note_read_again_says_what_was_written(tmp_path):
    options = analysis_of("detection").options(by="method", level="x", falling=True, signal="seen")
    write_note(tmp_path / "d.csv", options)

    assert read_note(tmp_path / "d.csv") == options
    assert read_note(tmp_path / "e.csv") is None


@pytest.mark.parametrize(("stated", "said"), [("null", 0), ("0.75", 1)])
def test_a_note_of_a_version_with_more_keys_is_read_and_says_what_is_ignored(
    tmp_path, stated, said
):
    content = f'{{"format": 2, "analysis": {{"kind": "abx", "threshold_at": {stated}}}}}'
    note_path(tmp_path / "d.csv").write_text(content)
    notes: list[str] = []

    assert read_note(tmp_path / "d.csv", notes).kind == "abx"
    assert len(notes) == said
    assert all("analysis.threshold_at is ignored: it was removed" in one for one in notes)


def test_a_protocol_given_for_a_table_must_know_its_conditions(tmp_path):
    protocol = protocol_of(yes_no_text(), tmp_path)
    trials = simulate_yes_no(
        TaskDesign(3, 1, 2), {"other": 1.0}, np.random.default_rng(7), answers=("yes", "no")
    )
    trials.to_csv(tmp_path / "t.csv", index=False)

    with pytest.raises(StudyError, match=r"method must be one of the protocol's .*got other"):
        report_decisions(tmp_path / "t.csv", tmp_path / "r", table=TableSettings(protocol))


def test_every_task_has_an_analysis_and_an_unknown_one_is_named():
    assert {analysis_of_task(name).kind for name in TEXTS if name != "adaptive"} == {
        "detection",
        "identification",
        "abx",
    }
    assert analysis_of_task("two-interval").kind == "preference"
    assert all(analysis_of(kind).kind == kind for kind in KINDS)
    with pytest.raises(StudyError, match="must be one of preference, detection"):
        analysis_of("preferance")


# Power.


EFFECTS = {
    "yes-no": {"difference": 1.2},
    "shared noise": {"difference": 1.2},
    "identification": {"difference": 1.2},
    "adaptive": {"difference": 0.3},
    "abx": {"d_prime": 3.0},
}


@pytest.mark.parametrize("task", EFFECTS)
def test_power_rises_with_people_and_finds_nothing_where_nothing_is(tmp_path, task, full):
    protocol = protocol_of((TEXTS | {"shared noise": shared_noise_text()})[task], tmp_path)
    simulation = analysis_of(protocol.analysis.kind).simulation(protocol)
    assert set(EFFECTS[task]) <= {one.name for one in simulation.assumptions}
    studies = 100 if full else 50
    rng = np.random.default_rng(8)
    found = power(simulation, EFFECTS[task], rng=rng, studies=studies).numbers

    assert 6 in found["participants"]
    assert found["each"][0] < found["each"][-1]
    assert found["each"][-1] > 0.75
    # More false ones would be a wonder at .05 (p < .005).
    assert found["false_positives"].max() <= stats.binom.isf(0.005, studies, 0.05) / studies
    assert (found["every"] <= found["each"] + 1e-12).all()


def test_power_against_chance_is_that_of_the_binomial_where_nobody_differs(tmp_path):
    """One trial each: participants are independent trials, and their shares can be counted."""
    text = study_text(
        "abx",
        ("a", "b"),
        [{"scene": "park", "method": name} for name in ("ours", "reference")],
        task='kind = "abx"\nstandard = { method = "reference" }',
        repeats=1,
        analysis='kind = "abx"',
    )
    protocol = protocol_of(text, tmp_path)
    assumed = {"d_prime": 2.5, "participant_sd": 0.0}
    rng, studies = np.random.default_rng(4), 200
    simulation = analysis_of("abx").simulation(protocol)
    found = power(simulation, assumed, rng=rng, studies=studies).numbers
    share = float(answer_rule("differencing").share(np.array(2.5)))

    each = zip(found["participants"], found["each"], strict=True)
    tried = [(n, p) for n, p in each if n >= 10]
    assert len(tried) >= 3
    for people, found_in in tried:
        count = np.arange(people + 1)
        ratio = np.abs(count / people - 0.5) / np.sqrt(0.25 / (people - 1))
        rejected = 2 * stats.t.sf(ratio, people - 1) < 0.05
        by_hand = stats.binom.pmf(count, people, share)[rejected].sum()
        assert found_in == pytest.approx(by_hand, abs=4 * np.sqrt(0.25 / studies))


def test_the_power_command_prints_what_it_took_for_true_and_refuses_the_rest(tmp_path):
    protocol_of(yes_no_text(repeats=1), tmp_path)
    toml = tmp_path / "study.toml"
    done = run("power", toml, "--set", "difference=1.5", "--studies", 100, "--out", tmp_path / "p")

    assert "difference 1.5" in re.sub(r"\s+", " ", done.output)
    assert "6 (planned)" in done.output
    assert json.loads((tmp_path / "p" / "power.json").read_text())["studies"] == 100
    for given, wanted in (
        ("rate=0.7", "must name what this task's simulation takes for true"),
        ("diference=1", "did you mean 'difference'"),
        ("d_prime=-1", "must be a number from 0 to inf"),
        ("d_prime=x", "must be a number from 0"),
    ):
        refused = run("power", toml, "--set", given, status=2)
        assert wanted in re.sub(r"\s+", " ", refused.output), refused.output
