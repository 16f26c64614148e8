"""Nobody with the study file and a public export finds out who came when."""

import re
from collections import Counter
from pathlib import Path

import pandas as pd
import pytest
from attack.guesses import export_and_guess, recorded, secretly
from attack.kills import CASES, write_study

from analysis.export import FORMATS, ExportOptions, write_export
from analysis.export.order import telling_columns, tells_order
from analysis.export.write_export import export_study
from protocols.errors import StudyError
from protocols.feasibility import virtual_manifest
from protocols.load import load_display, load_protocol, shipped
from protocols.plan import Plan, chosen, make_plan, place_of, planned_trials, rounds
from protocols.study_file.plausible import study_notes
from protocols.study_file.preregister import preregistration, to_markdown
from protocols.study_file.schema import StudyProtocol
from protocols.tasks.task_kinds import TASKS
from study_app.session_folders import next_slot, withdraw

SECRET = "0123456789abcdef" * 4
OTHER = "fedcba9876543210" * 4
PAPER = load_protocol(Path("inpainting-2afc"))
FHD = load_display("fhd27-60hz")


def with_places(study: StudyProtocol, places: str, secret: str = "") -> StudyProtocol:
    design = study.design.model_copy(update={"places": places})
    digest = "0" * 64 if secret else None
    privacy = study.privacy.model_copy(update={"secret_sha256": digest})
    changed = study.model_copy(update={"design": design, "privacy": privacy})
    return changed.with_secret(secret) if secret else changed


def of_task(folder: Path, case: str, places: str) -> StudyProtocol:
    write_study(folder, CASES[case])
    return secretly(folder / "study.toml", places, SECRET)


def what_the_slot_decides(study: StudyProtocol, slot: int) -> object:
    """Scenes in order, arrangements by repeat and keys: all that no chance of a code touches."""
    trials = sorted(planned_trials(study, "P1", slot), key=lambda trial: trial.id)
    trials = [trial for trial in trials if trial.role == "main"]
    ordered = study.design.scene_order == "balanced"
    return (
        [t.condition.get("scene") for t in trials] if ordered else None,
        {(t.repeat, *t.condition.items(), t.correct, t.stimuli) for t in trials},
        {t.answers for t in trials} if study.design.side == "by-participant" else None,
    )


# --- the places -------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("name", "secret"),
    [("demo", ""), ("inpainting-2afc", SECRET), ("inpainting-2afc", OTHER), ("showcase", SECRET),
     ("beyond-blur-preference", SECRET), ("beyond-blur-detection", OTHER)],
)  # fmt: skip
def test_each_place_is_drawn_once_in_every_round(name, secret):
    study = with_places(load_protocol(Path(name)), "drawn", secret)
    short, whole = rounds(study)
    assert whole % short == 0
    places = [place_of(study, slot) for slot in range(2 * whole)]
    for start in (0, whole):
        assert sorted(places[start : start + whole]) == [*range(whole)]
    for start in range(0, 2 * whole, short):  # a study of few is balanced, too
        among = {place % short for place in places[start : start + short]}
        assert among == set(range(short))


def test_a_round_is_all_that_the_slot_decides():
    """12 in the paper's study: 6 scenes, 2 orders, 2 keys; and 28 for 7 scenes, whose square is
    two."""
    assert rounds(PAPER) == (4, 12)
    assert rounds(load_protocol(Path("beyond-blur-preference"))) == (4, 28)
    decided = [what_the_slot_decides(PAPER, slot) for slot in range(24)]
    assert decided[:12] == decided[12:]
    assert all(decided[a] != decided[b] for a in range(12) for b in range(a))


