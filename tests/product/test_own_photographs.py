"""What docs/foveation.md says of photographs of one's own, to the letter, but small."""

from __future__ import annotations

import re
import shlex
from pathlib import Path

import pytest
from PIL import Image
from skimage import data

from protocols.load import load_protocol

pytestmark = pytest.mark.slow

PAGE = Path(__file__).resolve().parents[2] / "docs" / "foveation.md"


def section() -> str:
    text = PAGE.read_text(encoding="utf-8")
    return re.split(r"^#+ ", text.split("### A study of your own photographs\n")[1], flags=re.M)[0]


def put_in(path: Path, toml: str) -> None:
    """Do what the page asks for: its pictures and methods, and another size."""
    text = path.read_text(encoding="utf-8")
    methods = toml[toml.index("methods = [") :]
    for key, new in (("pictures", toml.removesuffix(methods)), ("methods", methods)):
        text, count = re.subn(
            rf"^{key} = \[.*?^\]\n", lambda _, new=new: new, text, flags=re.M | re.S
        )
        assert count == 1
    text = text.replace("width_px = 1920", "width_px = 320").replace(
        "height_px = 1080", "height_px = 180"
    )
    path.write_text(text, encoding="utf-8")


@pytest.mark.usefixtures("shared_gl_context")
def test_photographs_become_a_study_and_its_report(tmp_path, monkeypatch):
    from typer.testing import CliRunner

    from study_app.cli import app

    monkeypatch.chdir(tmp_path)
    Image.fromarray(data.astronaut()).save("harbour.jpg")
    Image.fromarray(data.coffee()).save("square.jpg")
    commands = [
        shlex.split(line.removeprefix("$ metamerlab "))
        for line in re.findall(r"^\$ .*$", section(), flags=re.M)
    ]
    assert len(commands) == 5
    for words in commands:
        ran = CliRunner().invoke(app, words)
        assert ran.exit_code == 0, ran.output
        if words[1] == "copy":
            (toml,) = re.findall(r"^```toml\n(.*?)^```", section(), flags=re.M | re.S)
            put_in(Path("my-study.toml"), toml)

    assert load_protocol(Path("my-study.toml")).study.name == "my-study"
    report = Path("report/report.html").read_text(encoding="utf-8")
    assert "ours" in report
    assert len(list(Path("clips").rglob("*.png"))) >= 6


def test_a_copy_is_never_written_over_an_old_file(tmp_path):
    from typer.testing import CliRunner

    from study_app.cli import app

    old = tmp_path / "mine.toml"
    old.write_text("kept")
    for words, said in (
        (("demo", old), "is never written over"),
        (("nothing", tmp_path / "new.toml"), "must be one of beyond-blur-detection"),
        (("demo", tmp_path / "new.txt"), "must end in .toml"),
        (("demo", tmp_path / "\u00fc.toml"), "choose another name for the file"),
    ):
        ran = CliRunner().invoke(app, ["protocol", "copy", *map(str, words)])
        assert ran.exit_code == 2
        assert said in " ".join(ran.output.split())
    assert old.read_text() == "kept"
    assert [path.name for path in tmp_path.iterdir()] == ["mine.toml"]
