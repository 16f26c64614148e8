"""Fixtures and options that every test may use."""

from __future__ import annotations

import ctypes
import gc
import json
import os
import subprocess
import sys
from collections import Counter
from collections.abc import Callable, Generator, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, ClassVar

import hypothesis
import moderngl
import numpy as np
import pytest

from pipeline.errors import GLUnavailableError
from pipeline.frame import SourceFrame
from pipeline.gl.context import create_context, release_context
from study_app.doctor.python_speed import loop_ms

# Shell scripts, and kills by the signals of POSIX.
POSIX_ONLY = ["test_attack.py", "test_prove_gpu.py", "test_release.py", "test_scripts.py"]
collect_ignore = POSIX_ONLY if sys.platform == "win32" else []
# Tests of the repository itself: whoever only wants to know if it works here does without them.
ABOUT_THE_REPOSITORY = (
    "test_attack.py", "test_budgets.py", "test_docs.py", "test_first_words.py", "test_fixtures.py",
    "test_installed_wheel.py", "test_layers.py", "test_names.py", "test_one_set_of_blocks.py",
    "test_packaging.py", "test_prove_gpu.py", "test_readme_table.py", "test_references.py",
    "test_release.py", "test_revision.py", "test_scripts.py", "test_site.py", "test_tutorials.py",
)  # fmt: skip

REPOSITORY = Path(__file__).resolve().parents[1]

# Files that take longest, as `script/test --costs` tells: they begin first.
LONGEST = (
    "tests/test_demo.py",
    "tests/presenter/test_guide.py",
    "tests/web/test_browser_sessions.py",
    "tests/presenter/test_every_task_was_shown.py",
    "tests/web/test_browser_pixels.py",
    "tests/test_attack.py",
    "tests/test_tutorials.py",
    "tests/stats/reports/test_task_reports.py",
    "tests/test_docs.py",
    "tests/batch/test_stimuli_build.py",
    "tests/presenter/test_panorama_study.py",
    "tests/web/test_browser_storage.py",
    "tests/web/test_kernel_twin.py",
    "tests/web/test_web_tutorial.py",
    "tests/web/test_metamer_page.py",
    "tests/presenter/test_a_labs_study.py",
    "tests/presenter/test_live_trials.py",
    "tests/foveation/test_foveation_gpu.py",
    "tests/stats/reports/test_report.py",
    "tests/score/test_score_libraries.py",
    "tests/twins/test_warp_gpu.py",
    "tests/study/test_kills_by_task.py",
    "tests/product/test_new_study_tasks.py",
    "tests/test_site.py",
    "tests/batch/test_without_opengl.py",
    "tests/product/test_arrival_is_hidden.py",
    "tests/stats/test_csv_commands.py",
    "tests/stats/models/test_reaction_models.py",
    "tests/twins/test_metameric_gpu.py",
    "tests/twins/test_inpaint_gpu.py",
    "tests/test_metameric_invariants.py",
    "tests/batch/test_beyond_blur_stimuli.py",
    "tests/product/test_own_material.py",
    "tests/batch/test_foveated_recipe.py",
    "tests/score/test_score_foveated.py",
    "tests/test_prove_gpu.py",
    "tests/foveation/test_live_stimuli.py",
    "tests/stats/models/test_margins_and_ratios.py",
    "tests/study/test_rating_task.py",
    "tests/test_installed_wheel.py",
    "tests/stats/test_analysis_cli.py",
    "tests/product/test_own_photographs.py",
    "tests/product/test_reproducibility_page.py",
)
# Long ones that touch each kind once, in the short run.
EIGHT = (
    "tests/presenter/test_every_task_was_shown.py"
    "::test_another_process_sees_every_logged_flip_with_the_hashed_frames[two-alternative stills]",
    "tests/presenter/test_every_task_was_shown.py"
    "::test_window_painter_and_preview_show_the_same_pixels[two-alternative stills]",
    "tests/web/test_browser_sessions.py"
    "::test_a_session_of_every_task_comes_home_from_chromium[yes-no]",
    "tests/study/test_kills_by_task.py"
    "::test_disturbed_anywhere_it_goes_on_as_it_would_have[two-interval-killed]",
    "tests/stats/reports/test_report.py::test_the_page_needs_nothing_from_outside",
    "tests/batch/test_stimuli_build.py::test_a_batch_holds_every_clip_of_its_protocol",
    "tests/twins/test_metameric_gpu.py::test_fill_on_gpu_matches_reference[size7]",
    "tests/foveation/test_foveation_gpu.py"
    "::test_metamer_on_gpu_matches_reference[size1-viewing1-gaze_px1]",
)
WAITING = ("tests/presenter/", "tests/web/")
STANDS_BACK = 5
"""Niceness of workers that compute."""
IN_TURN = """
import json, sys
from study_app.cli import main

for words in json.loads(sys.argv[1]):
    sys.argv = ["metamerlab", *words]
    try:
        main()
    except SystemExit as end:
        if end.code:
            raise
"""

