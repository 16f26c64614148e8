"""Live pictures on a virtual clock: the pixels of `foveate`, and logs that are drawn again."""

import errno
import json
import math
import os
from itertools import pairwise
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from command_line import metamerlab
from PIL import Image
from skimage import data
from virtual_screen import VirtualScreen

from pipeline.errors import InputError
from pipeline.foveation.geometry import Flat
from pipeline.gl.texture import create_texture, read_back
from pipeline.named_classes import Choice
from pipeline.pictures.colour_file import PictureReading
from protocols.disk.hashing import sha256_json
from protocols.errors import StudyError
from protocols.load import load_display
from stimuli.foveate.clip_to_files import ClipSettings, foveate_clip
from study_app.cli.pictures.foveate import track_of
from study_app.cli.pictures.live_renderer import FoveatingRenderer, read_source
from study_app.gaze.open_source import ReplaySource, recorded
from study_app.gaze.saccades import SUPPRESSED_AFTER_S, SaccadeWatch
from study_app.gaze.source import GazeSample
from study_app.gaze.trusted import TrustedGaze
from study_app.live.log import LiveChoice, LiveFlip, LiveLog, LiveSaccade, read_log
from study_app.live.loop import SPARE_SHARE, DrawnFlip, LiveLoop
from study_app.live.redraw import redraw
from study_app.live.renderer import STEPS_PER_PX, GazeState, LiveView, on_grid
from study_app.virtual import VirtualClock

HZ = 60.0
WIDTH, HEIGHT, FRAMES = 96, 72, 9
GEOMETRY = Flat(width_deg=40).of(WIDTH, HEIGHT)
PERIOD_COST_S = (1 - SPARE_SHARE) / HZ
"""A frame that takes so long is begun at the flip before its own."""


@pytest.fixture
def frames(tmp_path):
    """A folder of frames that move."""
    folder = tmp_path / "frames"
    folder.mkdir()
    for k in range(FRAMES):
        part = data.astronaut()[2 * k : 2 * k + HEIGHT, 3 * k : 3 * k + WIDTH]
        Image.fromarray(part).save(folder / f"{k:04d}.png")
    return folder


@pytest.fixture
def tape(tmp_path):
    """Gaze at 250 Hz that drifts, jumps, and is lost once; finer than the grid of gazes."""
    rng = np.random.default_rng(4)
    t_s = np.arange(0, FRAMES / HZ, 0.004)
    x = np.where(t_s < 0.07, 30.0, 70.0) + 40 * t_s + rng.normal(0, 0.2, len(t_s))
    y = 36 + rng.normal(0, 0.2, len(t_s))
    lost = (t_s > 0.09) & (t_s < 0.12)
    path = tmp_path / "tape.csv"
    rows = [
        f"{t:.3f},," if gone else f"{t:.3f},{a:.5f},{b:.5f}"
        for t, a, b, gone in zip(t_s, x, y, lost, strict=True)
    ]
    path.write_text("t_s,x_px,y_px\n" + "\n".join(rows) + "\n")
    return path


def run(renderer, tape, *, seed=5, count=FRAMES, cost_s=PERIOD_COST_S, log=None, view=LiveView):
    """Show frames to a recording on a virtual clock; yield flips and pixels of 8 bits."""
    clock = VirtualClock()
    gaze = TrustedGaze(ReplaySource(recorded(str(tape)).on_screen(WIDTH, HEIGHT), clock), clock)
    gaze.open()
    loop = LiveLoop(VirtualScreen(clock, HZ, cost_s), gaze, (0, 0), polled=False)
    if log is not None:
        log.choice(renderer.describe())
    for k in range(count):
        flip, picture = loop.step(renderer, view(k), seed)
        if log is not None:
            log.flip(flip, picture)
        shown = np.asarray(read_back(picture)[..., :3])
        yield flip, shown if shown.dtype == np.uint8 else np.rint(255 * shown).astype(np.uint8)


