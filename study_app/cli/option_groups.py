"""Commands that take options as dataclasses, and end at a mistake of the user with a message."""

from __future__ import annotations

import functools
import inspect
from collections.abc import Callable, Iterator
from dataclasses import fields, is_dataclass
from typing import Any, get_type_hints

import typer
from typer.models import ParameterInfo

from study_app.cli.error_messages import user_errors


class CommandGroup(typer.Typer):
    """A group of commands, each of which is made by `as_command`."""

    def __init__(self, **how: Any) -> None:
        super().__init__(rich_markup_mode="rich", no_args_is_help=True, **how)

    def command(self, *names: Any, **how: Any) -> Callable[[Any], Any]:
        """Return a decorator that adds a function as a command, and returns it as it is."""
        add = super().command(*names, **how)

        def added(function: Any) -> Any:
            add(as_command(function))
            return function

        return added


def as_command(function: Callable[..., None]) -> Callable[..., None]:
    """Return a command for Typer that builds what its parameters of dataclass types are.

    What the user can mend ends it with one message (`user_errors`).

    Each field annotated with ``typer.Option`` or ``typer.Argument`` becomes a parameter of its
    name, at the place of the dataclass, as do those of a field that is a dataclass itself; other
    fields keep their defaults.
    """
    hints = get_type_hints(function, include_extras=True)
    parameters: list[inspect.Parameter] = []
    for one in inspect.signature(function).parameters.values():
        kind = hints[one.name]
        if is_dataclass(kind):
            parameters += _options(kind)
        else:
            parameters.append(one.replace(annotation=kind, kind=one.KEYWORD_ONLY))

    @functools.wraps(function)
    def run(**given: Any) -> None:
        built = {name: _made(kind, given) for name, kind in hints.items() if is_dataclass(kind)}
        with user_errors():
            function(**built, **given)

    run.__signature__ = inspect.Signature(parameters)  # type: ignore[attr-defined]
    run.__annotations__ = {one.name: one.annotation for one in parameters}
    return run


def _told(kind: Any) -> Iterator[tuple[str, Any]]:
    """Yield the names and hints of the fields that commands give."""
    hints = get_type_hints(kind, include_extras=True)
    for one in fields(kind):
        told = getattr(hints[one.name], "__metadata__", ())
        if is_dataclass(hints[one.name]) or any(isinstance(each, ParameterInfo) for each in told):
            yield one.name, hints[one.name]


def _options(kind: Any) -> Iterator[inspect.Parameter]:
    for name, hint in _told(kind):
        if is_dataclass(hint):
            yield from _options(hint)
            continue
        default = getattr(kind, name, inspect.Parameter.empty)
        yield inspect.Parameter(
            name, inspect.Parameter.KEYWORD_ONLY, annotation=hint, default=default
        )


def _made(kind: Any, given: dict[str, Any]) -> Any:
    """Return a dataclass of what was given for its options, which it takes away."""
    return kind(
        **{
            name: _made(hint, given) if is_dataclass(hint) else given.pop(name)
            for name, hint in _told(kind)
        }
    )
