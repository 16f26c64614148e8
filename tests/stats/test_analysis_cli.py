"""`metamerlab analysis`: what a user types, sees, and is told when something is wrong."""

import json
import re
from pathlib import Path

import pytest
from command_line import metamerlab, result_of
from typer.testing import Result
from undrawn_reports import undrawn

from analysis.tasks import analysis_of
from protocols.disk.result_folder import LISTING
from protocols.study_file.new_study import preferences_of

run = result_of("analysis")


@pytest.fixture(scope="module")
def sessions(tmp_path_factory, write_journals) -> Path:
    return write_journals(tmp_path_factory.mktemp("cli") / "s", people=5)


@pytest.fixture(scope="module")
def reported(sessions) -> tuple[Path, Result]:
    """A report of the sessions, and what the command said."""
    out = sessions.parent / "report"
    return out, run(
        "report", sessions, "--protocol", "demo", "--out", out, "--no-figures", status=None
    )


@pytest.mark.slow
def test_report_says_the_result_and_where_it_lies(sessions, reported):
    out, result = reported

    assert result.exit_code == 0, result.output
    assert "Metameric was chosen over Push-pull" in result.output
    assert f"report: {out / 'report.html'}" in result.output
    names = [LISTING, "report.html", "results.json", "scripts", "tables"]
    assert sorted(path.name for path in out.iterdir()) == names
    again = run("report", sessions, "--protocol", "demo", "--out", out, "--no-figures", status=2)
    assert "--replace" in again.output


def test_replace_puts_the_new_result_in_the_place_of_the_old(sessions, tmp_path):
    for _ in range(2):
        run("tidy", sessions, "--protocol", "demo", "--out", tmp_path / "t", "--replace")

    assert [path.name for path in tmp_path.iterdir()] == ["t"]


def test_tidy_writes_all_tables(sessions, tmp_path):
    result = run("tidy", sessions, "--protocol", "demo", "--out", tmp_path / "t")

    assert "5 SIMULATED sessions, 120 of 120 main decisions kept" in result.output
    assert {path.name for path in (tmp_path / "t").iterdir()} == {
        LISTING,
        "answers.csv",
        "attempts.csv",
        "decisions.csv",
        "decisions.json",
        "demographics.csv",
        "dictionary.csv",
        "flow.csv",
        "participants.csv",
        "pwcmp.csv",
        "sessions.csv",
    }


@pytest.mark.slow
def test_tables_go_on_to_a_report_with_the_same_shares(sessions, reported, tmp_path):
    run("tidy", sessions, "--protocol", "demo", "--out", tmp_path / "t", status=None)
    table, out = tmp_path / "t" / "decisions.csv", tmp_path / "b"
    with undrawn():
        run("report", table, "--protocol", "demo", "--out", out, "--no-figures")

    one, other = (
        json.loads((folder / "results.json").read_text())
        for folder in (reported[0], tmp_path / "b")
    )
    assert one["results"]["preferences"]["table"] == other["results"]["preferences"]["table"]
    assert other["simulated"] is True


def test_import_names_columns_and_says_what_to_do_next(tmp_path):
    table = tmp_path / "old.csv"
    rows = [f"{p},park,a,b,{int((p * 7 + k) % 3 > 0)}" for p in range(6) for k in range(8)]
    table.write_text("who,where,one,two,pick\n" + "\n".join(rows) + "\n")
    maps = [
        f"--map={pair}"
        for pair in (
            "participant=who",
            "scene=where",
            "first=one",
            "second=two",
            "chose_first=pick",
        )
    ]

    result = run("import", table, *maps, "--out", tmp_path / "i")

    assert "48 decisions of 6 participants" in result.output
    with undrawn():
        run("report", tmp_path / "i" / "decisions.csv", "--out", tmp_path / "r")


def test_a_report_of_a_table_without_our_columns_names_the_command_that_maps_them(tmp_path):
    (tmp_path / "old.csv").write_text("who,first,second,pick\nA,a,b,1\n")

    result = run("report", tmp_path / "old.csv", "--out", tmp_path / "r", status=2)

    said = re.sub(r"\s+", " ", result.output)
    assert "metamerlab analysis import TABLE --map participant=COLUMN" in said
    (tmp_path / "old.csv").write_text('participant,first,second,chosen,rt_s\nA,a,b,a,"0,5"\n')
    said = re.sub(
        r"\s+",
        " ",
        run("report", tmp_path / "old.csv", "--out", tmp_path / "r", status=None).output,
    )
    assert "rt_s must be a number (got '0,5'); write decimals with a point" in said


