"""Foveated pictures on the GPU. Twins: reference.py and displacement.py."""

from __future__ import annotations

from typing import Protocol

from pipeline.foveation.condition import Look, Picture


class FoveationPass(Protocol):
    """A condition on the GPU, for pictures of one size."""

    def apply(self, picture: Picture, look: Look) -> Picture:
        """Upload, work, read back."""
        ...

    def release(self) -> None:
        """Free everything this pass made."""
        ...
