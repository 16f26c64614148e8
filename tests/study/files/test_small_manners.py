"""Small things that a user meets: Ctrl-C, names in pipes, key names, paths with spaces."""

import io
import shlex

import numpy as np
import pytest
from command_line import result_of
from rich.table import Table

from protocols.disk.whole_file import read_bytes
from protocols.errors import StudyError
from protocols.journal import GazeInfo
from protocols.journal_file import read_journal
from protocols.load import load_display, load_protocol, shipped
from protocols.study_file.preregister import preregistration, to_markdown
from protocols.study_file.session_schema import key_label
from study_app import simulate
from study_app.cli.sessions.session_commands import _data_of
from study_app.cli.terminal import PlainConsole
from study_app.conduct import Dialogue
from study_app.observers import ArtificialObserver, default_model
from study_app.pages import PageLayout
from study_app.shown_texts import require_showable
from study_app.stage import Page, PageResult

LONG = "a-scene-with-a-long-name__a-size-with-a-long-name__a-method-with-a-long-name"


def demo():
    return load_protocol(shipped("studies")["demo"])


def with_texts(study, texts):
    return study.model_copy(
        update={"text": study.text.model_copy(update={"languages": {"de": texts}})}
    )


run = result_of()


def test_an_interrupted_simulation_says_that_it_goes_on_and_does(tmp_path, monkeypatch):
    once, whole = [], simulate.simulate_session

    def interrupted(simulation, root, code, **options):
        if code == "S002" and not once:
            once.append(code)
            raise KeyboardInterrupt
        return whole(simulation, root, code, **options)

    monkeypatch.setattr(simulate, "simulate_session", interrupted)
    command = ("session", "simulate", "demo", "--participants", 2, "--out", tmp_path)
    stopped = run(*command, status=130)
    assert stopped.stderr == "stopped; the same command continues from here\n"
    again = run(*command)
    assert "1 simulated session," in again.stdout


@pytest.mark.parametrize(
    ("within", "words"),
    [
        (
            "stimuli.recipes.build_warped_clips.WarpedClipBuilder.build",
            ("stimuli", "build", "demo"),
        ),
        ("study_app.cli.demo.demonstration.run_demo", ("demo",)),
    ],
)
def test_what_keeps_its_work_says_at_ctrl_c_that_the_same_command_continues(
    tmp_path, monkeypatch, within, words
):
    def stopped(*_, **__):
        raise KeyboardInterrupt

    monkeypatch.setattr(within, stopped)
    done = run(*words, "--out", tmp_path, status=130)
    assert done.stderr.endswith("stopped; the same command continues from here\n")


def test_a_mouse_for_an_eye_and_a_timer_for_a_display_are_a_rehearsal(tmp_path):
    run("session", "simulate", "demo", "--out", tmp_path, status=None)
    start = read_journal(tmp_path / "demo/S001/journal.jsonl").start
    assert _data_of(start) == "simulated"
    real = start.model_copy(update={"simulated": False, "timing_evidence": "fence"})
    assert _data_of(real) == "real"
    mouse = GazeInfo(source="mouse", rate_hz=60.0)
    for update, said in (
        ({"gaze": mouse}, "rehearsal (mouse)"),
        ({"timing_evidence": "software timer"}, "rehearsal (timer)"),
        ({"gaze": mouse, "timing_evidence": "software timer"}, "rehearsal (mouse and timer)"),
    ):
        assert _data_of(real.model_copy(update=update)) == said


