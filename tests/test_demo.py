"""`metamerlab demo` writes what it says, and tells where it lies."""

import numpy as np
import pytest
from PIL import Image
from typer.testing import CliRunner

from study_app.cli import app


@pytest.fixture
def demo(tmp_path):
    pytest.importorskip("skimage")
    return lambda *arguments: CliRunner().invoke(
        app, ["demo", "--out", str(tmp_path / "out"), *arguments]
    )


@pytest.mark.usefixtures("shared_gl_context")
def test_the_demo_fills_every_hole_and_says_where_the_picture_is(demo, tmp_path):
    result = demo()

    assert result.exit_code == 0, result.output
    assert "before-and-after.png" in result.output.replace("\n", "")
    written = {path.name for path in (tmp_path / "out").iterdir()}
    assert written == {
        "before-and-after.png",
        "push-pull.png",
        "push-pull-depth.png",
        "metameric.png",
    }
    pixels = {name: np.asarray(Image.open(tmp_path / "out" / name)) for name in written}
    assert pixels["metameric.png"].shape == (500, 741, 3)
    changed = (pixels["metameric.png"] != pixels["push-pull.png"]).any(axis=-1).mean()
    assert 0.05 < changed < 0.15  # the holes, and nothing else


def test_the_demo_says_where_it_cannot_write(demo, tmp_path):
    (tmp_path / "out").write_text("a file")

    result = demo()

    assert result.exit_code == 2
    assert "out" in result.output
    assert "Traceback" not in result.output
