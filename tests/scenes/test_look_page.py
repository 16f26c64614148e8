"""`stimuli look --interactive`: a page of this machine from which a view's line is taken."""

import http.client
import io
import shutil
import subprocess
import threading
from contextlib import closing
from urllib.parse import urlencode, urlsplit

import numpy as np
import pytest
import trimesh
from PIL import Image

from protocols.recipes.warped_clips import CameraView
from stimuli.rendering.scene_views import ScenePreview, look_interactively
from stimuli.rendering.view_page import VIEW_PX, CameraPlace
from stimuli.rendering.world import Viewpoint

START = {"x_m": 0.0, "y_m": 1.6, "z_m": 4.0, "yaw_deg": 0.0, "pitch_deg": 0.0, "fov_deg": 50.0}


@pytest.fixture
def served(gl_context, tmp_path):
    """Give a function that serves a scene and runs `visit(address)` in a thread beside it."""

    def serve(visit):
        said: list[str] = []
        failed: list[BaseException] = []

        def opened(address: str) -> None:
            def work() -> None:
                try:
                    visit(address)
                except BaseException as error:
                    failed.append(error)
                finally:
                    ask(address, "done", "POST")

            threading.Thread(target=work, daemon=True).start()

        boxes = trimesh.Scene()
        for place in range(-2, 3):
            box = trimesh.creation.box((0.8, 2.0 + 0.3 * place, 0.8))
            box.visual.vertex_colors = (90 + 40 * place, 200 - 30 * place, 120, 255)
            box.apply_translation((1.5 * place, 1.0, -0.5 * place**2))
            boxes.add_geometry(box)
        boxes.export(tmp_path / "shed.glb")
        chosen = [CameraView(position_m=(0.0, 1.6, 4.0), look_at_m=(0.0, 1.0, 0.0))]
        preview = ScenePreview(str(tmp_path / "shed.glb"), chosen=chosen)
        look_interactively(gl_context, preview, opened=opened, say=said.append)
        if failed:
            raise failed[0]
        return said

    return serve


def ask(address, name, method="GET", host=None, **words):
    parts = urlsplit(address)
    query = f"?{urlencode(words)}" if words else ""
    said = {"Host": host or parts.netloc}
    with closing(http.client.HTTPConnection(parts.hostname, parts.port, timeout=60)) as connection:
        connection.request(method, f"{parts.path}{name}{query}", headers=said)
        answer = connection.getresponse()
        return answer.status, answer.read(), answer.headers.get("X-View")


def test_the_page_shows_views_and_the_line_that_is_taken_is_printed(served):
    def visit(address):
        status, page, _ = ask(address, "")
        assert status == 200
        assert b"shed.glb: choose a view" in page
        status, first, line = ask(address, "view", **START)
        assert status == 200
        assert Image.open(io.BytesIO(first)).size == VIEW_PX
        assert line.startswith("view = { position_m = [0, 1.6, 4], look_at_m = [0, 1.6, ")
        _, second, _ = ask(address, "view", **START | {"yaw_deg": 90.0})
        shown = [np.asarray(Image.open(io.BytesIO(data))).astype(float) for data in (first, second)]
        assert np.abs(shown[0] - shown[1]).mean() > 5
        assert ask(address, "take", "POST", **START)[0] == 200

    said = served(visit)
    assert len(said) == 1
    assert said[0].startswith("view = { position_m = [0, 1.6, 4], look_at_m = [0, 1.6, ")


def test_who_does_not_know_the_address_gets_nothing(served):
    def visit(address):
        parts = urlsplit(address)
        wrong = f"http://{parts.netloc}/guess/"
        assert ask(wrong, "")[0] == 404
        assert ask(wrong, "take", "POST", **START)[0] == 404
        assert ask(wrong, "done", "POST")[0] == 404
        assert ask(address, "", host="example.org")[0] == 404
        assert ask(address, "view", "POST", **START)[0] == 404
        assert ask(address, "../study.toml")[0] == 404

    assert served(visit) == []


@pytest.mark.parametrize(
    "harm",
    [{"x_m": "nan"}, {"x_m": "1e300"}, {"pitch_deg": "90"}, {"fov_deg": "0"}, {"yaw_deg": "a"}],
)
def test_numbers_that_are_no_view_are_refused(harm):
    with pytest.raises(ValueError, match=r"view|float"):
        CameraPlace.from_words({name: str(value) for name, value in START.items()} | harm)
    with pytest.raises(ValueError, match="a view has x_m"):
        CameraPlace.from_words({"x_m": "1"})


@pytest.mark.parametrize("target", [(3.0, 1.0, -5.0), (-2.0, 4.0, 1.0), (0.0, 1.6, 9.0)])
def test_a_view_turned_into_angles_and_back_looks_the_same_way(target):
    view = Viewpoint((0.5, 1.6, 2.0), target, 40.0)
    far = float(np.linalg.norm(np.subtract(target, view.position_m)))
    again = CameraPlace.of(view).view(far)
    assert again.position_m == view.position_m
    np.testing.assert_allclose(again.look_at_m, target, atol=1e-9)
    assert again.vertical_fov_deg == 40.0


def test_a_browser_shows_the_view_and_its_line(served):
    browser = shutil.which("chromium") or shutil.which("google-chrome")
    if browser is None:
        pytest.skip("needs Chromium (apt-get install chromium)")
    pages = []

    def visit(address):
        pages.append(
            subprocess.run(
                [browser, "--headless", "--no-sandbox", "--disable-gpu",
                 "--virtual-time-budget=4000",
                 "--dump-dom", address],
                capture_output=True, text=True, check=True, timeout=120,
            ).stdout
        )  # fmt: skip

    served(visit)
    assert "view = { position_m" in pages[0].split('id="line"')[1][:200]
    assert 'src="blob:' in pages[0]
