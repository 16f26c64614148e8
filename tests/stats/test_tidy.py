"""Journals to tables: every attempt and decision once, damage said, rules applied and counted."""

import csv
import json
import tomllib
from pathlib import Path

import pandas as pd
import pytest

from analysis.data_dictionary import dictionary, tables_of
from analysis.tidy import pwcmp_table, read_sessions, write_tables
from protocols.errors import StudyError
from protocols.journal import Withdrawal, event_line
from protocols.load import load_display, with_tuples
from protocols.study_file.new_study import study_files
from protocols.study_file.schema import StudyProtocol
from protocols.tasks.task_kinds import TASKS


def rules(study: StudyProtocol, **values: float) -> StudyProtocol:
    """Return the protocol with other exclusion rules."""
    analysis = study.analysis
    changed = analysis.exclusions.model_copy(update=values)
    return study.model_copy(
        update={"analysis": analysis.model_copy(update={"exclusions": changed})}
    )


def edit(folder: Path, code: str, change) -> None:
    """Change the lines of one journal."""
    path = folder / code / "journal.jsonl"
    path.write_bytes(b"".join(change(path.read_bytes().splitlines(keepends=True))))


def test_every_attempt_and_every_decision_has_one_row(tmp_path, demo_protocol, write_journals):
    tidy = read_sessions(write_journals(tmp_path / "s"), demo_protocol)
    lines = sum(
        b'"kind":"attempt"' in line
        for path in (tmp_path / "s").rglob("journal.jsonl")
        for line in path.read_bytes().splitlines()
    )

    assert len(tidy.attempts) == lines
    assert len(tidy.analysed) == 4 * 24
    assert set(tidy.decisions["kind"]) == {"main", "catch"}
    assert not tidy.decisions.duplicated(["session", "trial"]).any()
    assert tidy.simulated
    retried = tidy.decisions[tidy.decisions["attempts"] == 2]
    assert len(retried) == (tidy.attempts["outcome"] == "void").sum() > 0
    first = tidy.analysed.groupby("participant")["order"].agg(["min", "max"])
    assert (first["min"] == 1).all()
    assert (first["max"] == 24).all()


def test_chosen_and_rejected_are_what_the_journal_says(tmp_path, demo_protocol, write_journals):
    tidy = read_sessions(write_journals(tmp_path / "s", people=1), demo_protocol)
    path = tmp_path / "s" / "P01" / "journal.jsonl"
    events = [json.loads(line) for line in path.read_text().splitlines()]
    said = {
        e["trial"]: e["condition"][e["answer"]] for e in events if e.get("outcome") == "completed"
    }

    assert dict(zip(tidy.decisions["trial"], tidy.decisions["chosen"], strict=True)) == said
    assert (tidy.decisions["chosen"] != tidy.decisions["rejected"]).all()
    picked_first = tidy.decisions["chosen"] == tidy.decisions["first"]
    assert (tidy.decisions["chose_first"] == picked_first.astype(int)).all()


def test_the_dictionary_names_every_column_of_every_table(tmp_path, demo_protocol, write_journals):
    tidy = read_sessions(write_journals(tmp_path / "s"), demo_protocol)
    write_tables(tidy, demo_protocol, tmp_path)
    described = pd.read_csv(tmp_path / "dictionary.csv", keep_default_na=False)

    for table in tables_of(demo_protocol):
        columns = list(pd.read_csv(tmp_path / f"{table}.csv").columns)
        assert columns == list(described.loc[described["table"] == table, "column"])
    assert (described["meaning"] != "").all()
    assert len(dictionary(tables_of(demo_protocol))) == len(described)


def test_pwcmps_table_has_one_row_a_decision(tmp_path, demo_protocol, write_journals):
    tidy = read_sessions(write_journals(tmp_path / "s"), demo_protocol)
    pwcmp_table(tidy.analysed).to_csv(tmp_path / "pwcmp.csv", index=False)
    with (tmp_path / "pwcmp.csv").open() as file:
        rows = list(csv.DictReader(file))

    assert list(rows[0]) == [
        "observer",
        "session",
        "scene",
        "condition_A",
        "condition_B",
        "is_A_selected",
        "scene_name",
        "size",
    ]
    assert len(rows) == 96
    votes = sum(row["is_A_selected"] == "1" for row in rows)
    assert votes == int(tidy.analysed["chose_first"].sum())
    assert set(pwcmp_table(tidy.analysed)["scene"]) == {
        f"{scene}__{size}" for scene in ("garden", "colonnade") for size in ("small", "large")
    }