def test_places_are_drawn_by_the_secret_and_evenly():
    """Of 400 secrets, each place comes to slot 7 some 33 times (sd 5.5)."""
    paper = with_places(PAPER, "drawn", SECRET)
    again = with_places(PAPER, "drawn", SECRET)
    order = [place_of(paper, slot) for slot in range(12)]
    assert order == [place_of(again, slot) for slot in range(12)]
    assert order != [place_of(with_places(PAPER, "drawn", OTHER), slot) for slot in range(12)]
    assert order != [place_of(with_places(PAPER, "drawn"), slot) for slot in range(12)]
    assert order != [place_of(paper, slot) for slot in range(12, 24)]
    counts = Counter(place_of(with_places(PAPER, "drawn", f"{n:064x}"), 7) for n in range(400))
    assert set(counts) == set(range(12))
    assert max(counts.values()) < 60
    with pytest.raises(StudyError, match="secret must lie beside the study file"):
        place_of(StudyProtocol.model_validate_json(paper.model_dump_json()), 0)


TURNED = [name for name, kind in TASKS.items() if kind.task.every_answer]


@pytest.mark.parametrize("case", TURNED)
def test_all_that_the_slot_decides_is_that_of_its_place(tmp_path, case):
    drawn = of_task(tmp_path, case, "drawn")
    plain = with_places(drawn, "by-arrival", SECRET)
    places = [place_of(drawn, slot) for slot in range(24)]
    for slot, place in enumerate(places):
        assert what_the_slot_decides(drawn, slot) == what_the_slot_decides(plain, place)
    assert any((place - slot) % 2 for slot, place in enumerate(places))


def test_catch_trials_and_practice_are_turned_by_the_place(tmp_path):
    study = of_task(tmp_path, "two-interval", "drawn")
    practice = study.design.practice.model_copy(update={"feedback": True, "scenes": ()})
    design = study.design.model_copy(update={"practice": practice})
    study = study.model_copy(update={"design": design})
    for slot in range(8):
        place = place_of(study, slot)
        for trial in planned_trials(study, "P1", slot):
            if trial.role == "main":
                continue
            number = int(trial.id[-4:])
            cells = len(study.practice_cells())
            turn = number if trial.role == "catch" else number // cells
            assert trial.correct == study.task.answers()[(turn + place) % 2]


def test_pairs_that_answers_choose_are_turned_by_the_place(tmp_path):
    write_study(tmp_path, CASES["active pairs"])
    study = load_protocol(tmp_path / "study.toml")
    plain, drawn = (with_places(study, places, SECRET) for places in ("by-arrival", "drawn"))
    found = []
    for slot in range(8):
        plans = [main_plan(each, slot) for each in (plain, drawn)]
        shown = [
            chosen(each, plan, plan.trials[-1], []).condition
            for each, plan in zip((plain, drawn), plans, strict=True)
        ]
        turned = (place_of(drawn, slot) - slot) % 2 == 1
        assert (shown[0]["first"] == shown[1]["second"]) == turned
        found.append(turned)
    assert len(set(found)) == 2


def main_plan(study: StudyProtocol, slot: int) -> Plan:
    plan = make_plan(study, virtual_manifest(study, FHD), "P1", slot)
    main = [trial for trial in plan.trials if trial.role == "main"]
    return plan.model_copy(update={"trials": tuple(main)})


def test_a_study_without_the_key_keeps_its_hash_and_its_plans():
    said = with_places(PAPER, "by-arrival")

    assert said.sha256 == PAPER.sha256
    assert "places" not in PAPER.model_dump(mode="json")["design"]
    assert planned_trials(said, "P1", 5) == planned_trials(PAPER, "P1", 5)
    assert with_places(PAPER, "drawn").sha256 != PAPER.sha256
    assert [place_of(PAPER, slot) for slot in range(30)] == [*range(30)]


def test_who_takes_the_slot_of_one_who_withdrew_takes_the_place(tmp_path):
    simulation = recorded(tmp_path, "yes-no", "drawn", 3, SECRET)
    study, sessions = simulation.study, tmp_path / "sessions"
    withdraw(sessions, "S002", lambda: "2026-01-01T00:00:00.000000Z")

    assert next_slot(sessions, study.study.name) == 1
    before, after = (planned_trials(study, code, 1) for code in ("S002", "S004"))
    assert {trial.answers for trial in before} == {trial.answers for trial in after}


