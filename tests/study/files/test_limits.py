"""No file and no number asks for more than the machine has, and every reader says what is wrong."""

import base64
import gzip
import io
import json
import re
import struct
import subprocess
import sys
import zlib
from contextlib import suppress
from pathlib import Path
from types import SimpleNamespace

import cv2
import numpy as np
import psutil
import pytest
import trimesh
from command_line import metamerlab
from number_files import load_plane
from PIL import Image, ImageDraw
from study_texts import shipped_study

from analysis.export.bids_gaze import read_samples
from analysis.tables.table import Table
from analysis.tasks.note import read_note
from pipeline.errors import InputError
from pipeline.pictures.colour_file import load_colour, read_any, save_colour
from pipeline.pictures.decode import read_parts, read_pixels
from pipeline.pictures.header import check_fits
from pipeline.pictures.size_limits import NEEDS, check_need, check_values
from pipeline.pictures.stored_frames import read_frames, stated
from pipeline.pictures.warp_input import read_pose
from pipeline.pictures.write import write_pixels
from pipeline.video_file import VideoFrames
from protocols.disk.hashing import sha256_bytes
from protocols.errors import StudyError
from protocols.feasibility import virtual_manifest
from protocols.journal import SideFile
from protocols.journal_file import read_journal
from protocols.limits import FIXED, LIMITS, LIMITS_VARIABLE, gunzipped
from protocols.load import load_display, load_protocol
from protocols.manifest import read_manifest
from protocols.outside import bounded_bytes, lines_of, parsed_json, visible_line
from protocols.plan import make_plan, planned_trials
from protocols.recipes.files import read_table as read_stimuli
from stimuli.media.png import decode_png
from stimuli.media.video import unpacked_video
from stimuli.scenes.mesh_file import load_world
from stimuli.score.viewing_conditions import read_viewer_gaze
from study_app.cli.pictures.figure_command import _scores
from study_app.clips import read_frame
from study_app.gaze.recording import load_recording
from study_app.session import RunTrial, next_step

DEMO = load_protocol(Path("demo"))


def demo_file(tmp_path: Path, **changes: str) -> Path:
    path = tmp_path / "study.toml"
    path.write_text(shipped_study("demo", changes), encoding="utf-8")
    return path


