"""Tasks that ask for the preferred of two stimuli: pairs, catch pairs, the table.

`two-alternative` shows both side by side, `two-interval` one after the other.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Annotated, ClassVar, Literal

from pydantic import Field

from protocols.columns import Column
from protocols.disk.hashing import Chance
from protocols.display import Display
from protocols.errors import Problem, StudyError, did_you_mean
from protocols.journal import Attempt
from protocols.phases import Phase
from protocols.recipes.base import SCENE, Group, Pool
from protocols.tasks.base import (
    Adaptive,
    Analysis,
    Arrangement,
    Cell,
    Slot,
    Task,
    Turn,
    all_pairs,
    in_turn,
    matches,
    shown_phase,
    times,
)
from protocols.units import Condition, Degrees, Model, Name, Positive, Scalar, Seconds

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
    Column("choice", "text", "", "Interval or side picked: first or second"),
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
    """Value that an attentive participant picks."""
    worse: Name
    """Value that it is shown against."""
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


class Preferences(Analysis):
    """Tests of preferences, whatever is compared."""

    added_later: ClassVar[tuple[str, ...]] = (*Analysis.added_later, "interaction")

    smallest_effect_rate: Annotated[float, Field(ge=1e-4, lt=0.5)] = 0.1
    """Smallest effect of interest: distance of the preference share from one half."""
    test: Literal["participant-scene", "participant", "pooled"] = "participant-scene"
    """Units whose variation the test accounts for."""
    correction: Literal["holm", "none"] = "holm"
    """Over all pairings and sizes except the primary comparison."""
    interaction: Literal["size"] | None = None
    """Tests whether preferences differ between sizes, that of the primary comparison by itself.
    Default: not tested."""


class PreferenceAnalysis(Preferences):
    """Preference shares, a scale of all methods, what they depend on."""

    kind: Literal["preference"]
    primary: PrimaryComparison
    """Tested alone, without correction for multiple comparisons."""

    def problems(self, task: Task, pool: Pool, /) -> Iterator[Problem]:
        """Yield names that do not exist, and a primary comparison that is not shown."""
        primary = self.primary
        if not isinstance(task, PairTask):
            return
        known = [str(value) for value in pool.stimuli.values(task.compare)]
        for key, name in (("method", primary.method), ("against", primary.against)):
            if name not in known:
                yield _unknown(f"analysis.primary.{key}", name, known, task.compare)
        sizes = [str(value) for value in pool.stimuli.values("size")]
        if primary.size is not None and primary.size not in sizes:
            yield _unknown("analysis.primary.size", primary.size, sizes, "size")
        if self.interaction is not None and len(sizes) < 2:
            yield Problem(
                "analysis.interaction",
                f"must have two sizes to compare (the stimuli have {len(sizes)}); leave it out",
            )
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

    def plain_sentences(self, _task: Task, _pool: Pool) -> list[str]:
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
            *[
                f"Interaction: whether the preference of {primary.method} over {primary.against}"
                " differs between sizes, as a difference of shares with clustered errors and as a"
                f" difference of JOD, two-sided, alpha {self.alpha:g}; of other pairings"
                " Holm-adjusted."
            ]
            * (self.interaction is not None),
        ]


class ActivePairs(Adaptive):
    """The pairs whose answers are expected to tell most, chosen in batches (ASAP)."""

    rule: Literal["active-pairs"]

    def slots(self, task: Task, pool: Pool, chance: Chance) -> list[Slot]:
        """Return scenes and sizes in random order, each as often as the others."""
        groups = self._groups(task, pool)
        slots: list[Slot] = []
        while len(slots) < self.trials:
            slots += chance.shuffled([Slot("pairs", condition) for condition in groups])
        return slots[: self.trials]

    def choose(self, task: Task, pool: Pool, turn: Turn) -> Cell:
        """Return the next pair of the present batch, in the trial's scene and size."""
        from protocols.adaptive.active_pairs import next_batch

        assert isinstance(task, PairTask)
        past = turn.past
        methods = [str(value) for value in pool.stimuli.values(task.compare)]
        first, second = task.answers()
        batch = len(past) // (len(methods) - 1)
        wins = [[0.0] * len(methods) for _ in methods]
        for attempt in past[: batch * (len(methods) - 1)]:
            one, other = str(attempt.condition[first]), str(attempt.condition[second])
            won, lost = (one, other) if attempt.answer == first else (other, one)
            wins[methods.index(won)][methods.index(lost)] += 1
        drawn = turn.chance("pairs", batch)
        # Shuffled: a batch may have one method in many of its pairs.
        pairs = drawn.shuffled(next_batch(wins, drawn))
        i, j = pairs[len(past) % len(pairs)]
        cell = task.cell(pool, turn.condition, (methods[i], methods[j]))
        if cell is None:
            raise StudyError(
                f"task.sampling: there must be stimuli of {methods[i]!r} and {methods[j]!r} in"
                f" {dict(turn.condition)}"
            )
        return cell

    def problems(self, task: Task, pool: Pool) -> Iterator[Problem]:
        """Yield a problem where a scene lacks a stimulus that others have."""
        yield from super().problems(task, pool)
        assert isinstance(task, PairTask)
        if task.pairings != "all":
            yield Problem("task.pairings", "must be left out where sampling chooses the pairs")
        methods = len(pool.stimuli.values(task.compare))
        groups = pool.stimuli.groups(pool.scenes, task.compare)
        if any(len(stimuli) < methods for _, _, stimuli, _ in groups):
            yield Problem(
                "task.sampling",
                "every scene and size must have stimuli of every method, so that any pair can be"
                " shown anywhere; leave scenes without a reference out",
            )

    def sentence(self, task: Task, pool: Pool) -> str:
        """Return a sentence on how pairs are chosen."""
        assert isinstance(task, PairTask)
        methods = len(pool.stimuli.values(task.compare))
        return (
            f"{self.trials} pairs of {methods} methods, chosen in batches by the information that"
            " their answers are expected to give"
        )

    def _groups(self, task: Task, pool: Pool) -> list[Condition]:
        """Return the scenes and sizes in which methods are compared."""
        assert isinstance(task, PairTask)
        groups = pool.stimuli.groups(pool.scenes, task.compare)
        return [condition for _, _, stimuli, condition in groups if len(stimuli) > 1]


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
    decides: ClassVar[bool] = True

    def paired(self, pool: Pool) -> tuple[tuple[str, str], ...]:
        """Return the compared pairs, each once."""
        if self.pairings == "all":
            return all_pairs(pool.stimuli.values(self.compare))
        return self.pairings

    def cells(self, pool: Pool) -> list[Cell]:
        """Return every pair in every scene and size that has stimuli for both."""
        return [
            cell
            for group in pool.stimuli.groups(pool.scenes, self.compare)
            for place, pairing in enumerate(self.paired(pool))
            for cell in self._of_group(group, pairing, group.parity + place)
        ]

    def cell(self, pool: Pool, condition: Condition, pairing: tuple[str, str]) -> Cell | None:
        """Return one pair in a scene and size; None where a stimulus is missing."""
        groups = pool.stimuli.groups([str(condition.get(SCENE, ""))], self.compare)
        alike = (group for group in groups if group.condition == condition)
        found = (cell for one in alike for cell in self._of_group(one, pairing, one.parity))
        return next(found, None)

    def catch_cells(self, pool: Pool) -> list[Cell]:
        """Return the catch pair in every scene that has it."""
        if (catch := self.catch) is None:
            return []
        return [
            cell
            for group in pool.stimuli.groups(pool.scenes, self.compare)
            if matches(group.condition, catch.where)
            for cell in self._of_group(group, (catch.better, catch.worse), 0, catch.better)
        ]

    @property
    def catch_trials(self) -> int:
        """Number of catch trials."""
        return 0 if self.catch is None else self.catch.trials

    def judged_cells(self, pool: Pool) -> list[Cell]:
        """Return the catch pairs: their answer is known."""
        return self.catch_cells(pool)

    @property
    def adaptation(self) -> Adaptive | None:
        """The rule that chooses pairs from the answers."""
        return self.sampling

    def _of_group(
        self, group: Group, pairing: tuple[str, str], parity: int, better: str | None = None
    ) -> Iterator[Cell]:
        """Yield a pair in both orders, where the group has stimuli for both."""
        if set(pairing) <= set(group.stimuli):
            first, second = self.answers()
            orders = (
                Arrangement(
                    {**group.condition, first: one, second: other},
                    (group.stimuli[one].name, group.stimuli[other].name),
                    None if better is None else first if one == better else second,
                )
                for one, other in (pairing, pairing[::-1])
            )
            yield Cell(group.scene, tuple(orders), parity)

    def design_sentence(self, pool: Pool) -> str:
        """Return a sentence on the pairs that are shown, and how often."""
        if self.sampling is not None:
            return self.sampling.sentence(self, pool)
        pairs = ", ".join(f"{a} / {b}" for a, b in self.paired(pool))
        where = "scene and size" if "size" in pool.stimuli.columns() else "scene"
        often = times(pool.repeats)
        return f"pairings {pairs}, each in every {where} {often}, in both orders"

    def catch_sentence(self) -> str:
        """Return a sentence on the catch trials."""
        assert self.catch is not None
        where = ", ".join(f"{column} {value}" for column, value in self.catch.where.items())
        return f"{self.catch.better} against {self.catch.worse}, {where}"

    def condition_columns(self, pool: Pool) -> tuple[Column, ...]:
        """Return scene, size, any other column, and the two values compared."""
        others = [
            name for name in pool.stimuli.columns() if name not in ("scene", "size", self.compare)
        ]
        added = [Column(name, "value", "", "Column of the stimuli's table") for name in others]
        return (*SCENE_COLUMNS, *added, *PAIR_COLUMNS)

    def answer_columns(self) -> tuple[Column, ...]:
        """Return the columns of the method that was picked."""
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

    def arranged_columns(self, _pool: Pool) -> frozenset[str]:
        """Return the columns of first and second: the picked and the other tell no order."""
        return frozenset({"first", "second", "choice", "chose_first"})

    def problems(self, pool: Pool) -> Iterator[Problem]:
        """Yield all that does not fit the rest of the study."""
        yield from super().problems(pool)
        yield from pool.check_columns("task.compare", (self.compare,))
        for name in set(self.answers()) & set(pool.stimuli.columns()):
            yield Problem(
                "stimuli", f"a column must not be called {name!r}, as an answer is; rename it"
            )
        first: dict[frozenset[tuple[str, Scalar]], str] = {}
        for stimulus in pool.stimuli.pool():
            other = first.setdefault(frozenset(stimulus.condition.items()), stimulus.name)
            if other != stimulus.name:
                yield Problem(
                    "stimuli",
                    f"no two stimuli may have one condition (got {other!r} and"
                    f" {stimulus.name!r}), or it is not known which to show; add a column",
                )
                return
        known = [str(value) for value in pool.stimuli.values(self.compare)]
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
            yield from pool.check_where("task.catch.where", self.catch.where)

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


