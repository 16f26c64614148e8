"""`metamerlab demo`: the commands of a whole study on a few small clips, and the page of all."""

import io
import json
import os
import re
import shlex
import shutil
from collections.abc import Iterator
from concurrent.futures import Executor, Future
from dataclasses import replace
from pathlib import Path

import pytest
from command_line import metamerlab
from markupsafe import escape
from rich.console import Console
from study_texts import shipped_study
from typer.main import get_command

from protocols.disk.hashing import sha256_file
from protocols.errors import StudyError
from protocols.manifest import read_manifest
from study_app.cli import app
from study_app.cli.demo import demonstration
from study_app.cli.demo.demonstration import PROGRAMS, run_demo
from study_app.cli.demo.steps import Options, Step, run_commands, steps_of
from study_app.session_folders import find_sessions

SMALLER = {
    "width_deg": "2.0",
    "height_deg": "1.5",
    "duration_s": "0.2",
    "fixation_s": "0.1",
    "gap_s": "0.1",
    "iti_s": "0.1",
    # A busy machine misses refreshes; what follows is tested on a virtual clock.
    "dropped_frames_max": "10000",
    "completed_min_share": "0.0",
}


def write_small_study(folder: Path) -> Path:
    """One made scene and the photographs, one size, clips of six frames: 6 decisions."""
    text = shipped_study("showcase", SMALLER)
    text = re.sub(r"^(practice|catch) = \{.*\n", "", text, flags=re.M)
    text, scenes = re.subn(
        r'\n\[\[stimuli\.scenes\]\]\nname = "garden".*?(?=\n\[\[)', "\n", text, flags=re.S
    )
    text, sizes = re.subn(
        r'\n\[\[stimuli\.sizes\]\]\nname = "small".*?(?=\n\[\[)', "\n", text, flags=re.S
    )
    text, shares = re.subn(r"^hole_share = .*$", "extent_m = 0.16", text, flags=re.M)
    assert (scenes, sizes, shares) == (1, 1, 1)
    path = folder / "small.toml"
    path.write_text(text, encoding="utf-8")
    return path


def missing_window() -> str:
    """Reason why no window can be opened here, or nothing."""
    missing = [name for name in PROGRAMS if shutil.which(name) is None]
    return f"no {', '.join(missing)} here" if missing else ""


def run_quietly(options: Options) -> str:
    """Run the demonstration, and return what it printed."""
    console = Console(file=io.StringIO(), soft_wrap=True)
    run_demo(options, console)
    return console.file.getvalue()


# The demonstration itself


TWO = ["beyond-blur-detection", "critical-scaling-halves"]
"""Of the shipped studies that a step repeats its commands for; each has a report elsewhere."""


@pytest.fixture(scope="module")
def made(tmp_path_factory) -> Iterator[Options]:
    """Run every step once, on a few small clips, and the one of many studies for two of them."""
    pytest.importorskip("skimage")
    folder = tmp_path_factory.mktemp("demo")

    def fewer(*arguments) -> list[Step]:
        steps = steps_of(*arguments)
        return [replace(one, each=[n for n in one.each if n in (*TWO, "")]) for one in steps]

    if reason := missing_window():
        (pytest.fail if os.environ.get("REQUIRE_GL") == "1" else pytest.skip)(f"there is {reason}")
    options = Options(
        folder / "out", all=True, participants=3, study=str(write_small_study(folder))
    )
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(demonstration, "steps_of", fewer)
        run_quietly(options)
        yield options


@pytest.fixture(scope="module")
def page(made) -> str:
    return (made.out / "index.html").read_text(encoding="utf-8")


@pytest.mark.slow
@pytest.mark.timeout(900)
def test_the_page_says_on_every_screen_that_the_observers_are_simulated(page):
    assert "<title>SIMULATED:" in page
    assert re.search(r'class="stamp">[^<]*ALL OBSERVERS ARE SIMULATED', page)
    assert "Simulated data: this says what the program was told to prefer" in page


@pytest.mark.slow
def test_the_page_shows_pictures_of_its_own_and_links_files_of_its_folder(made, page):
    shown = re.findall(r'src="([^"]+)"', page)
    linked = re.findall(r'href="([^"#]+)"', page)

    assert {name.partition(";")[0] for name in shown} == {
        "data:image/png", "data:image/webp", "data:image/svg+xml", "data:video/webm"
    }  # fmt: skip
    assert {"clips/contact-sheet.html", "trial.html", "sessions/", "report/report.html"} <= set(
        linked
    )
    assert len([name for name in linked if name.endswith("report.html")]) == 1 + len(TWO)
    assert [name for name in linked if not (made.out / name).exists()] == []
    assert page.count("<video") == 2 * 3  # scenes x methods
    assert "http" not in re.sub(r"base64,[^\"]*", "", page.replace("http-equiv", ""))