# No deadline: a busy machine is not a failure. The same examples in every run of CI.
hypothesis.settings.register_profile("local", deadline=None)
hypothesis.settings.register_profile("ci", deadline=None, derandomize=True)
hypothesis.settings.load_profile("ci" if os.environ.get("CI") else "local")


def pytest_addoption(parser: pytest.Parser) -> None:
    """Add ``--short``, ``--slow``, ``--full`` and ``--costs``."""
    parser.addoption(
        "--short",
        action="store_true",
        help="the middle case of every test that is not slow and not about the repository itself,"
        " and eight long ones",
    )
    parser.addoption("--slow", action="store_true", help="run tests marked slow, too, as CI does")
    parser.addoption(
        "--full",
        action="store_true",
        help="run all, and long proofs whole (by default a tenth of them)",
    )
    parser.addoption(
        "--costs", action="store_true", help="print what the tests cost, in CPU seconds"
    )


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_make_scheduler(config: pytest.Config, log: Any) -> Any:
    """Give whole files to workers, those first that take longest: else one ends the run alone.

    Tests before a screen and in a browser mostly wait for real time to pass. One worker at a time
    runs those of a folder, from the beginning on, while the others compute: side by side they
    would leave the processors idle, and disturb each other. Of the workers that wait, the first to
    be done ends: of those that compute, more would only share the processors.
    """
    from xdist.scheduler import LoadScopeScheduling

    class WholeFiles(LoadScopeScheduling):
        one_has_ended = False

        def _split_scope(self, nodeid: str) -> str:
            return nodeid.split("::", 1)[0]

        def _place(self, scope: str, node: Any) -> int:
            """Return 0 for a file that waits and may begin at a worker, 1 for one that computes."""
            running = {
                waiting_folder(scope)
                for other, works in self.assigned_work.items()
                for scope, done in works.items()
                if other is not node and not all(done.values())
            }
            folder = waiting_folder(scope)
            return 1 if folder is None else 2 if folder in running else 0

        def _reschedule(self, node: Any) -> None:
            waited = any(map(waiting_folder, self.assigned_work[node]))
            waits = any(self._place(scope, node) == 0 for scope in self.workqueue)
            if self.numnodes > 2 and waited and not (waits or self.one_has_ended):
                self.one_has_ended = True
                node.shutdown()  # after what it was given
            else:
                super()._reschedule(node)

        def _assign_work_unit(self, node: Any) -> None:
            first = min(self.workqueue, key=lambda scope: self._place(scope, node))
            self.workqueue.move_to_end(first, last=False)
            super()._assign_work_unit(node)

    config.option.loadscopereorder = False  # in the order of the tests, as sorted below
    return WholeFiles(config, log)


def waiting_folder(path: str) -> str | None:
    """Return the folder of tests that mostly wait for real time to pass, or None."""
    return next((folder for folder in WAITING if path.startswith(folder)), None)


def pytest_runtest_logstart(nodeid: str) -> None:
    """Let a worker that computes stand back behind those before a screen and in a browser."""
    if "PYTEST_XDIST_WORKER" in os.environ and hasattr(os, "nice") and not waiting_folder(nodeid):
        os.nice(max(0, STANDS_BACK - os.nice(0)))


def cpu_s() -> float:
    """Return the CPU time of this process and of those that it started and that have ended."""
    now = os.times()
    forked = sum(sys.modules["forked"].COSTS_S) if "forked" in sys.modules else 0.0
    return now.user + now.system + now.children_user + now.children_system + forked


COLLECTION = "collection"
"""A row of its own among the costs."""
REFERENCE_LOOP_MS = 11
"""Time of the loop by which `script/setup` chooses a Python, where tests were marked `slow`."""
UNMARKED_S = 1.5
"""Most CPU seconds there of a test that is not marked."""


