"""Stimuli for browsers: lossless WebP, pieces that several have, and a share of the scenes."""

import io
from collections import Counter
from itertools import pairwise

import numpy as np
import pytest
from PIL import Image
from web_browser import Browser, served, whole
from web_study import PIECE_PX, BuiltWebStudy, brought_home, for_browsers

from protocols.disk.hashing import sha256_bytes
from protocols.plan import planned_trials
from study_app.paint import PixelBytes
from study_app.session_folders import find_sessions
from study_app.verification import verify
from study_app.web import export, packs


def pieces(of: BuiltWebStudy, pack: dict) -> list[PixelBytes]:
    """Pictures of a pack, each of which has the hash that is said."""
    data, found, began = (of.out / "packs" / pack["file"]).read_bytes(), [], 0
    for end, sha256 in zip(pack["ends"], pack["sha256"], strict=True):
        assert sha256_bytes(data[began:end]) == sha256
        found.append(np.asarray(Image.open(io.BytesIO(data[began:end])).convert("RGB")))
        began = end
    assert began == pack["bytes"] == len(data)
    return found


def test_what_stimuli_share_is_written_once_and_gives_the_same_codes(alike):
    told = alike.exported
    names = export.WebBuild(alike.study, alike.display, alike.manifest).names
    across, taken = -(-64 // PIECE_PX), 0
    for clip in alike.manifest.clips:
        pack = told["stimuli"][names[clip.name]]
        shared = [one for name in pack["shared"] for one in pieces(alike, told["shared"][name])]
        all_pieces = [*shared, *pieces(alike, pack)]
        assert 1 <= len(pack["ends"]) <= 4 < across**2  # the square alone
        (frame,) = pack["frames"]
        rows = [frame[at : at + across] for at in range(0, across**2, across)]
        made = np.vstack([np.hstack([all_pieces[number] for number in row]) for row in rows])
        path = alike.stimuli / clip.frame_path(0)
        assert np.array_equal(made, np.asarray(Image.open(path)))
        taken += pack["bytes"]
    png = sum((alike.stimuli / c.frame_path(0)).stat().st_size for c in alike.manifest.clips)
    assert taken + sum(pack["bytes"] for pack in told["shared"].values()) < png


def test_pictures_are_webp_where_that_is_smaller_and_codes_are_the_same(rng):
    def png(pixels: PixelBytes) -> bytes:
        file = io.BytesIO()
        Image.fromarray(pixels).save(file, "PNG")
        return file.getvalue()

    smooth = np.add.outer(np.arange(90), np.arange(70)).astype(np.uint8)
    picture = np.stack([smooth, smooth + 3, 255 - smooth], axis=-1)
    webp = packs.coded(png(picture))
    assert webp[:4] == b"RIFF"
    assert len(webp) < len(png(picture))
    assert np.array_equal(np.asarray(Image.open(io.BytesIO(webp))), picture)
    clear = png(rng.integers(0, 255, (40, 40, 4), dtype=np.uint8))
    assert packs.coded(clear) == clear  # what is seen through stays as it was hashed
    tiny = png(np.zeros((1, 1, 3), np.uint8))
    assert len(packs.coded(tiny)) <= len(tiny)


def test_a_participant_is_sent_the_files_of_its_scenes_alone(alike):
    build = export.WebBuild(alike.study, alike.display, alike.manifest)
    scenes = [
        {clip.condition["scene"] for clip in alike.manifest.clips if clip.name in build._seen(slot)}
        for slot in range(3)
    ]
    assert {len(one) for one in scenes} == {2}
    assert set.union(*scenes) == set(alike.study.main_scenes())
    whole = export.WebBuild(for_browsers(alike.study), alike.display, alike.manifest)
    sizes = {clip.name: {clip.name: 10} for clip in alike.manifest.clips}
    assert 3 * build.needs(sizes).fetched_bytes == 2 * whole.needs(sizes).fetched_bytes


def test_every_participant_of_few_scenes_has_a_plan(alike):
    """With two scenes of three one in eight had none: a block began as the one before ended."""
    study = alike.study.in_a_browser()
    for number in range(200):
        trials = planned_trials(study, f"P{number}", number % 6)
        for one, following in pairwise(trials):
            assert one.block != following.block or one.shown != following.shown


def shared_session(browser: Browser, alike: BuiltWebStudy, folder) -> None:
    """Run a whole session of the study with a share of scenes; only what its plan shows comes."""
    with served(alike.out) as site:
        whole(browser, site)
        assert browser.errors == []
        asked = Counter(name for name in site.asked if name.startswith("packs/"))
    (imported,) = brought_home(alike, site.lines, folder)
    assert (imported.state, imported.reason) == ("imported", "completed"), imported.message
    (session,) = find_sessions(folder)
    assert list(verify(session, alike.study).problems) == []
    shown = {name for one in session.journal.attempts for name in one.stimulus_names}
    names, told = export.WebBuild(alike.study, alike.display, alike.manifest).names, alike.exported
    own = {told["stimuli"][names[name]]["file"] for name in shown}
    several = {
        told["shared"][s]["file"] for n in shown for s in told["stimuli"][names[n]]["shared"]
    }
    assert set(asked) == {f"packs/{name}" for name in own | several}
    assert len(own) < len(told["stimuli"])
    assert {asked[f"packs/{name}"] for name in several} == {1}


def test_a_session_in_chromium_fetches_what_its_plan_shows_and_comes_home(
    chromium, alike, tmp_path
):
    shared_session(chromium, alike, tmp_path)


@pytest.mark.slow
def test_a_session_in_firefox_does_so_too(firefox, alike, tmp_path):
    shared_session(firefox, alike, tmp_path)
