"""No text is cut: what a screen cannot show is refused at every door, in every language."""

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from attack.kills import CASES, write_study
from command_line import metamerlab

from protocols.errors import StudyError
from protocols.load import load_display, load_study, shipped
from protocols.study_file.schema import StudyProtocol
from study_app import text_image
from study_app.cli.protocol_commands import _feasibility_table
from study_app.pages import PageLayout
from study_app.shown_texts import require_showable, shortcomings, shown_texts
from study_app.stage import Page

LONG = "We show you pictures. " * 250
WORD = "x" * 400


def run(*words):
    done = metamerlab(*words, catch_exceptions=False, status=None)
    return done.exit_code, " ".join((done.stderr or done.output).split())


def written(tmp_path, old: str, new: str):
    """Return the folder of a small study with confidence, a text of it changed."""
    write_study(tmp_path, CASES["yes-no by QUEST+ with confidence"])
    path = tmp_path / "study.toml"
    text = path.read_text(encoding="utf-8").replace(
        'display = "display.toml"', "display = 'fhd27-60hz'"
    )
    assert text.count(old) == 1, old
    path.write_text(text.replace(old, new), encoding="utf-8")
    return path


def changed(study: StudyProtocol, language: str, **texts: object) -> StudyProtocol:
    languages = dict(study.text.languages)
    languages[language] = languages[language].model_copy(update=texts)
    return study.model_copy(update={"text": study.text.model_copy(update={"languages": languages})})


STUDY, DISPLAY = load_study(shipped("studies")["critical-scaling"])


@pytest.mark.slow
def test_each_text_of_each_language_is_checked_by_itself():
    texts = STUDY.text.languages["de"]
    kinds = ["consent", "start", "question", "paused", "gaze_lost", "too_late", "preparing"]
    kinds += ["quit_question", "thanks", "break_page", "practice", "right", "wrong"]
    assert {*kinds, "instructions", "answers", "questions", "key_names"} == set(
        type(texts).model_fields
    )
    for kind in kinds:
        found = shortcomings(changed(STUDY, "de", **{kind: LONG}), DISPLAY).problems
        assert [problem.place for problem in found] == [f"text.languages.de.{kind}"], kind
        assert "1920x1080 pixels in letters of 12 px" in found[0].message
        assert "lines where" in found[0].message
    for kind in ("consent", "question", "too_late"):
        found = shortcomings(changed(STUDY, "de", **{kind: WORD}), DISPLAY).problems
        assert "px wide where" in found[0].message, kind
    for kind, value, place in [
        ("instructions", (*texts.instructions, LONG), f"instructions[{len(texts.instructions)}]"),
        ("answers", dict.fromkeys(texts.answers, WORD), "answers"),
        ("key_names", {"space": WORD}, "consent"),
    ]:
        (found, *_) = shortcomings(changed(STUDY, "de", **{kind: value}), DISPLAY).problems
        assert found.place == f"text.languages.de.{place}"
    assert shortcomings(STUDY, DISPLAY).problems == []


@pytest.mark.slow
def test_show_tells_of_each_display_what_check_tells():
    """Before, its table knew of times and stimuli alone."""
    study = changed(STUDY, "de", consent=LONG, question=LONG)
    names, _, _, verdicts = (column.cells for column in _feasibility_table(study, DISPLAY).columns)
    told = dict(zip(names, verdicts, strict=True))
    assert {name.removesuffix(" (chosen)") for name in told} == set(shipped("displays"))
    for name, said in told.items():
        display = load_display(name.removesuffix(" (chosen)"))
        assert said == "\n".join(map(str, shortcomings(study, display).problems))
        assert "must fit on" in said


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ('question = "Were there stripes?"', f'question = "{LONG}"',
         "text.languages.en.question: must fit on 1920x1080 pixels"),
        ('en = "How sure are you?"', f'en = "{LONG}"', "task.confidence.question.en: must fit on"),
        ('"rather sure"', f'"{WORD}"',
         "task.confidence.labels.en: the labels of 4 answers must fit beside each other"),
    ],
)  # fmt: skip
def test_every_door_refuses_what_the_screen_cannot_show(tmp_path, old, new, said):
    path = written(tmp_path, old, new)
    for words in (
        ("protocol", "check", path),
        ("protocol", "show", path, "--script", "--code", "P01"),
        ("protocol", "preview", path, "--out", tmp_path / "page.html"),
        ("session", "simulate", path, "--out", tmp_path / "sessions"),
    ):
        code, told = run(*words)
        assert code == 2, words
        assert said in told, words
        assert "shorten it" in told or "take shorter ones" in told
    assert {each.name for each in tmp_path.iterdir()} == {"study.toml", "stimuli.csv"}