def test_new_and_copied_studies_draw_places(metamerlab, tmp_path):
    metamerlab("new-study", tmp_path / "new")
    assert load_protocol(tmp_path / "new/study.toml").design.places == "drawn"
    for name in shipped("studies"):
        copy = tmp_path / f"my-{name}.toml"
        metamerlab("protocol", "copy", name, copy)
        assert load_protocol(copy).design.places == "drawn"
        assert copy.read_text().count('\n[design]\nplaces = "drawn"\n') == 1


def test_check_says_that_arrival_shows_although_there_is_a_secret():
    def notes(study: StudyProtocol) -> str:
        return "\n".join(map(str, study_notes(study, FHD, 72)))

    assert 'add places = "drawn" to [design]' in notes(with_places(PAPER, "by-arrival", SECRET))
    for study in (with_places(PAPER, "drawn", SECRET), PAPER, with_places(PAPER, "drawn")):
        assert "places" not in notes(study)


def test_a_preregistration_says_how_places_are_taken():
    for places in ("drawn", "by-arrival"):
        sections = preregistration(with_places(PAPER, places, SECRET), FHD, "1")
        assert f"Places in the counterbalancing: {places}." in to_markdown("", sections)


# --- public exports ---------------------------------------------------------------------------


def guessed(simulation, folder: Path, form: str, out: str):
    return export_and_guess(simulation, folder, form, folder / out)


@pytest.fixture
def as_it_was(monkeypatch):
    """Exports as they were: order, arrangement and keys stay wherever there is a secret."""

    def unprotect() -> None:
        monkeypatch.setattr(write_export, "telling_columns", lambda _study: frozenset())
        monkeypatch.setattr(write_export, "tells_order", lambda _study: False)

    return unprotect


@pytest.mark.slow
def test_no_slot_is_told_by_a_table_of_halves(tmp_path, as_it_was):
    for places in ("drawn", "by-arrival"):
        folder = tmp_path / places
        simulation = recorded(folder, "which-half", places, 8, SECRET)
        assert not guessed(simulation, folder, "bids", "bids").told
    as_it_was()
    found = guessed(simulation, folder, "bids", "unprotected")
    assert found.told
    assert found.right == found.people == 8


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "people"),
    [
        ("inpainting-2afc", 11), ("two-alternative", 14), ("abx", 10), ("yes-no by QUEST+", 14),
    ],
)  # fmt: skip
def test_no_slot_is_told_by_any_public_export(tmp_path, as_it_was, name, people):
    """Secret and key: nothing but luck. Secret alone: what would tell is not there. As it was:
    the same guesses find all, or all that keys tell."""
    for places in ("drawn", "by-arrival"):
        folder = tmp_path / places
        simulation = recorded(folder, name, places, people, SECRET)
        preference = simulation.study.analysis.kind == "preference"
        forms = [form for form in FORMATS if preference or form != "pwcmp"]
        for form in forms:
            assert not guessed(simulation, folder, form, form).told, (places, form)
    as_it_was()
    for form in forms:
        found = guessed(simulation, folder, form, f"{form}-unprotected")
        assert found.told, form
        if form != "pwcmp" and "yes-no" not in name:
            assert found.right == people, form


def test_without_the_key_no_table_holds_what_the_place_decides(tmp_path):
    for name in TURNED:
        folder = tmp_path / name
        simulation = recorded(folder, name, "by-arrival", 2, SECRET)
        study = simulation.study
        out = folder / "out"
        options = ExportOptions(public=True, displays=(simulation.display,))
        export_study(folder / "sessions", study, out, "bids", options)
        columns = {
            column
            for path in out.rglob("*.tsv")
            if path.parent.name == "beh"
            for column in pd.read_csv(path, sep="\t")
        }

        assert not columns & {"order", "repeat", "key_place", "first_side", "chosen_side"}
        assert not columns & telling_columns(study)
        assert {"rt_s", "correct", "trial"} <= columns
        assert ("stimulus" in columns) == (name == "yes-no")  # it is shown in one way only
        for path in out.rglob("*_beh.tsv"):
            trials = pd.read_csv(path, sep="\t")["trial"]
            assert list(trials) == sorted(trials)


