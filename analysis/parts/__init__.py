"""Parts of a report: one statistic, one file, from a table to all that readers see of it.

A kind of task is a tuple of parts. Every door (a study's report, a command on one table, a
plug-in) shows all of a part: section, sentences, methods, tables, figures.
Packages add parts by entry points of ``metamerlab.parts``.
"""

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any, ClassVar, Generic, Literal, Protocol, Self, TypeAlias, TypeVar

import numpy as np
import pandas as pd

from analysis import SEED
from analysis.answers import SimulatedAnswers
from analysis.arrays import Floats
from analysis.models.mixed.inference import Draws, Inference
from analysis.plots.style import Figure
from analysis.report.values import as_json
from analysis.showable import FamilyOfTests
from protocols.blocks import Block, Folded, Section
from protocols.disk.hashing import Json
from protocols.errors import StudyError
from protocols.plugins import based_on, misfit, registered
from protocols.tasks.base import Analysis
from protocols.tasks.mixed import MixedAnalysis, Weights

T = TypeVar("T")
V = TypeVar("V")

PartNumbers: TypeAlias = Mapping[str, Any]
"""Numbers of parts by the parts' names."""
EQUIVALENCE = "equivalence"
"""Name of a test that is to show that there is nothing; its power is that without an effect."""
Tests: TypeAlias = Mapping[str, Callable[[], Floats]]
"""Planned tests of simulated studies by name; each gives p (studies, numbers of participants,
comparisons), adjusted."""


_OF_TABLES = {"order", "label", "method", "against"}
"""Keys of sections of tables whose facts are in the plan."""


class SectionKey(Generic[V]):
    """A key of the section `[analysis]`, which its plan gives as its own."""

    def __init__(self, *default: V) -> None:
        self._default = default

    def __set_name__(self, _owner: type, name: str) -> None:
        self._name = name

    def __get__(self, plan: "AnalysisPlan", _owner: type) -> V:
        found: V = getattr(plan.section, self._name, *self._default)
        return found


@dataclass(frozen=True, kw_only=True)
class AnalysisPlan:
    """The section `[analysis]` of a study or of a table, and the facts of what it is about.

    Parts of one family read further facts.
    """

    section: Analysis
    study: str
    """Name of the study, or of the table's file."""
    title: str
    """Title at the top of the page."""
    protocol_sha256: str | None = None
    """Hash of the protocol; None for a plain table."""
    alternatives: int | None = None
    """Number of answers, one of them right; None: not said, or none is right."""

    kind = SectionKey[str]()
    alpha = SectionKey[float]()
    reaction = SectionKey[Literal["summary", "models"]]()
    contrasts = SectionKey[dict[str, Weights]]({})
    bootstrap_draws = SectionKey[int](0)

    @property
    def inference(self) -> Inference:
        """Limits and tests of mixed models, whose draws are the same at every call."""
        rng, count = np.random.default_rng(SEED), self.bootstrap_draws
        draws = Draws(count, rng) if count else None
        return Inference(self.confidence, profile=True, draws=draws)

    def but(self, **changes: Any) -> Self:
        """Return the same plan with some facts, or keys of its section, changed."""
        facts = {key: value for key, value in changes.items() if key in self.facts}
        asked = {key: value for key, value in changes.items() if key not in facts}
        return replace(self, section=self.section.model_copy(update=asked), **facts)

    @property
    def facts(self) -> dict[str, Any]:
        """Values beside the section, by name."""
        return {name: value for name, value in vars(self).items() if name != "section"}

    def said(self) -> dict[str, Json]:
        """Return section and facts as `results.json` has them."""
        section: dict[str, Json] = self.section.model_dump(mode="json", exclude=_OF_TABLES)
        if not isinstance(self.section, MixedAnalysis):
            section |= {"contrasts": {}, "bootstrap_draws": 0}
        return section | {name: as_json(value) for name, value in self.facts.items()}

    @property
    def confidence(self) -> float:
        """Coverage of limits."""
        return 1.0 - self.alpha

    @property
    def limits(self) -> str:
        """Heading of limits: ``95 % limits``."""
        return f"{100 * self.confidence:g} % limits"

    @property
    def compared(self) -> tuple[str, ...]:
        """The columns of the parts' table whose values are compared; none: all rows together."""
        return ()

    @property
    def compared_columns(self) -> tuple[str, ...]:
        """The columns of ``decisions.csv`` that make these values."""
        return self.compared

    @property
    def compared_title(self) -> str:
        """Heading of the compared values."""
        return ", ".join(self.compared) or "Trials"

    @property
    def counted(self) -> str:
        """Comparison in two or three words, for the top of the page."""
        return f"by {', '.join(self.compared)}" if self.compared else "all together"

    def label(self, name: str) -> str:
        """Return the words that reports print for a value."""
        return name

    def in_order(self, names: Sequence[str]) -> list[str]:
        """Return values of the table in the order of the report."""
        return list(names)

    def reference_in(self, _names: Sequence[str]) -> str | None:
        """Return the value that the others are compared with; None: all pairs are."""
        return None


