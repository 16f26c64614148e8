"""The proof of a graphics card, tried on the software renderer."""

import json
import os
import resource
import signal
import subprocess
import sys
import time
import zipfile

import numpy as np
import pytest

from benchmarks import prove_gpu
from benchmarks.gpu import NAMES
from benchmarks.prove_gpu import CannotError, Proof, missing, run, take_wheels
from benchmarks.twin_report import largest_difference

QUICK_NAMES = {(bench, name) for bench in NAMES for name in ("copy", *NAMES[bench])}
PLANTED = """
import numpy as np
import pytest

@pytest.fixture
def shared_gl_context():
    return None

def test_twin_that_agrees(shared_gl_context):
    np.testing.assert_array_equal([1.0, 2.0], [1.0, 2.0])

def test_twin_that_differs(shared_gl_context):
    found, wanted = np.zeros((2, 3)), np.full((2, 3), 0.25)
    wanted[1, 2] = -0.75
    assert (np.abs(found - wanted) <= 0.1).all()

def test_of_numpy_alone():
    assert False
"""


@pytest.fixture(scope="session")
def command(repository, tmp_path_factory):
    """Give a function that runs ``script/prove-gpu``, with no display to open."""
    out = tmp_path_factory.mktemp("proof")

    def prove(*words, **changes):
        env = {key: value for key, value in os.environ.items() if key != "DISPLAY"}
        return subprocess.run(
            [repository / "script/prove-gpu", *words, "--out", out],
            env=env | {"PYTHON": sys.executable} | changes,
            capture_output=True,
            text=True,
            check=False,
        ), out

    return prove


def proof_in(folder, left_s):
    return Proof(
        path=folder / "device.json",
        record={},
        env=dict(os.environ),
        work=folder,
        ends_s=time.monotonic() + left_s,
    )


@pytest.mark.slow
def test_a_quick_proof_names_the_device_and_measures_every_frame(command, gl_context):  # noqa: ARG001
    done, out = command("--quick", "--sizes", "64")

    assert done.returncode == 0, done.stderr
    (file,) = out.iterdir()
    found = json.loads(file.read_text())
    assert file.stem == prove_gpu.device_name(found["renderer"]["name"])
    assert found["revision"]
    assert found["libraries"]["moderngl"]
    assert {check["check"] for check in found["doctor"]["findings"]} >= {"OpenGL off-screen"}
    assert {(row["bench"], row["name"]) for row in found["rows"]} == QUICK_NAMES
    assert found["failed"] == found["not_run"] == []
    for row in found["rows"]:
        assert row["frame_ms"] > 0
        if row["name"] != "telea":
            assert row["python_calls"] > 10
            assert row["host_ms"] > 0
            assert row["gpu_ms"] == pytest.approx(
                sum(item["least_ms"] for item in row["passes"]), rel=1e-4
            )
    assert "metamer" in done.stdout


@pytest.mark.slow
def test_a_driver_that_is_too_old_gets_one_message(command, gl_context):  # noqa: ARG001
    done, out = command("--quick", MESA_GL_VERSION_OVERRIDE="4.2")

    assert done.returncode == 2
    (line,) = done.stderr.splitlines()
    assert line.startswith("error: OpenGL 4.3 through EGL is needed (found: ")
    assert "install a driver" in line
    assert done.stdout == ""
    assert not list(out.glob("*.part"))


def test_a_compute_shader_that_does_not_work_is_told(gl_context, monkeypatch):
    from benchmarks import gpu
    from pipeline.errors import GLUnavailableError

    gpu.check_compute(gl_context)
    monkeypatch.setattr(gpu.Copy, "__call__", lambda *_: None)

    with pytest.raises(GLUnavailableError, match=r"compute shaders must work .* came out changed"):
        gpu.check_compute(gl_context)


def test_a_full_disk_is_told_before_anything_is_measured(tmp_path):
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (4096, limits[1]))
    try:
        with pytest.raises(CannotError, match=r"must be a folder with room for 1 MiB"):
            prove_gpu.reserve(tmp_path / "new")
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
    prove_gpu.reserve(tmp_path / "new")
    assert list((tmp_path / "new").iterdir()) == []


def test_missing_packages_are_named_with_what_they_need():
    assert missing(["numpy"]) == {}
    found = missing(["no-such-package>=1", "numpy>=999", "rich; python_version < '3'"])
    assert found["no-such-package>=1"] == "not installed"
    assert found["numpy>=999"] == f"{np.__version__} is installed"
    assert len(found) == 2

    words = prove_gpu.missing_words(found)
    assert "'no-such-package>=1' 'numpy>=999'" in words
    assert "script/prove-gpu --wheels" in words


def test_every_package_of_the_project_is_asked_for():
    assert missing(prove_gpu.requirements()) == {}
    names = " ".join(prove_gpu.requirements())
    assert all(name in names for name in ("moderngl", "pytest-timeout", "hypothesis", "pydantic"))


