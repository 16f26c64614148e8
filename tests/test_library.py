"""Calls that `import metamerlab` offers: each there, typed, and shown by an example that runs."""

import ast
import inspect
import re
import subprocess
import sys

import pytest

import metamerlab
from protocols.errors import StudyError


@pytest.fixture(scope="module")
def page(repository):
    """Page on the calls."""
    return (repository / "docs" / "library.md").read_text(encoding="utf-8")


@pytest.fixture(scope="module")
def examples(page):
    """Code of every example, in the order of the page."""
    return re.findall(r"^```python\n(.*?)^```", page, flags=re.MULTILINE | re.DOTALL)


@pytest.mark.slow
def test_every_example_runs(examples, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    names: dict[str, object] = {}
    for number, example in enumerate(examples, 1):
        exec(compile(example, f"example {number}", "exec"), names)


def test_the_page_names_every_call_and_shows_it(page, examples):
    named = set(re.findall(r"`(\w+)`", "".join(re.findall(r"^\| `.*$", page, flags=re.M))))
    shown = {
        node.attr
        for example in examples
        for node in ast.walk(ast.parse(example))
        if isinstance(node, ast.Attribute) and ast.unparse(node.value) == "metamerlab"
    }
    # Clips of a shipped study take minutes: the page says the call, and tests of builds make it.
    told = {"build", "create_context", "Equirectangular"}

    assert set(metamerlab.OFFERED) - {"Flat", "SourceFrame", "Equirectangular"} <= named
    assert shown == set(metamerlab.OFFERED) - told
    assert all(f"metamerlab.{name}" in page or f"`{name}`" in page for name in told)


def test_types_and_calls_are_the_same_list(repository):
    tree = ast.parse((repository / "metamerlab.py").read_text(encoding="utf-8"))
    (typed,) = (
        node for node in tree.body if isinstance(node, ast.If) and "TYPE" in ast.unparse(node.test)
    )
    lines = {
        alias.asname: f"{node.module}:{alias.name}"
        for node in typed.body
        if isinstance(node, ast.ImportFrom)
        for alias in node.names
    }

    assert lines == metamerlab.OFFERED
    assert sorted(metamerlab.OFFERED) == [name for name in dir(metamerlab) if name != "main"]


@pytest.mark.parametrize("name", sorted(metamerlab.OFFERED))
def test_a_call_says_what_it_takes(name):
    call = getattr(metamerlab, name)

    assert inspect.getdoc(call)
    made = inspect.signature(call)
    assert all(one.annotation is not inspect.Parameter.empty for one in made.parameters.values())


def test_a_name_that_is_not_offered_is_no_attribute():
    with pytest.raises(AttributeError, match="no attribute 'inpaint'"):
        getattr(metamerlab, "inpaint")  # noqa: B009 (as a program writes it)


def test_what_a_call_would_leave_aside_is_refused(tmp_path):
    with pytest.raises(StudyError, match=r"no settings=: those are a table's"):
        metamerlab.report(tmp_path, tmp_path / "out", study="demo", settings={"alpha": "0.01"})
    with pytest.raises(StudyError, match=r"must be at least 1 \(got 0\)"):
        metamerlab.simulate("demo", tmp_path / "sessions", 0)
    with pytest.raises(ValueError, match=r"assumed must name some of rate.*\(got rat\)"):
        metamerlab.power("demo", {"rat": 0.6})


@pytest.mark.parametrize(
    ("name", "without"),
    [
        ("fill", ("analysis", "pandas", "stimuli", "study_app", "typer")),
        ("preferences", ("moderngl", "pipeline", "stimuli", "study_app", "typer")),
        ("load_protocol", ("analysis", "moderngl", "pandas", "stimuli", "study_app", "typer")),
        ("simulate", ("glfw", "matplotlib", "pandas")),
    ],
)
def test_a_call_loads_only_what_it_needs(name, without):
    code = f"import sys, metamerlab; metamerlab.{name}; print(*sys.modules)"
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, timeout=120, check=True
    )

    loaded = {module.partition(".")[0] for module in done.stdout.split()}
    assert loaded.isdisjoint(without)


def test_importing_the_front_loads_none_of_the_packages():
    code = "import sys, metamerlab; print(*sys.modules)"
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, timeout=120, check=True
    )

    loaded = {module.partition(".")[0] for module in done.stdout.split()}
    assert loaded.isdisjoint({*metamerlab.PACKAGES, "numpy"})
