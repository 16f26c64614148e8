"""`metamerlab demo`: the whole chain on a study of a few small clips, and its page."""

from __future__ import annotations

import io
import json
import os
import re
import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from rich.console import Console
from typer.testing import CliRunner

from pipeline.warp.gpu import warp_frame
from pipeline.warp.settings import WarpSettings
from protocols.errors import StudyError
from protocols.hashing import sha256_file
from protocols.load import load_display, load_protocol, load_study, shipped
from protocols.manifest import read_manifest
from stimuli.foveated.builtin_pictures import notices
from stimuli.scenes.stereo import built_in_pair
from study_app.cli import app
from study_app.cli.demo import pictures as demo_pictures
from study_app.cli.demo import studies
from study_app.cli.demo.observers import Options
from study_app.cli.demo.pictures import Photographs, most_holes
from study_app.cli.demo.run import run_demo
from study_app.cli.demo.screen import PROGRAMS
from study_app.cli.demo.sitting import Flip, clip_place
from study_app.cli.demo.studies import STUDIES, chosen_trial, side_by_side, trial_strip
from study_app.cli.demo.watcher import Place, Watcher
from study_app.sittings import find_sittings
from study_app.strip import BLOCK_PX, BLOCKS, GUARD, code_of

# Builds clips, and sits before a window in real time.
pytestmark = [pytest.mark.slow, pytest.mark.timeout(900)]

SMALLER = {
    "width_deg": "2.0",
    "height_deg": "1.5",
    "duration_s": "0.2",
    "fixation_s": "0.1",
    "gap_s": "0.1",
    "iti_s": "0.1",
    # A busy machine misses refreshes; what follows is tested on a virtual clock.
    "dropped_frames_max": "10000",
    "completed_min_share": "0.0",
}


def write_small_study(folder: Path) -> Path:
    """One made scene and the photographs, one size, clips of six frames: 6 decisions."""
    text = shipped("studies")["showcase"].read_text(encoding="utf-8")
    text = re.sub(r"^(practice|catch) = \{.*\n", "", text, flags=re.M)
    text, scenes = re.subn(
        r'\n\[\[stimuli\.scenes\]\]\nname = "garden".*?(?=\n\[\[)', "\n", text, flags=re.S
    )
    text, sizes = re.subn(
        r'\n\[\[stimuli\.sizes\]\]\nname = "small".*?(?=\n\[\[)', "\n", text, flags=re.S
    )
    text, shares = re.subn(r"^hole_share = .*$", "extent_m = 0.16", text, flags=re.M)
    assert (scenes, sizes, shares) == (1, 1, 1)
    for key, value in SMALLER.items():
        text, count = re.subn(rf"^{key} = .*$", f"{key} = {value}", text, flags=re.M)
        assert count == 1, key
    path = folder / "small.toml"
    path.write_text(text, encoding="utf-8")
    return path


def missing_window() -> str:
    """Why no window can be opened here, or nothing."""
    missing = [name for name in PROGRAMS if shutil.which(name) is None]
    return f"no {', '.join(missing)} here" if missing else ""


def quiet_console() -> Console:
    return Console(file=io.StringIO())