@pytest.mark.slow
def test_the_page_tells_every_command_and_what_it_said(made, page):
    record = json.loads((made.out / "demo.json").read_text())
    shown = " ".join(page.split())

    for step in steps_of(made, "showcase"):
        assert f'<h2 id="{step.name}">{step.title}</h2>' in page
        for command, said in record[step.name]["said"]:
            assert f"<b>{escape(command)}</b>" in page
            assert " ".join(escape(said).split()) in shown
    (_, said), *_ = record["report"]["said"]
    assert "Metameric was chosen over Push-pull" in said


@pytest.mark.slow
def test_all_observers_took_part_in_the_study_that_was_built(made):
    sessions = find_sessions(made.out / "sessions", "showcase")
    manifest = read_manifest(made.out / "clips")
    starts = [session.journal.start for session in sessions]

    assert len(sessions) == made.participants
    assert {session.state for session in sessions} == {"completed"}
    assert all(start.simulated for start in starts)
    assert {start.manifest_sha256 for start in starts} == {manifest.sha256}
    assert sorted(start.slot for start in starts) == list(range(made.participants))
    evidence = [start.timing_evidence for start in starts]
    assert evidence.count("software timer") == 1  # one sat before a real window


@pytest.mark.slow
def test_run_again_it_keeps_what_is_done(made):
    def state() -> dict[str, str]:
        return {
            str(path): sha256_file(path)
            for path in sorted(made.out.rglob("*"))
            if path.is_file() and path.name != ".metamerlab-files.json"
        }

    before = state()
    printed = run_quietly(made)

    assert state() == before
    assert printed.count(": kept") == len(steps_of(made, "showcase"))
    assert "$ metamerlab" not in printed


@pytest.mark.slow
@pytest.mark.timeout(900)
def test_the_demonstration_itself_is_one_page_that_begins_with_a_picture_and_the_result(
    tmp_path, monkeypatch
):
    monkeypatch.setenv("PATH", str(tmp_path))  # it needs no X server
    result = metamerlab("demo", "--out", str(tmp_path / "out"))

    page = (tmp_path / "out/index.html").read_text(encoding="utf-8")
    first = [page.index(words) for words in ("<img src", "SIMULATED data. Metameric", "<details>")]
    assert first == sorted(first)
    assert len(find_sessions(tmp_path / "out/sessions")) == 12
    assert page.count("data:image/svg+xml") == page.count("data:image/png") == 2
    assert "pictures/before-and-after.png" in result.output.partition("$ metamerlab foveate")[0]


# What it does of its steps, with commands that do nothing


class Commands(list):
    """Each command that was run; every one leaves what its step says, but for those that fail."""

    fails = ""


class Here(Executor):
    """This process in place of others."""

    def submit(self, function, /, *arguments):
        done = Future()
        try:
            done.set_result(function(*arguments))
        except StudyError as error:
            done.set_exception(error)
        return done

    def stop(self) -> None:
        """Nothing goes on."""


@pytest.fixture
def commands(monkeypatch) -> Commands:
    ran = Commands()

    def run(commands, folder, _env):
        said = []
        for words in commands:
            ran.append(" ".join(words[:2]))
            said.append((shlex.join(["metamerlab", *words]), "said"))
            if ran[-1] == ran.fails:
                raise StudyError(f"{ran[-1]} must end well")
            for step in ran.steps:
                if words in [one for chain in step.chains() for one in chain]:
                    for name in step.named(step.makes):
                        (folder / name).parent.mkdir(parents=True, exist_ok=True)
                        (folder / name).write_text(str(len(ran)))
        return said, 1.0

    def steps(*arguments):
        ran.steps = steps_of(*arguments)
        return ran.steps

    monkeypatch.setattr(demonstration, "steps_of", steps)
    monkeypatch.setattr(demonstration, "run_commands", run)
    monkeypatch.setattr(demonstration, "local_processes", lambda _: Here())
    return ran


@pytest.fixture
def options(tmp_path) -> Options:
    return Options(tmp_path / "out")


