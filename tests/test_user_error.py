"""A user's mistake has one root, which the command line catches."""

import ast
from collections.abc import Iterator
from pathlib import Path

import pytest
import typer

from pipeline.errors import GLUnavailableError, InputError, MissingExtraError
from protocols.errors import StudyError
from study_app.cli.error_messages import user_errors

PACKAGES = ("analysis", "pipeline", "protocols", "stimuli", "study_app")
BUGS = {"ShaderError", "_RefusedError", "NetworkError"}  # a shader of ours; what is caught nearby


def trees(repository: Path) -> Iterator[tuple[Path, ast.Module]]:
    for package in PACKAGES:
        for path in sorted((repository / package).rglob("*.py")):
            yield path, ast.parse(path.read_text(encoding="utf-8"))


def errors_of(repository: Path) -> dict[str, set[str]]:
    """The names of the bases of each class of an exception."""
    return {
        node.name: {ast.unparse(base) for base in node.bases}
        for _, tree in trees(repository)
        for node in ast.walk(tree)
        if isinstance(node, ast.ClassDef) and node.bases and node.name.endswith("Error")
    }


def kin(bases: dict[str, set[str]]) -> set[str]:
    found = {"UserError"}
    while more := {name for name, above in bases.items() if above & found} - found:
        found |= more
    return found


def test_every_exception_of_the_packages_has_the_one_root(repository):
    bases = errors_of(repository)
    assert {"StudyError", "InputError", "DiskError"} <= kin(bases)

    assert set(bases) - kin(bases) == BUGS


@pytest.mark.slow
def test_no_handler_lists_kinds_of_a_users_mistake(repository):
    ours = kin(errors_of(repository))
    listed = [
        f"{path.relative_to(repository)}:{node.lineno}: {ast.unparse(node.type)}"
        for path, tree in trees(repository)
        for node in ast.walk(tree)
        if isinstance(node, ast.ExceptHandler) and isinstance(node.type, ast.Tuple)
        if len(ours & {ast.unparse(one) for one in node.type.elts}) > 1
    ]

    assert not listed, f"catch UserError: {listed}"


@pytest.mark.parametrize("kind", [StudyError, InputError, MissingExtraError, GLUnavailableError])
def test_the_command_line_prints_each_with_status_2(kind, capsys):
    with pytest.raises(typer.Exit) as caught, user_errors():
        raise kind("must hold")

    assert caught.value.exit_code == 2
    assert capsys.readouterr().err == "error: must hold\n"
