"""Make a release of what is committed: version, changelog, checks, wheel and tag.

  script/release 0.3.0 --dry-run   says what would change, and changes nothing
  script/release 0.3.0             makes the commit and the tag; nothing is pushed

towncrier moves the lines of changelog.d/ to CHANGELOG.md. If a check fails, the commit is taken
back.
"""

from __future__ import annotations

import argparse
import datetime
import re
import subprocess
import sys
from pathlib import Path

from packaging.version import InvalidVersion, Version

ROOT = Path(__file__).resolve().parents[1]


class RefusedError(Exception):
    """No release can be made; the message says why, and what to do."""


def main(argv: list[str]) -> int:
    """Make the release, or say why not (status 2)."""
    parser = argparse.ArgumentParser(
        prog="script/release", description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("version", help="such as 0.3.0")
    parser.add_argument("--dry-run", action="store_true", help="only say what would change")
    arguments = parser.parse_args(argv)
    try:
        release(ROOT, arguments.version, dry_run=arguments.dry_run)
    except RefusedError as reason:
        print(f"script/release: {reason}", file=sys.stderr)
        return 2
    return 0


def release(root: Path, version: str, *, dry_run: bool = False) -> None:
    """Release the committed state of the repository `root` as `version`.

    Raises
    ------
    RefusedError
        If the tree is not clean, the version is no next one, its tag exists, there is nothing
        to tell, or a check fails.
    """
    refuse_what_is_not_ready(root, version)
    today = datetime.datetime.now(datetime.UTC).date().isoformat()
    texts = new_texts(root, version, today)
    told = changelog(root, version, today, "--draft")
    if dry_run:
        print(f"{version}: would commit and tag v{version} with {', '.join(texts)}, CHANGELOG.md")
        print(f"would remove the fragments; CHANGELOG.md would say:\n\n{told}")
        return
    start = git(root, "rev-parse", "HEAD")
    for name, text in texts.items():
        (root / name).write_text(text, encoding="utf-8")
    changelog(root, version, today, "--yes")
    git(root, "add", "--all", *texts, "CHANGELOG.md", "changelog.d")
    git(root, "commit", "--quiet", "--message", f"Release {version}")
    try:
        wheel = build_and_check(root, version)
    except BaseException:
        git(root, "reset", "--quiet", "--keep", start)
        raise
    git(root, "tag", "--annotate", "--message", f"metamerlab {version}", f"v{version}")
    print(f"{wheel.relative_to(root)} is built, and v{version} is tagged. To publish:")
    print(f"  git push origin HEAD v{version}")


def refuse_what_is_not_ready(root: Path, version: str) -> None:
    """Raise `RefusedError` unless `version` can be released from here."""
    current = re.search(r'^version = "(.*)"$', read(root, "pyproject.toml"), re.MULTILINE)
    assert current is not None
    try:
        wanted = Version(version)
    except InvalidVersion:
        wanted = Version("0")
    if not re.fullmatch(r"\d+\.\d+\.\d+", version) or wanted < Version(current[1]):
        raise RefusedError(
            f"the version must be three numbers, and not before {current[1]} (got {version!r})"
        )
    if changed := git(root, "status", "--porcelain"):
        raise RefusedError(f"everything must be committed or removed first:\n{changed}")
    if git(root, "tag", "--list", f"v{version}"):
        raise RefusedError(f"the tag v{version} exists; choose a later version")
    if not [*(root / "changelog.d").rglob("*.*.md")]:
        raise RefusedError("changelog.d/ is empty; write what users will notice there")


def new_texts(root: Path, version: str, today: str) -> dict[str, str]:
    """Return the files that name the version, as they will be, by path."""
    date = f'date-released: "{today}"\n'
    citation = re.sub(r"^date-released:.*\n", "", read(root, "CITATION.cff"), flags=re.MULTILINE)
    return {
        "pyproject.toml": once(
            r'^version = ".*"$', f'version = "{version}"', read(root, "pyproject.toml")
        ),
        "CITATION.cff": once(r"^version: .*\n", f"version: {version}\n{date}", citation),
    }


def changelog(root: Path, version: str, today: str, *words: str) -> str:
    """Let towncrier tell of a version; return what it printed."""
    towncrier = [sys.executable, "-P", "-m", "towncrier", "build", "--version", version]
    done = subprocess.run(
        [*towncrier, "--date", today, *words], cwd=root, capture_output=True, text=True
    )
    if done.returncode:
        raise RefusedError(f"towncrier: {done.stderr.strip()}")
    return done.stdout


def build_and_check(root: Path, version: str) -> Path:
    """Run all checks on the commit of the release, and build it into dist/.

    Raises
    ------
    RefusedError
        If one fails.
    """
    if subprocess.run([root / "script/check"], cwd=root).returncode:
        raise RefusedError("script/check must pass; the release was taken back")
    build = [sys.executable, "-P", "-m", "build", "--no-isolation", "--outdir", "dist", "."]
    if subprocess.run(build, cwd=root, stdout=subprocess.DEVNULL).returncode:
        raise RefusedError("the wheel must build; the release was taken back")
    if changed := git(root, "status", "--porcelain"):
        raise RefusedError(f"the checks must leave the tree as it was; taken back:\n{changed}")
    return root / "dist" / f"metamerlab-{version}-py3-none-any.whl"


def read(root: Path, name: str) -> str:
    return (root / name).read_text(encoding="utf-8")


def once(pattern: str, text: str, where: str) -> str:
    """Replace exactly one match."""
    result, count = re.subn(pattern, text, where, flags=re.MULTILINE)
    if count != 1:
        raise RefusedError(
            f"{pattern!r} must stand once in a file that names the version (got {count})"
        )
    return result


def git(root: Path, *words: str) -> str:
    """Run git; give what it printed."""
    done = subprocess.run(["git", "-C", root, *words], capture_output=True, text=True)
    if done.returncode:
        raise RefusedError(f"git {' '.join(words)}: {done.stderr.strip()}")
    return done.stdout.strip("\n")


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
