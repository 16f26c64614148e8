"""Artificial observers go through an exported folder in Chromium, and come home as such."""

from __future__ import annotations

import json
import shutil

import pytest
from typer.testing import CliRunner, Result
from web_kernel import needed

from protocols.journal_file import JOURNAL_NAME
from protocols.plan import make_plan
from study_app.cli import app
from study_app.cli.sessions.session_commands import ObserverOptions
from study_app.observers import ArtificialObserver
from study_app.session_folders import find_sessions
from study_app.verification import verify
from study_app.web.chromium import PROGRAMS


def simulate(of, out, *words: object, web=None) -> Result:
    """Run the command on a built study; its file is written beside its export."""
    path = of.out.parent / "web-study.toml"
    if not path.exists():
        text = (of.out.parent / "study.toml").read_text()
        path.write_text(text + '\n[web]\ngaze = "none"\ntolerance_s = 0.01\n')
    told = "session", "simulate", path, "--web", web or of.out, "--out", out, *words
    return CliRunner().invoke(app, [*map(str, told)], terminal_width=200)


def said(result: Result) -> str:
    return " ".join(result.output.split())


def rows(of, root, seed, options) -> list[tuple[object, ...]]:
    """Return the trial of each decision, its key and time, and what the observer would do."""
    (session,) = find_sessions(root)
    start = session.journal.start
    study = of.study.in_a_browser().ordered_by(start.seed)
    plan = make_plan(study, of.manifest, start.participant, start.slot)
    trials = {trial.id: trial for trial in plan.trials}
    observer = ArtificialObserver(options.model(of.study), study.response, seed, "S001")
    found = []
    for one in session.journal.attempts:
        if one.outcome == "completed":
            shown = {
                "condition": one.condition,
                "stimuli": one.stimulus_names,
                "correct": one.expected,
            }
            trial = trials[one.trial].model_copy(update=shown)
            found.append((one.trial, (one.key, one.rt_s), observer.answer(trial, one.attempt)))
    return found


@pytest.mark.slow
def test_observers_run_an_exported_folder_and_come_home_as_simulated(case, tmp_path):
    needed("Chromium", next(filter(None, map(shutil.which, PROGRAMS)), None))
    of = case("yes-no by up-down")
    words = ("--stimuli", of.stimuli, "--seed", 3, "--strength", "two=3", "--missed-per-1000", 8)
    done = simulate(of, tmp_path / "a", *words)
    assert done.exit_code == 0, done.output
    assert "1 simulated session, 12 decisions" in done.output
    (session,) = find_sessions(tmp_path / "a")
    start = session.journal.start
    assert (session.state, start.simulated, start.slot) == ("completed", True, 0)
    assert (start.remote.slot_from, start.remote.machine.simulated) == ("link", True)
    assert start.remote.machine.missed_share > 0
    assert list(verify(session, of.study).problems) == []
    answered = rows(of, tmp_path / "a", 3, ObserverOptions(strength=["two=3"]))
    assert len(answered) >= 16
    for trial, (key, rt_s), (wanted, wanted_s) in answered:
        assert (trial, key) == (trial, wanted)
        assert rt_s == pytest.approx(wanted_s, abs=3e-6)

    # The same command makes the same journal; and what is there stays.
    journal = tmp_path / "a" / of.study.study.name / session.participant / JOURNAL_NAME
    assert simulate(of, tmp_path / "b", *words).exit_code == 0
    again = tmp_path / "b" / journal.relative_to(tmp_path / "a")
    assert again.read_bytes() == journal.read_bytes()
    done = simulate(of, tmp_path / "a", *words)
    assert "0 simulated sessions" in done.output


@pytest.mark.slow
def test_a_page_that_cannot_show_its_study_is_one_message_and_no_session(case, tmp_path):
    needed("Chromium", next(filter(None, map(shutil.which, PROGRAMS)), None))
    of = case("yes-no")
    web = tmp_path / "web"
    shutil.copytree(of.out, web)
    for pack in (web / "packs").iterdir():
        pack.write_bytes(pack.read_bytes()[:-1])
    done = simulate(of, tmp_path / "out", "--stimuli", of.stimuli, web=web)
    assert done.exit_code == 2
    assert "the page must run the study to its end (it says: 'Something went wrong: packs/" in said(
        done
    )
    assert not (tmp_path / "out").exists()


def altered(of, folder, what):
    """Copy an export with one key of its `study.json` changed."""
    folder.mkdir()
    told = json.loads((of.out / "study.json").read_text())
    (folder / "study.json").write_text(json.dumps(told | what))
    return folder


@pytest.mark.parametrize(
    ("what", "options", "message"),
    [
        ({}, ("--late-per-1000", "5"), "--late-per-1000: must be left out with --web"),
        ({}, ("--steady-gaze",), "--steady-gaze: must be left out with --web"),
        ({"protocol_sha256": "0" * 64}, (), "the study file must be the one that was exported"),
        ({"manifest_sha256": "0" * 64}, (), "the manifest of the stimuli must be the one that was"),
        ({"format": 9}, (), "must be as this version exports it (must be 1 (got 9)); export the"),
    ],
    ids=str,
)
def test_a_folder_of_another_study_and_options_of_the_desk_are_refused(
    case, tmp_path, what, options, message
):
    of = case("yes-no")
    web = altered(of, tmp_path / "web", what)
    done = simulate(of, tmp_path / "out", "--stimuli", of.stimuli, *options, web=web)
    assert (done.exit_code, message in said(done)) == (2, True), done.output
    assert not (tmp_path / "out").exists()


def test_no_chromium_no_stimuli_and_no_export_are_named_with_a_cure(case, tmp_path, monkeypatch):
    of = case("yes-no")
    assert "--web: needs --stimuli" in said(simulate(of, tmp_path / "out"))
    words = "--stimuli", of.stimuli
    done = simulate(of, tmp_path / "out", *words, web=of.stimuli)
    assert "'metamerlab session export-web' wrote (there is no study.json); name" in said(done)
    monkeypatch.setenv("PATH", str(tmp_path))
    done = simulate(of, tmp_path / "out", *words)
    assert done.exit_code == 2
    assert said(done).startswith("error: Chromium must be on the PATH, as one of chromium, ")
    assert said(done).endswith("install it: sudo apt-get install chromium")
    assert not (tmp_path / "out").exists()
