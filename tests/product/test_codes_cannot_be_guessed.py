"""Nobody with the study file and a public export finds out who took part as what."""

import gzip
import re
import shutil
from collections.abc import Iterator
from pathlib import Path

import pandas as pd
import pytest
from study_texts import shipped_study

from analysis.export import FORMATS, ExportOptions
from analysis.export.write_export import export_study
from protocols.disk.hashing import sha256_bytes, sha256_json
from protocols.errors import StudyError
from protocols.load import load_display, load_protocol
from protocols.plan import Plan, planned_trials
from protocols.study_file.schema import StudyProtocol
from study_app.gaze.simulated import STEADY
from study_app.simulate import SimulatedStudy, simulate_study

CODES = [f"S{number:03d}" for number in range(1, 31)]
SLOTS = range(8)
SECRET = "0123456789abcdef" * 4


def texts_of(folder: Path) -> dict[str, str]:
    """Every file of an export as text."""
    found = {}
    for path in sorted(folder.rglob("*")):
        if path.is_file():
            data = path.read_bytes()
            plain = gzip.decompress(data) if path.suffix == ".gz" else data
            found[path.relative_to(folder).as_posix()] = plain.decode()
    return found


def guesses(study: StudyProtocol) -> Iterator[tuple[str, int, list[tuple[str, ...]]]]:
    """Every code and slot with the order of main trials that follows from what is public."""
    for code in CODES:
        for slot in SLOTS:
            trials = planned_trials(study, code, slot)
            yield code, slot, [trial.stimuli for trial in trials if trial.role == "main"]


def orders_in(folder: Path) -> list[list[tuple[str, ...]]]:
    """Every order of main trials that a file's rows, times or numbers could be read as."""
    found = []
    for path in sorted(folder.rglob("*.?sv")):
        table = pd.read_csv(path, sep="\t" if path.suffix == ".tsv" else ",", dtype=str).fillna("")
        who = next((c for c in ("participant", "observer") if c in table), None)
        for _, rows in table.groupby(who) if who else [("", table)]:
            for column in ("", "onset", "order", "position", "trial"):
                if column and column not in rows:
                    continue
                number = (
                    rows[column].str.extract(r"([0-9.]+)$")[0].astype(float) if column else None
                )
                placed = rows if number is None else rows.loc[number.sort_values().index]
                found.append(shown_in(placed))
    return found


def shown_in(rows: pd.DataFrame) -> list[tuple[str, ...]]:
    """The stimuli of main trials, trial by trial."""
    if "stimulus" in rows and "trial" in rows:  # events: one row per phase
        rows = rows[rows["stimulus"].ne("") & rows["stimulus"].ne("n/a")]
        trials: dict[str, list[str]] = {}
        for trial, stimulus in zip(rows["trial"], rows["stimulus"], strict=True):
            if trial.startswith("main") and stimulus not in trials.setdefault(trial, []):
                trials[trial].append(stimulus)
        return [tuple(names) for names in trials.values()]
    first, second = ("condition_A", "condition_B") if "condition_A" in rows else ("first", "second")
    scene = "scene_name" if "scene_name" in rows else "scene"
    if not {first, second, scene, "size"} <= set(rows):
        return []
    if "kind" in rows:
        rows = rows[rows["kind"] == "main"]
    names = [
        tuple(f"{row[scene]}__{row['size']}__{row[method]}" for method in (first, second))
        for _, row in rows.iterrows()
    ]
    return list(dict.fromkeys(names))


def found_by_guessing(folder: Path, study: StudyProtocol, manifest_sha256: str) -> set[str]:
    """Codes that can be told: by the plan's hash, by orders, by the order of new names."""
    found = set()
    texts = "\n".join(texts_of(folder).values())
    orders = [order for order in orders_in(folder) if len(order) > 4]
    for code, slot, trials in guesses(study):
        plan = Plan(
            study=study.study.name, participant=code, slot=slot, seed=study.design.seed,
            protocol_sha256=study.sha256, manifest_sha256=manifest_sha256,
            trials=planned_trials(study, code, slot),
        )  # fmt: skip
        if plan.sha256 in texts:
            found.add(f"{code}: hash of the plan")
        unique = list(dict.fromkeys(trials))
        if any(order in (unique, trials) for order in orders):
            found.add(f"{code}: order of trials")
        if sha256_bytes(code.encode()) in texts or sha256_json(code) in texts:
            found.add(f"{code}: hash of the code")
        if re.search(rf"\b{code}\b", texts):
            found.add(f"{code}: by name")
    return found


@pytest.fixture(scope="module")
def studies(tmp_path_factory) -> dict[str, tuple[Path, Path]]:
    """Five sessions of a study without a secret, and of the same study with one, places drawn."""
    made = {}
    for kind in ("older", "with a secret"):
        folder = tmp_path_factory.mktemp("study")
        path = folder / "study.toml"
        text = shipped_study("demo", {"duration_s": 0.2, "repeats": 1, "mode": '"none"'})
        if kind != "older":
            digest = sha256_bytes(SECRET.encode())
            text = text.replace("[privacy]\n", f'[privacy]\nsecret_sha256 = "{digest}"\n')
            text = text.replace("\n[design]\n", '\n[design]\nplaces = "drawn"\n')
            (folder / "study.secret").write_text(SECRET + "\n")
        path.write_text(text)
        study = load_protocol(path)
        display = load_display(study.display.display)
        simulate_study(
            SimulatedStudy(study, display, gaze=STEADY, gaze_rate_hz=60.0), folder / "s", 5
        )
        made[kind] = (path, folder / "s")
    return made


