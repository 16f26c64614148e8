"""Reports of right answers claim only what was done, and only what their data identify."""

import re
import warnings
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from made_up_trials import TaskDesign, simulate_abx, simulate_identification, simulate_yes_no

from analysis.models.critical_scaling import critical_scaling
from analysis.models.curves.population import Threshold
from analysis.models.thresholds import fit_thresholds
from analysis.parts import computed
from analysis.parts.curves.critical import apa_critical
from analysis.parts.levels import apa_thresholds
from analysis.tasks import analysis_of

UNKNOWN = "not identified by these data"


def told(kind: str, trials: pd.DataFrame, folder: Path, **options: object):
    """Return numbers by part, the blocks' text, and methods, sentences and captions as one text."""
    analysis = analysis_of(kind)
    trials.to_csv(folder / "t.csv", index=False)
    chosen = analysis.options(**options)
    rows = analysis.read(folder / "t.csv", chosen)
    settings = analysis.plan_of_table(rows, "t", chosen)
    found, _ = computed(analysis.parts, analysis.table(rows, settings), settings)
    parts = analysis.parts_of(settings)
    shown = [part.show(found[part.name], settings) for part in parts if part.name in found]
    page = repr([(one.blocks, one.others) for one in shown])
    captions = [figure.caption for one in shown for figure in one.figures]
    sentences = [sentence for one in shown for sentence in one.sentences]
    return found, page, " ".join([*(one.methods for one in shown), *sentences, *captions])


@pytest.fixture(scope="module")
def matched() -> pd.DataFrame:
    return simulate_abx(
        TaskDesign(6, 3, 3), {"v1": 0.2}, np.random.default_rng(3), scalings=[0.1, 0.3, 0.8]
    )


@pytest.fixture(scope="module")
def detected() -> pd.DataFrame:
    design = TaskDesign(6, 4, 4)
    return simulate_yes_no(design, {"blur": 1.5, "ours": 0.5}, np.random.default_rng(5))


def at_chance(trials: pd.DataFrame) -> pd.DataFrame:
    """Return trials half of which are right, whatever was shown."""
    return trials.drop(columns=["expected", "answer"]).assign(correct=np.arange(len(trials)) % 2)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("kind", "trials", "options"),
    [
        ("abx", "matched", {"level": "scaling"}),
        ("detection", "detected", {"signal": "inconsistent"}),
    ],
)
def test_scenes_are_spoken_of_only_where_errors_respect_them(
    kind, trials, options, tmp_path, request
):
    table = request.getfixturevalue(trials)
    _, page, text = told(kind, table, tmp_path, **options)
    assert "clustered by participant and scene" in text
    assert "respect participants and scenes" in text
    assert "both as crossed random intercepts" in text
    assert "Share of right answers by scene, with 95 % limits of people like these" in page
    assert "clusters its errors by participant and scene; the third has them as crossed" in page

    for rows, test in (
        (table, "participant"),
        (table.drop(columns="scene"), "participant-scene"),
        (table.assign(scene="park"), "participant-scene"),
    ):
        _, page, text = told(kind, rows, tmp_path, test=test, **options)
        assert "clustered by participant" in text
        assert "respect participants;" in text
        assert "participants as random intercepts" in text
        assert "clusters its errors by participant; the third has participants as random" in page
        assert not re.search(r"and scene|crossed|two-way", text)
        assert not re.search(r"participants? and scene\b|crossed", page)


@pytest.mark.slow
def test_critical_scalings_decide_come_first_and_say_whom_they_speak_of(matched, tmp_path):
    design = TaskDesign(6, 3, 3)  # what people guess is not compared: another that they see
    other = simulate_abx(design, {"v2": 0.25}, np.random.default_rng(4), scalings=[0.1, 0.3, 0.8])
    both = pd.concat([matched, other]).drop(columns=["expected", "answer", "order"])
    results, page, text = told("abx", both, tmp_path, level="scaling")
    (gap,) = results["critical"].contrasts

    assert results["comparisons"].differences == (gap,)
    assert gap.measure == "ln s_c"
    assert set(results["critical"].fits[0].scenes) == set(both["scene"])
    assert "Limits speak of people like these and scenes like these." in page
    assert "Critical scalings by scene" in page
    assert page.index("Critical scaling") < page.index("d' from shares of right answers")
    assert "random over participants and scenes" in text

    _, page, text = told("abx", both, tmp_path, level="scaling", test="participant")
    assert "Limits speak of people like these and these scenes." in page
    assert "Critical scalings by scene" not in page


