"""The front of metamerlab: the calls that programs need, each imported when it is first named.

docs/library.md has an example of each. Everything else in the five packages is private, or an
interface of plug-ins (docs/architecture.md).

`analysis`, `pipeline`, `protocols`, `stimuli` and `study_app` are plain names that other installed
packages, or folders of yours, may have too. The wheel therefore keeps the five in one folder of
their own. A path file makes them importable in every program, behind all other packages; the
command `metamerlab`, and ``import metamerlab`` at the head of a program, put them in front.
"""

from __future__ import annotations

import importlib
import os
import sys
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from analysis.models.preference import preferences as preferences
    from analysis.models.scaling import scale as scale
    from analysis.models.thresholds import fit_thresholds as fit_thresholds
    from analysis.tables.trials import read_trials as read_trials
    from analysis.tidy import read_sessions as read_sessions
    from pipeline.compression.codec import compress as compress
    from pipeline.compression.codec import decompress as decompress
    from pipeline.foveation.conditions import Foveator as Foveator
    from pipeline.foveation.conditions import foveate as foveate
    from pipeline.foveation.geometry import Equirectangular as Equirectangular
    from pipeline.foveation.geometry import Flat as Flat
    from pipeline.frame import PanoramaFrame as PanoramaFrame
    from pipeline.frame import SourceFrame as SourceFrame
    from pipeline.gl.context import create_context as create_context
    from pipeline.methods.moved_panorama import move_panorama as move_panorama
    from pipeline.methods.moved_panorama import warp_panorama as warp_panorama
    from pipeline.methods.registry import fill as fill
    from pipeline.pictures.colour_file import load_colour as read_picture  # noqa: F401 (offered)
    from pipeline.pictures.colour_file import save_colour as write_picture  # noqa: F401 (offered)
    from pipeline.textures.bake import bake as bake
    from pipeline.warp.gpu import warp_frame as warp  # noqa: F401 (offered)
    from protocols.load import load_protocol as load_protocol
    from study_app.cli.calls import build as build
    from study_app.cli.calls import power as power
    from study_app.cli.calls import report as report
    from study_app.cli.calls import score as score
    from study_app.cli.calls import simulate as simulate

PACKAGES = ("analysis", "pipeline", "protocols", "stimuli", "study_app")

OFFERED = {
    "Equirectangular": "pipeline.foveation.geometry:Equirectangular",
    "Flat": "pipeline.foveation.geometry:Flat",
    "Foveator": "pipeline.foveation.conditions:Foveator",
    "PanoramaFrame": "pipeline.frame:PanoramaFrame",
    "SourceFrame": "pipeline.frame:SourceFrame",
    "bake": "pipeline.textures.bake:bake",
    "build": "study_app.cli.calls:build",
    "compress": "pipeline.compression.codec:compress",
    "create_context": "pipeline.gl.context:create_context",
    "decompress": "pipeline.compression.codec:decompress",
    "fill": "pipeline.methods.registry:fill",
    "fit_thresholds": "analysis.models.thresholds:fit_thresholds",
    "foveate": "pipeline.foveation.conditions:foveate",
    "load_protocol": "protocols.load:load_protocol",
    "move_panorama": "pipeline.methods.moved_panorama:move_panorama",
    "power": "study_app.cli.calls:power",
    "preferences": "analysis.models.preference:preferences",
    "read_picture": "pipeline.pictures.colour_file:load_colour",
    "read_sessions": "analysis.tidy:read_sessions",
    "read_trials": "analysis.tables.trials:read_trials",
    "report": "study_app.cli.calls:report",
    "scale": "analysis.models.scaling:scale",
    "score": "study_app.cli.calls:score",
    "simulate": "study_app.cli.calls:simulate",
    "warp": "pipeline.warp.gpu:warp_frame",
    "warp_panorama": "pipeline.methods.moved_panorama:warp_panorama",
    "write_picture": "pipeline.pictures.colour_file:save_colour",
}
"""Name that a program writes: where it lies."""


def _folder() -> str:
    """Folder of the five: beside this file in a checkout, one folder deeper once installed."""
    here = Path(__file__).absolute().parent
    installed = here / "metamerlab-packages"
    return str(installed if installed.is_dir() else here)


def _put_first(folder: str) -> None:
    """Let the five be found in `folder` before anywhere else.

    Raises
    ------
    ImportError
        If another package of one of the five names was imported before.
    """
    for name in PACKAGES:
        if (taken := sys.modules.get(name)) is not None:
            found = (*getattr(taken, "__path__", ()), getattr(taken, "__file__", None))[0]
            if found is None or Path(found).resolve() != Path(folder, name).resolve():
                raise ImportError(
                    f"the package {name!r} must be metamerlab's, of {folder}"
                    f" (got {found}, which was imported before);"
                    " write 'import metamerlab' before that import"
                )
    sys.path[:] = [folder, *(entry for entry in sys.path if entry != folder)]


_put_first(_folder())


def __getattr__(name: str) -> object:
    """Return what is offered under `name`, which is imported now."""
    if name not in OFFERED:
        raise AttributeError(f"module 'metamerlab' has no attribute {name!r}")
    module, _, there = OFFERED[name].partition(":")
    return getattr(importlib.import_module(module), there)


def __dir__() -> list[str]:
    return sorted((*OFFERED, "main"))


def main() -> None:
    """Run the command line given in `sys.argv`; the console script `metamerlab`."""
    # Our matrices are small: threads that wait for each other took up to four times as long.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    from study_app.cli import main as front_door

    front_door()


if __name__ == "__main__":
    main()
