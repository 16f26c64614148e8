"""Figures: no text over text, nothing cut off, the same bytes, embedded fonts, colours, stamp."""

import re
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from itertools import combinations

import numpy as np
import pandas as pd
import pytest
from made_up_trials import TaskDesign, simulate_abx, simulate_identification, simulate_yes_no
from matplotlib.backend_bases import RendererBase
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.colors import to_hex, to_rgb
from matplotlib.figure import Figure
from matplotlib.text import Text
from matplotlib.transforms import Bbox

from analysis.models.bootstrap import bootstrap_scale
from analysis.models.compared_methods import counts, pairing_rows
from analysis.models.critical_scaling import critical_scalings
from analysis.models.curves.psychometric_posterior import psychometric_posterior
from analysis.models.curves.response import CurveForm
from analysis.models.detection import discrimination, yes_no
from analysis.models.order_and_side import Bias, order_bias, side_bias
from analysis.models.ordinal import rating_model
from analysis.models.preference import preferences
from analysis.models.reaction import reaction_times
from analysis.models.scaling import scale
from analysis.models.thresholds import fit_thresholds
from analysis.models.trends import course
from analysis.parts.scale import votes_of
from analysis.plots import (
    ONE_COLUMN_IN,
    TWO_COLUMNS_IN,
    bias_bars,
    d_prime_plot,
    detection_plot,
    figure_bytes,
    heat_map,
    jod_plot,
    learning_plot,
    power_plot,
    preference_bars,
    psychometric_plot,
    rates_plot,
    reaction_plot,
    save_figure,
    scaling_plot,
)
from analysis.plots.psychometric_plots import people_plot
from analysis.plots.style import BLUE, ORANGE, PALE_BLUE, PALE_ORANGE, SIMULATED_TEXT
from analysis.plots.tasks import interaction_plot, ratings_plot
from analysis.power import power
from analysis.tasks import analysis_of
from protocols.answer_rules import Alternatives

LABELS = {
    "metameric": "Metameric (ours)",
    "push-pull": "Push-pull, depth-aware",
    "reference": "Reference",
    "small": "small disocclusion",
    "large": "large disocclusion",
}
PAIRINGS = [("metameric", "push-pull"), ("metameric", "reference"), ("push-pull", "reference")]
KINDS = (
    "preference",
    "scale",
    "psychometric",
    "detection",
    "d_prime",
    "identification",
    "scaling",
    "levels",
    "heat",
    "learning",
    "reaction",
    "bias",
    "power",
    "ratings",
    "rates",
    "interaction",
)
Draw = Callable[..., Figure]


def label(name: str) -> str:
    return LABELS.get(name, name)


