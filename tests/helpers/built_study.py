"""A study so small that it builds in seconds, for whoever builds it, in a test or an attack."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from PIL import Image

from protocols.load import shipped

OBJ = """mtllib box.mtl
v -16 -12 -12
v 16 -12 -12
v -16 12 -12
v 16 12 -12
v -0.4 -0.5 -2
v 0.4 -0.5 -2
v -0.4 0.5 -2
v 0.4 0.5 -2
vt 0 0
vt 3 0
vt 0 3
vt 3 3
usemtl wall
f 1/1 2/2 4/4
f 1/1 4/4 3/3
usemtl box
f 5/1 6/2 8/4
f 5/1 8/4 7/3
"""
MTL = "newmtl wall\nmap_Kd wall.png\nnewmtl box\nKd 0.7 0.1 0.1\n"
SCENES = """
[[stimuli.scenes]]
name = "box"
kind = "mesh"
file = "box.obj"
view = { position_m = [0, 0, 0], look_at_m = [0, 0, -1], vertical_fov_deg = 60 }
camera = { kind = "circle" }

[[stimuli.scenes]]
name = "motorcycle"
kind = "stereo"
left = "motorcycle"
right = "motorcycle"
disparity = "motorcycle"
focal_px = 994.978
baseline_m = 0.193001
offset_px = 31.086
camera = { kind = "stereo" }

[[stimuli.sizes]]
name = "small"
extent_m = 0.16

[[stimuli.methods]]
name = "reference"

[[stimuli.methods]]
name = "push-pull"

[[stimuli.methods]]
name = "telea"
"""


def write_small_study(folder: Path) -> Path:
    """Write the study's protocol and its files; return the protocol."""
    rng = np.random.default_rng(3)
    noise = rng.integers(40, 220, (32, 32, 3), dtype=np.uint8)
    Image.fromarray(np.repeat(np.repeat(noise, 4, 0), 4, 1)).save(folder / "wall.png")
    (folder / "box.obj").write_text(OBJ)
    (folder / "box.mtl").write_text(MTL)
    path = folder / "small.toml"
    path.write_text(study_text(shipped("studies")["demo"].read_text()))
    return path


def study_text(demo: str) -> str:
    """Turn the demo study into the small one."""
    head, rest = demo.split("[[stimuli.scenes]]", 1)
    clips = rest[rest.index("[stimuli.clips]") :]
    for old, new in (
        ("width_deg = 8.0", "width_deg = 2.0"),
        ("height_deg = 6.0", "height_deg = 1.5"),
        ("fps = 30.0", "fps = 10.0"),
        ("duration_s = 1.0", "duration_s = 0.4"),
        ('scenes = ["garden"]', 'scenes = ["box"]'),
        ('size = "large"', 'size = "small"'),
        ('"metameric"', '"telea"'),
    ):
        assert old in clips, old
        clips = clips.replace(old, new)
    return head + SCENES.lstrip() + "\n" + clips
