"""Parts that installed packages add: entry points of ``metamerlab.parts``."""

from collections.abc import Callable, Mapping

from analysis.parts import AnyPart, Part
from protocols.plugins import based_on, registered

ADDED: Mapping[str, Callable[[], AnyPart]] = registered(
    "parts", {}, "name a class based on analysis.parts.Part", based_on(Part)
)
"""By name. A report of any kind asks each whether it is `wanted`."""
