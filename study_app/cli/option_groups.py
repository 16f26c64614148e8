"""Options that belong together, as a dataclass: declared once, and handed on whole."""

from __future__ import annotations

import functools
import inspect
from collections.abc import Callable
from dataclasses import fields, is_dataclass
from typing import Any, get_type_hints

from typer.models import ParameterInfo


def takes_settings(command: Callable[..., None]) -> Callable[..., None]:
    """Return a command for Typer that builds what its parameters of dataclass types are.

    Each field annotated with ``typer.Option`` or ``typer.Argument`` becomes a parameter of its
    name, at the place of the dataclass; other fields keep their defaults.
    """
    parameters: list[inspect.Parameter] = []
    built: dict[str, tuple[Any, list[str]]] = {}
    hints = get_type_hints(command, include_extras=True)
    for parameter in inspect.signature(command).parameters.values():
        kind = hints[parameter.name]
        if not is_dataclass(kind):
            parameters.append(parameter.replace(annotation=kind, kind=parameter.KEYWORD_ONLY))
            continue
        told = get_type_hints(kind, include_extras=True)
        told = {name: hint for name, hint in told.items() if _is_option(hint)}
        options = [one for one in fields(kind) if one.name in told]
        parameters += [
            inspect.Parameter(
                one.name, parameter.KEYWORD_ONLY, annotation=told[one.name],
                default=getattr(kind, one.name, parameter.empty),
            )
            for one in options
        ]  # fmt: skip
        built[parameter.name] = kind, [one.name for one in options]

    @functools.wraps(command)
    def run(**given: Any) -> None:
        settings = {
            name: kind(**{option: given.pop(option) for option in options})
            for name, (kind, options) in built.items()
        }
        command(**settings, **given)

    run.__signature__ = inspect.Signature(parameters)  # type: ignore[attr-defined]
    run.__annotations__ = {one.name: one.annotation for one in parameters}
    return run


def _is_option(hint: Any) -> bool:
    return any(isinstance(one, ParameterInfo) for one in getattr(hint, "__metadata__", ()))
