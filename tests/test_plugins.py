"""Plug-ins of a lab's own package, part by part, and messages about a broken one.

`tests/presenter/test_a_labs_study.py` runs a whole study with it.
"""

import contextlib
import importlib
import inspect
import json
import multiprocessing
import os
import pkgutil
import re
import runpy
import subprocess
import sys
import tomllib
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

import pytest
import typer

from analysis.journals import read_study
from analysis.tasks import KINDS, analysis_of
from analysis.tasks.preference import PreferenceOfPairs
from pipeline.errors import InputError
from pipeline.methods.registry import _with_plugins
from protocols.errors import Problem, StudyError
from protocols.load import load_display, load_protocol
from protocols.plugins import check_methods
from protocols.tasks.base import Arrangement, Cell, Task
from study_app.cli.error_messages import user_errors
from study_app.gaze.open_source import ADAPTERS, open_gaze
from study_app.observers import MAKERS, default_model
from study_app.simulate import SimulatedStudy, simulate_study


def test_a_labs_method_and_metric_are_listed_with_their_package(with_packages, lab_site):
    done = with_packages(lab_site, ("warp", "--list"), ("stimuli", "score", "--list"))

    assert done.returncode == 0, done.stderr
    assert "of the package lab-package" in done.stdout
    for name in ("lab-mean", "lab-error"):
        assert name in done.stdout


@pytest.mark.slow
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
        ("[metamerlab.trackers]\nlsl = broken:Task",
         ("session", "run", "demo", "--participant", "P1", "--display", "fhd27-60hz",
          "--stimuli", ".", "--out", "nowhere"),
         "a plug-in must have a name of its own in metamerlab.trackers (got 'lsl'"),
    ],
)  # fmt: skip
def test_a_broken_plug_in_is_named_with_its_package_and_a_cure(
    install_package, with_packages, entry_points, words, message
):
    site = install_package("broken", {"broken.py": "class Task: pass\n"}, entry_points + "\n")
    done = with_packages(site, words)

    assert done.returncode == 2, (done.stdout, done.stderr)
    assert "Traceback" not in done.stderr
    assert "package 'broken'" in done.stderr
    assert message in " ".join(done.stderr.split())
    assert "uninstall the package" in done.stderr


# --- plug-ins that end the program, or are something else ---------------------------------------

DEMO = load_protocol(Path("demo"))
REGISTRIES = {
    "tasks": "protocols/tasks/task_kinds.py",
    "recipes": "protocols/recipes/recipe_kinds.py",
    "builders": "stimuli/recipes/__init__.py",
    "observers": "study_app/observers/__init__.py",
    "analyses": "analysis/tasks/__init__.py",
    "parts": "analysis/parts/__init__.py",
    "metrics": "stimuli/score/metrics.py",
    "trackers": "study_app/gaze/open_source.py",
    "methods": "",
}
ODD = """
import sys
class Plain: pass
class Strange(BaseException): pass
class Model:
    pass
number, text, nothing = 3, "three", None
def of_five(a, b, c, d, e): pass
def ends(*_): sys.exit(0)
def strays(*_): raise Strange("of its own kind")
def returns(*_): return 3
"""


@pytest.fixture
def installed(install_package, monkeypatch):
    """Give a function that installs a package `odd` in this process, and reads one registry."""

    def read(group: str, target: str, module: str = ODD) -> None:
        entry_points = f"[metamerlab.{group}]\nmine = {target}\n"
        site = install_package("odd-one", {"odd.py": module}, entry_points)
        monkeypatch.syspath_prepend(str(site))
        monkeypatch.delitem(sys.modules, "odd", raising=False)
        if group == "methods":
            (entry,) = _with_plugins(())
            entry.load()
            return
        runpy.run_path(REGISTRIES[group])  # anew, beside the one that is loaded

    yield read
    sys.modules.pop("odd", None)


@pytest.mark.parametrize("group", REGISTRIES)
@pytest.mark.parametrize(
    "ends", ["sys.exit(0)", "sys.exit()", "raise GeneratorExit", "import none_such"]
)
def test_a_plug_in_that_ends_while_it_loads_is_named(installed, group, ends):
    """Before, the command ended at once, with the status that the plug-in chose."""
    with pytest.raises((StudyError, InputError)) as caught:
        installed(group, "odd:Plain", f"import sys\n{ends}\nclass Plain: pass\n")

    message = f"package 'odd-one': its plug-in 'mine' of metamerlab.{group} must load ("
    assert str(caught.value).startswith(message)
    assert "uninstall the package" in str(caught.value)


