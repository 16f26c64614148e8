"""The command `metamerlab`: what it lists, what it imports, how it fails."""

import errno
import io
import re
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
import typer
from command_line import metamerlab
from typer.testing import CliRunner

from pipeline.errors import GLUnavailableError, InputError
from protocols.errors import StudyError
from study_app.cli import SLOTS, CommandSlot, LazyGroup, main, user_errors

HEAVY = ("numpy", "pandas", "scipy", "moderngl", "glfw", "pydantic", "matplotlib", "PIL", "cv2")


def run_cli(*arguments: str) -> subprocess.CompletedProcess[str]:
    code = "from study_app.cli import main; main()"
    return subprocess.run(
        [sys.executable, "-c", code, *arguments], capture_output=True, text=True, timeout=60
    )


def test_help_imports_nothing_heavy():
    code = (
        "import sys\n"
        "from study_app.cli import main\n"
        "try:\n    main()\nexcept SystemExit:\n    pass\n"
        f"print('IMPORTED', [name for name in {HEAVY!r} if name in sys.modules])"
    )

    done = subprocess.run(
        [sys.executable, "-c", code, "--help"], capture_output=True, text=True, timeout=60
    )

    assert "doctor" in done.stdout
    assert done.stdout.strip().splitlines()[-1] == "IMPORTED []", done.stdout + done.stderr


@pytest.mark.slow
def test_help_of_no_command_imports_statistics_or_graphics():
    """A command imports what it works with when it runs; its formats it needs at once."""
    heavy = sorted({*HEAVY, "statsmodels", "jinja2"} - {"numpy", "pydantic", "PIL"})
    code = (
        "import sys\n"
        "from study_app.cli import SLOTS\n"
        "for slot in SLOTS:\n"
        "    slot.load()\n"
        f"    print(slot.name, [name for name in {heavy!r} if name in sys.modules])"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60)

    assert done.stdout.splitlines() == [f"{slot.name} []" for slot in SLOTS], done.stderr


@pytest.mark.slow
def test_planning_a_study_imports_no_figures_and_no_models():
    """`protocol check` asks every statistic about the design, and computes none of them."""
    heavy = ("matplotlib", "statsmodels", "scipy.stats", "scipy.optimize", "scipy.sparse")
    code = (
        "import sys\n"
        "from analysis.tasks import planning_notes\n"
        "from protocols.load import load_protocol, shipped\n"
        "for path in shipped('studies').values():\n"
        "    study = load_protocol(path)\n"
        "    planning_notes(study)\n"
        f"print(study.study.name, [name for name in {heavy!r} if name in sys.modules])"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60)

    assert done.stdout.endswith(" []\n"), done.stdout + done.stderr


def test_help_lists_every_slot():
    listed = metamerlab("--help", terminal_width=100, status=None).stdout

    for slot in SLOTS:
        assert slot.help in listed, slot.name


@pytest.mark.parametrize("name", [slot.name for slot in SLOTS])
def test_help_of_every_command_shows_an_example(name):
    shown = metamerlab(name, "--help", prog_name="metamerlab")

    assert f"Usage: metamerlab {name}" in shown.stdout
    assert "xample" in shown.stdout, "the help of a command must show how it is used"


def every_command() -> list[tuple[str, Any]]:
    """Return every command that does something, with the words that call it."""
    found = []
    for slot in SLOTS:
        command = slot.load()
        inner = getattr(command, "commands", None) or {"": command}
        found += [(f"{slot.name} {name}".strip(), each) for name, each in inner.items()]
    return found


@pytest.mark.parametrize(("name", "command"), [pytest.param(*c, id=c[0]) for c in every_command()])
def test_help_of_every_command_and_option_is_there_and_shown_whole(name, command):
    assert f"metamerlab {name}" in command.help, "an example must call the command"
    for parameter in command.params:
        assert parameter.help, f"{name}: {parameter.name} has no help"
        # Text in square brackets is markup: it vanishes unless its bracket is escaped.
        assert not re.search(r"(?<!\\)\[", parameter.help), f"{name}: {parameter.name}"


@pytest.mark.parametrize(
    "words", ["", "new-study", "doctor", "session import-web", "analysis power", "warp"]
)
def test_help_names_types_in_words_and_flags_without_one(words):
    said = metamerlab(*words.split(), "--help", env={"COLUMNS": "160"}, status=None).output
    assert "--help " in said
    types = re.findall(r"<([^<>]+)>", said)
    assert not [one for one in types if re.search(r"^(bool|str|int|float|Path)\b|\[", one)]
    assert words == "" or "text" in types or "path" in types


