"""Stimuli that follow the gaze, in trials on a virtual display: pixels, logs, planted faults."""

import csv
import dataclasses
import itertools
import re
import sys
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from command_line import metamerlab
from PIL import Image
from skimage import data
from study_texts import shipped_study
from virtual_screen import VirtualScreen

from analysis.report.report_source import from_sessions
from analysis.report.write_report import report_sessions
from pipeline.gl.texture import read_back
from pipeline.named_classes import Choice
from protocols.display import Viewing
from protocols.errors import StudyError
from protocols.feasibility import virtual_manifest
from protocols.journal_file import read_journal
from protocols.latency import LatencySummary, LiveFrames
from protocols.load import load_study, shipped
from protocols.make_script import example_scripts
from protocols.manifest import write_manifest
from protocols.phases import Image as Still
from protocols.phases import LiveImage, Phase
from protocols.plan import make_plan
from stimuli.foveate.clip_to_files import ClipSettings, foveate_clip
from stimuli.media.gaze_and_display import StatedViewing
from stimuli.recipes.build_foveated_images import FoveatedBuilder
from study_app.attempt import GazeWatcher
from study_app.cli.pictures.foveate import track_of
from study_app.cli.pictures.live_renderer import FoveatingStudio
from study_app.conduct import conduct
from study_app.gaze.open_source import ReplaySource, recorded
from study_app.gaze.saccades import SUPPRESSED_AFTER_S, SaccadeWatch
from study_app.gaze.simulated import STEADY, GazeEvent, SimulatedGaze
from study_app.gaze.source import GazeSample
from study_app.gaze.trusted import TrustedGaze
from study_app.live.in_trials import LiveShow, NullRenderer, too_dear
from study_app.live.loop import SPARE_SHARE, LiveLoop
from study_app.live.redraw import TrialDrawer
from study_app.live.renderer import STEPS_PER_PX, LiveView
from study_app.observers import ArtificialObserver, default_model
from study_app.opening import begin
from study_app.run import require_live
from study_app.session_folders import SessionFolder
from study_app.session_setup import SessionSetup
from study_app.simulate import SimulatedStudy, simulate_study
from study_app.virtual import VirtualClock, VirtualStage

WIDTH, HEIGHT, HZ = 96, 64, 60.0
SHOWN = 12
"""Refreshes that a stimulus lasts."""
DISPLAY = """
name = "little"
width_px = 320
height_px = 240
width_mm = 96.0
height_mm = 72.0
distance_mm = 100.0
refresh_hz = 60.0
clip_memory_mib = 64
"""
DRAWN_BY = {"renderer": "here", "opengl": "4"}


@pytest.fixture
def small(tmp_path):
    """Give a function: a shipped live study, with a picture and a method, and other values."""
    (tmp_path / "little.toml").write_text(DISPLAY)

    def made(name="live-detection", method='name = "blur"', **values):
        values = {
            "display": f'"{tmp_path / "little.toml"}"', "width_px": WIDTH, "height_px": HEIGHT,
            "blocks": 1, "stimulus_s": SHOWN / HZ, **values,
        }  # fmt: skip
        text = shipped_study(name, values)
        text = re.sub(
            r"^  \{ name = \"(street|castle|colonnade|tunnel|thicket|notices|reference|blur)[^\n]*",
            "", text, flags=re.M,
        )  # fmt: skip
        text = re.sub(r'^  \{ name = "ours"[^\n]*', f"  {{ {method} }},", text, flags=re.M)
        text = text.replace("draws = 6", "draws = 1").replace('"balanced"', '"random"')
        text = text.replace('baseline = "ours"', f"baseline = {method.split(' ')[2].strip(',')}")
        path = tmp_path / "study.toml"
        path.write_text(text, encoding="utf-8")
        return load_study(path, None)

    return made


def pixels_of(_name):
    picture = np.full((HEIGHT, WIDTH, 4), 255, np.uint8)
    picture[..., :3] = data.astronaut()[:HEIGHT, 180 : 180 + WIDTH]
    return picture


