"""Pixels of a browser are those that `study_app/paint.py` paints."""

import copy
import io
import json
import subprocess
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import pytest
from chromium import chromium_for_tests
from PIL import Image
from PIL.PngImagePlugin import PngInfo
from web_browser import Browser, Site, screen, served
from web_kernel import WEB, node_modules
from web_study import WEB_CASES, BuiltWebStudy

from protocols.disk.hashing import sha256_bytes
from protocols.script import Frames, Picture, ScriptPhase
from study_app.paint import PixelBytes, bitmaps_of, paint
from study_app.web.export import WebBuild

SMOOTH = {False: (0, 0), True: (8, 1)}
"""Most pixels and codes that differ: on a flat canvas, Firefox blends smooth edges a little off."""
PAINTED = [name for name in WEB_CASES if name not in ("yes-no", "yes-no by up-down")]
"""All that these two show, "yes-no with confidence" shows."""
RATIOS = (1, 1.1, 1.25, 1.5, 2)


@pytest.fixture(scope="module")
def lab(tmp_path_factory):
    """Give the page that paints what it is told, as bytes of a script."""
    script = tmp_path_factory.mktemp("lab") / "lab.js"
    esbuild = node_modules() / ".bin" / "esbuild"
    subprocess.run(
        [esbuild, "test/lab.ts", "--bundle", "--format=iife", "--log-level=warning",
         f"--outfile={script}"],
        cwd=WEB, check=True, timeout=60,
    )  # fmt: skip
    return script.read_bytes()


@dataclass(frozen=True)
class Scene:
    """Something that a flip shows: for the page as JSON, and as Python paints it."""

    told: str
    screen: PixelBytes


def scenes(of: BuiltWebStudy) -> Iterator[Scene]:
    """Yield all that the study's scripts show: each phase with each notice, and as of a clip."""
    build = WebBuild(of.study, of.display, of.manifest)
    bitmaps = bitmaps_of(build.shown, of.display)
    frames = dict(enumerate([pixels_of(of, name) for name in names] for names in held(of)))
    seen = set()
    for script in build.scripts[60.0]["en"]:
        for phase in script.phases:
            second = [
                entry.model_copy(update={"every": 2, "last": 1})
                if isinstance(entry, Frames)
                else entry
                for entry in phase.show
            ]
            clip = phase.model_copy(update={"show": tuple(second)})
            shown = [(phase, 0, notice) for notice in (None, *phase.follows.values())]
            for one, refreshes, notice in (*shown, (clip, 3, None)):
                told = json.dumps([_told(build, one), refreshes, _shown(build, notice)])[1:-1]
                if told not in seen:
                    seen.add(told)
                    yield Scene(told, paint(script, one, frames, bitmaps, refreshes=refreshes,
                                            notice=notice))  # fmt: skip


def _shown(build: WebBuild, entry):
    if entry is None:
        return None
    shown = build._entry(entry) if isinstance(entry, Picture) else entry
    return shown.model_dump(mode="json")


def _told(build: WebBuild, phase: ScriptPhase):
    return {"show": [_shown(build, entry) for entry in phase.show]}


