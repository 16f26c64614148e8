"""Photographs of one's own, as docs/foveation.md says it, to the letter, but small."""

import re
import shlex
from pathlib import Path

import pytest
from command_line import metamerlab
from PIL import Image
from skimage import data

from protocols.load import load_protocol, shipped

pytestmark = pytest.mark.slow

PAGE = Path(__file__).resolve().parents[2] / "docs" / "foveation.md"


def section() -> str:
    text = PAGE.read_text(encoding="utf-8")
    return re.split(r"^#+ ", text.split("## Your own photographs\n")[1], flags=re.M)[0]


@pytest.mark.usefixtures("shared_gl_context")
def test_photographs_become_a_study_and_its_report(tmp_path, monkeypatch):

    monkeypatch.chdir(tmp_path)
    shown = {"harbour": data.astronaut(), "square": data.coffee(), "photo": data.coffee()}
    for name, picture in shown.items():
        Image.fromarray(picture).resize((320, 240)).save(f"{name}.jpg")
    commands = [
        shlex.split(line.removeprefix("$ metamerlab "), comments=True)
        for line in re.findall(r"^\$ .*$", section(), flags=re.M)
    ]
    assert [words[0] for words in commands[:3]] == ["foveate"] * 3
    assert len(commands) == 8
    for words in commands:
        metamerlab(*words)

    assert load_protocol(Path("my-study/study.toml")).study.name == "my-study"
    report = Path("report/report.html").read_text(encoding="utf-8")
    assert "Metamer" in report
    assert len(list(Path("my-study/clips").rglob("*.png"))) >= 6


@pytest.mark.parametrize("name", shipped("studies"))
def test_a_copy_is_a_study_of_its_own_and_not_the_paper_s(tmp_path, name):
    file = tmp_path / "mine.toml"
    said = metamerlab("protocol", "copy", name, str(file)).output
    study = load_protocol(file).study
    assert (study.name, study.title, study.source) == ("mine", f"Copy of {name}", "")
    assert "Change it, its title and description first, then:" in said

    metamerlab("protocol", "copy", name, str(tmp_path / "b.toml"), "--title", r"Ours \1", status=2)
    metamerlab("protocol", "copy", name, str(tmp_path / "b.toml"), "--title", "Ours, 2nd")
    assert load_protocol(tmp_path / "b.toml").study.title == "Ours, 2nd"


def test_a_copy_is_never_written_over_an_old_file(tmp_path):

    old = tmp_path / "mine.toml"
    old.write_text("kept")
    for words, said in (
        (("demo", old), "is never written over"),
        (("nothing", tmp_path / "new.toml"), "must be one of beyond-blur-detection"),
        (("demo", tmp_path / "new.txt"), "must end in .toml"),
        (("demo", tmp_path / "\u00fc.toml"), "choose another name for the file"),
    ):
        ran = metamerlab("protocol", "copy", *map(str, words), status=2)
        assert said in " ".join(ran.output.split())
    assert old.read_text() == "kept"
    assert [path.name for path in tmp_path.iterdir()] == ["mine.toml"]
