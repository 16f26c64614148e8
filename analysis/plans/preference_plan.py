"""Plan of an analysis of preferences, from a study's protocol or from a plain table."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import Literal

import pandas as pd

from analysis.models.compared_methods import ALL_SIZES, found_pairings
from analysis.parts import AnalysisPlan, SectionKey
from analysis.plans.table_sections import PreferenceTableSection
from protocols.errors import StudyError, did_you_mean
from protocols.recipes.warped_clips import WarpedClips
from protocols.study_file.schema import StudyProtocol
from protocols.tasks.base import Cell
from protocols.tasks.pairs import PairTask, PreferenceAnalysis, Preferences


@dataclass(frozen=True)
class Comparison:
    """One pairing at one size, and how often a participant sees it."""

    method: str
    against: str
    size: str
    scenes: tuple[str, ...]
    repeats: int


@dataclass(frozen=True, kw_only=True)
class PreferencePlan(AnalysisPlan):
    """Names, labels and rules of a study's analysis."""

    section: Preferences
    methods: tuple[str, ...]
    sizes: tuple[str, ...]
    pairings: tuple[tuple[str, str], ...]
    """Methods; whose share is counted comes first."""
    comparisons: tuple[Comparison, ...] = ()
    labels: Mapping[str, str]
    primary: tuple[str, str, str] | None
    """Method, against, and size, "all" for all together; None: a table declares none."""
    planned_participants: int | None = None
    planned_trials: int | None = None

    test = SectionKey[Literal["participant-scene", "participant", "pooled"]]()
    correction = SectionKey[Literal["holm", "none"]]()
    interaction = SectionKey[Literal["size"] | None]()
    smallest_effect_rate = SectionKey[float]()

    @property
    def margin(self) -> float:
        """Smallest effect of interest, as a distance from one half."""
        return self.smallest_effect_rate

    @property
    def counted(self) -> str:
        """Number of methods compared, in words."""
        return f"{len(self.methods)} methods"

    @property
    def compared(self) -> tuple[str, ...]:
        """The column of sizes, where there are several."""
        return ("size",) if self.sized else ()

    @property
    def compared_title(self) -> str:
        """Heading of sizes."""
        return "Size" if self.sized else "Trials"

    @property
    def sized(self) -> bool:
        """True if the study has sizes of disocclusion."""
        return self.sizes not in (("all",), ("",))

    def label(self, name: str) -> str:
        """Return the words that reports print for a method, size or scene."""
        return self.labels.get(name, name)

    def at(self, size: str, form: str = "{}", whole: str = "all sizes") -> str:
        """Return the words for a size, within `form`; empty where the study has no sizes."""
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


def preference_plan(study: StudyProtocol) -> PreferencePlan:
    """Return the plan that a protocol fixes.

    Pairings are turned so that the primary method's share is counted, and the reference is
    always on the other side, as the papers' figures read.
    """
    analysis, task, recipe = study.analysis, study.task, study.stimuli
    if not (isinstance(analysis, PreferenceAnalysis) and isinstance(task, PairTask)):
        raise TypeError(f"a study of preferences is needed (got task {task.kind!r})")
    primary = analysis.primary
    references = {"reference"}
    if isinstance(recipe, WarpedClips):
        references = {method.name for method in recipe.methods if method.is_reference}
    pairings = task.paired(study.pool)
    cells = task.cells(study.pool)
    sizes = tuple(map(str, recipe.values("size"))) or ("",)
    turned = _turned(pairings, primary.method, primary.against, references)
    comparisons = tuple(
        Comparison(
            method, against, size, _scenes(cells, {method, against}, size), study.design.repeats
        )
        for size in sizes
        for method, against in turned
    )
    return PreferencePlan(
        section=analysis,
        study=study.study.name,
        title=study.study.title,
        protocol_sha256=study.sha256,
        methods=tuple(map(str, recipe.values(task.compare))),
        sizes=sizes,
        pairings=turned,
        comparisons=tuple(entry for entry in comparisons if entry.scenes),
        labels=dict(recipe.labels()),
        primary=(primary.method, primary.against, primary.size or "all"),
        planned_participants=study.study.participants,
        planned_trials=sum(
            len(entry.scenes) * entry.repeats for entry in comparisons if entry.scenes
        ),
    )


def preference_plan_of_table(
    decisions: pd.DataFrame, name: str, section: PreferenceTableSection
) -> PreferencePlan:
    """Return the plan of a table without a protocol: every pairing found.

    Raises
    ------
    StudyError
        If the options name methods or comparisons that the table does not have.
    """
    found = found_pairings(decisions)
    methods = section.sort(sorted({method for pairing in found for method in pairing}))
    sizes = tuple(sorted(map(str, decisions["size"].unique())))
    pairs = (pair for pair in combinations(methods, 2) if tuple(sorted(pair)) in found)
    pairings = _asked(pairs, section, methods)
    primary = None
    if section.primary is not None:
        known = {
            f"{one}/{other}" + (f"/{size}" if size else ""): (one, other, size or "all")
            for pair in pairings
            for one, other in (pair, (pair[1], pair[0]))
            for size in ("", *sizes)
        }
        text = "/".join(part.strip() for part in section.primary.split("/"))
        if text not in known:
            raise StudyError(
                f"--set primary={section.primary}: must be a comparison of the table, as"
                f" METHOD/AGAINST ({', '.join('/'.join(pair) for pair in pairings)})"
                f"{did_you_mean(text, known)}"
            )
        primary = known[text]
        pairings = _turned(pairings, primary[0], primary[1], set())
    return PreferencePlan(
        section=section,
        study=name,
        title=name,
        methods=tuple(methods),
        sizes=sizes,
        pairings=pairings,
        labels=section.label,
        primary=primary,
    )


def _asked(
    pairs: Iterable[tuple[str, str]], section: PreferenceTableSection, methods: Sequence[str]
) -> tuple[tuple[str, str], ...]:
    """Return the pairings that are asked for, the way round that they do."""
    asked = {"method": section.method, "against": section.against}
    for key, name in asked.items():
        if name is not None and name not in methods:
            raise StudyError(
                f"--set {key}={name}: must be one of {', '.join(methods)}"
                f"{did_you_mean(name, methods)}"
            )
    found = []
    for pair in pairs:
        ways = [
            way
            for way in (pair, pair[::-1])
            if section.method in (None, way[0]) and section.against in (None, way[1])
        ]
        found += ways[:1]
    if not found:
        raise StudyError(
            f"--set method={section.method}: must be compared with --set"
            f" against={section.against} (no decision does)"
        )
    return tuple(found)


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