class Stage(VirtualStage):
    """Frames take so long that each is begun at the flip before its own; all are kept."""

    def __init__(self, *given, **more):
        super().__init__(*given, **more)
        self.frames = []

    def paint(self, picture, gaze_state):
        if picture is not None:
            self.frames.append((gaze_state, np.asarray(read_back(picture)[..., :3])))
        self._clock.move_to(self._clock() + (1 - SPARE_SHARE) / HZ)


def sit(study, display, root, studio, *, gaze_of=None, pixels=pixels_of, stage=VirtualStage):
    """Run a whole session on a virtual display; return its folder and the stage."""
    clock = VirtualClock()
    manifest = virtual_manifest(study, display)
    observer = ArtificialObserver(default_model(study), study.response, 0, "P01")
    made = stage(clock, HZ, observer)
    made.show_live(display, manifest, studio, pixels)
    made._live._cost_s = (1 - SPARE_SHARE) / HZ if stage is Stage else 0.0
    gaze = (
        gaze_of(clock)
        if gaze_of is not None
        else SimulatedGaze(clock, Viewing.of(display), (0, 0), behaviour=STEADY)
    )
    setup = SessionSetup(
        study, display, manifest, root, "P01", "en", wall_clock=clock.wall, simulated=True,
        late_most=sys.maxsize, timing_evidence="virtual",
        drawn_by=DRAWN_BY,
    )  # fmt: skip
    recorder, plan = begin(setup, made, gaze)
    recorder.waits_for_disk = False
    with recorder:
        conduct(setup, plan, recorder, made, gaze)
    made._live.release()
    return recorder.folder, made


def live_rows(folder):
    """Return the flips that followed the gaze, attempt by attempt."""
    found = []
    for attempt in read_journal(folder / "journal.jsonl").attempts:
        with (folder / attempt.flips_file.file).open() as file:
            found.append([row for row in csv.DictReader(file) if row.get("drawn_sha256")])
    return found


def again(ctx, folder, study, display, drawn_by=("here", "4"), pixels=pixels_of, manifest=None):
    """Draw a session again with passes of its own."""
    drawer = TrialDrawer(
        ctx, study, display, manifest or virtual_manifest(study, display), pixels,
        FoveatingStudio(ctx), drawn_by,
    )  # fmt: skip
    try:
        return drawer.redraw(SessionFolder(folder, read_journal(folder / "journal.jsonl")), {})
    finally:
        drawer.release()


