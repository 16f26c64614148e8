"""A fill method of another package in clips of the shipped recipe, which other processes build."""

import re

import numpy as np
import pytest
from PIL import Image

pytestmark = pytest.mark.slow

LAB_FILL = 'name = "telea"\nmethod = "lab-mean"\nparameters = { factor = 0.5 }'


@pytest.fixture
def lab_study(small_study):
    """The small study with its mesh alone, filled by the lab's method; and with its name wrong."""
    text = re.sub(
        r'\[\[stimuli.scenes\]\]\nname = "motorcycle".*?(?=\[\[stimuli.sizes)', "",
        small_study.read_text(), flags=re.S,
    )  # fmt: skip
    right = text.replace('name = "telea"', LAB_FILL, 1)
    for name, said in (
        ("lab", right),
        ("misspelt", right.replace("lab-mean", "lab-maen")),
        ("settling", right.replace("lab-mean", "lab-settling")),
    ):
        (small_study.parent / f"{name}.toml").write_text(said, encoding="utf-8")
    return small_study.parent / "lab.toml", small_study.parent / "misspelt.toml"


def test_a_labs_fill_method_fills_the_clips_of_a_study(
    lab_study, lab_site, with_packages, tmp_path
):
    study, misspelt = lab_study
    done = with_packages(
        lab_site, ("stimuli", "build", study, "--out", "clips"), ("protocol", "check", misspelt)
    )

    assert done.returncode == 2, done.stderr
    assert "did you mean 'lab-mean'?" in done.stderr
    checked = 0
    for path in sorted((tmp_path / "clips" / "box__small__telea").iterdir()):
        with Image.open(path) as image:
            frame = np.asarray(image.convert("RGB")) / 255
        with Image.open(tmp_path / "clips" / "holes" / "box__small" / path.name) as image:
            hole = np.asarray(image) > 0
        if hole.any():
            # The mean of the rest of the frame with its margin, which is wider than what is shown.
            (colour,) = np.unique(frame[hole], axis=0)
            assert colour == pytest.approx(0.5 * frame[~hole].mean(axis=0), abs=0.02)
            checked += 1
    assert checked >= 2


def test_a_labs_plate_of_the_old_kind_ends_the_build_with_one_message(
    lab_study, lab_site, with_packages, tmp_path
):
    study = lab_study[0].parent / "settling.toml"
    done = with_packages(lab_site, ("stimuli", "build", study, "--out", "clips"))

    assert done.returncode == 2, done.stdout + done.stderr
    assert "got SettlingPlate, which has settle); mend the method that makes it" in done.stderr
    assert "Traceback" not in done.stderr
    assert not (tmp_path / "clips" / "manifest.json").exists()