class Costs:
    """Cost of every test, its fixtures included where they were made; tables of them if `told`."""

    SLOWEST = 30

    def __init__(self, told: bool) -> None:
        self._told = told
        self._unmarked: set[str] = set()
        self._last_s = cpu_s()
        self._collection_s = 0.0
        self._by_test: Counter[str] = Counter()

    @pytest.hookimpl(trylast=True)
    def pytest_collection_finish(self) -> None:
        """Keep what collection took apart from the first test: each worker collects by itself."""
        now_s = cpu_s()
        self._collection_s, self._last_s = now_s - self._last_s, now_s

    @pytest.hookimpl(wrapper=True)
    def pytest_runtest_makereport(self) -> Generator[None, Any, Any]:
        """Tell the phase's cost to whoever reads reports: with xdist that is another process."""
        report = yield
        now_s = cpu_s()
        costs = [("cpu_s", now_s - self._last_s), ("collection_s", self._collection_s)]
        report.user_properties = [*report.user_properties, *costs]
        self._last_s, self._collection_s = now_s, 0.0
        return report

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        """Add a phase to its test."""
        if not {"slow", "full"} & report.keywords.keys():
            self._unmarked.add(report.nodeid)
        for key, name in (("cpu_s", report.nodeid), ("collection_s", COLLECTION)):
            self._by_test[name] += sum(s for told, s in report.user_properties if told == key)

    def pytest_terminal_summary(self, terminalreporter: pytest.TerminalReporter) -> None:
        """Print files and the slowest tests, as tables, and tests that should be marked `slow`."""
        if self._told:
            self._tell_tables(terminalreporter)
        ms = loop_ms()
        most_s = UNMARKED_S * ms / REFERENCE_LOOP_MS
        heavy = [
            (name, s) for name, s in self._by_test.most_common()
            if s > most_s and name in self._unmarked
        ]  # fmt: skip
        if heavy:
            terminalreporter.section(f"not marked slow, above {most_s:.1f} CPU s")
            terminalreporter.write_line(
                f"{UNMARKED_S} s where a loop takes {REFERENCE_LOOP_MS} ms, and {ms} ms here"
            )
            for name, seconds in heavy:
                terminalreporter.write_line(f"{seconds:.1f} s  {name}")

    def _tell_tables(self, terminalreporter: pytest.TerminalReporter) -> None:
        files: Counter[str] = Counter()
        for name, seconds in self._by_test.items():
            files[name.partition("::")[0]] += seconds
        tell = terminalreporter.write_line
        terminalreporter.section("costs")
        tell(f"{len(self._by_test) - 1} tests took {sum(files.values()):.0f} CPU seconds")
        for head, rows in (("file", files), ("test", self._by_test)):
            tell(f"\n| s | {head} |\n| ---: | --- |")
            for name, seconds in rows.most_common(self.SLOWEST):
                if seconds >= 0.5:
                    tell(f"| {seconds:.0f} | {cost_name(name)} |")


def cost_name(nodeid: str) -> str:
    """Return a test as its file and the sentence that is its name."""
    path, _, test = nodeid.partition("::")
    said = test.rpartition("::")[2].removeprefix("test_").replace("_", " ")
    file = f"`{path.removeprefix('tests/')}`"
    return f"{file}: {said.replace('|', ' ')}" if said else file


def pytest_configure(config: pytest.Config) -> None:
    """Watch the costs where they are asked for; let Mesa compile shaders fast, unless `--full`.

    Slow tests run where they are asked for, too: by `--full`, and by naming files or tests.
    For pictures as small as ours, its software renderer takes longer to make its programs quick
    than to run them as they are. Both compute the same.
    """
    told = config.getoption("--costs")
    if told or config.getoption("--slow"):
        config.pluginmanager.register(Costs(told), "costs")
    if config.getoption("--full") or config.args_source is pytest.Config.ArgsSource.ARGS:
        config.option.slow = True  # workers are told
    if not config.getoption("--full"):
        os.environ.setdefault("GALLIVM_PERF", "nopt")
    begin_elsewhere(config)