@pytest.fixture(scope="module")
def draw(make_decisions, demo_protocol) -> dict[str, Draw]:
    """Every kind of figure, ready to draw at a width, from one study of eleven people."""
    rows = make_decisions()
    cells = preferences(rows, pairings=PAIRINGS, sizes=("small", "large")).cells
    shares = {}
    for cell in cells:
        part = pairing_rows(rows, cell.method, cell.against, cell.size)
        chosen, shown, people, _ = counts(part, cell.method)
        shares[cell.method, cell.against, cell.size] = (chosen.sum(1) / shown.sum(1)).tolist()
    names = ("metameric", "push-pull", "reference")
    scales = {}
    for size in ("small", "large"):
        votes = votes_of(rows[rows["size"] == size], names)[0]
        limits = bootstrap_scale(votes, rng=np.random.default_rng(0), samples=200)
        scales[size] = (scale(votes.sum(axis=(0, 1)), names), limits)
    x, trials = np.array([5.0, 10, 15, 20, 25]), np.full(5, 140)
    rng = np.random.default_rng(1)
    curves = {}
    for name, place in (("Reference", 22), ("Blur 0.35", 20), ("Blur 0.70", 17), ("Ours", 21)):
        good = rng.binomial(trials, 0.5 + 0.5 / (1 + np.exp((x - place) / 3)))
        fit = psychometric_posterior(x, good, trials, CurveForm(shape="logistic", falling=True))
        curves[name] = (x, good, trials, fit)
    sizes = TaskDesign(8, 4, 3)
    said = simulate_yes_no(sizes, {"blur": 0.6, "ours": 0.3, "F&S": 1.5}, rng)
    found = yes_no(said, ("method",), signal="inconsistent", bias_answer="consistent")
    named = simulate_identification(
        sizes, {"blur": 0.0, "ours": 0.5}, rng, levels=[-1.0, 0.0, 1.0], width=2.0, alternatives=4
    )
    told = discrimination(named, Alternatives(4), ("method",))
    matched = simulate_abx(
        TaskDesign(5, 1, 12), {"v1": 0.2, "luminance": 0.1}, rng, scalings=[0.06, 0.12, 0.25, 0.5]
    )
    fits = critical_scalings(matched, ("method",)).fits
    seen = {
        str(name): (
            np.array(sorted(part["scaling"].unique())),
            part.groupby("scaling")["correct"].sum().to_numpy(float),
            part.groupby("scaling")["correct"].size().to_numpy(float),
        )
        for name, part in matched.groupby("method")
    }
    model = fit_thresholds(named, "level", ("method",), CurveForm(guess=0.25))
    levels = {
        str(name): (
            np.array(sorted(part["level"].unique())) + 2.0,
            part.groupby("level")["correct"].sum().to_numpy(float),
            part.groupby("level")["correct"].size().to_numpy(float),
            partial(lambda name, x: model.population.average(name, x - 2.0), str(name)),
        )
        for name, part in named.groupby("method")
    }
    times = reaction_times(rows, ("size",))
    medians = {
        one.condition: rows[rows["size"] == one.condition]
        .groupby("participant")["rt_s"]
        .median()
        .tolist()
        for one in times
    }
    table = np.array(list(shares.values())).T
    columns = [f"{label(c.method)} / {label(c.against)}\n{label(c.size)}" for c in cells]
    chosen = rows.assign(y=(rows["chosen"] == "metameric").astype(float))
    side = side_bias(rows)
    assert side is not None
    simulation = analysis_of("preference").simulation(demo_protocol)
    curve = power(simulation, {"rate": 0.65}, rng=np.random.default_rng(2), studies=200)
    right = [(one.condition, one.correct) for one in found.conditions]
    sides = [
        (label(of), at, one.share, one.lower, one.upper)
        for of in ("metameric", "push-pull")
        for at, one in right
    ]
    rated = rating_model(
        pd.DataFrame(
            [
                {"participant": who, "method": of, "rating": str(rng.integers(1, 5) + (of == "b"))}
                for who in "abcdef"
                for of in "ab"
                for _ in range(6)
            ]
        ),
        ("method",),
        categories=list("12345"),
    )
    return {
        "rates": lambda **k: rates_plot([one for _, one in right], **k),
        "ratings": lambda **k: ratings_plot(rated, **k),
        "interaction": lambda **k: interaction_plot(
            sides, title="Field of view", chance=0.5, **{"level": 0.95} | k
        ),
        "preference": lambda **k: preference_bars(cells, shares, label=label, **k),
        "scale": lambda **k: jod_plot(scales, label=label, **k),
        "psychometric": lambda **k: psychometric_plot(curves, x_label="Eccentricity, deg", **k),
        "detection": lambda **k: detection_plot(found, **k),
        "d_prime": lambda **k: d_prime_plot(found, **k),
        "identification": lambda **k: d_prime_plot(told, **k),
        "scaling": lambda **k: scaling_plot(fits, seen, **k),
        "levels": lambda **k: psychometric_plot(
            levels, x_label="Size, deg", chance=0.25, logarithmic=True, **k
        ),
        "heat": lambda **k: heat_map(table, list(people), columns, row_title="Participant", **k),
        "learning": lambda **k: learning_plot(
            course(chosen, "y"), y_label="Share", bounds=(0, 1), **k
        ),
        "reaction": lambda **k: reaction_plot(times, medians, label=label, **k),
        "bias": lambda **k: bias_bars([order_bias(rows), side], **k),
        "power": lambda **k: power_plot(
            curve.participants, curve.curves, planned=curve.planned, **k
        ),
    }


def visible_texts(figure: Figure) -> list[tuple[str, Bbox]]:
    """Return every text that is really drawn, with the box it fills in pixels."""
    found: dict[int, tuple[str, Bbox]] = {}
    original = Text.draw

    def spy(text: Text, renderer: RendererBase, *args: object, **kwargs: object) -> None:
        if text.get_visible() and text.get_text().strip():
            found[id(text)] = (text.get_text(), text.get_window_extent(renderer))
        original(text, renderer, *args, **kwargs)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Text, "draw", spy)
        FigureCanvasAgg(figure).draw()
    return list(found.values())


