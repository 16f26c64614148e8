"""Benchmarks of foveated pictures: banks of pyramids, shares of time, tables and plots."""

import numpy as np
import pytest

from benchmarks import foveate_bands
from benchmarks.foveate_bands import Row
from benchmarks.shared import foveate_report
from benchmarks.shared.foveate_report import Line
from benchmarks.shared.output import conditions
from benchmarks.shared.pyramid_banks import (
    haar,
    laplacian,
    printed_metamer,
    small_kernels,
    steerable,
)
from pipeline.foveation.geometry import Flat
from pipeline.foveation.pooling import Pools, make_pooling

EDGE = 128
BANKS = [haar(3), laplacian(3), *(steerable(count, 3) for count in (1, 2, 4, 6))]


def named(bank) -> str:
    return f"{bank.name} {bank.orientations}"


@pytest.mark.parametrize("bank", BANKS, ids=named)
def test_a_bank_puts_together_what_it_splits(bank, rng):
    luma = rng.random((EDGE, EDGE))
    np.testing.assert_allclose(bank.join(bank.split(luma), luma.shape), luma, atol=1e-12)


def test_the_small_kernels_bank_is_the_projects_pyramid(rng):
    """Power is flat within 8 %; without the coarser high bands more is lost."""
    smooth = np.cumsum(np.cumsum(rng.standard_normal((EDGE, EDGE)), axis=0), axis=1)
    luma = smooth / np.abs(smooth).max()
    lost = []
    for everywhere in (True, False):
        bank = small_kernels(3, high_everywhere=everywhere)
        lost.append(np.abs(bank.join(bank.split(luma), luma.shape) - luma).mean())
    assert lost[0] < 0.01
    assert lost[1] > lost[0]


def test_what_is_kept_of_a_pixel_follows_from_the_bands():
    """By hand: two moments; 3 bands on 1 + 1/4 + 1/16 coefficients, a band, 3 on 1/4 + ..."""
    sums = 1 + 1 / 4 + 1 / 16
    assert small_kernels(3).kept_per_px() == pytest.approx(6 * sums)
    assert laplacian(3).kept_per_px() == pytest.approx(2 * sums)
    assert haar(3).kept_per_px() == pytest.approx(6 / 4 * sums)
    assert steerable(4, 3).kept_per_px() == pytest.approx(2 + 8 * sums)


@pytest.mark.parametrize("bank", [small_kernels(3), haar(3), steerable(2, 3)], ids=named)
def test_a_printed_metamer_keeps_the_fovea_and_the_periphery_s_contrast(bank, rng):
    picture = np.repeat(rng.uniform(0.35, 0.65, (EDGE, EDGE, 1)), 3, axis=2).astype(np.float32)
    middle = (EDGE / 2, EDGE / 2)
    pools = Pools(Flat(40.0).of(EDGE, EDGE), middle, make_pooling("v1"))
    shown, first_s, second_s = printed_metamer(picture, pools, bank, seed=1)

    away = pools.eccentricity_deg()
    np.testing.assert_array_equal(shown[away <= 1], picture[away <= 1])
    assert shown[away > 8].std() == pytest.approx(picture[away > 8].std(), rel=0.12)
    assert abs(np.corrcoef(shown[away > 8][:, 0], picture[away > 8][:, 0])[0, 1]) < 0.2
    assert first_s > 0
    assert second_s > 0


LINES = [
    Line(512, "copy", "gpu", 2.0, 1.0, None, 0.1, 1.0, passes=1, held_bytes=0),
    Line(512, "blur", "gpu", 12.0, 10.0, None, 1.0, 10.0, 4.0, 6.0, 12, 2**20, 2**20),
    Line(512, "metamer", "gpu", 40.0, 30.0, None, 3.1, 31.0, 12.0, 18.0, 13, 8 * 2**20, 3 * 2**20),
    Line(512, "gen_metamer", "odak", 900.0, 800.0, 700.0),
]


def test_tables_say_time_ratio_and_memory_of_analysis_and_synthesis():
    text = foveate_report.markdown(LINES, "a card", "a processor, load 1")

    assert text.startswith("a card; a processor, load 1. ms per frame (least of the runs")
    assert "| `metamer` | gpu | 30 (3.10) | 13 | 32 |" in text
    assert "| `gen_metamer` | odak | 700 |  |  |" in text
    assert "| `metamer` | 512² | 12 | 18 | 3.0 | 5.0 |" in text


def test_a_plot_of_times_is_the_same_file_twice(tmp_path):
    files = [tmp_path / "a.svg", tmp_path / "b.svg"]
    for file in files:
        foveate_report.plot(LINES, "a card", file)

    assert files[0].read_bytes() == files[1].read_bytes()
    text = files[0].read_text("utf-8")
    assert "its analysis" in text
    assert "gen_metamer (odak)" in text


def test_the_table_of_bands_names_pictures_and_law(tmp_path):
    rows = [
        Row("ours", "residual pooled", 5, 2, 15, "3x3", 8.0, 0.12, 0.9, 1.1, 5.2, 70.0, None, 50.0),
        Row("ours", "residual kept", 5, 2, 15, "3x3", 8.0, 0.11, 0.9, 1.1, 5.3, 71.0, None, 50.0),
        Row("as printed", "Haar", 5, 2, 15, "2x2", 2.0, 0.2, 0.7, 1.3, None, 30.0, 0.4, None),
    ]  # fmt: skip
    text = foveate_bands.markdown(rows, "a card", ["one", "two"], "v1", 256)

    assert "2 pictures (one, two), 256 x 256 px, 40 degrees wide, law `v1`; a card." in text
    assert "| as printed: Haar | 5 | 2 | 15 | 2x2 | 2.0 | 0.200 | 0.70 to 1.30 |  | 30 |  |" in text
    foveate_bands.plot(rows, tmp_path / "bands.svg")
    assert "Haar" in (tmp_path / "bands.svg").read_text("utf-8")


def test_results_say_which_machine_and_how_busy_it_was():
    found = conditions("numpy", "a package that nobody has")

    assert set(found) == {
        "processor", "cores", "platform", "python", "libraries", "revision", "load_average_before",
    }  # fmt: skip
    assert list(found["libraries"]) == ["numpy"]
    assert found["load_average_before"] >= 0
