"""The answer screen of m labelled answers: every label stands over its key, whole."""

import numpy as np
import pytest

from protocols.errors import StudyError
from protocols.load import load_protocol, load_study, shipped
from protocols.script import Words
from protocols.study_file.session_schema import Response, key_label
from study_app.pages import words_image
from study_app.shown_texts import require_showable

SIZE = (960, 540)
KEYS = ["left", "up", "down", "right", "kp_5", "f", "j", "k", "pad_a"]


def screen(labels: list[str], size: tuple[int, int] = SIZE) -> np.ndarray:
    """Return the alpha of the answer screen with these labels."""
    names = [f"a{index}" for index in range(len(labels))]
    texts = load_protocol(shipped("studies")["demo"]).text.languages["en"]
    texts = texts.model_copy(update={"answers": dict(zip(names, labels, strict=True))})
    response = Response(keys=tuple((key,) for key in KEYS[: len(labels)]))
    words = Words(
        size_px=size,
        background=128,
        text=texts.question,
        labels=tuple(labels),
        keys=tuple(key_label(keys[0]) for keys in response.keys),
    )
    return words_image(words)[..., 3]


def column(picture: np.ndarray, place: int, count: int) -> np.ndarray:
    """Return an answer's share of the width, below the question."""
    width = picture.shape[1]
    return picture[picture.shape[0] // 2 :, place * width // count : (place + 1) * width // count]


@pytest.mark.parametrize("count", range(2, 10))
def test_each_answer_has_its_label_and_key_in_its_own_share_of_the_width(count):
    labels = [f"answer {index}" for index in range(count)]
    picture = screen(labels)
    for place in range(count):
        part = column(picture, place, count)
        assert part.any(), place
        rows = np.flatnonzero(part.any(axis=1))
        assert len(np.split(rows, np.flatnonzero(np.diff(rows) > 1) + 1)) >= 2  # label, then key
        assert not part[:, 0].any(), "cut at the left"
        assert not part[:, -1].any(), "cut at the right"


@pytest.mark.parametrize("count", [2, 4, 7])
def test_another_label_changes_its_own_place_alone(count):
    labels = ["left"] * count
    plain = screen(labels)
    for place in range(count):
        other = screen([*labels[:place], "tfel", *labels[place + 1 :]])
        changed = [(column(plain, k, count) != column(other, k, count)).any() for k in range(count)]
        assert changed == [k == place for k in range(count)]


def test_long_labels_get_smaller_letters_and_stay_whole():
    word = "anticlockwise"
    small, large = screen([word] * 8), screen([word] * 2)

    def height(picture, count):
        return np.flatnonzero(column(picture, 0, count).any(axis=1)).size

    assert height(small, 8) < height(large, 2)
    for place in range(8):
        part = column(small, place, 8)
        assert not part[:, 0].any()
        assert not part[:, -1].any()


def test_labels_that_fit_at_no_size_are_refused_before_a_window_opens():
    with pytest.raises(StudyError, match="labels of 9 answers must fit beside each other"):
        screen(["quite-a-long-word-that-never-ends"] * 9, (640, 480))

    study, display = load_study(shipped("studies")["demo"])
    texts = study.text.languages["en"]
    long = texts.model_copy(update={"answers": {"first": "x" * 400, "second": "second"}})
    text = study.text.model_copy(update={"languages": {"en": long}})
    require_showable(study, display, language="en")
    with pytest.raises(StudyError, match=r"  text\.languages\.en\.answers: .*take shorter ones"):
        require_showable(study.model_copy(update={"text": text}), display)


@pytest.mark.parametrize(
    ("name", "label"),
    [("left", "←"), ("up", "↑"), ("f", "F"), ("space", "space"), ("kp_4", "num 4"),
     ("pad_a", "pad A"), ("pad_left", "pad ←"), ("pad_lb", "pad lb")],
)  # fmt: skip
def test_keys_are_named_as_people_know_them(name, label):
    assert key_label(name) == label