def held(of: BuiltWebStudy) -> list[list[str]]:
    """Return the stimuli of a trial; more than one still stands for the frames of a clip."""
    names = list(of.exported["stimuli"])
    return [names[2 * n : 2 * n + 2] for n in range(len(names) // 2)]


def pixels_of(of: BuiltWebStudy, name: str) -> PixelBytes:
    names = WebBuild(of.study, of.display, of.manifest).names
    clip = next(clip for clip in of.manifest.clips if names[clip.name] == name)
    return np.asarray(Image.open(of.stimuli / clip.frame_path(0)).convert("RGB"))


def on_canvas(screen: PixelBytes, width: int, height: int, scale: int) -> PixelBytes:
    """Return the part of a screen about its middle that a canvas shows."""
    large = np.kron(screen, np.ones((scale, scale, 1), np.uint8))
    down, across = scale * (screen.shape[0] // 2), scale * (screen.shape[1] // 2)
    top, left = down - height // 2, across - width // 2
    assert min(top, left) >= 0
    return large[top : top + height, left : left + width]


def opened(
    browser: Browser, site: Site, of: BuiltWebStudy, lab: bytes, scale: int, flat: bool, **how
) -> tuple[int, int, str]:
    site.faults["lab.js"] = lambda _: (200, lab)
    page = '<!doctype html><link rel="stylesheet" href="metamerlab.css"><body><script src="lab.js">'
    site.faults["lab.html"] = lambda _: (200, f"{page}</script>".encode())
    how.setdefault("size", of.exported["window_px"])
    browser.open(f"{site.url}lab.html", **how)
    width, height, kind = browser.evaluate(
        f"lab.open({json.dumps(held(of))}, {scale}, {json.dumps(flat)})"
    )
    return width, height, kind


def differences(browser: Browser, of: BuiltWebStudy, shown: list[Scene], lab: bytes, flat: bool):
    """Yield how many pixels of each scene differ, and by how many codes at most."""
    with served(of.out, jatos=False) as site:
        width, height, kind = opened(browser, site, of, lab, 1, flat)
        assert kind == ("2d" if flat else "webgl")
        for number, scene in enumerate(shown):
            wanted = on_canvas(scene.screen, width, height, 1).tobytes()
            site.faults[f"wanted-{number}"] = lambda _, wanted=wanted: (200, wanted)
            browser.evaluate(f"lab.paint({scene.told})")
            yield *browser.evaluate(f"lab.differs('wanted-{number}')"), scene.told


def test_a_canvas_in_chromium_shows_what_is_painted(chromium, case, lab):
    of = case("which-half")
    found = [*differences(chromium, of, [*scenes(of)], lab, flat=False)]
    assert [one for one in found if one[0]] == []
    assert len(found) > 15


@pytest.mark.slow
@pytest.mark.parametrize("name", PAINTED)
def test_canvases_show_what_is_painted(chromium, firefox, case, lab, name):
    of = case(name)
    shown = [*scenes(of)]
    for browser, flat in ((chromium, False), (chromium, True), (firefox, True)):
        found = [*differences(browser, of, shown, lab, flat=flat)]
        most = SMOOTH[browser is firefox]
        assert [one for one in found if one[0] > most[0] or one[1] > most[1]] == []


@pytest.mark.slow
def test_frames_put_together_of_pieces_show_what_is_painted(chromium, firefox, alike, lab):
    shown = [*scenes(alike)]
    for browser, flat in ((chromium, False), (chromium, True), (firefox, True)):
        found = [*differences(browser, alike, shown, lab, flat=flat)]
        most = SMOOTH[browser is firefox]
        assert [one for one in found if one[0] > most[0] or one[1] > most[1]] == []


def with_gamma(of: BuiltWebStudy, name: str, site: Site) -> None:
    """Give a stimulus a chunk that asks for other colours: its pixels are the same."""
    chunk = PngInfo()
    chunk.add(b"gAMA", (100_000).to_bytes(4, "big"))
    file = io.BytesIO()
    Image.fromarray(pixels_of(of, name)).save(file, "png", pnginfo=chunk)
    data = file.getvalue()
    assert b"gAMA" in data
    pack = {"bytes": len(data), "ends": [len(data)], "sha256": [sha256_bytes(data)]}
    site.faults[f"packs/{of.exported['stimuli'][name]['file']}"] = lambda _: (200, data)
    changed = copy.deepcopy(of.exported)
    changed["stimuli"][name].update(pack)
    site.faults["study.json"] = lambda _: (200, json.dumps(changed).encode())


@pytest.mark.slow
def test_a_colour_chunk_changes_no_pixel(chromium, firefox, case, lab):
    of = case("two-alternative")
    scene = next(one for one in scenes(of) if '"frames"' in one.told)
    for browser, flat in ((chromium, False), (chromium, True), (firefox, True)):
        with served(of.out, jatos=False) as site:
            with_gamma(of, held(of)[0][0], site)
            width, height, _ = opened(browser, site, of, lab, 1, flat)
            wanted = on_canvas(scene.screen, width, height, 1).tobytes()
            site.faults["wanted"] = lambda _, wanted=wanted: (200, wanted)
            browser.evaluate(f"lab.paint({scene.told})")
            pixels, codes = browser.evaluate("lab.differs('wanted')")
            most = SMOOTH[browser is firefox]
            assert pixels <= most[0]
            assert codes <= most[1]


@pytest.mark.slow
@pytest.mark.parametrize("ratio", RATIOS)
def test_the_composited_page_shows_what_is_painted_at_any_ratio(case, lab, ratio):
    of, scale = case("two-alternative"), max(1, round(ratio))
    args = f"--force-device-scale-factor={ratio}", "--window-size=900,500"
    with chromium_for_tests(*args) as browser, served(of.out, jatos=False) as site:
        width, height, _ = opened(browser, site, of, lab, scale, flat=False, size=None)
        assert browser.evaluate("devicePixelRatio") == pytest.approx(ratio)
        some = [one for one in scenes(of) if '"frames"' in one.told][:3]
        assert some
        for scene in some:
            browser.evaluate(f"lab.paint({scene.told})")
            shot = screen(browser)
            assert shot.shape[:2] == (height, width)
            wanted = on_canvas(scene.screen, width, height, scale)
            assert np.count_nonzero((shot != wanted).any(axis=2)) == 0
