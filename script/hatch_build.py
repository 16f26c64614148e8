"""Build hook: what is built knows its git revision, and a wheel makes its packages importable."""

from __future__ import annotations

import importlib.util
import tempfile
from pathlib import Path
from typing import Any

from hatchling.builders.hooks.plugin.interface import BuildHookInterface

STAMP = "protocols/_revision.txt"
FOLDER = "metamerlab-packages"  # as in pyproject.toml and metamerlab.py


class BuildHook(BuildHookInterface[Any]):
    """Put the revision in place of the repository's stamp, and a path file into a wheel."""

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        """Write the files to a temporary folder and have them packed."""
        if version == "editable":
            return  # a checkout is asked directly
        root = Path(self.root)
        reader = _load(root / "protocols" / "revision.py")
        self._scratch = tempfile.TemporaryDirectory(prefix="metamerlab-build-")
        stamp = Path(self._scratch.name) / Path(STAMP).name
        stamp.write_text(reader.read_revision(root) + "\n", encoding="utf-8")
        wheel = self.target_name == "wheel"
        build_data["force_include"][str(stamp)] = f"{FOLDER}/{STAMP}" if wheel else STAMP
        if wheel:
            paths = Path(self._scratch.name) / "metamerlab.pth"
            paths.write_text(FOLDER + "\n", encoding="utf-8")
            build_data["force_include"][str(paths)] = paths.name

    def finalize(self, version: str, build_data: dict[str, Any], artifact_path: str) -> None:  # noqa: ARG002
        """Remove the temporary files."""
        if version != "editable":
            self._scratch.cleanup()


def _load(path: Path) -> Any:
    spec = importlib.util.spec_from_file_location("_metamerlab_revision", path)
    if spec is None or spec.loader is None:
        raise ImportError(f"cannot read {path}")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module