@pytest.mark.parametrize("group", REGISTRIES)
@pytest.mark.parametrize(
    "line", ["import analysis.parts.oracle", "from protocols.tasks.base import Oracle"]
)
def test_a_plug_in_that_imports_what_went_is_sent_to_the_page_that_says_so(installed, group, line):
    with pytest.raises((StudyError, InputError)) as caught:
        installed(group, "odd:Plain", f"{line}\nclass Plain: pass\n")

    message = str(caught.value)
    assert message.startswith(f"package 'odd-one': its plug-in 'mine' of metamerlab.{group} must")
    cure = "mend it by docs/from-0.3-to-0.4.md, which says what went or moved, or uninstall"
    assert message.endswith(f"; {cure} the package")


@pytest.mark.parametrize(
    ("line", "told"),
    [
        ("from protocols.html_page import html_page",
         "No module named 'protocols.html_page', which is protocols.blocks now)"),
        ("import stimuli.read_stimulus",
         "'stimuli.read_stimulus', which is pipeline.pictures.stored_frames now)"),
        ("import stimuli.foveated.rings", "which is stimuli.foveate or stimuli.media.moving or "),
        ("from protocols.tasks import two_interval", "which is protocols.tasks.pairs now)"),
        ("from protocols.phases import Clip", "which is protocols.phases.MovingImage now)"),
        ("from protocols.units import visible", "which is protocols.units.require_visible now)"),
        ("from analysis.report.values import flat_table", "is analysis.report.values.frame_of now"),
    ],
)  # fmt: skip
def test_a_plug_in_is_told_where_lies_what_moved(installed, line, told):
    with pytest.raises(StudyError) as caught:
        installed("parts", "odd:Plain", f"{line}\nclass Plain: pass\n")
    assert told in str(caught.value)


def test_what_moved_lies_where_the_message_says():
    def there(name):
        with contextlib.suppress(ImportError, AttributeError):
            return bool(pkgutil.resolve_name(name))
        return False

    rows = tomllib.loads(Path("protocols/moved.toml").read_text(encoding="utf-8"))
    assert [old for old in rows if there(old)] == []
    assert [new for places in rows.values() for new in places.split() if not there(new)] == []


def test_an_analysis_with_the_names_of_0_3_is_told_the_new_ones():
    with pytest.raises(TypeError, match=r"settings of an analysis is plan since 0\.4"):
        type("Mine", (PreferenceOfPairs,), {"settings": PreferenceOfPairs.plan})


@pytest.mark.parametrize("group", REGISTRIES)
@pytest.mark.parametrize("target", ["odd:number", "odd:text", "odd:nothing", "odd", "odd:of_five"])
def test_a_plug_in_of_a_wrong_type_is_named(installed, group, target):
    with pytest.raises((StudyError, InputError)) as caught:
        installed(group, target)

    message = f"package 'odd-one': its plug-in 'mine' of metamerlab.{group} must name a"
    assert str(caught.value).startswith(message)
    assert "(got " in str(caught.value)


@pytest.mark.parametrize("group", ["tasks", "recipes", "builders", "methods"])
def test_a_class_of_no_base_of_ours_is_named(installed, group):
    with pytest.raises((StudyError, InputError), match="must name a class"):
        installed(group, "odd:Plain")


def test_a_task_of_another_kind_than_its_entry_is_named(installed):
    module = (
        "from typing import Literal\nfrom protocols.tasks.yes_no import YesNo\n"
        "class Mine(YesNo):\n    kind: Literal['other']\n"
    )
    with pytest.raises(StudyError, match="whose kind is the entry's name"):
        installed("tasks", "odd:Mine", module)


@pytest.mark.parametrize(
    ("call", "registry", "key", "must"),
    [
        (lambda: default_model(DEMO), MAKERS, "two-interval", "return a model"),
        (lambda: analysis_of("preference"), KINDS, "preference", "give an"),
        (lambda: open_gaze("mouse:", None), ADAPTERS, "mouse", "return a source with open, info"),
    ],
)  # fmt: skip
def test_a_plug_in_that_returns_something_else_is_named(monkeypatch, call, registry, key, must):
    monkeypatch.setitem(registry, key, lambda *_: 3)
    with pytest.raises(StudyError, match=rf"its plug-in '{key}' of .*must {must}.*\(got int\)"):
        call()


