"""Name and parameters, as a study or an option gives them."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any


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
