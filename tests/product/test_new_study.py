"""`metamerlab new-study` makes a folder that works at once and explains every key."""

import re
import tomllib
from pathlib import Path

import pytest

from protocols.display import Display
from protocols.load import load_display, load_protocol, shipped
from protocols.recipes.warped_clips import BuiltinScene, Clips, FillMethod, Size
from protocols.study_file.new_study import clip_fps, explained, study_files
from protocols.study_file.schema import StudyProtocol
from protocols.study_file.session_schema import ClosingQuestion, Exclusions, Practice, Texts
from protocols.tasks.pairs import CatchPair, PrimaryComparison
from protocols.tasks.task_kinds import TASKS
from protocols.units import key_docs
from study_app.cli.new_study_command import slug


@pytest.fixture
def made(metamerlab, tmp_path) -> Path:
    metamerlab("new-study", tmp_path / "My Study 2")
    return tmp_path / "My Study 2"


def test_it_is_in_order_at_once_from_wherever_it_is_checked(metamerlab, made, monkeypatch):
    for folder, name in ((made, "study.toml"), (made.parent, "My Study 2/study.toml")):
        monkeypatch.chdir(folder)
        done = metamerlab("protocol", "check", name)
        assert "my-study-2: in order" in done.stdout
    assert {path.name for path in made.iterdir()} == {
        "README.md", "study.toml", "display.toml", "schemas", "scenes", "clips", "sessions",
        "report", "study.secret", ".gitignore",
    }  # fmt: skip
    assert (made / "study.secret").stat().st_mode & 0o077 == 0
    assert len((made / "study.secret").read_text().strip()) == 64


@pytest.mark.parametrize("display", shipped("displays"))
def test_it_is_in_order_for_every_shipped_display(metamerlab, tmp_path, display):
    metamerlab("new-study", tmp_path / "study", "--display", display)

    metamerlab("protocol", "check", tmp_path / "study" / "study.toml")
    copied = load_display(str(tmp_path / "study" / "display.toml"))
    # A display that will be changed must not go by the name of another in manifests and journals.
    assert copied.name == "my-display"
    assert copied == load_display(display).model_copy(update={"name": "my-display"})


@pytest.mark.parametrize(
    ("section", "model"),
    [
        *((name, name) for name in ("study", "display", "design", "trial", "gaze")),
        *((name, name) for name in ("response", "privacy")),
        ("stimuli.scenes", BuiltinScene),
        ("stimuli.sizes", Size),
        ("stimuli.methods", FillMethod),
        ("stimuli.clips", Clips),
        ("task", TASKS["two-interval"].task),
        ("analysis", TASKS["two-interval"].task.analysis),
        ("task.catch", CatchPair),
        ("design.practice", Practice),
        ("analysis.primary", PrimaryComparison),
        ("analysis.exclusions", Exclusions),
        ("text.languages.en", Texts),
        ("text.languages.en.questions", ClosingQuestion),
    ],
)
def test_every_key_of_every_section_is_there_and_explained(made, section, model):
    if isinstance(model, str):
        model = StudyProtocol.model_fields[model].annotation
    parts = re.split(r"^\[\[?([\w.]+)\]\]?$", (made / "study.toml").read_text(), flags=re.M)
    lines = next(
        text for name, text in zip(parts[1::2], parts[2::2], strict=True) if name == section
    ).splitlines()
    tables = {
        "task": {"catch", "sampling", "confidence"},
        "design": {"practice"},
        "analysis": {"primary", "exclusions"},
        "text.languages.en": {"questions"},
    }

    for table in tables.get(section, set()):  # what is left out stands there as a comment
        assert re.search(
            rf"^(# )?\[+{section}\.{table}\]+$", (made / "study.toml").read_text(), re.M
        )
    for key in set(model.model_fields) - tables.get(section, set()):
        at = next((i for i, line in enumerate(lines) if re.match(rf"(# )?{key} = ", line)), None)
        assert at is not None, f"[{section}] {key} is missing"
        assert lines[at - 1].startswith("# "), f"[{section}] {key} is not explained"


def test_examples_of_optional_keys_are_valid_themselves(made):
    text = (made / "study.toml").read_text(encoding="utf-8")
    examples = re.findall(r"^# (\w+) = (.+)$", text, flags=re.M)
    ours = {
        "source", "view", "parameters", "reference", "extent_m", "method", "bit_depth",
        "render_width_px", "rescale", "margin_share", "exr", "preview", "scenes", "timeout_s",
        "choices", "rt_max_s", "retention_months",
    }  # fmt: skip
    assert ours <= {key for key, _ in examples}

    # Alternatives to what is there (an extent instead of a share) go in one by one.
    for key in ours - {"extent_m", "parameters", "method"}:
        one = re.sub(rf"^# ({key} = .+)$", r"\1", text, count=1, flags=re.M)
        if key == "render_width_px":
            one = re.sub(r"^# (rescale = .+)$", r"\1", one, count=1, flags=re.M)
        path = made / "with-example.toml"
        path.write_text(one, encoding="utf-8")
        load_protocol(path)


