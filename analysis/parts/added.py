"""Parts that installed packages add: entry points of ``metamerlab.parts``."""

from collections.abc import Callable, Collection, Mapping

from analysis.parts import AnyPart, Part
from protocols.plugins import based_on, misfit, registered

ADDED: Mapping[str, Callable[[], AnyPart]] = registered(
    "parts", {}, "name a class based on analysis.parts.Part", based_on(Part)
)
"""By name. A report of any kind asks each whether it is `wanted`."""


def added_parts(taken: Collection[str]) -> tuple[AnyPart, ...]:
    """Return them; `taken` are the names of results that the report has already.

    Raises
    ------
    StudyError
        If one takes such a name.
    """
    parts = tuple(make() for make in ADDED.values())
    for entry, part in zip(ADDED, parts, strict=True):
        if part.name in taken:
            must = f"name a part with a name of its own, not {part.name!r}, which is taken"
            raise misfit("parts", entry, must, part)
    return parts
