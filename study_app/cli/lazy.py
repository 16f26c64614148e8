"""Commands that are imported when they run, not when they are listed."""

from __future__ import annotations

import importlib
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar

import typer
from typer.core import TyperCommand, TyperGroup

from study_app.cli.complete import completing
from study_app.cli.option_groups import CommandGroup

if TYPE_CHECKING:
    from typer._click import Command, Context


@dataclass(frozen=True)
class CommandSlot:
    """A place for one command or group of commands.

    `target` is ``module:attribute``: a `typer.Typer` (a group) or a function
    (one command); `made_by` is the class of that command, in the same module.
    """

    name: str
    help: str
    target: str
    made_by: str | None = None

    def load(self) -> Command:
        """Import the module and return its command, under the slot's name."""
        module, _, attribute = self.target.partition(":")
        target = getattr(importlib.import_module(module), attribute)
        if isinstance(target, typer.Typer):
            group = typer.main.get_group(target)
            group.name = self.name
            return completing(group)
        single = CommandGroup(add_completion=False)
        made_by = getattr(importlib.import_module(module), self.made_by) if self.made_by else None
        single.command(self.name, cls=made_by)(target)
        return completing(typer.main.get_command(single))


class LazyGroup(TyperGroup):
    """A group that lists its `slots` and imports only the one that is called."""

    slots: ClassVar[tuple[CommandSlot, ...]] = ()

    def __init__(self, **attrs: Any) -> None:
        super().__init__(**attrs)
        for slot in self.slots:
            self.add_command(_LazyCommand(slot))


class _LazyCommand(TyperCommand):
    """Stands in for a slot's command in listings; becomes it when called."""

    def __init__(self, slot: CommandSlot) -> None:
        super().__init__(slot.name, help=slot.help)
        self._slot = slot

    def make_context(
        self,
        info_name: str | None,
        args: list[str],
        parent: Context | None = None,
        **extra: Any,
    ) -> Context:
        return self._slot.load().make_context(info_name, args, parent=parent, **extra)
