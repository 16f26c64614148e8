"""Pictures show what their captions say, and sheets keep every picture and label."""

import numpy as np
import pytest

from pipeline.pictures import drawing
from pipeline.pictures.decode import read_pixels


def test_near_is_bright_and_infinity_black():
    """By hand: with white at 2 m, 4 m is half as bright."""
    picture = drawing.of_depth(np.array([[2.0, 4.0, np.inf]]))

    assert picture[0, :, 0].tolist() == [255, 128, 0]


def test_directions_of_motion_have_their_own_hues():
    """Right is red, left cyan; twice the motion is twice as bright; rest is black."""
    flow_px = np.array([[[4.0, 0.0], [-4.0, 0.0], [2.0, 0.0], [0.0, 0.0], [0.0, 4.0]]])
    right, left, slow, rest, down = drawing.of_flow(flow_px)[0].astype(int)

    assert right.tolist() == [255, 0, 0]
    assert left[0] < 8
    assert left[1:].min() > 247
    assert slow.tolist() == [128, 0, 0]
    assert rest.tolist() == [0, 0, 0]
    assert down[1] == 255


def test_still_and_empty_fields_are_drawn_without_dividing_by_zero():
    zeros = np.zeros((3, 4))

    assert (drawing.of_flow(np.zeros((3, 4, 2))) == 0).all()
    assert (drawing.of_signed(zeros) == 128).all()
    assert (drawing.of_magnitude(zeros) == 0).all()


def test_signed_values_are_grey_at_zero_and_clipped_at_the_largest():
    picture = drawing.of_signed(np.array([[-2.0, -1.0, 0.0, 1.0, 9.0]]), largest=1.0)

    assert picture[0, :, 0].tolist() == [0, 0, 128, 255, 255]


def test_holes_are_marked_and_nothing_else(rng):
    colour = rng.random((4, 5, 3))
    hole = np.zeros((4, 5), bool)
    hole[1, 2] = True
    marked = drawing.of_holes(colour, hole)

    assert tuple(marked[1, 2]) == drawing.HOLE_COLOUR
    np.testing.assert_array_equal(marked[~hole], drawing.of_colour(colour)[~hole])


@pytest.mark.parametrize("count", [1, 2, 5, 7])
def test_a_sheet_holds_every_picture_whole(rng, count):
    tiles = [
        (f"a label of picture {index}", rng.integers(0, 255, (400, 330, 3), dtype=np.uint8))
        for index in range(count)
    ]
    sheet = drawing.sheet(tiles)

    for _, tile in tiles:
        rows, columns = np.nonzero((sheet[:-399, :-329] == tile[0, 0]).all(axis=-1))
        assert any(
            np.array_equal(sheet[row : row + 400, column : column + 330], tile)
            for row, column in zip(rows, columns, strict=True)
        )


def test_a_long_label_wraps_and_never_leaves_its_picture():
    """Text is drawn in the sheet's light colour: none of it beyond the picture's right edge."""
    tile = np.zeros((40, 330, 3), np.uint8)
    label = "a very long label that cannot possibly fit on one line under so narrow a picture"
    sheet = drawing.sheet([(label, tile)])

    bright = (sheet > 200).all(axis=-1)
    assert bright.any()
    assert not bright[:, 12 + 330 :].any()
    assert bright.any(axis=1).sum() > 2 * 10  # more than one line of text


def test_small_pictures_are_enlarged_until_labels_fit():
    assert drawing.sheet([("x", np.zeros((8, 10, 3), np.uint8))]).shape[1] >= 320


def test_a_picture_is_fitted_without_changing_its_aspect():
    white = np.full((10, 40, 3), 255, np.uint8)
    fitted = drawing.fitted(white, (50, 100))

    assert fitted.shape == (50, 100, 3)
    assert (fitted[:25] == 255).all()
    assert (fitted[26:] < 50).all()


def test_a_saved_picture_comes_back(tmp_path, rng):
    picture = rng.integers(0, 255, (6, 7, 3), dtype=np.uint8)
    drawing.save_picture(tmp_path / "a.png", picture)

    np.testing.assert_array_equal(read_pixels(tmp_path / "a.png").data, picture)