def test_a_torn_last_line_costs_nothing_else(tmp_path, demo_protocol, write_journals):
    folder = write_journals(tmp_path / "s")
    edit(folder, "P02", lambda lines: [*lines[:-3], lines[-3][:40]])

    tidy = read_sessions(folder, demo_protocol)

    row = tidy.sessions.set_index("participant").loc["P02"]
    assert row["torn"] == 1
    assert row["status"] == "unfinished"
    assert any("P02" in note and "unfinished" in note for note in tidy.warnings)
    assert len(tidy.analysed) == 96  # the lines lost were no decisions


def test_a_withdrawn_participant_leaves_a_note_and_nothing_else(
    tmp_path, demo_protocol, write_journals
):
    folder = write_journals(tmp_path / "s")
    stone = Withdrawal(n=0, t_s=0.0, at="2026-01-01T10:00:00Z", study="demo", slot=1)
    edit(folder, "P02", lambda _lines: [event_line(stone)])

    tidy = read_sessions(folder, demo_protocol)

    assert "P02" not in set(tidy.attempts["participant"])
    assert any("withdrew" in note for note in tidy.warnings)


def test_a_decision_recorded_twice_counts_once(tmp_path, demo_protocol, write_journals):
    folder = write_journals(tmp_path / "s")

    def twice(lines):
        at = next(i for i, line in enumerate(lines) if b'"outcome":"completed"' in line)
        return [*lines, lines[at].replace(b'"n":%d' % at, b'"n":%d' % len(lines))]

    edit(folder, "P01", twice)
    tidy = read_sessions(folder, demo_protocol)

    assert any("decided twice" in note for note in tidy.warnings)
    assert len(tidy.analysed) == 96


def test_a_participant_with_three_trials_is_excluded_and_counted(
    tmp_path, demo_protocol, write_journals
):
    folder = write_journals(tmp_path / "s", people=3)
    write_journals(tmp_path / "few", people=4, decided=3)
    (tmp_path / "few" / "P04").rename(folder / "P04")

    tidy = read_sessions(folder, demo_protocol)

    step = next(s for s in tidy.flow if "planned trials" in s.step)
    assert (step.sittings_out, step.decisions_out, step.sittings_left) == (1, 3, 3)
    assert any("21 of 24 main trials are missing" in note for note in tidy.warnings)
    assert "P04" not in set(tidy.analysed["participant"])
    assert "P04" in set(tidy.decisions["participant"])


def test_fast_answers_are_left_out_one_by_one(tmp_path, demo_protocol, write_journals):
    folder = write_journals(tmp_path / "s", people=2, rt_s=0.05)
    slow = rules(demo_protocol, rt_min_s=0.0, rt_max_s=0.01)

    with pytest.raises(StudyError, match="protocol given"):
        read_sessions(folder, slow)  # other rules are another protocol

    tidy = read_sessions(folder, demo_protocol)
    step = next(s for s in tidy.flow if "faster" in s.step)
    assert (step.sittings_out, step.decisions_out, step.decisions_left) == (0, 48, 0)
    assert tidy.analysed.empty


def test_one_sided_sessions_are_left_out_by_rule(tmp_path, demo_protocol, write_journals):
    strict = rules(demo_protocol, same_side_max_share=0.9)
    folder = write_journals(
        tmp_path / "s", people=2, study=strict, choose=lambda _f, _s, _rng: True
    )

    tidy = read_sessions(folder, strict)

    step = next(s for s in tidy.flow if "one side" in s.step)
    assert step.sittings_out == 2


def test_failed_catch_trials_leave_a_session_out(tmp_path, demo_protocol, write_journals):
    folder = write_journals(tmp_path / "s", people=2)

    def fail(lines):
        out = []
        for line in lines:
            event = json.loads(line)
            if event.get("role") == "catch":
                event |= {"answer": "second", "correct": False}
                line = json.dumps(event).encode() + b"\n"
            out.append(line)
        return out

    edit(folder, "P01", fail)
    tidy = read_sessions(folder, demo_protocol)

    assert next(s for s in tidy.flow if "catch" in s.step).sittings_out == 1
    kept = set(tidy.analysed["participant"])
    assert kept == {"P02"}