@pytest.mark.parametrize("method", ["reference", "blur", "metamer", "warped-metamer"])
def test_a_replayed_recording_shows_the_frames_that_foveate_writes(
    gl_context, frames, tape, tmp_path, method
):
    written = foveate_clip(
        frames, tmp_path / "out", choice=Choice(method), seed=5, ctx=gl_context,
        asked=ClipSettings(track=track_of(f"replay:{tape}", None, HZ, print), fps=HZ),
    )  # fmt: skip
    source = read_source(frames, PictureReading(), panorama=False)
    renderer = FoveatingRenderer(gl_context, source, GEOMETRY, Choice(method))
    renderer.prepare(5)

    shown = list(run(renderer, tape))

    renderer.release()
    assert [flip.refreshes for flip, _ in shown] == [0] + [1] * (FRAMES - 1)
    assert {flip.eye for flip, _ in shown} == {"found", "lost"}
    for path, (flip, pixels) in zip(written, shown, strict=True):
        np.testing.assert_array_equal(np.asarray(Image.open(path)), pixels, f"{path} {flip}")


class Faulty:
    """A renderer that draws something else from flip 4 on than what is logged."""

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
                    gaze_state = gaze_state._replace(seed=gaze_state.seed + 1)
                case "stale texture":
                    return self._last
        self._last = self._renderer.draw(gaze_state)
        return self._last


@pytest.fixture
def shown_to(frames, tmp_path, gl_context, tape, monkeypatch):
    """Give a function that shows frames with a fault, and returns the log and a new renderer."""
    monkeypatch.setattr("study_app.live.log.EVERY", 5)
    made = []

    def show(fault, method="warped-metamer", of=None):
        source = read_source(of or frames, PictureReading(), panorama=False)
        renderer = FoveatingRenderer(gl_context, source, GEOMETRY, Choice(method))
        made.append(renderer)
        path = tmp_path / f"{len(made)}.jsonl"
        log = LiveLog(path, **START)
        renderer.prepare(5)
        list(run(Faulty(renderer, fault), tape, log=log))
        log.end(flips=FRAMES, missed=0, left_out=0, latency=LATENCY)
        log.close()
        return path, renderer

    yield show
    for renderer in made:
        renderer.release()


START = {
    "at": "2026-01-01T00:00:00.000000Z", "source": "frames", "reading": vars(PictureReading()),
    "gaze": "replay", "display": load_display("fhd27-60hz").model_dump(mode="json"),
    "renderer": "r", "driver": "1", "revision": "0", "refresh_hz": HZ,
}  # fmt: skip
LATENCY = {"frames": 0, "median_ms": None, "p95_ms": None, "max_ms": None, "lost": 0, "silent": 0,
           "ahead": 0}  # fmt: skip


def test_a_log_draws_its_frames_again_bit_for_bit_with_other_passes(shown_to):
    path, _ = shown_to("none")
    log = read_log(path)
    flips = [line for line in log.lines if isinstance(line, LiveFlip)]
    assert [flip.n for flip in flips if flip.pixels] == [0, 5]
    assert all(flip.gaze_state.gaze_px == on_grid(flip.gaze_state.gaze_px) for flip in flips)
    assert log.notes == ()

    _, again = shown_to("none")
    found = redraw(log, lambda _: again, exactly=True)

    assert (found.flips, found.drawn, found.equal, found.problems) == (FRAMES, 2, 2, ())


@pytest.mark.parametrize(
    ("fault", "exactly"),
    [
        ("wrong gaze", True),
        ("wrong field", True),
        ("old gaze", True),
        ("wrong seed", True),
        ("wrong seed", False),
        ("stale texture", True),
        ("stale texture", False),
    ],
)
def test_a_frame_that_was_not_drawn_as_it_is_logged_is_found(shown_to, fault, exactly):
    path, _ = shown_to(fault)
    _, again = shown_to("none")

    found = redraw(read_log(path), lambda _: again, exactly=exactly)

    assert [text.partition(":")[0] for text in found.problems] == ["flip 5"]


@pytest.mark.parametrize("exactly", [True, False])
def test_another_source_is_found_by_its_hash_and_by_its_pixels(frames, shown_to, exactly):
    path, _ = shown_to("none", method="blur")
    for frame in frames.iterdir():
        picture = np.asarray(Image.open(frame))
        Image.fromarray(np.ascontiguousarray(picture[:, ::-1])).save(frame)
    _, other = shown_to("none", method="blur")

    by_hash, *by_pixels = redraw(read_log(path), lambda _: other, exactly=exactly).problems

    assert by_hash.startswith("flips from 0 on: source_sha256 must be as in the log")
    assert len(by_pixels) == 2


