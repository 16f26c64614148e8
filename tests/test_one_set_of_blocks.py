"""All pages that are written share one template, one style and one set of blocks."""

import re

import pytest

from protocols.blocks import (
    Box,
    Cautions,
    Code,
    CopyText,
    Figure,
    FigurePlace,
    Heading,
    MediaFile,
    MediaRow,
    Paragraph,
    Section,
    TableBlock,
    html_page,
    strong,
)

OURS = ("analysis", "pipeline", "protocols", "stimuli", "study_app")
PARTICIPANTS = "study_app/web/"
"""Pages that people see who take part, in a browser."""


def test_every_page_is_of_the_one_template_and_draws_no_block_itself(repository):
    found = [path for name in OURS for path in (repository / name).rglob("*.html")]
    names = {path.relative_to(repository).as_posix(): path for path in found}
    templates = {n: p for n, p in names.items() if not n.startswith(PARTICIPANTS)}
    own = {name for name in templates if name.startswith("protocols/")}
    assert own == {"protocols/page/blocks.html", "protocols/page/page.html"}
    assert len(templates) > len(own)
    for name in templates.keys() - own:
        assert not name.endswith(("/page.html", "/blocks.html")), f"{name} would extend itself"
        text = templates[name].read_text(encoding="utf-8")
        assert text.startswith('{% extends "page.html" %}'), name
        assert not re.search(r"<(table|h1|style|html|body|main)\b", text), name
        style = text.partition("{% block css %}")[2].partition("{% endblock %}")[0]
        assert not re.search(r"font:|font-family|button|:focus-visible", style), name
        assert not re.search(r"<link|<script[^>]+src=|@import|url\(http", text), name


def test_no_code_writes_a_table_of_its_own(repository):
    for name in OURS:
        for path in (repository / name).rglob("*.py"):
            assert not re.search(r"<(table|figure|html|h1|h2)[\s>]", path.read_text("utf-8")), path


def test_every_kind_of_block_is_drawn():
    table = TableBlock.of(
        "Rows & co", [("a", "l"), ("b", "n")], [("x<y", "1"), ("sum", "2")], totals=True
    )
    page = html_page(
        "A < B",
        under="below",
        stamp="STAMP",
        lead=[Box("Read", "first", "then"), Cautions("Beware", ("of <this>",)), Cautions("no", ())],
        sections=[
            Section.of("One thing", "plain", ["first", "second"], Heading("within"), table),
            Section.of(
                "Two",
                Paragraph("quiet", muted=True),
                CopyText(("copy me",)),
                Code("$ run"),
                FigurePlace("known"),
                FigurePlace("absent"),
                MediaRow((MediaFile("a.png", "caption", "alt", "a.png"), MediaFile("b.webm"))),
            ),
        ],
        figures={"known": Figure(strong("both"), "<wide>", "<narrow>")},
    )
    for piece in (
        "<title>A &lt; B</title>",
        "<h1>A &lt; B</h1>",
        '<p class="muted">below</p>',
        '<div class="stamp">STAMP</div>',
        '<a href="#one-thing">One thing</a>',
        '<h2 id="one-thing">One thing</h2>',
        "<p>plain</p>",
        "<li>second</li>",
        "<h3>within</h3>",
        "<caption>Rows &amp; co</caption>",
        '<td class="l">x&lt;y</td><td class="n">1</td>',
        '<tr class="totals"><td class="l">sum</td>',
        '<p class="muted">quiet</p>',
        "<p>copy me</p>",
        "<pre>$ run</pre>",
        '<figure id="fig-known">',
        "<strong>both</strong>",
        '<a href="a.png"><img src="a.png" alt="alt"></a>',
        "<video",
        "<li>of &lt;this&gt;</li>",
        '<p class="lead">first</p>',
    ):
        assert piece in page, piece
    assert page.count("<figure") == 3
    assert page.count('class="box') == 2
    assert "<thead>" in page
    assert "<thead>" not in html_page("t", lead=[TableBlock.of("", [("", "l")], [("x",)])])


@pytest.mark.parametrize("policy", ["default-src 'none'; style-src 'unsafe-inline'; img-src data:"])
def test_a_page_may_ask_nobody(policy):
    assert f'content="{policy}"' in html_page("t")
    assert "https:" not in html_page("t")


def test_what_the_style_adds_to_texts_is_a_star():
    """A stylesheet once said "\\2605" as Python reads it: the best values bore "\xb05"."""
    added = re.findall(r'content: "([^"]+)"', html_page("t"))
    assert added
    assert all(text in (r"\2605", " / ") for text in added)


def test_every_table_of_a_page_can_scroll_and_shows_that_it_does(repository):
    blocks = (repository / "protocols/page/blocks.html").read_text(encoding="utf-8")
    assert blocks.count("<table") == blocks.count('<div class="scroll"><table') == 1
    style = (repository / "protocols/page/page.css").read_text(encoding="utf-8")
    (scrolling,) = re.findall(r"^\.scroll \{(.*?)\}", style, flags=re.M | re.S)
    assert scrolling.count("no-repeat local") == scrolling.count("no-repeat scroll") == 2
    assert style.count("--shade:") == 2, "one shade for paper, one for the dark"
