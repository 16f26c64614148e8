"""Wheel for users: it holds what they need and nothing else."""

import ast
import os
import re
import subprocess
import sys
import tomllib
import zipfile
from email.parser import Parser
from importlib.metadata import packages_distributions
from pathlib import Path

import pytest
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

import metamerlab
import pipeline
from protocols.revision import STAMP_NAME, read_revision

PACKAGES = {"analysis", "pipeline", "protocols", "stimuli", "study_app"}
FOLDER = "metamerlab-packages"
ABSENT = {"pycvvdp": "cvvdp", "pylink": "sr-research-pylink"}
"""Packages of extras whose modules are called otherwise."""


@pytest.fixture(scope="module")
def wheel(repository, tmp_path_factory):
    """Build the wheel from this checkout, with the tools that are installed."""
    out = tmp_path_factory.mktemp("wheel")
    command = [sys.executable, "-P", "-m", "build", "--wheel", "--no-isolation"]
    done = subprocess.run(
        [*command, "--outdir", str(out), str(repository)],
        capture_output=True,
        text=True,
        timeout=120,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    (path,) = out.glob("*.whl")
    with zipfile.ZipFile(path) as archive:
        yield archive


@pytest.fixture(scope="module")
def contents(wheel):
    """The wheel's files outside its own metadata."""
    return {name for name in wheel.namelist() if ".dist-info/" not in name}


def sources(repository: Path) -> set[str]:
    """Return every file of the five packages, as the wheel should name it.

    What the browser's part is made of stays behind.
    """
    web = repository / "study_app/web"
    return {
        f"{FOLDER}/{path.relative_to(repository).as_posix()}"
        for package in PACKAGES
        for path in (repository / package).rglob("*")
        if path.is_file() and "__pycache__" not in path.parts
        if "node_modules" not in path.parts
        if web not in path.parents
        or path.suffix == ".py"
        or {web / "assets", web / "driven"} & {*path.parents}
    }


def test_the_wheel_puts_nothing_in_the_way_of_other_packages(contents):
    assert {name.partition("/")[0] for name in contents} == {
        FOLDER,
        "metamerlab.py",
        "metamerlab.pth",
    }


def test_the_wheel_holds_every_file_of_exactly_the_five_packages(repository, contents):
    assert contents == {*sources(repository), "metamerlab.py", "metamerlab.pth"}


def test_the_path_file_names_one_folder_and_runs_no_code(wheel):
    assert wheel.read("metamerlab.pth").decode() == f"{FOLDER}\n"


@pytest.mark.parametrize(
    ("suffix", "why"),
    [
        (".glsl", "shaders"),
        ("py.typed", "types for users' checkers"),
        ("protocols/studies/demo.toml", "studies"),
        ("protocols/templates/study.toml", "a new study's files"),
        ("study_app/cli/demo/demo.html", "page of the demonstration"),
        ("study_app/cli/demo/steps.toml", "steps of the demonstration"),
        ("protocols/page/page.html", "template of all pages"),
        ("protocols/page/page.css", "style of all pages"),
    ],
)
def test_the_wheel_carries_data_files(contents, suffix, why):
    assert any(name.endswith(suffix) for name in contents), f"no {why} in the wheel"


def test_the_five_are_put_in_front_by_their_names():
    assert set(metamerlab.PACKAGES) == PACKAGES


def test_every_package_is_typed(contents):
    assert {f"{FOLDER}/{package}/py.typed" for package in PACKAGES} <= contents


def test_the_wheel_installs_one_command(wheel):
    (entry_points,) = [name for name in wheel.namelist() if name.endswith("entry_points.txt")]

    assert wheel.read(entry_points).decode().split("\n", 1)[0] == "[console_scripts]"
    assert wheel.read(entry_points).decode().count("=") == 1


def test_the_wheel_carries_the_licence_and_asks_for_the_right_python(wheel):
    (metadata,) = [name for name in wheel.namelist() if name.endswith("METADATA")]
    fields = Parser().parsestr(wheel.read(metadata).decode())

    assert fields["Name"] == "metamerlab"
    assert fields["Requires-Python"] == ">=3.11"
    assert fields["License-File"] == "LICENSE"
    assert {"metrics", "metamers", "lsl", "dask", "onnx", "dev"} <= set(
        fields.get_all("Provides-Extra")
    )


def test_the_wheel_knows_its_revision(wheel, repository, tmp_path):
    wheel.extract(f"{FOLDER}/protocols/{STAMP_NAME}", tmp_path)

    assert read_revision(tmp_path / FOLDER) == read_revision(repository)


@pytest.mark.slow
def test_everything_that_is_imported_is_declared(repository):
    project = tomllib.loads((repository / "pyproject.toml").read_text())["project"]
    extras = project["optional-dependencies"]
    asked = [*project["dependencies"]]
    asked += [one for extra, names in extras.items() if extra != "dev" for one in names]
    declared = {canonicalize_name(Requirement(one).name) for one in asked}
    assert {"jinja2", "pydantic"} <= declared
    declared |= {"markupsafe", "pydantic-core"}  # these two tell their users to import them
    ours = PACKAGES | {"metamerlab"} | sys.stdlib_module_names
    distributions = packages_distributions()
    imported = set()
    for package in PACKAGES:
        for path in (repository / package).rglob("*.py"):
            for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
                if isinstance(node, ast.Import):
                    imported |= {alias.name.partition(".")[0] for alias in node.names}
                elif isinstance(node, ast.ImportFrom) and node.module and not node.level:
                    imported.add(node.module.partition(".")[0])

    # A module that is not installed here cannot be asked whose it is.
    owners = {name: [ABSENT.get(name, name)] for name in imported} | distributions
    undeclared = {
        name
        for name in imported - ours
        if not declared & {canonicalize_name(owner) for owner in owners[name]}
    }
    assert {"numpy", "packaging"} <= imported
    assert undeclared == set()


@pytest.mark.skipif(
    os.environ.get("METAMERLAB_TEST_WHEEL") != "1", reason="only under script/test --wheel"
)
def test_the_tests_run_against_the_installed_wheel(repository):
    assert repository not in Path(pipeline.__file__).parents or ".venv" in pipeline.__file__
    assert not any(Path(entry).resolve() == repository for entry in sys.path)


def test_every_extra_for_users_stands_on_the_installing_page(repository):
    project = tomllib.loads((repository / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    page = (repository / "docs/installing.md").read_text(encoding="utf-8")
    told = page.partition("Extras bring")[2].partition("\n\n")[0]

    extras = set(project["optional-dependencies"]) - {"docs", "dev"}
    assert [extra for extra in sorted(extras) if f"`{extra}`" not in told] == []


def test_a_job_of_the_workflow_tests_with_every_extra_installed(repository):
    project = tomllib.loads((repository / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    workflow = (repository / ".github/workflows/tests.yml").read_text(encoding="utf-8")
    (installed,) = re.findall(r'--editable\s+"\.\[([\w,]+,[\w,]+)\]"', workflow)

    assert {*installed.split(","), "dev"} == {*project["optional-dependencies"]}


def test_the_container_has_the_system_packages_and_runs_as_nobody_special(repository):
    container = (repository / "Containerfile").read_text(encoding="utf-8")
    table = (repository / "script/lib.sh").read_text(encoding="utf-8")
    needed = table.partition('SYSTEM_PACKAGES="')[2].partition('"')[0].splitlines()
    image = container.rpartition("\nFROM ")[2]
    page = (repository / "docs/installing.md").read_text(encoding="utf-8")
    told = page.partition("apt-get install")[2].partition("\n")[0]

    for line in filter(None, needed):
        name = line.split()[0]
        if name != "xdotool":  # only tests type and click
            assert name in image.split(), name
            assert name in told.split(), name
    assert "\nUSER 1000\n" in image.partition("ENTRYPOINT")[0]


def test_the_container_is_built_of_what_git_and_the_lock_know(repository):
    sent = (repository / ".dockerignore").read_text(encoding="utf-8").split()
    container = (repository / "Containerfile").read_text(encoding="utf-8")

    assert sent == ["*", "!requirements.lock", "!dist/*.whl"]
    assert "COPY requirements.lock dist/*.whl ./" in container
    assert '|| { echo "$wheel is not in requirements.lock"; exit 1; }' in container
