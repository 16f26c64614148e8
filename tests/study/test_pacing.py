"""Every planted timing fault is found, and nothing else."""

from __future__ import annotations

import math
import random

import pytest

from protocols.load import load_display
from study_app.attempt import BLANK
from study_app.observers import ArtificialObserver, PreferenceModel
from study_app.pacing import LATE_SHARE, Pacer
from study_app.stage import Picture
from study_app.virtual import Fault, VirtualClock, VirtualStage

RATES_HZ = [60, 90, 120, 144, 240]


def stage_with(faults, rate_hz, true_hz=None):
    """A virtual display with faults by number of flip, and no one before it."""
    observer = ArtificialObserver(PreferenceModel(), None, 0, "P01")
    stage = VirtualStage(
        VirtualClock(),
        true_hz or rate_hz,
        observer,
        nominal_hz=rate_hz,
        on_prepare=lambda _trial, _attempt: faults,
    )
    stage.prepare(None, 1)
    return stage


def planted(count, flips, seed):
    """Faults at distinct flips, never at the first: there is no flip before to judge it by."""
    chance = random.Random(seed)
    faults = {}
    for flip in sorted(chance.sample(range(1, flips), count)):
        kind = chance.choice(["late", "missed", "doubled"])
        amount = {
            "late": chance.uniform(LATE_SHARE + 0.05, 0.45),
            "missed": float(chance.randint(1, 4)),
            "doubled": 0.0,
        }[kind]
        faults[flip] = Fault(kind, amount)
    return faults


@pytest.mark.parametrize("rate_hz", RATES_HZ)
@pytest.mark.parametrize("off_share", [0.0, 0.0005, -0.0005])
def test_200_planted_faults_are_found_and_no_other(rate_hz, off_share):
    faults = planted(200, 3000, seed=rate_hz)
    stage = stage_with(faults, rate_hz, rate_hz * (1 + off_share))
    pacer = Pacer(stage.refresh_hz)

    found = {}
    for number in range(3000):
        flip = pacer.flip(stage.show(Picture(BLANK)).t_s)
        if flip.kind not in ("first", "on-time"):
            found[number] = (flip.kind, flip.missed)

    wanted = {
        number: (fault.kind, int(fault.amount) if fault.kind == "missed" else 0)
        for number, fault in faults.items()
    }
    assert found == wanted  # precision and recall are both 1


def test_jitter_below_the_threshold_is_no_fault():
    chance = random.Random(1)
    pacer = Pacer(60)

    kinds = [pacer.flip((k + chance.uniform(-0.06, 0.06)) / 60).kind for k in range(2000)]

    assert set(kinds[1:]) == {"on-time"}


def test_refreshes_add_up_to_the_time_passed():
    faults = planted(200, 3000, seed=9)
    stage = stage_with(faults, 120)
    pacer = Pacer(120)
    flips = [pacer.flip(stage.show(Picture(BLANK)).t_s) for _ in range(3000)]

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
    flips = [pacer.flip(stage.show(Picture(BLANK)).t_s) for _ in range(1440)]

    assert {flip.kind for flip in flips[1:]} == {"on-time"}