def test_scenes_in_comments_are_as_a_study_takes_them(made):
    text = (made / "study.toml").read_text(encoding="utf-8")
    kinds = []
    for block in re.findall(r"^# \[\[stimuli\.scenes\]\]\n(?:# .*\n)+", text, flags=re.M):
        section = re.sub(r"^# ", "", block, flags=re.M)
        path = made / "with-scene.toml"
        path.write_text(text.replace(block, section), encoding="utf-8")
        kinds.append(load_protocol(path).stimuli.scenes[-1].kind)
    assert kinds == ["mesh", "stereo", "rgbd", "exr"]


def test_comments_come_from_the_schema():
    text = explained(
        "[stimuli.clips]\nfps = 30.0\n#? exr = false\n[stimuli.clips]\nfps = 60.0\n", StudyProtocol
    )

    meaning = key_docs(Clips)
    assert text == (
        f"[stimuli.clips]\n# {meaning['fps']} (Hz, > 0)\nfps = 30.0\n"
        f"# {meaning['exr']} (true | false, default false)\n# exr = false\n"
        "[stimuli.clips]\nfps = 60.0\n"
    )


def test_names_and_titles_reach_every_file():
    made = study_files("two-words", "Two words", load_display("qhd27-120hz"))

    assert tomllib.loads(made["study.toml"])["study"]["name"] == "two-words"
    assert "# Two words" in made["README.md"]
    assert not [name for name, text in made.items() if re.search(r"@[A-Z_]+@", text)]
    assert Display.model_validate(tomllib.loads(made["display.toml"])).width_px == 2560


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["日本"], "give one with --name"),
        (["x", "--name", "Not A Name"], "--name: must be lower-case words"),
        (["x", "--name", "a" * 49], "at most 48"),
        (["x", "--title", 'a "b"'], "--title: must hold no quotes"),
        (["x", "--title", ""], "and not be empty (got '')"),
        (["x", "--name", ""], "--name: must be lower-case words"),
        (["x", "--display", "fhd28-60hz"], "fhd27-60hz"),
        (["full"], "must be empty or new"),
        (["full/a-file"], "must be a folder to fill"),
        (["full/a-file/x"], "must be a folder, and"),
    ],
)
def test_mistakes_are_told_and_leave_nothing(metamerlab, tmp_path, monkeypatch, arguments, message):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "full").mkdir()
    (tmp_path / "full" / "a-file").write_text("mine")

    done = metamerlab("new-study", *arguments, status=2)

    assert message in " ".join(done.stderr.split())
    assert sorted(path.name for path in tmp_path.rglob("*")) == ["a-file", "full"]


def test_an_empty_folder_is_taken(metamerlab, tmp_path):
    (tmp_path / "empty").mkdir()

    metamerlab("new-study", tmp_path / "empty")
    assert (tmp_path / "empty" / "study.toml").is_file()


@pytest.mark.parametrize(
    ("refresh_hz", "fps"),
    [(60, 30), (90, 30), (120, 30), (144, 36), (240, 30), (75, 25), (59.94, 59.94)],
)  # fmt: skip
def test_clip_frames_last_whole_refreshes(refresh_hz, fps):
    assert clip_fps(refresh_hz) == fps


@pytest.mark.parametrize(
    ("folder", "name"), [("My Study 2", "my-study-2"), ("__x__", "x"), ("日本", "")]
)
def test_folders_become_names(folder, name):
    assert slug(folder) == name


def test_every_command_of_its_readme_exists(made):
    from typer.main import get_command

    from study_app.cli import app

    text = (made / "README.md").read_text(encoding="utf-8").replace("\\\n", " ")
    commands = [line.split() for line in text.splitlines() if line.startswith("       metamerlab")]
    assert len(commands) >= 12
    for words in commands:
        command = get_command(app)
        context = command.make_context("metamerlab", [], resilient_parsing=True)
        for word in words[1:3]:
            command = command.get_command(context, word)
            assert command is not None, words
            if not hasattr(command, "get_command"):
                command = command._slot.load() if hasattr(command, "_slot") else command
        options = {option for entry in command.params for option in getattr(entry, "opts", [])}
        assert {word for word in words if word.startswith("--")} <= options, words


def test_scene_files_that_are_not_there_are_noted_by_check(metamerlab, made):
    path = made / "study.toml"
    path.write_text(
        path.read_text(encoding="utf-8").replace(
            "[[stimuli.sizes]]",
            """[[stimuli.scenes]]
name = "place"
kind = "mesh"
file = "scenes/place.glb"
camera = { kind = "circle" }

[[stimuli.scenes]]
name = "pair"
kind = "stereo"
left = "motorcycle"
right = "motorcycle"
disparity = "motorcycle"
focal_px = 1000.0
baseline_m = 0.1
camera = { kind = "stereo" }

[[stimuli.sizes]]""",
            1,
        ),
        encoding="utf-8",
    )

    done = metamerlab("protocol", "check", path)
    said = " ".join(done.stdout.split())
    assert "note: stimuli.scenes[2].file: the file is not there" in said
    assert "stimuli.scenes[3]" not in said

    (made / "scenes" / "place.glb").write_bytes(b"")
    assert "note" not in metamerlab("protocol", "check", path, status=None).stdout