def exported(studies, kind: str, form: str, out: Path, *, public: bool) -> tuple[Path, str]:
    path, sessions = studies[kind]
    study = load_protocol(path)
    display = load_display(study.display.display)
    made = export_study(
        sessions, study, out, form, ExportOptions(public=public, displays=(display,))
    )
    assert made.participants == 5
    from protocols.journal_file import find_journals, read_journal

    return out, read_journal(find_journals(sessions)[0]).start.manifest_sha256


@pytest.mark.slow
@pytest.mark.parametrize("form", FORMATS)
def test_codes_cannot_be_guessed_from_a_public_export(studies, tmp_path, form):
    for kind, (path, _) in studies.items():
        public = StudyProtocol.model_validate_json(load_protocol(path).model_dump_json())
        guessable = public.with_secret("")  # whoever guesses does not have it
        out, manifest = exported(studies, kind, form, tmp_path / kind, public=True)
        assert found_by_guessing(out, guessable, manifest) == set(), kind

    # The same search finds all five in an export that is not public.
    out, manifest = exported(studies, "older", form, tmp_path / "whole", public=False)
    found = found_by_guessing(out, load_protocol(studies["older"][0]), manifest)
    assert {f"{code}: order of trials" for code in CODES[:5]} <= found
    if form == "bids":
        assert {f"{code}: hash of the plan" for code in CODES[:5]} <= found


@pytest.mark.slow
def test_new_names_follow_from_nothing_that_is_public(studies, tmp_path):
    """Sorted by codes, by hashes of codes, or by slots, people would be told by their places.

    Five people have 120 orders, so one study may have any of them by chance; four have not.
    """
    from analysis.export.export_content import people_of
    from analysis.journals import read_study

    def order_of(path, sessions):
        study = load_protocol(path)
        people, _ = people_of(read_study(sessions, study), study, public=True)
        return [person.reading.start.participant for person in people]

    path, sessions = studies["older"]
    study = load_protocol(path)
    display = load_display(study.display.display)
    for seed in (9, 10):
        simulate_study(
            SimulatedStudy(study, display, gaze=STEADY, seed=seed), tmp_path / str(seed), 5
        )
    orders = [order_of(path, at) for at in (sessions, tmp_path / "9", tmp_path / "10")]
    orders.append(order_of(*studies["with a secret"]))

    for known in (lambda code: code, lambda code: sha256_bytes(code.encode())):
        assert any(order != sorted(order, key=known) for order in orders)
    assert order_of(path, sessions) == orders[0]
    # It follows from what somebody did: other answers, another place.
    assert any(order != orders[0] for order in orders[1:])


def test_a_session_that_is_not_whole_is_left_out_where_order_tells(studies, tmp_path):
    path, sessions = studies["older"]
    copy = tmp_path / "s"
    shutil.copytree(sessions, copy)
    journal = next(iter(sorted(copy.rglob("journal.jsonl"))))
    lines = journal.read_bytes().splitlines(keepends=True)
    journal.write_bytes(b"".join(lines[:15]))

    study = load_protocol(path)
    options = ExportOptions(public=True, displays=(load_display(study.display.display),))
    made = export_study(copy, study, tmp_path / "out", "bids", options)
    assert made.participants == 4
    assert any("which of its trials are missing tells their order" in n for n in made.notes)


def test_a_study_with_a_secret_keeps_its_order_and_needs_the_secret(studies, tmp_path):
    path, _ = studies["with a secret"]
    study = load_protocol(path)
    alone = tmp_path / "study.toml"
    shutil.copy(path, alone)
    public = load_protocol(alone)

    assert public.sha256 == study.sha256
    assert planned_trials(study, "S001", 0) != planned_trials(study.with_secret("x"), "S001", 0)
    with pytest.raises(StudyError, match="secret must lie beside the study file"):
        planned_trials(public, "S001", 0)
    (tmp_path / "study.secret").write_text("another")
    with pytest.raises(StudyError, match="must be the secret that"):
        load_protocol(alone)
    out, _ = exported(studies, "with a secret", "bids", tmp_path / "out", public=True)
    table = pd.read_csv(next(out.rglob("*_beh.tsv")), sep="\t")
    assert list(table["position"])[:3] == [0, 1, 2]


def test_a_key_that_a_study_does_not_use_leaves_its_hash():
    study = load_protocol(Path("demo"))
    plain = study.model_dump(mode="json")
    assert plain["privacy"].pop("secret_sha256") is None

    assert study.sha256 == sha256_json(plain)
    with_one = study.privacy.model_copy(update={"secret_sha256": "0" * 64})
    assert study.model_copy(update={"privacy": with_one}).sha256 != study.sha256