@pytest.mark.parametrize(
    ("value", "said"),
    [
        ("2.5", "must be a valid whole number (got '2.5')"),
        ("70%", "must be a valid whole number (got '70%')"),
        ("0", "must be greater than or equal to 1 (got '0')"),
    ],
)
def test_a_number_that_is_none_is_named_with_what_it_must_be(value, said):
    words = ["session", "simulate", "demo", "--participants", value]
    done = metamerlab(*words, env={"COLUMNS": "200"}, status=2)
    assert f"Invalid value for '--participants': {said}" in done.stderr


@pytest.mark.slow
def test_help_of_every_command_is_shown_by_a_console_that_knows_few_characters(monkeypatch):
    calls = [[], *([slot.name] for slot in SLOTS), *(name.split() for name, _ in every_command())]
    for words in calls:
        shown = io.BytesIO()
        monkeypatch.setattr(sys, "stdout", io.TextIOWrapper(shown, encoding="ascii"))
        monkeypatch.setattr(sys, "argv", ["metamerlab", *words, "--help"])
        with pytest.raises(SystemExit) as ended:
            main()
        sys.stdout.flush()
        assert ended.value.code == 0, words
        assert b"Usage: metamerlab" in shown.getvalue()


def test_a_message_about_any_name_is_shown_by_a_console_that_knows_few_characters(
    monkeypatch, tmp_path
):
    said = io.BytesIO()
    stream = io.TextIOWrapper(said, encoding="cp1252", errors="strict")
    monkeypatch.setattr(sys, "stderr", stream)
    missing = str(tmp_path / "画像 ←.toml")
    for words in (["protocol", "check", missing], ["stimuli", "check", missing], ["→"]):
        monkeypatch.setattr(sys, "argv", ["metamerlab", *words])
        with pytest.raises(SystemExit) as ended:
            main()
        assert ended.value.code == 2, words
    stream.flush()

    assert said.getvalue().count(b"\\u753b") >= 2
    assert b"\\u2192" in said.getvalue()


def test_version_names_version_and_git_revision():
    shown = metamerlab("--version", status=None).stdout

    assert shown.startswith("metamerlab ")
    assert "git revision" in shown


def test_unknown_command_suggests_the_nearest_and_exits_with_2():
    done = run_cli("docter")

    assert done.returncode == 2
    assert "doctor" in done.stderr
    assert "Traceback" not in done.stderr


def test_a_message_about_a_megabyte_leaves_its_middle_out(capsys):
    with pytest.raises(typer.Exit), user_errors():
        raise StudyError("a.csv: line 2: must be short (got " + "x" * 10**6 + "); cut it\nanother")
    said = capsys.readouterr().err

    assert said.startswith("error: a.csv: line 2: must be short (got xxx")
    assert "more characters]" in said
    assert said.endswith("x); cut it\n       another\n")
    assert len(said) < 2200


def lazy_app(target: str) -> typer.Typer:
    class Group(LazyGroup):
        slots = (CommandSlot("job", "A job.", target),)

    return typer.Typer(cls=Group, callback=lambda: None)


def test_a_slot_offers_a_function_or_a_whole_group(tmp_path, monkeypatch):
    (tmp_path / "slot_under_test.py").write_text(
        "import typer\n"
        "app = typer.Typer(callback=lambda: None)\n"
        "@app.command()\n"
        "def inner(size: int = 3) -> None:\n    print('size', size)\n"
    )
    monkeypatch.syspath_prepend(tmp_path)

    alone = CliRunner().invoke(lazy_app("slot_under_test:inner"), ["job", "--size", "5"])
    grouped = CliRunner().invoke(lazy_app("slot_under_test:app"), ["job", "inner", "--size", "7"])

    assert (alone.exit_code, alone.stdout) == (0, "size 5\n")
    assert (grouped.exit_code, grouped.stdout) == (0, "size 7\n")


@pytest.mark.parametrize(
    ("error", "said"),
    [
        (StudyError("pilot.toml: one\npilot.toml: two"), "pilot.toml: one\n       pilot.toml: two"),
        (InputError("flow_px must be finite (found NaN)"), "flow_px must be finite (found NaN)"),
        (GLUnavailableError("OpenGL 4.3 is needed"), "OpenGL 4.3 is needed"),
        (FileNotFoundError(errno.ENOENT, "No such file", "a.exr"), "a.exr: no such file; check"),
        (PermissionError(errno.EACCES, "Permission denied", "out"), "out: permission denied;"),
        (OSError(errno.ENOSPC, "No space left on device"), "no space left on device; free"),
        (MemoryError("Unable to allocate 298. GiB"), "this must fit into the machine's memory (Un"),
    ],
)
def test_what_the_user_can_mend_gives_one_message_and_exit_status_2(capsys, error, said):
    with pytest.raises(typer.Exit) as exit_info, user_errors():
        raise error

    printed = capsys.readouterr()
    assert exit_info.value.exit_code == 2
    assert printed.out == ""
    assert printed.err.startswith(f"error: {said}")


