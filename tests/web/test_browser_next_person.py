"""One browser, one person after the other: nobody meets another's session, and nothing is lost."""

import json
import time
from contextlib import suppress

import pytest
from chromium import BrowserError
from web_browser import begin, served, started, until
from web_study import brought_home

from protocols.feasibility import session_duration_s
from protocols.plan import planned_trials

OVER = "document.querySelector('main')?.dataset.page === 'over'"
STORED = "Object.fromEntries(Object.entries(localStorage))"
STOPS = """
const asked = observer.answer;
let answers = 2;
observer.answer = (phase) => {
  const told = asked(phase);
  if (told && --answers < 0) window.stopped = true;
  return answers < 0 ? null : told;
};
"""
"""An observer who gives two answers and no third."""
STOPPED = "window.stopped"
LINK = "document.querySelector('main a[download]')"
SAVED = f"fetch({LINK}.href).then((file) => file.text())"
OTHER = "document.querySelector('main button.other')"
FACTS = "document.querySelector('main dl')"
WITHDRAW = "document.querySelector('main button.withdraw')"
WAITS = 'observer.leave = ["gate"];'
"""An observer who does not press start: there is no such button."""


def lines_of(text: str) -> list[str]:
    return text.splitlines(keepends=True)


@pytest.fixture(scope="module")
def of(pairs):
    """Return a built study of three trials."""
    return pairs("abc")


def someone_else(browser, then: str = FACTS) -> None:
    """Press the button, and wait for something on the page that is loaded anew."""
    browser.evaluate(f"setTimeout(() => {OTHER}.click())")
    end = time.monotonic() + 60
    while time.monotonic() < end:
        with suppress(BrowserError, AssertionError):  # between two pages
            if browser.evaluate(f"Boolean({then})"):
                return
        time.sleep(0.02)
    raise AssertionError(browser.text())


def people(lines: list[str]) -> set[str]:
    return {json.loads(line)["participant"] for line in lines}


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["chromium", "firefox"])
def test_a_browser_forgets_what_was_saved_and_the_next_person_begins_anew(
    request, kind, of, tmp_path
):
    browser = request.getfixturevalue(kind)
    with served(of.out, jatos=False) as site:
        begin(browser, site)
        until(browser, OVER)
        browser.evaluate(f"{LINK}.click()")
        until(browser, "document.body.innerText.includes('Saved as short.txt.')")
        until(browser, f"Object.keys({STORED}).length === 1")
        (flag,) = browser.evaluate(STORED).items()
        assert not browser.evaluate(f"Boolean({WITHDRAW})")
        first = lines_of(browser.evaluate(SAVED))
        (who,) = people(first)
        assert flag[0].endswith(":used")
        assert who not in str(flag)

        begin(browser, site, WAITS, anew=False)
        until(browser, OTHER)
        assert "came to its end with this link" in browser.text()
        assert not browser.evaluate("document.querySelector('main button.start')")
        someone_else(browser)
        assert browser.evaluate(STORED) == {}
        begin(browser, site, anew=False)
        until(browser, OVER)
        second = lines_of(browser.evaluate(SAVED))
    assert len(people(second) | {who}) == 2
    told = brought_home(of, first + second, tmp_path)
    assert [(one.state, one.reason) for one in told] == [("imported", "completed")] * 2


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["chromium", "firefox"])
def test_what_somebody_left_unsaved_is_kept_apart_and_offered_as_a_file(
    request, kind, of, tmp_path
):
    browser = request.getfixturevalue(kind)
    with served(of.out, jatos=False) as site:
        begin(browser, site, STOPS)
        until(browser, STOPPED)
        browser.close()
        begin(browser, site, WAITS, anew=False)
        until(browser, OTHER)
        before = "".join(text for name, text in browser.evaluate(STORED).items() if "lines" in name)
        someone_else(browser)
        left = lines_of(browser.evaluate(SAVED))
        assert [*dict.fromkeys(left)][: len(lines_of(before))] == lines_of(before)
        browser.close()

        begin(browser, site, anew=False)
        until(browser, OVER)
        own = lines_of(browser.evaluate(SAVED))
        assert not people(own) & people(left)
        begin(browser, site, WAITS, anew=False)
        until(browser, LINK)
        assert lines_of(browser.evaluate(SAVED)) == left
        browser.evaluate(f"{LINK}.click()")
        assert not any(
            people(left) & {*text.split('"')} for text in browser.evaluate(STORED).values()
        )
        assert lines_of(browser.evaluate(SAVED)) == left, "once more, while the page is open"
    told = {one.participant: one for one in brought_home(of, left + own, tmp_path)}
    assert {who: one.reason for who, one in told.items()} == {
        people(left).pop(): "", people(own).pop(): "completed",
    }  # fmt: skip


