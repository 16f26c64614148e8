"""A lab's own package adds a task, a recipe with its builder, an observer, a fill method, a metric
and a tracker, without a change of ours; a study runs with them from check to report."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

MAIN = "from study_app.cli import main; main()"
# One module for each layer, as in our own packages: a study must load where nothing is built.
PACKAGE = {
    "study_part": '''
from typing import Literal

from protocols.phases import Fixation, Image, Phase
from protocols.recipes.base import Recipe, Stimulus
from protocols.tasks.base import shown_phase
from protocols.tasks.pairs import PairTask
from protocols.units import Degrees, Pixels


class Patches(Recipe):
    """Even patches of grey, one for each name."""

    kind: Literal["lab-patches"]
    greys: dict[str, int]
    edge_px: Pixels

    def pool(self):
        return tuple(
            Stimulus(f"{scene}-{name}", {"scene": scene, "method": name})
            for scene in ("a", "b")
            for name in self.greys
        )

    def described(self, display, scenes):
        return (f"Even patches of {self.edge_px} px.",)

    def size_px(self, display):
        return self.edge_px, self.edge_px

    @property
    def frame_hz(self):
        return 1.0

    @property
    def frames(self):
        return 1


class Above(PairTask):
    """Fixation, one stimulus above the other, answer."""

    kind: Literal["lab-above"]
    separation_deg: Degrees

    sided = True

    def answers(self):
        return "upper", "lower"

    def phases(self, study, display):
        (phase,) = [shown_phase(study, display, self, "both", [(0, 0.0), (1, 0.0)])]
        half = self.separation_deg / 2
        show = (Image(0, 0.0, -half), Image(1, 0.0, half), Fixation())
        return (Phase(phase.name, phase.frames, show, watched=True),)

    def shown_s(self, study):
        return self.single_s(study)

    def description(self, study):
        return f"one above the other for {self.single_s(study):g} s, answer"
''',
    "builder": """
import numpy as np

from protocols.manifest import Clip, cache_key
from stimuli.png import encode_bytes
from stimuli.recipes.taken import TakingBuilder
from stimuli.worker import RendererInfo


class PatchBuilder(TakingBuilder):
    renderer = RendererInfo("", "lab patches", "")

    @property
    def recipe(self):
        return self.protocol.stimuli

    @property
    def wanted(self):
        return self.recipe.pool()

    def _grey(self, stimulus):
        return self.recipe.greys[stimulus.condition["method"]]

    def key(self, stimulus):
        return cache_key({"grey": self._grey(stimulus), "edge_px": self.recipe.edge_px})

    def encoded(self, stimulus):
        edge = self.recipe.edge_px
        yield encode_bytes(np.full((edge, edge, 3), self._grey(stimulus), np.uint8))

    def record(self, stimulus, key, hashes):
        return Clip(
            name=stimulus.name, condition=dict(stimulus.condition), width_px=self.recipe.edge_px,
            height_px=self.recipe.edge_px, fps=1.0, bit_depth=8, seed=0, parameters={},
            cache_key=key, frames_sha256=hashes,
        )
""",
    "fill": '''
import numpy as np

from pipeline.methods.method import composite


class MeanFill:
    """Fills with the mean of what is known, times a factor."""

    def __init__(self, *, factor: float = 1.0) -> None:
        self.factor = factor

    def fill(self, warped, seed):
        mean = warped.colour[~warped.hole].mean(axis=0) * np.float32(self.factor)
        return composite(warped, np.broadcast_to(mean, warped.colour.shape))

    def release(self):
        pass
''',
    "metric": """
import numpy as np

from stimuli.score.measured import Measured
from stimuli.score.metrics import Family, Metric, PluginMetrics


def measure(pair, viewing, gaze):
    errors = [float(np.abs(test - truth).mean()) for _, test, truth, _ in pair.walk()]
    return Measured({("lab-error", region): float(np.mean(errors)) for region in pair.regions})


METRICS = PluginMetrics(
    Family("lab", "lab_package.metric"),
    (
        Metric(
            "lab-error", "lab error", "", "lower", 0.0, "lab", 1, 3,
            "mean absolute difference", "the lab",
        ),
    ),
)
""",
    "tracker": '''
from study_app.gaze.source import GazeSample, SourceInfo


class Steady:
    """An eye that always looks at one place: x,y in pixels."""

    def __init__(self, rest, desk):
        self.place = tuple(float(part) for part in rest.split(","))
        self.clock = desk.clock

    def open(self):
        pass

    def info(self):
        return SourceInfo("steady", "a lab's tracker", 500.0)

    def poll(self):
        now = self.clock()
        return [GazeSample(now, now, *self.place)]

    def mark(self, text):
        pass

    def calibrate(self, points_px):
        return None

    def close(self):
        pass
''',
}
ENTRY_POINTS = """
[metamerlab.tasks]
lab-above = lab_package.study_part:Above

