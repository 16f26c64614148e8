"""Format 1 is read for ever: the same trials, hashes, pictures and numbers as the old code's.

`format1/` was made at revision 7b43e25, the last that wrote format 1: its studies; the trial lists
of 50 slots of each; five simulated sessions of `showcase` (seed 11, 2 of 1000 flips missed, 2 late,
1 doubled) with the hashes of their side files; and `results.json` of their report.
"""

from __future__ import annotations

import gzip
import json
import math
import re
from collections.abc import Mapping
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np
import pytest
from undrawn_reports import undrawn

from analysis.report.build import report_sessions
from protocols.errors import StudyError
from protocols.feasibility import virtual_manifest
from protocols.hashing import sha256_bytes, sha256_file, sha256_json
from protocols.journal import SessionEnd
from protocols.journal_file import read_journal
from protocols.load import load_display, load_protocol, load_study
from protocols.manifest import Manifest, read_manifest, write_manifest
from protocols.plan import PlannedTrial, make_plan
from protocols.schema import StudyProtocol
from study_app.simulate import Simulation, simulate_sitting, simulate_study

DATA = Path(__file__).parent / "format1"
STUDIES = ("demo", "inpainting-2afc", "showcase")
PLANS = json.loads((DATA / "plans.json").read_text())
CHANGED = {
    r"\.results\.(order|side)\.(p|lower|upper|warnings.*)": "0160",
    r"\.results\.(primary|table\.cells\[\d+\])\.(p|p_adjusted|lower|upper|t|test|effective_n"
    r"|odds_lower|odds_upper|bayes_factor|equivalence_p|verdict|warnings.*)": "0160",
    r"\.results\.models\[\d+\]\[3\]\.(coefficients|random_sd|log_likelihood).*": "0055",
    # Firth rows have limits of the penalised likelihood's profile.
    r"\.results\.models\[\d+\]\[3\]\.(coefficients\[\d+\]\.(lower|upper)|warnings.*)": "0166",
    r"\.results\.scales\[\d+\]\.observers\.p\[\d+\]": "0056",
}
"""Which numbers are not the old code's any more, and the decision that changed them.

`renewed.json` holds what stands in their place, by where it stands in `results.json`.
"""
MADE_ANEW = ("analysed_with", "libraries")
"""What a report says of itself, and not of the data."""
WRITTEN_WITH = "c1e3682bdbd2668fa0f152d361a17a879209f86f9453256c759e809561e07626"
"""What `arithmetic` gives where `results.json` was written."""
CLOSED = {"rel": 1e-9, "abs": 1e-12}
MIXED = {"rel": 1e-6, "abs": 1e-7}


def row(trial: PlannedTrial) -> list[object]:
    """A trial in the words of format 1."""
    said = trial.condition
    return [
        trial.id, trial.block, trial.role == "practice", trial.role == "catch", trial.repeat,
        said["scene"], said["size"], said["first"], said["second"],
        said[trial.correct] if trial.correct else None,
        "left" if trial.answers[0] == "first" else "right",
    ]  # fmt: skip


def study_file(name: str, format_: int) -> Path:
    return DATA / f"{name}.toml" if format_ == 1 else Path(name)


@pytest.mark.parametrize("format_", [1, 2])
@pytest.mark.parametrize("name", STUDIES)
def test_50_participants_meet_the_same_trials_in_the_same_order(name, format_):
    protocol, display = load_study(study_file(name, format_))
    manifest, wanted = virtual_manifest(protocol, display), PLANS[name]
    found = [
        [row(trial) for trial in make_plan(protocol, manifest, f"P{slot:03d}", slot).trials]
        for slot in range(50)
    ]

    assert found[0] == wanted["slot_0"]
    assert [sha256_json(rows) for rows in found] == wanted["slots"]


@pytest.mark.parametrize("name", STUDIES)
def test_a_study_of_format_1_keeps_its_hashes(name):
    protocol = load_protocol(study_file(name, 1))

    assert protocol.format == 1
    assert protocol.sha256 == PLANS[name]["protocol_sha256"]
    assert protocol.stimuli_sha256 == PLANS[name]["stimuli_sha256"]


def with_the_old_fill(path: Path) -> StudyProtocol:
    """A shipped study as it was: the paper's study has shown the printed method since."""
    study = load_protocol(path)
    recipe = study.warped
    methods = tuple(method.model_copy(update={"method": None}) for method in recipe.methods)
    return study.model_copy(update={"stimuli": recipe.model_copy(update={"methods": methods})})


@pytest.mark.parametrize("name", STUDIES)
def test_clips_of_format_1_serve_the_study_in_format_2(name):
    """The hash of what decides the pixels is the same; that of the whole study is not."""
    old, new = load_protocol(study_file(name, 1)), with_the_old_fill(study_file(name, 2))

    assert new.stimuli_sha256 == old.stimuli_sha256
    assert new.sha256 != old.sha256
    assert new.model_copy(update={"format": 1}) == old


