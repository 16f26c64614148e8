"""Whole sessions in Chromium and Firefox, on a virtual clock: they come home as ordinary ones."""

import json
import random
import re
import threading
import time

import pytest
from web_browser import Browser, Site, begin, said, served, until, whole
from web_study import WEB_CASES, BuiltWebStudy, brought_home

from protocols.browser.web_study import DRAWN_CODES
from protocols.journal import SessionResume
from protocols.journal_file import Journal, read_journal
from study_app.session_folders import find_sessions
from study_app.verification import verify

# In the first attempts: a lost focus, the pause key, refreshes that were missed in a row.
DISTURBED = """
let attempts = 0, was = "";
observer.each = (frames) => {
  const phase = document.querySelector("canvas")?.dataset.phase ?? "";
  if (!frames || phase === was) return;
  was = phase;
  if (phase === "fixate") attempts += 1;
  else if (attempts === 2) dispatchEvent(new Event("blur"));
  else if (attempts === 4) observer.press("p");
  else if (attempts === 6) for (let n = 1; n <= 5; n++) clock.drop.add(clock.frame + n);
};
"""
# Of the page's Content-Security-Policy; an inline script and a foreign server, which it forbids.
VIOLATIONS = """
const violations = (window.violations = []);
addEventListener("securitypolicyviolation", (event) => violations.push(event.effectiveDirective));
"""
FORBIDDEN = """
const script = document.createElement("script");
script.text = "window.ran = true";
document.head.append(script);
fetch("https://example.org/").catch(() => undefined);
"""
TYPED = "<b>edges</b> & \U0001f440"
DEFAULT = "yes-no with confidence"
BY_FIREFOX = {"two-interval", "rating"}


def session_of(of: BuiltWebStudy, site: Site, root) -> Journal:
    """Bring home what a site holds: one whole session, to which Python agrees."""
    (imported,) = brought_home(of, site.lines, root)
    assert (imported.state, imported.reason) == ("imported", "completed"), imported.message
    assert re.fullmatch(DRAWN_CODES, imported.participant)
    (session,) = find_sessions(root)
    assert (session.state, list(verify(session, of.study).problems)) == ("completed", [])
    return read_journal(root / of.study.study.name / imported.participant / "journal.jsonl")


def whole_session(browser: Browser, of: BuiltWebStudy, root) -> None:
    with served(of.out) as site:
        whole(browser, site, DISTURBED, VIOLATIONS)
        assert (browser.evaluate("violations"), browser.errors) == ([], [])
        browser.evaluate(FORBIDDEN)
        until(browser, "violations.join() === 'script-src-elem,connect-src'")
        assert browser.evaluate("window.ran") is None
        fetched = "performance.getEntriesByType('resource').map((file) => file.name)"
        assert [name for name in browser.evaluate(fetched) if not name.startswith(site.url)] == []
        assert browser.evaluate("document.cookie") == ""
    assert site.ended == {"done": True}
    journal = session_of(of, site, root)
    attempts = said(site.lines, "attempt")
    assert [(one.trial, one.outcome, one.answer) for one in journal.attempts] == [
        (line["trial"], line["outcome"], line["answer"]) for line in attempts
    ]
    voids = {one.void_reason for one in journal.attempts}
    assert voids >= {None, "focus-lost", "paused", "dropped-frames"}
    typed = [one for one in said(site.lines, "answer") if one["question"] == "strategy"]
    assert [one["text"] for one in typed] == [TYPED]
    assert len(site.lines) > len({*site.lines}), "the server's retries were not tried"


def test_a_session_in_chromium_comes_home(chromium, case, tmp_path):
    whole_session(chromium, case(DEFAULT), tmp_path)


@pytest.mark.slow
@pytest.mark.parametrize("name", sorted({*WEB_CASES} - {DEFAULT}))
def test_a_session_of_every_task_comes_home_from_chromium(chromium, case, tmp_path, name, full):
    """Those that Firefox does not show; with --full these too."""
    if not full and name in BY_FIREFOX:
        pytest.skip("a long proof: script/test --full runs it")
    whole_session(chromium, case(name), tmp_path)