@pytest.mark.parametrize("method", ["metamer", "warped-metamer"])
def test_a_replayed_recording_shows_in_a_trial_the_frames_that_foveate_writes(
    gl_context, small, tmp_path, method
):
    study, display = small(method=f'name = "{method}"', loss_max_share=1.0)
    rng = np.random.default_rng(4)
    t_s = np.arange(0, 30, 0.004)
    x = 160 + 30 * np.sign(np.sin(31 * t_s)) + rng.normal(0, 0.3, len(t_s))
    y = 120 + 20 * np.sin(9 * t_s) + rng.normal(0, 0.3, len(t_s))
    lost = np.zeros(len(t_s), bool)

    def tape(name, times_s, first=0):
        rows = zip(times_s, x[first:], y[first:], lost[first:], strict=True)
        lines = [f"{t:.6f},," if gone else f"{t:.6f},{a:.5f},{b:.5f}" for t, a, b, gone in rows]
        (tmp_path / name).write_text("\n".join(["t_s,x_px,y_px", *lines]) + "\n")
        return str(tmp_path / name)

    def consistent(name, studio):
        """Show a session to the tape; return rows and frames of the trial without a cut."""

        def gaze_of(clock):
            recording = recorded(tape("tape.csv", t_s)).on_screen(320, 240)
            gaze = TrustedGaze(ReplaySource(recording, clock), clock)
            gaze.open()
            return gaze

        folder, stage = sit(study, display, tmp_path / name, studio, gaze_of=gaze_of, stage=Stage)
        cuts = [a.condition["cut"] for a in read_journal(folder / "journal.jsonl").attempts]
        rows, place = live_rows(folder), cuts.index("consistent")
        start = sum(map(len, rows[:place]))
        return rows[place], stage.frames[start : start + len(rows[place])]

    rows, _ = consistent("first", None)
    asked_s = float(rows[0]["t_s"]) - 1 / HZ  # each frame is begun at the flip before its own
    lost |= (t_s > asked_s + 0.05) & (t_s < asked_s + 0.09)
    studio = FoveatingStudio(gl_context)
    rows, shown = consistent("second", studio)

    first = int(np.searchsorted(t_s, asked_s + 1e-6, side="right")) - 1
    rest = tape("rest.csv", np.maximum(t_s[first:] - asked_s, 0), first)
    frames = tmp_path / "frames"
    frames.mkdir()
    for k in range(SHOWN):
        Image.fromarray(pixels_of("")[..., :3]).save(frames / f"{k:04d}.png")
    little = str(tmp_path / "little.toml")
    written = foveate_clip(
        frames, tmp_path / "out", seed=int(rows[0]["seed"]), choice=Choice(method),
        asked=ClipSettings(track=track_of(f"replay:{rest}", little, HZ, print), fps=HZ),
        viewing=StatedViewing(display=little), ctx=gl_context,
    )  # fmt: skip
    assert {row["eye"] for row in rows} == {"found", "lost"}
    assert len({row["field_x_px"] for row in rows}) > 1
    for path, (gaze_state, pixels) in zip(written, shown, strict=True):
        eight = np.rint(255 * pixels).astype(np.uint8)
        np.testing.assert_array_equal(np.asarray(Image.open(path)), eight, f"{path} {gaze_state}")


class Faulty:
    """Draws something else from frame 4 of a stimulus on than what is logged."""

    def __init__(self, renderer, fault):
        self._renderer, self._fault = renderer, fault
        self._drawn, self._before, self._last = 0, None, None

    def __getattr__(self, name):
        return getattr(self._renderer, name)

    def draw(self, gaze_state):
        before = self._before
        self._before, self._drawn = gaze_state, self._drawn + 1
        if self._drawn > 4:
            match self._fault:
                case "wrong gaze":
                    gaze_state = gaze_state._replace(
                        gaze_px=(gaze_state.gaze_px[0] + 1 / STEPS_PER_PX, 0.0)
                    )
                case "wrong field":
                    gaze_state = gaze_state._replace(field_px=(gaze_state.field_px[0] + 4, 10.0))
                case "old gaze":
                    gaze_state = before
                case "wrong seed":
                    self._renderer.prepare(gaze_state.seed + 1)
                    gaze_state = gaze_state._replace(seed=gaze_state.seed + 1)
                case "stale texture":
                    return self._last
        self._last = self._renderer.draw(gaze_state)
        return self._last


class FaultyStudio(FoveatingStudio):
    fault = "none"

    def __call__(self, place, said, pixels):
        if self.fault == "another source":
            pixels = np.ascontiguousarray(pixels[:, ::-1])
        return Faulty(super().__call__(place, said, pixels), self.fault)


FAULTS = ("wrong gaze", "wrong field", "old gaze", "wrong seed", "stale texture", "another source")


@pytest.mark.parametrize("fault", ["none", *FAULTS])
def test_live_frames_of_a_session_are_drawn_again_and_each_planted_fault_is_found(
    gl_context, small, tmp_path, fault
):
    study, display = small(method='name = "warped", method = "warped-metamer"')
    studio = FaultyStudio(gl_context)
    studio.fault = fault
    folder, _ = sit(study, display, tmp_path / "s", studio)
    kept = [row["flip"] for rows in live_rows(folder) for row in rows if row["pixels_sha256"]]
    assert kept == [rows[-1]["flip"] for rows in live_rows(folder)]

    found = again(gl_context, folder, study, display)

    assert (found.flips, found.drawn) == (2 * SHOWN, 2)
    named = [text.partition(":")[0] for text in found.problems]
    if fault == "none":
        assert (found.equal, found.problems) == (2, ())
        elsewhere = again(gl_context, folder, study, display, drawn_by=("there", "4"))
        assert elsewhere.problems == ()
    else:
        assert named == [f"flip {flip}" for flip in kept]
        assert "must show what gaze" in found.problems[0]


