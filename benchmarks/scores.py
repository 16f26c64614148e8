"""The table of docs/quality.md: every built-in scene, three motions, by every metric.

`python -m benchmarks scores` builds the clips, scores them as `metamerlab stimuli score`
does, and writes the tables into the document. Killed at any point, it goes on where it was.
"""

from __future__ import annotations

import argparse
import json
import sys
import tomllib
from pathlib import Path
from typing import Any

from protocols.load import load_display, shipped
from protocols.schema import StudyProtocol
from stimuli.build import build
from stimuli.executors import cores, local_processes
from stimuli.orders import Orders
from stimuli.scenes.registry import scene_names

MOTIONS: dict[str, dict[str, Any]] = {
    "lateral": {"kind": "line", "direction": (1.0, 0.0, 0.0)},
    "vertical": {"kind": "line", "direction": (0.0, 1.0, 0.0)},
    "6dof": {
        "kind": "keyframes",
        "keyframes": (
            {"t_s": 0.0, "position_m": (-0.8, 0.3, -0.4), "yaw_deg": -1.0, "roll_deg": -1.0},
            {"t_s": 0.2, "position_m": (0.2, -0.6, 0.3), "pitch_deg": 1.0},
            {"t_s": 0.4, "position_m": (0.9, 0.4, 0.5), "yaw_deg": 1.0, "roll_deg": 1.0},
        ),
    },
}
METHODS = ("reference", "metameric", "push-pull", "push-pull-depth", "background-extension")
SIZE = {"name": "medium", "hole_share": 0.05}
FRAMES, FPS = 12, 30.0
SCENE_SEED = 1


def protocol(scenes: list[str] | None = None, methods: tuple[str, ...] = METHODS) -> StudyProtocol:
    """Return a study of the built-in scenes, each on every path of `MOTIONS`."""
    raw: dict[str, Any] = tomllib.loads(shipped("studies")["demo"].read_text(encoding="utf-8"))
    raw["study"] |= {"name": "quality-scenes", "title": "The built-in scenes on three paths"}
    raw["scenes"] = [
        {
            "name": f"{scene}-{motion}",
            "kind": "builtin",
            "builtin": scene,
            "seed": SCENE_SEED,
            "camera": camera,
        }
        for scene in scenes or scene_names()
        for motion, camera in MOTIONS.items()
    ]
    raw["sizes"] = [SIZE]
    raw["methods"] = [{"name": name} for name in methods]
    raw["clips"] |= {
        "width_deg": 5.7, "height_deg": 4.3, "fps": FPS, "duration_s": FRAMES / FPS,
        "preview": False,
    }  # fmt: skip
    raw["design"] = {
        key: value for key, value in raw["design"].items() if key not in ("practice", "catch")
    }
    raw["analysis"]["primary"] = {"method": "metameric", "against": "push-pull"}
    return StudyProtocol.model_validate_json(json.dumps(raw))


def main(argv: list[str]) -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, default=Path("out/scores"))
    parser.add_argument("--scenes", nargs="+", choices=scene_names())
    arguments = parser.parse_args(argv)
    study = protocol(arguments.scenes)
    orders = Orders(study, load_display(study.display.display), Path.cwd())
    clips = arguments.out / "clips"
    with local_processes(cores()) as pool:
        build(orders, clips, pool, parallel=cores(), report=lambda d, t, w: print(d, t, w))
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