@pytest.fixture(scope="module", autouse=True)
def one_worker():
    """Clips are built by one process: each opens the scene anew, and that costs most."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("study_app.cli.demo.run.cores", lambda: 1)
        yield


@pytest.fixture(scope="module")
def filled_once(tmp_path_factory) -> Callable[[Path, int], Photographs]:
    """`fill_photographs` that fills for the first who asks, and copies for the others."""
    real, filled = demo_pictures.fill_photographs, {}

    def fill(out: Path, seed: int) -> Photographs:
        if seed not in filled:
            folder = tmp_path_factory.mktemp("filled")
            filled[seed] = (real(folder, seed), folder)
        made, folder = filled[seed]
        shutil.copytree(folder, out, dirs_exist_ok=True)
        return made

    return fill


@pytest.fixture(scope="module")
def options(tmp_path_factory) -> Options:
    pytest.importorskip("skimage")
    folder = tmp_path_factory.mktemp("demo")
    return Options(
        folder / "out", write_small_study(folder), observers=3, figures=False, studies=False
    )


@pytest.fixture(scope="module")
def made(options, filled_once, shared_gl_context) -> Options:  # noqa: ARG001
    """Run the demonstration once; without a window where none can be opened."""
    reason = missing_window()
    if reason and os.environ.get("REQUIRE_GL") == "1":
        pytest.fail(f"REQUIRE_GL=1, and there is {reason}")
    options = replace(options, window=not reason)
    # What another run drew of a study: this one leaves the studies out, and keeps it on the page.
    strip = options.out / "studies" / "beyond-blur-detection" / studies.STRIP_NAME
    strip.parent.mkdir(parents=True)
    Image.fromarray(np.full((60, 400, 3), 90, np.uint8)).save(strip)
    (strip.parent / "report").mkdir()
    (strip.parent / "report" / "report.html").touch()
    (options.out / "demo.json").write_text("{}", encoding="utf-8")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(demo_pictures, "fill_photographs", filled_once)
        run_demo(options, quiet_console())
    return options


@pytest.fixture(scope="module")
def page(made) -> str:
    return (made.out / "index.html").read_text(encoding="utf-8")


def needs_window(made: Options) -> None:
    if not made.window:
        pytest.skip(missing_window())


def test_the_page_says_on_every_screen_that_the_observers_are_simulated(page):
    assert "<title>SIMULATED:" in page
    assert re.search(r'class="stamp">[^<]*ALL OBSERVERS ARE SIMULATED', page)
    assert "Simulated data: this says what the program was told to prefer" in page
    assert not re.search(r"<td class=\"l\">real</td>", page)


def test_the_page_shows_the_studies_on_foveated_pictures(page):
    assert "Studies on foveated pictures" in page
    assert 'href="studies/beyond-blur-detection/report/report.html"' in page
    assert "Beyond Blur: preference" not in page  # of which nothing was drawn


def test_the_page_needs_no_other_file_and_no_network(page):
    loaded = re.findall(r'(?:src|poster|data)="([^"]{0,40})', page)

    assert len(loaded) > 20
    assert [entry for entry in loaded if not entry.startswith("data:")] == []
    assert "http" not in re.sub(r'base64,[^"]*|http-equiv', "", page)
    assert "default-src 'none'" in page


def test_every_link_of_the_page_leads_to_a_file_that_is_there(made, page):
    links = re.findall(r'href="([^"#]+)"', page)

    assert {"report/report.html", "clips/contact-sheet.html", "sessions/"} <= set(links)
    assert [link for link in links if not (made.out / link).exists()] == []


def test_the_page_shows_fills_clips_trial_and_report(made, page):
    for title in ("Warped to the other eye", "Push-pull", "Metameric", "The truth"):
        assert page.count(f"<b>{title}</b>") >= 2  # whole, and the part with most holes
    assert page.count("data:video/webm") == 2 * 3  # scenes x methods
    headline = json.loads((made.out / "demo.json").read_text())["report"]["notes"]["headline"]
    assert "Metameric was" in headline
    assert headline.replace("'", "&#39;") in page
    for step in ("Built the study&#39;s clips", "Checked them", "Analysed", "In all"):
        assert step in page


def test_all_observers_took_part_in_the_study_that_was_built(made):
    sittings = find_sittings(made.out / "sessions", "showcase")
    manifest = read_manifest(made.out / "clips")
    starts = [sitting.journal.start for sitting in sittings]

    assert len(sittings) == made.observers
    assert {sitting.state for sitting in sittings} == {"completed"}
    assert all(start.simulated for start in starts)
    assert {start.manifest_sha256 for start in starts} == {manifest.sha256}
    assert sorted(start.slot for start in starts) == list(range(made.observers))


def test_one_observer_sat_before_a_real_window(made, page):
    needs_window(made)
    (sitting,) = (one for one in find_sittings(made.out / "sessions") if one.participant == "W001")

    assert sitting.journal.start.timing_evidence == "software timer"
    assert "W001" in page
    seen = json.loads((made.out / "demo.json").read_text())["window"]["notes"]
    assert seen["wrong"] == []
    assert seen["seen"] > 0
    assert f"saw {seen['seen']} of the {seen['flips']} flips" in page
    assert "none differs" in page


def test_the_filmstrip_shows_the_frames_that_its_captions_name(made):
    """Each picture was read from the screen; the clip in it is the frame with that hash."""
    needs_window(made)
    strip = json.loads((made.out / "trial/trial.json").read_text())
    assert strip["source"] == "screen"
    manifest = read_manifest(made.out / "clips")
    paths = {
        sha: made.out / "clips" / clip.frame_path(index)
        for clip in manifest.clips
        for index, sha in enumerate(clip.frames_sha256)
    }
    place = clip_place(load_display(str(made.out / "screen.toml")), load_protocol(made.study))
    rows = slice(place.top, place.top + place.height)
    columns = slice(place.left, place.left + place.width)
    for shot in strip["shots"]:
        shown = pixels_of(made.out / "trial" / shot["file"])[rows, columns]
        if shot["frame"]:
            assert np.array_equal(shown, pixels_of(paths[shot["frame"]])), shot
        else:
            assert shot["phase"] in {"fixate", "gap", "respond"}
    assert {shot["phase"] for shot in strip["shots"]} == {
        "fixate", "first", "gap", "second", "respond",
    }  # fmt: skip


def pixels_of(path: Path) -> np.ndarray:
    with Image.open(path) as image:
        return np.asarray(image.convert("RGB"))


def test_run_again_it_keeps_what_is_done(made):
    def state() -> dict[str, str]:
        kept = ("sessions", "clips", "pictures", "report", "trial")
        files = [path for name in kept for path in sorted((made.out / name).rglob("*"))]
        return {str(path): sha256_file(path) for path in files if path.is_file()}

    before, times = state(), (made.out / "demo.json").read_text()
    run_demo(made, quiet_console())

    assert state() == before
    told = {name: step["seconds"] for name, step in json.loads(times).items() if name != "check"}
    again = json.loads((made.out / "demo.json").read_text())
    assert {name: again[name]["seconds"] for name in told} == told


def test_without_a_window_all_sit_before_a_virtual_display(made, tmp_path):
    copy = replace(made, out=tmp_path / "out", window=False)
    shutil.copytree(made.out, copy.out, ignore=shutil.ignore_patterns("sessions", "trial"))

    run_demo(copy, quiet_console())

    page = (copy.out / "index.html").read_text(encoding="utf-8")
    sittings = find_sittings(copy.out / "sessions")
    assert {one.journal.start.timing_evidence for one in sittings} == {"virtual"}
    assert len(sittings) == copy.observers
    assert "drawn again from the frames that the log names, since no window" in page
    assert "real window" not in page


def test_sittings_with_older_clips_are_made_again_but_recorded_ones_are_refused(
    made, tmp_path, monkeypatch, reseal
):
    copy = replace(made, out=tmp_path / "out", window=False, seed=1)
    shutil.copytree(made.out, copy.out, ignore=shutil.ignore_patterns("trial"))
    # Another seed also means other fills of the photographs, which nothing here looks at.
    kept = json.loads((made.out / "demo.json").read_text())["pictures"]["notes"]
    monkeypatch.setattr(
        "study_app.cli.demo.pictures.fill_photographs",
        lambda _folder, _seed: Photographs.from_notes(kept),
    )
    journal = next((copy.out / "sessions").rglob("S001/journal.jsonl"))
    simulated = journal.read_bytes()
    journal.write_bytes(simulated.replace(b'"simulated":true', b'"simulated":false'))

    for change in (lambda _: None, reseal):  # damaged, then a whole session of a person
        change(journal)
        before = journal.read_bytes()
        with pytest.raises(StudyError, match=r"must hold simulated sessions alone .*S001"):
            run_demo(copy, quiet_console())
        assert journal.read_bytes() == before

    journal.write_bytes(simulated)
    mine = copy.out / "sessions" / "notes.txt"
    mine.write_text("precious")
    with pytest.raises(StudyError, match=r"it holds notes\.txt.*move that folder away"):
        run_demo(copy, quiet_console())
    again = CliRunner().invoke(app, ["demo", "--no-window", "--out", str(copy.out), "--fresh"])
    assert again.exit_code == 2
    assert "sessions/notes.txt" in " ".join(again.output.split())
    assert (journal.read_bytes(), mine.read_text()) == (simulated, "precious")

    mine.unlink()
    run_demo(copy, quiet_console())
    assert journal.read_bytes() != simulated  # another seed, other answers


def test_where_xvfb_is_missing_the_message_says_what_to_do(tmp_path, monkeypatch):
    monkeypatch.setenv("PATH", str(tmp_path))

    result = CliRunner().invoke(app, ["demo", "--out", str(tmp_path / "out")])

    assert result.exit_code == 2
    for cure in ("Xvfb", "apt-get install xvfb openbox", "--display", "--no-window"):
        assert cure in result.output
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("window", [True, False])
def test_a_folder_of_other_things_is_left_alone(tmp_path, window):
    if window and missing_window():
        pytest.skip(missing_window())
    (tmp_path / "report").mkdir()
    arguments = ["demo", "--out", str(tmp_path), *(() if window else ("--no-window",))]

    result = CliRunner().invoke(app, arguments)
    fresh = CliRunner().invoke(app, [*arguments, "--fresh"])

    assert result.exit_code == fresh.exit_code == 2
    assert "must be empty or made by 'metamerlab demo' (it holds report" in result.output
    assert "nothing was deleted" in fresh.output
    assert [path.name for path in tmp_path.iterdir()] == ["report"]


def test_a_watcher_reports_whole_pictures_once_and_torn_ones_never():
    screen = np.full((64, 400, 4), 128, np.uint8)
    with Watcher(screen, Place(10, 20, 8, 6)) as watcher:
        for number in (7, 8):
            screen[20:26, 10:18, :3] = number
            draw_strips(screen, number, number)
            wait_until(lambda number=number: number in {one.number for one in watcher.seen})
        draw_strips(screen, 10, 9)  # torn
        wait_until(lambda: False, timeout_s=0.05)
        draw_strips(screen, 11, 11)
        wait_until(lambda: 11 in {one.number for one in watcher.seen})
        pictures = watcher.take([7, 8, 9])

    assert [one.number for one in watcher.seen] == [7, 8, 11]
    assert sorted(pictures) == [7, 8]
    assert (pictures[8][20:26, 10:18] == 8).all()
    assert (pictures[8][0] == 128).all()  # without the strip
    assert watcher.take([7, 8]) == {}


class DrawnWhileCopied(np.ndarray):
    """A screen of which `draw` draws a part each time, the moment after its pixels were copied."""

    draw = staticmethod(lambda _: None)

    def __getitem__(self, key):
        part = super().__getitem__(key)
        if key == (..., slice(2, None, -1)):
            part = np.array(part)
            self.draw(self)
        return part


def screen_with(number: int, draw) -> np.ndarray:
    screen = np.full((64, 400, 4), 128, np.uint8).view(DrawnWhileCopied)
    screen.draw = draw
    screen[20:26, 10:18, :3] = number
    draw_strips(screen, number, number)
    return screen


def seen_whole(screen: np.ndarray, last: int) -> list[int]:
    """Numbers of the pictures, whose clips show them, that a watcher reports until `last`."""
    with Watcher(screen, Place(10, 20, 8, 6)) as watcher:
        wait_until(lambda: bool(watcher.seen), timeout_s=0.1)
        screen.draw = lambda _: None
        screen[20:26, 10:18, :3] = last
        draw_strips(screen, last, last)
        wait_until(lambda: last in {one.number for one in watcher.seen})
        numbers = [one.number for one in watcher.seen]
        pictures = watcher.take(numbers)
    assert all((pictures[number][20:26, 10:18] == number).all() for number in numbers)
    return numbers


def test_a_picture_that_is_drawn_to_its_end_while_it_is_copied_counts_as_torn():
    def finish(screen: np.ndarray) -> None:
        screen[20:26, 10:18, :3] = 8
        draw_strips(screen, 8, 8)

    screen = screen_with(7, finish)
    draw_strips(screen, 8, 7)  # the upper part of flip 8 is there, the clip is still flip 7's

    assert seen_whole(screen, 9) == [9]


def test_a_picture_that_the_next_begins_to_replace_while_it_is_copied_counts_as_torn():
    def begin(screen: np.ndarray) -> None:
        draw_strips(screen, 8, 7)

    assert seen_whole(screen_with(7, begin), 9) == [9]


def draw_strips(screen: np.ndarray, upper: int, lower: int) -> None:
    for rows, number in ((slice(0, BLOCK_PX), upper), (slice(-BLOCK_PX, None), lower)):
        bits = [*GUARD, *(int(bit) for bit in f"{code_of(number):032b}")]
        assert len(bits) == BLOCKS
        screen[rows, : BLOCKS * BLOCK_PX] = np.repeat(bits, BLOCK_PX)[None, :, None] * 255


def wait_until(condition, timeout_s: float = 20.0) -> None:
    import time

    until_s = time.monotonic() + timeout_s
    while not condition() and time.monotonic() < until_s:
        time.sleep(0.005)


def test_the_detail_is_where_most_is_hidden():
    hole = np.zeros((60, 100), bool)
    hole[:, :5] = True  # what enters at the border is no disocclusion
    hole[30:40, 50:70] = True

    top, left = most_holes(hole, (10, 20))

    assert (top, left) == (30, 50)


def test_shots_are_spread_over_each_phase_and_taken_from_what_was_seen():
    from study_app.cli.demo.filmstrip import chosen_flips

    flips = [Flip(n, n / 60, 1, "first", "f") for n in range(40)]
    flips += [Flip(n, n / 60, 1, "gap", "") for n in range(40, 50)]
    seen = {n: np.zeros((1, 1, 3), np.uint8) for n in range(0, 50, 2)}

    chosen = chosen_flips(flips, seen)

    assert [flip.number for flip in chosen] == [4, 14, 24, 34, 44]
    assert [flip.phase for flip in chosen_flips(flips, None)] == ["first"] * 4


@pytest.fixture
def pictures(tmp_path):
    pytest.importorskip("skimage")
    out = tmp_path / "out"
    return lambda: CliRunner().invoke(app, ["demo", "--pictures-only", "--out", str(out)])


@pytest.mark.usefixtures("shared_gl_context")
def test_pictures_alone_fill_every_hole_and_say_where_they_are(
    pictures, tmp_path, filled_once, monkeypatch
):
    monkeypatch.setattr(demo_pictures, "fill_photographs", filled_once)

    result = pictures()

    assert result.exit_code == 0, result.output
    assert "before-and-after.png" in result.output.replace("\n", "")
    written = {path.stem for path in (tmp_path / "out").iterdir()}
    assert written == {
        "before-and-after", "warped", "truth", "push-pull", "push-pull-depth", "metameric",
    }  # fmt: skip
    filled = {name: pixels_of(tmp_path / "out" / f"{name}.png") for name in written}
    assert filled["metameric"].shape == (500, 741, 3)
    changed = (filled["metameric"] != filled["push-pull"]).any(axis=-1).mean()
    assert 0.05 < changed < 0.15  # the holes, and nothing else


def test_the_demonstration_mends_depth_and_takes_the_rim_of_its_photographs_into_the_holes(
    gl_context, filled_once, tmp_path
):
    frame = built_in_pair("motorcycle").warp_input()
    wanted = WarpSettings(rim_px=1, depth_speckle=True)
    hole = warp_frame(gl_context, frame.source, frame.flow_px, settings=wanted).hole

    assert filled_once(tmp_path, 0).hole_share == hole.mean()


def test_it_says_where_it_cannot_write(pictures, tmp_path):
    (tmp_path / "out").write_text("a file")

    result = pictures()

    assert result.exit_code == 2
    assert "out" in result.output
    assert "Traceback" not in result.output


@pytest.mark.full
@pytest.mark.timeout(1800)
def test_the_demonstration_itself_ends_in_a_whole_page(tmp_path):
    result = CliRunner().invoke(app, ["demo", "--out", str(tmp_path / "out")])

    assert result.exit_code == 0, result.output
    page = (tmp_path / "out/index.html").read_text(encoding="utf-8")
    links = re.findall(r'href="([^"#]+)"', page)
    assert [link for link in links if not (tmp_path / "out" / link).exists()] == []
    assert len(find_sittings(tmp_path / "out/sessions")) == 12
    assert "none differs" in page
    assert page.count("data:image/svg+xml") == 2


def test_a_trial_of_each_study_on_foveated_pictures_is_drawn_phase_by_phase(monkeypatch):
    """With a wall of notices for every scene, which needs no light to be baked."""
    monkeypatch.setattr(
        "stimuli.recipes.foveated_work.builtin_picture",
        lambda _name, geometry, *_, **__: notices(geometry.height_px, geometry.width_px),
    )
    phases = {
        "beyond-blur-task": 3, "beyond-blur-preference": 5, "beyond-blur-detection": 3,
        "critical-scaling": 7, "critical-scaling-halves": 5,
    }  # fmt: skip
    assert set(phases) == set(STUDIES)
    for name, count in phases.items():
        study, display = load_study(Path(name), None)
        strip = trial_strip(study, display, chosen_trial(study, display))
        assert count * 480 < strip.shape[1] < (count + 0.5) * 480, name
        shown = strip[20:250]
        grey = (shown == 128).all(axis=2).mean()
        assert 0.3 < grey < 0.75, name


def test_side_by_side_each_stimulus_stands_on_its_side_of_the_dot():
    study, display = load_study(Path("showcase"), None)
    black, white = (np.full((240, 320, 3), level, np.uint8) for level in (0, 255))

    fixate, both, respond = screens_of(side_by_side(study, display, [black, white]), 240)

    assert (both[0, :320] == 0).all()
    assert (both[0, -320:] == 255).all()
    assert (both[0, 320:-320] == 128).all()
    assert both.shape == (240, 320 * 2 + 32, 3)
    assert (fixate[0] == 128).all()
    assert (respond == 128).all()


def screens_of(strip: np.ndarray, height: int) -> list[np.ndarray]:
    """The screens on a sheet of one row, without the labels below."""
    inside = (strip[: height + 12] != strip[0, 0]).any(axis=2)
    rows, columns = inside.any(axis=1), inside.any(axis=0)
    edges = np.flatnonzero(np.diff(np.concatenate([[0], columns, [0]])))
    top = int(rows.argmax())
    return [strip[top : top + height, a:b] for a, b in edges.reshape(-1, 2)]


@pytest.mark.usefixtures("shared_gl_context")
def test_the_moving_gaze_visits_a_photograph(tmp_path):
    studies.show_moving_gaze(tmp_path / "studies" / "gaze.webp", frames=3)

    with Image.open(tmp_path / "studies" / "gaze.webp") as moving:
        assert getattr(moving, "n_frames", 1) == 3
        assert moving.size[0] == 480


def test_a_study_in_the_demonstration_is_simulated_and_reported(tmp_path, monkeypatch):
    monkeypatch.setattr(studies, "trial_strip", lambda *_: np.zeros((8, 8, 3), np.uint8))
    report = []

    def reported(sessions, study, *_, **__):
        report.append((sessions, study.study.name))

    monkeypatch.setattr(studies, "report_sessions", reported)
    folder = tmp_path / "beyond-blur-preference"
    studies.show_study("beyond-blur-preference", folder, observers=1)

    assert report == [(folder / "sessions", "beyond-blur-preference")]
    (sitting,) = find_sittings(folder / "sessions", "beyond-blur-preference")
    assert sitting.main_done == 252
    assert (folder / studies.STRIP_NAME).is_file()