class TwoInterval(PairTask):
    """Fixation, interval 1, gap, interval 2, answer."""

    kind: Literal["two-interval"]
    gap_s: Seconds = 0.5
    """Blank between the intervals."""

    every_answer: ClassVar[tuple[str, ...]] = ("first", "second")

    def phases(self, pool: Pool, display: Display) -> tuple[Phase, ...]:
        """Return interval 1, gap, interval 2."""
        return in_turn(pool, display, self, self.every_answer, self.gap_s)

    def durations(self) -> Mapping[str, float]:
        """Return the task's times by key."""
        return {**super().durations(), "gap_s": self.gap_s}

    def shown_s(self, pool: Pool) -> float:
        """Return the length of both intervals and the gap."""
        return 2 * self.single_s(pool) + self.gap_s

    def description(self, pool: Pool) -> str:
        """Return a trial in a sentence."""
        what = "still" if pool.stimuli.clip_s is None else "clip"
        return (
            f"first {what} ({self.single_s(pool):g} s), blank {self.gap_s:g} s, second {what},"
            " answer"
        )


class TwoAlternative(PairTask):
    """Fixation, both stimuli side by side, answer."""

    kind: Literal["two-alternative"]
    separation_deg: Degrees
    """Between the centres of the two."""

    sided: ClassVar[bool] = True
    every_answer: ClassVar[tuple[str, ...]] = ("left", "right")

    def phases(self, pool: Pool, display: Display) -> tuple[Phase, ...]:
        """Return the one phase that shows both."""
        half_deg = self.separation_deg / 2
        return (shown_phase(pool, display, self, "both", [(0, -half_deg), (1, half_deg)]),)

    def shown_s(self, pool: Pool) -> float:
        """Return the time for which both are shown."""
        return self.single_s(pool)

    def description(self, pool: Pool) -> str:
        """Return a trial in a sentence."""
        what = "stills" if pool.stimuli.clip_s is None else "clips"
        return (
            f"two {what} side by side, {self.separation_deg:g} deg apart, for"
            f" {self.single_s(pool):g} s, answer"
        )
