"""The opening figure of a paper: where it looks, and what stands in it."""

import io
import re

import numpy as np
import pytest
from PIL import Image

from pipeline.errors import InputError
from pipeline.pictures.drawing import Crop, auto_crops, mean_difference
from stimuli.score.plots import png_bytes, vector_bytes
from stimuli.warp.teaser import (
    WIDTHS_IN,
    FigureRow,
    RowSettings,
    _titles,
    figure_rows,
    of_steps,
    teaser,
)


def row(methods: int = 3, scene: str = "") -> FigureRow:
    made = np.random.default_rng(1)
    frames = tuple(made.integers(0, 255, (90, 120, 3), np.uint8) for _ in range(methods))
    crops = (Crop(10, 10, 20, 15), Crop(60, 40, 20, 15))
    return FigureRow((scene, "large"), frames[0], "reference", frames, crops, 0)


def test_the_difference_is_the_mean_over_pairs_by_hand():
    a, b, c = (np.full((2, 2, 3), level, np.uint8) for level in (0, 10, 40))
    np.testing.assert_allclose(mean_difference([a, b, c]), (10 + 40 + 30) / 3)
    np.testing.assert_allclose(mean_difference([a]), 0)


def test_crops_lie_where_the_difference_is_largest_and_never_overlap():
    apart = np.zeros((96, 120))
    apart[20:30, 30:44] = 5.0
    apart[70:80, 90:100] = 3.0
    first, second, third = auto_crops(apart, 3)
    assert first.width == 20
    assert first.height == 15
    assert apart[first.y : first.y + 15, first.x : first.x + 20].sum() == pytest.approx(700)
    assert apart[second.y : second.y + 15, second.x : second.x + 20].sum() == pytest.approx(300)
    for one, other in ((first, second), (first, third), (second, third)):
        assert abs(one.x - other.x) >= 20 or abs(one.y - other.y) >= 15


def test_a_crop_has_what_differs_in_its_middle_unless_it_lies_at_the_border():
    apart = np.zeros((96, 120))
    apart[:, 60:63] = 5.0
    (crop,) = auto_crops(apart, 1)
    assert abs(crop.x + crop.width / 2 - 61.5) <= 1
    apart = np.zeros((96, 120))
    apart[40:50, 117:] = 5.0
    (crop,) = auto_crops(apart, 1)
    assert crop.x == 100


def test_a_second_crop_shows_another_place():
    """One long edge holds both, far from each other; a hardly weaker place is shown before."""
    apart = np.zeros((96, 120))
    apart[:, 20:24] = 5.0
    first, second = auto_crops(apart, 2)
    assert abs(first.y - second.y) > 2 * first.width
    apart[40:56] = 0.0  # parts of the edge that the first crop leaves lie close to it
    apart[:40, 20:24] = 0.0
    apart[:15, 90:94] = 4.0
    first, second = auto_crops(apart, 2)
    assert first.x < 24 < 80 < second.x + second.width


def test_no_more_crops_are_found_than_fit():
    assert len(auto_crops(np.ones((15, 20)), 4)) <= 4
    crops = auto_crops(np.ones((96, 120)), 200)
    taken = np.zeros((96, 120), int)
    for crop in crops:
        taken[crop.y : crop.y + crop.height, crop.x : crop.x + crop.width] += 1
    assert taken.max() == 1


@pytest.mark.parametrize("columns", [1, 2])
def test_it_is_as_wide_as_columns_are_and_its_text_is_text(columns):
    made = teaser(
        ("ours", "theirs", "reference"),
        [row(scene="Garden"), row(scene="Shed")],
        columns=columns,
        labels={"ours": "Ours"},
        scores={"ours": "1.20 JOD\n[0.90, 1.50]"},
        simulated=True,
    )
    assert made.get_size_inches()[0] == pytest.approx(WIDTHS_IN[columns])
    svg = vector_bytes(made, "svg").decode()
    texts = re.findall(r"<text[^>]*>([^<]*)</text>", svg)
    scores = ("1.20 JOD", "[0.90, 1.50]")
    for text in ("Ours", "theirs", *scores, "SIMULATED DATA", "Garden", "Shed", "a", "b"):
        assert text in texts, texts
    assert texts.count("Ours") == 2
    assert texts.count("reference") == 2 * 2  # above its crops, and on the frame
    assert svg.count("<image") == 2 * (1 + 3 * 2)