@pytest.mark.parametrize(("background", "grey"), [(128, 0), (20, 255)])
def test_a_page_of_a_break_has_a_bar_as_full_as_much_is_done(background, grey):
    lay_out = PageLayout((640, 480), {}, background)
    plain, bar = (lay_out.page("Rest.", "space", share).image() for share in (0.0, 0.25))
    drawn = (bar != plain).any(axis=-1)
    rows, columns = np.flatnonzero(drawn.any(axis=1)), np.flatnonzero(drawn.any(axis=0))
    assert rows[-1] < 0.2 * 480, "above the text"
    assert (columns[0], columns[-1]) == (192, 447), "in the middle, 40 % of the width"
    inside = bar[(rows[0] + rows[-1]) // 2, 192:448]
    filled = inside[1:-1, 3] == 255
    assert filled.sum() == filled.argmin() == 63, "a quarter, from the left"
    assert (inside[:64] == (grey, grey, grey, 255)).all()


def test_participants_see_how_much_is_done_at_every_break_and_nowhere_else():
    study = demo()
    shown = []

    class Shown:
        def page(self, page):
            shown.append(page)
            return PageResult(study.response.continue_keys[0], "", 0.0)

    texts = study.text.languages["en"]
    pages = Dialogue(Shown(), study.response, texts, blocks=4)
    pages.show("instructions", texts.instructions[0])
    for block in (1, 2, 3):
        pages.show("break", texts.break_page, done=block)
    assert [page.done_share for page in shown] == [0.0, 0.25, 0.5, 0.75]


def test_an_artificial_observer_lets_a_person_quit():
    study = demo()
    observer = ArtificialObserver(default_model(study), study.response, 0, "S001")
    keys = (*study.response.quit_keys, *study.response.continue_keys)
    assert observer.turn_page(Page("quit", "Quit?", keys)).key in study.response.quit_keys
    assert observer.turn_page(Page("start", "Go", keys)).key in study.response.continue_keys


def test_names_stay_whole_in_pipes_and_a_width_can_be_asked_for(monkeypatch):
    monkeypatch.delenv("COLUMNS", raising=False)
    table = Table("clip", "change", box=None)
    table.add_row(LONG, "1.00")
    piped = io.StringIO()
    PlainConsole(file=piped).print(table)
    assert f"{LONG}  1.00" in " ".join(piped.getvalue().split("\n"))
    narrow = io.StringIO()
    monkeypatch.setenv("COLUMNS", "40")
    PlainConsole(file=narrow).print(table)
    assert LONG not in narrow.getvalue()


def test_keys_are_called_in_the_participants_language_where_the_study_says_how():
    study = demo()
    texts = study.text.languages["de"]
    named = texts.model_copy(update={"key_names": {"space": "Leertaste"}})
    assert key_label("space", named.key_names) == "Leertaste"
    assert key_label("left", named.key_names) == "\N{LEFTWARDS ARROW}"
    pictures = [
        PageLayout((640, 480), each.key_names, 128).page("Text", "space").image()
        for each in (texts, named)
    ]
    assert (pictures[0] != pictures[1]).any()
    assert "key_names" not in texts.model_dump()
    unwritable = texts.model_copy(update={"key_names": {"space": "\U000131a3"}})
    with pytest.raises(Exception, match="character"):
        require_showable(with_texts(study, unwritable), load_display("fhd27-60hz"), language="de")


@pytest.mark.parametrize("name", ["plain", "with a space", "it's"])
def test_a_printed_command_can_be_pasted_whatever_its_path(tmp_path, name):
    folder = tmp_path / name
    said = run("new-study", folder, "--name", "mine", status=None).stdout
    (line,) = [line for line in said.splitlines() if line.strip().startswith("cd ")]
    assert shlex.split(line) == ["cd", str(folder)]


def test_a_preregistration_says_which_attempts_do_not_count():
    study = demo()
    display = load_display(study.display.display)
    text = to_markdown("x", preregistration(study, display, "1"))
    assert "attempts that a pause, the quit key or another window cut short do not count" in text


def test_a_missing_file_and_a_folder_in_its_place_are_named_with_what_may_be_meant(tmp_path):
    (tmp_path / "study.toml").touch()
    for path, said in (
        (tmp_path / "studdy.toml", f"no such file); did you mean {tmp_path / 'study.toml'}?"),
        (tmp_path / "other.csv", "no such file); check the path"),
        (tmp_path / "none" / "study.toml", "no such file); check the path"),
        (tmp_path, f"this is a folder); name {tmp_path / 'study.toml'}"),
    ):
        with pytest.raises(StudyError) as caught:
            read_bytes(path, "the TOML file", "toml")
        assert said in str(caught.value)
