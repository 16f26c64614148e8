"""Options of commands as dataclasses: `study_app.cli.option_groups`."""

from dataclasses import dataclass
from typing import Annotated, ClassVar

import pytest
import typer
from typer.testing import CliRunner

from protocols.errors import StudyError
from study_app.cli.option_groups import CommandGroup


@dataclass(frozen=True)
class Look:
    scene: str
    """Name of the
    scene."""
    views: Annotated[int, typer.Option(min=1)] = 12
    """Number of views."""
    inside: bool = False
    """Seen from inside."""
    turn: Annotated[float, typer.Option(help="Turn of the scene.")] = 0.0
    notes: tuple[str, ...] = ()  # no option


@dataclass(frozen=True)
class Frame:
    panel: ClassVar = "Frame"

    look: Look
    dark: bool = False
    """Black all around."""


GIVEN: list[object] = []
app = CommandGroup()


@app.command()
def draw(name: Annotated[str, typer.Argument()], *, look: Look, wide: bool = False) -> None:
    """Draw it."""
    GIVEN[:] = [name, look, wide]


@app.command()
def hang(frame: Frame, *, high: bool = False) -> None:
    GIVEN[:] = [frame, high]


@app.command()
def fall() -> None:
    raise StudyError("the nail must hold")


def test_a_mistake_of_the_user_ends_any_command_of_a_group_with_status_2():
    ended = CliRunner().invoke(app, ["fall"])

    assert (ended.exit_code, ended.stderr) == (2, "error: the nail must hold\n")


def test_every_group_of_commands_is_such_a_group(repository):
    files = (repository / "study_app" / "cli").rglob("*.py")
    made = [path.name for path in files if "typer.Typer(" in path.read_text(encoding="utf-8")]

    assert made == ["__init__.py"]  # the front door, whose groups these are


@pytest.mark.parametrize(
    ("line", "wanted"),
    [
        ("draw a --scene garden", ["a", Look("garden"), False]),
        (
            "draw a --views 3 --inside --wide --scene garden",
            ["a", Look("garden", 3, inside=True), True],
        ),
        ("hang --views 3 --dark --scene garden", [Frame(Look("garden", 3), dark=True), False]),
    ],
)
def test_the_fields_of_a_dataclass_are_options_and_reach_the_command_as_one(line, wanted):
    assert CliRunner().invoke(app, line.split()).exit_code == 0
    assert wanted == GIVEN


@pytest.mark.parametrize(
    "line", ["draw a", "draw a --scene x --views 0", "draw a --scene x --notes y", "hang"]
)
def test_what_a_field_needs_and_forbids_holds_and_others_are_no_options(line):
    assert CliRunner().invoke(app, line.split()).exit_code == 2


def test_help_lists_fields_in_place_and_the_command_keeps_its_text():
    said = CliRunner().invoke(app, ["draw", "--help"]).output

    assert "Draw it." in said
    assert said.index("--scene") < said.index("--views") < said.index("--wide")
    assert "--notes" not in said


def test_the_text_below_a_field_is_the_help_of_its_option():
    said = CliRunner().invoke(app, ["draw", "--help"]).output

    assert "Name of the scene." in said
    assert "Number of views." in said
    assert "Turn of the scene." in said


def test_fields_are_listed_under_the_heading_of_their_own_dataclass():
    before, headed = CliRunner().invoke(app, ["hang", "--help"]).output.split("─ Frame ─")

    assert "Black all around." in headed
    assert "Name of the scene." in before


def test_a_flag_that_is_off_unless_given_has_no_opposite():
    said = CliRunner().invoke(app, ["draw", "--help"]).output

    assert "--inside" in said
    assert "--no-" not in said