def as_format_1(manifest: Manifest, protocol: StudyProtocol) -> Manifest:
    """A manifest without pixels as the old code made it: with the hole shares asked for."""
    asked = {size.name: size.hole_share for size in protocol.warped.sizes}
    clips = tuple(
        clip.model_copy(update={"hole_share": asked[clip.column("size")]})
        for clip in manifest.clips
    )
    return manifest.model_copy(update={"format": 1, "clips": clips})


@pytest.mark.parametrize("name", STUDIES)
def test_a_manifest_of_format_1_keeps_its_hash_and_its_file(name, tmp_path):
    protocol, display = load_study(study_file(name, 1))
    manifest = as_format_1(virtual_manifest(protocol, display), protocol)
    path = write_manifest(tmp_path, manifest)
    raw = json.loads(path.read_text(encoding="utf-8"))

    assert {"scene", "size", "method"} <= set(raw["clips"][0])
    assert not {"name", "condition"} & set(raw["clips"][0])
    assert sha256_file(path) == PLANS[name]["manifest_sha256"]
    read = read_manifest(tmp_path)
    assert read == manifest
    assert read.sha256 == PLANS[name]["manifest_sha256"]


@pytest.mark.parametrize("format_", [1, 2])
def test_a_simulated_sitting_gives_the_same_flips_and_gaze_byte_for_byte(tmp_path, format_):
    protocol, display = load_study(study_file("showcase", format_))
    faults = {"missed_per_flip": 0.002, "late_per_flip": 0.002, "doubled_per_flip": 0.001}
    simulate_study(Simulation(protocol, display, seed=11, **faults), tmp_path, 5)
    root = tmp_path / "showcase"

    found = {
        path.relative_to(root).as_posix(): sha256_file(path)[:16]
        for path in sorted(root.rglob("*.csv"))
    }
    assert found == json.loads((DATA / "side_files.json").read_text())


@pytest.fixture
def old_sittings(tmp_path) -> Path:
    """The five sessions as the old code left them, side files aside."""
    root = tmp_path / "sessions"
    for path in sorted(DATA.glob("*.jsonl.gz")):
        folder = root / "showcase" / path.name.removesuffix(".jsonl.gz")
        folder.mkdir(parents=True)
        (folder / "journal.jsonl").write_bytes(gzip.decompress(path.read_bytes()))
    return root


def test_a_journal_of_format_1_says_what_it_said(old_sittings):
    """Every attempt, read as format 2, against the line as it stands in the file."""
    for path in sorted(old_sittings.rglob("journal.jsonl")):
        journal = read_journal(path)
        assert journal.start.format == 1
        lines = [json.loads(line) for line in path.read_bytes().splitlines()]
        old = [line for line in lines if line["kind"] == "attempt"]
        assert len(old) == len(journal.attempts) > 20
        for line, attempt in zip(old, journal.attempts, strict=True):
            shown = attempt.condition
            assert [shown[key] for key in ("scene", "size", "first", "second")] == [
                line[key] for key in ("scene", "size", "first", "second")
            ]
            assert (attempt.role == "practice", attempt.role == "catch") == (
                line["practice"], line["catch"],
            )  # fmt: skip
            sides = dict(zip(attempt.answers, ("left", "right"), strict=True))
            assert sides["first"] == line["first_side"]
            assert (attempt.answer, sides.get(attempt.answer)) == (
                line["choice"], line["chosen_side"],
            )  # fmt: skip
            assert shown.get(attempt.answer) == line["chosen"]
            assert shown.get(attempt.expected) == line["expected"]
            assert [(s.name, s.sha256) for s in attempt.stimuli] == [
                (clip["clip"], clip["clip_sha256"]) for clip in line["clips"]
            ]
            same = ("trial", "attempt", "position", "outcome", "void_reason", "rt_s", "dropped")
            assert [getattr(attempt, key) for key in same] == [line[key] for key in same]


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


def differences(
    old: Any,
    new: Any,
    place: str = "",
    *,
    exact: bool = True,
    renewed: Mapping[str, Any] = MappingProxyType({}),
) -> list[str]:
    """Where `new` does not say what `old` says; what it says besides is no difference.

    Not `exact`: numbers may differ by what another processor's rounding makes of them. `renewed`
    holds what must stand in some places instead.
    """
    old = renewed.get(place, old)
    if isinstance(old, dict) and isinstance(new, dict):
        return [
            found
            for key, value in old.items()
            for found in differences(
                value, new.get(key, "(missing)"), f"{place}.{key}", exact=exact, renewed=renewed
            )
        ]
    if isinstance(old, list) and isinstance(new, list) and len(old) == len(new):
        return [
            found
            for index, pair in enumerate(zip(old, new, strict=True))
            for found in differences(*pair, f"{place}[{index}]", exact=exact, renewed=renewed)
        ]
    mixed = place.startswith(".results.models")
    if isinstance(old, float) and isinstance(new, float) and (mixed or not exact):
        near = MIXED if mixed else CLOSED
        return [] if new == pytest.approx(old, **near) else [f"{place}: {old!r} {new!r}"]
    return [] if type(old) is type(new) and old == new else [f"{place}: {old!r} {new!r}"]


