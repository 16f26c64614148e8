"""Faults in a participant's browser, said in words, and in the lines that come home."""

import json
import re
import time

import pytest
from web_browser import CLOCK, OBSERVER, begin, said, served, until, whole
from web_study import brought_home, built, for_browsers

from protocols.journal import Note
from protocols.journal_file import read_journal
from study_app.web.import_lines import DISTURBANCES

WITHDRAW = "for (const time of [1, 2]) document.querySelector('button.withdraw').click()"
"""Press, and once more when asked."""


@pytest.fixture(scope="module")
def of(case):
    """A built study."""
    return case("yes-no")


@pytest.fixture
def site(of):
    with served(of.out) as site:
        yield site


def changed(data: bytes) -> bytes:
    """Change one byte in the middle."""
    middle = len(data) // 2
    return data[:middle] + bytes([data[middle] ^ 1]) + data[middle + 1 :]


@pytest.mark.slow
def test_a_wrong_file_is_named_never_shown_and_the_session_goes_on_once_it_is_mended(
    chromium, site, of, tmp_path
):
    packs = [path.name for path in (of.out / "packs").iterdir()]
    faults = {
        r"frame 0 of [\w-]+ is not the one that was hashed": lambda data: (200, changed(data)),
        r"packs/[\w-]+\.pack must have \d+ bytes \(has \d+\)": lambda data: (200, data[:-1]),
        r"packs/[\w-]+\.pack did not come \(the server says 404\)": lambda _: (404, b""),
        r"packs/[\w-]+\.pack did not come \(the server says 503\)": lambda _: (503, b""),
    }
    for number, (words, fault) in enumerate(faults.items()):
        site.faults = {f"packs/{name}": fault for name in packs}
        begin(chromium, site)
        until(chromium, "document.querySelector('main a')")
        text = chromium.text()
        assert text.startswith("Something went wrong: ")
        assert re.search(words, text), text
        assert said(site.lines, "attempt") == []
        notes = said(site.lines, "note")
        assert len(notes) == number + 1
        assert re.search(words, notes[-1]["text"])
        assert said(site.lines, "end")[-1]["reason"] == "error"
    site.faults = {}
    whole(chromium, site)
    (imported,) = brought_home(of, site.lines, tmp_path)
    assert (imported.state, imported.reason) == ("imported", "completed"), imported.message
    journal = read_journal(tmp_path / "short" / imported.participant / "journal.jsonl")
    assert sum(isinstance(event, Note) for event in journal.events) >= len(faults)


@pytest.mark.slow
def test_a_wrong_picture_is_named(chromium, site, of):
    name = next((of.out / "pictures").iterdir()).name
    site.faults = {f"pictures/{name}": lambda data: (200, changed(data))}
    begin(chromium, site)
    until(chromium, "document.body.innerText.includes('went wrong')")
    assert f"pictures/{name} is not the picture that was hashed" in chromium.text()


@pytest.mark.slow
def test_a_slow_line_is_told_and_noted(chromium, site, of, tmp_path):
    def slow(data: bytes) -> tuple[int, bytes]:
        time.sleep(0.25)
        return 200, data

    # Time jumps to the next timer: a quarter of a second is long enough.
    site.faults = {f"packs/{path.name}": slow for path in (of.out / "packs").iterdir()}
    told = "document.body?.innerText.includes('The line is slow')"
    # Once it is told, no time jumps over what a silent line has.
    noticed = "slow = 1; clock.patience_ms = Infinity;"
    seen = f"let slow = 0; setInterval(() => {{ if ({told}) {{ {noticed} }} }}, 5)"
    begin(chromium, site, seen, "clock.patience_ms = 100;")
    until(chromium, "document.title === 'ended'")
    assert chromium.evaluate("slow") == 1
    assert re.fullmatch(
        r"the stimuli of practice-\d+ came after \d+ s", said(site.lines, "note")[0]["text"]
    )
    assert brought_home(of, site.lines, tmp_path)[0].state == "imported"


