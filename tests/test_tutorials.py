"""Every command of the tutorials runs, in its order, and what they tell is so."""

import random
import re
from pathlib import Path
from statistics import NormalDist

import pictures
import pytest
from forked import programs

pytestmark = pytest.mark.slow

REPOSITORY = Path(__file__).resolve().parents[1]
TUTORIALS = sorted((REPOSITORY / "docs/tutorials").glob("*.md"))
LONGEST_WORDS = 500


@pytest.fixture(scope="module")
def walked(tmp_path_factory):
    """Return what a tutorial printed, and the folder that it was followed in; each runs once."""
    done = {}

    def walk(name: str) -> tuple[str, Path]:
        if name not in done:
            folder = tmp_path_factory.mktemp(name)
            ran = pictures.run(REPOSITORY / f"docs/tutorials/{name}.md", folder, programs())
            assert ran.returncode == 0, f"{ran.stdout}{ran.stderr}"
            assert "Traceback" not in ran.stderr
            done[name] = (ran.stdout, folder)
        return done[name]

    return walk


def test_there_are_three_tutorials_and_each_is_short():
    assert len(TUTORIALS) == 3
    words = {page.name: len(page.read_text(encoding="utf-8").split()) for page in TUTORIALS}
    assert {name: count for name, count in words.items() if count > LONGEST_WORDS} == {}


@pytest.mark.usefixtures("shared_gl_context")
@pytest.mark.parametrize("name", [page.stem for page in TUTORIALS])
def test_every_command_of_a_tutorial_runs_and_writes_what_the_page_names(walked, name):
    _, folder = walked(name)

    page = REPOSITORY / f"docs/tutorials/{name}.md"
    for picture in pictures.pictures_of(page):
        assert pictures.written(picture, folder).is_file()
    text = page.read_text(encoding="utf-8")
    named = set(re.findall(r"`(out/[\w./-]+\.\w+)`", text))
    assert [path for path in sorted(named) if not (folder / path).is_file()] == []


@pytest.mark.usefixtures("shared_gl_context")
def test_a_fill_made_elsewhere_is_measured_beside_ours(walked):
    said, _ = walked("compare-fills")

    ratios = {
        name: float(ratio)
        for name, ratio in re.findall(r"^ (\S+) +[\d.]+ +[\d.]+ +([\d.]+) ", said, re.MULTILINE)
    }
    assert {"metameric", "push-pull", "coherence-transport", "frames:out/mine"} <= set(ratios)
    assert ratios["push-pull"] < ratios["metameric"]  # as the page says


def test_the_csv_tutorial_quotes_what_the_command_prints(walked):
    said, _ = walked("psychometric-csv")

    text = (REPOSITORY / "docs/tutorials/psychometric-csv.md").read_text(encoding="utf-8")
    (quoted,) = re.findall(r"^> (blur minus reference: .*)$", text, flags=re.MULTILINE)
    assert quoted in " ".join(said.split())


def test_the_csv_holds_the_made_up_people_that_the_page_tells_of():
    draw, normal = random.Random(29), NormalDist()
    lines = ["subject,method,ecc_deg,hit"]
    for person in range(1, 9):
        shift_deg = draw.gauss(0, 1.5)
        for method, threshold_deg in (("reference", 18.0), ("blur", 14.0)):
            for level_deg in (5, 10, 15, 20, 25):
                for _ in range(10):
                    missed = normal.cdf((level_deg - threshold_deg - shift_deg) / 4.0)
                    right = draw.random() < 0.25 + 0.73 * (1 - missed)
                    lines.append(f"S{person},{method},{level_deg},{int(right)}")

    text = (REPOSITORY / "docs/tutorials/acuity.csv").read_text(encoding="utf-8")
    assert text.splitlines() == lines
