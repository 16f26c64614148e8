"""The window is watched before and in every attempt, and a device without keys is told so."""

import pytest
from web_browser import CLOCK, OBSERVER, begin, said, served, started, until
from web_study import brought_home, built, for_browsers

from protocols.journal import Note
from protocols.journal_file import read_journal

SMALL = (300, 120)
TOO_SMALL = "document.querySelector('main')?.dataset.page === 'window'"
# A browser that gives the full screen to who presses; a window that changes without telling.
FULL = """
let full = null;
Object.defineProperty(document, "fullscreenElement", { get: () => full });
Element.prototype.requestFullscreen = async () => { full = document.documentElement; };
document.exitFullscreen = async () => { full = null; };
const looks = (of, name, value) =>
  Object.defineProperty(of, name, { get: () => value, configurable: true });
"""
SILENT = """
const pages = (window.pages = []);
let was = "";
window.attempts = 0;
observer.each = (frames) => {
  const main = document.querySelector("main");
  if (!frames && main && !main.hidden && main.querySelector("button.next:only-of-type")) {
    pages.push(main.innerText.split("\\n")[0]);
    if (visualViewport.scale === 1.5) looks(visualViewport, "scale", 1);
  }
  const phase = document.querySelector("canvas")?.dataset.phase ?? "";
  if (!frames || phase === was) return;
  was = phase;
  if (phase === "fixate") attempts += 1;
  if (attempts === 5 && phase === "iti") full = null; // the outcome is known
  if (phase !== "stimulus") return;
  if (attempts === 1) looks(window, "innerWidth", 1234);
  if (attempts === 2) looks(window, "devicePixelRatio", 2);
  if (attempts === 3) full = null;
  if (attempts === 4) looks(visualViewport, "scale", 1.5);
};
"""


@pytest.fixture
def site(case):
    with served(case("yes-no").out) as site:
        yield site


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["chromium", "firefox"])
def test_changes_that_a_browser_does_not_tell_void_the_attempt_and_nothing_counts_until_it_fits(
    request, kind, case, site, tmp_path
):
    browser, of = request.getfixturevalue(kind), case("yes-no")
    need_px = tuple(of.exported["window_px"])
    # Twice as large, so that another ratio could choose another scale.
    begin(browser, site, FULL + SILENT, size=(2 * need_px[0], 2 * need_px[1]))
    until(browser, "window.attempts > 5")
    browser.resize(SMALL)
    until(browser, f"{TOO_SMALL} && observer.pages.slice(-3).join() === 'window,window,window'")
    counted = len(said(site.lines, "attempt"))
    assert browser.text().startswith("This window is too small. It must be at least")
    assert f"(it is {SMALL[0]} x {SMALL[1]})" in browser.text()
    until(browser, "observer.pages.slice(-6).every((name) => name === 'window')")
    assert len(said(site.lines, "attempt")) == counted
    browser.resize(need_px)
    until(browser, "document.title === 'ended'")
    assert browser.errors == []
    told = browser.evaluate("pages")
    first = dict.fromkeys(text.split(".")[0] for text in told)
    assert [text for text in first if text.startswith("This ")] == [
        "This page is enlarged", "This study runs in full screen", "This window is too small",
    ]  # fmt: skip

    attempts = said(site.lines, "attempt")
    disturbed = [line["disturbed"] and line["disturbed"][1] for line in attempts]
    assert disturbed[:4] == ["size", "size", "full-screen", "size"]
    assert all(line["outcome"] == "void" for line in attempts if line["disturbed"])
    windows = [line["window"] for line in attempts]
    assert [one["device_pixel_ratio"] for one in windows[:3]] == [1, 1, 2]
    assert windows[-1]["window_px"] == list(need_px)
    assert {(one["scale"], one["full_screen"]) for one in windows} == {(1, True)}
    (imported,) = brought_home(of, site.lines, tmp_path)
    assert (imported.state, imported.reason) == ("imported", "completed"), imported.message
    journal = read_journal(tmp_path / "short" / imported.participant / "journal.jsonl")
    notes = [event.text for event in journal.events if isinstance(event, Note)]
    changes = [text for text in notes if text.startswith("window of")]
    size = f"{need_px[0]} x {need_px[1]}"
    assert changes[-1] == f"window of {size} px, device ratio 2, scale 1, in full screen"


@pytest.mark.slow
def test_a_window_that_is_too_small_at_the_gate_is_waited_for(chromium, site):
    begin(chromium, site, size=SMALL)
    until(chromium, TOO_SMALL)
    assert chromium.text().startswith("This window is too small. It must be at least")
    assert site.lines == []
    chromium.resize((1920, 400))
    start = started(chromium, site)
    assert start["machine"]["window_px"] == [1920, 400]


@pytest.mark.slow
def test_a_browser_without_full_screen_says_so_once_and_goes_on(chromium, site):
    noticed = (
        "let told = 0; addEventListener('DOMContentLoaded', () => new MutationObserver(() => {"
    )
    count = "told += document.body.innerText.startsWith('This browser gives no full screen.');"
    begin(
        chromium,
        site,
        f"{noticed} {count} }}).observe(document.body, {{ subtree: true, childList: true }}));",
    )
    until(chromium, "document.title === 'ended'")
    assert chromium.evaluate("told") == 1
    assert {line["window"]["full_screen"] for line in said(site.lines, "attempt")} == {False}
    assert said(site.lines, "start")[0]["machine"]["full_screen"] is False


TABLET = """
const asked = window.matchMedia.bind(window);
window.matchMedia = (query) =>
  /pointer: coarse/.test(query) ? { matches: true } : asked(query);
"""


@pytest.mark.slow
def test_a_tablet_is_asked_for_a_key_unless_the_study_takes_pointers(
    chromium, case, site, tmp_path
):
    page = f"{site.url}?slot=1"
    at = "document.querySelector('main')?.dataset.page"
    chromium.open(page, CLOCK, OBSERVER, TABLET, 'observer.leave = ["keys"];', size=(1024, 768))
    until(chromium, f"{at} === 'over'")
    assert chromium.text().startswith("This study needs a computer with a keyboard")
    assert site.lines == []
    chromium.open(page, CLOCK, TABLET, size=(1024, 768))
    until(chromium, f"{at} === 'keys'")
    assert chromium.text().startswith("This study needs a keyboard.")
    chromium.evaluate("dispatchEvent(new KeyboardEvent('keydown', { key: 'k', code: 'KeyK' }))")
    until(chromium, f"{at} === 'gate'")
    of = case("yes-no")
    response = of.study.response.model_copy(update={"pointer": True})
    clicked = built(
        for_browsers(of.study.model_copy(update={"response": response}), tolerance_s=0.01), tmp_path
    )
    with served(clicked.out) as other:
        chromium.open(f"{other.url}?slot=1", CLOCK, TABLET, size=(1024, 768))
        until(chromium, f"{at} === 'gate'")