def begin_elsewhere(config: pytest.Config) -> None:
    """Let each worker collect from another folder on: in a fresh clone each compiles its part."""
    worker = getattr(config, "workerinput", None)
    if worker and config.args_source is pytest.Config.ArgsSource.TESTPATHS:
        tests = Path(__file__).parent
        folders = sorted(map(str, tests.glob("[!_]*/")))
        at = len(folders) * int(worker["workerid"].removeprefix("gw")) // worker["workercount"]
        config.args[:] = folders[at:] + folders[:at] + sorted(map(str, tests.glob("test_*.py")))


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Put the longest files first; skip what is marked `slow` or `full` unless it is asked for."""
    order = {name: place for place, name in enumerate(LONGEST)}

    def place(item: pytest.Item) -> tuple[int, Sequence[str]]:
        name = item.nodeid.split("::", 1)[0]
        return order.get(name, len(order)), name.split("/")

    items.sort(key=place)
    if config.getoption("--short"):
        lost = {*EIGHT} - {item.nodeid for item in items}
        if lost and config.args_source is pytest.Config.ArgsSource.TESTPATHS:
            raise pytest.UsageError(f"the short run must have {', '.join(lost)} (see EIGHT)")
        kept = {id(item) for item in one_of_each(items)}
        config.hook.pytest_deselected(items=[item for item in items if id(item) not in kept])
        items[:] = [item for item in items if id(item) in kept]
    for mark, why in (("slow", "takes seconds"), ("full", "a long proof")):
        if not config.getoption(f"--{mark}"):
            skip = pytest.mark.skip(reason=f"{why}: script/test --{mark} runs it")
            for item in items:
                if item.get_closest_marker(mark) and not asked_by_short(config, item):
                    item.add_marker(skip)


def asked_by_short(config: pytest.Config, item: pytest.Item) -> bool:
    """Return True for one of the eight long tests of the short run."""
    return bool(config.getoption("--short")) and item.nodeid in EIGHT


def one_of_each(items: list[pytest.Item]) -> list[pytest.Item]:
    """Return the middle case of every test that is not slow, for the first is often the empty one,
    and the eight long ones."""
    cases: dict[str, list[pytest.Item]] = {}
    for item in items:
        slow = item.get_closest_marker("slow") or item.get_closest_marker("full")
        if not slow and Path(item.fspath).name not in ABOUT_THE_REPOSITORY:
            cases.setdefault(item.nodeid.partition("[")[0], []).append(item)
    middle = [family[len(family) // 2] for family in cases.values()]
    return middle + [item for item in items if item.nodeid in EIGHT and item not in middle]


def pytest_ignore_collect(collection_path: Path, config: pytest.Config) -> bool | None:
    """Leave tests of the repository out of the short run: nothing of them is even read."""
    short = config.getoption("--short") and collection_path.name in ABOUT_THE_REPOSITORY
    return True if short else None


def pytest_collection_finish() -> None:
    """Let Python's search for garbage pass over what collection left, and come more rarely.

    What collection left stays to the end. The search took a seventeenth of the tests' time.
    """
    gc.collect()
    gc.freeze()
    gc.set_threshold(20_000)


def pytest_sessionfinish() -> None:
    """Let the end of the process find all again: libraries complain of what stays."""
    gc.unfreeze()


@pytest.fixture(scope="session")
def full(request: pytest.FixtureRequest) -> bool:
    """True if long proofs run whole."""
    return bool(request.config.getoption("--full"))


@pytest.fixture(scope="session")
def proof_count(full: bool) -> Callable[[int], int]:
    """Give how often to repeat: all of the count asked for with ``--full``, else a tenth."""
    return lambda count: count if full else max(1, count // 10)


@pytest.fixture
def rng() -> np.random.Generator:
    """Return a generator that starts at the same seed in every test."""
    return np.random.default_rng(20_260_101)


@pytest.fixture(scope="session")
def disc_over_plane() -> SourceFrame:
    """Return [MI] Fig. 5's scene, 96x128: a red disc at 2 m over a grey noise plane at 5 m."""
    height, width = 96, 128
    y, x = np.mgrid[:height, :width] + 0.5
    grey = np.random.default_rng(5).uniform(0.2, 0.8, (height, width, 1))
    disc = (x - 52) ** 2 + (y - 48) ** 2 < 26**2
    colour = np.where(disc[..., None], (0.8, 0.1, 0.1), grey)
    return SourceFrame(colour.astype(np.float32), np.where(disc, 2, 5).astype(np.float32))


