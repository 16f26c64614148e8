"""Estimates are printed with as many digits as their limits need."""

import json
import re

import numpy as np
import pytest
from fixed_studies import PLAN, STORED

from analysis.models.contrasts import Difference
from analysis.models.mixed.deviations import Deviation
from analysis.parts.random_effects import ModelEffects, RandomEffectResults, RatingEffects
from analysis.parts.ratings import RatingsPart
from analysis.parts.shared import apa_difference
from analysis.plans.rating_plan import RatingPlan
from analysis.plans.table_sections import RatingTableSection
from analysis.plots import psychometric_plot
from analysis.report.wording import number, number_range, size, size_range


@pytest.mark.parametrize(
    ("value", "ends", "said"),
    [
        (442.3, (441.8, 442.9), "442.3 [441.8, 442.9]"),
        (442.31, (442.02, 442.62), "442.31 [442.02, 442.62]"),
        (18.24, (16.6, 19.9), "18.2 [16.6, 19.9]"),
        (0.0123, (0.01, 0.015), "0.0123 [0.0100, 0.0150]"),
        (12345.0, (12000.0, 12700.0), "12345 [12000, 12700]"),
        (1.2e-6, (1.1e-6, 1.35e-6), "1.2e-06 [1.1e-06, 1.35e-06]"),
        (2.1, (0.0, 5.2), "2.10 [0, 5.20]"),
        (7.0, (7.0, 7.0), "7 [7, 7]"),
        (0.239, (0.1, 0.327), "0.239 [0.100, 0.327]"),
        (-0.0388, (-0.0751, -0.00246), "-0.0388 [-0.0751, -0.0025]"),
        (0.000638, (-0.0748, 0.0761), "0.0006 [-0.0748, 0.0761]"),
        (175.0, (89.7, 347.0), "175 [90, 347]"),
        (0.00213, (0.0001, 52.0), "0.00213 [0.0001, 52.0]"),
    ],
)
def test_levels_have_as_many_digits_as_their_limits_need(value, ends, said):
    assert f"{size(value, within=ends)} {size_range(ends)}" == said


def test_differences_with_narrow_limits_are_never_all_zeros():
    gap = Difference("threshold", "ours", "blur", 0.0012, 0.0002, 0.0008, 0.0016, 0.95, 9, 0.01,
                     0.01)  # fmt: skip

    assert "0.00120 in threshold, 95% CI [0.00080, 0.00160]" in apa_difference(gap, PLAN)
    assert number(1.25, within=(1.0, 1.5)) == "1.25"
    assert number_range(-0.5, 0.5) == "[-0.50, 0.50]"


def test_two_ticks_of_near_levels_can_be_told_apart():
    (axes,) = psychometric_plot(
        {"ours": (np.array([442.1, 442.9]), np.array([5.0, 9.0]), np.array([10.0, 10.0]), None)},
        x_label="level", chance=0.5, logarithmic=True, width_in=3.33,
    ).axes[:1]  # fmt: skip

    assert [tick.get_text() for tick in axes.get_xticklabels()] == ["442.10", "442.90"]


def ends_alike(text):
    """Return whether the number before limits ends at the digit at which they do."""
    before, ends = re.fullmatch(r"(.*)\[(.*)\].*", text).groups()
    value = re.findall(r"-?\d*\.?\d+", re.sub(r"\d+% CI", "", before))[-1]
    return len({len(one.partition(".")[2]) for one in (value, *ends.split(", "))}) == 1


@pytest.mark.parametrize("ends", [(0.352, 0.399), (0.0, 0.065), (0.17, 0.49), (12.3, 12.31)])
def test_sentences_print_value_and_limits_to_one_digit(ends):
    middle = sum(ends) / 2
    level = Deviation("participant", middle, *ends, 0.1)
    plan = RatingPlan(section=RatingTableSection(), study="", title="", scale=())
    effects = RandomEffectResults((ModelEffects("", (level,)),), ())
    (deviation,) = RatingEffects(RatingsPart()).show(effects, plan).sentences

    assert ends_alike(deviation.partition(" (ICC")[0])


def test_stored_sentences_print_value_and_limits_to_one_digit():
    """Of every kind of fixed study; odds end by their size, and trials are counts."""
    sentences = [
        one
        for file in sorted(STORED.glob("*.json"))
        for one in json.loads(file.read_text(encoding="utf-8"))["sentences"]
    ]
    told = [
        said
        for one in sentences
        for said in re.findall(r"[^;]*?\[-?[\d.]+, [\d.]+\]", re.sub(r"\[T\..*?\]", "", one))
        if not re.search("odds|OR = |trials, ", said)
    ]

    assert len(told) > 100
    assert [said for said in told if not ends_alike(said)] == []
