"""Parts that installed packages add: entry points of ``metamerlab.parts``."""

from collections.abc import Callable, Mapping, Sequence

from analysis.parts import AnyPart, Part
from protocols.plugins import based_on, misfit, registered

ADDED: Mapping[str, Callable[[], AnyPart]] = registered(
    "parts", {}, "name a class based on analysis.parts.Part", based_on(Part)
)
"""By name. A report of any kind asks each whether it is `wanted`."""


def with_added(own: Sequence[AnyPart]) -> tuple[AnyPart, ...]:
    """Return the parts of a kind of analysis, and those after them.

    Raises
    ------
    StudyError
        If one takes the name of such a part.
    """
    taken = {part.name for part in own}
    parts = tuple(make() for make in ADDED.values())
    for entry, part in zip(ADDED, parts, strict=True):
        if part.name in taken:
            must = f"name a part with a name of its own, not {part.name!r}, which is taken"
            raise misfit("parts", entry, must, part)
    return (*own, *parts)