def test_flow_adds_up(tmp_path, demo_protocol, write_journals):
    tidy = read_sessions(write_journals(tmp_path / "s"), demo_protocol)

    for before, after in zip(tidy.flow, tidy.flow[1:], strict=False):
        assert before.decisions_left - after.decisions_out == after.decisions_left
        assert before.sittings_left - after.sittings_out == after.sittings_left
    assert tidy.flow[-1].decisions_left == len(tidy.analysed)


def test_sessions_of_two_protocols_are_refused_with_both_named(
    tmp_path, demo_protocol, write_journals
):
    """Also where both studies number their participants alike."""
    other = rules(demo_protocol, rt_min_s=0.2)
    write_journals(tmp_path / "s" / "one", people=2)
    write_journals(tmp_path / "s" / "two", people=3, study=other)

    with pytest.raises(StudyError) as refusal:
        read_sessions(tmp_path / "s", demo_protocol)

    assert demo_protocol.sha256[:12] in str(refusal.value)
    assert other.sha256[:12] in str(refusal.value)


def test_empty_folders_copies_and_mixtures_are_refused(tmp_path, demo_protocol, write_journals):
    with pytest.raises(StudyError, match="no such folder"):
        read_sessions(tmp_path / "none", demo_protocol)
    (tmp_path / "empty").mkdir()
    with pytest.raises(StudyError, match=r"no journal.jsonl was found"):
        read_sessions(tmp_path / "empty", demo_protocol)

    folder = write_journals(tmp_path / "s", people=2)
    write_journals(tmp_path / "s" / "copy", people=1)
    with pytest.raises(StudyError, match="'P01' in"):
        read_sessions(folder, demo_protocol)

    mixed = write_journals(tmp_path / "m", people=2)
    write_journals(tmp_path / "real", people=3, simulated=False)
    (tmp_path / "real" / "P03").rename(mixed / "P03")
    with pytest.raises(StudyError, match="must not be mixed"):
        read_sessions(mixed, demo_protocol)


def test_only_unreadable_journals_are_refused_with_the_reason(tmp_path, demo_protocol):
    (tmp_path / "x").mkdir()
    (tmp_path / "x" / "journal.jsonl").write_bytes(b"\x00\xff garbage\n")

    with pytest.raises(StudyError, match=r"none of \d+ journals can be used"):
        read_sessions(tmp_path, demo_protocol)


@pytest.mark.parametrize("kind", TASKS)
def test_tables_of_every_task_name_every_column_once(demo_protocol, kind):
    """A name that comes twice would hide a column."""
    text = study_files("every", "Every", load_display("fhd27-60hz"), kind)["study.toml"]
    task = TASKS[kind].task.model_validate(with_tuples(tomllib.loads(text)["task"]))
    study = demo_protocol.model_copy(update={"task": task})

    for table, columns in tables_of(study).items():
        names = [column.name for column in columns]
        assert len(set(names)) == len(names), table


def session_file(folder, code):
    return folder / code / "journal.jsonl"


def test_a_session_copied_under_another_code_is_refused(tmp_path, write_journals, demo_protocol):
    folder = write_journals(tmp_path / "in", people=2)
    text = session_file(folder, "P01").read_text()
    session_file(folder, "P02").write_text(text.replace('"P01"', '"P02"'))

    with pytest.raises(StudyError, match="equal those of P01, under another code"):
        read_sessions(folder, demo_protocol)


def test_sessions_of_different_manifests_are_noted(tmp_path, write_journals, demo_protocol):
    folder = write_journals(tmp_path / "in", people=3)
    assert not any("manifests" in note for note in read_sessions(folder, demo_protocol).warnings)
    path = session_file(folder, "P03")
    other = '"manifest_sha256":"' + "1" * 64
    path.write_text(path.read_text().replace('"manifest_sha256":"' + "0" * 64, other))

    notes = read_sessions(folder, demo_protocol).warnings
    assert any("stimuli of 2 different manifests" in note and "P03" in note for note in notes)
