"""Sentences tell the sign of a difference in words, and beside it as a number."""

from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest
from fixed_studies import PLAN

from analysis.models.ordinal import rating_model
from analysis.parts.ratings import apa_rating
from analysis.report.wording import by_how_much


@pytest.fixture(scope="module")
def model():
    rng = np.random.default_rng(0)
    rows = pd.DataFrame(
        [(who, method) for who in range(6) for method in "ab" for _ in range(8)],
        columns=["participant", "method"],
    )
    latent = rows["method"].map({"a": 0.0, "b": 1.0}) + rng.standard_normal(len(rows))
    return rating_model(rows.assign(rating=np.digitize(latent, (-0.5, 0.5, 1.5))), ("method",))


@pytest.mark.parametrize(
    ("value", "said"), [(-0.19, "0.19 SD below"), (0.19, "0.19 SD above"), (0.0, "0.00 SD above")]
)
def test_a_difference_has_the_word_of_its_sign(value, said):
    limits = SimpleNamespace(lower=value - 0.3, upper=value + 0.3)

    assert by_how_much(limits, value, "SD", ("above", "below")) == said


def test_a_worse_rating_is_below_and_its_limits_keep_their_sign(model):
    (one,) = model.contrasts
    said = apa_rating(one, model, PLAN)

    assert one.upper < 0.0
    assert said.startswith(f"a was rated {-one.difference:.2f} SD below b (difference -")
    assert f"95% CI [{one.lower:.2f}, {one.upper:.2f}])" in said