@pytest.fixture(scope="session")
def repository() -> Path:
    """Return the folder that holds `pyproject.toml`, also when a wheel is under test."""
    return REPOSITORY


@pytest.fixture(scope="session")
def shared_data() -> Path:
    """Return the folder of large test data, kept beside the repository and not in it."""
    folder = REPOSITORY.parent / "shared" / "data"
    if not folder.is_dir():
        pytest.skip("needs the test data in ../shared/data, which is not here")
    return folder


@pytest.fixture(scope="session")
def sample_sessions(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder with two simulated sessions of the demo study: ``demo/S001`` and ``S002``.

    Made by the real session code; every test reads the same files, so none may change them.
    """
    from protocols.load import load_display, load_protocol
    from study_app.simulate import SimulatedStudy, simulate_study

    root = tmp_path_factory.mktemp("sessions")
    protocol = load_protocol(Path("demo"))
    simulate_study(SimulatedStudy(protocol, load_display(protocol.display.display)), root, 2)
    return root


@pytest.fixture
def install_package(tmp_path: Path) -> Callable[..., Path]:
    """Give a function that puts a package where Python finds it; it returns the folder.

    `files` holds texts by path; `entry_points` is the text of its entry points.
    """

    def install(name: str, files: Mapping[str, str], entry_points: str) -> Path:
        site = tmp_path / "site"
        metadata = {
            "METADATA": f"Metadata-Version: 2.1\nName: {name}\nVersion: 1\n",
            "entry_points.txt": entry_points,
        }
        info = f"{name.replace('-', '_')}-1.dist-info"
        for path, text in {
            **files,
            **{f"{info}/{key}": value for key, value in metadata.items()},
        }.items():
            (site / path).parent.mkdir(parents=True, exist_ok=True)
            (site / path).write_text(text, encoding="utf-8")
        return site

    return install


@pytest.fixture(scope="session")
def lab_site() -> Path:
    """Return the folder in which a lab's own package is installed."""
    return Path(__file__).parent / "lab"


@pytest.fixture
def with_packages(tmp_path: Path) -> Callable[..., subprocess.CompletedProcess[str]]:
    """Give a function that runs commands where the packages of a folder are installed.

    All in one process, one after the other, up to the first that fails.
    """

    def run(
        site: Path, *commands: Sequence[object], env: Mapping[str, str] = os.environ
    ) -> subprocess.CompletedProcess[str]:
        paths = [str(site), env.get("PYTHONPATH", "")]
        return subprocess.run(
            [sys.executable, "-c", IN_TURN, json.dumps([[*map(str, words)] for words in commands])],
            env={**env, "PYTHONPATH": os.pathsep.join(filter(None, paths)), "COLUMNS": "200"},
            cwd=tmp_path,
            capture_output=True,
            text=True,
            check=False,
        )

    return run


@pytest.fixture(scope="session")
def reseal() -> Callable[[Path], None]:
    """Give a function that computes a journal's checksums anew, after a test has changed it."""
    from protocols.disk.hashing import canonical_json
    from protocols.journal_file import due, first_link

    def resealed(path: Path) -> None:
        before, lines = first_link(b""), []
        for line in path.read_bytes().split(b"\n"):
            try:
                event = json.loads(line)
            except ValueError:
                lines.append(line)
                continue
            if "chain" in event:
                bare = canonical_json(event | {"chain": None})
                before = due(bare, before)
                line = canonical_json(event | {"chain": before})
            lines.append(line)
        path.write_bytes(b"\n".join(lines))

    return resealed


@pytest.fixture(scope="session")
def shared_gl_context() -> Iterator[moderngl.Context]:
    """Yield one context for all tests; most want `gl_context`, which watches what it leaves."""
    try:
        ctx = create_context()
    except GLUnavailableError as error:
        if os.environ.get("REQUIRE_GL") == "1":
            pytest.fail(f"REQUIRE_GL=1, and there is no usable OpenGL: {error}")
        pytest.skip(f"no usable OpenGL: {error}")
    yield ctx
    release_context(ctx)


@pytest.fixture(scope="module")
def module_gl_context(shared_gl_context: moderngl.Context) -> moderngl.Context:
    """Give the off-screen context, current, to a fixture that serves a whole file."""
    shared_gl_context.__enter__()  # another test may have made its own context current
    return shared_gl_context


@pytest.fixture
def gl_context(shared_gl_context: moderngl.Context) -> Iterator[moderngl.Context]:
    """Yield an off-screen context, current; without OpenGL skip, or fail where REQUIRE_GL=1.

    A test fails if it leaves an object alive in the context, or a GL error unread.
    """
    shared_gl_context.__enter__()  # another test may have made its own context current
    shared_gl_context.detect_framebuffer(0).use()  # or have released the framebuffer in use
    shared_gl_context.clear_errors()
    watch = GLWatch()
    yield shared_gl_context
    shared_gl_context.__enter__()
    error = shared_gl_context.error
    left = watch.gained()
    assert not left, f"GL objects left alive: {', '.join(sorted(left))}"
    assert error == "GL_NO_ERROR", f"GL error left unread: {error}"


@pytest.fixture
def gl_watch(gl_context: moderngl.Context) -> type[GLWatch]:  # noqa: ARG001
    """Give the class whose instances tell which GL objects came into being since."""
    return GLWatch


@pytest.fixture
def refuse_gl_objects(monkeypatch: pytest.MonkeyPatch) -> Callable[[], None]:
    """Give a function from whose call on making a GL object fails."""

    def refuse(*_arguments: object, **_options: object) -> None:
        raise AssertionError("made a GL object")

    def begin() -> None:
        kinds = ("texture", "texture_array", "buffer", "framebuffer", "compute_shader", "program")
        for kind in kinds:
            monkeypatch.setattr(moderngl.Context, kind, refuse)

    return begin


class GLWatch:
    """Objects that the current context has gained since the watch began, e.g. ``texture 3``.

    It asks the driver: moderngl frees nothing when Python collects its objects, so
    counting those would miss what leaks. Query objects are left out, since moderngl has no
    call to free them. A program that was released but is still bound counts as gone.
    """

    # Of each kind more than a test ever holds at once.
    KINDS: ClassVar = {
        "Texture": 512, "Buffer": 512, "Framebuffer": 128, "Renderbuffer": 128, "Sampler": 128,
        "VertexArray": 128, "Program": 512,
    }  # fmt: skip
    DELETE_STATUS = 0x8B80

    def __init__(self) -> None:
        self._egl = ctypes.CDLL("libEGL.so.1")
        self._egl.eglGetProcAddress.restype = ctypes.c_void_p
        self._first = self._next_names()
        self._before = self._alive()

    def gained(self) -> set[str]:
        """Return kind and GL name of every new object that is still alive."""
        return self._alive() - self._before

    def _alive(self) -> set[str]:
        # Drivers give out either the lowest free name or one never used before: in both
        # cases nothing new lies below the name that was next when the watch began.
        nexts, alive = self._next_names(), set()
        for kind, first in self._first.items():
            exists = self._call(f"glIs{kind}", ctypes.c_ubyte, ctypes.c_uint)
            names = range(first, max(nexts[kind], first + self.KINDS[kind]))
            alive |= {f"{kind.lower()} {name}" for name in filter(exists, names)}
        return {name for name in alive if not self._is_released_program(name)}

    def _next_names(self) -> dict[str, int]:
        nexts, name = {}, ctypes.c_uint()
        for kind in self.KINDS.keys() - {"Program"}:
            self._call(f"glGen{kind}s", None, ctypes.c_int, ctypes.c_void_p)(1, ctypes.byref(name))
            nexts[kind] = name.value
            delete = self._call(f"glDelete{kind}s", None, ctypes.c_int, ctypes.c_void_p)
            delete(1, ctypes.byref(name))
        nexts["Program"] = self._call("glCreateProgram", ctypes.c_uint)()
        self._call("glDeleteProgram", None, ctypes.c_uint)(nexts["Program"])
        return nexts

    def _is_released_program(self, name: str) -> bool:
        kind, number = name.split()
        if kind != "program":
            return False
        status = ctypes.c_int()
        get = self._call("glGetProgramiv", None, ctypes.c_uint, ctypes.c_uint, ctypes.c_void_p)
        get(int(number), self.DELETE_STATUS, ctypes.byref(status))
        return bool(status.value)

    def _call(
        self, name: str, returns: type[ctypes._SimpleCData[int]] | None, *arguments: type
    ) -> Callable[..., int]:
        return ctypes.CFUNCTYPE(returns, *arguments)(self._egl.eglGetProcAddress(name.encode()))
