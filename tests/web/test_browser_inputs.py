"""Keys, mouse and touch of the browser itself, not of a script, answer and turn pages."""

import time

import pytest
from chromium import Chromium, chromium_for_tests
from web_browser import CLOCK, OBSERVER, said, served
from web_study import brought_home, built, for_browsers

from protocols.journal import Note
from protocols.journal_file import read_journal

# How many attempts have begun, where the one that runs awaits an answer.
ASKS = "(document.querySelector('canvas')?.style.cursor === 'default' && window.begun)"
COUNTS = """
let was;
window.begun = 0;
clock.each = () => {
  const phase = document.querySelector("canvas")?.dataset.phase;
  if (phase && !was) window.begun += 1;
  was = phase;
};
"""
# What the page wants: its title, a field to fill, a choice, and a button, each once.
PAGE = """
(() => {
  const middle = (what) => {
    if (!what || what.seen) return null;
    what.seen = true;
    what.scrollIntoView({ block: "center" });
    const box = what.getBoundingClientRect();
    return [box.x + box.width / 2, box.y + box.height / 2];
  };
  const of = (what) => document.querySelector(`main:not([hidden]) ${what}`);
  const text = of("textarea"), told = of("button") && !text?.value && Boolean(text);
  const next = told ? null : of("button:enabled");
  return [document.title, ASKS, told, middle(of("input")), middle(next)];
})()
"""
# How many attempts have begun, where the one that runs awaits an answer.
ASKS = "(document.querySelector('canvas')?.style.cursor === 'default' && window.begun)"
COUNTS = """
let was;
window.begun = 0;
clock.each = () => {
  const phase = document.querySelector("canvas")?.dataset.phase;
  if (phase && !was) window.begun += 1;
  was = phase;
};
"""
BUTTON = "document.querySelector('main:not([hidden]) button:not([disabled])')"


def touch(browser: Chromium, x: float, y: float) -> None:
    browser.devtools("Input.dispatchTouchEvent", type="touchStart", touchPoints=[{"x": x, "y": y}])
    browser.devtools("Input.dispatchTouchEvent", type="touchEnd", touchPoints=[])


def click(browser: Chromium, x: float, y: float) -> None:
    for kind in ("mousePressed", "mouseReleased"):
        browser.devtools(
            "Input.dispatchMouseEvent", type=kind, x=x, y=y, button="left", clickCount=1
        )


def press(browser: Chromium, key: str, code: str) -> None:
    for kind in ("keyDown", "keyUp"):
        browser.devtools("Input.dispatchKeyEvent", type=kind, key=key, code=code)


@pytest.fixture(scope="module")
def alone():
    """A browser of its own: once a window was full screen, later ones in it draw slowly."""
    with chromium_for_tests() as browser:
        yield browser


@pytest.fixture(scope="module")
def pointed(case, tmp_path_factory):
    """A study of eight trials whose answers a pointer gives, too."""
    study = case("two-alternative").study
    response = study.response.model_copy(update={"pointer": True})
    design = study.design.model_copy(update={"practice": None, "blocks": 1})
    changed = study.model_copy(update={"response": response, "design": design})
    return built(for_browsers(changed, tolerance_s=0.01), tmp_path_factory.mktemp("pointed"))


@pytest.mark.slow
def test_a_session_by_real_keys_mouse_and_touch_comes_home(alone, pointed, tmp_path):
    chromium = alone
    of, width = pointed, pointed.exported["window_px"][0]
    left, right = 0.4 * width, 0.6 * width
    ways = {
        "touch": lambda: touch(chromium, left, 100),
        "key": lambda: press(chromium, "2", "Digit2"),
        "mouse": lambda: click(chromium, right, 100),
        "key of another alphabet": lambda: press(chromium, "\u0661", "Digit1"),
    }
    wanted, given = dict(zip(ways, ("left", "right", "right", "left"), strict=True)), []
    with served(of.out) as site:
        chromium.open(f"{site.url}?slot=1", CLOCK, OBSERVER, COUNTS, size=of.exported["window_px"])
        turn, end = 0, time.monotonic() + 180
        while time.monotonic() < end:
            title, asks, untold, choice, button = chromium.evaluate(PAGE.replace("ASKS", ASKS))
            if title == "ended":
                break
            if untold:
                chromium.devtools("Input.insertText", text="edges \U0001f440")
            if choice:
                click(chromium, *choice)
            if button:
                (touch, click)[turn % 2](chromium, *button)
                turn += 1
            elif asks and asks > len(given) == 3:
                given.append(None)
                chromium.evaluate("document.exitFullscreen()")
            elif asks and asks > len(given):
                way = [*ways][len(given) % len(ways)]
                given.append(wanted[way])
                ways[way]()
            else:
                time.sleep(0.02)
        assert title == "ended", (chromium.text(), turn, given)
        assert chromium.errors == []
    attempts = said(site.lines, "attempt")
    assert [one["answer"] for one in attempts] == given
    disturbed = [one["disturbed"] and one["disturbed"][1] for one in attempts]
    assert disturbed == [None] * 3 + ["full-screen"] + [None] * (len(given) - 4)
    pressed = [press for one in attempts for press in one["presses"]]
    assert {press["key"] for press in pressed} == {"pointer", "1", "2"}
    assert {round(press["x"], 1) for press in pressed if press["x"] is not None} == {0.4, 0.6}
    (told,) = brought_home(of, site.lines, tmp_path)
    assert told.reason == "completed"
    journal = read_journal(tmp_path / of.study.study.name / told.participant / "journal.jsonl")
    notes = [event.text for event in journal.events if isinstance(event, Note)]
    assert notes == ["the page left full screen"]
    (start,) = said(site.lines, "start")
    assert start["machine"]["full_screen"], "a real touch may ask for the full screen"
