"""A study on a panorama, in the real window, seen flip by flip by another process."""

import re

import numpy as np
import pytest
import trimesh
from attack.captured_flips import compare
from PIL import Image
from study_texts import shipped_study

from pipeline.foveation.view import flat_view
from stimuli.recipes.foveated_work import StillsPlan

pytestmark = pytest.mark.slow


@pytest.mark.timeout(900)
def test_a_study_on_a_panorama_is_drawn_built_shown_and_reported(screen, start_study):
    """The commands of the documentation, small: a room all around, two views of it as scenes."""
    study = start_study("panorama")
    room = trimesh.creation.box((8, 3, 6)).subdivide().subdivide().subdivide()
    room.invert()
    shades = np.random.default_rng(3).integers(0, 256, (len(room.vertices), 4), dtype=np.uint8)
    shades[:, 3] = 255
    room.visual = trimesh.visual.ColorVisuals(room, vertex_colors=shades)
    room.export(study.folder / "room.glb")
    text = shipped_study("beyond-blur-preference", {}, questions=False)
    text = re.sub(r"^  \{ name = \"(garden|castle|colonnade|tunnel|thicket|notices|blur|energy)"
                  r"[^\n]*\n", "", text, flags=re.M)  # fmt: skip
    views = "".join(
        f'  {{ name = "{name}", file = "room-360.png", view = {{ right_deg = {right} }} }},\n'
        for name, right in (("door", 20), ("corner", 195))
    )
    text = text.replace('  { name = "street", file = "builtin:street" },\n', views)
    for old, new in (
        ('"fhd27-60hz"', '"little.toml"'), ("width_px = 1920", "width_px = 96"),
        ("height_px = 1080", "height_px = 64"), ('mode = "enforce"', 'mode = "none"'),
        ("dot_over_clips = true", "dot_over_clips = false"), ("repeats = 6", "repeats = 2"),
        ("blocks = 4", "blocks = 1"), ('against = "blur"', 'against = "reference"'),
        ("dropped_frames_max = 2", "dropped_frames_max = 10000"),
    ):  # fmt: skip
        assert old in text
        text = text.replace(old, new)
    study.path.write_text(text, encoding="utf-8")
    for words in (
        ("stimuli", "panorama", study.folder / "room.glb", "--out", study.folder / "room-360.png",
         "--height-px", 256, "--view", "view = { position_m = [0, 0, 1], look_at_m = [1, 0, 1] }"),
        ("stimuli", "build", study.path, "--out", study.stimuli),
    ):  # fmt: skip
        screen.run(*words)

    seen = screen.watch(study)
    logged, names = study.logged()
    assert compare(logged, seen, names) == []
    shown = {entry.split("/")[0] for entry in logged.values() if entry}
    assert shown == {
        f"{name}__{how}" for name in ("door", "corner") for how in ("reference", "ours")
    }
    whole = np.asarray(Image.open(study.folder / "room-360.png").convert("RGB"), np.float32) / 255
    order = StillsPlan(study.protocol.stimuli, 600 / 0.3, study.folder)
    for name, right in (("door", 20), ("corner", 195)):
        wanted = flat_view(whole, order.geometry, right_deg=right)
        stored = study.frame(f"{name}__reference", 0) / 255
        np.testing.assert_allclose(stored, wanted, atol=0.51 / 255)
        assert stored.std() > 0.02
    screen.run("analysis", "report", study.sessions, "--protocol", study.path,
                          "--out", study.folder / "report", "--no-figures")  # fmt: skip
