"""The table of fill quality in docs/ is made by a command that measures what it says."""

from unittest.mock import Mock

import numpy as np

from benchmarks import quality
from benchmarks.quality import PART, jods, means, measure, table
from pipeline.named_classes import Choice
from pipeline.quality import Quality, interior
from pipeline.warp.reference import warp
from pipeline.warp.settings import WarpSettings
from stimuli.scenes.stereo import StereoPair


def test_holes_that_touch_the_border_are_left_out_whole():
    hole = np.zeros((6, 8), bool)
    hole[2:4, 3:5] = True  # inside
    hole[0, 6] = hole[1, 7] = True  # at the border, joined by a corner

    kept = interior(hole)

    assert np.argwhere(kept).tolist() == [[2, 3], [2, 4], [3, 3], [3, 4]]


def test_a_pair_is_measured_inside_its_interior_holes(gl_context, rng):
    """A plane in front of which a square moves; the truth is the plane's own constant colour."""
    disparity = np.full((48, 64), 2.0, np.float32)
    disparity[12:36, 24:48] = 10.0
    left = np.where(disparity[..., None] > 5, 1.0, 0.5) + 0 * np.zeros(3)
    truth = (0.5 + 0.01 * rng.standard_normal((48, 64, 3))).astype(np.float32)
    pair = StereoPair(left.astype(np.float32), disparity, disparity > 0, 100.0, 0.1, right=truth)

    share, found = measure(gl_context, pair, [Choice("background-extension")])

    frame = pair.warp_input()
    bare, grown = (
        interior(warp(frame.source, frame.flow_px, settings=WarpSettings(rim_px=rim_px)).hole)
        for rim_px in (0, 1)
    )
    assert share == grown.mean() > bare.mean()  # a photograph's rim is hole too
    assert 24 * 7 / (48 * 64) < share < 24 * 12 / (48 * 64)  # not the 2 px at the right border
    assert found["background-extension"].psnr_db > 35  # noise of 0.01 is 40 dB


def test_the_means_replace_what_stands_between_its_markers(tmp_path):
    document = tmp_path / "page.md"
    document.write_text(f"before\n{PART.begin}\nold\n{PART.end}\nafter\n", encoding="utf-8")
    found = {
        "one": (0.05, {"telea": Quality(15.0, 0.5, 0.4, 0.3)}),
        "other": (0.01, {"telea": Quality(17.0, 0.7, 0.5, 0.1)}),
    }

    PART.replace(document, means(found))

    text = document.read_text(encoding="utf-8")
    assert "old" not in text
    assert "| `telea` | 16.00 | 0.600 | 0.45 | 0.200 |" in text
    assert text.startswith("before\n")
    assert text.endswith("after\n")
    assert "| other (1.0 %) | telea | 17.00 | 0.700 | 0.50 | 0.100 |" in table(found)


def test_jod_is_of_interior_holes_alone(gl_context, rng, monkeypatch):
    """With a metric that tells the share of pixels which differ from the truth."""
    disparity = np.full((48, 64), 2.0, np.float32)
    disparity[12:36, 24:48] = 10.0
    left, right = rng.random((2, 48, 64, 3)).astype(np.float32)
    pair = StereoPair(left, disparity, disparity > 0, 100.0, 0.1, right=right)
    metric = Mock(predict=lambda test, truth, **_: [(test != truth).any(axis=-1).mean()])
    monkeypatch.setattr(quality, "open_fvvdp", lambda *_, **__: metric)
    monkeypatch.setattr(quality, "pairs", lambda _: [("square", pair)])

    share, _ = measure(gl_context, pair, [Choice("push-pull")])
    line = jods(gl_context, None, [Choice("push-pull")]).splitlines()[-1]
    assert line == f"| square | {share:.2f} |"