def test_an_error_in_a_plug_in_is_not_taken_for_its_absence(monkeypatch):
    monkeypatch.setitem(MAKERS, "two-interval", lambda _study: {}["its own"])
    with pytest.raises(KeyError, match="its own"):
        default_model(DEMO)


@pytest.mark.parametrize("group", REGISTRIES)
@pytest.mark.parametrize(("name", "kind"), [("ends", "SystemExit"), ("strays", "Strange")])
def test_a_plug_in_that_ends_the_program_when_it_is_called_is_named(
    install_package, monkeypatch, capsys, group, name, kind
):
    site = install_package("odd-one", {"odd.py": ODD}, f"[metamerlab.{group}]\nmine = odd:Model\n")
    monkeypatch.syspath_prepend(str(site))
    monkeypatch.delitem(sys.modules, "odd", raising=False)
    called = getattr(importlib.import_module("odd"), name)
    with pytest.raises(typer.Exit) as caught, user_errors():
        called()

    said = " ".join(capsys.readouterr().err.split())
    assert caught.value.exit_code == 2
    assert f"error: package 'odd-one': its plug-in 'mine' of metamerlab.{group} must return" in said
    assert f"(its {name} raised {kind}" in said


def test_a_plug_in_that_ends_a_worker_process_is_named(install_package, monkeypatch, capsys):
    """The exception arrives without its frames; the traceback came as text."""
    site = install_package("odd-one", {"odd.py": ODD}, "[metamerlab.methods]\nmine = odd:Plain\n")
    monkeypatch.syspath_prepend(str(site))
    with (
        ProcessPoolExecutor(1, multiprocessing.get_context("spawn")) as pool,
        pytest.raises(typer.Exit),
        user_errors(),
    ):
        pool.submit(importlib.import_module("odd").ends).result()

    assert "its plug-in 'mine' of metamerlab.methods" in " ".join(capsys.readouterr().err.split())


def test_what_no_plug_in_raised_goes_its_way():
    for error in (SystemExit(3), KeyboardInterrupt()):
        with pytest.raises(type(error)) as caught, user_errors():
            raise error
        assert caught.value is error


def test_a_plug_in_that_exits_ends_its_command_with_status_2(install_package, with_packages):
    site = install_package(
        "odd-one", {"odd.py": "import sys\nsys.exit(0)\n"}, "[metamerlab.tasks]\nmine = odd:Task\n"
    )
    done = with_packages(site, ("protocol", "check", "demo"))

    assert done.returncode == 2, (done.stdout, done.stderr)
    assert done.stderr.startswith("error: package 'odd-one': its plug-in 'mine'")
    assert "Traceback" not in done.stderr


BAD_TASK = """
from typing import Literal
from protocols.tasks.pairs import TwoInterval

class Odd(TwoInterval):
    kind: Literal["mine"]

def broken(name, error):
    def method(self, *_):
        return half(error)
    method.__code__ = method.__code__.replace(co_name=name)
    return method

def half(error):
    if error is None:
        return None
    raise error("one of its own")
"""
EACH_BROKEN = """
import json, sys
from typer.testing import CliRunner
from study_app.cli import app
import builtins, odd
for method, error, words in json.loads(sys.argv[1]):
    setattr(odd.Odd, method, odd.broken(method, error and getattr(builtins, error)))
    done = CliRunner().invoke(app, words)
    delattr(odd.Odd, method)
    print(json.dumps([done.exit_code, " ".join(done.stderr.split()), repr(done.exception)]))
"""
ENTRY_POINTS = """[metamerlab.tasks]
mine = odd:Odd
[metamerlab.observers]
mine = study_app.observers.preference_observer:PreferenceModel.of
"""
DOORS = {
    "check": ("protocol", "check"),
    "script": ("protocol", "show", "--script"),
    "preview": ("protocol", "preview"),
    "simulate": ("session", "simulate", "--out", "sessions"),
    "run": ("session", "run", "--stimuli", ".", "--participant", "P01"),
}


def odd_study(folder: Path) -> Path:
    text = Path("protocols/studies/demo.toml").read_text(encoding="utf-8")
    text = text.replace('kind = "two-interval"', 'kind = "mine"')
    (folder / "mine.toml").write_text(text, encoding="utf-8")
    return folder / "mine.toml"


