"""Lines reach home by a browser's own storage, or by JATOS, whatever its server does to them."""

import json

import pytest
from web_browser import begin, served, started, until, whole
from web_study import brought_home

from protocols.journal import SessionResume
from protocols.journal_file import read_journal
from study_app.web.import_lines import import_results
from study_app.web.read_results import read_web_results

OVER = "document.querySelector('main')?.dataset.page === 'over'"
SAVED = "fetch(document.querySelector('main a[download]').href).then((file) => file.text())"
WITHDRAW = "for (const time of [1, 2]) document.querySelector('button.withdraw').click()"
LINES = "Object.entries(localStorage).find(([name]) => name.endsWith(':lines'))?.[1] ?? ''"

# The observer turns no page of this name: whatever is there waits.
STOPS = """
observer.each = () => {
  const main = document.querySelector("main");
  if (main?.dataset.page !== "NAME") return;
  for (const button of main.querySelectorAll("button")) button.seen = true;
};
"""
STARTS = "document.querySelector('main')?.dataset.page === 'start'"
BUSY = "document.querySelector('main')?.innerText.startsWith('This study is open in another tab')"


def numbers(lines: list[str]) -> set[int]:
    return {json.loads(line)["n"] for line in lines}


def session_in(of, lines, root):
    (imported,) = brought_home(of, lines, root)
    assert (imported.state, imported.reason) == ("imported", "completed"), imported.message
    return read_journal(root / of.study.study.name / imported.participant / "journal.jsonl")


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["chromium", "firefox"])
def test_a_folder_without_jatos_keeps_its_lines_and_goes_on_after_a_closed_tab(
    request, kind, case, tmp_path
):
    browser, of = request.getfixturevalue(kind), case("yes-no")
    with served(of.out, jatos=False) as site:
        begin(browser, site, STOPS.replace("NAME", "start"))
        until(browser, STARTS)
        assert len(browser.evaluate(LINES).split('"attempt"')) > 3
        browser.swap()  # the other tab waits until this one is closed
        begin(browser, site, STOPS.replace("NAME", "busy"), anew=False)
        until(browser, BUSY)
        browser.swap()
        browser.close()
        browser.swap()
        until(browser, OVER)
        assert browser.errors == []
        saved = browser.evaluate(SAVED)
        # Who opens the link once more is not asked anything, and may save the same answers.
        begin(browser, site, "observer.leave = [];", anew=False)
        until(browser, OVER)
        again = browser.evaluate(SAVED)
        assert browser.evaluate("observer.pages") == ["gate"]
    assert again.startswith(saved)
    lines = [*dict.fromkeys(saved.splitlines(keepends=True))]  # the last one was sent again
    journal = session_in(of, lines, tmp_path / "a")
    assert sum(isinstance(event, SessionResume) for event in journal.events) == 1
    done = [one.trial for one in journal.attempts if one.outcome == "completed"]
    assert len(done) == len(set(done))
    assert [json.loads(line)["n"] for line in lines] == [*range(len(lines))]
    assert session_in(of, again.splitlines(keepends=True), tmp_path / "b").attempts


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["chromium", "firefox"])
def test_a_tab_that_asks_goes_on_at_its_own_refresh_rate_and_the_other_says_so(
    request, kind, case, tmp_path
):
    browser, of = request.getfixturevalue(kind), case("yes-no")
    with served(of.out) as site:
        begin(browser, site, "clock.hz = 120;", STOPS.replace("NAME", "start"))
        until(browser, STARTS)
        browser.swap()
        begin(browser, site, "clock.hz = 67;", STOPS.replace("NAME", "busy"), anew=False)
        until(browser, BUSY)
        before = len({*site.lines})
        browser.evaluate("document.querySelector('main button').click()")
        until(browser, "document.querySelector('main')?.innerText.includes('screen has 67')")
        assert len({*site.lines}) == before
        browser.swap()
        assert browser.text().startswith("The study goes on in another tab")
        browser.close()
        browser.swap()
        whole(browser, site, anew=False)
        assert browser.errors == []
    journal = session_in(of, site.lines, tmp_path)
    (resumed,) = [event for event in journal.events if isinstance(event, SessionResume)]
    assert (journal.start.refresh_hz, resumed.refresh_hz) == (120, 60)
    assert numbers(site.lines) == {*range(len({*site.lines}))}
    assert len({json.loads(line)["opening"] for line in site.lines}) == 2


