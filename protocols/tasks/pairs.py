"""What tasks share that ask for the preferred of two stimuli: pairs, catch pairs, the table."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, Annotated, ClassVar, Literal

from pydantic import Field

from protocols.adaptive.section import ActivePairs, Adaptive
from protocols.columns import Column
from protocols.errors import Problem
from protocols.recipes.base import SCENE
from protocols.session_schema import Analysis
from protocols.suggest import did_you_mean
from protocols.tasks.base import (
    Arrangement,
    Cell,
    Task,
    all_pairs,
    matches,
    times,
)
from protocols.units import Condition, Model, Name, Positive, Scalar

if TYPE_CHECKING:
    from protocols.journal import Attempt
    from protocols.schema import StudyProtocol


SCENE_COLUMNS = (
    Column("scene", "text", "", "Scene of both stimuli"),
    Column("size", "text", "", "Size of the disocclusion"),
)
PAIR_COLUMNS = (
    Column("first", "text", "", "Method shown in interval 1, or on the left"),
    Column("second", "text", "", "Method shown in interval 2, or on the right"),
    Column("expected", "text", "", "Catch trials: the right answer"),
    Column("first_side", "text", "", "Side of the key that stands for interval 1"),
)
CHOICE_COLUMNS = (
    Column("choice", "text", "", "Which was picked: first or second"),
    Column("chosen", "text", "", "Method picked", ("winner", "preferred", "choice")),
    Column("rejected", "text", "", "Method not picked"),
    Column("chose_first", "0/1", "", "1: the first was picked"),
    Column("chosen_side", "text", "", "Side whose key was pressed"),
    Column("correct", "0/1", "", "Catch trials: 1 if the expected method was picked"),
)


class CatchPair(Model):
    """Catch trials, spread evenly over the blocks."""

    trials: Positive
    """Number of catch trials."""
    better: Name
    """What an attentive participant picks."""
    worse: Name
    """What it is shown against."""
    where: dict[Name, Scalar]
    """Condition in which the difference is obvious, such as `{ size = "large" }`."""


class PrimaryComparison(Model):
    """The comparison that decides the study."""

    method: Name
    """The method expected to be preferred."""
    against: Name
    """The method it is compared with."""
    size: Name | None = None
    """Default: all sizes together."""


class PreferenceAnalysis(Analysis):
    """Preference shares, a scale of all methods, what they depend on."""

    kind: Literal["preference"]
    primary: PrimaryComparison
    """Tested alone, without correction for multiple comparisons."""
    smallest_effect_rate: Annotated[float, Field(ge=1e-4, lt=0.5)] = 0.1
    """Smallest effect of interest: distance of the preference share from one half."""
    test: Literal["participant-scene", "participant", "pooled"] = "participant-scene"
    """Whose variation the test accounts for."""
    correction: Literal["holm", "none"] = "holm"
    """Over all pairings and sizes except the primary comparison."""

    def problems(self, study: StudyProtocol) -> Iterator[Problem]:
        """Yield names that do not exist, and a primary comparison that is not shown."""
        task, primary = study.task, self.primary
        if not isinstance(task, PairTask):
            return
        known = [str(value) for value in study.stimuli.values(task.compare)]
        for key, name in (("method", primary.method), ("against", primary.against)):
            if name not in known:
                yield _unknown(f"analysis.primary.{key}", name, known, task.compare)
        sizes = [str(value) for value in study.stimuli.values("size")]
        if primary.size is not None and primary.size not in sizes:
            yield _unknown("analysis.primary.size", primary.size, sizes, "size")
        pairing = {primary.method, primary.against}
        if len(pairing) == 1:
            yield Problem(
                "analysis.primary.against", f"must differ from method ({primary.method!r})"
            )
        elif (
            pairing <= set(known)
            and task.pairings != "all"
            and pairing not in [set(entry) for entry in task.pairings]
        ):
            yield Problem(
                "analysis.primary",
                f"must compare two methods that the task pairs (got {primary.method!r} against"
                f" {primary.against!r}); add the pairing, or choose another comparison",
            )

    def plain_sentences(self, _study: StudyProtocol) -> list[str]:
        """Return the analysis in sentences."""
        primary = self.primary
        where = f"at size {primary.size}" if primary.size else "over all sizes"
        respected = {
            "participant-scene": "respecting variation of participants and of scenes",
            "participant": "respecting variation of participants",
            "pooled": "taking all trials as independent",
        }[self.test]
        return [
            f"Primary comparison: {primary.method} against {primary.against}, {where}:"
            f" preference rate against one half, two-sided, alpha {self.alpha:g}, {respected}.",
            f"Other comparisons: correction {self.correction}.",
            "Smallest effect of interest: a preference rate"
            f" {self.smallest_effect_rate:g} from one half.",
        ]


class PairTask(Task):
    """Two stimuli that differ in one column of their condition; which is preferred?"""

    compare: Name = "method"
    """The column in which the two stimuli differ."""
    pairings: Annotated[tuple[tuple[Name, Name], ...], Field(min_length=1)] | Literal["all"] = "all"
    """Pairs of its values. `all`: every pair."""
    catch: CatchPair | None = None
    """Catch trials. Default: none."""
    sampling: ActivePairs | None = None
    """Choose pairs by the answers so far, for many methods. Default: every pairing in every
    scene."""

    analysis: ClassVar[type[Analysis]] = PreferenceAnalysis
    stimuli_per_trial: ClassVar[int] = 2

    def paired(self, study: StudyProtocol) -> tuple[tuple[str, str], ...]:
        """Return the compared pairs, each once."""
        if self.pairings == "all":
            return all_pairs(study.stimuli.values(self.compare))
        return self.pairings

    def cells(self, study: StudyProtocol, scenes: Sequence[str]) -> list[Cell]:
        """Return every pair in every scene and size that has stimuli for both."""
        found = []
        for scene, parity, stimuli, condition in study.stimuli.groups(scenes, self.compare):
            for place, pairing in enumerate(self.paired(study)):
                if set(pairing) <= set(stimuli):
                    names = {value: stimuli[value].name for value in pairing}
                    found.append(
                        Cell(scene, self._both_orders(condition, pairing, names), parity + place)
                    )
        return found

    def cell(
        self, study: StudyProtocol, condition: Condition, pairing: tuple[str, str]
    ) -> Cell | None:
        """Return one pair in a scene and size; None where a stimulus is missing."""
        scene = str(condition.get(SCENE, ""))
        for _, parity, stimuli, found in study.stimuli.groups([scene], self.compare):
            if found == condition and set(pairing) <= set(stimuli):
                names = {value: stimuli[value].name for value in pairing}
                return Cell(scene, self._both_orders(found, pairing, names), parity)
        return None

    def catch_cells(self, study: StudyProtocol, scenes: Sequence[str] | None = None) -> list[Cell]:
        """Return the catch pair in every scene that has it; left out: the main ones."""
        if self.catch is None:
            return []
        found = []
        pairing = (self.catch.better, self.catch.worse)
        for scene, _, stimuli, condition in study.stimuli.groups(
            study.main_scenes() if scenes is None else scenes, self.compare
        ):
            if matches(condition, self.catch.where) and set(pairing) <= set(stimuli):
                names = {value: stimuli[value].name for value in pairing}
                found.append(
                    Cell(scene, self._both_orders(condition, pairing, names, self.catch.better))
                )
        return found

    @property
    def catch_trials(self) -> int:
        """How many catch trials there are."""
        return 0 if self.catch is None else self.catch.trials

    def practice_cells(self, study: StudyProtocol, scenes: Sequence[str]) -> list[Cell]:
        """Return all pairs, or those whose answer is known where feedback asks for it."""
        practice = study.design.practice
        if practice is not None and (practice.feedback or practice.criterion_share is not None):
            return self.catch_cells(study, scenes)
        return self.cells(study, scenes)

    @property
    def adaptation(self) -> Adaptive | None:
        """The rule that chooses pairs from the answers."""
        return self.sampling

    def _both_orders(
        self,
        condition: dict[str, Scalar],
        pairing: tuple[str, str],
        names: dict[str, str],
        better: str | None = None,
    ) -> tuple[Arrangement, ...]:
        first, second = self.answers()
        return tuple(
            Arrangement(
                {**condition, first: one, second: other},
                (names[one], names[other]),
                None if better is None else first if one == better else second,
            )
            for one, other in (pairing, pairing[::-1])
        )

    def design_sentence(self, study: StudyProtocol) -> str:
        """Return which pairs are shown how often."""
        if self.sampling is not None:
            return self.sampling.sentence(study)
        pairs = ", ".join(f"{a} / {b}" for a, b in self.paired(study))
        where = "scene and size" if "size" in study.stimuli.columns() else "scene"
        often = times(study.design.repeats)
        return f"pairings {pairs}, each in every {where} {often}, in both orders"

    def catch_sentence(self) -> str:
        """Return what the catch trials show."""
        assert self.catch is not None
        where = ", ".join(f"{column} {value}" for column, value in self.catch.where.items())
        return f"{self.catch.better} against {self.catch.worse}, {where}"

    def condition_columns(self, study: StudyProtocol) -> tuple[Column, ...]:
        """Return scene, size, any other column, and the two values compared."""
        others = [
            name for name in study.stimuli.columns() if name not in ("scene", "size", self.compare)
        ]
        added = [Column(name, "value", "", "Column of the stimuli's table") for name in others]
        return (*SCENE_COLUMNS, *added, *PAIR_COLUMNS)

    def answer_columns(self) -> tuple[Column, ...]:
        """Return what was picked."""
        return CHOICE_COLUMNS

    def row(self, attempt: Attempt) -> dict[str, object]:
        """Return an attempt in these columns."""
        first, second = self.answers()
        condition = dict(attempt.condition)
        shown = {"first": condition.pop(first), "second": condition.pop(second)}
        by_answer = {first: "first", second: "second"}
        expected = by_answer.get(attempt.expected or "")
        choice = by_answer.get(attempt.answer or "")
        return {
            "scene": "",
            "size": "",
            **condition,
            **shown,
            "expected": shown[expected] if expected else None,
            "first_side": "left" if attempt.answers[0] == first else "right",
            "choice": choice,
            "chosen": shown[choice] if choice else None,
            "rejected": shown["second" if choice == "first" else "first"] if choice else None,
            "chose_first": None if choice is None else int(choice == "first"),
            "chosen_side": None
            if attempt.answer is None
            else ("left", "right")[attempt.answers.index(attempt.answer)],
            "correct": None if attempt.correct is None else int(attempt.correct),
        }

    def arranged_columns(self, _study: StudyProtocol) -> frozenset[str]:
        """Return what was first and second: what was picked and what was not tell no order."""
        return frozenset({"first", "second", "choice", "chose_first"})

    def problems(self, study: StudyProtocol) -> Iterator[Problem]:
        """Yield what does not fit the rest of the study."""
        yield from super().problems(study)
        yield from self.check_columns(study, "task.compare", (self.compare,))
        for name in set(self.answers()) & set(study.stimuli.columns()):
            yield Problem(
                "stimuli", f"a column must not be called {name!r}, as an answer is; rename it"
            )
        first: dict[frozenset[tuple[str, Scalar]], str] = {}
        for stimulus in study.stimuli.pool():
            other = first.setdefault(frozenset(stimulus.condition.items()), stimulus.name)
            if other != stimulus.name:
                yield Problem(
                    "stimuli",
                    f"no two stimuli may have one condition (got {other!r} and"
                    f" {stimulus.name!r}), or it is not known which to show; add a column",
                )
                return
        known = [str(value) for value in study.stimuli.values(self.compare)]
        if not known:
            return
        if self.pairings != "all":
            yield from self._pairing_problems(known)
        if self.catch:
            for key, name in (("better", self.catch.better), ("worse", self.catch.worse)):
                if name not in known:
                    yield _unknown(f"task.catch.{key}", name, known, self.compare)
            if self.catch.better == self.catch.worse:
                yield Problem(
                    "task.catch.worse",
                    f"must differ from better (got {self.catch.worse!r} for both)",
                )
            yield from self.check_where(study, "task.catch.where", self.catch.where)

    def _pairing_problems(self, known: list[str]) -> Iterator[Problem]:
        seen: dict[frozenset[str], int] = {}
        for index, pairing in enumerate(self.pairings):
            for place, name in enumerate(pairing):
                if name not in known:
                    yield _unknown(f"task.pairings[{index}][{place}]", name, known, self.compare)
            if pairing[0] == pairing[1]:
                yield Problem(
                    f"task.pairings[{index}]",
                    f"a pairing must hold two different methods (got {pairing[0]!r} twice)",
                )
            elif frozenset(pairing) in seen:
                yield Problem(
                    f"task.pairings[{index}]",
                    f"every pairing must be given once (got {list(pairing)}, which"
                    f" task.pairings[{seen[frozenset(pairing)]}] has); raise repeats instead",
                )
            seen.setdefault(frozenset(pairing), index)


def _unknown(place: str, name: str, known: Sequence[str], column: str) -> Problem:
    return Problem(
        place,
        f"must name one of the {column}s ({', '.join(known)}) (got {name!r})"
        f"{did_you_mean(name, known)}",
    )
