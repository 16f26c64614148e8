"""Every page that is written has the one style, and nothing comes from elsewhere."""

from __future__ import annotations

import re

import pytest

TEMPLATES = (
    "analysis/report/template.html",
    "stimuli/contact.html",
    "stimuli/look_page.html",
    "stimuli/score/scores.html",
    "study_app/preview.html",
    "study_app/cli/demo/page.html",
)


def test_every_template_is_one_of_these(repository):
    found = {
        path.relative_to(repository).as_posix()
        for package in ("analysis", "pipeline", "protocols", "stimuli", "study_app")
        for path in (repository / package).rglob("*.html")
        if "web" not in path.parts
    }
    assert found == set(TEMPLATES)


def test_every_table_of_a_page_can_scroll_and_shows_that_it_does(repository):
    for name in TEMPLATES:
        text = (repository / name).read_text(encoding="utf-8")
        assert text.count("<table") == text.count('<div class="scroll"><table'), name
    style = (repository / "protocols/page.css").read_text(encoding="utf-8")
    (scrolling,) = re.findall(r"^\.scroll \{(.*?)\}", style, flags=re.M | re.S)
    assert scrolling.count("no-repeat local") == scrolling.count("no-repeat scroll") == 2
    assert style.count("--shade:") == 2, "one shade for paper, one for the dark"


@pytest.mark.parametrize("name", TEMPLATES)
def test_a_template_takes_the_common_style_and_loads_nothing(repository, name):
    text = (repository / name).read_text(encoding="utf-8")
    assert text.count("{{ style }}") == 1
    style = text.split("<style>")[1].split("</style>")[0]
    assert not re.search(r"font:|font-family|button|:focus-visible", style)  # said once, for all
    assert not re.search(r"<link|<script[^>]+src=|@import|url\(http", text)
