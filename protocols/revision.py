"""Version of this code, and the git revision it was made from.

Standard library only: the build hook (`script/hatch_build.py`) runs this file
before any dependency is there.
"""

from __future__ import annotations

import os
import re
import subprocess
from functools import cache
from pathlib import Path

UNKNOWN = "unknown"
REVISION_PATTERN = r"^(unknown|[0-9a-f]{7,40}(\+dirty|\+unchecked)?)$"
"""Pattern of what `code_revision` returns, for schemas that store it."""

# Made by git in an archive of the repository and by the build hook in a wheel.
STAMP_NAME = "_revision.txt"

_HASH = re.compile(r"[0-9a-f]{40}([0-9a-f]{24})?")
_HERE = Path(__file__).resolve().parent


@cache
def code_revision() -> str:
    """Return the git revision of the running code, asked once per process.

    Returns
    -------
    str
        Seven hexadecimal digits, followed by ``+dirty`` where tracked files
        differ from that revision, or by ``+unchecked`` where no git program
        could compare them; ``unknown`` where the code is neither a checkout nor
        an archive or wheel made from one.
    """
    return read_revision(_HERE.parent)


@cache
def package_version() -> str:
    """Return the installed version of metamerlab, or ``unknown`` if it is not installed."""
    from importlib import metadata  # slow to import, and rarely wanted

    try:
        return metadata.version("metamerlab")
    except metadata.PackageNotFoundError:
        return UNKNOWN


def read_revision(root: Path) -> str:
    """Return the revision of the code under `root`, the folder that holds our packages.

    A checkout is asked through git, or read from ``.git`` where git is missing
    or refuses; anything else tells by the stamp in ``protocols/``. Folders
    above `root` are never looked at: they may be a checkout of something else.
    """
    dot_git = root / ".git"
    if dot_git.exists():
        return _ask_git(root) or _read_dot_git(dot_git) or UNKNOWN
    return _read_stamp(root / "protocols" / STAMP_NAME) or UNKNOWN


def _ask_git(root: Path) -> str | None:
    # Inside a git hook these variables point git at another repository.
    env = {name: value for name, value in os.environ.items() if not name.startswith("GIT_")}
    env["LC_ALL"] = "C"

    def git(*arguments: str) -> str:
        return subprocess.run(
            ["git", "--no-optional-locks", "-C", str(root), *arguments],
            env=env,
            check=True,
            capture_output=True,
            text=True,
            timeout=20,
        ).stdout.strip()

    try:
        commit = git("rev-parse", "--verify", "HEAD")
        changed = git("status", "--porcelain", "--untracked-files=no")
    except (OSError, subprocess.SubprocessError):
        return None
    return commit[:7] + ("+dirty" if changed else "")


def _read_dot_git(dot_git: Path) -> str | None:
    try:
        if dot_git.is_file():  # a linked worktree: "gitdir: PATH"
            pointer = dot_git.read_text(encoding="utf-8").removeprefix("gitdir:").strip()
            dot_git = dot_git.parent / pointer
        common = dot_git
        if (dot_git / "commondir").is_file():
            common = dot_git / (dot_git / "commondir").read_text(encoding="utf-8").strip()
        head = (dot_git / "HEAD").read_text(encoding="utf-8").strip()
        if head.startswith("ref:"):
            head = _read_ref(dot_git, common, head.removeprefix("ref:").strip())
    except (OSError, UnicodeDecodeError):
        return None
    return f"{head[:7]}+unchecked" if _HASH.fullmatch(head) else None


def _read_ref(dot_git: Path, common: Path, ref: str) -> str:
    for folder in (dot_git, common):
        if (folder / ref).is_file():
            return (folder / ref).read_text(encoding="utf-8").strip()
    packed = common / "packed-refs"
    if packed.is_file():
        for line in packed.read_text(encoding="utf-8").splitlines():
            commit, _, name = line.partition(" ")
            if name == ref:
                return commit
    return ""


def _read_stamp(stamp: Path) -> str | None:
    try:
        text = stamp.read_text(encoding="utf-8").strip()
    except (OSError, UnicodeDecodeError):
        return None
    if _HASH.fullmatch(text):  # git archive writes the full hash
        return text[:7]
    # Anything else is an untouched `$Format:%H$` placeholder, or damage.
    return text if re.match(REVISION_PATTERN, text) else None