@pytest.mark.slow
def test_who_withdraws_at_the_gate_or_after_a_session_deletes_their_own_only(chromium, of):
    with served(of.out, jatos=False) as site:
        begin(chromium, site, STOPS)
        until(chromium, STOPPED)
        begin(chromium, site, WAITS, anew=False)
        until(chromium, OTHER)
        someone_else(chromium)
        left = chromium.evaluate(STORED)
        for opened in ("", WAITS):  # the second one withdraws at the gate, the first at the end
            begin(chromium, site, *([STOPS] if opened else []), anew=False)
            until(chromium, STOPPED if opened else OVER)
            if opened:
                begin(chromium, site, opened, anew=False)
            until(chromium, WITHDRAW)
            there = chromium.evaluate(STORED)
            chromium.evaluate(f"{WITHDRAW}.click()")
            assert chromium.evaluate(STORED) == there, "it was not asked once more"
            chromium.evaluate(f"{WITHDRAW}.click()")
            until(chromium, "document.body.innerText.startsWith('All your answers were deleted.')")
            assert chromium.evaluate(STORED) == left


@pytest.mark.slow
def test_at_the_gate_of_jatos_one_withdraws_or_hands_over_without_touching_the_other(
    chromium, of, tmp_path
):
    for press, ended in (
        (f"{OTHER}.click()", {"done": False}),
        (f"{WITHDRAW}.click(), {WITHDRAW}.click()", {"aborted": True}),
    ):
        with served(of.out) as site:
            begin(chromium, site, STOPS)
            until(chromium, STOPPED)
            chromium.close()
            begin(chromium, site, WAITS)
            until(chromium, WITHDRAW)
            came = [*dict.fromkeys(site.lines)]
            chromium.evaluate(press)
            until(chromium, OVER)
            assert ended.items() <= site.ended.items()
            if "done" in ended:
                assert {*came} <= {*site.lines}
                assert brought_home(of, site.lines, tmp_path)[0].state == "imported"
                assert "Open your link again" in chromium.text()
            else:
                assert site.lines == []


@pytest.mark.slow
def test_the_next_person_meets_a_labs_own_screens_too(chromium, of):
    forms = """
observer.each = () => {
  const form = document.querySelector("form.lab");
  if (!form || form.done) return;
  form.done = true;
  if (form.age) form.age.value = 33;
  form.requestSubmit();
};
"""
    with served(of.out, jatos=False) as site:
        begin(chromium, site, STOPS, forms, page="lab.html?slot=3")
        until(chromium, STOPPED)
        begin(chromium, site, WAITS, page="lab.html?slot=3", anew=False)
        until(chromium, OTHER)  # not asked again
        someone_else(chromium, "document.querySelector('form.lab')")
        assert chromium.text().startswith("What this study stores")


@pytest.mark.slow
def test_no_link_makes_a_session_simulated(chromium, of):
    page = "index.html?slot=1&simulated&metamerlabSimulated=1#metamerlabSimulated"
    for driven, person in (("window.metamerlabSimulated = true;", False), ("", True)):
        with served(of.out) as site:
            begin(chromium, site, driven, page=page)
            start = started(chromium, site)
            assert start["machine"]["simulated"] is not person
            chromium.close()


@pytest.mark.slow
def test_the_first_page_says_length_keys_and_what_is_stored_before_its_button(chromium, pairs):
    made = pairs("abc", "de", identifier="PANEL_ID")
    study = made.study.in_a_browser()
    trials = len(planned_trials(study, "web", 0))
    minutes = max(1, round(session_duration_s(study, trials) / 60))
    parts = "[...document.querySelectorAll('main :is(h1, dt, button)')].map((it) => it.innerText)"
    with served(made.out, jatos=False) as site:
        chromium.open(f"{site.url}index.html", size=(480, 800))
        until(chromium, FACTS)
        text = chromium.text()
        keys = chromium.evaluate("[...document.querySelectorAll('kbd')].map((it) => it.innerText)")
        assert chromium.evaluate("document.querySelector('main').scrollWidth <= innerWidth")
        assert chromium.evaluate(parts) == [
            "A short study", "Dauer", "Tasten", "Gespeichert wird", "Im Vollbild beginnen",
        ]  # fmt: skip
    assert f"etwa {minutes} Min." in text
    assert "Auch der Code PANEL_ID" in text
    assert keys == ["1", "2", "Leertaste", "P", "escape"]