@pytest.mark.slow
def test_a_task_whose_method_raises_is_named_with_it_at_every_door(install_package, tmp_path):
    site = install_package("odd-one", {"odd.py": BAD_TASK}, ENTRY_POINTS)
    path = odd_study(tmp_path)
    cases = [
        *(("answers", "ValueError", door) for door in DOORS),  # pydantic would take it for its own
        *(("phases", "KeyError", door) for door in DOORS if door != "run"),
        ("cells", "AssertionError", "check"),
        ("catch_cells", "TypeError", "simulate"),
        ("phases_after", "RuntimeError", "script"),
        ("shown_s", "ZeroDivisionError", "simulate"),
        ("durations", "LookupError", "preview"),
        ("description", "AttributeError", "preview"),
        ("condition_columns", "NotImplementedError", "check"),
        ("problems", "ValueError", "check"),
        *((name, None, "check") for name in ("answers", "cells", "shown_s", "description")),
        *((name, None, "check") for name in ("problems", "phases", "phases_after", "row")),
    ]
    told = [(m, e, [*DOORS[door][:2], str(path), *DOORS[door][2:]]) for m, e, door in cases]
    done = subprocess.run(
        [sys.executable, "-c", EACH_BROKEN, json.dumps(told)],
        env={**os.environ, "PYTHONPATH": os.pathsep.join([str(site), *sys.path])},
        cwd=tmp_path, capture_output=True, text=True, check=True,
    )  # fmt: skip

    for (method, error, door), line in zip(cases, done.stdout.splitlines(), strict=True):
        code, said, exception = json.loads(line)
        if method == "row":  # nothing was answered yet
            assert code == 0, exception
            continue
        assert code == 2, (method, door, exception)
        if error is None:
            assert re.fullmatch(
                r"error: (?:/\S+mine\.toml: task: )?package 'odd-one': its plug-in 'mine' of"
                rf" metamerlab\.tasks must return [\w.\[\], ]+ from {method} \(got NoneType\);"
                r" mend or uninstall the package",
                said,
            ), said
            continue
        assert re.fullmatch(
            r"error: package 'odd-one': its plug-in 'mine' of metamerlab\.tasks must return or say"
            rf" what is wrong \(its {method} raised {error}: '?one of its own'?, odd\.py line 17\);"
            r" mend or uninstall the package",
            said,
        ), (method, door, said)
    assert {each.name for each in tmp_path.iterdir()} <= {"site", "mine.toml", "sessions"}
    assert not [*tmp_path.glob("sessions/*/*")]


class Broken:
    """Object that no method of ours returns."""


HOOKS = {
    name: function
    for name, member in vars(Task).items()
    if inspect.isfunction(function := getattr(member, "fget", member)) and name[0] != "_"
}


@pytest.mark.parametrize("hook", HOOKS)
def test_each_method_of_a_task_says_itself_that_it_returns_something_else(hook):
    """Before, most gave a traceback from where their value was used."""
    kept: list[object] = []

    class Odd(type(DEMO.task)):
        def own(self, *_: object) -> object:
            return kept[-1]

    own = Odd.own
    own.__name__ = hook
    setattr(Odd, hook, property(own) if isinstance(vars(Task)[hook], property) else own)
    task = Odd.model_construct(**dict(DEMO.task))
    check_methods("tasks", "two-interval", Odd)
    check_methods("tasks", "two-interval", Odd)  # twice is once
    given = [None] * (len(inspect.signature(HOOKS[hook]).parameters) - 1)

    def call() -> object:
        found = getattr(task, hook)
        return found(*given) if callable(found) else found

    for wrong in (Broken(), Broken, [Broken()], {"a": Broken()}, None):
        kept.append(wrong)
        if (hook, wrong) == ("adaptation", None):
            continue
        if hook in ("row", "whole_row") and isinstance(wrong, dict):
            continue
        with pytest.raises(StudyError) as caught:
            call()
        said = str(caught.value)
        assert "its plug-in 'two-interval' of metamerlab.tasks must return " in said
        assert f" from {hook} (got " in said
        assert said.endswith("; mend or uninstall the package")