def test_journals_of_format_1_give_the_numbers_they_gave(old_sittings, tmp_path):
    """To the last digit where arithmetic rounds as it did on the machine that wrote them; but for
    the mixed models, which have been computed another way since (decision 0166).

    Numbers that a later decision changed are listed in `CHANGED`, and held to `renewed.json`.

    Elsewhere nothing can bring the digits back: a sum of products rounds once or twice, by the
    processor. Rounding in the file would hide it up to a number that lies on an edge, and would
    change the file. So other machines are held to what was found when this one was made to compute
    as four others do (OpenBLAS for Prescott, Haswell, Zen, and numpy without AVX2): closed formulas
    moved by less than 1e-12, and the mixed models by less than 1e-6. (They moved by up to 1e-4 of a
    standard error until the curvature was taken at the mode itself, decision 0055; that moved the
    stored numbers by at most 2e-4 of a standard error.)
    """
    showcase = load_protocol(study_file("showcase", 1))
    with undrawn():
        made = report_sessions(old_sittings, showcase, tmp_path / "out", figure_files=False)
    old = json.loads(gzip.decompress((DATA / "results.json.gz").read_bytes()))
    new = json.loads(made.json.read_text(encoding="utf-8"))
    libraries = [said["provenance"]["libraries"] for said in (old, new)]
    for key in MADE_ANEW:
        assert old["provenance"].pop(key) is not None
    # What that code did not look at or say: the lines have no checksums, side files are not here,
    # sessions are simulated, refreshes were missed.
    checked = (
        "without checksums",
        "files beside the journal",
        "simulated",
        "refreshes were missed",
    )
    said = [note for note in new["warnings"] if any(words in note for words in checked)]
    assert len(said) == 8
    first = old["flow"][0]  # that code said "sittings" for sessions
    first["step"] = first["step"].replace("sittings", "sessions")
    new["warnings"] = [note for note in new["warnings"] if note not in said]

    exact = arithmetic() == WRITTEN_WITH and libraries[0] == libraries[1]
    renewed = json.loads((DATA / "renewed.json").read_text(encoding="utf-8"))
    assert differences(old, new, exact=exact, renewed=renewed) == []


def test_only_what_a_decision_changed_is_renewed():
    """Every renewed place exists, says something else than before, and names its decision."""
    old = json.loads(gzip.decompress((DATA / "results.json.gz").read_bytes()))
    renewed = json.loads((DATA / "renewed.json").read_text(encoding="utf-8"))
    decisions = set()
    for page in Path("docs/decisions").glob("*.md"):
        decisions |= {page.name[:4], *re.findall(r"^## (\d{4}) ", page.read_text(), re.MULTILINE)}

    assert set(CHANGED.values()) <= decisions
    for place, value in renewed.items():
        assert any(re.fullmatch(pattern, place) for pattern in CHANGED), place
        said = old
        for step in re.findall(r"[^.\[\]]+", place):
            said = said[int(step)] if isinstance(said, list) else said[step]
        assert said != value, place


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
    assert differences({"a": 2.0, "b": 1}, {"a": 3.0, "b": 1}, renewed={".a": 3.0}) == []
    assert differences({"a": 2.0}, {"a": 2.0}, renewed={".a": 3.0}) == [".a: 3.0 2.0"]
    assert differences({"a": 2.0}, {"a": 2.0 + 1e-7}, exact=False) == [".a: 2.0 2.0000001"]
    models = [{"results": {"models": [value]}} for value in (1.0, 1.0000005, 1.00001)]
    assert differences(*models[:2], exact=False) == []
    assert differences(*models[::2], exact=False) == [".results.models[0]: 1.0 1.00001"]
    assert differences(old, {"a": [True, 2.0, None]}) == [
        ".a[0]: 1 True", ".b: {'c': 'x'} '(missing)'",
    ]  # fmt: skip


@pytest.mark.parametrize("format_", [1, 2])
def test_a_half_done_sitting_of_format_1_is_left_to_the_revision_that_began_it(
    old_sittings, format_
):
    path = old_sittings / "showcase" / "S001" / "journal.jsonl"
    lines = path.read_bytes().splitlines(keepends=True)
    path.write_bytes(b"".join(lines[:12]))
    before = sha256_bytes(path.read_bytes())
    simulation = Simulation(
        load_protocol(study_file("showcase", format_)), load_display("fhd27-60hz"), seed=11
    )

    with pytest.raises(StudyError) as caught:
        simulate_sitting(simulation, old_sittings, "S001")

    assert str(caught.value) == (
        f"{path}: a session must be resumed in its own format (got format 1, this version"
        " records format 2); resume with revision 0.1.0 7b43e25, or analyse it as it is"
    )
    assert sha256_bytes(path.read_bytes()) == before


def test_a_finished_sitting_of_format_1_is_over(old_sittings):
    path = old_sittings / "showcase" / "S002" / "journal.jsonl"
    assert isinstance(read_journal(path).events[-1], SessionEnd)
    simulation = Simulation(
        load_protocol(study_file("showcase", 1)), load_display("fhd27-60hz"), seed=11
    )

    with pytest.raises(StudyError, match=r"the session is over \(completed\)"):
        simulate_sitting(simulation, old_sittings, "S002")