DISTURBED = """
let attempts = 0, was = "";
observer.each = (frames) => {
  const phase = document.querySelector("canvas")?.dataset.phase ?? "";
  if (!frames || phase === was) return;
  was = phase;
  if (phase === "fixate") attempts += 1;
  if (phase !== "stimulus") return;
  if (attempts === 1) dispatchEvent(new Event("blur"));
  const tells = (name, value, event) => {
    Object.defineProperty(document, name, { value, configurable: true });
    document.dispatchEvent(new Event(event));
    delete document[name];
  };
  if (attempts === 2) tells("hidden", true, "visibilitychange");
  if (attempts === 3) tells("fullscreenElement", null, "fullscreenchange");
  if (attempts === 4) dispatchEvent(new Event("resize"));
};
"""


@pytest.mark.slow
def test_whatever_comes_between_voids_the_attempt_and_is_named(chromium, site, of, tmp_path):
    whole(chromium, site, DISTURBED)
    disturbed = [line["disturbed"][1] for line in said(site.lines, "attempt") if line["disturbed"]]
    assert disturbed == ["focus", "hidden", "full-screen", "size"]
    assert len(said(site.lines, "pause")) == 4
    (told,) = brought_home(of, site.lines, tmp_path)
    assert told.reason == "completed"
    journal = read_journal(tmp_path / "short" / told.participant / "journal.jsonl")
    notes = [event.text for event in journal.events if isinstance(event, Note)]
    assert notes == [DISTURBANCES[what] for what in disturbed]


@pytest.mark.slow
def test_answers_that_a_server_does_not_take_are_offered_as_a_file(chromium, site):
    def from_now_on(_: str) -> bool:
        site.refuses = len(site.lines) > 8
        return False

    site.lost = from_now_on
    begin(chromium, site)
    until(chromium, "document.querySelector('main a[download]')")
    assert chromium.text().startswith("Your answers could not be sent.")
    copy = chromium.evaluate(
        "fetch(document.querySelector('a[download]').href).then((file) => file.text())"
    )
    kept = [json.loads(line)["n"] for line in copy.splitlines()]
    assert kept == [*range(len(kept))]
    assert set(dict.fromkeys(site.lines)) < set(copy.splitlines(keepends=True))


@pytest.mark.slow
def test_who_leaves_may_come_back_or_withdraw(chromium, site):
    leaves = 'observer.leave = ["start", "quit"];'
    begin(chromium, site, leaves)
    until(chromium, "document.querySelector('main button.withdraw')")
    assert chromium.text().startswith("You have left the study.")
    assert said(site.lines, "end")[-1]["reason"] == "quit"
    assert site.ended is None
    chromium.evaluate(WITHDRAW)
    until(chromium, "document.title === 'aborted'")
    assert site.results == []


@pytest.mark.slow
def test_screens_that_cannot_run_the_study_are_refused_before_anything_is_asked(
    chromium, site, of, tmp_path
):
    def refused(*scripts: str, url: str = site.url, size: tuple[int, int] = (1920, 400)) -> str:
        chromium.open(f"{url}?slot=1", CLOCK, OBSERVER, *scripts, size=size)
        until(chromium, "['over', 'window'].includes(document.querySelector('main')?.dataset.page)")
        return chromium.text()

    exact = built(for_browsers(of.study), tmp_path)
    with served(exact.out) as other:
        text = refused("clock.hz = 75;", url=other.url)
    assert text.startswith("This study runs at")
    assert "(this screen has 75)" in text
    assert "It must be at least" in refused(size=(640, 480))
    insecure = refused(url=site.url.replace("localhost", "lab.test"))
    assert insecure.startswith("This page must come over https")
    chromium.open("about:blank", CLOCK, OBSERVER)
    phone = {"width": 390, "height": 844, "deviceScaleFactor": 3, "mobile": True}
    chromium.devtools("Emulation.setDeviceMetricsOverride", **phone)
    chromium.devtools("Emulation.setTouchEmulationEnabled", enabled=True, maxTouchPoints=5)
    chromium.go(f"{site.url}?slot=1")
    until(chromium, "document.querySelector('main')?.innerText.length > 60")
    assert chromium.text().startswith("This study needs a computer")
    assert site.lines == []