def overlaps(figure: Figure) -> list[tuple[str, str]]:
    """Return the pairs of texts whose boxes share more than a hair's breadth."""
    hair = 1.0  # pixel at 150 dpi
    texts = visible_texts(figure)
    return [
        (a, b)
        for (a, box), (b, other) in combinations(texts, 2)
        if min(box.x1, other.x1) - max(box.x0, other.x0) > hair
        and min(box.y1, other.y1) - max(box.y0, other.y0) > hair
    ]


def test_the_overlap_measure_sees_text_over_text():
    figure = Figure(figsize=(3, 2), dpi=150)
    axes = figure.subplots()
    axes.text(0.5, 0.5, "one")
    axes.text(0.52, 0.5, "other")

    assert ("one", "other") in overlaps(figure)


@pytest.mark.parametrize("width_in", [ONE_COLUMN_IN, TWO_COLUMNS_IN])
@pytest.mark.parametrize("simulated", [pytest.param(False, marks=pytest.mark.slow), True])
@pytest.mark.parametrize("kind", KINDS)
def test_no_text_overlaps_and_none_is_cut_off(draw, kind, simulated, width_in):
    figure = draw[kind](width_in=width_in, simulated=simulated)
    texts = visible_texts(figure)
    width, height = figure.canvas.get_width_height()

    assert len(texts) > 3
    assert not any("$" in text for text, _ in texts)  # a formula, printed as it is written
    assert overlaps(figure) == []
    for text, box in texts:
        assert box.x0 >= -1, text
        assert box.y0 >= -1, text
        assert box.x1 <= width + 1, text
        assert box.y1 <= height + 1, text


@pytest.mark.parametrize("kind", KINDS)
def test_figures_have_the_width_asked_for_and_legible_letters(draw, kind):
    for width_in in (ONE_COLUMN_IN, TWO_COLUMNS_IN):
        figure = draw[kind](width_in=width_in)
        smallest = min(
            text.get_fontsize() for text in figure.findobj(Text) if text.get_text().strip()
        )

        assert figure.get_figwidth() == width_in
        assert smallest >= 5.4


@pytest.mark.parametrize("kind", KINDS)
def test_simulated_figures_say_so_and_others_do_not(draw, kind):
    def stamped(figure: Figure) -> bool:
        return any(text.get_text() == SIMULATED_TEXT for text in figure.findobj(Text))

    assert stamped(draw[kind](width_in=ONE_COLUMN_IN, simulated=True))
    assert not stamped(draw[kind](width_in=ONE_COLUMN_IN))


@pytest.mark.parametrize("kind", ["svg", "pdf", "png"])
def test_the_same_figure_has_the_same_bytes(draw, kind):
    first, second = (
        figure_bytes(draw["preference"](width_in=ONE_COLUMN_IN), kind) for _ in range(2)
    )

    assert first == second
    assert len(first) > 2000


def test_the_order_in_which_kinds_are_written_changes_nothing(draw):
    figure = draw["heat"](width_in=ONE_COLUMN_IN)
    alone = figure_bytes(draw["heat"](width_in=ONE_COLUMN_IN), "svg")

    figure_bytes(figure, "png")
    assert figure_bytes(figure, "svg") == alone


@pytest.mark.parametrize("people", [41, 300])
@pytest.mark.parametrize("width_in", [ONE_COLUMN_IN, TWO_COLUMNS_IN])
def test_a_heat_map_of_many_people_fits_a_page(people, width_in):
    names = [f"P{number:03d}" for number in range(people)]
    shares = np.linspace(0, 1, 8 * people).reshape(people, 8)
    figure = heat_map(shares, names, list("abcdefgh"), row_title="Participant", width_in=width_in)
    shown = [text for text, _ in visible_texts(figure)]

    assert figure.get_figheight() < 11
    assert {"P000", "Participant", "h"} < set(shown)
    assert not any(re.fullmatch(r"\.\d\d", text) for text in shown)
    assert {"Share", "0", "1"} < set(shown)  # what colours mean
    assert overlaps(figure) == []


def test_colours_without_numbers_are_told_apart_in_grey():
    names = [f"P{number:03d}" for number in range(60)]
    shares = np.tile(np.linspace(0, 1, 5), (60, 1))
    figure = heat_map(shares, names, list("abcde"), row_title="Participant")
    (mesh,) = (one for one in figure.axes[0].collections if one.get_array() is not None)
    figure.canvas.draw()
    grey = [luminance(mesh.cmap(mesh.norm(value))) for value in shares[0]]

    assert np.all(np.diff(grey) > 0.05)