@pytest.mark.slow
def test_another_link_and_another_version_begin_a_session_of_their_own(chromium, case):
    """Two people at one computer, and a study that was exported again under its name."""
    of = case("yes-no")
    everyone = "Object.keys(localStorage).filter((name) => name.endsWith(':lines')).length"
    resumed = "Object.values(localStorage).some((text) => text.includes('\"resume\"'))"
    with served(of.out, jatos=False) as site:
        begin(chromium, site)
        until(chromium, f"{everyone} === 1")
        begin(chromium, site, page="?slot=2", anew=False)
        until(chromium, f"{everyone} === 2")
        begin(chromium, site, anew=False)
        until(chromium, resumed)
        changed = of.exported | {"protocol_sha256": "f" * 64}
        site.faults["study.json"] = lambda _: (200, json.dumps(changed).encode())
        begin(chromium, site, anew=False)
        until(chromium, f"{everyone} === 3")


@pytest.mark.slow
def test_slots_of_a_batch_are_given_once_whoever_comes_between(chromium, case):
    slots, batch, version = [], {}, 0
    for rivals in (1, 0, 3):
        with served(case("yes-no").out) as site:
            site.rivals, site.batch, site.version = rivals, batch, version
            begin(chromium, site, page="index.html")
            start = started(chromium, site)
            assert (start["slot_from"], site.rivals) == ("batch", 0)
            slots.append(start["slot"])
            batch, version = site.batch, site.version
    assert slots == [1, 2, 6]
    assert batch == {"metamerlab_slots": 7}


@pytest.mark.slow
def test_a_batch_that_never_gives_a_slot_is_said_and_nothing_is_sent(chromium, case):
    with served(case("yes-no").out) as site:
        site.rivals = 1000
        begin(chromium, site, page="index.html")
        until(chromium, OVER)
        assert chromium.text().startswith("Something went wrong: ")
        assert site.lines == []


@pytest.mark.slow
def test_lines_that_are_too_many_for_a_result_come_as_files(chromium, case, tmp_path):
    of = case("yes-no")
    with served(of.out) as site:
        site.most_bytes = 4000
        whole(chromium, site)
        assert sum(map(len, site.results)) <= 4000
        assert len([name for name in site.files if name.endswith(".txt")]) > 5
        site.archive(tmp_path / "results.zip")
    assert chromium.errors == []
    inbox = read_web_results([tmp_path / "results.zip"])
    (imported,) = import_results(inbox, of.study, of.display, of.manifest, tmp_path / "sessions")
    assert (imported.state, imported.reason) == ("imported", "completed"), imported.message


@pytest.mark.slow
def test_requests_that_nobody_answers_in_time_are_sent_again_and_told_apart(
    chromium, case, tmp_path
):
    of = case("yes-no")
    with served(of.out) as site:
        unanswered = {"append": 2, "session": 1, "end": 1}

        def late(what: str) -> bool:
            unanswered[what] = unanswered.get(what, 0) - 1
            return unanswered[what] >= 0

        site.hang = late
        whole(chromium, site, "clock.patience_ms = 300;")
        assert max(unanswered.values()) < 0
        twice = len(site.lines) - len({*site.lines})
        assert twice >= 2
        journal = session_in(of, site.lines, tmp_path)
        waited_s = max(line["t_s"] for line in map(json.loads, site.lines))
    assert numbers(site.lines) == {*range(len({*site.lines}))}
    assert waited_s > 90, "30 s each were not waited for"
    assert journal.attempts


@pytest.mark.slow
def test_a_withdrawal_that_a_server_refuses_is_said_and_may_be_tried_again(chromium, case):
    with served(case("yes-no").out) as site:
        begin(chromium, site, 'observer.leave = ["start", "quit"];')
        until(chromium, OVER)
        assert site.lines
        site.refuses = True
        chromium.evaluate(WITHDRAW)
        until(chromium, "document.querySelector('button.withdraw')?.innerText.includes('wrong')")
        assert not chromium.evaluate("document.querySelector('button.withdraw').disabled")
        assert site.lines
        site.refuses = False
        chromium.evaluate(WITHDRAW)
        until(chromium, "document.title === 'aborted'")
        assert site.results == []
        assert chromium.text().startswith("All your answers were deleted.")
