"""The options and fixtures of conftest.py do what they promise."""

import os
import re
import signal
import subprocess
import sys
from collections import Counter

import forked
import pytest

NO_GL = """

def create_context():
    raise GLUnavailableError("no driver here")
"""

PROOFS = """
import pytest

@pytest.mark.full
def test_whole():
    pass

@pytest.mark.slow
def test_slow():
    pass

def test_counts(proof_count, full):
    print("counts", proof_count(500), proof_count(3), full)
"""


@pytest.fixture
def run_pytest(repository, tmp_path):
    """Run a test file under a copy of our conftest.py; return pytest's exit status and output."""

    def run(source: str, *options: str, conftest: str = "", **env: str) -> tuple[int, str]:
        ours = (repository / "tests/conftest.py").read_text(encoding="utf-8")
        (tmp_path / "conftest.py").write_text(ours + conftest)
        (tmp_path / "test_made_up.py").write_text(source)
        markers = "[pytest]\nmarkers =\n  full: a long proof\n  slow: takes seconds\n"
        (tmp_path / "pytest.ini").write_text(markers)
        inherited = {key: value for key, value in os.environ.items() if key != "REQUIRE_GL"}
        done = subprocess.run(
            [sys.executable, "-m", "pytest", "-rs", "-s", "-p", "no:cacheprovider", *options],
            cwd=tmp_path,
            env=inherited | env,
            capture_output=True,
            text=True,
            timeout=120,
        )
        return done.returncode, done.stdout

    return run


def test_without_opengl_a_test_that_needs_it_skips_and_says_why(run_pytest):
    status, output = run_pytest("def test_a(gl_context): pass", conftest=NO_GL)

    assert status == 0
    assert "1 skipped" in output
    assert "no driver here" in output


def test_without_opengl_a_test_that_needs_it_fails_where_opengl_is_required(run_pytest):
    status, output = run_pytest("def test_a(gl_context): pass", conftest=NO_GL, REQUIRE_GL="1")

    assert status == 1
    assert "REQUIRE_GL=1, and there is no usable OpenGL: no driver here" in output


def test_by_default_long_proofs_run_a_tenth_and_slow_tests_not_at_all(run_pytest):
    _, output = run_pytest(PROOFS)

    assert "counts 50 1 False" in output
    assert "1 passed, 2 skipped" in output
    assert "takes seconds: script/test --slow runs it" in output


@pytest.mark.parametrize(
    "words", [("--slow",), ("test_made_up.py",), ("-n", "1", "test_made_up.py")]
)
def test_slow_tests_run_where_they_are_asked_for_or_named(run_pytest, words):
    _, output = run_pytest(PROOFS, *words)

    assert "2 passed, 1 skipped" in output
    assert "a long proof: script/test --full runs it" in output


def test_long_proofs_run_whole_when_asked(run_pytest):
    _, output = run_pytest(PROOFS, "--full")

    assert "counts 500 3 True" in output
    assert "3 passed" in output


def test_the_short_run_takes_the_middle_case_of_a_test_and_long_ones_by_name(run_pytest):
    source = """
import pytest

@pytest.mark.parametrize("case", ["empty", "middle", "odd"])
def test_cases(case):
    print("ran", case)

@pytest.mark.slow
@pytest.mark.parametrize("case", ["named", "other"])
def test_long(case):
    print("ran", case)
"""
    named = "\nEIGHT = ('test_made_up.py::test_long[named]',)\n"
    status, output = run_pytest(source, "--short", conftest=named)

    assert status == 0
    assert re.findall("ran (\\w+)", output) == ["middle", "named"]
    assert "2 passed, 3 deselected" in output


def test_the_short_run_reads_no_test_of_the_repository(run_pytest):
    left_out = "\nABOUT_THE_REPOSITORY = ('test_made_up.py',)\n"
    status, output = run_pytest("raise RuntimeError('was read')", "--short", conftest=left_out)

    assert status == 5
    assert "was read" not in output


def test_files_that_begin_first_are_there(repository):
    text = (repository / "tests/conftest.py").read_text(encoding="utf-8")
    first = re.findall(r'^    "(tests/.*\.py)",$', text, flags=re.MULTILINE)

    assert len(first) > 20
    assert [name for name in first if not (repository / name).is_file()] == []


def test_names_of_test_files_are_unique(repository):
    """pytest and people find a file by its name alone."""
    names = Counter(path.name for path in (repository / "tests").rglob("test_*.py"))
    assert [name for name, count in names.items() if count > 1] == []


SCHEDULED = """
import os, time
import pytest

@pytest.mark.parametrize("number", range(3))
def test_one(number, request):
    time.sleep(0.02)
    with (request.config.rootpath / "ran").open("a") as file:
        print(request.node.nodeid, os.environ["PYTEST_XDIST_WORKER"], os.nice(0), file=file)
"""


@pytest.mark.slow
def test_tests_that_wait_come_first_one_worker_a_folder_and_one_ends_with_them(
    run_pytest, tmp_path
):
    waiting = ("presenter/test_a", "presenter/test_b", "web/test_c", "web/test_d")
    for path in (*waiting, *(f"test_{number}" for number in range(12))):
        file = tmp_path / "tests" / f"{path}.py"
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(SCHEDULED)

    status, _ = run_pytest("", "-n", "4", "tests")

    assert status == 0
    ran = [line.split() for line in (tmp_path / "ran").read_text().splitlines()]
    assert len(ran) == 3 * 16
    workers = {
        folder: {worker for name, worker, _ in ran if name.startswith(f"tests/{folder}/")}
        for folder in ("presenter", "web")
    }
    assert [len(names) for names in workers.values()] == [1, 1]
    assert not workers["presenter"] & workers["web"]
    waited = set.union(*workers.values())
    assert len({worker for name, worker, _ in ran if name.startswith("tests/test_")} & waited) <= 1
    mine = os.nice(0)
    for name, _, niceness in ran:
        behind = name.startswith("tests/test_")
        assert int(niceness) == (max(mine, 5) if behind else mine), name