def test_every_command_of_every_step_is_one_that_metamerlab_takes(tmp_path):
    for options in (
        Options(tmp_path),
        Options(tmp_path, all=True),
        Options(tmp_path, True, display="fhd27-60hz", study="/a folder/study.toml"),
    ):
        for step in steps_of(options, "showcase"):
            for chain in step.chains():
                for words in chain:
                    command, name = get_command(app), "metamerlab"
                    while commands := getattr(command, "commands", None):
                        name, *words = words
                        command = commands[name]
                        if slot := getattr(command, "_slot", None):
                            command = slot.load()
                    assert command.make_context(name, list(words)).args == []


def test_another_seed_makes_sessions_anew_and_recorded_ones_are_refused(options, commands):
    run_quietly(options)
    journal = options.out / "sessions/glimpse/S001/journal.jsonl"
    mine = options.out / "sessions/glimpse/S001/notes.txt"
    recorded = journal.parent.parent / "S900" / "journal.jsonl"
    other = replace(options, seed=1)
    simulated = journal.read_text()

    mine.write_text("precious")
    with pytest.raises(StudyError, match=r"it holds notes\.txt.*move that folder away"):
        run_quietly(other)
    mine.unlink()
    recorded.parent.mkdir()
    recorded.write_text("of a person")
    with pytest.raises(StudyError, match=r"S900: must hold nothing but.*it holds journal\.jsonl"):
        run_quietly(other)
    again = metamerlab("demo", "--out", str(options.out), "--fresh", status=2)
    assert "S900/journal.jsonl" in " ".join(again.output.split())
    assert recorded.read_text() == "of a person"
    recorded.unlink()
    journal.write_text("of a person as well")
    with pytest.raises(StudyError, match=r"S001: must hold nothing but"):
        run_quietly(other)
    journal.write_text(simulated)

    recorded.parent.rmdir()
    del commands[:]
    run_quietly(other)
    assert "session simulate" in commands
    assert journal.read_text() != simulated


def test_with_other_clips_all_that_came_of_them_is_done_again(options, commands):
    run_quietly(options)
    del commands[:]

    run_quietly(replace(options, display="fhd27-60hz"))

    assert commands == [
        "warp motorcycle", "stimuli build", "foveate pictures/metameric.png",
        "session simulate", "session list", "analysis report",
    ]  # fmt: skip


def test_after_a_command_that_failed_it_goes_on_from_there(options, commands):
    commands.fails = "session simulate"
    with pytest.raises(StudyError, match="session simulate must end well"):
        run_quietly(options)
    assert not (options.out / "index.html").exists()
    commands.fails = ""
    del commands[:]

    run_quietly(options)

    assert commands == ["session simulate", "session list", "analysis report"]
    assert (options.out / "index.html").exists()


def test_what_was_deleted_is_made_again(options, commands):
    run_quietly(options)
    (options.out / "pictures/conditions.png").unlink()
    del commands[:]

    run_quietly(options)

    assert commands == ["foveate pictures/metameric.png"]


def test_a_command_that_fails_is_the_last_one_and_its_message_is_passed_on(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("sys.argv", [])

    with pytest.raises(
        StudyError, match=r"(?s)'metamerlab stimuli check nowhere' must .*2\).*error: nowhere"
    ):
        run_commands([["stimuli", "check", "nowhere"], ["doctor"]], tmp_path, {})


def test_where_xvfb_is_missing_the_message_says_what_to_do(tmp_path, monkeypatch):
    monkeypatch.setenv("PATH", str(tmp_path))

    result = metamerlab("demo", "--all", "--out", str(tmp_path / "out"), status=2)

    for cure in ("Xvfb", "apt-get install xvfb openbox", "--display", "leave out --all"):
        assert cure in result.output
    assert not (tmp_path / "out").exists()


def test_a_display_without_a_window_is_refused(tmp_path):
    arguments = ["demo", "--out", str(tmp_path), "--display", "fhd27-60hz"]

    result = metamerlab(*arguments, status=2)

    assert "--display must stand beside --all" in result.output


def test_a_folder_of_other_things_is_left_alone(tmp_path):
    (tmp_path / "report").mkdir()
    arguments = ["demo", "--out", str(tmp_path)]

    result = metamerlab(*arguments, status=None)
    fresh = metamerlab(*arguments, "--fresh", status=None)

    assert result.exit_code == fresh.exit_code == 2
    assert "must be empty or made by 'metamerlab demo' (it holds report" in result.output
    assert "nothing was deleted" in fresh.output
    assert [path.name for path in tmp_path.iterdir()] == ["report"]


def test_it_says_where_it_cannot_write(tmp_path):
    (tmp_path / "out").write_text("a file")

    result = metamerlab("demo", "--out", str(tmp_path / "out"), status=2)

    assert "out" in result.output
    assert "Traceback" not in result.output