def test_on_another_renderer_a_wrong_seed_another_source_and_a_stale_texture_are_found_too(
    gl_context, small, tmp_path
):
    study, display = small(method='name = "warped", method = "warped-metamer"')
    for fault in ("wrong seed", "another source"):
        studio = FaultyStudio(gl_context)
        studio.fault = fault
        folder, _ = sit(study, display, tmp_path / fault.replace(" ", "-"), studio)
        assert len(again(gl_context, folder, study, display, ("there", "4")).problems) == 2


def test_frames_of_another_study_s_parameters_seeds_or_pictures_are_named(
    gl_context, small, tmp_path
):
    study, display = small()
    folder, _ = sit(study, display, tmp_path / "s", FoveatingStudio(gl_context))
    other, _ = small(texture_seed=64)
    with pytest.raises(StudyError, match="the manifest of the stimuli must be the one"):
        again(gl_context, folder, other, display)
    renamed = virtual_manifest(study, display)
    with pytest.raises(StudyError, match="the display must be the one"):
        again(gl_context, folder, study, replace_display(display), manifest=renamed)
    file = next((folder / "flips").glob("*.csv"))
    seed = live_rows(folder)[0][0]["seed"]
    file.write_text(file.read_text().replace(f",{seed},", f",{int(seed) + 1},"))
    found = again(gl_context, folder, study, display)
    assert all("must have seed" in text for text in found.problems[:SHOWN])
    whole = file.read_text().replace(f",{int(seed) + 1},", f",{seed},")
    row = live_rows(folder)[0][-1]
    gaze = row["gaze_x_px"]
    for old, new in (
        (f",{seed},", ",many,"), (f",{gaze},", ",nan,"), (row["grid"], row["grid"][:-4]),
        (f"stimulus,0,{row['frame_sha256']},{gaze}", f"iti,0,{row['frame_sha256']},{gaze}"),
        (f",{row['eye']},{seed},{row['drawn_sha256']},", f",,,{row['drawn_sha256']},"),
    ):  # fmt: skip
        assert old in whole
        file.write_text(whole.replace(old, new))
        said = again(gl_context, folder, study, display).problems
        assert "must be a flip of this study" in said[-1] + said[0], (old, said)
    for column in ("seed", "eye", "flip", "phase", "age_s", "grid"):
        file.write_text(re.sub(rf"\b{column}\b", "other", whole, count=1))
        said = again(gl_context, folder, study, display).problems
        assert len(said) == (1 if column == "grid" else SHOWN)
        assert "must be a flip of this study" in said[0]


def replace_display(display):
    return display.model_copy(update={"distance_mm": 101.0})


def test_a_lost_eye_holds_the_last_gaze_for_a_blink_and_then_the_trial_is_void(small, tmp_path):
    study, display = small(loss_max_share=1.0)

    def gaze_of(clock):
        return Losing(clock, Viewing.of(display), (0, 0), behaviour=STEADY)

    folder, _ = sit(study, display, tmp_path / "s", None, gaze_of=gaze_of)

    attempts = read_journal(folder / "journal.jsonl").attempts
    rows = live_rows(folder)
    assert [a.void_reason for a in attempts[:2]] == [None, "data-loss"]
    short, long = rows[0], rows[1]
    held = [row for row in short if row["eye"] == "lost"]
    before = next(a for a, b in itertools.pairwise(short) if b is held[0])
    assert len(held) in (5, 6, 7)
    assert {row["gaze_x_px"] for row in held} == {before["gaze_x_px"]}
    assert attempts[0].live.lost == len(held)
    assert len(attempts[0].live.ages_ms) == SHOWN - len(held)
    assert [row["eye"] for row in long][-3:] == ["lost"] * 3
    assert len(long) < SHOWN


