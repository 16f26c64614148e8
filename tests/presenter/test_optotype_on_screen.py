"""A ring as the presenter puts it on the screen, pixel by pixel."""

from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from protocols.feasibility import virtual_manifest
from protocols.load import load_study
from protocols.make_script import landolt_ring
from protocols.phases import Optotype
from protocols.script import ScriptPhase
from study_app.paint import ring_image
from study_app.presenter import Presenter
from study_app.session_setup import SessionSetup
from study_app.stage import FlipPicture


@pytest.mark.parametrize("gap_deg", [None, 90.0])
def test_a_phase_with_an_optotype_shows_the_ring_and_nothing_else(gl_context, tmp_path, gap_deg):
    study, display = load_study(Path("demo"))
    size = (display.width_px, display.height_px)
    pixels = gl_context.texture(size, 4)
    screen = gl_context.framebuffer([pixels])
    screen.use()
    window = SimpleNamespace(ctx=gl_context, size=size, display=display, now=lambda: 0.0)
    manifest = virtual_manifest(study, display)
    setup = SessionSetup(study, display, manifest, tmp_path, "P01", stimuli=tmp_path)
    presenter = Presenter(window, setup, 60.0)
    ring = Optotype(gap_deg, height_deg=1.25, x_deg=5.0, y_deg=-3.0)

    picture = landolt_ring(ring, display)
    presenter._ready[id(picture)] = picture, presenter._texture(picture)
    presenter._draw(FlipPicture(ScriptPhase(name="ring", frames=9, show=(picture,))))

    shown = np.frombuffer(screen.read(components=3), np.uint8).reshape(size[1], size[0], 3)[::-1]
    image = ring_image(picture.of)
    x, y = picture.at[0] + size[0] // 2, picture.at[1] + size[1] // 2
    alpha = image[..., 3:] / 255.0
    grey = round(255 * study.display.background)
    wanted = np.full((size[1], size[0], 3), float(grey))
    part = wanted[y : y + len(image), x : x + len(image)]
    part[:] = alpha * image[..., :3] + (1 - alpha) * part
    presenter.close()
    screen.release()
    pixels.release()
    assert np.abs(shown - wanted).max() <= 1.0
    assert (shown < 100).any(), "the ring is black on grey"