def test_more_than_9999_trials_have_names_and_an_order():
    many = DEMO.design.model_copy(update={"repeats": 2 * (10_001 // 24 + 1)})
    study = DEMO.model_copy(update={"design": many})
    manifest = virtual_manifest(study, load_display(study.display.display))
    plan = make_plan(study, manifest, "P01", 0)

    assert plan.main_trials > 10_000
    assert len({trial.id for trial in plan.trials}) == len(plan.trials)
    assert "main-10000" in {trial.id for trial in plan.trials}
    no_consent = study.privacy.model_copy(update={"consent_required": False})
    study = study.model_copy(update={"privacy": no_consent})
    step = next_step(study, plan, [], "en")
    assert not isinstance(step, RunTrial)


@pytest.mark.parametrize("command", ["check", "show", "preregister"])
def test_a_billion_repeats_are_refused_at_once(tmp_path, command):
    path = demo_file(tmp_path, repeats="1_000_000")
    more = ["--out", tmp_path / "x.html"] if command == "preregister" else []
    done = metamerlab("protocol", command, str(path), *map(str, more), status=2)

    assert "at most 100,000 trials" in done.output


def test_the_limit_on_trials_is_raised_by_the_environment(monkeypatch):
    study = DEMO.model_copy(update={"design": DEMO.design.model_copy(update={"repeats": 50})})
    monkeypatch.setenv(LIMITS_VARIABLE, "values=9, trials=100")
    with pytest.raises(StudyError, match="at most 100 trials"):
        planned_trials(study, "P01", 0)
    monkeypatch.setenv(LIMITS_VARIABLE, "trials=1e5")
    assert len(planned_trials(study, "P01", 0)) > 100
    monkeypatch.setenv(LIMITS_VARIABLE, "trials=many")
    with pytest.raises(StudyError, match="must read NAME=NUMBER"):
        planned_trials(study, "P01", 0)


@pytest.mark.parametrize("width", ["180.0", "200.0", "359.0"])
def test_a_clip_wider_than_half_the_world_is_refused(tmp_path, width):
    path = demo_file(tmp_path, width_deg=width)
    with pytest.raises(StudyError, match=r"width_deg: must be less than 180"):
        load_protocol(path)


def small_file_of_a_huge_picture(path: Path) -> None:
    """A PNG that says it has 60,000 x 60,000 pixels, as a few bytes of zeros can hold."""

    def chunk(kind: bytes, data: bytes) -> bytes:
        return (
            struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))
        )

    head = struct.pack(">IIBBBBB", 60_000, 60_000, 8, 2, 0, 0, 0)
    path.write_bytes(
        b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", head) + chunk(b"IDAT", zlib.compress(b"\0" * 1000))
        + chunk(b"IEND", b"")
    )  # fmt: skip


def test_a_picture_of_any_size_is_refused_before_it_is_unpacked(tmp_path):
    path = tmp_path / "huge.png"
    small_file_of_a_huge_picture(path)
    program = (
        "import re, sys; from pathlib import Path; from pipeline.pictures.decode import"
        " read_pixels\nfrom pipeline.errors import InputError\n"
        "try: read_pixels(Path(sys.argv[1]))\nexcept InputError as error: print(error)\n"
        # Not `ru_maxrss`, which begins at what the parent held.
        "status = Path('/proc/self/status').read_text()\n"
        "print(int(re.search(r'VmHWM:\\s*([0-9]+) kB', status)[1]) // 1024)"
    )
    done = subprocess.run(
        [sys.executable, "-c", program, path], capture_output=True, text=True, check=True
    )
    said, peak_mib = done.stdout.splitlines()

    assert "must hold at most" in said or "header claims" in said  # OpenImageIO looks, too
    assert int(peak_mib) < 1000


def test_the_limit_on_pictures_is_raised_by_the_environment(tmp_path, monkeypatch):
    path = tmp_path / "p.png"
    Image.new("RGB", (40, 30)).save(path)
    monkeypatch.setenv(LIMITS_VARIABLE, "values=3599")
    with pytest.raises(InputError, match=r"40 x 30 x 3.*METAMERLAB_LIMITS=values=3600"):
        read_pixels(path)
    monkeypatch.setenv(LIMITS_VARIABLE, "values=3600")
    assert read_pixels(path).data.shape == (30, 40, 3)
    with pytest.raises(InputError, match="says that it holds -1 x 5"):
        check_values(path, -1, 5)


def test_numpy_files_are_looked_at_before_they_are_unpacked(tmp_path, monkeypatch):
    np.save(tmp_path / "a.npy", np.ones((4, 5), np.float32))
    np.savez_compressed(tmp_path / "a.npz", np.zeros((1000, 1000), np.float32))
    np.save(tmp_path / "objects.npy", np.array([{}], dtype=object), allow_pickle=True)
    (tmp_path / "cut.npz").write_bytes((tmp_path / "a.npz").read_bytes()[:-30])
    (tmp_path / "bad.npy").write_bytes(b"\x93NUMPY\x01\x00v\x00{'descr': " + b" " * 200)

    assert load_plane(tmp_path / "a.npy")[0].shape == (4, 5)
    assert load_plane(tmp_path / "a.npz")[0].shape == (1000, 1000)
    for name in ("objects.npy", "cut.npz", "bad.npy"):
        with pytest.raises(InputError, match="must be a numpy file"):
            load_plane(tmp_path / name)
    monkeypatch.setenv(LIMITS_VARIABLE, "values=1000")
    with pytest.raises(InputError, match="at most 1,000 numbers"):
        load_plane(tmp_path / "a.npz")
    monkeypatch.setenv(LIMITS_VARIABLE, "values=19")
    with pytest.raises(InputError, match="4 x 5"):
        load_plane(tmp_path / "a.npy")


def test_gzip_files_unpack_to_a_limit(tmp_path, monkeypatch):
    data = b"t_s,x_px,y_px\n" + b"0" * 5_000_000
    packed = gzip.compress(data)
    path = tmp_path / "g.csv.gz"

    assert gunzipped(packed, path) == data
    assert gunzipped(packed + gzip.compress(b"more"), path) == data + b"more"
    assert gunzipped(b"", path) == b""
    for broken in (packed[:-9], packed[: len(packed) // 2], b"text", packed[:4] + b"\xff" * 40):
        with pytest.raises(StudyError, match="must be a whole gzip file"):
            gunzipped(broken, path)
    monkeypatch.setenv(LIMITS_VARIABLE, "text=4e6")
    with pytest.raises(StudyError, match="must unpack to at most 4,000,000 bytes"):
        gunzipped(packed, path)


ASC = "** x\nGAZE_COORDS 0 0 1919 1079\nSTART 1\n{}END 9\n"


@pytest.mark.parametrize(
    ("lines", "said"),
    [
        ("100\t1\t1\n110\t2\t2\n105\t3\t3\n", "do not fall"),
        ("100\t1\t1\n1e999\t2\t2\n", "finite"),
        ("1x\t1\t1\n110\t2\t2\n", "finite"),
        ("100\t1\t1\n110\tinf\t2\n", "gaze must be in pixels"),
    ],
)
def test_stamps_of_a_recording_are_finite_and_do_not_fall(tmp_path, lines, said):
    path = tmp_path / "g.asc"
    path.write_text(ASC.format(lines))
    with pytest.raises(StudyError, match=said):
        load_recording(path)


@pytest.mark.parametrize(
    ("lines", "said"),
    [
        ("0.1,1,2,3\n0.05,2,2,3\n", "must not fall"),
        ("0.1,1,inf,3\n", "all finite numbers"),
        ("nan,1,2,3\n", "all finite numbers"),
        ("0.1,1,2\n", "must be a table"),
    ],
)
def test_stored_gaze_is_finite_and_does_not_fall(tmp_path, lines, said):
    data = b"t_s,raw_t,x_px,y_px\n" + lines.encode()
    (tmp_path / "0001.csv").write_bytes(data)
    with pytest.raises(StudyError, match=said):
        read_samples(tmp_path, SideFile(file="0001.csv", sha256=sha256_bytes(data)))


def test_indices_of_a_gltf_that_lead_nowhere_are_one_message(tmp_path):
    scene = trimesh.Scene(trimesh.creation.box())
    data = scene.export(file_type="glb")
    path = tmp_path / "s.glb"
    rng = np.random.default_rng(4)
    for _ in range(60):
        harmed = bytearray(data)
        for place in rng.integers(20, len(data), 3):
            harmed[place] = rng.integers(0, 256)
        path.write_bytes(bytes(harmed))
        with suppress(InputError):  # and nothing else
            load_world(path)


def test_poses_gaze_and_tables_that_no_reader_can_read_are_one_message(tmp_path):
    bad = tmp_path / "poses.txt"
    bad.write_bytes(b"0 1 2\xff 3 0 0 0 1\n")
    with pytest.raises(InputError, match=r"1: must be tx ty tz"):
        read_pose(f"{bad}:1")
    wide = tmp_path / "wide.csv"
    wide.write_text("t_s,x,y_px\n1,2,3,4\n")
    with pytest.raises(StudyError, match="must have the columns x_px and y_px"):
        read_viewer_gaze(str(wide))
    turned = tmp_path / "turned.csv"
    turned.write_bytes(b"t_s,x_px,y_px\n0.1,1,2\r0.2,1,3\r,,\n")
    with suppress(StudyError):  # and nothing else
        load_recording(turned)
    asc = tmp_path / "far.asc"
    screen = "MSG 1 GAZE_COORDS 0 0 1" + "0" * 400 + " 10"
    asc.write_text(f"{screen}\nSTART 1\n1\t1\t1\n2\t1\t1\nEND 2\n")
    with pytest.raises(StudyError, match="must be a whole recording of gaze"):
        load_recording(asc)


@pytest.mark.parametrize("text", ["x = " + "9" * 5000, "x = " + "[" * 3000, "x = '''"])
def test_toml_that_its_parser_cannot_hold_is_one_message(tmp_path, text):
    path = tmp_path / "study.toml"
    path.write_text(text)
    with pytest.raises(StudyError, match="must be valid TOML"):
        load_protocol(path)


@pytest.mark.parametrize("text", ['{"format": ' + "9" * 5000 + "}", "[" * 100_000])
def test_a_manifest_that_its_parser_cannot_hold_is_one_message(tmp_path, text):
    (tmp_path / "manifest.json").write_text(text)
    with pytest.raises(StudyError, match="must be the manifest of a build"):
        read_manifest(tmp_path)


def test_an_exr_header_with_any_byte_harmed_is_read_or_is_one_message(tmp_path):
    path = tmp_path / "p.exr"
    write_pixels(path, np.ones((4, 5, 4), np.float32), ("R", "G", "B", "Z"))
    data = path.read_bytes()
    refused = 0
    for place in range(len(data)):
        path.write_bytes(data[:place] + b"\xd9" + data[place + 1 :])
        for read in (read_pixels, read_parts):
            try:
                read(path)
            except InputError:  # and nothing else
                refused += 1
    assert refused > 20


def test_an_exr_header_that_says_what_no_colour_is_is_one_message(tmp_path):
    path = tmp_path / "p.exr"
    save_colour(path, np.full((4, 5, 3), 0.5, np.float32))
    path.write_bytes(path.read_bytes().replace(b"linear", b"\x1b[31m!", 1))
    for read in (load_colour, read_any):
        with pytest.raises(InputError, match=r"metamerlab:transfer must be linear or encoded"):
            read(path)


@pytest.mark.parametrize("shape", [(0, 5), (3, 0)])
def test_arrays_without_numbers_are_refused(tmp_path, shape):
    np.save(tmp_path / "a.npy", np.zeros(shape, np.float32))
    with pytest.raises(InputError, match=r"must hold at least one number \(is \d x \d\)"):
        load_plane(tmp_path / "a.npy")


@pytest.mark.parametrize("place", ["1e300", "-1e7", "inf"])
def test_gaze_farther_away_than_any_screen_is_refused(tmp_path, place):
    path = tmp_path / "g.csv"
    path.write_text(f"t_s,x_px,y_px\n0,1,1\n0.004,{place},1\n0.008,,\n")
    with pytest.raises(StudyError, match="gaze must be in pixels of the screen"):
        load_recording(path)
    with pytest.raises(StudyError, match="must be two numbers, pixels from"):
        read_viewer_gaze(f"{place},1")


def test_what_a_library_says_is_shown_on_one_line():
    assert visible_line("bad type '\x01'.\nand more") == r"bad type '\x01'"
    assert visible_line(" ") == "no reason given"
    assert len(visible_line("x" * 5000)) == 200


def test_frames_and_videos_are_looked_at_before_they_are_decoded(tmp_path, monkeypatch):
    huge = tmp_path / "huge.png"
    small_file_of_a_huge_picture(huge)
    with pytest.raises(InputError, match="must hold at most"):
        decode_png(huge)
    video = tmp_path / "v.avi"
    writer = cv2.VideoWriter(str(video), cv2.VideoWriter.fourcc(*"MJPG"), 30, (16, 12))
    for _ in range(3):
        writer.write(np.zeros((12, 16, 3), np.uint8))
    writer.release()
    assert len(list(read_frames(video, (16, 12), 3, 30.0))) == 3
    monkeypatch.setenv(LIMITS_VARIABLE, "values=100")
    with pytest.raises(InputError, match="16 x 12 x 3"):
        list(read_frames(video, (16, 12), 3, 30.0))


def test_a_picture_of_too_many_numbers_for_its_bytes_is_refused(tmp_path, monkeypatch):
    path = tmp_path / "flat.png"
    path.write_bytes(b"x" * 1000)
    check_values(path, 90_000_000)
    with pytest.raises(InputError, match=r"numbers in each byte.*METAMERLAB_LIMITS=ratio=200000"):
        check_values(path, 10_000, 5_000, 4)
    monkeypatch.setenv(LIMITS_VARIABLE, "ratio=200000")
    check_values(path, 10_000, 5_000, 4)


def test_a_list_of_a_mesh_that_is_only_stated_is_refused(tmp_path, monkeypatch):
    path = tmp_path / "s.gltf"
    entry = {"componentType": 5126, "count": 400_000_000, "type": "VEC3"}  # no bytes behind it
    square = {"primitives": [{"attributes": {"POSITION": 0}, "mode": 4}]}
    tree = {"asset": {"version": "2.0"}, "accessors": [entry], "meshes": [square],
            "nodes": [{"mesh": 0}], "scenes": [{"nodes": [0]}], "scene": 0}  # fmt: skip
    path.write_text(json.dumps(tree))
    with pytest.raises(InputError, match=r"400,000,000.*METAMERLAB_LIMITS=vertices="):
        load_world(path)
    entry["count"] = "many"
    path.write_text(json.dumps(tree))
    with pytest.raises(InputError, match="no whole number"):
        load_world(path)
    whole = mesh(path)
    assert load_world(whole).parts
    monkeypatch.setenv(LIMITS_VARIABLE, "vertices=2")
    with pytest.raises(InputError, match="longer than 2"):
        load_world(whole)
    monkeypatch.setenv(LIMITS_VARIABLE, "triangles=0")
    with pytest.raises(InputError, match="at most 0 triangles"):
        load_world(whole)


def test_a_file_name_that_is_too_long_is_a_missing_file(tmp_path):
    path = mesh(tmp_path / "s.gltf", images=[{"uri": "m" * 5000}])
    with pytest.raises(InputError, match="that is missing") as caught:
        load_world(path)
    assert len(str(caught.value)) < 1000


def test_a_link_that_leads_to_itself_is_one_message(tmp_path):
    loop = tmp_path / "loop.png"
    loop.symlink_to(loop)
    (tmp_path / "out.png").write_bytes(b"an older one, which must not be the same file")
    asked = ["denoise", "run", loop, "--gaze", "1,1", "--out", tmp_path / "out.png"]
    done = metamerlab(*asked, status=2)
    assert "too many levels of symbolic links" in " ".join(done.output.split())


def test_tables_have_a_limit_of_lines(tmp_path, monkeypatch):
    path = tmp_path / "t.csv"
    path.write_text("t_s,x_px,y_px\n" + "".join(f"{n},1,1\n" for n in range(5)))
    readers = (Table, load_recording, lambda p: read_viewer_gaze(str(p)), read_stimuli)
    assert len(Table(path).rows) == 5
    monkeypatch.setenv(LIMITS_VARIABLE, "rows=5")
    for read in readers:
        with pytest.raises(StudyError, match=r"at most 5 lines.*METAMERLAB_LIMITS=rows=6"):
            read(path)


def test_a_frame_that_no_reader_reads_is_one_message(tmp_path):
    clip = virtual_manifest(DEMO, load_display(DEMO.display.display)).clips[0]
    data = b"\x89PNG\r\n\x1a\nnothing"
    clip = clip.model_copy(update={"frames_sha256": (sha256_bytes(data),)})
    place = tmp_path / clip.frame_path(0)
    place.parent.mkdir(parents=True)
    place.write_bytes(data)
    with pytest.raises(StudyError, match="must be a PNG frame that can be read"):
        read_frame(tmp_path, clip, 0)


def test_the_page_of_limits_has_each_of_them_and_what_commands_take(repository):
    page = (repository / "docs/formats/limits.md").read_text(encoding="utf-8")
    rows = re.findall(r"^\| (.+) \| `(\w+)` \| ([\d,]+) \|$", page, re.M)
    told = [(of, name, f"{most:,}") for name, (most, of) in (LIMITS | FIXED).items()]
    assert rows == told
    for name, (always, each, seconds) in NEEDS.items():
        assert f"| `{name}` | {always >> 20} | {each} | {seconds:g} |" in page


@pytest.mark.parametrize(
    ("name", "value", "said"),
    [
        (LIMITS_VARIABLE, "valeus=4e9", "NAME must be one of values, .* did you mean 'values'"),
        (LIMITS_VARIABLE, "values=nan", "must read NAME=NUMBER"),
        (LIMITS_VARIABLE, "values=-1", "must read NAME=NUMBER"),
        ("METAMERLAB_LIMIT", "values=4e9", "METAMERLAB_LIMIT: must be spelt METAMERLAB_LIMITS"),
        ("METAMERLAB_LIMTS", "values=4e9", "METAMERLAB_LIMTS: must be spelt METAMERLAB_LIMITS"),
    ],
)
def test_a_misspelt_limit_is_named_by_any_command(monkeypatch, name, value, said):
    monkeypatch.setenv(name, value)
    done = metamerlab("protocol", "show", "demo", status=2)
    assert re.search(said, " ".join(done.output.split()))


def flat(path: Path, edge: int) -> Path:
    Image.new("RGB", (edge, edge), (90, 90, 90)).save(path)
    return path


@pytest.mark.parametrize("command", NEEDS)
def test_a_flat_picture_is_refused_where_its_command_would_take_too_much(
    tmp_path, monkeypatch, command
):
    path = flat(tmp_path / "p.png", 200)
    always, each, _ = NEEDS[command]
    monkeypatch.setenv(LIMITS_VARIABLE, f"memory={always + 40_000 * each}")
    check_fits(path, command)
    monkeypatch.setenv(LIMITS_VARIABLE, f"memory={always + 40_000 * each - 1}")
    with pytest.raises(
        InputError, match=rf"200 x 200 px in '{command}'.*METAMERLAB_LIMITS=memory="
    ):
        check_fits(path, command)


def test_a_photograph_is_read_where_a_flat_picture_of_its_size_is_refused(tmp_path, monkeypatch):
    path = tmp_path / "photograph.png"
    noise = np.random.default_rng(1).integers(0, 256, (200, 200, 3), dtype=np.uint8)
    Image.fromarray(noise).save(path)
    monkeypatch.setenv(LIMITS_VARIABLE, "memory=1.5e8")
    check_fits(path, "read")
    with pytest.raises(InputError, match="GB of memory"):
        check_fits(flat(path, 200), "read")


@pytest.mark.parametrize("words", ["foveate p.png o.png", "compress p.png --out o.metamer"])
def test_a_photograph_that_takes_more_memory_than_is_free_is_refused_before_it_is_read(
    tmp_path, monkeypatch, words
):
    noise = np.random.default_rng(1).integers(0, 256, (200, 200, 3), dtype=np.uint8)
    Image.fromarray(noise).save(tmp_path / "p.png")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("pipeline.pictures.decode.read_pixels", None)
    monkeypatch.setattr(psutil, "virtual_memory", lambda: SimpleNamespace(available=-(1 << 40)))
    done = metamerlab(*words.split(), status=2)
    said = " ".join(done.output.split())
    assert re.search(
        r"p\.png: must take at most .* free here \(200 x 200 px .* take 0\.\d+ GB", said
    )
    assert said.endswith("make it smaller, or end other programs")


def test_no_command_refuses_a_picture_that_fits_its_limit():
    for width, height, command in ((1920, 1080, "texture bake"), (2048, 2048, "foveate"),
                                   (1024, 1024, "score"), (512, 512, "denoise"),
                                   (1280, 720, "compress")):  # fmt: skip
        check_need(Path("flat.png"), command, width, height, packed=1)
    for megapixels, command in ((24, "compress"), (34, "foveate"), (67, "texture bake")):
        check_need(Path("photograph.jpg"), command, megapixels, 10**6, packed=megapixels * 150_000)


@pytest.mark.parametrize(
    ("content", "line"),
    [
        ("a." * 20_000 + "a = 1", 1), ("x = 1\n[" + "a." * 20_000 + "a]", 2),
        ('x = 1\ny = {"a" . ' + "'b'." * 33 + "a = 1}", 2),
    ],
)  # fmt: skip
def test_keys_of_many_parts_are_named_before_they_are_parsed(tmp_path, content, line):
    path = tmp_path / "study.toml"
    path.write_text(content)
    with pytest.raises(StudyError, match=rf"line {line}: .*keys of at most 32 parts"):
        load_protocol(path)


@pytest.mark.parametrize("name", ["text", "table", "toml", "files"])
def test_a_file_is_as_large_as_its_limit_allows(tmp_path, monkeypatch, name):
    path = tmp_path / "file"
    path.write_bytes(b"x" * 100)
    monkeypatch.setenv(LIMITS_VARIABLE, f"{name}=100")
    assert bounded_bytes(path, StudyError, name) == b"x" * 100
    monkeypatch.setenv(LIMITS_VARIABLE, f"{name}=99")
    with pytest.raises(StudyError, match=f"at most 99 bytes.*METAMERLAB_LIMITS={name}=100"):
        bounded_bytes(path, StudyError, name)
    with pytest.raises(StudyError, match="at most 99 bytes"):
        bounded_bytes(Path("/dev/zero"), StudyError, name)


def test_lines_of_a_text_are_those_of_a_file():
    for content in ("", "a", "a\nb", "a\r\nb\n", "\n\n", "a\x0bb\u2028c\n"):
        assert list(lines_of(content)) == list(io.StringIO(content, newline="\n"))


@pytest.mark.parametrize("text", ["[" * 100_000, "{" * 5, "9" * 5000])
def test_json_that_no_parser_holds_is_one_message(tmp_path, text):
    table = tmp_path / "decisions.csv"
    table.with_suffix(".json").write_text(text)
    with pytest.raises(StudyError, match="must be what 'metamerlab analysis import' notes"):
        read_note(table)
    (tmp_path / "power.json").write_text(text)
    asked = ["protocol", "preregister", "demo", "--power", tmp_path, "--out", tmp_path / "p.html"]
    done = metamerlab(*asked, status=2)
    assert "power.json: must be JSON" in " ".join(done.output.split())
    (tmp_path / "results.json").write_text(text)
    with pytest.raises(StudyError, match=r"results\.json: must be the results\.json of a report"):
        _scores(tmp_path, "jod", None)


def test_json_of_more_values_than_the_limit_is_not_parsed(tmp_path, monkeypatch):
    monkeypatch.setenv(LIMITS_VARIABLE, "cells=10")
    assert parsed_json(tmp_path, b"[1, 2, [3]]", "it", StudyError) == [1, 2, [3]]
    with pytest.raises(StudyError, match="at most 10 values"):
        parsed_json(tmp_path, b"[" + b"[]," * 9 + b"0]", "it", StudyError)


def test_a_journal_has_a_limit_of_lines_and_is_not_lost(tmp_path, monkeypatch):
    path = tmp_path / "journal.jsonl"
    path.write_text("{}\n" * 6)
    monkeypatch.setenv(LIMITS_VARIABLE, "events=5")
    with pytest.raises(StudyError, match=r"at most 5 lines.*METAMERLAB_LIMITS=events=6"):
        read_journal(path)
    (damage,) = read_journal(path, lenient=True).damaged
    assert "at most 5 lines" in damage.reason
    assert path.read_text() == "{}\n" * 6


def mesh(path: Path, **parts: object) -> Path:
    """A glTF file of one triangle, some of whose parts are others."""
    data = base64.b64encode(struct.pack("<9f", 0, 0, 0, 1, 0, 0, 0, 1, 0)).decode()
    tree = {
        "asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": [0]}], "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}}]}],
        "accessors": [{"componentType": 5126, "count": 3, "type": "VEC3", "bufferView": 0}],
        "bufferViews": [{"buffer": 0, "byteLength": 36}],
        "buffers": [{"byteLength": 36, "uri": f"data:application/octet-stream;base64,{data}"}],
    }  # fmt: skip
    path.write_text(json.dumps(tree | parts))
    return path


@pytest.mark.parametrize(
    ("parts", "said"),
    [
        ({"accessors": [{"componentType": 5126, "count": 45_000_000, "type": "VEC3"}]},
         "GB of memory"),
        ({"nodes": [{"children": [1]}, {"children": [0], "mesh": 0}]}, "is its own"),
        ({"nodes": [{"children": [2]}, {"children": [2]}, {"mesh": 0}]}, "the child of one other"),
        ({"nodes": [{"mesh": 0}] * 10_001}, r"at most 10,000 meshes, nodes.*nodes=10001"),
        ({"bufferViews": [{"buffer": 0, "byteLength": 10**11}] * 9}, "GB of memory"),
    ],
)  # fmt: skip
def test_a_mesh_is_held_to_its_document_before_any_reader(tmp_path, monkeypatch, parts, said):
    path = mesh(tmp_path / "s.gltf")
    assert load_world(path).parts
    monkeypatch.setattr(trimesh, "load_scene", None)
    with pytest.raises(InputError, match=said):
        load_world(mesh(path, **parts))


def test_nodes_may_lie_deep_in_each_other(tmp_path):
    deep = [{"children": [n + 1], "translation": [0.01, 0, 0]} for n in range(2000)]
    (part,) = load_world(mesh(tmp_path / "s.gltf", nodes=[*deep, {"mesh": 0}])).parts
    assert part.mesh.position_m[:, 0].min() == pytest.approx(20, abs=1e-4)


def test_a_texture_counts_once_for_each_material_that_has_it(tmp_path, monkeypatch):
    flat(tmp_path / "t.png", 100)
    material = {"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}}
    parts = {"images": [{"uri": "t.png"}], "textures": [{"source": 0}], "materials": [material] * 9}
    path = mesh(tmp_path / "s.gltf", **parts)
    monkeypatch.setattr("pipeline.pictures.size_limits.MEMORY_FOR_A_BYTE_OF_A_MESH", 0)
    monkeypatch.setenv(LIMITS_VARIABLE, "memory=1.6e6")
    assert load_world(path).parts
    monkeypatch.setenv(LIMITS_VARIABLE, "memory=1.5e6")
    with pytest.raises(InputError, match="its pictures, each as often as it is used"):
        load_world(path)


PLAYLISTS = {
    "ffconcat": "ffconcat version 1.0\nfile v.avi\n",
    "HLS": "#EXTM3U\n#EXT-X-TARGETDURATION:9\n#EXTINF:9,\nv.avi\n#EXT-X-ENDLIST\n",
    "SDP": "v=0\nc=IN IP4 127.0.0.1\nm=video 9 RTP/AVP 96\n",
    "DASH": "<?xml version='1.0'?><MPD></MPD>\n",
    "half a video": "RIFF....AVI \n#EXTM3U\nv.avi\n",
}


@pytest.mark.parametrize("ending", ["avi", "mp4", "mkv"])
@pytest.mark.parametrize("kind", PLAYLISTS)
def test_a_video_that_is_a_list_of_others_is_refused_under_any_ending(tmp_path, kind, ending):
    video = tmp_path / "v.avi"
    writer = cv2.VideoWriter(str(video), cv2.VideoWriter.fourcc(*"MJPG"), 30, (16, 12))
    writer.write(np.zeros((12, 16, 3), np.uint8))
    writer.release()
    assert len(VideoFrames(video)) == 1
    path = tmp_path / f"clip.{ending}"
    path.write_text(PLAYLISTS[kind])
    for read in (
        VideoFrames, lambda path: list(read_frames(path, (16, 12), 1, 30.0)),
        lambda path: unpacked_video(path).__enter__(), lambda path: stated(path, 30.0),
    ):  # fmt: skip
        with pytest.raises(InputError, match="no list of others"):
            read(path)


@pytest.mark.parametrize("command", ["foveate blur", "foveate metamer", "foveate"])
def test_a_slide_of_a_camera_s_size_is_taken_as_a_small_jpeg(tmp_path, command):
    """Two words on white: 45 pixels in each byte, as slides and posters have."""
    page = Image.new("RGB", (4200, 2800), (250, 250, 250))
    ImageDraw.Draw(page).text((200, 300), "A slide " * 9, fill=(20, 40, 160), font_size=240)
    page.save(tmp_path / "slide.jpg", quality=85)
    assert 20 < 4200 * 2800 / (tmp_path / "slide.jpg").stat().st_size < 60
    check_fits(tmp_path / "slide.jpg", command)
