"""Estimates are printed with as many digits as their limits need."""

import numpy as np
import pytest

from analysis.models.contrasts import Difference
from analysis.parts.shared import apa_difference
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
    ],
)
def test_levels_have_as_many_digits_as_their_limits_need(value, ends, said):
    assert f"{size(value, within=ends)} {size_range(ends)}" == said


def test_differences_with_narrow_limits_are_never_all_zeros():
    gap = Difference("threshold", "ours", "blur", 0.0012, 0.0002, 0.0008, 0.0016, 0.95, 9, 0.01,
                     0.01)  # fmt: skip

    assert "0.00120 in threshold, 95% CI [0.00080, 0.00160]" in apa_difference(gap)
    assert number(1.25, within=(1.0, 1.5)) == "1.25"
    assert number_range(-0.5, 0.5) == "[-0.50, 0.50]"


def test_two_ticks_of_near_levels_can_be_told_apart():
    (axes,) = psychometric_plot(
        {"ours": (np.array([442.1, 442.9]), np.array([5.0, 9.0]), np.array([10.0, 10.0]), None)},
        x_label="level", chance=0.5, logarithmic=True, width_in=3.33,
    ).axes[:1]  # fmt: skip

    assert [tick.get_text() for tick in axes.get_xticklabels()] == ["442.10", "442.90"]