class Losing(SimulatedGaze):
    """Loses the eye for 0.1 s in the first trial, for longer than a blink in the second."""

    trials = 0

    def mark(self, _text):
        self.trials += 1
        lost_s = {1: 0.1, 2: 0.2}.get(self.trials, 0.0)
        self.restart(self.trials, [GazeEvent("loss", 0.52, lost_s)] if lost_s else [])


class Jumping(SimulatedGaze):
    """Makes one saccade of four degrees while a stimulus is shown, and one back much later."""

    def mark(self, _text):
        self.restart(1, [GazeEvent("away", 0.58, 9.0, (4.0, 0.0))])


WAITS = {"live": 'true\nchange = "during-saccades"'}


def test_in_a_study_that_waits_pictures_change_in_saccades_alone_and_the_journal_names_these(
    gl_context, small, tmp_path, monkeypatch
):
    study, display = small(method='name = "warped", method = "warped-metamer"', **WAITS)

    def gaze_of(clock):
        return Jumping(clock, Viewing.of(display), (0, 0), behaviour=STEADY)

    def sat(name):
        studio = FoveatingStudio(gl_context)
        folder, _ = sit(study, display, tmp_path / name, studio, gaze_of=gaze_of, stage=Stage)
        return folder, again(gl_context, folder, study, display)

    folder, found = sat("right")
    assert (found.problems, found.equal) == ((), 2)
    attempts = read_journal(folder / "journal.jsonl").attempts
    for attempt, rows in zip(attempts, live_rows(folder), strict=True):
        keys = "gaze_x_px", "field_x_px"
        moved = [b for a, b in itertools.pairwise(rows) if any(a[k] != b[k] for k in keys)]
        assert 2 <= len(moved) <= 5
        assert {row["suppressed"] for row in moved} == {"1"}
        saccade = attempt.live.saccades[-1]  # the one before is the way back
        onset_s, end_s = saccade.onset_s, saccade.offset_s + SUPPRESSED_AFTER_S
        assert all(onset_s <= float(row["t_s"]) <= end_s + 1e-6 for row in moved)
        assert float(rows[-1]["gaze_x_px"]) - float(rows[0]["gaze_x_px"]) > 20  # it has landed
        held = [row for row in rows if row["suppressed"] == "0"]
        assert len(attempt.live.ages_ms) == 1 + SHOWN - len(held)
        # The same samples give the same frames where no task is.
        with (folder / attempt.gaze_file.file).open() as file:
            taken = [(float(r["t_s"]), float(r["x_px"]), float(r["y_px"]))
                     for r in csv.DictReader(file)]  # fmt: skip
        np.testing.assert_allclose(
            looks_of(taken, rows, display),
            [[float(row[f"gaze_{axis}_px"]) for axis in "xy"] for row in rows],
            atol=1 / STEPS_PER_PX,  # samples are recorded to two decimals
        )

    shows = LiveShow.show

    def hasty(self, entry, last_flip_s, *, begins):
        one = self._stimuli[entry.stimulus]
        live = one.live.model_copy(update={"change": "always"})
        self._stimuli[entry.stimulus] = dataclasses.replace(one, live=live)
        return shows(self, entry, last_flip_s, begins=begins)

    monkeypatch.setattr(LiveShow, "show", hasty)
    _, found = sat("hasty")
    wrong = [text for text in found.problems if "must hold the gaze of the flip before" in text]
    assert len(wrong) == len(found.problems) > SHOWN // 2