def make_wheel(folder, name, requires=()):
    info = f"{name}-1.0.dist-info"
    needs = "".join(f"Requires-Dist: {one}\n" for one in requires)
    texts = {
        f"{name}.py": "",
        f"{info}/METADATA": f"Metadata-Version: 2.1\nName: {name}\nVersion: 1.0\n{needs}",
        f"{info}/WHEEL": "Wheel-Version: 1.0\nRoot-Is-Purelib: true\nTag: py3-none-any\n",
    }
    record = "".join(f"{file},,\n" for file in (*texts, f"{info}/RECORD"))
    with zipfile.ZipFile(folder / f"{name}-1.0-py3-none-any.whl", "w") as file:
        for place, text in (texts | {f"{info}/RECORD": record}).items():
            file.writestr(place, text)


@pytest.mark.slow
def test_missing_packages_come_from_a_folder_with_all_that_they_need(tmp_path):
    wheels, site = tmp_path / "wheels", tmp_path / "site"
    wheels.mkdir()
    make_wheel(wheels, "thing", ["another>=1"])

    with pytest.raises(CannotError, match=r"or in .*wheels \(found another>=1: not installed\)"):
        take_wheels(wheels, ["thing"], site)
    make_wheel(wheels, "another")
    take_wheels(wheels, ["thing"], site)

    assert missing(["thing"], site) == {}
    assert {path.stem for path in site.glob("*.py")} == {"thing", "another"}
    with pytest.raises(CannotError, match="must be a folder of wheels"):
        take_wheels(tmp_path / "none", ["thing"], site)


def test_what_has_no_time_left_is_named(tmp_path):
    proof = proof_in(tmp_path, left_s=0)

    prove_gpu.frames(proof, [512, 1024], repeats=1)

    assert len(proof.not_run) == 2 * len(prove_gpu.BENCHES)
    assert "foveate at 1024 px" in proof.not_run


def test_a_crash_and_a_hang_are_results():
    crash = run(dict(os.environ), ["-c", f"import os; os.kill(os.getpid(), {signal.SIGSEGV})"])
    assert prove_gpu.how_it_ended(*crash) == "the driver or a library crashed (SIGSEGV)"

    endless = "print('so far', flush=True); import time; time.sleep(60)"
    hang = run(dict(os.environ), ["-c", endless], 1.0)
    assert prove_gpu.how_it_ended(*hang) == "time ran out: so far"


@pytest.mark.slow
def test_twins_that_differ_come_with_their_largest_difference(tmp_path, monkeypatch):
    file = tmp_path / "test_planted_twins.py"
    file.write_text(PLANTED)
    monkeypatch.setattr(prove_gpu, "TWINS", (str(file),))
    monkeypatch.setattr(prove_gpu, "MOST_WORKERS", 1)
    proof = proof_in(tmp_path, left_s=60)
    proof.env["PYTHONPATH"] = str(prove_gpu.ROOT)

    prove_gpu.twins(proof, most_s=60)

    found = proof.record["twins"]
    assert (found["tests"], found["passed"], found["failed"]) == (2, 1, 1)
    assert found["failures"][0]["largest"] == 0.75
    assert found["not_run"] == []
    assert len(proof.failed) == 1
    assert "test_twin_that_differs: largest difference 0.75" in proof.failed[0]
    assert json.loads(proof.path.read_text())["failed"] == proof.failed


def in_a_frame(compare):
    """Give the frames of a failed comparison."""
    try:
        compare(np.array([0.0, 1.0, 2.0]), np.array([0.0, 1.5, 2.0]))
    except AssertionError as error:
        frames, trace = [], error.__traceback__
        while trace is not None:
            frames.append(trace.tb_frame)
            trace = trace.tb_next
        return frames
    raise ValueError("did not fail")


def by_allclose(found, wanted):
    np.testing.assert_allclose(found, wanted)


def by_bytes(found, wanted):
    assert found.tobytes() == wanted.tobytes()


def by_parts(found, wanted):
    assert np.abs(found[1:] - wanted[1:]).max() < 0.1


def by_words(found, wanted):
    assert str(found) == str(wanted)


@pytest.mark.parametrize(
    ("compare", "largest"), [(by_allclose, 0.5), (by_bytes, 0.5), (by_parts, 0.5), (by_words, None)]
)
def test_the_largest_difference_is_that_of_the_arrays_compared(compare, largest):
    assert largest_difference(in_a_frame(compare)) == largest


@pytest.mark.parametrize(
    ("renderer", "name"),
    [
        ("NVIDIA H100 80GB HBM3/PCIe/SSE2", "nvidia-h100-80gb-hbm3"),
        ("llvmpipe (LLVM 15.0.6, 256 bits)", "llvmpipe"),
        ("AMD Radeon RX 7900 XTX (radeonsi, navi31, LLVM 17)", "amd-radeon-rx-7900-xtx"),
        ("///", "device"),
    ],
)
def test_results_are_named_by_the_device(renderer, name):
    assert prove_gpu.device_name(renderer) == name
