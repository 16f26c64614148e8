"""`foveate --page`: the metamer on the page is that of numpy, wherever mouse and finger point."""

import base64
import io
import re

import numpy as np
import pytest
from command_line import metamerlab
from PIL import Image

from pipeline.foveation.conditions import foveate
from pipeline.foveation.geometry import Flat
from pipeline.gl.fragment import fragment_of
from pipeline.gl.shader import ShaderSource
from pipeline.named_classes import Choice
from stimuli.foveate.metamer_page import write_page

EDGE, SEED = 512, 3
MOST_BYTES = 6_000_000


def textured(height, width):
    """Encoded R'G'B' of 8 bits with edges, hues, texture and large dark and pale areas."""
    rng = np.random.default_rng(7)
    y, x = np.mgrid[:height, :width] / max(height, width)
    hues = np.stack([x, y, 0.5 + 0.5 * np.sin(40 * x * y)], axis=-1)
    bars = ((x * 23).astype(int) % 2 == 0)[..., None] * np.array([0.9, 0.2, 0.4])
    grain = rng.normal(0, 0.15, (height, width, 1))
    mixed = np.where((y > 0.6)[..., None], bars, hues) + grain * (x > 0.5)[..., None]
    return np.rint(255 * np.clip(mixed, 0, 1)).astype(np.uint8).astype(np.float32) / 255


def pixels(url):
    data = base64.b64decode(url.split(",")[1])
    return np.asarray(Image.open(io.BytesIO(data)).convert("RGB"), np.float64)


@pytest.mark.slow
def test_the_page_shows_the_metamer_of_numpy_where_mouse_and_finger_point(chromium, tmp_path):
    picture, viewing = textured(EDGE, EDGE), Flat(width_deg=40)
    path = tmp_path / "page.html"
    *size, count = write_page(path, "a page", picture, viewing, Choice("metamer"), seed=SEED)
    assert size == [EDGE, EDGE]
    assert count == path.stat().st_size <= MOST_BYTES
    chromium.open(path.as_uri(), size=(900, 800))
    assert chromium.evaluate("ready.then(() => said.textContent)") == ""
    left, top = chromium.evaluate("[canvas.getBoundingClientRect()].map((b) => [b.x, b.y])[0]")

    def middle(x, y):
        """Nobody has pointed yet: the page has drawn this for itself."""
        assert chromium.evaluate("metamer.shown") == [x, y]

    def moved(x, y):
        chromium.devtools("Input.dispatchMouseEvent", type="mouseMoved", x=left + x, y=top + y)

    def touched(x, y):
        point = [{"x": left + x, "y": top + y}]
        chromium.devtools("Input.dispatchTouchEvent", type="touchStart", touchPoints=point)
        chromium.devtools("Input.dispatchTouchEvent", type="touchEnd", touchPoints=[])

    for ask, gaze_px in ((middle, (256, 256)), (moved, (30, 480)), (touched, (400, 100))):
        ask(*gaze_px)
        # What a canvas shows is lost once it is shown: it is drawn again.
        told, url = chromium.evaluate(
            "new Promise(requestAnimationFrame).then(() => {"
            " const told = metamer.shown; metamer.show(...told);"
            " return [told, canvas.toDataURL()]; })"
        )
        assert told == list(gaze_px)
        wanted = foveate(picture, gaze_px=gaze_px, viewing=viewing, method="metamer", seed=SEED)
        assert abs(pixels(url) - 255 * wanted).max() <= 2, gaze_px
    assert chromium.errors == []


@pytest.mark.slow
@pytest.mark.parametrize(
    "parameters",
    [
        {"chroma": "luma", "law": "authors", "noise": 0.5},
        {"residual": "pooled", "levels": 2, "fovea_deg": 0.0},
    ],
)
def test_other_parameters_and_odd_sizes_are_those_of_numpy(chromium, tmp_path, parameters):
    picture, viewing = textured(61, 83), Flat(distance_px=150)
    choice = Choice("metamer", parameters)
    path = tmp_path / "page.html"
    write_page(path, "a page", picture, viewing, choice, seed=5)
    chromium.open(path.as_uri())
    assert chromium.evaluate("ready.then(() => said.textContent)") == ""
    shown = pixels(chromium.evaluate("metamer.show(20, 41.5); canvas.toDataURL()"))
    wanted = foveate(
        picture, gaze_px=(20, 41.5), viewing=viewing, method="metamer", seed=5, **parameters
    )
    assert abs(shown - 255 * wanted).max() <= 2