def looks_of(taken, rows, display):
    """Return the gazes that a loop without a task shows to these samples."""
    begin_s = float(rows[0]["t_s"]) - 1 / HZ
    clock = VirtualClock(begin_s)
    samples = [GazeSample(t_s, t_s, x, y) for t_s, x, y in taken]
    corner = (display.width_px - WIDTH) / 2, (display.height_px - HEIGHT) / 2
    loop = LiveLoop(
        VirtualScreen(clock, HZ, (1 - SPARE_SHARE) / HZ), Played(clock, samples), corner,
        polled=False, cost_s=(1 - SPARE_SHARE) / HZ, change="during-saccades",
        watch=SaccadeWatch(np.radians(display.distance_mm / display.pitch_x_mm)),
    )  # fmt: skip
    loop.begin(begin_s, None)
    unseen = NullRenderer(0, SimpleNamespace(centre_px=(0.0, 0.0)), None)
    return [loop.step(unseen, LiveView(), 0)[0].gaze_state.gaze_px for _ in rows]


class Played:
    """Samples, each from its own time on."""

    def __init__(self, clock, samples):
        self._clock, self._samples = clock, samples

    def poll(self):
        due = [one for one in self._samples if one.t_s <= self._clock() + 1e-5]
        self._samples = self._samples[len(due) :]
        return due


def test_a_study_that_waits_for_saccades_needs_live_pictures_and_gaze_that_is_fast(small, tmp_path):
    with pytest.raises(StudyError, match="set live = true, or leave it"):
        small(live='false\nchange = "during-saccades"')
    study, display = small(**WAITS)
    assert study.stimuli_sha256 == small()[0].stimuli_sha256  # what is built is the same
    patient = study.gaze.model_copy(update={"rate_min_hz": 1.0})

    def slow(clock):
        return SimulatedGaze(clock, Viewing.of(display), (0, 0), rate_hz=10.0, behaviour=STEADY)

    with pytest.raises(StudyError, match="during-saccades needs gaze of at least 20 Hz"):
        sit(study.model_copy(update={"gaze": patient}), display, tmp_path / "s", None, gaze_of=slow)
    assert not (tmp_path / "s").exists()


def test_an_eye_that_is_lost_when_a_picture_begins_holds_where_it_was_seen_before(small, tmp_path):
    study, display = small(loss_max_share=1.0)

    class Early(SimulatedGaze):
        def mark(self, _text):
            self.look_at((3.0, 0.0))
            self.restart(1, [GazeEvent("loss", 0.507, 0.1)])

    folder, _ = sit(
        study, display, tmp_path / "s", None,
        gaze_of=lambda clock: Early(clock, Viewing.of(display), (0, 0), behaviour=STEADY),
    )  # fmt: skip

    first = live_rows(folder)[0][0]
    assert first["eye"] == "lost"
    three_deg_px = 100 * np.tan(np.radians(3)) / 0.3
    assert abs(float(first["gaze_x_px"]) - WIDTH / 2 - three_deg_px) < 4


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"mode": '"none"'}, "gaze.mode: must watch gaze where pictures follow it"),
        ({"store_gaze": "false"}, "privacy.store_gaze: must be true where pictures follow"),
        ({"cuts": "{ draws = 1 }\nrings = { eccentricities_deg = [5.0] }"}, "rings"),
        ({"cuts": '{ draws = 1 }\ngazes = [{ name = "left", x_deg = -5.0 }]'}, "gazes"),
    ],
)
def test_what_does_not_go_with_a_free_gaze_is_refused(small, values, message):
    with pytest.raises(StudyError, match=message):
        small(**values)


def test_a_browser_refuses_a_study_that_follows_the_gaze_by_its_name(small):
    study, _ = small()
    with pytest.raises(StudyError, match="'live-detection' has pictures that follow the gaze"):
        study.in_a_browser()


def test_frames_that_take_longer_than_a_refresh_are_refused_with_a_cure(small):
    _, display = small()
    assert too_dear(display, 0.014, "metamer", "a card") is None
    error = str(too_dear(display, 0.0150, "metamer", "a card"))
    assert "a frame of 'metamer' must be drawn in 14.2 ms" in error
    assert "(it took 15.0 ms on a card)" in error
    assert "smaller stimuli" in error