class PartResults(Protocol):
    """Every number of a part: a frozen dataclass, which `results.json` holds by field."""

    @property
    def notes(self) -> tuple[str, ...]:
        """Notes on what is odd about the data as a whole, or why a number is not there."""


@dataclass(frozen=True)
class Estimate:
    """One of the numbers that a study is about, with its limits.

    `what` says of what, and is the same for the same number of other decisions.
    """

    what: str
    value: float
    lower: float
    upper: float
    p: float
    decisions: int


@dataclass(frozen=True)
class PartFigure:
    """A figure by name, its caption, and how to draw it.

    `draw` takes ``width_in``, inches, and ``simulated``: the report says so, and no part forgets.
    """

    name: str
    caption: str
    draw: Callable[..., Figure]

    def marked(self, *, simulated: bool) -> Self:
        """Return the figure of data that are simulated, or not."""
        return replace(self, draw=partial(self.draw, simulated=simulated))


@dataclass(frozen=True)
class Presentation:
    """One statistic as readers see it, whichever door they came by.

    Attributes
    ----------
    lead : sequence of Block
        What stands before all sections: the result in short.
    headline : str
        The result in one sentence; of parts that have one the first counts.
    title : str
        Of the part's section, where it says more than `section`.
    blocks : sequence of Block
        Of the part's section of the page, in reading order; a `FigurePlace` names a figure.
    others : sequence of Folded
        Analyses that answer the same in another way, each with a sentence on why it is there; none
        decides.
    further : sequence of Section
        Other sections, such as of people.
    sentences : sequence of str
        Results ready to paste.
    methods : str
        How they were made, ready to paste: whole sentences.
    tables : mapping of file name to DataFrame
    figures : sequence of PartFigure
    scripts : mapping of file name to text
        Repeat its model from the tables with packages that others wrote (`analysis.repeat`).
    """

    lead: Sequence[Block] = ()
    headline: str = ""
    title: str = ""
    blocks: Sequence[Block] = ()
    others: Sequence[Folded] = ()
    further: Sequence[Section] = ()
    sentences: Sequence[str] = ()
    methods: str = ""
    tables: Mapping[str, pd.DataFrame] = field(default_factory=dict)
    figures: Sequence[PartFigure] = ()
    scripts: Mapping[str, str] = field(default_factory=dict)


P = TypeVar("P", bound=AnalysisPlan, contravariant=True)
R = TypeVar("R", bound=PartResults)


class Part(ABC, Generic[P, R]):
    """A statistic: `P` is the plan that it reads, `R` its numbers."""

    name: ClassVar[str]
    """Name in `results.json`."""
    section: ClassVar[tuple[str, str]]
    """Section of the page: its name and title. Parts of the same name share a section."""
    needs: ClassVar[tuple[str, ...]] = ()
    """Parts whose numbers it reads, such as the comparisons of a Holm family."""
    essential: ClassVar[bool] = False
    """True for the subject of a report: if this part can say nothing, there is no report."""
    beside: ClassVar[tuple[str, str] | None] = None
    """Title and reason, where all that it shows is another analysis."""
    secondary: ClassVar[bool] = False
    """Its test is a question of its own, beside that of the task."""

    def wanted(self, _table: pd.DataFrame, _plan: P) -> bool:
        """Return True if such a table holds what this is about, and the plan asks for it."""
        return True

    @abstractmethod
    def compute(
        self,
        table: pd.DataFrame,
        plan: P,
        found: PartNumbers,
        chance: np.random.Generator,
    ) -> R:
        """Return every number.

        Parameters
        ----------
        table : DataFrame
            Decisions, as the kind of analysis prepares them for its parts.
        found : mapping of part to its numbers
            Of those that this one needs; one that was not wanted, or failed, is not there.
        chance : Generator
            Of this part alone, so that others do not change what it draws.

        Raises
        ------
        ValueError
            If nothing can be said of such a table; the report then says why.
        """

    def planned_p(self, _found: R, _plan: P) -> float | None:
        """Return p of the planned test; None: there is none.

        Of several planned comparisons it is the least, adjusted if the plan corrects for them.
        """
        return None

    def families(self, _cells: pd.DataFrame, _plan: P) -> Sequence[FamilyOfTests]:
        """Return the families of tests that a study plans, that of `planned_p` first.

        `cells` are those of the study's `PowerSimulation`.
        """
        return ()

    def planned_over(self, _answers: SimulatedAnswers, _people: Sequence[int], _plan: P) -> Tests:
        """Return the planned tests of many simulated studies, for `analysis power`.

        Without it, `planned_p` is asked about a table of each, which takes far longer.

        Parameters
        ----------
        people : sequence of int
            The first n participants of a study are a study of n.

        Returns
        -------
        mapping of a test to a function that makes it
            The planned one first, then others by name; ``""`` is the family of comparisons.
        """
        return {}

    def estimates(self, _found: R, _plan: P) -> Sequence[Estimate]:
        """Return the main numbers, which a report gives without exclusions too."""
        return ()

    def planned(self, found: R, plan: P) -> Sequence[Estimate]:
        """Return those of the planned test."""
        return self.estimates(found, plan)

    @abstractmethod
    def show(self, found: R, plan: P) -> Presentation:
        """Return all that readers see of these numbers."""


