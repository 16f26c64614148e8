"""What an analysis needs to know of a study: from its protocol, or from a plain table."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import Annotated, Literal

import pandas as pd
from pydantic import Field

from analysis.pairings import ALL_SIZES, found_pairings
from analysis.parts import Plan
from analysis.preference import Test
from analysis.tasks.base import NamedOptions
from protocols.errors import StudyError
from protocols.recipes.warped_clips import WarpedClips
from protocols.schema import StudyProtocol
from protocols.suggest import did_you_mean
from protocols.tasks.base import Cell
from protocols.tasks.pairs import PairTask, PreferenceAnalysis


@dataclass(frozen=True)
class Comparison:
    """One pairing at one size, and how often a participant sees it."""

    method: str
    against: str
    size: str
    scenes: tuple[str, ...]
    repeats: int


@dataclass(frozen=True)
class Settings(Plan):
    """Names, labels and rules of a study's analysis.

    `primary` is (method, against, size), size "all" for all together, or None where a plain
    table declares no primary comparison. `margin` is the smallest effect of interest as a
    distance from one half. `pairings` give whose share is counted. `reaction` "models": of
    reaction times too. `interaction` "size": whether preferences differ between sizes.
    """

    study: str
    title: str
    methods: tuple[str, ...]
    sizes: tuple[str, ...]
    pairings: tuple[tuple[str, str], ...]
    comparisons: tuple[Comparison, ...]
    labels: Mapping[str, str]
    primary: tuple[str, str, str] | None
    alpha: float
    margin: float
    test: Test
    correction: Literal["holm", "none"]
    planned_participants: int | None
    planned_trials: int | None
    protocol_sha256: str | None
    reaction: Literal["summary", "models"] = "summary"
    interaction: Literal["size"] | None = None

    alternatives = None

    @property
    def compared(self) -> tuple[str, ...]:
        """The column of sizes, where there are several."""
        return ("size",) if self.sized else ()

    @property
    def compared_title(self) -> str:
        """What heads sizes."""
        return "Size" if self.sized else "Trials"

    @property
    def sized(self) -> bool:
        """Whether the study has sizes of disocclusion."""
        return self.sizes not in (("all",), ("",))

    def label(self, name: str) -> str:
        """Return what reports print for a method, size or scene."""
        return self.labels.get(name, name)

    def at(self, size: str, form: str = "{}", whole: str = "all sizes") -> str:
        """Return what reports call a size, within `form`; empty where the study has no sizes."""
        if not self.sized:
            return ""
        return form.format(whole if size == ALL_SIZES else self.label(size))

    def named(self, method: str, against: str, size: str) -> str:
        """Return a comparison's name: ``A / B, small disocclusion``."""
        return f"{self.label(method)} / {self.label(against)}{self.at(size, ', {}')}"

    def compared_at(
        self, decisions: pd.DataFrame, size: str
    ) -> tuple[pd.DataFrame, tuple[str, ...]]:
        """Return the decisions at one size, and the methods that they compare."""
        together = size == ALL_SIZES and ALL_SIZES not in set(decisions["size"])
        rows = decisions if together else decisions[decisions["size"] == size]
        shown = set(rows["first"]) | set(rows["second"])
        return rows, tuple(name for name in self.methods if name in shown)


def from_protocol(protocol: StudyProtocol) -> Settings:
    """Return the settings a protocol fixes.

    Pairings are turned so that the primary method's share is counted, and the reference is
    always on the other side, as the papers' figures read.
    """
    analysis, task, recipe = protocol.analysis, protocol.task, protocol.stimuli
    if not (isinstance(analysis, PreferenceAnalysis) and isinstance(task, PairTask)):
        raise TypeError(f"a study of preferences is needed (got task {task.kind!r})")
    primary = analysis.primary
    references = {"reference"}
    if isinstance(recipe, WarpedClips):
        references = {method.name for method in recipe.methods if method.is_reference}
    pairings = task.paired(protocol.pool)
    cells = task.cells(protocol.pool)
    sizes = tuple(map(str, recipe.values("size"))) or ("",)
    turned = _turned(pairings, primary.method, primary.against, references)
    comparisons = tuple(
        Comparison(
            method, against, size, _scenes(cells, {method, against}, size), protocol.design.repeats
        )
        for size in sizes
        for method, against in turned
    )
    return Settings(
        study=protocol.study.name,
        title=protocol.study.title,
        methods=tuple(map(str, recipe.values(task.compare))),
        sizes=sizes,
        pairings=turned,
        comparisons=tuple(entry for entry in comparisons if entry.scenes),
        labels=dict(recipe.labels()),
        primary=(primary.method, primary.against, primary.size or "all"),
        alpha=analysis.alpha,
        margin=analysis.smallest_effect_rate,
        test=analysis.test,
        correction=analysis.correction,
        planned_participants=protocol.study.participants,
        planned_trials=sum(
            len(entry.scenes) * entry.repeats for entry in comparisons if entry.scenes
        ),
        protocol_sha256=protocol.sha256,
        reaction=analysis.reaction,
        interaction=analysis.interaction,
    )


