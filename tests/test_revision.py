"""The revision that results carry names the code that made them."""

import re
import shutil
import subprocess

import pytest

from protocols.revision import (
    REVISION_PATTERN,
    STAMP_NAME,
    UNKNOWN,
    code_revision,
    package_version,
    read_revision,
)

COMMIT = "3f2a91c07d5e4b8a9c6d1e2f3a4b5c6d7e8f9a0b"

needs_git = pytest.mark.skipif(shutil.which("git") is None, reason="needs git")


def git(folder, *arguments):
    identity = ("-c", "user.name=A", "-c", "user.email=a@example.invalid")
    command = ["git", "-C", str(folder), *identity, *arguments]
    return subprocess.run(command, check=True, capture_output=True, text=True).stdout.strip()


@pytest.fixture
def checkout(tmp_path):
    """A real repository with one commit."""
    git(tmp_path, "init", "--quiet")
    (tmp_path / "code.py").write_text("a = 1\n")
    git(tmp_path, "add", "code.py")
    git(tmp_path, "commit", "--quiet", "--message", "One")
    return tmp_path


@pytest.fixture
def without_git(monkeypatch, tmp_path_factory):
    """A machine on which there is no git program."""
    monkeypatch.setenv("PATH", str(tmp_path_factory.mktemp("empty")))


def stamp(root, text):
    (root / "protocols").mkdir()
    (root / "protocols" / STAMP_NAME).write_text(text)


@needs_git
def test_a_clean_checkout_tells_its_commit(checkout):
    assert read_revision(checkout) == git(checkout, "rev-parse", "HEAD")[:7]


@needs_git
def test_a_changed_file_makes_the_revision_dirty(checkout):
    (checkout / "code.py").write_text("a = 2\n")

    assert read_revision(checkout) == git(checkout, "rev-parse", "HEAD")[:7] + "+dirty"


@needs_git
def test_a_staged_change_makes_the_revision_dirty(checkout):
    (checkout / "code.py").write_text("a = 2\n")
    git(checkout, "add", "code.py")

    assert read_revision(checkout).endswith("+dirty")


@needs_git
def test_an_untracked_file_leaves_the_revision_clean(checkout):
    (checkout / "notes.txt").write_text("mine\n")

    assert "+" not in read_revision(checkout)


@needs_git
def test_variables_of_a_git_hook_do_not_lead_to_another_repository(checkout, monkeypatch):
    expected = read_revision(checkout)
    monkeypatch.setenv("GIT_DIR", str(checkout / "elsewhere"))

    assert read_revision(checkout) == expected


@needs_git
@pytest.mark.parametrize("packed", [False, True])
def test_without_git_the_commit_is_read_and_said_to_be_unchecked(checkout, packed, without_git):
    del without_git  # from here on PATH is empty
    commit = (checkout / ".git" / (checkout / ".git/HEAD").read_text()[5:].strip()).read_text()
    if packed:
        ref = (checkout / ".git/HEAD").read_text().removeprefix("ref: ").strip()
        (checkout / ".git" / ref).unlink()
        (checkout / ".git/packed-refs").write_text(
            f"# pack-refs with: peeled\n{commit[:40]} {ref}\n"
        )

    assert read_revision(checkout) == f"{commit[:7]}+unchecked"


def test_a_detached_head_is_read_without_git(tmp_path, without_git):
    del without_git
    (tmp_path / ".git").mkdir()
    (tmp_path / ".git/HEAD").write_text(COMMIT + "\n")

    assert read_revision(tmp_path) == "3f2a91c+unchecked"


def test_a_linked_worktree_is_followed_without_git(tmp_path, without_git):
    del without_git
    main, tree = tmp_path / "main", tmp_path / "tree"
    private = main / ".git/worktrees/tree"
    (main / ".git/refs/heads").mkdir(parents=True)
    private.mkdir(parents=True)
    tree.mkdir()
    (tree / ".git").write_text(f"gitdir: {private}\n")
    (private / "HEAD").write_text("ref: refs/heads/side\n")
    (private / "commondir").write_text("../..\n")
    (main / ".git/refs/heads/side").write_text(COMMIT + "\n")

    assert read_revision(tree) == "3f2a91c+unchecked"


@pytest.mark.parametrize("content", [{}, {"HEAD": "ref: refs/heads/none\n"}, {"HEAD": "rubbish"}])
def test_a_damaged_checkout_is_unknown(tmp_path, content, without_git):
    del without_git
    (tmp_path / ".git").mkdir()
    for name, text in content.items():
        (tmp_path / ".git" / name).write_text(text)

    assert read_revision(tmp_path) == UNKNOWN


@pytest.mark.parametrize(
    ("text", "revision"),
    [
        (COMMIT + "\n", "3f2a91c"),  # as git archive writes it
        ("3f2a91c+dirty\n", "3f2a91c+dirty"),  # as the build hook writes it
        ("unknown\n", UNKNOWN),
        ("$Format:%H$\n", UNKNOWN),  # copied from a checkout, without its .git
        ("", UNKNOWN),
    ],
)
def test_outside_a_checkout_the_stamp_tells(tmp_path, text, revision):
    stamp(tmp_path, text)

    assert read_revision(tmp_path) == revision


def test_a_repository_further_up_is_not_ours(tmp_path):
    (tmp_path / ".git").mkdir()
    (tmp_path / ".git/HEAD").write_text(COMMIT + "\n")
    installed = tmp_path / "site-packages"
    installed.mkdir()

    assert read_revision(installed) == UNKNOWN


@needs_git
def test_an_archive_made_by_git_knows_its_commit(repository, tmp_path):
    if not (repository / ".git").exists():
        pytest.skip("needs a checkout")
    archive = tmp_path / "code.zip"
    git(repository, "archive", "--output", str(archive), "HEAD", "protocols")
    shutil.unpack_archive(archive, tmp_path / "code")

    assert read_revision(tmp_path / "code") == git(repository, "rev-parse", "HEAD")[:7]


def test_this_code_tells_a_revision_of_the_promised_form():
    assert re.match(REVISION_PATTERN, code_revision())


def test_the_installed_version_is_the_one_in_pyproject(repository):
    listed = (repository / "pyproject.toml").read_text(encoding="utf-8")

    assert f'version = "{package_version()}"' in listed