def test_a_session_in_one_language_is_refused_for_a_text_of_another():
    long = changed(STUDY, "de", thanks=LONG)
    with pytest.raises(StudyError, match=r"  text\.languages\.de\.thanks: must fit"):
        require_showable(long, DISPLAY, language="en")


@pytest.mark.parametrize("blank", [" ", "\\n", "\\u200b", "\\u00a0\\u00ad", "\\u3164"])
@pytest.mark.parametrize(
    ("old", "place"),
    [
        ('"Were there stripes?"', "text.languages.en.question"),
        ('"sure"', "task.confidence.labels.en"),
        ('{ yes = "yes"', "text.languages.en.answers.yes"),
        ('"How sure are you?"', "task.confidence.question.en"),
    ],
)
def test_a_text_that_nobody_sees_is_refused(tmp_path, blank, old, place):
    new = f'{{ yes = "{blank}"' if old.startswith("{") else f'"{blank}"'
    code, told = run("protocol", "check", written(tmp_path, old, new))
    assert code == 2
    assert place in told
    assert "at least one character that can be seen" in told


def test_a_long_word_is_whole_and_letters_shrink_for_it():
    maker = PageLayout((960, 540), {}, 128)
    word = "https://example.org/" + "consent-" * 4
    for sheet in (maker.page(word), maker.question(Page("question", word, ()), "", -1)):
        columns = np.flatnonzero(sheet.image()[..., 3].any(axis=0))
        assert 0 < columns[0] <= columns[-1] < 959
        (block, *_) = sheet.blocks
        assert block.width_px >= columns[-1] - columns[0]
    smaller = maker.page(word * 2).blocks[0].face.size_px
    assert smaller < maker.page(word).blocks[0].face.size_px


def test_typing_never_ends_a_session_and_shows_what_was_typed_last():
    maker = PageLayout((640, 480), {}, 128)
    page = Page("question", "What did you look for?", ())
    typed = "first " + "word " * 800 + "last"
    shown = " ".join(maker.question(page, typed, -1).blocks[0].lines)
    assert shown.endswith("last|")
    assert "first" not in shown


def test_the_question_stands_above_the_labels_however_long_it_is():
    for count in (1, 20, 60, 100):
        study = changed(STUDY, "en", question="Which one was it? " * count)
        (asked,) = [s for s in shown_texts(study, DISPLAY, "en") if s.place.endswith("question")][
            :1
        ]
        question, *labels = asked.lay().blocks
        ends = question.top + len(question.lines) * question.face.line_px
        assert ends <= min(label.top for label in labels)


def test_fonts_are_searched_once_for_all_texts_of_a_study(monkeypatch):
    """Before, the folders were read anew for each text: a tenth of a simulated session."""
    text_image._fonts_in.cache_clear()
    text_image._font_for.cache_clear()
    read: list[Path] = []
    rglob = Path.rglob
    monkeypatch.setattr(
        Path, "rglob", lambda path, wanted: read.append(path) or rglob(path, wanted)
    )
    shortcomings(STUDY, DISPLAY)
    assert read
    assert len(read) == len(set(read))


def test_a_simulated_session_loads_no_tracker_and_no_graphics():
    code = "import sys, study_app.simulate; print(*sys.modules)"
    loaded = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True
    ).stdout.split()
    apart = {"eyelink", "lsl", "open_source"}
    assert not {f"study_app.gaze.{name}" for name in apart} & set(loaded)
    assert not {"moderngl", "ssl"} & set(loaded)