[metamerlab.recipes]
lab-patches = lab_package.study_part:Patches

[metamerlab.builders]
lab-patches = lab_package.builder:PatchBuilder

[metamerlab.observers]
lab-above = study_app.observers.two_interval:PreferenceModel.of

[metamerlab.methods]
lab-mean = lab_package.fill:MeanFill

[metamerlab.metrics]
lab = lab_package.metric:METRICS

[metamerlab.trackers]
steady = lab_package.tracker:Steady
"""
STUDY = """
format = 2
[study]
name = "lab"
title = "A lab's study"
participants = 3
[display]
display = "fhd27-60hz"
[stimuli]
kind = "lab-patches"
greys = { dark = 40, light = 200 }
edge_px = 64
[task]
kind = "lab-above"
separation_deg = 6.0
stimulus_s = 0.5
[design]
repeats = 4
side = "fixed"
seed = 5
[trial]
[gaze]
mode = "none"
[response]
keys = [["up"], ["down"]]
[text]
default_language = "en"
[text.languages.en]
consent = "Do you agree?"
instructions = ["Look."]
practice = "Practice."
start = "Start."
question = "Which do you prefer?"
answers = { upper = "upper", lower = "lower" }
break_page = "Break."
paused = "Paused."
gaze_lost = "Look at the dot."
too_late = "Too late."
preparing = "Preparing."
quit_question = "Stop?"
thanks = "Thank you."
[analysis]
kind = "preference"
primary = { method = "light", against = "dark" }
[privacy]
"""


def install(site: Path, name: str, modules: dict[str, str], entry_points: str) -> None:
    """Put a package where Python finds it: its modules, and the record of its installation."""
    info = site / f"{name}-1.dist-info"
    info.mkdir(parents=True)
    (site / name).mkdir()
    for module, text in ({"__init__": ""} | modules).items():
        (site / name / f"{module}.py").write_text(text, encoding="utf-8")
    (info / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {name}\nVersion: 1\n")
    (info / "entry_points.txt").write_text(entry_points, encoding="utf-8")


@pytest.fixture
def run(tmp_path, repository):
    """Return a function that runs Python text with the packages of `tmp_path/site` installed."""

    def python(text: str, *words: object) -> subprocess.CompletedProcess[str]:
        paths = os.pathsep.join([str(tmp_path / "site"), str(repository)])
        return subprocess.run(
            [sys.executable, "-c", text, *map(str, words)],
            env=os.environ | {"PYTHONPATH": paths, "COLUMNS": "200"},
            cwd=tmp_path,
            capture_output=True,
            text=True,
            check=False,
        )

    return python


@pytest.fixture
def lab(tmp_path):
    """Install the lab's package."""
    install(tmp_path / "site", "lab_package", PACKAGE, ENTRY_POINTS)
    (tmp_path / "study.toml").write_text(STUDY, encoding="utf-8")
    return tmp_path


def test_a_study_of_a_labs_task_and_recipe_runs_from_check_to_report(lab, run):
    for words in (
        ("protocol", "check", "study.toml"),
        ("protocol", "preregister", "study.toml", "--out", "prereg.md"),
        ("stimuli", "build", "study.toml", "--out", "clips"),
        ("stimuli", "check", "clips"),
        ("session", "simulate", "study.toml", "--stimuli", "clips", "--out", "sessions",
         "--participants", 3, "--utility", "light=2"),
        ("analysis", "report", "sessions", "--protocol", "study.toml", "--out", "report",
         "--no-figures"),
    ):  # fmt: skip
        done = run(MAIN, *words)
        assert done.returncode == 0, (words, done.stdout, done.stderr)

    frame = np.asarray(Image.open(lab / "clips" / "a-light" / "000000.png"))
    assert frame.shape == (64, 64, 3)
    assert (frame == 200).all()
    manifest = json.loads((lab / "clips" / "manifest.json").read_text())
    assert manifest["renderer"]["renderer"] == "lab patches"
    journal = (lab / "sessions" / "lab" / "S001" / "journal.jsonl").read_text().splitlines()
    attempt = next(json.loads(line) for line in journal if '"kind":"attempt"' in line)
    assert attempt["answers"] == ["upper", "lower"]
    assert attempt["phases"][1] == attempt["phases"][1] | {"phase": "both", "stimuli": [0, 1]}
    results = json.loads((lab / "report" / "results.json").read_text())
    assert results["results"]["primary"]["share"] > 0.5
    assert "one above the other for 0.5 s" in (lab / "prereg.md").read_text()

    changed = STUDY.replace("light = 200", "light = 210")
    (lab / "study.toml").write_text(changed, encoding="utf-8")
    again = run(MAIN, "stimuli", "build", "study.toml", "--out", "clips")
    assert "2 stills built, 2 kept" in again.stdout


