"""A study without sizes speaks of none: no empty column, no comma or colon beside nothing."""

import re
from itertools import combinations, product
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from analysis.parts import computed, estimates_of
from analysis.plans.preference_plan import preference_plan
from analysis.plans.table_sections import PreferenceTableSection
from analysis.plots.preference_plots import jod_plot
from analysis.report.values import as_json
from analysis.tasks import analysis_of
from analysis.tasks.preference import PreferenceOfPairs
from protocols.blocks import TableBlock
from protocols.load import load_protocol

PLAN = preference_plan(load_protocol(Path("beyond-blur-preference")))
BESIDE_NOTHING = re.compile(
    r"[,/(:]\s*$|^\s*[,:/]|[,:]\s*[,:;]|\bat\s*(?:[:,;]|\.(?!\d)|$)|\(\s*\)"
)


def table_of(folder: Path, people: int, scenes: int) -> pd.DataFrame:
    rng, rows = np.random.default_rng(5), ["participant,scene,first,second,chosen,rt_s"]
    for person, scene in product(range(people), range(scenes)):
        for first, second in combinations(PLAN.methods, 2):
            better = rng.random() < 0.3 + 0.15 * PLAN.methods.index(second)
            row = f"P{person}", f"s{scene}", first, second, second if better else first
            rows.append(",".join((*row, f"{0.8 + rng.random():.3f}")))
    (folder / "choices.csv").write_text("\n".join(rows) + "\n")
    read = analysis_of("preference").read(folder / "choices.csv", PreferenceTableSection())
    return read.assign(size="")  # as in tables of sessions


def words(value: object):
    """Yield every text of blocks, sentences and numbers."""
    if isinstance(value, str):
        yield value
    elif isinstance(value, dict):
        for key, one in value.items():
            yield from words(key)
            yield from words(one)
    elif isinstance(value, list | tuple):
        for one in value:
            yield from words(one)
    elif hasattr(value, "__dict__"):
        yield from words(vars(value))


def tables(value: object):
    if isinstance(value, TableBlock):
        yield value
    elif isinstance(value, list | tuple):
        for one in value:
            yield from tables(one)
    elif hasattr(value, "__dict__"):
        yield from tables(list(vars(value).values()))


@pytest.mark.parametrize(
    ("people", "scenes"),
    [pytest.param(3, 2, marks=pytest.mark.slow), (1, 1)],
    ids=["whole", "hopeless"],
)
def test_no_word_of_a_report_stands_beside_a_size_that_is_not_there(tmp_path, people, scenes):
    table = table_of(tmp_path, people, scenes)
    found, notes = computed(PreferenceOfPairs.parts, table, PLAN)
    parts = {part.name: part for part in PreferenceOfPairs.parts}
    shown = [parts[name].show(one, PLAN) for name, one in found.items()]
    said = [
        *notes, *words([one.lead for one in shown]), *words([one.sentences for one in shown]),
        *words([(one.blocks, one.further) for one in shown]), *words(as_json(found)),
        *(one.what for one in estimates_of(PreferenceOfPairs.parts, table, PLAN, planned=True)),
    ]  # fmt: skip

    assert len(said) > 40
    assert [text for text in said if BESIDE_NOTHING.search(text)] == []
    for one in tables([(one.blocks, one.further) for one in shown]):
        assert "Size" not in [column.title for column in one.columns]
    for one in found["scale"].sizes if "scale" in found else ():
        for name in ("", "all"):  # as in tables of sessions, and of others
            figure = jod_plot({name: (one.scale, one.intervals)})
            assert [axes.get_title(loc="left") for axes in figure.axes] == [""]
