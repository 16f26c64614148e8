"""A study so small that it builds in seconds, for whoever builds it, in a test or an attack."""

import base64
import json
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

from protocols.load import shipped

CORNERS = [
    [x, y, z] for side_x, side_y, z in ((16, 12, -12), (0.4, 0.5, -2))
    for y in (-side_y, side_y) for x in (-side_x, side_x)
]  # fmt: skip
UV = [[0, 1], [3, 1], [0, -2], [3, -2]] * 2
FACES = [0, 1, 3, 0, 3, 2, 4, 5, 7, 4, 7, 6]
SCENES = """
[[stimuli.scenes]]
name = "box"
kind = "mesh"
file = "box.gltf"
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


def box_document() -> dict[str, Any]:
    """Return the box before its wall as glTF: the wall has a picture, the box is red."""
    data = np.array(CORNERS, "<f4").tobytes() + np.array(UV, "<f4").tobytes()
    data += np.array(FACES, "<u2").tobytes()
    floats = {"bufferView": 0, "componentType": 5126, "count": 8}
    indices = {"bufferView": 1, "componentType": 5123, "count": 6, "type": "SCALAR"}
    shared = {"attributes": {"POSITION": 0, "TEXCOORD_0": 1}}
    wall = {"baseColorTexture": {"index": 0}}
    return {
        "asset": {"version": "2.0"},
        "buffers": [
            {
                "byteLength": len(data),
                "uri": "data:application/octet-stream;base64," + base64.b64encode(data).decode(),
            }
        ],
        "bufferViews": [
            {"buffer": 0, "byteLength": 160},
            {"buffer": 0, "byteOffset": 160, "byteLength": 24},
        ],
        "accessors": [
            {**floats, "type": "VEC3"},
            {**floats, "byteOffset": 96, "type": "VEC2"},
            indices,
            {**indices, "byteOffset": 12},
        ],
        "images": [{"uri": "wall.png"}],
        "textures": [{"source": 0}],
        "materials": [
            {"name": "wall", "doubleSided": True, "pbrMetallicRoughness": wall},
            {
                "name": "box",
                "doubleSided": True,
                "pbrMetallicRoughness": {"baseColorFactor": [0.7, 0.1, 0.1, 1]},
            },
        ],
        "meshes": [
            {
                "primitives": [
                    {**shared, "indices": 2, "material": 0},
                    {**shared, "indices": 3, "material": 1},
                ]
            }
        ],
        "nodes": [{"mesh": 0}],
    }


def write_small_study(folder: Path) -> Path:
    """Write the study's protocol and its files; return the protocol."""
    rng = np.random.default_rng(3)
    noise = rng.integers(40, 220, (32, 32, 3), dtype=np.uint8)
    Image.fromarray(np.repeat(np.repeat(noise, 4, 0), 4, 1)).save(folder / "wall.png")
    (folder / "box.gltf").write_text(json.dumps(box_document()))
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
