"""Options of commands as dataclasses: `study_app.cli.option_groups`."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

import pytest
import typer
from typer.testing import CliRunner

from study_app.cli.option_groups import takes_settings


@dataclass(frozen=True)
class Look:
    scene: Annotated[str, typer.Option(help="Name of the scene.")]
    views: Annotated[int, typer.Option(min=1, help="Number of views.")] = 12
    notes: tuple[str, ...] = ()


@dataclass(frozen=True)
class Frame:
    look: Look
    dark: Annotated[bool, typer.Option("--dark")] = False


GIVEN: list[object] = []
app = typer.Typer()


@app.command()
@takes_settings
def draw(
    name: Annotated[str, typer.Argument()],
    *,
    look: Look,
    wide: Annotated[bool, typer.Option("--wide")] = False,
) -> None:
    """Draw it."""
    GIVEN[:] = [name, look, wide]


@app.command()
@takes_settings
def hang(frame: Frame, *, high: Annotated[bool, typer.Option("--high")] = False) -> None:
    GIVEN[:] = [frame, high]


@pytest.mark.parametrize(
    ("line", "wanted"),
    [
        ("draw a --scene garden", ["a", Look("garden"), False]),
        ("draw a --views 3 --wide --scene garden", ["a", Look("garden", 3), True]),
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