@pytest.mark.parametrize("kind", ["psychometric", "levels", "scaling"])
def test_no_line_joins_the_points_under_a_fitted_curve(draw, kind):
    axes = draw[kind](width_in=TWO_COLUMNS_IN).axes[0]
    points = [bars.lines[0] for bars in axes.containers]
    curves = [line for line in axes.lines if len(line.get_xdata()) >= 200]

    assert len(points) == len(curves) > 1
    assert {line.get_linestyle() for line in points} == {"None"}
    assert len({str(line._dash_pattern) for line in curves}) == len(curves)


def test_points_without_a_curve_are_joined():
    x, right, trials = np.array([1.0, 2, 3]), np.array([5.0, 7, 9]), np.full(3, 10.0)
    axes = psychometric_plot({"one": (x, right, trials, None)}, x_label="x", chance=0.5).axes[0]

    assert axes.containers[0].lines[0].get_linestyle() == "-"


MEANINGS = {
    "preference": "95 % limits; dots: participants",
    "scale": "95 % limits, by bootstrap",
    "psychometric": "± 1 binomial standard error",
    "detection": "95 % limits",
    "d_prime": "95 % limits",
    "identification": "95 % limits",
    "scaling": "± 1 standard error",
    "levels": "± 1 binomial standard error",
    "learning": "95 % limits; grey lines: participants' own trends",
    "reaction": "95 % limits of the mean; grey dots: participants' medians",
    "bias": "95 % limits; grey dots: participants",
    "rates": "95 % limits; dashed: chance",
    "ratings": "95 % limits",
    "interaction": "95 % limits; dashed: chance",
}


@pytest.mark.parametrize("width_in", [ONE_COLUMN_IN, TWO_COLUMNS_IN])
@pytest.mark.parametrize("kind", MEANINGS)
def test_what_bars_mean_stands_on_the_figure(draw, kind, width_in):
    texts = [text.replace("\n", " ") for text, _ in visible_texts(draw[kind](width_in=width_in))]

    assert any(MEANINGS[kind] in text for text in texts)


@pytest.mark.parametrize("kind", ["learning", "reaction", "bias", "interaction"])
def test_other_limits_are_named_on_the_figure(draw, kind):
    texts = " ".join(text for text, _ in visible_texts(draw[kind](width_in=7.0, level=0.9)))

    assert "90 % limits" in texts
    assert "95" not in texts


def test_the_band_of_the_course_has_the_level_asked_for(draw):
    heights = [
        np.ptp(draw["learning"](level=level).axes[0].collections[0].get_paths()[0].vertices[:, 1])
        for level in (0.5, 0.95)
    ]

    assert heights[0] < 0.7 * heights[1]


def test_people_are_straight_lines_below_their_mean(draw, make_decisions):
    rows = make_decisions()
    lines = draw["learning"](width_in=TWO_COLUMNS_IN).axes[0].lines
    mean = max(lines, key=lambda line: line.get_linewidth())
    people = [line for line in lines if line is not mean]

    assert len(people) == rows["participant"].nunique()
    assert all(len(line.get_xdata()) == 2 for line in people)
    assert all(line.get_zorder() < mean.get_zorder() for line in people)
    assert all(luminance(line.get_color()) > 0.4 for line in people)


@pytest.mark.parametrize("width_in", [ONE_COLUMN_IN, TWO_COLUMNS_IN])
def test_dots_at_nothing_and_all_are_clear_of_the_names_beside_them(make_decisions, width_in):
    (cell,) = preferences(make_decisions(), pairings=PAIRINGS[:1], sizes=("all",)).cells
    dots = {(cell.method, cell.against, cell.size): [0.0, 0.0, 1.0, 1.0]}
    chosen = preference_bars([cell], dots, label=label, width_in=width_in)
    everyone = Bias("left key", 9, 0.5, 0.1, 0.9, 1.0, 1.0, (("a", 0.0), ("b", 1.0)), (), ())
    for figure in (chosen, bias_bars([everyone], width_in=width_in)):
        texts = visible_texts(figure)
        renderer = figure.canvas.get_renderer()
        (drawn,) = figure.axes[0].collections[:1]
        reach_px = np.sqrt(drawn.get_sizes()[0]) / 2 * figure.dpi / 72 + 1
        for x, y in figure.axes[0].transData.transform(drawn.get_offsets()):
            around = Bbox([[x - reach_px, y - reach_px], [x + reach_px, y + reach_px]])
            assert renderer is not None
            assert not [text for text, box in texts if around.overlaps(box)]
            assert figure.axes[0].bbox.x0 <= x - reach_px
            assert x + reach_px <= figure.axes[0].bbox.x1


