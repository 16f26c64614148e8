"""Python, our packages, fonts and text."""

from __future__ import annotations

import importlib.metadata
import importlib.util
import platform
import re
import sys
from collections.abc import Iterable, Mapping
from importlib.machinery import PathFinder
from pathlib import Path

from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

from study_app import fonts
from study_app.doctor.findings import FOR_SESSIONS, Finding, Status


def check_python(version: tuple[int, int] | None = None) -> Finding:
    """Python 3.11 or newer, 64 bit."""
    found = f"{platform.python_version()}, {platform.machine()}, {platform.system()}"
    if (version or sys.version_info[:2]) < (3, 11) or sys.maxsize < 2**33:
        return Finding("Python", Status.FAIL, found, "install a 64-bit Python 3.11 or newer")
    return Finding("Python", Status.PASS, found)


def check_packages(
    needed: Iterable[Requirement], tested: Mapping[str, str] | None = None
) -> Finding:
    """Everything that metamerlab needs, in a version that it accepts and, best, was tested with.

    Parameters
    ----------
    needed : iterable of Requirement
        As `requirements` returns them; those of the optional parts are left out.
    tested : mapping, optional
        Name to the version that the tests ran with, as `tested_versions` reads it.
    """
    wrong, untested = [], []
    versions: dict[str, str | None] = {}
    for requirement in needed:
        if requirement.marker and not requirement.marker.evaluate({"extra": ""}):
            continue
        name = requirement.name
        version = versions[name] = _installed(name)
        if version is None:
            wrong.append(f"{name} is missing")
        elif not requirement.specifier.contains(version, prereleases=True):
            wrong.append(f"{name} {version} is not {requirement.specifier}")
        elif version != (tested or {}).get(canonicalize_name(name), version):
            untested.append(f"{name} {version}, tested {(tested or {})[canonicalize_name(name)]}")
    if wrong:
        cure = "install metamerlab again: script/setup in a checkout, pip install -U metamerlab"
        return Finding("packages", Status.FAIL, "; ".join(wrong), cure, details=versions)
    if not versions:
        cure = "install it (script/setup) to know which packages it needs"
        return Finding("packages", Status.WARN, "metamerlab is not installed", cure)
    if untested:
        cure = "script/setup installs the tested versions; others usually work"
        return Finding("packages", Status.WARN, "; ".join(untested), cure, details=versions)
    found = f"all {len(versions)} present" + (", in the tested versions" if tested else "")
    return Finding("packages", Status.PASS, found, details=versions)


def tested_versions() -> dict[str, str]:
    """Return the versions that a checkout's lock names; none where there is no checkout."""
    lock = Path(__file__).resolve().parents[2] / "requirements.lock"
    if not lock.is_file():
        return {}
    pins = re.findall(r"^[\w.-]+==[^\\\n]+", lock.read_text(encoding="utf-8"), re.MULTILINE)
    lines = [Requirement(pin.strip()) for pin in pins]
    return {
        canonicalize_name(line.name): next(iter(line.specifier)).version
        for line in lines
        if line.marker is None or line.marker.evaluate()
    }


def check_extras(requirements: Iterable[Requirement]) -> Finding:
    """Report which optional parts are installed; none is needed."""
    extras: dict[str, bool] = {}
    for requirement in requirements:
        match = re.search(r"extra\s*==\s*['\"]([\w-]+)", str(requirement.marker or ""))
        if match and match[1] != "dev":
            there = _installed(requirement.name) is not None
            extras[match[1]] = extras.get(match[1], True) and there
    present = [name for name, there in extras.items() if there]
    absent = [name for name, there in extras.items() if not there]
    found = f"installed: {', '.join(present) or 'none'}; not installed: {', '.join(absent) or '-'}"
    return Finding("optional parts", Status.PASS, found, details=extras)


def check_names(names: Iterable[str], path: Iterable[str] | None = None) -> Finding:
    """Report whether another package, or a file beside a program of yours, has a name of ours.

    Parameters
    ----------
    names : iterable of str
        Of our packages.
    path : iterable of str, optional
        The folders where Python looks; left out, `sys.path`.
    """
    folders = [*(sys.path if path is None else path)]
    elsewhere: dict[str, str] = {}
    for name in names:
        ours = importlib.util.find_spec(name)
        home = Path(ours.origin).resolve().parents[1] if ours and ours.origin else None
        other = PathFinder.find_spec(name, [one for one in folders if Path(one).resolve() != home])
        if other is not None and other.origin:  # a folder without __init__.py stands behind ours
            elsewhere[name] = other.origin
    if not elsewhere:
        return Finding("names", Status.PASS, "no other package has a name of ours")
    found = "; ".join(f"{name} is also {origin}" for name, origin in elsewhere.items())
    cure = (
        "none for this command; programs of your own begin with 'import metamerlab', or run where"
        " the other package is not installed"
    )
    return Finding("names", Status.WARN, found, cure, details=elsewhere)


def requirements() -> list[Requirement]:
    try:
        return [Requirement(line) for line in importlib.metadata.requires("metamerlab") or []]
    except importlib.metadata.PackageNotFoundError:
        return []


def _installed(name: str) -> str | None:
    try:
        return importlib.metadata.version(name)
    except importlib.metadata.PackageNotFoundError:
        return None


def check_text_shaping() -> Finding:
    """Pillow's raqm with FriBiDi: without it Arabic or Devanagari lose their shapes, silently."""
    from PIL import features

    versions = {name: features.version(name) for name in ("raqm", "fribidi", "harfbuzz")}
    found = ", ".join(f"{name} {version or 'missing'}" for name, version in versions.items())
    if features.check("raqm") and versions["fribidi"]:
        return Finding("text shaping", Status.PASS, found, "", FOR_SESSIONS, versions)
    cure = "install FriBiDi (Debian, Ubuntu: apt-get install libfribidi0); Latin text works anyway"
    return Finding("text shaping", Status.WARN, found, cure, FOR_SESSIONS, versions)


def check_fonts() -> Finding:
    """A font for instructions, and which scripts this machine can write."""
    files = fonts.find_fonts()
    best: dict[str, str] = {}  # script -> the first font that writes it
    for path in files:
        for script in fonts.scripts_of(path):
            best.setdefault(script, path.name)
        if len(best) == len(fonts.SAMPLES):
            break
    absent = [script for script in fonts.SAMPLES if script not in best]
    if "Latin" not in best:
        cure = "install one (Debian, Ubuntu: apt-get install fonts-dejavu-core)"
        return Finding("fonts", Status.FAIL, "no font for Latin text", cure, FOR_SESSIONS)
    by_font: dict[str, list[str]] = {}
    for script, font in best.items():
        by_font.setdefault(font, []).append(script)
    found = "; ".join(f"{font}: {', '.join(scripts)}" for font, scripts in by_font.items())
    if absent:
        found += f"; no font for {', '.join(absent)}"
    wide = {"Latin", "Greek", "Cyrillic"} <= best.keys()
    return Finding(
        "fonts",
        Status.PASS if wide else Status.WARN,
        found,
        "" if wide else "install a font with wide coverage (apt-get install fonts-dejavu-core)",
        FOR_SESSIONS,
        best,
    )
