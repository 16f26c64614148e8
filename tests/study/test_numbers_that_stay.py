"""Numbers that stay as once computed: trials, hashes and the numbers of a report.

`golden/` holds what earlier revisions gave: hashes and the trial lists of 50 slots of three shipped
studies; `results.json` of the report of five simulated sessions of `showcase` (seed 11, 2 of 1000
flips missed, 2 late, 1 doubled; its numbers under the names that they have today). A change of
these files needs a decision.
"""

import gzip
import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from undrawn_reports import undrawn

from analysis.report.write_report import report_sessions
from protocols.disk.hashing import sha256_bytes, sha256_json
from protocols.feasibility import virtual_manifest
from protocols.load import load_protocol, load_study
from protocols.plan import PlannedTrial, make_plan
from study_app.simulate import SimulatedStudy, simulate_study

DATA = Path(__file__).parent / "golden"
STUDIES = ("demo", "inpainting-2afc", "showcase")
PLANS = json.loads((DATA / "plans.json").read_text())
WRITTEN_WITH = "c1e3682bdbd2668fa0f152d361a17a879209f86f9453256c759e809561e07626"
"""Hash that `arithmetic` gives where `results.json` was written."""
CLOSED = {"rel": 1e-9, "abs": 1e-12}
MIXED = {"rel": 1e-5, "abs": 1e-6}


def row(trial: PlannedTrial) -> list[object]:
    """A trial in the words of the first trial lists."""
    said = trial.condition
    return [
        trial.id, trial.block, trial.role == "practice", trial.role == "catch", trial.repeat,
        said["scene"], said["size"], said["first"], said["second"],
        said[trial.correct] if trial.correct else None,
        "left" if trial.answers[0] == "first" else "right",
    ]  # fmt: skip


@pytest.mark.parametrize("name", STUDIES)
def test_50_participants_meet_the_same_trials_in_the_same_order(name):
    protocol, display = load_study(Path(name))
    manifest, wanted = virtual_manifest(protocol, display), PLANS[name]
    found = [
        [row(trial) for trial in make_plan(protocol, manifest, f"P{slot:03d}", slot).trials]
        for slot in range(50)
    ]

    assert found[0] == wanted["slot_0"]
    assert [sha256_json(rows) for rows in found] == wanted["slots"]


@pytest.mark.parametrize("name", STUDIES)
def test_a_study_keeps_its_hashes(name):
    """Keys that were added later and say nothing are no part of a hash (`without_nothing`)."""
    protocol = load_protocol(Path(name))

    assert protocol.sha256 == PLANS[name]["protocol_sha256"]
    assert protocol.stimuli_sha256 == PLANS[name]["stimuli_sha256"]


@pytest.fixture(scope="module")
def sessions(tmp_path_factory) -> Path:
    """Five simulated sessions, with planted faults of the display."""
    protocol, display = load_study(Path("showcase"))
    faults = {"missed_per_flip": 0.002, "late_per_flip": 0.002, "doubled_per_flip": 0.001}
    root = tmp_path_factory.mktemp("sessions")
    simulate_study(SimulatedStudy(protocol, display, seed=11, **faults), root, 5)
    return root / "showcase"


def arithmetic() -> str:
    """A hash of what linear algebra and functions give here, to the last digit.

    They take other instructions on other processors, and so round elsewhere.
    """
    square = (np.arange(1, 1601).reshape(40, 40) * 7919 % 1009) / 1009
    even = square @ square.T + 40.0 * np.eye(40)
    found = [
        even, np.linalg.solve(even, square), np.linalg.eigvalsh(even),
        np.linalg.pinv(square[:, :8]), np.array(np.linalg.slogdet(even)),
        np.exp(square), np.log1p(square), np.tanh(square),
    ]  # fmt: skip
    return sha256_bytes(b"".join(np.ascontiguousarray(part).tobytes() for part in found))