def test_a_critical_scaling_or_gain_that_is_not_bounded_is_no_number(matched):
    fit = critical_scaling(matched)
    known = replace(fit, critical_limits=(0.1, 0.3), gain_limits=(2.0, 9.0), warnings=())
    assert UNKNOWN not in apa_critical(known)

    for ends in ((0.0, float("inf")), (1e-200, 1e200), None):
        text = apa_critical(replace(known, gain=123.0, gain_limits=ends))
        assert f"gain {UNKNOWN}" in text
        assert "s_c = " in text
        assert not re.search(r"123|\binf\b|of ln gain", text)
    chance = at_chance(matched)
    text = apa_critical(critical_scaling(chance))
    assert f"s_c {UNKNOWN}; gain {UNKNOWN}; lapse" in text


def test_a_critical_scaling_that_is_not_identified_is_no_number_in_the_table(matched, tmp_path):
    chance = at_chance(matched)
    results, page, _ = told("abx", chance, tmp_path, level="scaling")

    (fit,) = results["critical"].fits
    assert not fit.critical_identified
    assert f"'{fit.critical:.3g}'" not in page
    assert f"'{UNKNOWN}', 'none', '{UNKNOWN}', 'none', 'none'" in page


def test_a_threshold_between_the_levels_is_placed_and_one_far_outside_is_not():
    levels = np.array([1.0, 2.0, 3.0, 4.0, 5.0])
    one = Threshold("ours", 3.0, 2.0, 4.0, 2.0, {})
    assert one.identified(levels.tolist())
    assert not replace(one, value=-1.25e5).identified(levels.tolist())
    assert not replace(one, lower=None, upper=None).identified(levels.tolist())


def test_a_threshold_that_is_not_identified_is_no_number_in_table_or_sentence(matched, tmp_path):
    flat = at_chance(matched)
    results, page, text = told("abx", flat, tmp_path, level="scaling")

    assert f"'{UNKNOWN}', 'none', 'none'" in page
    model = results["thresholds"]
    (one,) = model.thresholds
    assert not one.identified([0.1, 0.3, 0.8])
    assert f"v1 {UNKNOWN}." in text  # and no deviation of people's thresholds
    far = replace(model, thresholds=(replace(one, value=-1.25e5, lower=-2e5, upper=0.0),))
    assert f"v1 {UNKNOWN}." in apa_thresholds(far, levels=[0.1, 0.8])
    assert "v1 -125000, 95% CI [-200000, 0]." in apa_thresholds(far)


def test_thresholds_that_are_not_identified_are_not_compared():
    rows = simulate_identification(
        TaskDesign(6, 1, 8),
        {"a": 14.0, "b": 17.0},
        np.random.default_rng(4),
        levels=[5, 10, 15, 20, 25],
        width=-12.0,
    )
    model = fit_thresholds(rows, "level", ("method",))
    assert len(model.contrasts) == 1
    assert not any("not compared" in note for note in model.warnings)

    lucky = rows["correct"].where(rows["method"] == "a", rows.index % 2)  # b is guessed
    far = fit_thresholds(rows.assign(correct=lucky), "level", ("method",))
    assert np.isnan([far["b"].value, far["b"].width]).all()
    assert (far["b"].lower, far["b"].upper, far["b"].individual) == (None, None, {})
    assert far.contrasts == ()
    assert f"thresholds of a and b are not compared: {UNKNOWN}" in far.warnings


def test_limits_beyond_every_float_are_infinite_without_a_warning(matched, monkeypatch):
    flat = "analysis.models.curves.critical_likelihood._curvature"
    monkeypatch.setattr(flat, lambda _, theta: 1e-6 * np.eye(theta.size))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        fit = critical_scaling(matched)

    assert fit.gain_limits == (0.0, float("inf"))
    assert not fit.gain_identified
    assert f"gain {UNKNOWN}" in apa_critical(fit)
