"""Of a participant's link only what the study names is kept; at the end stand code and address."""

import pytest
from web_browser import begin, said, served, until, whole
from web_study import brought_home

from protocols.journal_file import read_journal

PAGE = "index.html?slot=5&PANEL=p%3Cb%3E7&OTHER=sesame"
BACK = "https://panel.test/done?cc=1"


@pytest.mark.slow
@pytest.mark.parametrize("jatos", [True, False])
def test_an_identifier_that_the_study_names_is_kept_and_nothing_else(
    chromium, pairs, jatos, tmp_path
):
    named = pairs("a", identifier="PANEL", completion_url=BACK, completion_code="C<0>DE")
    with served(named.out, jatos=jatos) as site:
        begin(chromium, site, page=PAGE)
        until(chromium, "document.querySelector('main')?.dataset.page === 'over'")
        lines = site.lines if jatos else stored(chromium)
        text = chromium.text()
        (back,) = chromium.evaluate(
            "[...document.querySelectorAll('main a')].map((a) => a.href)"
            ".filter((href) => href.startsWith('https'))"
        )
    assert "C<0>DE" in text
    assert back == BACK
    assert not any("sesame" in line for line in lines)
    (start,) = said(lines, "start")
    assert (start["identifier"], start["slot"], start["slot_from"]) == ("p<b>7", 5, "link")
    (imported,) = brought_home(named, lines, tmp_path)
    journal = read_journal(tmp_path / "short" / imported.participant / "journal.jsonl")
    assert journal.start.remote.identifier == "p<b>7"


@pytest.mark.slow
def test_an_identifier_that_the_study_does_not_name_is_kept_nowhere(chromium, pairs):
    plain = pairs("a")
    with served(plain.out) as site:
        whole(chromium, site, page=PAGE)
        assert "C<0>DE" not in chromium.text()
    assert not any("p<b>7" in line or "sesame" in line for line in site.lines)
    assert said(site.lines, "start")[0]["identifier"] is None


def stored(browser) -> list[str]:
    """Return the lines that the browser itself keeps."""
    name = "Object.keys(localStorage).find((one) => one.endsWith(':lines'))"
    return browser.evaluate(f"localStorage.getItem({name})").splitlines(keepends=True)
