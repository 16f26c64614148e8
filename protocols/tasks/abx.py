"""Three stimuli A, B, X; was X the first or the second? The task `abx`."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from itertools import combinations
from typing import TYPE_CHECKING, ClassVar, Literal

from protocols.columns import Column
from protocols.errors import Problem
from protocols.phases import Phase
from protocols.recipes.base import Stimulus
from protocols.session_schema import Analysis
from protocols.tasks.base import (
    Arrangement,
    Cell,
    blank_phase,
    matches,
    shown_phase,
)
from protocols.tasks.rates import RatesAnalysis
from protocols.tasks.single import RightOrWrong
from protocols.units import Name, Scalar, Seconds

if TYPE_CHECKING:
    from protocols.display import Display
    from protocols.schema import StudyProtocol


class AbxAnalysis(RatesAnalysis):
    """Sensitivity by condition, and the level at which it leaves zero."""

    kind: Literal["abx"]
    rule: Literal["differencing", "independent"] = "differencing"
    """How the participant is taken to decide, which turns shares of right answers into d'."""


class Abx(RightOrWrong):
    """Fixation, A, gap, B, gap, X, answer."""

    kind: Literal["abx"]
    standard: dict[Name, Scalar] | None = None
    """What every other stimulus of its scene is compared with: `{ method = "reference" }`."""
    matched: tuple[Name, ...] = ("scene",)
    """The columns in which a stimulus and its standard agree."""
    compare: Name | None = None
    """In place of a standard: the one column in which the two differ, such as `seed`."""
    gap_s: Seconds = 0.5
    """Blank between two stimuli."""

    analysis: ClassVar[type[Analysis]] = AbxAnalysis
    sided: ClassVar[bool] = True
    stimuli_per_trial: ClassVar[int] = 3

    def answers(self) -> tuple[str, ...]:
        """Return the two that X may be."""
        return "a", "b"

    def cells(self, study: StudyProtocol, scenes: Sequence[str]) -> list[Cell]:
        """Return every pair that is compared, each in four arrangements."""
        pairs = self._against_standard if self.standard is not None else self._between
        rank = {scene: place for place, scene in enumerate(scenes)}
        seen: Counter[str] = Counter()
        found = []
        for scene, condition, named in pairs(study, scenes):
            # Each condition has another arrangement in every scene.
            found.append(_cell(scene, condition, named, rank[scene] + seen[scene]))
            seen[scene] += 1
        return found

    def _between(
        self, study: StudyProtocol, scenes: Sequence[str]
    ) -> Iterator[tuple[str, Mapping[str, Scalar], dict[str, str]]]:
        groups = study.stimuli.groups(scenes, self.compare or "")
        for scene, _, stimuli, condition in groups:
            for one, other in combinations(stimuli, 2):
                yield scene, condition, {name: stimuli[name].name for name in (one, other)}

    def _against_standard(
        self, study: StudyProtocol, scenes: Sequence[str]
    ) -> Iterator[tuple[str, Mapping[str, Scalar], dict[str, str]]]:
        pool = study.stimuli.pool()
        where = self.standard or {}
        standards = {self._key(s): s for s in pool if matches(s.condition, where)}
        rank = {scene: place for place, scene in enumerate(scenes)}
        shown = [s for s in pool if s.scene in rank and not matches(s.condition, where)]
        for stimulus in sorted(shown, key=lambda s: rank[s.scene]):
            standard = standards.get(self._key(stimulus))
            if standard is not None:
                names = {"standard": standard.name, "comparison": stimulus.name}
                yield stimulus.scene, stimulus.condition, names

    def _key(self, stimulus: Stimulus) -> tuple[Scalar | None, ...]:
        return tuple(stimulus.condition.get(name) for name in self.matched)

    def phases(self, study: StudyProtocol, display: Display) -> tuple[Phase, ...]:
        """Return A, gap, B, gap, X."""
        shown = [
            shown_phase(study, display, self, name, [(index, 0.0)])
            for index, name in enumerate("abx")
        ]
        gaps = [blank_phase(display, f"gap-{number}", self.gap_s) for number in (1, 2)]
        return shown[0], gaps[0], shown[1], gaps[1], shown[2]

    def durations(self) -> Mapping[str, float]:
        """Return the task's times by key."""
        return {**super().durations(), "gap_s": self.gap_s}

    def shown_s(self, study: StudyProtocol) -> float:
        """Return the length of the three stimuli and their gaps."""
        return 3 * self.single_s(study) + 2 * self.gap_s

    def description(self, study: StudyProtocol) -> str:
        """Return a trial in a sentence."""
        return (
            f"A, B and X ({self.single_s(study):g} s each), blanks of {self.gap_s:g} s between,"
            " answer"
        )

    def right_answer(self) -> str:
        """Return what the three are, and which answer is right."""
        differ = f"A and B differ in {self.compare} alone"
        if self.standard is not None:
            where = ", ".join(f"{column} {value}" for column, value in self.standard.items())
            differ = (
                f"One of A and B is the standard ({where}), the other has the same"
                f" {' and '.join(self.matched)}"
            )
        return f"{differ}; X is one of the two again, and right is which."

    def condition_columns(self, study: StudyProtocol) -> tuple[Column, ...]:
        """Return the columns of the stimuli, and which came as A, B and X."""
        return (
            *(
                Column(name, "value", "", "Column of the stimuli's conditions")
                for name in study.stimuli.columns()
                if name != self.compare
            ),
            *(Column(name, "text", "", f"What was shown as {name.upper()}") for name in "abx"),
        )

    def problems(self, study: StudyProtocol) -> Iterator[Problem]:
        """Yield what does not fit the rest of the study."""
        yield from super().problems(study)
        if (self.standard is None) == (self.compare is None):
            yield Problem("task", "must have either standard or compare")
        elif self.standard is not None:
            yield from self.check_where(study, "task.standard", self.standard)
            yield from self.check_columns(study, "task.matched", self.matched)
            yield from self._standard_problems(study)
        else:
            yield from self.check_columns(study, "task.compare", (str(self.compare),))

    def _standard_problems(self, study: StudyProtocol) -> Iterator[Problem]:
        """Yield a problem where a stimulus has no standard, or more than one."""
        pool, where = study.stimuli.pool(), self.standard or {}
        standards: dict[tuple[Scalar | None, ...], list[str]] = {}
        for stimulus in pool:
            if matches(stimulus.condition, where):
                standards.setdefault(self._key(stimulus), []).append(stimulus.name)
        for key, names in standards.items():
            if len(names) > 1:
                said = ", ".join(f"{c} = {v}" for c, v in zip(self.matched, key, strict=True))
                yield Problem(
                    "task.matched",
                    f"there must be one standard where {said} (got {' and '.join(names[:3])});"
                    " name the column in which they differ too",
                )
        for stimulus in pool:
            if not matches(stimulus.condition, where) and self._key(stimulus) not in standards:
                yield Problem(
                    "task.matched",
                    "every stimulus must have a standard that agrees with it in"
                    f" {', '.join(self.matched)} (there is none for {stimulus.name!r})",
                )
                return


def _cell(scene: str, condition: Mapping[str, Scalar], named: dict[str, str], place: int) -> Cell:
    """Return both orders of A and B, each with X as the one and as the other.

    The right answer alternates, so that any two that follow each other balance it.
    """
    one, other = named
    arrangements = []
    for a, b, x in ((one, other, one), (one, other, other), (other, one, other), (other, one, one)):
        arrangements.append(
            Arrangement(
                {**condition, "a": a, "b": b, "x": x},
                (named[a], named[b], named[x]),
                "a" if x == a else "b",
            )
        )
    return Cell(scene, tuple(arrangements), place)
