"""`script/release` in a scratch clone: what it writes, what it refuses, what it takes back."""

import os
import re
import shutil
import subprocess
import sys
import tomllib
import zipfile
from pathlib import Path

import pytest
import yaml

COMMITTER = {
    f"GIT_{role}_{key}": value
    for role in ("AUTHOR", "COMMITTER")
    for key, value in (("NAME", "A Maintainer"), ("EMAIL", "maintainer@example.org"))
}
TOOLS = (
    "script/release.py", "script/hatch_build.py", "pyproject.toml", "CITATION.cff",
    "script/changelog.md.jinja",
)  # fmt: skip
START = "<!-- the newest release comes below -->"


class Clone:
    """A clone of this repository, with the files of the working tree that make a release."""

    def __init__(self, folder: Path, repository: Path) -> None:
        self.folder = folder
        git = ["git", "clone", "--quiet", "--shared", "--no-tags", repository, folder]
        subprocess.run(git, check=True, capture_output=True)
        for name in TOOLS:
            shutil.copy(repository / name, folder / name)
        for fragment in (folder / "changelog.d").rglob("*.*.md"):
            fragment.unlink()
        self.write("CHANGELOG.md", f"# Changelog\n\n{START}\n\n## 0.1.0\n\n- First.\n")
        self.write("changelog.d/analysis/faster.changed.md", "Reports took half the time.\n")
        self.write("changelog.d/dots.added.md", "Added dots.\n")
        self.write("changelog.d/analysis/rows.added.md", "Added rows.\n")
        self.write("changelog.d/stimuli/scenes.added.md", "Added scenes.\n")
        self.checks('test -z "$(git status --porcelain)"')

    def write(self, name: str, text: str) -> None:
        (self.folder / name).parent.mkdir(exist_ok=True)
        (self.folder / name).write_text(text, encoding="utf-8")

    def read(self, name: str) -> str:
        return (self.folder / name).read_text(encoding="utf-8")

    def checks(self, command: str) -> None:
        """Let `script/check` be one command, and commit."""
        self.write("script/check", f"#!/bin/sh\n{command}\n")
        self.git("add", "--all")
        self.git("commit", "--quiet", "--message", "Before the release")

    def git(self, *words: str) -> str:
        done = subprocess.run(
            ["git", "-C", self.folder, *words],
            env={**os.environ, **COMMITTER},
            check=True, capture_output=True, text=True,
        )  # fmt: skip
        return done.stdout.strip()

    def release(self, *words: str, status: int = 0) -> str:
        """Run the command; give what it said."""
        done = subprocess.run(
            [sys.executable, "-P", self.folder / "script/release.py", *words],
            env={**os.environ, **COMMITTER}, capture_output=True, text=True,
        )  # fmt: skip
        assert done.returncode == status, done.stdout + done.stderr
        return done.stdout + done.stderr

    def state(self) -> tuple[str, str, str]:
        """State that a refused release must leave alone."""
        return self.git("rev-parse", "HEAD"), self.git("tag"), self.git("status", "--porcelain")


@pytest.fixture
def clone(tmp_path, repository):
    if shutil.which("git") is None or not (repository / ".git").exists():
        pytest.skip("needs git and a checkout; install git, and clone the repository")
    return Clone(tmp_path / "clone", repository)


@pytest.mark.slow
def test_a_release_has_version_changelog_wheel_and_tag(clone):
    said = clone.release("1.0.0")

    assert "v1.0.0 is tagged" in said
    assert clone.git("tag") == "v1.0.0"
    assert clone.git("rev-parse", "v1.0.0^{commit}") == clone.git("rev-parse", "HEAD")
    assert clone.git("status", "--porcelain") == ""
    assert tomllib.loads(clone.read("pyproject.toml"))["project"]["version"] == "1.0.0"
    citation = yaml.safe_load(clone.read("CITATION.cff"))
    assert citation["version"] == "1.0.0"
    assert re.fullmatch(r"\d{4}-\d\d-\d\d", citation["date-released"])
    assert clone.read("CHANGELOG.md") == (
        f"# Changelog\n\n{START}\n\n## 1.0.0 ({citation['date-released']})\n"
        "\n### Changed\n\n#### Analysis\n\n- Reports took half the time.\n"
        "\n### Added\n\n- Added dots.\n"
        "\n#### Stimuli and pictures\n\n- Added scenes.\n\n#### Analysis\n\n- Added rows.\n"
        "\n## 0.1.0\n\n- First.\n"
    )
    left = (clone.folder / "changelog.d").rglob("*")
    assert [p.name for p in left if p.is_file()] == ["README.md"]
    wheel = clone.folder / "dist/metamerlab-1.0.0-py3-none-any.whl"
    with zipfile.ZipFile(wheel) as archive:
        revision = archive.read("metamerlab-packages/protocols/_revision.txt").decode()
    assert revision.strip() == clone.git("rev-parse", "--short=7", "HEAD")


def test_a_dry_run_changes_nothing(clone):
    before = clone.state()

    assert "- Added dots." in clone.release("1.0.0", "--dry-run")
    assert clone.state() == before
    assert not (clone.folder / "dist").exists()


@pytest.mark.parametrize(
    ("version", "message"),
    [("0.0.9", "not before"), ("1.0", "three numbers"), ("v1.0.0", "three numbers")],
)
def test_a_version_that_is_no_next_one_is_refused(clone, version, message):
    assert message in clone.release(version, status=2)


def test_what_is_not_committed_tagged_already_or_fails_its_checks_is_refused(clone):
    clone.write("notes.txt", "mine")
    assert "notes.txt" in clone.release("1.0.0", status=2)
    assert clone.read("notes.txt") == "mine"

    (clone.folder / "notes.txt").unlink()
    clone.git("tag", "v1.0.0")
    assert "the tag v1.0.0 exists" in clone.release("1.0.0", status=2)

    clone.checks("exit 1")
    before = clone.state()
    assert "script/check must pass" in clone.release("1.0.1", status=2)
    assert clone.state() == before
    assert (clone.folder / "changelog.d/dots.added.md").exists()


def test_nothing_to_tell_is_refused(clone):
    clone.git(
        "rm", "--quiet", "changelog.d/*.added.md", "changelog.d/*.changed.md"
    )  # below folders too
    clone.git("commit", "--quiet", "--message", "No news")

    assert "changelog.d/ is empty" in clone.release("1.0.0", status=2)


def test_the_citation_names_this_version_and_its_papers(repository):
    citation = yaml.safe_load((repository / "CITATION.cff").read_text(encoding="utf-8"))
    project = tomllib.loads((repository / "pyproject.toml").read_text(encoding="utf-8"))["project"]

    assert citation["cff-version"] == "1.2.0"
    assert citation["version"] == project["version"]
    assert citation["license"] == project["license"]
    assert citation["abstract"] == project["description"]
    assert citation["message"]
    assert citation["authors"] == project["authors"]
    assert all(re.fullmatch(r"10\.\d+/\S+", paper["doi"]) for paper in citation["references"])
