"""The built wheel works by itself, in an environment where other packages have our names.

It is installed without a network beside the packages that the tests run with; nothing of the
checkout can be imported there.
"""

import os
import re
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest
from PIL import Image

from protocols.revision import read_revision

pytestmark = pytest.mark.slow

# Of the running environment, whatever path files made it; never the checkout.
LIBRARIES = [entry for entry in sys.path if Path(entry).name in ("site-packages", "dist-packages")]
PIP = [sys.executable, "-P", "-m", "pip", "--disable-pip-version-check"]
TAKEN = ("analysis", "pipeline", "protocols", "stimuli")

Run = Callable[..., str]


def call(*words: object, cwd: Path, status: int = 0) -> str:
    """Run a command that knows nothing of the checkout; give what it said."""
    env = {name: value for name, value in os.environ.items() if not name.startswith("PYTHON")}
    done = subprocess.run(
        [*map(str, words)], cwd=cwd, env={**env, "COLUMNS": "200"}, capture_output=True, text=True
    )
    assert done.returncode == status, (words, done.stdout, done.stderr)
    return done.stdout + done.stderr


@pytest.fixture(scope="module")
def site(repository, tmp_path_factory) -> Path:
    """The site folder of an environment with the wheel, and with packages of four of our names."""
    root = tmp_path_factory.mktemp("installed")
    call(sys.executable, "-P", "-m", "build", "--wheel", "--no-isolation", "--outdir", root,
         repository, cwd=root)  # fmt: skip
    call(sys.executable, "-P", "-m", "venv", "--without-pip", root / "venv", cwd=root)
    (site,) = (root / "venv/lib").glob("python*/site-packages")
    (site / "others.pth").write_text("\n".join(LIBRARIES) + "\n", encoding="utf-8")
    for name in TAKEN:
        (site / name).mkdir()
        text = f"raise SystemExit('{name} of another package was imported')\n"
        (site / name / "__init__.py").write_text(text, encoding="utf-8")
    (wheel,) = root.glob("*.whl")
    call(*PIP, "--python", root / "venv/bin/python", "install", "--no-deps", "--no-index",
         "--no-compile", wheel, cwd=root)  # fmt: skip
    return site


@pytest.fixture(scope="module")
def python(site) -> Path:
    """The interpreter of that environment."""
    return site.parents[2] / "bin/python"


@pytest.fixture
def metamerlab(python, tmp_path) -> Run:
    """Run the installed command in an empty folder."""

    def run(*words: object, status: int = 0) -> str:
        return call(python.with_name("metamerlab"), *words, cwd=tmp_path, status=status)

    return run


def test_the_installed_command_knows_its_version_and_revision(metamerlab, repository):
    assert f"(git revision {read_revision(repository)})" in metamerlab("--version")


def test_a_study_runs_from_an_empty_folder_to_its_sessions(metamerlab, tmp_path):
    metamerlab("new-study", "acuity", "--task", "identification")
    assert "40 stills built" in metamerlab(
        "stimuli", "build", "acuity/study.toml", "--out", "clips", "--workers", 2
    )
    said = metamerlab("session", "simulate", "acuity/study.toml", "--stimuli", "clips",
                      "--out", "sessions")  # fmt: skip

    assert "decisions" in said
    assert [*(tmp_path / "sessions").rglob("*.jsonl")]


def test_other_packages_keep_their_files_and_programs_choose_ours(site, python, tmp_path):
    ours = 'import metamerlab, stimuli, pipeline.errors; print("ours", stimuli.__file__)'
    late = "import sys; sys.modules['stimuli'] = type(sys)('stimuli'); import metamerlab"

    assert "stimuli of another package" in call(
        python, "-c", "import stimuli", cwd=tmp_path, status=1
    )
    assert f"ours {site / 'metamerlab-packages/stimuli/__init__.py'}" in call(
        python, "-c", ours, cwd=tmp_path
    )
    assert "'stimuli' must be metamerlab's" in call(python, "-c", late, cwd=tmp_path, status=1)
    for name in TAKEN:
        (site / name / "__init__.py").rename(site / name / "aside")
    try:
        assert "packages/stimuli" in call(
            python, "-c", "import stimuli; print(stimuli.__file__)", cwd=tmp_path
        )
    finally:
        for name in TAKEN:
            (site / name / "aside").rename(site / name / "__init__.py")


def test_the_package_of_the_installing_page_adds_its_method(
    metamerlab, python, repository, tmp_path
):
    page = (repository / "docs/installing.md").read_text(encoding="utf-8")
    (project,) = re.findall(r"```toml\n(.*?)```", page, flags=re.DOTALL)
    (module,) = re.findall(r"```python\n(.*?)```", page, flags=re.DOTALL)
    (command,) = re.findall(r"^\$ metamerlab (warp .*)$", page, flags=re.MULTILINE)
    package = tmp_path / "mean-fill"
    package.mkdir()
    (package / "pyproject.toml").write_text(project, encoding="utf-8")
    (package / "mean_fill.py").write_text(module, encoding="utf-8")
    install = ("install", "--no-deps", "--no-index", "--no-build-isolation", package)
    call(*PIP, "--python", python, *install, cwd=tmp_path)
    metamerlab(*command.split())

    with Image.open(tmp_path / "filled.png") as filled:
        assert filled.size == (741, 500)


@pytest.mark.full
@pytest.mark.timeout(900)
def test_the_installed_demonstration_writes_its_page(metamerlab, tmp_path):
    metamerlab("demo", "--out", "demo", "--participants", 3)

    assert (tmp_path / "demo/index.html").stat().st_size > 10_000
    assert [*(tmp_path / "demo").rglob("report.html")]
