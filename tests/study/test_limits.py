"""No file and no number asks for more than the machine has, and every reader says what is wrong."""

from __future__ import annotations

import gzip
import re
import struct
import subprocess
import sys
import zlib
from contextlib import suppress
from pathlib import Path

import numpy as np
import pytest
import trimesh
from PIL import Image
from typer.testing import CliRunner

from analysis.export.bids_gaze import read_samples
from pipeline.errors import InputError
from pipeline.image_file import read_pixels
from pipeline.limits import VARIABLE, check_values
from protocols.errors import StudyError
from protocols.feasibility import virtual_manifest
from protocols.hashing import sha256_bytes
from protocols.journal import SideFile
from protocols.limits import unpacked
from protocols.load import load_display, load_protocol, shipped
from protocols.plan import make_plan, planned_trials
from stimuli.scenes.mesh_file import load_world
from stimuli.scenes.stereo import _load_disparity
from study_app.cli import app
from study_app.gaze.recording import load_recording
from study_app.session import RunTrial, next_step

DEMO = load_protocol(Path("demo"))


def demo_file(tmp_path: Path, **changes: str) -> Path:
    text = shipped("studies")["demo"].read_text(encoding="utf-8")
    for key, value in changes.items():
        text, count = re.subn(rf"^{key} = .*$", f"{key} = {value}", text, flags=re.M)
        assert count == 1
    path = tmp_path / "study.toml"
    path.write_text(text, encoding="utf-8")
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
    path = demo_file(tmp_path, repeats="1_000_000_000")
    more = ["--out", tmp_path / "x.html"] if command == "preregister" else []
    done = CliRunner().invoke(app, ["protocol", command, str(path), *map(str, more)])

    assert done.exit_code == 2
    assert "at most 100,000 trials" in done.output


def test_the_limit_on_trials_is_raised_by_the_environment(monkeypatch):
    study = DEMO.model_copy(update={"design": DEMO.design.model_copy(update={"repeats": 50})})
    monkeypatch.setenv(VARIABLE, "values=9, trials=100")
    with pytest.raises(StudyError, match="at most 100 trials"):
        planned_trials(study, "P01", 0)
    monkeypatch.setenv(VARIABLE, "trials=1e5")
    assert len(planned_trials(study, "P01", 0)) > 100
    monkeypatch.setenv(VARIABLE, "trials=many")
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
        "import resource, sys; from pathlib import Path; from pipeline.image_file import"
        " read_pixels\nfrom pipeline.errors import InputError\n"
        "try: read_pixels(Path(sys.argv[1]))\nexcept InputError as error: print(error)\n"
        "print(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss // 1024)"
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
    monkeypatch.setenv(VARIABLE, "values=3599")
    with pytest.raises(InputError, match=r"40 x 30 x 3.*METAMERLAB_LIMITS=values=3600"):
        read_pixels(path)
    monkeypatch.setenv(VARIABLE, "values=3600")
    assert read_pixels(path).data.shape == (30, 40, 3)
    with pytest.raises(InputError, match="says that it holds -1 x 5"):
        check_values(path, -1, 5)


def test_numpy_files_are_looked_at_before_they_are_unpacked(tmp_path, monkeypatch):
    np.save(tmp_path / "a.npy", np.ones((4, 5), np.float32))
    np.savez_compressed(tmp_path / "a.npz", np.zeros((1000, 1000), np.float32))
    np.save(tmp_path / "objects.npy", np.array([{}], dtype=object), allow_pickle=True)
    (tmp_path / "cut.npz").write_bytes((tmp_path / "a.npz").read_bytes()[:-30])
    (tmp_path / "bad.npy").write_bytes(b"\x93NUMPY\x01\x00v\x00{'descr': " + b" " * 200)

    assert _load_disparity(tmp_path / "a.npy")[0].shape == (4, 5)
    assert _load_disparity(tmp_path / "a.npz")[0].shape == (1000, 1000)
    for name in ("objects.npy", "cut.npz", "bad.npy"):
        with pytest.raises(InputError, match="must be a numpy file of one array"):
            _load_disparity(tmp_path / name)
    monkeypatch.setenv(VARIABLE, "values=1000")
    with pytest.raises(InputError, match="at most 1,000 numbers"):
        _load_disparity(tmp_path / "a.npz")
    monkeypatch.setenv(VARIABLE, "values=19")
    with pytest.raises(InputError, match="4 x 5"):
        _load_disparity(tmp_path / "a.npy")


def test_gzip_files_unpack_to_a_limit(tmp_path, monkeypatch):
    data = b"t_s,x_px,y_px\n" + b"0" * 5_000_000
    packed = gzip.compress(data)
    path = tmp_path / "g.csv.gz"

    assert unpacked(packed, path) == data
    assert unpacked(packed + gzip.compress(b"more"), path) == data + b"more"
    assert unpacked(b"", path) == b""
    for broken in (packed[:-9], packed[: len(packed) // 2], b"text", packed[:4] + b"\xff" * 40):
        with pytest.raises(StudyError, match="must be a whole gzip file"):
            unpacked(broken, path)
    monkeypatch.setenv(VARIABLE, "unpacked=4e6")
    with pytest.raises(StudyError, match="must unpack to at most 4,000,000 bytes"):
        unpacked(packed, path)


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


@pytest.mark.parametrize("index", ["7", "-9", "0", "99999999999999999999", "x"])
def test_faces_of_an_obj_that_lead_nowhere_are_one_message(tmp_path, index):
    path = tmp_path / "s.obj"
    path.write_text(f"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 {index}\n")
    with suppress(InputError):  # and nothing else
        load_world(path)


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
