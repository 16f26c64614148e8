"""Registries to which other installed packages add: Python entry points.

A package that declares, say, ``[project.entry-points."metamerlab.tasks"]`` with
``my-task = "my_package.tasks:MyTask"`` adds a task without a change here.
"""

from __future__ import annotations

import inspect
import re
import sys
import traceback
from collections.abc import Callable, Iterator, Mapping
from functools import lru_cache, wraps
from importlib import import_module, metadata
from operator import attrgetter
from types import GenericAlias
from typing import Any, Literal, TypeVar, get_args, get_origin, get_type_hints

from protocols.errors import StudyError
from protocols.gone import moved
from protocols.outside import OURS, plug_in, visible_line

T = TypeVar("T")
Fits = Callable[[str, object], bool]
"""Test of a plug-in's name and object: does it fit its group?"""
GROUPS = (
    "tasks", "recipes", "observers", "analyses", "parts", "builders", "methods", "metrics",
    "trackers",
)  # fmt: skip
_PREFIX = "metamerlab."


def registered(group: str, shipped: Mapping[str, T], must: str, fits: Fits) -> dict[str, T]:
    """Return the things of a registry and of installed packages, by name.

    Parameters
    ----------
    group : str
        The registry: entry points of ``metamerlab.<group>`` belong to it.
    shipped : mapping
        What comes with metamerlab.
    must : str
        What an entry point must name, in words.
    fits : callable
        Whether it does.

    Raises
    ------
    StudyError
        If a package takes a name that is taken, cannot be imported, or names something else.
    """
    found = dict(shipped)
    for entry in _entry_points().select(group=_PREFIX + group):
        owner = _owner(entry)
        if entry.name in found:
            raise StudyError(
                f"package {owner!r}: a plug-in must have a name of its own in metamerlab.{group}"
                f" (got {entry.name!r}, which is taken); rename it, or uninstall the package"
            )
        with plug_in(owner, entry.name, group, StudyError):
            value = entry.load()
            right = fits(entry.name, value)
        if not right:
            raise misfit(group, entry.name, must, value)
        found[entry.name] = value
    return found


def check_methods(group: str, name: str, plugged: type[object]) -> None:
    """Let a plug-in's class check what it returns, in each method that takes the place of ours.

    Ours states what it returns. A list stands for a tuple, as pydantic converts it.

    Parameters
    ----------
    group, name : str
        Of the entry point.
    plugged : type
        Changed in place, with those of its bases that are not ours.

    Raises
    ------
    StudyError
        If one cannot be called as ours is; afterwards by each that returns something else.
    """
    ours = [base for base in plugged.__mro__ if _is_ours(base)]
    for base in plugged.__mro__:
        for key, own in () if base in ours else [*vars(base).items()]:
            stated = [vars(one)[key] for one in ours if key in vars(one) and key[0] != "_"]
            first = stated[-1] if stated else None
            if isinstance(first, property):
                if not isinstance(own, property):
                    raise misfit(group, name, f"have {key} as a property", own)
                if own.fget not in _CHECKING:
                    setattr(base, key, property(_checking(group, name, own.fget, first.fget)))
            elif inspect.isfunction(first):
                takes = [*inspect.signature(first).parameters]
                if not inspect.isfunction(own) or not taking(len(takes))(name, own):
                    must = f"have a method {key}({', '.join(takes)})"
                    raise misfit(group, name, must, own)
                if own not in _CHECKING:
                    setattr(base, key, _checking(group, name, own, first))


_CHECKING: set[object] = set()
"""Methods of plug-ins that check what they return."""


def _is_ours(base: type[object]) -> bool:
    return base.__module__.split(".")[0] in (*OURS, "pydantic", "builtins", "abc")