def test_a_labs_fill_method_is_listed_and_fills(lab, run):  # noqa: ARG001
    listed = run(MAIN, "warp", "--list")
    assert listed.returncode == 0, listed.stderr
    assert "lab-mean" in listed.stdout
    done = run(
        """
import numpy as np
from pipeline.frame import WarpedFrame
from pipeline.methods.registry import create_method
import inspect
names = inspect.signature(WarpedFrame).parameters
hole = np.zeros((4, 4), bool); hole[1, 1] = True
colour = np.full((4, 4, 3), 0.5, np.float32); colour[hole] = 0
values = {"colour": colour, "hole": hole, "depth_m": np.where(hole, np.inf, 1.0).astype(np.float32)}
known = {name: values[name] for name in names if name in values}
try:
    frame = WarpedFrame(**known)
except TypeError:
    from types import SimpleNamespace
    frame = SimpleNamespace(**values)
print(create_method("lab-mean", None, {"factor": 0.5}).fill(frame, 0)[1, 1])
"""
    )
    assert done.returncode == 0, done.stderr
    assert done.stdout.split() == ["[0.25", "0.25", "0.25]"]


def test_a_labs_method_belongs_to_a_study_of_warped_clips(lab, run, repository):
    text = (repository / "protocols" / "studies" / "demo.toml").read_text(encoding="utf-8")
    text = text.replace(
        'name = "push-pull"\nlabel = "Push-pull"', 'name = "push-pull"\nmethod = "lab-mean"'
    )
    (lab / "warped.toml").write_text(text, encoding="utf-8")
    done = run(MAIN, "protocol", "check", "warped.toml")
    assert done.returncode == 0, done.stderr

    (lab / "warped.toml").write_text(text.replace("lab-mean", "lab-maen"), encoding="utf-8")
    done = run(MAIN, "protocol", "check", "warped.toml")
    assert done.returncode == 2
    assert "did you mean 'lab-mean'?" in done.stderr


def test_a_labs_metric_is_listed_and_measures(lab, run):
    for name, grey in (("test", 100), ("truth", 151)):
        Image.fromarray(np.full((32, 32, 3), grey, np.uint8)).save(lab / f"{name}.png")

    listed = run(MAIN, "stimuli", "score", "--list")
    assert "lab-error" in listed.stdout
    done = run(MAIN, "stimuli", "score", "test.png", "truth.png", "--metrics", "lab-error")
    assert done.returncode == 0, done.stderr
    assert "0.200" in done.stdout


def test_a_labs_tracker_is_opened_by_its_name(lab, run):  # noqa: ARG001
    done = run(
        """
from protocols.load import load_display
from study_app.gaze.open_source import Desk, open_gaze
desk = Desk(load_display("fhd27-60hz"), lambda: 1.5, lambda: (0.0, 0.0), 60.0)
source = open_gaze("steady:3,4", desk)
print(source.info().source, *source.poll()[0])
"""
    )
    assert done.stdout.split() == ["steady", "1.5", "1.5", "3.0", "4.0"], done.stderr


@pytest.mark.parametrize(
    ("entry_points", "words", "message"),
    [
        ("[metamerlab.tasks]\nyes-no = broken:Task", ("protocol", "check", "demo"),
         "a plug-in must have a name of its own in metamerlab.tasks (got 'yes-no'"),
        ("[metamerlab.tasks]\nmine = broken:Missing", ("protocol", "check", "demo"),
         "its plug-in 'mine' of metamerlab.tasks must load"),
        ("[metamerlab.methods]\ntelea = broken:Task", ("warp", "--list"),
         "a plug-in must have a name of its own in metamerlab.methods (got 'telea'"),
        ("[metamerlab.builders]\nfiles = broken:Task", ("protocol", "check", "demo"),
         "a plug-in must have a name of its own in metamerlab.builders (got 'files'"),
        ("[metamerlab.trackers]\nlsl = broken:Task", ("session", "list", "."),
         "a plug-in must have a name of its own in metamerlab.trackers (got 'lsl'"),
    ],
)  # fmt: skip
def test_a_broken_plug_in_is_named_with_its_package_and_a_cure(
    tmp_path, run, entry_points, words, message
):
    install(tmp_path / "site", "broken", {"__init__": "class Task: pass\n"}, entry_points + "\n")
    done = run(MAIN, *words)

    assert done.returncode == 2, (done.stdout, done.stderr)
    assert "Traceback" not in done.stderr
    assert "package 'broken'" in done.stderr
    assert message in " ".join(done.stderr.split())
    assert "uninstall the package" in done.stderr