@pytest.mark.slow
@pytest.mark.parametrize("name", WEB_CASES)
def test_a_session_of_every_task_comes_home_from_firefox(firefox, case, tmp_path, name, full):
    """Pairs and ratings; with --full the other tasks too, which Chromium has shown."""
    if not full and name not in BY_FIREFOX:
        pytest.skip("a long proof: script/test --full runs it")
    whole_session(firefox, case(name), tmp_path)


FORMS = """
const shown = (window.shown = []);
observer.each = () => {
  const form = document.querySelector("form.lab");
  if (!form || form.done) return;
  form.done = true;
  for (const field of form.querySelectorAll("input")) field.value = "33";
  shown.push(form.innerText.split("\\n")[0]);
  form.requestSubmit();
};
"""


# Plugins of jsPsych write styles and pictures into the page.
STYLED = """
addEventListener("DOMContentLoaded", () => {
  const pixel = URL.createObjectURL(new Blob([]));
  const made = `<style>b { color: red }</style><b style="margin: 1px"><img src="${pixel}"></b>`;
  document.body.insertAdjacentHTML("beforeend", `<div>${made}</div>`);
});
"""


@pytest.mark.slow
def test_a_labs_own_pages_stand_around_a_session_in_jspsych(chromium, case, tmp_path):
    of = case("yes-no")
    with served(of.out) as site:
        begin(chromium, site, FORMS, STYLED, VIOLATIONS, page="lab.html?slot=3")
        until(chromium, "shown.length === 2 && document.querySelector('canvas')?.dataset.phase")
        assert (chromium.evaluate("violations"), chromium.errors) == ([], [])
        chromium.close()
        whole(chromium, site, FORMS, VIOLATIONS, page="lab.html?slot=3")
        assert (chromium.evaluate("violations"), chromium.errors) == ([], [])
        # Whoever comes back is not asked again.
        assert chromium.evaluate("shown.length") == 1
        assert "Thank you." in chromium.text()
    assert site.ended == {"done": True}
    first, second = (site.files[f"{number}/jspsych.json"] for number in range(2))
    assert '"age":"33"' in first
    assert '"odd":"33"' in second
    assert session_of(of, site, tmp_path).attempts


def dies(site: Site, chance: random.Random) -> None:
    """Wait for a moment to die: any, or after the first or the second write of a line."""
    what = chance.choice(["session", "append", None])
    if what is None:
        time.sleep(chance.uniform(0.3, 1.5))
        return
    left, dying = chance.randrange(1, 9), threading.Event()

    def now(asked: str) -> bool:
        nonlocal left
        left -= asked == what
        if asked == what and left <= 0:
            dying.set()
        return dying.is_set()

    if chance.random() < 0.5:
        site.hang = now  # it arrives, and the page never hears of it
    else:
        site.lost = now
    dying.wait(4)


@pytest.mark.slow
def test_tabs_that_are_killed_lose_nothing_and_double_nothing(chromium, case, tmp_path, full):
    of, chance = case("yes-no"), random.Random(5)
    kills = people = resumed = 0
    while kills < (60 if full else 12):
        people += 1
        with served(of.out) as site:
            while not site.ended and kills < 12 * people:
                begin(chromium, site)
                dies(site, chance)
                kills += not site.ended
                chromium.close(crash=chance.random() < 0.5)
                site.hang = site.lost = lambda _: False
            if not site.ended:
                whole(chromium, site)
        journal = session_of(of, site, tmp_path / str(people))
        done = [one.trial for one in journal.attempts if one.outcome == "completed"]
        assert len(done) == len(set(done))
        numbers = {json.loads(line)["n"] for line in site.lines}
        assert numbers == {*range(len(numbers))}
        resumed += sum(isinstance(event, SessionResume) for event in journal.events)
    assert resumed >= 4