def test_power_of_numbers_alone_is_that_of_the_study_they_describe():
    numbers = {"pairs": 2, "scenes": 4, "repeats": 3, "participants": 7}
    options = [word for name, value in numbers.items() for word in (f"--{name}", value)]
    result = run("power", *options, "--rate", 0.65, "--studies", 100)
    assert "7 (planned)" in result.output

    study = preferences_of(**numbers)
    settings = analysis_of("preference").plan(study)
    assert len(settings.comparisons) == 2
    assert {len(entry.scenes) for entry in settings.comparisons} == {4}
    assert {entry.repeats for entry in settings.comparisons} == {3}
    assert study.study.participants == 7


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ([], "missing: --pairs, --scenes, --repeats, --participants"),
        (["--pairs", 3, "--scenes", 6], "missing: --repeats, --participants"),
        (["demo", "--pairs", 3], "without a protocol (got demo too)"),
        (
            ["--pairs", 0, "--scenes", 6, "--repeats", 2, "--participants", 9],
            "--pairs: must be 1 to",
        ),
        (
            ["--pairs", 1, "--scenes", 1, "--repeats", 2, "--participants", 9],
            "--scenes: must be 2 to",
        ),
        (
            ["--pairs", 1, "--scenes", 2, "--repeats", 2, "--participants", 9999],
            "--participants: must be 2",
        ),
    ],
)
def test_power_says_which_numbers_are_missing_or_wrong(words, said):
    result = run("power", *words, "--rate", 0.65, status=2)

    assert said in re.sub(r"\s+", " ", result.output)


def pairs_of_old(person: int, scene: int) -> str:
    return f"p{person};s{scene};ours;theirs;{'left' if (person + scene) % 3 else 'right'}"


def answers_of_old(person: int, scene: int) -> str:
    truth = ("left", "right")[scene % 2]
    wrong = {"left": "right", "right": "left"}[truth]
    return f"p{person};s{scene // 2};{truth};{wrong if (person + scene) % 3 == 0 else truth}"


@pytest.mark.parametrize(
    ("task", "head", "row", "words", "design", "named"),
    [
        (
            "two-interval", "who;scene;first;second;said", pairs_of_old, ["chosen=said"],
            ["--pairs", 1, "--scenes", 3, "--repeats", 2, "--participants", 6], "deviations",
        ),
        (
            "yes-no", "who;scene;expected;answer", answers_of_old, ["--set", "signal=left"],
            ["new/study.toml"], "d_prime",
        ),
        (
            "identification", "who;scene;expected;answer", answers_of_old,
            ["--set", "alternatives=2"], ["new/study.toml"], "participant_sd",
        ),
    ],
)  # fmt: skip
def test_an_imported_table_serves_as_the_pilot_of_a_power_curve(
    tmp_path, monkeypatch, task, head, row, words, design, named
):
    monkeypatch.chdir(tmp_path)
    lines = [row(person, scene) for person in range(6) for scene in range(6)]
    Path("old.csv").write_text("\n".join([head, *lines]) + "\n")
    maps = ["--map", "participant=who", *(["--map"] if "=" in words[0] else []), *words]
    run("import", "old.csv", "--task", task, *maps, "--out", "old one")
    if design == ["new/study.toml"]:
        metamerlab("new-study", "new", "--task", task)
    words = ["--rate", 0.7] if task == "two-interval" else []

    done = run("power", *design, *words, "--from", "old one/decisions.csv", "--studies", 100)

    text = re.sub(r"\s+", " ", done.output)
    assert named in text
    assert "6 participants in the pilot" in text


def test_power_prints_a_table_and_draws_the_curve(tmp_path):
    result = run("power", "demo", "--rate", 0.7, "--studies", 200, "--out", tmp_path / "p")

    assert "4 (planned)" in result.output
    assert "primary, power 80%" in result.output
    curve = json.loads((tmp_path / "p" / "power.json").read_text())
    assert curve["studies"] == 200
    assert (tmp_path / "p" / "power-1-column.svg").exists()


