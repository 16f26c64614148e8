"""What a lab's own package brings, part by part, and what is said of a package that is broken.

`tests/presenter/test_a_labs_study.py` runs a whole study with it.
"""

from __future__ import annotations

import importlib
import multiprocessing
import runpy
import sys
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

import pytest
import typer

from analysis.tasks import ANALYSES, analysis_of
from pipeline.errors import InputError
from pipeline.methods.registry import _with_plugins
from protocols.errors import StudyError
from protocols.load import load_protocol
from study_app.cli.errors import user_errors
from study_app.gaze.open_source import ADAPTERS, open_gaze
from study_app.observers import OBSERVERS, default_model


def test_a_labs_method_and_metric_are_listed_with_their_package(with_packages, lab_site):
    done = with_packages(lab_site, ("warp", "--list"), ("stimuli", "score", "--list"))

    assert done.returncode == 0, done.stderr
    assert "of the package lab-package" in done.stdout
    for name in ("lab-mean", "lab-error"):
        assert name in done.stdout


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
    "tasks": "protocols/tasks/registry.py",
    "recipes": "protocols/recipes/registry.py",
    "builders": "stimuli/recipes/__init__.py",
    "observers": "study_app/observers/__init__.py",
    "analyses": "analysis/tasks/__init__.py",
    "parts": "analysis/parts/added.py",
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
        (lambda: default_model(DEMO), OBSERVERS, "two-interval", "return a model"),
        (lambda: analysis_of("preference"), ANALYSES, "preference", "give an"),
        (lambda: open_gaze("mouse:", None), ADAPTERS, "mouse", "return a source with open, info"),
    ],
)  # fmt: skip
def test_a_plug_in_that_returns_something_else_is_named(monkeypatch, call, registry, key, must):
    monkeypatch.setitem(registry, key, lambda *_: 3)
    with pytest.raises(StudyError, match=rf"its plug-in '{key}' of .*must {must}.*\(got int\)"):
        call()


def test_an_error_in_a_plug_in_is_not_taken_for_its_absence(monkeypatch):
    monkeypatch.setitem(OBSERVERS, "two-interval", lambda _study: {}["its own"])
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
    assert f"it raised {kind}" in said


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
