"""A line that is down: the page says so, tries again for minutes, and says how to go on."""

from collections.abc import Callable

import pytest
from web_browser import begin, said, served, until, whole
from web_study import brought_home

DOWN = "The connection is down."
AGAIN = "To go on, open this link again"
# Texts of the page that came for a moment only.
HEARD = """
const heard = (window.heard = new Set());
addEventListener("DOMContentLoaded", () => {
  const note = () => document.querySelectorAll("main p").forEach((one) => heard.add(one.innerText));
  new MutationObserver(note).observe(document.body, { childList: true, subtree: true });
});
"""


@pytest.fixture
def site(case):
    with served(case("yes-no").out) as site:
        yield site


def failing(numbers: range) -> Callable[[bytes], tuple[int, bytes]]:
    """Return a fault that some requests meet."""
    count = [0]

    def answer(data: bytes) -> tuple[int, bytes]:
        count[0] += 1
        return (503, b"") if count[0] - 1 in numbers else (200, data)

    return answer


@pytest.mark.slow
def test_files_that_do_not_come_for_a_minute_are_waited_for_and_the_page_says_so(
    chromium, site, case, tmp_path
):
    of = case("yes-no")
    picture = next((of.out / "pictures").iterdir()).name
    packs = [f"packs/{path.name}" for path in (of.out / "packs").iterdir()]
    site.faults = {f"pictures/{picture}": failing(range(8)), packs[0]: failing(range(8))}
    site.faults["study.json"] = failing(range(1, 9))  # the observer asks first
    whole(chromium, site, HEARD)
    assert chromium.errors == []
    assert any(text.startswith(DOWN) for text in chromium.evaluate("[...heard]"))
    (imported,) = brought_home(of, site.lines, tmp_path)
    assert (imported.state, imported.reason) == ("imported", "completed")
    assert [site.asked.count(name) for name in site.faults] == [9, 9, 10]


@pytest.mark.slow
def test_lines_that_a_server_does_not_take_for_a_minute_arrive(chromium, site, case, tmp_path):
    left, taken = [9], site.lost

    def for_a_minute(_: str) -> bool:
        left[0] -= len(site.lines) > 8
        site.refuses = left[0] in range(8)
        return taken(_)

    site.lost = for_a_minute
    whole(chromium, site, HEARD)
    assert left[0] < 0
    assert any(text.startswith(DOWN) for text in chromium.evaluate("[...heard]"))
    assert said(site.lines, "end")[-1]["reason"] == "completed"
    (imported,) = brought_home(case("yes-no"), site.lines, tmp_path)
    assert (imported.state, imported.reason) == ("imported", "completed")


@pytest.mark.slow
@pytest.mark.parametrize("page", ["index.html", "lab.html"])
def test_a_page_that_gives_up_says_to_open_its_link_again(chromium, site, page):
    site.faults["study.json"] = failing(range(1, 100))
    begin(chromium, site, page=page)
    until(chromium, f"document.body?.innerText.includes('{AGAIN}')")
    assert chromium.text().startswith("Something went wrong: study.json did not come")
    assert len([name for name in site.asked if name == "study.json"]) > 8
    site.faults["study.json"] = lambda _: (200, b"<html>Please log in to this network")
    begin(chromium, site, page=page)
    until(chromium, f"document.body?.innerText.includes('{AGAIN}')")
    assert site.lines == []