def test_a_condition_that_cannot_be_drawn_in_a_frame_is_refused_by_protocol_check(small):
    for method in ('name = "n", method = "noise-enhanced"',
                   'name = "metamer", parameters = { chroma = "full" }'):  # fmt: skip
        study, display = small(method=method)
        problems = FoveatedBuilder(study, display, Path()).problems()
        assert ["a live picture must be one that the GPU draws" in str(p) for p in problems] == [
            True
        ]


def test_tasks_that_show_halves_or_two_pictures_at_once_refuse_what_follows_the_gaze(small):
    study, display = small()
    two = study.model_copy(update={"task": Halves()})
    with pytest.raises(StudyError, match="follow the gaze: show them as Live"):
        example_scripts(two, display)
    two = study.model_copy(update={"task": Halves(both=True)})
    with pytest.raises(StudyError, match="one live picture at most"):
        example_scripts(two, display)


class Halves:
    """As much of a task as scripts ask for."""

    stimuli_per_trial, confidence = 2, None

    def __init__(self, *, both=False):
        self.show = (LiveImage(0, -5.0), LiveImage(1, 5.0)) if both else (Still(0, half="left"),)

    def answers(self):
        return "yes", "no"

    def phases(self, _pool, _display):
        return (Phase("shown", 12, self.show, watched=True),)

    def phases_after(self, _pool, _display):
        return ()


@pytest.mark.slow
@pytest.mark.parametrize(("name", "decisions"), [("live-preference", 126), ("live-detection", 210)])
def test_the_shipped_live_studies_simulate_whole_and_are_reported_with_their_latency(
    tmp_path, name, decisions
):
    text = shipped("studies")[name].read_text(encoding="utf-8")
    text = text.replace("stimulus_s = 0.5", "stimulus_s = 0.1").replace(
        "gap_s = 0.5", "gap_s = 0.1"
    )
    path = tmp_path / "study.toml"
    path.write_text(text, encoding="utf-8")
    study, display = load_study(path, None)
    assert len(make_plan(study, virtual_manifest(study, display), "P01", 0).trials) == decisions
    done = simulate_study(SimulatedStudy(study, display), tmp_path / "s", 2)
    assert {code: one.main_done for code, one in done.items()} == dict.fromkeys(
        ("S001", "S002"), decisions
    )
    events = [
        attempt
        for code in done
        for attempt in read_journal(tmp_path / "s" / name / code / "journal.jsonl").attempts
    ]
    assert all(len(a.live.ages_ms) + a.live.lost > 0 for a in events if a.void_reason is None)
    whole = LatencySummary.of([a.live for a in events])
    source = from_sessions(tmp_path / "s", study, None)
    assert source.provenance["sample_to_flip"] == whole.model_dump(mode="json")
    listed = metamerlab("session", "status", str(tmp_path / "s" / name / "S001"), status=None)
    assert "sample to flip" in listed.stdout
    assert "ms, 95 %" in listed.stdout
    if name == "live-preference":  # tests of the other kind of report take as long
        report_sessions(tmp_path / "s", study, tmp_path / "r", figure_files="none")
        page = (tmp_path / "r" / "report.html").read_text(encoding="utf-8")
        said = re.search(r"Frames that followed the gaze, (sample to flip: median [^<]*)", page)
        assert said
        assert said[1] == whole.words() + "."


@pytest.mark.parametrize(
    ("ages_ms", "median", "p95", "most"),
    [((5.0,), 5.0, 5.0, 5.0), (tuple(range(1, 101)), 50.0, 95.0, 100.0), ((), None, None, None)],
)
def test_latency_of_attempts_is_that_of_all_their_frames(ages_ms, median, p95, most):
    half = len(ages_ms) // 2
    parts = [
        LiveFrames(ages_ms=part, lost=1, silent=2, ahead=0)
        for part in (ages_ms[half:], ages_ms[:half])
    ]
    found = LatencySummary.of(parts)
    assert (found.median_ms, found.p95_ms, found.max_ms) == (median, p95, most)
    assert (found.frames, found.lost, found.silent) == (len(ages_ms), 2, 4)