def test_trials_of_one_condition_stand_in_no_order(tmp_path):
    """Participants become faster: were the first of a condition named first, order would tell."""
    simulation = recorded(tmp_path, "inpainting-2afc", "by-arrival", 2, SECRET)
    sessions = tmp_path / "sessions"
    export_study(sessions, simulation.study, tmp_path / "out", "bids", public(simulation))
    whole = attempts_of(export_whole(simulation, sessions, tmp_path / "whole"))
    whole = whole[whole["outcome"] == "completed"]
    shared = attempts_of(tmp_path / "out")
    order = dict(zip(whole["rt_s"], whole["position"], strict=True))
    first = 0
    pairs = shared.sort_values("trial").groupby("participant")
    for _, rows in pairs:
        places = [order[rt] for rt in rows["rt_s"]]
        first += sum(a < b for a, b in zip(places[::2], places[1::2], strict=True))
    assert 20 < first < 52  # of 72, sd 4.2


def public(simulation) -> ExportOptions:
    return ExportOptions(public=True, displays=(simulation.display,))


def export_whole(simulation, sessions: Path, out: Path) -> Path:
    options = ExportOptions(displays=(simulation.display,))
    export_study(sessions, simulation.study, out, "bids", options)
    return out


def attempts_of(out: Path) -> pd.DataFrame:
    """Every attempt of an export in BIDS, `participant` added."""
    tables = (
        pd.read_csv(path, sep="\t").assign(participant=path.name.split("_")[0])
        for path in sorted(out.rglob("*_beh.tsv"))
    )
    return pd.concat(tables, ignore_index=True)


def test_what_answers_choose_keeps_its_order_and_loses_its_keys(tmp_path):
    simulation = recorded(tmp_path, "yes-no by QUEST+", "by-arrival", 2, SECRET)
    study = simulation.study
    out = tmp_path / "out"
    export_study(tmp_path / "sessions", study, out, "bids", public(simulation))
    table = attempts_of(out)

    assert not tells_order(study)
    assert "key_place" not in table
    assert list(table["position"])[:3] == [0, 1, 2]


def test_where_the_slot_decides_nothing_a_secret_alone_keeps_all(tmp_path):
    simulation = recorded(tmp_path, "identification", "by-arrival", 2, SECRET)
    study = simulation.study
    out = tmp_path / "out"
    export_study(tmp_path / "sessions", study, out, "bids", public(simulation))

    assert rounds(study) == (1, 1)
    assert {"key_place", "position", "repeat"} <= set(attempts_of(out))
    assert not [note for note in study_notes(study, FHD, 9) if note.place == "design.places"]
    balanced = study.design.model_copy(update={"scene_order": "balanced"})
    scenes = study.main_scenes()
    assert tells_order(study.model_copy(update={"design": balanced})) == (len(scenes) > 1)


def test_the_readmes_say_what_is_left_out_and_why(tmp_path):
    for places, words in (("by-arrival", "when participants came"), ("drawn", None)):
        folder = tmp_path / places
        simulation = recorded(folder, "two-interval", places, 2, SECRET)
        options = ExportOptions(public=True)
        export_study(folder / "sessions", simulation.study, folder / "o", "pwcmp", options)
        text = re.sub(r"\s+", " ", (folder / "o/README.md").read_text())
        assert ("when participants came" in text) == (words is not None)
        table = pd.read_csv(folder / "o/pwcmp.csv")
        alphabetic = (table["condition_A"] < table["condition_B"]).all()
        assert alphabetic == (words is not None)
        assert ("`condition_A` comes first in the alphabet" in text) == alphabetic
        assert set(table["is_A_selected"]) == {0, 1}
