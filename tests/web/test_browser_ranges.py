"""Packs come by HTTP ranges where the server has them, and whole where it has none."""

import re

import loopback
import pytest
from study_texts import short_study
from task_cases import PREFERENCE, TRIAL
from web_browser import CLOCK, LUCKY, OBSERVER, until
from web_study import built, for_browsers

from protocols.load import load_study

CLIPS = """kind = "files"
width_px = 520
height_px = 520
fps = 30
duration_s = 0.1
entries = [
  { name = "one", file = "one.mp4", condition = { scene = "a", method = "one" } },
  { name = "two", file = "two.mp4", condition = { scene = "a", method = "two" } },
]"""


class Handler(loopback.FolderHandler):
    """Notes what is asked for; answers ranges, as JATOS does, where `ranges` is set."""

    ranges: bool
    asked: list[tuple[str, str]]

    def do_GET(self) -> None:  # noqa: N802
        asked = self.headers.get("range", "")
        found = re.fullmatch(r"bytes=(\d+)-(\d+)", asked)
        if self.name.endswith(".pack"):
            self.asked.append((self.name, asked))
        if not (self.ranges and found):
            return super().do_GET()
        data = (self.folder / self.name).read_bytes()
        first, last = map(int, found.groups())
        self.send_response(206)
        self.send_header("content-range", f"bytes {first}-{last}/{len(data)}")
        self.send_header("content-length", str(last + 1 - first))
        self.end_headers()
        self.wfile.write(data[first : last + 1])
        return None


@pytest.fixture(scope="module")
def of(tmp_path_factory):
    """A study of one trial, whose two clips have three frames of most of a megabyte."""
    folder = tmp_path_factory.mktemp("large")
    text = short_study(
        stimuli=CLIPS,
        task='kind = "two-interval"\ngap_s = 0.1',
        answers=("first", "second"),
        analysis=PREFERENCE,
        design="repeats = 1\nblocks = 1",
        trial=TRIAL,
    )
    (folder / "study.toml").write_text(text, encoding="utf-8")
    study, _ = load_study(folder / "study.toml")
    return built(for_browsers(study, tolerance_s=0.01), folder)


@pytest.mark.slow
@pytest.mark.parametrize("ranges", [True, False])
def test_clips_come_frame_by_frame_or_whole_as_the_server_can(chromium, of, ranges):
    own = {"folder": of.out, "ranges": ranges, "asked": []}
    handler = type("Ranges", (Handler,), own)
    with loopback.served(handler) as url:
        script = "addEventListener('error', (event) => { document.title = event.message; });"
        page = f"{url}index.html?slot=1"
        size = of.exported["window_px"]
        chromium.open(page, CLOCK, OBSERVER, LUCKY, script, size=size)
        until(chromium, "document.querySelector('main')?.dataset.page === 'over'")
        assert chromium.text().startswith(of.exported["pages"]["en"]["thanks"][:10])
    packs = {f"packs/{pack['file']}": pack["ends"] for pack in of.exported["stimuli"].values()}
    assert len(packs) == 2
    expected = set()
    for name, ends in packs.items():
        starts = [0, *ends[:-1]]
        parts = [f"bytes={first}-{end - 1}" for first, end in zip(starts, ends, strict=True)]
        expected |= {(name, part) for part in (parts if ranges else parts[:1])}
    assert set(own["asked"]) == expected
    assert len(own["asked"]) == len(expected)