class PreferenceOptions(NamedOptions):
    """What a table of preferences may be told."""

    primary: str | None = None
    """The comparison that the report leads with and does not adjust, as METHOD/AGAINST or
    METHOD/AGAINST/SIZE; left out: none."""
    alpha: Annotated[float, Field(gt=0, lt=1)] = 0.05
    """Level of every test."""
    margin: Annotated[float, Field(gt=0, lt=0.5)] = 0.1
    """Smallest effect of interest, as a distance from one half."""
    reaction: Literal["summary", "models"] = "summary"
    """Of reaction times: medians and means, or a model of them too."""
    interaction: Literal["size"] | None = None
    """Tests whether preferences differ between sizes."""


def from_decisions(
    decisions: pd.DataFrame, name: str, options: PreferenceOptions | None = None
) -> Settings:
    """Return settings for a table without a protocol: every pairing found.

    Raises
    ------
    StudyError
        If the options name methods or comparisons that the table does not have.
    """
    options = options or PreferenceOptions()
    found = found_pairings(decisions)
    methods = options.sort(sorted({method for pairing in found for method in pairing}))
    sizes = tuple(sorted(map(str, decisions["size"].unique())))
    pairings = tuple(pair for pair in combinations(methods, 2) if tuple(sorted(pair)) in found)
    primary = None
    if options.primary is not None:
        known = {
            f"{one}/{other}" + (f"/{size}" if size else ""): (one, other, size or "all")
            for pair in pairings
            for one, other in (pair, (pair[1], pair[0]))
            for size in ("", *sizes)
        }
        text = "/".join(part.strip() for part in options.primary.split("/"))
        if text not in known:
            raise StudyError(
                f"--set primary={options.primary}: must be a comparison of the table, as"
                f" METHOD/AGAINST ({', '.join('/'.join(pair) for pair in pairings)})"
                f"{did_you_mean(text, known)}"
            )
        primary = known[text]
        pairings = _turned(pairings, primary[0], primary[1], set())
    return Settings(
        study=name,
        title=name,
        methods=tuple(methods),
        sizes=sizes,
        pairings=pairings,
        comparisons=(),
        labels=options.label,
        primary=primary,
        alpha=options.alpha,
        margin=options.margin,
        test="participant-scene",
        correction="holm",
        planned_participants=None,
        planned_trials=None,
        protocol_sha256=None,
        reaction=options.reaction,
        interaction=options.interaction,
    )


def _scenes(cells: Sequence[Cell], pair: set[str], size: str) -> tuple[str, ...]:
    """Return the scenes in which a pair is compared at a size."""
    found = []
    for cell in cells:
        shown = cell.arrangements[0]
        if str(shown.condition.get("size", "")) == size and pair <= set(
            map(str, shown.condition.values())
        ):
            found.append(cell.scene)
    return tuple(dict.fromkeys(found))


def _turned(
    pairings: Iterable[tuple[str, str]], method: str, against: str, references: set[str]
) -> tuple[tuple[str, str], ...]:
    """Return the primary comparison, then the others of its method; else as they came."""
    return tuple(
        sorted(
            (_turn(pairing, method, against, references) for pairing in pairings),
            key=lambda pair: (pair != (method, against), method not in pair),
        )
    )


def _turn(
    pairing: tuple[str, str], method: str, against: str, references: set[str]
) -> tuple[str, str]:
    first, second = pairing
    backwards = (second, first)
    if {first, second} == {method, against}:
        return (method, against)
    if second == method or (first in references and second not in references):
        return backwards
    return pairing