def differences(old: Any, new: Any, place: str = "", *, exact: bool = True) -> list[str]:
    """Places where `new` does not say what `old` says; what it says besides is no difference.

    Not `exact`: numbers may differ by what another processor's rounding makes of them.
    """
    if isinstance(old, dict) and isinstance(new, dict):
        return [
            found
            for key, value in old.items()
            for found in differences(
                value, new.get(key, "(missing)"), f"{place}.{key}", exact=exact
            )
        ]
    if isinstance(old, list) and isinstance(new, list) and len(old) == len(new):
        return [
            found
            for index, pair in enumerate(zip(old, new, strict=True))
            for found in differences(*pair, f"{place}[{index}]", exact=exact)
        ]
    mixed = place.startswith(".results.choice_models")
    exact = exact and not place.startswith(".results.scale")  # its sums go in another order now
    if isinstance(old, float) and isinstance(new, float) and (mixed or not exact):
        near = MIXED if mixed else CLOSED
        return [] if new == pytest.approx(old, **near) else [f"{place}: {old!r} {new!r}"]
    return [] if type(old) is type(new) and old == new else [f"{place}: {old!r} {new!r}"]


def test_a_report_gives_the_numbers_it_gave(sessions, tmp_path):
    """To the last digit where arithmetic rounds as it did on the machine that wrote them; but for
    the mixed models, which have been computed another way since (decision 0166).

    Elsewhere nothing can bring the digits back: a sum of products rounds once or twice, by the
    processor. Rounding in the file would hide it up to a number that lies on an edge, and would
    change the file. So other machines are held to what was found when this one was made to compute
    as four others do (OpenBLAS for Prescott, Haswell, Zen, and numpy without AVX2): closed formulas
    moved by less than 1e-12, and the mixed models by less than 1e-6; their limits are searched.
    (They moved by up to 1e-4 of a standard error until the curvature was taken at the mode itself,
    decision 0055; that moved the stored numbers by at most 2e-4 of a standard error.)
    """
    with undrawn():
        made = report_sessions(
            sessions.parent, load_protocol(Path("showcase")), tmp_path / "out", figure_files="none"
        )
    old = json.loads(gzip.decompress((DATA / "results.json.gz").read_bytes()))
    new = json.loads(made.json.read_text(encoding="utf-8"))
    libraries = [said["provenance"].pop("libraries") for said in (old, new)]

    exact = arithmetic() == WRITTEN_WITH and libraries[0] == libraries[1]
    assert differences(old, new, exact=exact) == []


def test_every_difference_of_two_results_is_found():
    old = {"a": [1, 2.0, None], "b": {"c": "x"}}

    assert differences(old, old | {"new": 1}) == []
    assert differences(old, {"a": [1, 2.0 + 1e-7, None], "b": {"c": "x"}}) == [
        ".a[1]: 2.0 2.0000001"
    ]
    assert differences(old, {"a": [1, 2.0], "b": {"c": "y"}}) == [
        ".a: [1, 2.0, None] [1, 2.0]", ".b.c: 'x' 'y'",
    ]  # fmt: skip
    assert differences({"a": 2.0}, {"a": math.nextafter(2.0, 3.0)}) == [
        ".a: 2.0 2.0000000000000004"
    ]
    assert differences({"a": 2.0}, {"a": 2.0 + 1e-10}, exact=False) == []
    assert differences({"a": 2.0}, {"a": 2.0 + 1e-7}, exact=False) == [".a: 2.0 2.0000001"]
    models = [{"results": {"choice_models": [value]}} for value in (1.0, 1.0000005, 1.00001)]
    assert differences(*models[:2], exact=False) == []
    assert differences(*models[::2], exact=False) == [".results.choice_models[0]: 1.0 1.00001"]
    assert differences(old, {"a": [True, 2.0, None]}) == [
        ".a[0]: 1 True", ".b: {'c': 'x'} '(missing)'",
    ]  # fmt: skip
