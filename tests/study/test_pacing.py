"""Every planted timing fault is found, and nothing else."""

import math
import random

import pytest
from attack.planted import RATES_HZ, check_capture, check_timing, planted, stage_with

from protocols.load import load_display
from study_app.attempt import BLANK
from study_app.pacing import Pacer
from study_app.stage import FlipPicture


@pytest.mark.parametrize("rate_hz", RATES_HZ)
@pytest.mark.parametrize("off_share", [0.0, 0.0005, -0.0005])
def test_200_planted_faults_are_found_and_no_other(rate_hz, off_share):
    check_timing(200, rate_hz, off_share, seed=rate_hz)


@pytest.mark.parametrize("seed", range(30))
def test_whatever_is_amiss_in_a_capture_is_found(seed):
    check_capture(seed)


def test_jitter_below_the_threshold_is_no_fault():
    chance = random.Random(1)
    pacer = Pacer(60)

    kinds = [pacer.flip((k + chance.uniform(-0.06, 0.06)) / 60).kind for k in range(2000)]

    assert set(kinds[1:]) == {"on-time"}


def test_refreshes_add_up_to_the_time_passed():
    faults = planted(200, 3000, seed=9)
    stage = stage_with(faults, 120)
    pacer = Pacer(120)
    flips = [pacer.flip(stage.show(FlipPicture(BLANK)).t_s) for _ in range(3000)]

    assert sum(flip.refreshes for flip in flips) == math.floor(
        (flips[-1].t_s - flips[0].t_s) * 120 + 0.5
    )


def test_stamps_that_run_backwards_are_refused():
    pacer = Pacer(60)
    pacer.flip(1.0)
    with pytest.raises(ValueError, match="backwards"):
        pacer.flip(0.9)


def test_a_shipped_display_s_rate_paces_its_virtual_twin():
    display = load_display("fhd24-144hz")
    stage = stage_with({}, display.refresh_hz)
    pacer = Pacer(display.refresh_hz)
    flips = [pacer.flip(stage.show(FlipPicture(BLANK)).t_s) for _ in range(1440)]

    assert {flip.kind for flip in flips[1:]} == {"on-time"}