def test_a_choice_whose_parameters_were_changed_is_found(shown_to):
    path, renderer = shown_to("none", method="blur")
    log = read_log(path)
    choice = next(line for line in log.lines if isinstance(line, LiveChoice))
    assert choice.sha256 == sha256_json(renderer.describe())
    renderer.choose(Choice("blur", {"law": "authors"}))

    found = redraw(log, lambda _: renderer, exactly=True)

    assert "method" not in found.problems[0]
    assert "parameters must be as in the log (got {'law': 'authors'})" in found.problems[0]
    assert len(found.problems) == 3


@pytest.mark.parametrize("change", ["gaze", "removed", "swapped"])
def test_a_line_that_was_changed_afterwards_is_found_and_named(shown_to, change):
    path, _ = shown_to("none", method="blur")
    lines = path.read_bytes().splitlines(keepends=True)
    match change:
        case "gaze":
            line = json.loads(lines[5])
            line["gaze_px"][0] += 1
            lines[5] = json.dumps(line).encode() + b"\n"
        case "removed":
            del lines[5]
        case "swapped":
            lines[5:7] = lines[6:4:-1]
    path.write_bytes(b"".join(lines))

    with pytest.raises(StudyError, match="line 6: must be as it was written"):
        read_log(path)


def test_the_log_of_a_killed_program_is_whole_up_to_its_last_line(shown_to):
    path, renderer = shown_to("none", method="blur")
    whole = path.read_bytes()
    *_, last_flip, _ = whole.splitlines(keepends=True)
    ends = whole.index(last_flip)
    path.write_bytes(whole[: ends + 40])

    log = read_log(path)

    assert sum(isinstance(line, LiveFlip) for line in log.lines) == FRAMES - 1
    assert "the last line is unfinished" in log.notes[0]
    assert "was not closed" in log.notes[1]
    assert redraw(log, lambda _: renderer, exactly=True).problems == ()


def test_a_file_that_is_no_log_is_refused_with_its_line(tmp_path):
    path = tmp_path / "x.jsonl"
    for text, message in (
        ("", "was killed before its first line was whole"),
        ("{}\n", "line 1: must be a line of a live log"),
        ("\x00\n", "line 1: must be a line of a live log"),
    ):
        path.write_text(text)
        with pytest.raises(StudyError, match=message):
            read_log(path)