class SimplePart(Part[P, R]):
    """A part that needs no other, and draws nothing by chance."""

    @abstractmethod
    def of(self, table: pd.DataFrame, plan: P) -> R:
        """Return every number, as `compute` does."""

    def compute(
        self,
        table: pd.DataFrame,
        plan: P,
        _found: PartNumbers,
        _chance: np.random.Generator,
    ) -> R:
        """Return every number."""
        return self.of(table, plan)


AnyPart: TypeAlias = Part[Any, Any]


def computed(
    parts: Sequence[AnyPart],
    table: pd.DataFrame,
    plan: AnalysisPlan,
    step: Callable[[str], None] = lambda _name: None,
) -> tuple[dict[str, Any], tuple[str, ...]]:
    """Compute all parts that are wanted, each after those that it needs.

    Returns
    -------
    found : mapping of part to numbers, in the order of `parts`
    notes : why a part could not be had

    Raises
    ------
    StudyError
        If nothing can be said of what the report is about.
    RuntimeError
        If two parts have one name, or parts need each other in a circle.
    """
    wanted = {one.name: one for one in parts if one.wanted(table, plan)}
    if len({one.name for one in parts}) < len(parts):
        raise RuntimeError(f"parts must have names of their own (got {[p.name for p in parts]})")
    found: dict[str, Any] = {}
    notes: list[str] = []
    waiting = dict(wanted)
    while waiting:
        part = next((p for p in waiting.values() if not waiting.keys() & {*p.needs}), None)
        if part is None:
            raise RuntimeError(f"parts must not need each other in a circle (got {[*waiting]})")
        del waiting[part.name]
        step(part.name.replace("_", " "))
        own = {name: found[name] for name in part.needs if name in found}
        try:
            found[part.name] = part.compute(table, plan, own, np.random.default_rng(SEED))
        except ValueError as problem:
            if part.essential:
                raise StudyError(f"{plan.study}: {problem}") from None
            if str(problem):  # without words: a part that it needs has said why
                notes.append(f"no {part.name.replace('_', ' ')}: {problem}")
    return {name: found[name] for name in wanted if name in found}, tuple(notes)


def estimates_of(
    parts: Sequence[AnyPart], table: pd.DataFrame, plan: AnalysisPlan, *, planned: bool = False
) -> tuple[Estimate, ...]:
    """Return the main numbers of a table, or those of the planned test; no other is computed.

    Raises
    ------
    ValueError or StudyError
        If nothing can be said of these decisions.
    """
    main = {p.name: p for p in parts if type(p).estimates is not Part.estimates}
    asked = set(main)
    for part in parts[::-1]:
        asked |= {*part.needs} if part.name in asked else set()
    found, _ = computed([part for part in parts if part.name in asked], table, plan)
    return tuple(
        one
        for name, part in main.items()
        if name in found
        for one in (part.planned if planned else part.estimates)(found[name], plan)
    )


def tried(make: Callable[[], T], what: str, notes: list[str]) -> T | None:
    """Return the result that the data allow, or None and a note that says why `what` is missing."""
    try:
        return make()
    except ValueError as problem:
        notes.append(f"no {what}: {problem}")
        return None


ADDED: Mapping[str, Callable[[], AnyPart]] = registered(
    "parts", {}, "name a class based on analysis.parts.Part", based_on(Part)
)
"""By name. A report of any kind asks each whether it is `wanted`."""


def with_added(own: Sequence[AnyPart]) -> tuple[AnyPart, ...]:
    """Return the parts of a kind of analysis, and those after them.

    Raises
    ------
    StudyError
        If one takes the name of such a part.
    """
    taken = {part.name for part in own}
    parts = tuple(make() for make in ADDED.values())
    for entry, part in zip(ADDED, parts, strict=True):
        if part.name in taken:
            must = f"name a part with a name of its own, not {part.name!r}, which is taken"
            raise misfit("parts", entry, must, part)
    return (*own, *parts)
