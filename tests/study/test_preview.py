"""`protocol preview`: a study as one page, drawn from what sessions are drawn from."""

import json
import re
import shutil
import subprocess
from html import escape as html_escape
from pathlib import Path

import numpy as np
import pytest
from command_line import result_of
from study_texts import short_study

from pipeline.pictures.drawing import save_picture
from protocols.load import load_study, shipped
from protocols.make_script import example_scripts
from protocols.tasks.task_kinds import TASKS
from study_app.preview import MARK, preview_page
from study_app.text_image import UnwritableError, typeface_for

run = result_of(catch_exceptions=False)


def escape(text: str) -> str:
    return html_escape(text).replace("&quot;", "&#34;").replace("&#x27;", "&#39;")


def data_of(html: str) -> dict:
    return json.loads(re.search(r"^const data = (\{.*\});$", html, flags=re.M)[1])


@pytest.fixture(scope="module")
def page() -> str:
    study, display = load_study(Path("demo"), None)
    return preview_page(study, display).html


def test_it_needs_no_other_file(page):
    assert not re.findall(r'(?:src|href)="(?!data:)', page)
    assert "http://" not in page
    assert "https://" not in page
    assert MARK in page


def test_every_page_of_every_language_is_drawn_and_read_out(page):
    study, _ = load_study(Path("demo"), None)
    parts = dict(re.findall(r'<section lang="(\w+)">(.*?)</section>', page, flags=re.S))
    assert set(parts) == {"en", "de", "ja"}
    names = {
        language: re.findall(r'data-page="([\w-]+)"', part) for language, part in parts.items()
    }
    assert names["en"] == names["de"] == names["ja"]
    assert {"consent", "instructions-1", "start", "paused", "quit", "thanks", "gaze-lost"} <= set(
        names["en"]
    )
    for language, part in parts.items():
        texts = study.text.languages[language]
        for text in (texts.thanks, texts.question, texts.gaze_lost, *texts.answers.values()):
            assert escape(text) in part


def test_a_language_that_no_font_here_writes_is_said_and_shown_as_text(monkeypatch):
    from study_app import pages

    def lacking(texts, size_px):
        if "。" in "".join(texts):
            raise UnwritableError("text: one font must hold every character")
        return typeface_for(texts, size_px)

    monkeypatch.setattr(pages, "typeface_for", lacking)
    study, display = load_study(Path("demo"), None)
    made = preview_page(study, display, most=1)
    assert [note[:3] for note in made.notes] == ["ja:"]
    part = re.search(r'<section lang="ja">(.*?)</section>', made.html, flags=re.S)[1]
    assert "<img" not in part
    assert escape(study.text.languages["ja"].thanks) in part


def test_lengths_are_the_studys_and_the_timeline_is_to_scale(page):
    first = data_of(page)["trials"][0]
    study, display = load_study(Path("demo"), None)
    by_name = {phase["name"]: phase for phase in first["phases"]}
    assert by_name["iti"]["ms"] == pytest.approx(1000 * study.trial.iti_s)
    assert by_name["respond"]["ms"] is None
    drawn = re.search(r'data-trial="0".*?</svg>', page, flags=re.S)[0]
    widths = [float(width) for width in re.findall(r'y="22" width="([\d.]+)" height="26"', drawn)]
    lengths = [800 if phase["ms"] is None else phase["ms"] for phase in first["phases"]]
    assert len(widths) == len(lengths)
    np.testing.assert_allclose(np.array(widths) / sum(widths), np.array(lengths) / sum(lengths),
                               atol=1e-3)  # fmt: skip
    watched = sum(phase["watched"] for phase in first["phases"])
    assert drawn.count('fill="#D55E00"') == (watched if study.gaze.mode != "none" else 0)
    assert display.refresh_hz == data_of(page)["hz"]


def test_what_a_phase_draws_is_where_the_presenter_draws_it(page):
    study, display = load_study(Path("demo"), None)
    script = example_scripts(study, display)[0]
    (place,) = {entry.at for shown in script.frames for entry in shown}
    place = place[0] + display.width_px // 2, place[1] + display.height_px // 2
    data = data_of(page)
    scale = data["size"][0] / display.width_px
    shown = [
        entry for phase in data["trials"][0]["phases"] for entry in phase["show"]
        if entry["kind"] == "stimulus"
    ]  # fmt: skip
    assert shown
    for entry in shown:
        assert (entry["x"], entry["y"]) == pytest.approx(np.array(place) * scale, abs=0.01)
        assert (entry["w"], entry["h"]) == pytest.approx(
            np.array(script.stimulus_px) * scale, abs=0.01
        )