@pytest.mark.parametrize(
    ("cells", "what"),
    [
        ([Cell("a scene", None)], "NoneType at 0 at arrangements"),
        ([Cell("a scene", (Arrangement({"column": Broken()}, ("one",)),))], "Broken at 0"),
        ([Cell("a scene", (Arrangement({}, (1,)),))], "int at 0 at arrangements at 0 at stimuli"),
    ],
)
def test_what_a_task_returns_is_checked_to_the_last_part(cells, what):
    class Odd(type(DEMO.task)):
        def cells(self, _pool):
            return cells

    check_methods("tasks", "two-interval", Odd)
    with pytest.raises(StudyError, match=rf"from cells \(got {what}"):
        Odd.model_construct(**dict(DEMO.task)).cells(DEMO.pool)


def test_a_list_stands_for_a_tuple_and_an_iterator_is_read_once():
    class Odd(type(DEMO.task)):
        def answers(self):
            return ["first", "second"]

        def problems(self, _pool):
            return [Problem("task", "wrong")]

    check_methods("tasks", "two-interval", Odd)
    task = Odd.model_construct(**dict(DEMO.task))
    assert task.answers() == ("first", "second")
    assert list(task.problems(DEMO.pool)) == [Problem("task", "wrong")]


@pytest.fixture(scope="module")
def answered(tmp_path_factory) -> Path:
    """Return a folder with a session of the demonstration."""
    folder = tmp_path_factory.mktemp("answered")
    simulate_study(SimulatedStudy(DEMO, load_display("fhd27-60hz")), folder, 1)
    return folder


@pytest.mark.parametrize(
    ("row", "must"),
    [
        (lambda _: {}, r"return its column 'scene' from row \(got dict with nothing\)"),
        (lambda row: row | {"chose_first": "abc"},
         r"return from row, in its column 'chose_first', what is '0/1' \(got str\)"),
        (lambda row: row | {"scene": [1]},
         r"return from row, in its column 'scene', what is 'text' \(got list\)"),
        (lambda _: None, r"return dict\[str, object\] from row \(got NoneType\)"),
        (lambda _: {}["its own"], r"return or say what is wrong \(its row raised KeyError"),
    ],
)  # fmt: skip
def test_a_row_of_something_else_stops_the_analysis_with_its_task(
    install_package, monkeypatch, answered, row, must
):
    """Before, these were tracebacks, or the attempts were taken for damaged lines."""
    site = install_package("odd-one", {"odd.py": ODD}, "[metamerlab.tasks]\nmine = odd:Model\n")
    monkeypatch.syspath_prepend(str(site))
    task = type(DEMO.task)
    inner = "def row(self, attempt): return change(real(self, attempt))"
    names = {"real": task.row, "change": row}
    exec(compile(inner, str(site / "odd.py"), "exec"), names)

    class Odd(task):
        row = names["row"]

    study = DEMO.model_copy(update={"task": Odd.model_construct(**dict(DEMO.task))})
    check_methods("tasks", "mine", Odd)
    with pytest.raises(StudyError, match=rf"its plug-in '(mine|two-interval)' of .* must {must}"):
        read_study(answered, study)


@pytest.mark.parametrize(
    ("name", "member", "must"),
    [
        ("row", lambda _self: {}, r"have a method row\(self, attempt\) \(got function\)"),
        ("phases", lambda _self, _pool: (), r"have a method phases\(self, pool, display\)"),
        ("labels", {"a": "b"}, r"have a method labels\(self\) \(got dict\)"),
        ("catch_trials", lambda _self: 3, "have catch_trials as a property"),
    ],
)
def test_a_method_that_cannot_be_called_as_ours_is_named(name, member, must):
    class Odd(type(DEMO.task)):
        pass

    setattr(Odd, name, member)
    with pytest.raises(StudyError, match=rf"'two-interval' of metamerlab.tasks must {must}"):
        check_methods("tasks", "two-interval", Odd)


def test_a_task_that_lacks_a_method_is_named_with_it(install_package, with_packages, tmp_path):
    module = (
        "from typing import Literal\nfrom protocols.tasks.pairs import PairTask\n"
        'class Odd(PairTask):\n    kind: Literal["mine"]\n    gap_s: float\n'
    )
    site = install_package("odd-one", {"odd.py": module}, "[metamerlab.tasks]\nmine = odd:Odd\n")
    done = with_packages(site, ("protocol", "check", odd_study(tmp_path)))

    assert done.returncode == 2, done.stdout + done.stderr
    said = " ".join(done.stderr.split())
    assert "Traceback" not in said
    assert "its plug-in 'mine' of metamerlab.tasks must" in said
    assert "(it has no answers)" in said
