"""The code weighs no more than `budgets.toml` says."""

import io
import subprocess
import tokenize
import tomllib
from collections import Counter
from collections.abc import Mapping

import pytest

TOPS = ("analysis", "study_app", "stimuli", "pipeline", "protocols", "benchmarks", "script")
OTHER = {".ts": "typescript", ".glsl": "glsl", ".jinja": "templates", ".html": "templates"}
OF_SCRIPT = "metamerlab.py"  # counts as part of script/


def tokens_of(source: str) -> int:
    """Return the number of Python's tokens; a formatted string is one, as before Python 3.12."""
    count = inside = 0
    begin, end = getattr(tokenize, "FSTRING_START", None), getattr(tokenize, "FSTRING_END", None)
    for token in tokenize.generate_tokens(io.StringIO(source).readline):
        if token.type == end:
            inside -= 1
            continue
        count += inside == 0
        inside += token.type == begin
    return count


def weigh(sources: Mapping[str, str]) -> dict[str, Counter[str]]:
    """Return what `budgets.toml` limits, section by section.

    Parameters
    ----------
    sources : mapping
        Text of every tracked file, by its path.
    """
    found = {name: Counter[str]() for name in ("lines", "files", "other")}
    for path, text in sources.items():
        top = "script" if path == OF_SCRIPT else path.partition("/")[0]
        lines = text.count("\n")
        if path.endswith(".py") and top in (*TOPS, "tests"):
            found["lines"][top] += lines
            if top == "tests":
                found["lines"]["helpers"] += lines * path.startswith("tests/helpers/")
                continue
            found["files"].update([top, "all"])
            found["other"]["tokens"] += tokens_of(text)
        elif top in TOPS and (kind := OTHER.get(path[path.rfind(".") :])):
            found["other"][kind] += lines
    return found


def above(found: Mapping[str, Counter[str]], budgets: Mapping[str, Mapping[str, int]]) -> list[str]:
    """Return a line for everything that weighs more than it may."""
    return [
        f"{section}.{name}: {found[section][name]:,} of at most {most:,},"
        f" {found[section][name] - most:,} too many"
        for section, limits in budgets.items()
        for name, most in limits.items()
        if found[section][name] > most
    ]


@pytest.fixture(scope="module")
def sources(repository) -> dict[str, str]:
    """Text of every tracked file of a kind that is weighed, by path."""
    listed = subprocess.run(
        ["git", "-C", str(repository), "ls-files"], capture_output=True, text=True
    )
    if listed.returncode:
        pytest.skip("this is no checkout")
    return {
        path: (repository / path).read_text(encoding="utf-8")
        for path in listed.stdout.splitlines()
        if path.endswith((".py", *OTHER)) and (repository / path).is_file()
    }


@pytest.mark.slow
def test_nothing_weighs_more_than_its_budget(sources, repository):
    budgets = tomllib.loads((repository / "budgets.toml").read_text(encoding="utf-8"))
    found = weigh(sources)

    assert set(budgets["lines"]) == {*TOPS, "tests", "helpers"}
    assert set(budgets["files"]) == {*TOPS, "all"}
    assert set(budgets["other"]) == {"tokens", *OTHER.values()}
    for section, limits in budgets.items():
        for name, most in limits.items():
            print(f"{section}.{name}: {found[section][name]:,} of {most:,}")
    over = above(found, budgets)
    assert not over, "\n".join(over) + "\nwhat leaves for it? see budgets.toml"


def test_what_weighs_too_much_is_named_with_by_how_much():
    sources = {"analysis/a.py": 'x = f"{1} a"\n\n', "tests/t.py": "y\n", "pipeline/s.glsl": "z\n"}
    found = weigh(sources)

    assert found["other"]["tokens"] == 6  # x, =, the text, two ends of lines, the end
    assert found["lines"] == {"analysis": 2, "tests": 1, "helpers": 0}
    assert found["files"] == {"analysis": 1, "all": 1}
    assert above(found, {"lines": {"analysis": 2}, "other": {"glsl": 1}}) == []
    assert above(found, {"lines": {"analysis": 1}}) == [
        "lines.analysis: 2 of at most 1, 1 too many"
    ]