def test_the_page_is_drawn_for_the_distance_that_is_said_and_keeps_it(chromium, tmp_path):
    """By hand: a card of 342.4 px would have 4 px a mm, and 15 cm 600 px."""
    picture, path = textured(61, 83), tmp_path / "page.html"
    write_page(path, "a page", picture, Flat(distance_px=150), Choice("metamer"), seed=5)
    chromium.open(path.as_uri())
    assert chromium.evaluate("ready.then(() => metamer.away)") == 150
    away = chromium.evaluate(
        "document.getElementById('card').value = 342;"
        "document.getElementById('distance').value = 15;"
        "document.getElementById('distance').dispatchEvent(new Event('input')); metamer.away"
    )
    assert away == pytest.approx(150 * 342 / 85.6)
    shown = pixels(chromium.evaluate("metamer.show(20, 41.5); canvas.toDataURL()"))
    wanted = foveate(picture, gaze_px=(20, 41.5), viewing=Flat(distance_px=away), seed=5)
    assert abs(shown - 255 * wanted).max() <= 2
    chromium.open(path.as_uri(), anew=False)
    assert chromium.evaluate("ready.then(() => metamer.away)") == pytest.approx(away)


def test_without_webgl2_the_page_says_so_and_shows_no_picture(chromium, tmp_path):
    path = tmp_path / "page.html"
    write_page(path, "a page", textured(32, 40), Flat(), Choice("metamer"), seed=0)
    chromium.open(path.as_uri(), "HTMLCanvasElement.prototype.getContext = () => null;")
    said = chromium.evaluate("ready.then(() => said.textContent)")
    assert "WebGL2" in said
    assert "another browser" in said
    assert chromium.evaluate("canvas.hidden")


def run(*words):
    done = metamerlab("foveate", *map(str, words), catch_exceptions=False, status=None)
    return done.exit_code, done.stdout + done.stderr


@pytest.fixture
def photo(tmp_path):
    Image.fromarray(np.rint(255 * textured(600, 800)).astype(np.uint8)).save(tmp_path / "photo.png")
    return tmp_path / "photo.png"


def test_the_command_writes_one_file_that_names_no_other(tmp_path):
    photo, page = tmp_path / "photo.png", tmp_path / "new" / "page.html"
    Image.fromarray(np.rint(255 * textured(72, 96)).astype(np.uint8)).save(photo)
    words = ("--page", page, "--size-px", "64", "--numpy", "-m", "metamer")
    code, said = run(photo, tmp_path / "out.png", *words)
    assert code == 0, said
    assert "64 x 48 px" in said
    text = page.read_text()
    assert "photo" in text
    assert not re.search(r"https?:|\bsrc=|\bhref=|import\(|fetch\(", text)


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (("--page", "p.html", "-m", "blur"), ("metamer", "got blur")),
        (("--page", "p.html", "--set", "chroma=full"), ("chroma full", "follow or luma")),
        (("--page", "p.png"), ("p.png", ".html")),
        (("--page", "p.html", "--gaze", "replay:eye.csv"), ("--gaze replay:eye.csv", "frames")),
    ],
)
def test_what_a_page_cannot_show_is_refused_before_anything_is_written(
    photo, tmp_path, monkeypatch, words, says
):
    monkeypatch.chdir(photo.parent)
    code, said = run(photo.name, "out.png", "--numpy", *words)
    said = " ".join(said.split())
    assert code == 2, said
    assert said.count("error:") == 1
    assert all(word in said for word in says), said
    assert [path.name for path in tmp_path.iterdir()] == ["photo.png"]


def test_a_page_takes_a_picture_of_any_size_and_writes_no_other_file(photo, tmp_path, monkeypatch):
    """By hand: 591 x 443 px are at most 512 x 512 px."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "foveated.png").write_bytes(b"mine")
    code, said = run(photo.name, "--numpy", "--page", "p.html", "--size-px", "800")
    assert code == 0, said
    assert "wrote p.html (591 x 443 px" in " ".join(said.split())
    assert sorted(path.name for path in tmp_path.iterdir()) == [
        "foveated.png",
        "p.html",
        photo.name,
    ]
    assert (tmp_path / "foveated.png").read_bytes() == b"mine"


def test_pages_are_for_one_flat_picture(tmp_path):
    (tmp_path / "frames").mkdir()
    Image.new("RGB", (64, 32)).save(tmp_path / "frames" / "0.png")
    code, said = run(tmp_path / "frames", tmp_path / "shown", "--page", tmp_path / "p.html")
    assert code == 2
    assert "--page takes one picture" in said
    still = tmp_path / "frames" / "0.png"
    code, said = run(still, tmp_path / "out.png", "--panorama", "--page", tmp_path / "p.html")
    assert code == 2
    assert "panorama" in said
    assert not (tmp_path / "out.png").exists()


def test_a_fragment_keeps_what_its_call_writes_to_its_own_pixel():
    text = (
        "#version 430\nlayout(local_size_x = 8) in;\n"
        "layout(r32i) uniform writeonly iimage2D low;\n"
        "layout(rgba32ui) uniform writeonly uimage2DArray raised;\n"
        "void main() { imageStore(low, imageSize(low), ivec4(0)); imageStore(raised, a, b); }\n"
    )
    made = fragment_of(ShaderSource(text, ()), "raised", shared=2)
    assert "out uvec4" in made
    assert "uniform ivec2 low_size;\nuniform ivec3 raised_size;" in made
    assert "PASS_OVER(low_size, ivec4(0)); keep(a, b);" in made
    assert "local_size_x" not in made