@pytest.mark.slow
@pytest.mark.parametrize("name", ["beyond-blur-detection", "critical-scaling", "inpainting-2afc"])
def test_other_tasks_have_a_preview(name):
    study, display = load_study(shipped("studies")[name], None)
    made = preview_page(study, display, most=3)
    assert made.shown == min(3, made.conditions)
    trials = data_of(made.html)["trials"]
    assert len(trials) == made.shown
    assert len({trial["title"] for trial in trials}) == made.shown
    assert study.task.kind in TASKS


def test_built_clips_are_played_and_a_changed_one_is_refused(tmp_path):
    pictures = tmp_path / "pictures"
    pictures.mkdir()
    rows = ["stimulus,file,scene,seen"]
    for index, seen in enumerate(("yes", "no")):
        grey = np.full((64, 64, 3), 60 + 120 * index, np.uint8)
        save_picture(pictures / f"{seen}.png", grey)
        rows.append(f"{seen},pictures/{seen}.png,one,{seen}")
    (tmp_path / "stimuli.csv").write_text("\n".join(rows) + "\n")
    (tmp_path / "study.toml").write_text(
        short_study(
            stimuli='kind = "files"\ntable = "stimuli.csv"\nwidth_px = 64\nheight_px = 64',
            task='kind = "yes-no"\nsignal = { seen = ["yes"] }\nstimulus_s = 0.5',
            answers=["yes", "no"],
            analysis='kind = "detection"\nby = "seen"',
            design="repeats = 1",
        )
    )
    run("stimuli", "build", tmp_path / "study.toml", "--out", tmp_path / "clips")
    words = (tmp_path / "study.toml", "--stimuli", tmp_path / "clips", "--out", tmp_path / "p.html")

    run("protocol", "preview", *words)

    data = data_of((tmp_path / "p.html").read_text())
    assert all(entry["strip"].startswith("data:image/webp") for entry in data["stimuli"].values())
    assert data["window"] is None
    frame = next((tmp_path / "clips").glob("*/000000.png"))
    save_picture(frame, np.zeros((64, 64, 3), np.uint8))
    done = run("protocol", "preview", *words, status=2)
    assert "must be the frame that was hashed" in " ".join(done.stderr.split())


@pytest.mark.slow
def test_an_earlier_preview_is_written_over_and_nothing_else(tmp_path):
    run("protocol", "preview", "demo", "--out", tmp_path / "p.html")
    run("protocol", "preview", "demo", "--out", tmp_path / "p.html")
    (tmp_path / "mine.html").write_text("mine")
    for out, said in (("mine.html", "something else"), ("p.htm", "must end in .html")):
        done = run("protocol", "preview", "demo", "--out", tmp_path / out, status=2)
        assert said in " ".join(done.stderr.split())
    assert (tmp_path / "mine.html").read_text() == "mine"


def test_a_browser_plays_it_phase_by_phase(page, tmp_path):
    browser = shutil.which("chromium") or shutil.which("google-chrome")
    if browser is None:
        pytest.skip("needs Chromium (apt-get install chromium)")
    walk = """
    addEventListener("load", () => {
      const seen = [];
      for (const _ of trial.phases) {
        seen.push($("now").textContent.split(",")[0]); $("next").click();
      }
      const light = (x, y) => pen.getImageData(x, y, 1, 1).data[0];
      enter(1); draw(0);
      const box = trial.phases[1].show[0];
      seen.push(`grey ${light(2, 2)}, box ${light(box.x + 3, box.y + 3)}`);
      document.body.innerHTML = `<p id="out">${seen.join("; ")}</p>`;
    });"""
    (tmp_path / "p.html").write_text(page.replace("</script>", walk + "</script>"), "utf-8")
    dump = subprocess.run(
        [browser, "--headless", "--no-sandbox", "--disable-gpu", "--virtual-time-budget=3000",
         "--dump-dom", f"file://{tmp_path / 'p.html'}"],
        capture_output=True, text=True, check=True, timeout=120,
    ).stdout  # fmt: skip
    said = re.search(r'<p id="out">(.*?)</p>', dump)[1].split("; ")
    data = data_of(page)
    phases = data["trials"][0]["phases"]
    assert said[:-1] == [
        f"Phase {number} of {len(phases)}: {phase['name']}"
        for number, phase in enumerate(phases, 1)
    ]
    assert said[-1] == f"grey {data['grey']}, box 200"