def test_a_view_of_a_panorama_is_drawn_again_where_it_was_turned_to(
    gl_context, tmp_path, tape, monkeypatch
):
    monkeypatch.setattr("study_app.live.log.EVERY", 1)
    Image.fromarray(np.ascontiguousarray(data.astronaut()[:64, :128])).save(tmp_path / "p.png")
    source = read_source(tmp_path / "p.png", PictureReading(), panorama=True)
    renderer = FoveatingRenderer(gl_context, source, GEOMETRY, Choice("metamer"))
    renderer.prepare(5)
    path = tmp_path / "log.jsonl"
    log = LiveLog(path, **START)

    shown = [
        pixels
        for _, pixels in run(
            renderer, tape, count=4, log=log, view=lambda k: LiveView(0, 20.0 * (k // 2), 5.0)
        )
    ]
    log.close()
    found = redraw(read_log(path), lambda _: renderer, exactly=True)
    renderer.release()

    assert (found.equal, found.problems) == (4, ())
    assert np.abs(shown[1].astype(int) - shown[2]).mean() > 1  # it turned


def test_gaze_is_rounded_to_a_sixteenth_of_a_pixel_and_stays_lost():
    assert on_grid((10.03, -0.04)) == (10.0, -0.0625)
    assert math.isnan(on_grid((math.nan, 3.0))[0])


def test_only_what_the_gpu_draws_can_be_live(gl_context, frames):
    source = read_source(frames, PictureReading(), panorama=False)
    with pytest.raises(InputError, match="must be one that the GPU draws"):
        FoveatingRenderer(gl_context, source, GEOMETRY, Choice("metamer", {"chroma": "full"}))


def test_a_look_is_all_that_a_frame_depends_on(gl_context, frames):
    source = read_source(frames, PictureReading(), panorama=False)
    renderer = FoveatingRenderer(gl_context, source, GEOMETRY, Choice("warped-metamer"))
    gaze_state = GazeState((30.0, 20.0), (31.0, 22.0), 3)

    def drawn():
        renderer.prepare(gaze_state.seed)
        renderer.hold(LiveView(2))
        return read_back(renderer.draw(gaze_state)).copy()

    first = drawn()
    renderer.hold(LiveView(4))
    renderer.prepare(9)
    renderer.draw(GazeState((80.0, 60.0), (10.0, 10.0), 9))
    renderer.choose(Choice("blur"))
    renderer.choose(Choice("warped-metamer"))

    np.testing.assert_array_equal(drawn(), first)
    renderer.release()


SECONDS, ONSET_S, LONG_S = 1.2, 0.7, 0.05
PX_PER_DEG = math.radians(GEOMETRY.distance_px)


class Trace:
    """Gaze at 500 Hz: it drifts, makes one saccade of 40 pixels, and drifts on."""

    def __init__(self, clock, rng):
        self._clock, self._next = clock, 0
        t_s = np.arange(0, SECONDS, 0.002)
        way = np.clip((t_s - ONSET_S) / LONG_S, 0, 1)
        x = 20 + 4 * t_s + 40 * (3 * way**2 - 2 * way**3) + rng.normal(0, 0.01, len(t_s))
        y = 36 + rng.normal(0, 0.01, len(t_s))
        self._samples = [GazeSample(*map(float, one)) for one in zip(t_s, t_s, x, y, strict=True)]

    def poll(self):
        begin, now_s = self._next, self._clock()
        while self._next < len(self._samples) and self._samples[self._next].t_s <= now_s:
            self._next += 1
        return self._samples[begin : self._next]


@pytest.fixture
def shown(gl_context, tmp_path, monkeypatch, rng):
    """Give a function that shows the trace, and returns flips, pixels, the log and the renderer."""
    monkeypatch.setattr("study_app.live.log.EVERY", 10)
    picture = np.ascontiguousarray(data.astronaut()[:HEIGHT, 128 : 128 + WIDTH])
    Image.fromarray(picture).save(tmp_path / "p.png")
    source = read_source(tmp_path / "p.png", PictureReading(), panorama=False)
    renderer = FoveatingRenderer(gl_context, source, GEOMETRY, Choice("blur"))
    renderer.prepare(5)

    def show(change):
        clock, path = VirtualClock(), tmp_path / f"{change}.jsonl"
        loop = LiveLoop(
            VirtualScreen(clock, HZ, 0.004), Trace(clock, rng), (0, 0), polled=False,
            watch=SaccadeWatch(PX_PER_DEG), change=change,
        )  # fmt: skip
        log = LiveLog(path, **START, change=change)
        log.choice(renderer.describe())
        flips, pixels = [], []
        while clock() < SECONDS - 0.02:
            flip, drawn = loop.step(renderer, LiveView(), 5)
            log.flip(flip, drawn)
            flips.append(flip)
            pixels.append(read_back(drawn).copy())
        log.close()
        return flips, pixels, loop, read_log(path)

    yield show, renderer
    renderer.release()


def test_only_frames_that_fall_into_a_saccades_window_change_and_the_log_tells_so(shown):
    show, renderer = shown
    flips, pixels, loop, log = show("during-saccades")

    moved = [b.number for a, b in pairwise(flips) if a.gaze_state != b.gaze_state]
    differ = [k for k in range(1, len(pixels)) if not np.array_equal(pixels[k - 1], pixels[k])]
    assert moved == differ
    assert 3 <= len(moved) <= math.ceil((LONG_S + SUPPRESSED_AFTER_S) * HZ)
    (saccade,) = [line for line in log.lines if isinstance(line, LiveSaccade)]
    assert saccade.onset_s == pytest.approx(ONSET_S, abs=0.012)
    assert saccade.offset_s == pytest.approx(ONSET_S + LONG_S, abs=0.012)
    # The eye has landed: the picture is where it is.
    assert flips[-1].gaze_state.gaze_px[0] == pytest.approx(20 + 4 * 0.8 + 40, abs=0.3)

    lines = [line for line in log.lines if isinstance(line, LiveFlip)]
    assert [line.n for line in lines if line.suppressed] == moved
    inside = [line.n for line in lines if saccade.suppresses(line.t_s)]
    assert set(moved) <= set(inside)
    assert len(inside) <= len(moved) + 2  # a saccade is known a little after its onset
    assert log.start.change == "during-saccades"
    # Held frames have no latency; the gaze that they show is as old as they say.
    assert loop.latency.summary().frames == 1 + len(moved)
    assert lines[moved[0] - 1].age_s == pytest.approx(lines[moved[0] - 1].t_s - flips[0].sample_s)

    found = redraw(log, lambda _: renderer, exactly=True)
    assert found.equal == found.drawn >= 7
    assert found.problems == ()


def test_without_the_option_each_frame_follows_and_the_log_still_names_the_saccade(shown):
    flips, _, loop, log = shown[0]("always")

    assert (
        sum(a.gaze_state.gaze_px != b.gaze_state.gaze_px for a, b in pairwise(flips))
        > len(flips) / 2
    )
    assert sum(isinstance(line, LiveSaccade) for line in log.lines) == 1
    assert 3 <= sum(flip.suppressed for flip in flips) <= 8
    assert loop.latency.summary().frames == len(flips)


def test_when_the_source_is_mute_in_a_saccade_the_window_ends_all_the_same():
    clock = VirtualClock()
    trace = Trace(clock, np.random.default_rng(1))
    trace._samples = [one for one in trace._samples if one.t_s < ONSET_S + 0.03]
    still = SimpleNamespace(
        hold=lambda _: None, draw=lambda _: None, follow=lambda eye_px, _: (eye_px, eye_px)
    )
    loop = LiveLoop(
        VirtualScreen(clock, HZ, 0.004), trace, (0, 0), polled=False,
        watch=SaccadeWatch(PX_PER_DEG), change="during-saccades",
    )  # fmt: skip
    flips = []
    while clock() < SECONDS:
        flips.append(loop.step(still, None, 0)[0])

    assert any(flip.suppressed for flip in flips)
    late = [flip for flip in flips if flip.t_s > ONSET_S + 0.03 + SUPPRESSED_AFTER_S]
    assert not any(flip.suppressed for flip in late)
    assert all(math.isnan(flip.gaze_state.gaze_px[0]) for flip in late)  # the renderer holds


def test_a_log_of_a_program_that_was_killed_before_its_first_flip_holds_nothing_wrong(tmp_path):
    path = tmp_path / "seen.jsonl"
    LiveLog(path, **START).close()

    done = metamerlab("live", "builtin:garden", "--verify", str(path))

    assert "note: the log was not closed: the program was killed" in done.stdout
    assert "0 flips: nothing was shown" in done.stdout


def test_a_log_whose_first_line_is_refused_is_closed(tmp_path, monkeypatch):
    opened, really = [], Path.open

    def spied(path, *how, **more):
        opened.append(really(path, *how, **more))
        return opened[-1]

    def refuse(*_):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(Path, "open", spied)
    monkeypatch.setattr(LiveLog, "_write", refuse)
    with pytest.raises(OSError, match="No space left"):
        LiveLog(tmp_path / "seen.jsonl", **START)
    assert [file.closed for file in opened] == [True]


def test_another_word_for_change_gets_one_message(tmp_path):
    done = metamerlab("live", str(tmp_path / "p.png"), "--change", "in-saccades", status=2)

    assert "--change: must be one of always, during-saccades (got 'in-saccades')" in " ".join(
        done.output.split()
    )


@pytest.mark.parametrize(("hz", "every", "kept"), [(2, None, 10), (100, None, 4), (100, 5, 20)])
def test_a_minute_has_a_hundred_proofs_however_slow_its_frames(
    tmp_path, gl_context, hz, every, kept
):
    """By hand: of ten frames each half second all, of a hundred frames a second every thirtieth."""
    picture = create_texture(gl_context, (32, 32), "rgba8")
    log = LiveLog(tmp_path / "log.jsonl", every=every, **START)
    state = GazeState((0.0, 0.0), (0.0, 0.0), 0)
    for n in range(10 if hz == 2 else 100):
        t_s = n / hz
        log.flip(DrawnFlip(n, t_s, t_s, t_s, 1, LiveView(), state, "found", 0.0), picture)
    log.close()
    picture.release()
    lines = read_log(tmp_path / "log.jsonl").lines
    assert sum(line.pixels is not None for line in lines if isinstance(line, LiveFlip)) == kept