def test_a_row_alone_has_no_heading_and_several_say_in_what_they_differ():
    assert _titles([row(scene="shot")]) == [""]
    assert _titles([row(scene="Garden"), row(scene="Shed")]) == ["Garden", "Shed"]


@pytest.mark.parametrize("columns", [1, 2])
def test_a_score_is_whole_in_the_narrowest_column(columns):
    names = tuple("abcdefg")
    score = "\u22120.88 JOD\n[\u22121.43, \u22120.33]"
    made = teaser(names, [row(7)], columns=columns, scores=dict.fromkeys(names, score))
    renderer = made.canvas.get_renderer()
    wide = made.axes[1].get_window_extent(renderer).width
    shown = [text for text in made.texts if "JOD" in text.get_text()]
    assert [text.get_text() for text in shown] == [score] * 7
    assert all(text.get_window_extent(renderer).width <= wide + 1 for text in shown)


def test_steps_of_a_warp_are_compared_with_their_true_view(tmp_path):
    made = np.random.default_rng(2)
    pictures = {
        name: made.integers(0, 255, (90, 120, 3), np.uint8)
        for name in ("03-warped", "20-filled-telea", "21-filled-push-pull", "22-true-view")
    }
    for name, picture in pictures.items():
        Image.fromarray(picture).save(tmp_path / f"{name}.png")

    methods, (only,) = figure_rows(of_steps(tmp_path))

    assert methods == ("telea", "push-pull", "reference")
    assert only.whole_is == "reference"
    np.testing.assert_array_equal(only.whole, pictures["22-true-view"])
    np.testing.assert_array_equal(only.frames[1], pictures["21-filled-push-pull"])
    assert teaser(methods, [only], columns=2).get_size_inches()[0] == WIDTHS_IN[2]
    with pytest.raises(InputError, match=r"must hold built clips .*warp --steps"):
        of_steps(tmp_path / "nowhere")
    with pytest.raises(InputError, match="--scene: must be one of none"):
        figure_rows(of_steps(tmp_path), RowSettings(scenes=("garden",)))


@pytest.mark.parametrize("columns", [1, 2])
def test_pictures_keep_their_shape_and_nothing_leaves_the_page(columns):
    made = teaser(("a", "b", "c"), [row()], columns=columns, scores={"a": "x"})
    across, down = made.get_size_inches()
    for axes in made.axes:
        box = axes.get_position()
        assert -1e-6 <= box.x0 <= box.x1 <= 1 + 1e-6
        assert -1e-6 <= box.y0 <= box.y1 <= 1 + 1e-6
        shown = abs(np.subtract(*axes.get_ylim()) / np.subtract(*axes.get_xlim()))
        assert box.height * down / (box.width * across) == pytest.approx(shown, rel=1e-6)


@pytest.mark.parametrize("columns", [1, 2])
def test_long_names_are_no_wider_than_their_column_and_scores_stand_below_all_crops(columns):
    name = "A method with a name that is far too long for its column of crops"
    made = teaser((name, "b", "c"), [row()], columns=columns, scores={name: "0.50 JOD"})
    renderer = made.canvas.get_renderer()
    wide = made.axes[1].get_window_extent(renderer).width
    lowest = min(axes.get_window_extent(renderer).y0 for axes in made.axes[1:])
    shown = [text for text in made.texts if text.get_text()]
    for text in shown:
        box = text.get_window_extent(renderer)
        assert box.width <= wide + 1
        assert box.x0 >= -1
    (score,) = (text for text in shown if "JOD" in text.get_text())
    assert score.get_window_extent(renderer).y1 <= lowest
    assert score.get_window_extent(renderer).y0 >= 0


def test_the_same_rows_give_the_same_bytes_and_pixels_are_not_smoothed():
    made = [teaser(("a", "b", "c"), [row()], columns=2) for _ in range(2)]
    assert vector_bytes(made[0], "pdf") == vector_bytes(made[1], "pdf")
    drawn = np.asarray(Image.open(io.BytesIO(png_bytes(made[0]))).convert("RGB"))
    stored = {tuple(pixel) for pixel in row().frames[1][10:25, 10:30].reshape(-1, 3)}
    box = made[0].axes[3].get_position()  # the second method's first crop
    high, wide = drawn.shape[:2]
    inside = drawn[
        round((1 - box.y1) * high) + 8 : round((1 - box.y0) * high) - 8,
        round(box.x0 * wide) + 8 : round(box.x1 * wide) - 8,
    ].reshape(-1, 3)
    same = np.mean([tuple(pixel) in stored for pixel in inside])
    assert same > 0.99
