"""Confidence: a second question after the answer, `[task.confidence]`."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Annotated

from pydantic import Field

from protocols.columns import Column
from protocols.errors import Problem
from protocols.journal import Attempt
from protocols.phases import Phase, Question, QuestionText
from protocols.study_file.session_schema import Keys, Response, TextSection, unknown_placeholders
from protocols.units import LanguageCode, Model, Text

CONFIDENCE = "confidence"
"""Name of the question, and of its phase."""
_DIGITS = 9
COLUMNS = (
    Column(CONFIDENCE, "integer", "", "Confidence in the answer, in steps from 1, the least"),
    Column(f"{CONFIDENCE}_rt_s", "number", "s", "Time from that question to its key press"),
)


class Confidence(Model):
    """Confidence of a participant, asked after each answer, without a time limit."""

    steps: Annotated[int, Field(ge=2, le=11)]
    """Number of steps, from the least sure."""
    question: Annotated[dict[LanguageCode, Text], Field(min_length=1)]
    """Text of the question, by language."""
    labels: Annotated[dict[LanguageCode, tuple[Text, ...]], Field(default_factory=dict)]
    """A label per step, by language. Default: the numbers of the steps."""
    keys: tuple[Keys, ...] = ()
    """A list of keys per step. Default, for up to 9 steps: the digits from 1."""

    @property
    def answers(self) -> tuple[str, ...]:
        """The numbers of the steps, as names of answers."""
        return tuple(str(step) for step in range(1, self.steps + 1))

    @property
    def all_keys(self) -> tuple[Keys, ...]:
        """A list of keys per step."""
        return self.keys or tuple((answer,) for answer in self.answers[:_DIGITS])

    def labelled(self, language: str) -> tuple[str, ...]:
        """Return the label of each step."""
        return self.labels.get(language, self.answers)

    def phase(self) -> Phase:
        """Return the phase that asks it."""
        labels = {language: self.labelled(language) for language in self.question}
        question = Question(CONFIDENCE, self.answers, self.all_keys, self.question, labels)
        return Phase(CONFIDENCE, None, (QuestionText(),), asks=question)

    def row(self, attempt: Attempt) -> Mapping[str, object]:
        """Return an attempt's values in `COLUMNS`."""
        for given in attempt.further:
            if given.question == CONFIDENCE:
                return {CONFIDENCE: int(given.answer), f"{CONFIDENCE}_rt_s": given.rt_s}
        return {}

    def problems(self, response: object, text: object) -> Iterator[Problem]:
        """Yield steps without keys or labels, keys that do two things, languages that differ."""
        keys = self.all_keys
        if len(keys) != self.steps:
            yield Problem(
                "task.confidence.keys",
                f"must have a list of keys for each of the {self.steps} steps (got"
                f" {len(self.keys)}); give every step one, or leave keys out for up to {_DIGITS}",
            )
        taken: dict[str, str] = {}
        if isinstance(response, Response):
            taken = dict.fromkeys(response.pause_keys, "response.pause_keys")
            taken |= dict.fromkeys(response.quit_keys, "response.quit_keys")
        for step, names in enumerate(keys):
            for name in names:
                if name in taken:
                    yield Problem(
                        f"task.confidence.keys[{step}]",
                        f"a key must do one thing (got {name!r}, which {taken[name]} has); give"
                        " the step another key",
                    )
                taken.setdefault(name, f"task.confidence.keys[{step}]")
        languages = text.languages if isinstance(text, TextSection) else self.question
        for key, by_language in (("question", self.question), ("labels", self.labels)):
            missing, other = set(languages) - set(by_language), set(by_language) - set(languages)
            if by_language and (missing or other):
                cures = [f"add {', '.join(sorted(missing))}"] if missing else []
                cures += [f"leave out {', '.join(sorted(other))}"] if other else []
                yield Problem(
                    f"task.confidence.{key}",
                    f"must be in the languages of the study: {', '.join(languages)} (got"
                    f" {', '.join(by_language)}); {' and '.join(cures)}",
                )
        for language, said in self.question.items():
            for wrong in unknown_placeholders(said):
                yield Problem(f"task.confidence.question.{language}", wrong)
        for language, labels in self.labels.items():
            if len(labels) != self.steps:
                yield Problem(
                    f"task.confidence.labels.{language}",
                    f"must label each of the {self.steps} steps (got {len(labels)} labels); give"
                    " one per step and its keys, or change steps",
                )
