"""Classes under names: fill methods, and conditions for a gaze.

Parameters of a name are the keyword-only parameters of its class; a class that hands ``**others``
on to its base has the base's too. The class checks their values.
"""

from __future__ import annotations

import importlib
import inspect
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import reduce
from pathlib import Path
from typing import Any, cast

from pipeline.errors import InputError
from protocols.errors import did_you_mean
from protocols.outside import plug_in


@dataclass(frozen=True)
class NamedClass:
    """One name, what it stands for, and where its class lives."""

    name: str  # a trailing colon: a path follows
    summary: str
    target: str  # module:class, imported when it is made
    path: str = ""  # what the path leads to, FILE or FOLDER
    owner: str = ""  # of a plug-in: the package that adds it, as a method

    @property
    def takes_path(self) -> bool:
        return self.name.endswith(":")

    @property
    def shown_name(self) -> str:
        """The name as a user writes it."""
        return self.name + self.path

    def load(self) -> type[Any]:
        """Import and return the class; `InputError` where a plug-in's is none or does not load."""
        if not self.owner:
            return self._imported()
        with plug_in(self.owner, self.name, "methods", InputError):
            kind = self._imported()
        needed = (getattr(kind, name, None) for name in ("fill", "release"))
        if not (isinstance(kind, type) and all(map(callable, needed))):
            raise InputError(
                f"package {self.owner!r}: its plug-in {self.name!r} of metamerlab.methods must name"
                f" a class with fill and release (got {self.target}); mend or uninstall the package"
            )
        return kind

    def _imported(self) -> type[Any]:
        module, _, attribute = self.target.partition(":")
        names = filter(None, attribute.split("."))
        return cast(type[Any], reduce(getattr, names, importlib.import_module(module)))

    def path_in(self, name: str) -> tuple[Path, ...]:
        """The path that `name` carries, or nothing."""
        return (Path(name.removeprefix(self.name)),) if self.takes_path else ()


def find(
    entries: Sequence[NamedClass], name: str, retired: Mapping[str, str] | None = None
) -> NamedClass:
    """Return the entry that `name` means; nothing is imported.

    Raises
    ------
    InputError
        If there is none, with what `retired` says of the name, or with the nearest name; or if its
        path is missing.
    """
    for entry in entries:
        if entry.takes_path and name.startswith(entry.name):
            if name == entry.name:
                raise InputError(f"method {name!r} must name a path: {entry.shown_name}")
            return entry
        if name == entry.name:
            return entry
    if retired and name in retired:
        raise InputError(f"method {name!r} {retired[name]}")
    shown = ", ".join(entry.shown_name for entry in entries)
    near = did_you_mean(name, [entry.name for entry in entries])
    raise InputError(f"method must be one of {shown} (got {name!r}){near}")


def parameters_of(kind: type[Any]) -> dict[str, inspect.Parameter]:
    """Return the parameters of a class by name, those of its bases first.

    A class that takes ``**settings`` for its `settings_class` has the fields of that, too.
    """
    found: dict[str, inspect.Parameter] = {}
    for base in kind.__mro__:
        if "__init__" in vars(base):
            every = inspect.signature(vars(base)["__init__"]).parameters.values()
            found = {p.name: p for p in every if p.kind is p.KEYWORD_ONLY} | found
            if not any(p.kind is p.VAR_KEYWORD for p in every):
                break
            if hasattr(kind, "settings_class"):
                found = dict(inspect.signature(kind.settings_class).parameters) | found
    return found


def defaults_of(kind: type[Any]) -> dict[str, Any]:
    """Return the parameters of a class with their defaults."""
    return {name: parameter.default for name, parameter in parameters_of(kind).items()}


def check_given(
    name: str,
    kind: type[Any],
    given: Mapping[str, Any],
    retired: Mapping[str, str] | None = None,
) -> None:
    """Check the names and the types of parameters; their values are the class's to check.

    Raises
    ------
    InputError
        Naming the parameter, with what `retired` says of it, or with the nearest that there is.
    """
    known = parameters_of(kind)
    for key, value in given.items():
        if key not in known:
            if retired and f"{name}.{key}" in retired:
                raise InputError(f"parameter {key!r} of {name} {retired[f'{name}.{key}']}")
            offered = ", ".join(known) or "none"
            raise InputError(
                f"parameters of {name} are: {offered} (got {key!r}){did_you_mean(key, known)}"
            )
        accepted = _accepted(known[key])
        default = known[key].default
        if not isinstance(value, accepted) or isinstance(value, bool) != isinstance(default, bool):
            wanted = " or ".join(kind.__name__ for kind in accepted if kind is not type(None))
            raise InputError(f"parameter {key} must be {wanted} (got {value!r})")


def _accepted(parameter: inspect.Parameter) -> tuple[type, ...]:
    default = parameter.default
    if default is None:  # the annotation alone says what else it may be
        numbers = "float" in str(parameter.annotation)
        return (int, float, type(None)) if numbers else (str, type(None))
    return (int, float) if isinstance(default, float) else (type(default),)


@dataclass(frozen=True)
class Choice:
    """A fill method or a condition, and its parameters; the rest keep their defaults."""

    name: str
    parameters: Mapping[str, Any] = field(default_factory=dict)

    @property
    def label(self) -> str:
        """Name and parameters, as on a sheet."""
        given = ", ".join(f"{key} {value}" for key, value in self.parameters.items())
        return f"{self.name} ({given})" if given else self.name

    @property
    def file_name(self) -> str:
        """The label without what file names should not have."""
        return "".join(c if c.isalnum() or c in "-.," else "_" for c in self.label).strip("_")