def test_files_carry_their_fonts(draw, tmp_path):
    svg, pdf, png = save_figure(draw["bias"](width_in=ONE_COLUMN_IN), tmp_path, "bias")

    assert b"<text" not in svg.read_bytes()  # glyphs are outlines
    assert b"/FontFile2" in pdf.read_bytes()  # TrueType inside
    assert png.read_bytes()[:4] == b"\x89PNG"
    with pytest.raises(ValueError, match="kind must be one of"):
        figure_bytes(draw["bias"](width_in=ONE_COLUMN_IN), "bmp")


@pytest.mark.parametrize("width_in", [ONE_COLUMN_IN, TWO_COLUMNS_IN])
def test_names_of_three_lines_keep_apart(make_decisions, width_in):
    names = {
        "large": "noise, against the standard picture",
        "small": "warped, against another picture",
    }
    times = reaction_times(make_decisions(people=4), ("size",))
    figure = reaction_plot(
        times, {one.condition: (0.8, 1.2) for one in times}, label=names.get, width_in=width_in
    )
    boxes = [
        box for text, box in visible_texts(figure) if text.replace("\n", " ") in names.values()
    ]

    assert len(boxes) == 2
    assert boxes[0].y0 - boxes[1].y1 > 0.25 * 6.5 / 72 * figure.dpi


def luminance(colour: str) -> float:
    linear = [c / 12.92 if c <= 0.03928 else ((c + 0.055) / 1.055) ** 2.4 for c in to_rgb(colour)]
    return float(np.dot(linear, [0.2126, 0.7152, 0.0722]))


@pytest.mark.parametrize("colour", [BLUE, ORANGE])
def test_colours_stand_out_from_paper(colour):
    """WCAG 2.1, 1.4.11: at least 3:1 against white."""
    assert (1.0 + 0.05) / (luminance(colour) + 0.05) >= 3.0


def test_bars_show_share_limits_and_people_in_numbers(draw, make_decisions):
    cells = preferences(make_decisions(), pairings=PAIRINGS, sizes=("small", "large")).cells
    texts = [text for text, _ in visible_texts(draw["preference"](width_in=TWO_COLUMNS_IN))]

    for cell in cells:
        share, lower, upper = (
            f"{value:.2f}".lstrip("0")
            for value in (cell.estimate.share, cell.estimate.lower, cell.estimate.upper)
        )
        assert share in texts
        assert f"[{lower}, {upper}]" in texts


def test_long_names_of_twelve_methods_still_fit():
    rng = np.random.default_rng(0)
    names = [f"A method with a long name {i}" for i in range(5)]
    rows = [
        {
            "participant": p,
            "scene": s,
            "size": "all",
            "first": a,
            "second": b,
            "chosen": a if rng.random() < 0.6 else b,
        }
        for p in range(5)
        for s in range(5)
        for a, b in combinations(names, 2)
    ]
    cells = preferences(pd.DataFrame(rows)).cells

    for width_in in (ONE_COLUMN_IN, TWO_COLUMNS_IN):
        assert overlaps(preference_bars(cells, {}, width_in=width_in)) == []


def test_a_tie_is_dark_on_neither_side(make_decisions):
    cell = preferences(make_decisions(people=4)).cells[0]
    tie = replace(cell, chosen=4, trials=8, estimate=replace(cell.estimate, share=0.5))
    bars = preference_bars([tie], {}).axes[0].patches
    assert [to_hex(bar.get_facecolor()).upper() for bar in bars] == [PALE_BLUE, PALE_ORANGE]


def test_panels_of_people_have_three_ticks_from_chance():
    x = np.array([4.0, 8.0, 12.0, 16.0])
    one = {"ours": (x, np.array([3.0, 5.0, 8.0, 9.0]), np.full(4, 10.0), None)}
    (axes, *_) = people_plot({"P1": one}, x_label="level", chance=0.25, logarithmic=True).axes
    assert axes.get_yticks().tolist() == [0.25, 0.625, 1.0]
    assert axes.get_xticks().tolist() == [4.0, 12.0, 16.0]