@pytest.mark.parametrize("name", ["live-preference", "live-detection"])
def test_all_live_stimuli_share_a_seed_for_it_takes_longer_than_a_frame_to_prepare(name):
    study, _ = load_study(Path(name), None)
    assert len({live.seed for live in study.stimuli.live_methods().values()}) == 1


def test_a_session_is_refused_where_its_frames_do_not_fit_and_a_rehearsal_says_so(small):
    study, display = small()

    class Slow:
        def dearest_live_s(self):
            return 0.040, "metamer"

    manifest = virtual_manifest(study, display)
    setup = SessionSetup(study, display, manifest, Path(), "P01")
    with pytest.raises(StudyError, match="a frame of 'metamer' must be drawn in"):
        require_live(Slow(), setup, "a card")
    rehearsal = dataclasses.replace(setup, pacing="software")
    assert "took 40.0 ms: too long for a refresh" in require_live(Slow(), rehearsal, "a card")


def test_a_gaze_that_is_not_the_sample_s_whose_age_is_logged_is_named(
    gl_context, small, tmp_path, monkeypatch
):
    """As a loop that drew an old gaze and said that it was the newest."""
    study, display = small()
    folder, _ = sit(study, display, tmp_path / "right", FoveatingStudio(gl_context))
    assert again(gl_context, folder, study, display).problems == ()
    polls = GazeWatcher.poll
    before = []

    def late(self):
        new = polls(self)
        before.append(new)
        old = before[-3] if len(before) > 2 else new
        if not (new and old):
            return new
        return [*new[:-1], new[-1]._replace(x_px=old[-1].x_px, y_px=old[-1].y_px)]

    monkeypatch.setattr(GazeWatcher, "poll", late)
    folder, _ = sit(study, display, tmp_path / "wrong", FoveatingStudio(gl_context))

    found = again(gl_context, folder, study, display).problems

    assert len(found) > SHOWN
    assert "must have the gaze of the sample that is 0.0" in found[0]


@pytest.mark.usefixtures("gl_context")
def test_verify_render_says_what_it_needs(small, tmp_path, monkeypatch):
    study, display = small()
    made = tmp_path / "s"
    sit(study, display, made, None)
    path, clips = tmp_path / "study.toml", tmp_path / "clips"
    for name in study.shown():
        (clips / name).mkdir(parents=True)
        Image.fromarray(pixels_of("")[..., :3]).save(clips / name / "000000.png")
    write_manifest(clips, virtual_manifest(study, display).model_copy(update={"simulated": False}))
    (tmp_path / "none").mkdir()
    whole = ("--protocol", path, "--render", "--stimuli", clips)
    for words, message in (
        (("--stimuli", clips), "are for --render; add it"),
        (("--render", "--protocol", path), "give --protocol and --stimuli"),
        (("--render", "--stimuli", clips), "give --protocol and --stimuli"),
        (("--protocol", "demo", "--render", "--stimuli", clips), "must follow the gaze"),
        ((*whole, "--captured", tmp_path / "none"), "must hold captures of the screen"),
        ((*whole, "--captured", clips / study.shown()[0]), "must show the whole screen"),
    ):
        done = metamerlab("session", "verify", str(made), *map(str, words), status=2)
        assert message in " ".join(done.stderr.split())
    monkeypatch.setattr(TrialDrawer, "_check", lambda *_: None)  # the manifest says: simulated
    words = ["session", "verify", str(made), *map(str, whole)]
    assert "must hold frames to draw again (none was kept" in metamerlab(*words, status=None).stderr
    # Killed before its first attempt: there is nothing to draw, and nothing amiss.
    journal = next(made.rglob("journal.jsonl"))
    journal.write_bytes(b"".join(journal.read_bytes().splitlines(keepends=True)[:1]))
    done = metamerlab(*words)
    assert "0 live frames, 0 drawn again" in done.stdout
