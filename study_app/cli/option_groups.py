"""Commands that take options as dataclasses, and end at a mistake of the user with a message."""

from __future__ import annotations

import copy
import functools
import inspect
from collections.abc import Callable, Iterator
from dataclasses import fields, is_dataclass
from typing import Annotated, Any, get_type_hints

import typer
from typer.models import OptionInfo, ParameterInfo

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

    Each field with a text below it becomes an option, whose help that text is, at the place of the
    dataclass; so do the fields of a field that is a dataclass itself. ``Annotated`` with
    ``typer.Option`` or ``typer.Argument`` adds what else is to be said of one. A flag that is off
    unless given has no ``--no-``. Options whose text is below them are listed under the heading
    ``panel`` of their dataclass, where it has one. Fields without a text keep their defaults.
    """
    hints = get_type_hints(function, include_extras=True)
    parameters: list[inspect.Parameter] = []
    for one in inspect.signature(function).parameters.values():
        kind = hints[one.name]
        parameters += _options(kind) if is_dataclass(kind) else [_told(one.name, kind, one.default)]

    @functools.wraps(function)
    def run(**given: Any) -> None:
        built = {name: _made(kind, given) for name, kind in hints.items() if is_dataclass(kind)}
        with user_errors():
            function(**built, **given)

    run.__signature__ = inspect.Signature(parameters)  # type: ignore[attr-defined]
    run.__annotations__ = {one.name: one.annotation for one in parameters}
    return run


def _given_fields(kind: Any) -> Iterator[tuple[str, Any, str]]:
    """Yield the names, hints and texts of the fields that commands give."""
    from protocols.units import key_docs  # it brings pydantic along

    hints, texts = get_type_hints(kind, include_extras=True), key_docs(kind)
    for one in fields(kind):
        hint, text = hints[one.name], " ".join(texts[one.name].split())
        if text or is_dataclass(hint) or _said_of(hint):
            yield one.name, hint, text


def _options(kind: Any) -> Iterator[inspect.Parameter]:
    for name, hint, text in _given_fields(kind):
        if is_dataclass(hint):
            yield from _options(hint)
            continue
        default = getattr(kind, name, inspect.Parameter.empty)
        yield _told(name, hint, default, text, getattr(kind, "panel", None))


def _said_of(hint: Any) -> list[ParameterInfo]:
    return [one for one in getattr(hint, "__metadata__", ()) if isinstance(one, ParameterInfo)]


def _told(
    name: str, hint: Any, default: Any, text: str = "", panel: str | None = None
) -> inspect.Parameter:
    """Return an option or an argument as Typer is told it; `panel` is where `text` is listed."""
    said = _said_of(hint)
    info = copy.copy(said[0]) if said else typer.Option()
    if text:
        info.help, info.rich_help_panel = text, panel or info.rich_help_panel
    unnamed = isinstance(info, OptionInfo) and info.default is ...  # else the first of its names
    if unnamed and default is False:
        info.default = f"--{name.replace('_', '-')}"
    return inspect.Parameter(
        name,
        inspect.Parameter.KEYWORD_ONLY,
        annotation=Annotated[hint.__origin__ if said else hint, info],
        default=default,
    )


def _made(kind: Any, given: dict[str, Any]) -> Any:
    """Return a dataclass of what was given for its options, which it takes away."""
    return kind(
        **{
            name: _made(hint, given) if is_dataclass(hint) else given.pop(name)
            for name, hint, _ in _given_fields(kind)
        }
    )