@pytest.mark.parametrize(
    "bug", [ValueError("a bug"), KeyError("a bug"), OSError(errno.EBADF, "Bad file descriptor")]
)
def test_a_bug_keeps_its_traceback(bug):
    with pytest.raises(type(bug)), user_errors():
        raise bug


def test_a_missing_folder_is_told_without_a_traceback(tmp_path: Path):
    done = run_cli("doctor", "--folder", str(tmp_path / "nowhere"))

    assert done.returncode == 2
    assert "nowhere" in "".join(filter(str.isalpha, done.stderr))  # a box may break the line
    assert "Traceback" not in done.stderr


@pytest.mark.parametrize(
    ("line", "some", "none"),
    [
        ("protocol show de", ["demo"], ["showcase"]),
        ("stimuli build beyond-blur-t", ["beyond-blur-task"], ["demo"]),
        ("session simulate demo --display fhd2", ["fhd24-144hz", "fhd27-60hz"], ["qhd27-120hz"]),
        ("session check-display u", ["uhd55-60hz"], ["fhd27-60hz"]),
        ("new-study x --task which", ["which-half"], ["reaction"]),
        ("analysis import t.csv --task r", ["rating", "ratings", "reaction"], ["abx"]),
        ("foveate x.png --methods metamer,b", ["metamer,blur"], ["metamer,push-pull"]),
        ("warp x.png y.png -m t", ["telea"], ["metamer"]),
        ("new-study x --methods reference,t", ["reference,telea"], ["reference,blur"]),
        ("new-study x --photos a.jpg --methods bl", ["blur"], ["telea"]),
        ("protocol show mine/", ["mine/study.toml"], ["mine/notes.txt", "mine/.git/"]),
        ("protocol show mi", ["mine/"], []),
    ],
)
def test_a_shell_completes_values(tmp_path, monkeypatch, line, some, none):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "mine").mkdir()
    for name in ("study.toml", "notes.txt", ".git"):
        (tmp_path / "mine" / name).touch()
    words = f"metamerlab {line}"
    asked = {
        "_METAMERLAB_COMPLETE": "complete_bash",
        "COMP_WORDS": words,
        "COMP_CWORD": str(len(words.split()) - 1),
    }
    done = metamerlab(prog_name="metamerlab", env=asked, status=None)
    offered = done.stdout.split("\n")
    assert set(some) <= set(offered), done.output
    assert not set(none) & set(offered)


@pytest.mark.parametrize(
    "command", ["analysis power", "demo", "warp", "foveate", "live", "session simulate", "figure"]
)
def test_one_thing_has_one_spelling_in_every_help(command, monkeypatch):
    monkeypatch.setenv("COLUMNS", "200")
    said = metamerlab(*command.split(), "--help", status=None).output
    for old in ("--people", "--observers", "--method "):
        assert old not in said
    assert "--participants" in said or "--methods" in said


@pytest.mark.parametrize("name", ["psychometric", "detection", "reaction", "ratings"])
def test_confidence_is_that_of_participants_and_limits_have_coverage(name, monkeypatch):
    monkeypatch.setenv("COLUMNS", "200")
    said = metamerlab("analysis", name, "--help", status=None).output
    assert "--coverage" in said
    assert "--confidence" not in said
    for option, known in (("--confidence", True), ("--confidense", False)):
        done = metamerlab("analysis", name, "no.csv", option, "0.9", status=2)
        assert ("No such option" not in done.stderr) is known


def test_old_spellings_of_participants_and_methods_are_still_read(tmp_path):
    design = ("--pairs", "1", "--scenes", "2", "--repeats", "1", "--rate", "0.6")
    for option in (["--people", "1"], ["--people=1"]):
        done = metamerlab("analysis", "power", *design, *option, status=2)
        assert "--participants: must be 2 to" in done.stderr
    done = metamerlab("demo", "--observers", "1", "--out", str(tmp_path / "x"), status=None)
    assert "--participants" in done.stderr
    for words in (["--method", "metamr"], ["--method=metamr"], ["-m", "telea", "-m", "metamr"]):
        done = metamerlab("warp", "motorcycle", *words, "--compare", "s.png", status=2)
        assert "'metamr'" in done.stderr
    done = metamerlab("warp", "motorcycle", "--methods", "telea,,mean", status=None)
    assert "--methods: must be names joined by commas" in done.stderr
