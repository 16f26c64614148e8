"""Build hook: a wheel or source archive knows the git revision it was made from."""

from __future__ import annotations

import importlib.util
import tempfile
from pathlib import Path
from typing import Any

from hatchling.builders.hooks.plugin.interface import BuildHookInterface

STAMP = "protocols/_revision.txt"


class RevisionHook(BuildHookInterface[Any]):
    """Put the revision in place of the stamp that the repository holds."""

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        """Write the stamp to a temporary file and have it packed as `STAMP`."""
        if version == "editable":
            return  # a checkout is asked directly
        root = Path(self.root)
        reader = _load(root / "protocols" / "revision.py")
        self._scratch = tempfile.TemporaryDirectory(prefix="metamerlab-build-")
        stamp = Path(self._scratch.name) / Path(STAMP).name
        stamp.write_text(reader.read_revision(root) + "\n", encoding="utf-8")
        build_data["force_include"][str(stamp)] = STAMP

    def finalize(self, version: str, build_data: dict[str, Any], artifact_path: str) -> None:  # noqa: ARG002
        """Remove the temporary file."""
        if version != "editable":
            self._scratch.cleanup()


def _load(path: Path) -> Any:
    spec = importlib.util.spec_from_file_location("_metamerlab_revision", path)
    if spec is None or spec.loader is None:
        raise ImportError(f"cannot read {path}")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module