@pytest.mark.parametrize(
    ("arguments", "wanted"),
    [
        (["report", "nowhere", "--protocol", "demo", "--out", "r"], "no such folder"),
        (["report", "nowhere", "--out", "r"], "--protocol must name"),
        (["report", "nowhere.csv", "--out", "r"], "the table must exist"),
        (["tidy", ".", "--protocol", "nothing", "--out", "t"], "must be a .toml file or one of"),
        (["tidy", ".", "--protocol", "demo", "--out", "t"], "no journal.jsonl was found"),
        (["report", "nowhere", "--protocol", "demo", "--title", "T", "--out", "r"], "study.title"),
        (["report", "nowhere", "--protocol", "demo", "--set", "alpha=0.1", "--out", "r"], "--set"),
        (["report", "no.csv", "--protocol", "demo", "--set", "test=pooled", "--out", "r"], "--set"),
        (["import", "none.csv", "--out", "i"], "no such file"),
        (["import", "none.csv", "--map", "x", "--out", "i"], "OURS=THEIRS"),
        (["power", "nothing"], "must be a .toml file or one of"),
    ],
)
def test_mistakes_get_one_message_and_status_2(tmp_path, monkeypatch, arguments, wanted):
    monkeypatch.chdir(tmp_path)
    result = run(*arguments, status=2)

    assert re.search(wanted, result.output), result.output
    assert "Traceback" not in result.output
    assert list(tmp_path.iterdir()) == []


def test_sessions_of_two_protocols_are_refused_with_status_2(
    tmp_path, demo_protocol, write_journals
):
    study = demo_protocol.study.model_copy(update={"version": "2"})
    other = demo_protocol.model_copy(update={"study": study})
    write_journals(tmp_path / "s" / "a", people=2)
    write_journals(tmp_path / "b", people=3, study=other)
    (tmp_path / "b" / "P03").rename(tmp_path / "s" / "P03")

    result = run("report", tmp_path / "s", "--protocol", "demo", "--out", tmp_path / "r", status=2)

    assert "all sessions must follow one protocol (found 2" in result.output
    assert not (tmp_path / "r").exists()


def test_help_teaches_with_an_example():
    for command in ("report", "tidy", "power", "import"):
        result = run(command, "--help")
        assert "Example" in result.output


def test_power_takes_the_deviations_of_a_pilot_and_draws_scenes_too(sessions, tmp_path):
    out = tmp_path / "power"
    result = run(
        *("power", "demo", "--from", sessions, "--set", "scene_sd=0.25", "--studies", 100),
        *("--out", out),
    )

    assert "only 5 participants in the pilot" in " ".join(result.output.split())
    assumed = json.loads((out / "power.json").read_text())["assumptions"]
    assert assumed["participant_sd"] != 0.6
    assert assumed["scene_sd"] == 0.25
    assert {"power-1-column.svg", "scenes-1-column.svg"} <= {path.name for path in out.iterdir()}


def test_a_pilot_of_another_kind_of_task_is_refused(tmp_path):
    table = tmp_path / "seen.csv"
    table.write_text("participant,correct\nP1,1\nP2,0\n")
    run(
        "import",
        table,
        "--task",
        "identification",
        "--set",
        "alternatives=4",
        "--out",
        tmp_path / "imported",
    )

    result = run("power", "demo", "--from", tmp_path / "imported" / "decisions.csv", status=2)

    assert "must hold decisions of the study's kind of task (preference)" in " ".join(
        result.output.split()
    )


@pytest.mark.parametrize("place", ["condition", "stimuli"])
def test_a_method_that_the_study_does_not_have_is_damage_and_no_traceback(
    tmp_path, write_journals, place
):
    """Without a plan to hold it to: report, tables and exports leave the line out and say so."""
    folder = write_journals(tmp_path / "s", people=3)
    journal = folder / "P02" / "journal.jsonl"
    lines = journal.read_text().split("\n")
    number = next(n for n, line in enumerate(lines) if "push-pull" in line and '"main' in line)
    event = json.loads(lines[number])
    changed = json.dumps(event[place]).replace("push-pull", "pull-push")
    lines[number] = json.dumps(event | {place: json.loads(changed)})
    journal.write_text("\n".join(lines))

    out = tmp_path / "out"
    result = run("export", folder, "--protocol", "demo", "--format", "pwcmp", "--out", out)

    told = " ".join(result.output.split())
    assert f"P02: line {number + 1} is damaged" in told
    assert "(got" in told
    assert "pull-push" in told
    assert "pull-push" not in (out / "pwcmp.csv").read_text()
    run("tidy", folder, "--protocol", "demo", "--out", tmp_path / "tables")
    assert "pull-push" not in (tmp_path / "tables" / "decisions.csv").read_text()
