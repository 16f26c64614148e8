"""Trials with pictures that follow the gaze, in a real window on a virtual screen."""

from __future__ import annotations

import re

import pytest

from protocols.load import shipped

pytestmark = pytest.mark.slow


@pytest.fixture
def live(start_study, screen):
    """Give a function: a shipped live study, small, with few conditions, its stimuli built."""

    def made(name):
        study = start_study(name)
        text = shipped("studies")[name].read_text(encoding="utf-8")
        text = re.sub(
            r"\n\[\[text\.languages\.\w+\.questions\]\].*?(?=\n\[)", "\n", text, flags=re.S
        )
        dropped = r"^  \{ name = \"(castle|colonnade|tunnel|thicket|notices|blur)[^\n]*\n"
        text = re.sub(dropped, "", text, flags=re.M)
        text = text.replace("draws = 6", "draws = 1").replace("repeats = 6", "repeats = 2")
        text = text.replace('against = "blur"', 'against = "reference"').replace(
            "gap_s = 0.5", "gap_s = 0.1"
        )
        for key, value in {
            "display": '"little.toml"', "width_px": "160", "height_px": "96", "blocks": "1",
            "fixation_s": "0.1", "iti_s": "0.05", "stimulus_s": "0.2", "dropped_frames_max": "9999",
        }.items():  # fmt: skip
            text, count = re.subn(rf"^{key} = [^#\n]*", f"{key} = {value}", text, flags=re.M)
            assert count, key
        study.path.write_text(text, encoding="utf-8")
        built = screen.run("stimuli", "build", study.path, "--out", study.stimuli)
        assert built.returncode == 0, built.stdout + built.stderr
        return study

    return made


def test_smoke(live, screen):
    study = live("live-detection")
    done = screen.run(*screen.session("run", study, "--simulate"))
    print(done.stdout, done.stderr)
    rows = [row for row in study.flips() if row["drawn_sha256"]]
    print(rows[:3], [r for r in rows if r["grid"]][0])
    assert done.returncode == 0
    assert 0