def test_every_test_starts_from_the_same_random_numbers(run_pytest):
    source = "def test_a(rng): print('drew', rng.random())\ntest_b = test_a\n"
    _, output = run_pytest(source)

    drawn = [line.split()[-1] for line in output.splitlines() if "drew" in line]
    assert len(drawn) == 2
    assert len(set(drawn)) == 1


LEAKS = """
def test_tidy(gl_context):
    gl_context.texture((2, 2), 4).release()

def test_texture(gl_context):
    for _ in range(600):  # names run on, and the watch with them
        gl_context.texture((2, 2), 4).release()
    gl_context.texture((2, 2), 4)

def test_tidy_after_another_left_something(gl_context):
    gl_context.buffer(reserve=4).release()

def test_error(gl_context):
    gl_context.texture((1, 1 + gl_context.info["GL_MAX_TEXTURE_SIZE"]), 1).release()
"""


@pytest.mark.usefixtures("gl_context")  # skips without OpenGL
def test_a_test_that_leaves_gl_objects_or_errors_behind_is_an_error(run_pytest):
    status, output = run_pytest(LEAKS)

    assert status == 1
    assert "4 passed, 2 errors" in output
    assert "AssertionError: GL objects left alive: texture" in output
    assert "AssertionError: GL error left unread: GL_INVALID_VALUE" in output


COSTLY = """
import subprocess, sys
BURN = "import time\\nwhile time.process_time() < 1.2: pass"

def test_its_process_is_slow():
    subprocess.run([sys.executable, "-c", BURN], check=True)

def test_quick():
    pass
"""


@pytest.mark.slow
@pytest.mark.parametrize("workers", [(), ("-n", "1")], ids=["here", "in a worker"])
def test_costs_count_processes_that_a_test_starts(run_pytest, workers):
    status, output = run_pytest(COSTLY, "--costs", *workers)

    assert status == 0
    assert "2 tests took" in output
    costs = dict(
        reversed(line.strip("| ").split(" | ")) for line in output.splitlines() if "| `" in line
    )
    assert float(costs["`test_made_up.py`: its process is slow"]) >= 1
    assert float(costs["`test_made_up.py`"]) >= 1
    assert "`test_made_up.py`: quick" not in costs


@pytest.mark.slow
@pytest.mark.parametrize("workers", [(), ("-n", "1")], ids=["here", "in a worker"])
def test_a_run_of_all_names_what_takes_long_and_is_not_marked(run_pytest, workers):
    marked = COSTLY.replace("def test_its", "import pytest\n\n@pytest.mark.slow\ndef test_its")
    quick = "\nloop_ms = lambda: REFERENCE_LOOP_MS / 2\n"  # a machine twice as fast
    status, output = run_pytest(COSTLY, "--slow", *workers, conftest=quick)
    assert status == 0
    assert re.search(r"above 0\.8 CPU s =+\n+1\.5 s where a loop takes 11 ms", output)
    assert re.search(
        r"^\d\.\d s  test_made_up\.py::test_its_process_is_slow$", output, re.MULTILINE
    )
    for source, conftest in ((marked, quick), (COSTLY, quick.replace("/ 2", "* 200"))):
        assert "not marked slow" not in run_pytest(source, "--slow", *workers, conftest=conftest)[1]


HABITS = """
import atexit, os, sys
atexit.register(print, "over")
print(os.getcwd(), os.environ["SAID"], sys.argv[1:])
print("wrong", file=sys.stderr)
"""


@pytest.mark.parametrize("kind", [forked.Forked, forked.Started])
def test_a_forked_process_is_one_of_its_own(tmp_path, monkeypatch, kind):
    """So is one that is started anew, where Python cannot fork so."""
    monkeypatch.setattr(forked, "Forked", kind)
    env = {**os.environ, "SAID": "so"}
    for last, status, told in (
        ("", 0, ""), ("sys.exit(3)", 3, ""), ("sys.exit('no')", 1, "no\n"), ("1 / 0", 1, "Division")
    ):  # fmt: skip
        done = forked.run("a", 1, code=HABITS + last, env=env, folder=tmp_path)
        assert (done.returncode, done.stdout) == (status, f"{tmp_path} so ['a', '1']\nover\n")
        assert done.stderr.startswith("wrong\n")
        assert told in done.stderr
    process = forked.Forked(code="import time; time.sleep(60)")
    with pytest.raises(subprocess.TimeoutExpired):
        process.communicate(timeout=0.05)
    assert process.poll() is None
    process.kill()
    assert (process.communicate(), process.returncode) == (("", ""), -signal.SIGKILL)
    with pytest.raises(subprocess.TimeoutExpired):
        forked.run(code="import time; time.sleep(60)", timeout=0.05)


@pytest.mark.skipif(sys.platform != "linux", reason="processes are not forked here")
def test_a_forked_process_that_nobody_waits_for_leaves_nothing_open():
    process = forked.Forked(code="import time; time.sleep(60)")
    told, written = process._told, process._written
    process.kill()
    process.returncode = None  # as where the test failed before it waited
    del process

    assert told.closed
    for each in written:
        with pytest.raises(OSError, match="Bad file descriptor"):
            os.fstat(each)


def test_costs_count_forked_processes():
    before_s = sum(forked.COSTS_S)
    forked.run(code="import time\nwhile time.process_time() < 0.5: pass")

    assert sum(forked.COSTS_S) - before_s >= 0.4