def _checking(group: str, name: str, own: Any, first: Any) -> Callable[..., Any]:
    """Return a method of a plug-in that checks that it returns what ours says."""
    from pydantic import ConfigDict, TypeAdapter, ValidationError  # `--help` does without it

    wanted: Any = get_type_hints(first)["return"]
    told = inspect.formatannotation(wanted)
    lazy = get_origin(wanted) is Iterator
    if lazy:
        wanted = GenericAlias(tuple, (*get_args(wanted), ...))
    elif "Json" in told:  # it names itself
        wanted = get_origin(wanted)
    # What is inside a phase or a model is checked elsewhere.
    apart = any(one in told for one in ("Phase", "Adaptive", "Recipe"))
    inside: Literal["always", "never"] = "never" if apart else "always"
    alone: Any = GenericAlias(tuple, (wanted,))
    adapter = TypeAdapter[Any](alone, config=ConfigDict(revalidate_instances=inside))

    @wraps(own)
    def method(*given: Any, **named: Any) -> Any:
        found = own(*given, **named)
        if isinstance(found, Iterator):
            found = tuple(found)  # what is raised meanwhile is the plug-in's
        try:
            (found,) = adapter.validate_python((found,))
        except ValidationError as error:
            wrong = error.errors()[0]
            place = "".join(f" at {one}" for one in wrong["loc"][1:])
            must = f"return {told} from {first.__name__}"
            raise misfit(group, name, must, wrong["input"], place) from None
        return iter(found) if lazy else found

    _CHECKING.add(method)
    return method


def named(place: str | Callable[..., object]) -> Callable[..., object]:
    """Return the class or function that ``module:NAME`` names, imported now; another as it is."""
    if not isinstance(place, str):
        return place
    module, _, name = place.partition(":")
    found: Callable[..., object] = attrgetter(name)(import_module(module))
    return found


def misfit(group: str, name: str, must: str, found: object, place: str = "") -> StudyError:
    """Return the error on a plug-in that is, or returns, something else than it must."""
    kind = f"the class {found.__name__}" if isinstance(found, type) else type(found).__name__
    owners = map(_owner, _entry_points().select(group=_PREFIX + group, name=name))
    return StudyError(
        f"package {', '.join(owners)!r}: its plug-in {name!r} of metamerlab.{group} must {must}"
        f" (got {kind}{place}); mend or uninstall the package"
    )


def culprit(error: BaseException) -> str | None:
    """Return the words on an exception that came out of a plug-in; None: it came out of none.

    Also where the plug-in ran in another process, whose traceback came with the exception, and
    where one of its classes lacks a method that it must have.
    """
    told = "".join(traceback.format_exception(error)).replace("\\", "/")
    entries = [
        entry
        for name in GROUPS
        for entry in _entry_points().select(group=_PREFIX + name)
        if entry.module.split(".")[0] not in OURS  # what ships may stand under another name
    ]
    raised = f"{type(error).__name__}: {visible_line(str(error))}{moved(error)}"
    for whole in (True, False):  # the module that it names, or another of its package
        for entry in entries:
            place = entry.value.partition(":")[0].strip().replace(".", "/")
            place = (
                rf"{place}(?:\.py|/__init__\.py)" if whole else rf"{place.split('/')[0]}(?:\.py|/)"
            )
            frames = re.findall(rf'"[^"\n]*/({place}[^"\n]*)", line (\d+), in (.*)', told)
            if frames:
                file, line, _ = frames[-1]
                return _blame(entry, f"its {frames[0][2]} raised {raised}, {file} line {line}")
    for frame, _ in traceback.walk_tb(error.__traceback__):
        module = type(frame.f_locals.get("self")).__module__.split(".")[0]
        for entry in entries if isinstance(error, NotImplementedError) else ():
            if module == entry.value.partition(":")[0].split(".")[0]:
                return _blame(entry, f"it has no {frame.f_code.co_name}")
    return None


def _blame(entry: metadata.EntryPoint, why: str) -> str:
    return (
        f"package {_owner(entry)!r}: its plug-in {entry.name!r} of {entry.group} must return or say"
        f" what is wrong ({why}); mend or uninstall the package"
    )


def based_on(base: type[object]) -> Fits:
    """Return the test for classes with that base, of the entry's own kind where they name one."""

    def fits(name: str, value: object) -> bool:
        if not (isinstance(value, type) and issubclass(value, base)):
            return False
        kind = getattr(value, "model_fields", {}).get("kind")
        return kind is None or name in get_args(kind.annotation)

    return fits


def taking(count: int) -> Fits:
    """Return the test for what can be called with so many arguments."""

    def fits(_name: str, value: object) -> bool:
        if not callable(value):
            return False
        try:
            inspect.signature(value).bind(*[None] * count)
        except (TypeError, ValueError):
            return False
        return True

    return fits


def _entry_points() -> metadata.SelectableGroups:
    return _installed(tuple(sys.path))


@lru_cache(maxsize=1)  # a file of every package is read
def _installed(_path: tuple[str, ...]) -> metadata.SelectableGroups:
    return metadata.entry_points()


def _owner(entry: metadata.EntryPoint) -> str:
    return entry.dist.name if entry.dist else entry.value
