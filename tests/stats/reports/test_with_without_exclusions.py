"""The report's table of the same numbers with and without what the rules left out."""

import json

import numpy as np
import pandas as pd
import pytest
from undrawn_reports import undrawn

from analysis.models.preference import preferences
from analysis.parts import Estimate, estimates_of
from analysis.plans.table_sections import DetectionTableSection
from analysis.report.exclusion_comparison import ExclusionComparison, beside, beside_blocks
from analysis.report.report_source import from_sessions
from analysis.report.write_report import report_sessions
from analysis.tasks import analysis_of
from analysis.tasks.rates import DetectionRates


def slow_out(protocol, limit_s):
    analysis = protocol.analysis
    changed = analysis.exclusions.model_copy(update={"rt_max_s": limit_s})
    return protocol.model_copy(
        update={"analysis": analysis.model_copy(update={"exclusions": changed})}
    )


@pytest.fixture(scope="module")
def strict(demo_protocol):
    """The demonstration, without answers slower than 1 s: half of the made-up ones."""
    return slow_out(demo_protocol, 1.0)


@pytest.fixture(scope="module")
def journals(write_journals, strict, tmp_path_factory):
    return write_journals(tmp_path_factory.mktemp("beside") / "s", people=5, study=strict)


def test_both_columns_are_the_statistics_of_their_own_decisions(journals, strict):
    source = from_sessions(journals, strict, None)
    found = beside(source)

    assert found is not None
    main = source.tidy.decisions.query("kind == 'main'")
    assert 0 < found.left_out == len(main) - len(source.decisions) < len(main)
    settings = source.plan
    for decisions, column in ((main, found.every), (source.decisions, found.kept)):
        cells = preferences(
            decisions.reset_index(drop=True), pairings=settings.pairings, sizes=settings.sizes,
            alpha=settings.alpha, margin=settings.margin, test=settings.test,
        ).cells  # fmt: skip
        assert [one.value for one in column] == [cell.estimate.share for cell in cells]
        assert [one.p for one in column] == [cell.test.p_adjusted for cell in cells]
        assert sum(one.decisions for one in column) == len(decisions)


@pytest.mark.slow
def test_the_report_shows_them_and_results_hold_them(journals, strict, tmp_path):
    with undrawn():
        made = report_sessions(journals, strict, tmp_path / "r", figure_files="none")
    page = made.html.read_text()
    noted = json.loads(made.json.read_text())["without_exclusions"]

    assert f"With exclusions, and without: rules left out {noted['left_out']} decisions" in page
    assert len(noted["kept"]) == len(noted["every"]) > 0


def test_no_rule_at_work_no_table(write_journals, demo_protocol, tmp_path):
    source = from_sessions(write_journals(tmp_path, people=2), demo_protocol, None)

    assert beside(source) is None
    assert beside_blocks(None) == ()


def test_a_result_that_exclusions_decide_is_named():
    def one(p: float) -> Estimate:
        return Estimate("a over b", 0.6, 0.5, 0.7, p, 40)

    kept, every = one(0.03), one(0.2)
    table, text = beside_blocks(ExclusionComparison((kept,), (every,), 3, 0.05, ("a over b",)))
    _, calm = beside_blocks(ExclusionComparison((kept,), (kept,), 3, 0.05, ()))

    assert "Exclusions decide about: a over b" in text.text
    assert "No result is significant on one side only" in calm.text
    assert table.rows == (
        ("a over b", "0.60", "[0.50, 0.70]", ".030", "40",
         "0.60", "[0.50, 0.70]", ".200", "40"),
    )  # fmt: skip


def _answers(share: float, people: int = 6) -> pd.DataFrame:
    rng = np.random.default_rng(4)
    rows = [
        {"participant": f"P{who}", "scene": scene, "method": method, "expected": truth,
         "answer": truth if rng.random() < share else {"yes": "no", "no": "yes"}[truth]}
        for who in range(people) for scene in "abc" for method in ("ours", "theirs")
        for truth in ("yes", "no") for _ in range(4)
    ]  # fmt: skip
    table = pd.DataFrame(rows)
    table["correct"] = (table["expected"] == table["answer"]).astype(int)
    return table


def test_yes_no_tasks_give_d_prime_and_others_shares():
    rows = _answers(0.8)
    detection = DetectionRates()
    settings = detection.plan_of_table(rows, "t", DetectionTableSection(by="method"))
    identification = analysis_of("identification")
    asked = identification.options(by="method", alternatives=2)
    other = identification.plan_of_table(rows, "t", asked)

    found = [
        one.what for one in estimates_of(detection.parts, detection.table(rows, settings), settings)
    ]
    shares = estimates_of(identification.parts, identification.table(rows, other), other)
    assert found == ["d' of ours", "d' of theirs", "theirs - ours, d'"]
    assert [one.what for one in shares] == [
        "right answers, ours",
        "right answers, theirs",
        "theirs - ours, share correct",
    ]
    assert shares[0].value == pytest.approx(rows.query("method == 'ours'")["correct"].mean())
