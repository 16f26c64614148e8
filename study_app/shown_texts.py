"""Every text that a participant reads, as a screen shows it; what none can show is refused."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from functools import partial

from protocols.display import Display
from protocols.errors import Problem, StudyError
from protocols.feasibility import check_feasible
from protocols.make_script import example_scripts, text_picture
from protocols.manifest import Manifest
from protocols.phases import STUDY_QUESTION
from protocols.script import Picture, Words
from protocols.study_file.schema import StudyProtocol
from protocols.study_file.session_schema import consent_text, filled_text
from protocols.tasks.confidence_question import CONFIDENCE
from study_app.pages import PageLayout, Sheet, UnfitLabelsError, words_sheet
from study_app.stage import Page
from study_app.text_image import UnwritableError


@dataclass(frozen=True)
class ShownText:
    """A text that is shown on a screen of its own."""

    name: str
    """Name of the page."""
    says: str
    """Occasion on which it is shown."""
    place: str
    """In the study's file."""
    text: str
    """All of it, placeholders filled."""
    lay: Callable[[], Sheet]
    """Lays it out; `StudyError` where it does not fit or cannot be written."""
    labels: str = ""
    """Place of the labels below it."""


@dataclass
class Shortcomings:
    """Parts of a study that a display, or the fonts of this machine, cannot show."""

    problems: list[Problem] = field(default_factory=list)
    unwritten: dict[str, str] = field(default_factory=dict)
    """Reasons why no font here writes the texts of a language."""


def shortcomings(
    study: StudyProtocol, display: Display, manifest: Manifest | None = None
) -> Shortcomings:
    """Return all that cannot be shown: times, stimuli, and texts in every language."""
    found = Shortcomings(check_feasible(study, display, manifest))
    for language in study.text.languages:
        for shown in shown_texts(study, display, language):
            try:
                shown.lay()
            except UnwritableError as error:
                found.unwritten[language] = str(error)
                break
            except StudyError as error:
                place = shown.labels if isinstance(error, UnfitLabelsError) else shown.place
                problem = Problem(place, str(error).removeprefix("text: "))
                if problem not in found.problems:  # of both orders of keys
                    found.problems.append(problem)
    return found


def require_showable(
    study: StudyProtocol,
    display: Display,
    manifest: Manifest | None = None,
    language: str | None = None,
) -> dict[str, str]:
    """Refuse what cannot be shown, before anything is.

    Returns
    -------
    dict
        Why no font here writes a language, of each that none writes.

    Raises
    ------
    StudyError
        With one line per problem; or if no font of this machine writes `language`.
    """
    found = shortcomings(study, display, manifest)
    if found.problems:
        raise StudyError(
            f"study {study.study.name!r} must be feasible on display {display.name!r}:\n"
            + "\n".join(f"  {problem}" for problem in found.problems)
        )
    if language in found.unwritten:
        raise StudyError(found.unwritten[language])
    return found.unwritten


def shown_texts(study: StudyProtocol, display: Display, language: str) -> Iterator[ShownText]:
    """Yield every text that a participant reads in one language."""
    texts, response = study.text.languages[language], study.response
    section = f"text.languages.{language}"
    size = display.width_px, display.height_px
    maker = PageLayout(size, texts.key_names, round(255 * study.display.background))
    key, blocks = response.continue_keys[0], study.design.blocks
    pages = [
        ("consent", "First", "consent", consent_text(texts, study.privacy.contact)),
        *(
            (f"instructions-{place + 1}", "Instructions", f"instructions[{place}]", text)
            for place, text in enumerate(texts.instructions)
        ),
        ("start", "Before the first block", "start", texts.start),
        ("paused", "After the pause key", "paused", texts.paused),
        ("quit", "After the quit key", "quit_question", texts.quit_question),
    ]
    if study.design.practice:
        pages.insert(-3, ("practice", "Before practice", "practice", texts.practice))
    if blocks > 1:
        pages.insert(-2, ("break", "Between two blocks", "break_page", texts.break_page))
    for name, says, place, text in pages:
        full = filled_text(text, response, done=max(1, blocks - 1), total=blocks)
        yield ShownText(name, says, f"{section}.{place}", full, partial(maker.page, full, key))
    for number, question in enumerate(texts.questions):
        page = Page("question", filled_text(question.text, response), (), choices=question.choices)
        yield ShownText(
            f"question-{number + 1}",
            "At the end",
            f"{section}.questions[{number}]",
            "\n".join((page.text, *page.choices)),
            partial(maker.question, page, "", 0),
        )
    thanks = filled_text(texts.thanks, response)
    yield ShownText("thanks", "Last", f"{section}.thanks", thanks, partial(maker.page, thanks))
    yield from _questions(study, display, language)
    for place, says, said in (
        ("preparing", "While stimuli are loaded", texts.preparing),
        ("gaze_lost", "After gaze left the dot", texts.gaze_lost),
        ("too_late", "After an answer that came too late", texts.too_late),
        ("right", "After a right answer in practice", texts.right),
        ("wrong", "After a wrong answer in practice", texts.wrong),
    ):
        if said:
            yield _words(
                place.replace("_", "-"),
                says,
                f"{section}.{place}",
                text_picture(study, display, said),
            )


def _questions(study: StudyProtocol, display: Display, language: str) -> Iterator[ShownText]:
    """Yield the questions of trials, with both orders of keys."""
    try:
        scripts = example_scripts(study, display, language)
    except StudyError:  # `protocols.feasibility` says why
        return
    section = f"text.languages.{language}"
    places = {
        STUDY_QUESTION.name: (f"{section}.question", f"{section}.answers"),
        CONFIDENCE: (f"task.confidence.question.{language}", f"task.confidence.labels.{language}"),
    }
    orders = 1 if study.design.side == "fixed" else 2
    asked = {
        picture: phase
        for script in scripts[:orders]
        for phase in script.phases
        for picture in phase.show
        if isinstance(picture, Picture) and isinstance(picture.of, Words) and phase.question
    }
    for picture, phase in asked.items():
        question = phase.question
        assert question
        place, labels = places.get(question.name, (f"task: phase {phase.name!r}",) * 2)
        name = "-".join((question.name, *question.answers))
        yield _words(name, "While the answer is awaited", place, picture, labels)


def _words(name: str, says: str, place: str, picture: Picture, labels: str = "") -> ShownText:
    words = picture.of
    assert isinstance(words, Words)
    under = map("{} [{}]".format, words.labels, words.keys)
    text = "\n".join((words.text, *under))
    return ShownText(name, says, place, text, partial(words_sheet, words), labels)
