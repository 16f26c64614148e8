"""Sheets of the worst places show the worst places."""

import numpy as np

from benchmarks.paper import View
from benchmarks.worst import crops_of, local_distance, sheet_of, worst_places
from pipeline.frame import WarpedFrame


def test_the_squares_with_most_distance_come_first_and_do_not_overlap():
    distance = np.zeros((60, 80))
    distance[10:14, 20:24] = 2.0
    distance[40:44, 60:64] = 3.0
    distance[40:44, 5:9] = 1.0

    found = list(worst_places(distance, 5, 16))

    assert [round(total) for total, _ in found] == [48, 32, 16]
    seen = np.zeros(distance.shape, int)
    for _, place in found:
        seen[place] += 1
    assert seen.max() == 1


def test_a_moved_texture_is_near_and_a_smooth_or_darker_fill_is_far(rng):
    truth = rng.random((48, 48, 3)).astype(np.float32)
    mask = np.zeros((48, 48), bool)
    mask[12:36, 12:36] = True
    moved, smooth = np.roll(truth, 7, axis=1), np.full_like(truth, 0.5)

    near, far, dark = (
        local_distance(fill, truth, mask)[mask].mean() for fill in (moved, smooth, 0.7 * moved)
    )

    assert near < 0.5 * min(far, dark)
    assert (local_distance(smooth, truth, mask)[~mask] == 0).all()


def test_a_sheet_shows_fill_truth_and_holes(rng):
    truth = rng.random((80, 90, 3)).astype(np.float32)
    hole = np.zeros((80, 90), bool)
    hole[30:50, 40:60] = True
    flat = np.zeros((80, 90), np.float32)
    warped = WarpedFrame(truth * ~hole[..., None], flat + 2, hole, np.dstack([flat, flat]))

    crops = list(crops_of("a 0", View(warped, truth, hole), np.where(hole[..., None], 1, truth)))

    assert len(crops) == 1
    assert (crops[0].fill != crops[0].truth).any()
    assert sheet_of(crops).shape[1] > 3 * 64
