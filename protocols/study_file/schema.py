"""A study protocol: stimuli by recipe, a task, an analysis, and what is common to all."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import replace
from functools import reduce
from operator import or_
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Literal

from pydantic import Field, PrivateAttr, model_validator

from protocols.adaptive.section import AdaptiveLevels
from protocols.columns import COMMON_COLUMNS
from protocols.disk.hashing import sha256_bytes, sha256_json
from protocols.errors import Problem, StudyError
from protocols.gone import as_hashed, gone
from protocols.plugins import culprit
from protocols.recipes.base import SCENE, Pool, Recipe
from protocols.recipes.recipe_kinds import RECIPES
from protocols.recipes.warped_clips import WarpedClips
from protocols.study_file.cross_check import cross_check
from protocols.study_file.session_schema import (
    Design,
    Gaze,
    Headset,
    Privacy,
    Response,
    StudyDisplay,
    StudyInfo,
    TextSection,
    TrialTiming,
    Web,
)
from protocols.tasks.base import Analysis, Cell, Task
from protocols.tasks.task_kinds import TASKS, check_returns
from protocols.units import ExtendedModel

if TYPE_CHECKING:
    AnyRecipe = Recipe
    AnyTask = Task
    AnyAnalysis = Analysis
else:  # what is registered, plug-ins included: known when the program starts
    _KIND = Field(discriminator="kind")
    AnyRecipe = Annotated[reduce(or_, RECIPES.values()), _KIND]
    AnyTask = Annotated[reduce(or_, (kind.task for kind in TASKS.values())), _KIND]
    AnyAnalysis = Annotated[
        reduce(or_, dict.fromkeys(kind.task.analysis for kind in TASKS.values())), _KIND
    ]


class StudyProtocol(ExtendedModel):
    """A whole study. Two studies with equal hashes are the same study."""

    added_later: ClassVar[tuple[str, ...]] = ("web",)

    format: Literal[2]
    """Version of the file format."""
    study: StudyInfo
    """Name, title, planned number of participants."""
    display: StudyDisplay
    """The display, and the grey around the stimuli."""
    stimuli: AnyRecipe
    """The recipe: where the stimuli come from."""
    task: AnyTask
    """Task of a participant in a trial."""
    design: Design
    """Repeats, order, blocks, practice."""
    trial: TrialTiming
    """Times around the stimuli, fixation target, tolerated dropped frames."""
    gaze: Gaze
    """Rules for gaze, and what happens when it breaks them."""
    response: Response
    """Keys and time-out."""
    text: TextSection
    """Everything a participant reads."""
    analysis: AnyAnalysis
    """Tests and exclusions, fixed before data collection."""
    privacy: Privacy
    """Participant codes, consent, what is stored."""
    web: Web | None = None
    """Settings for a browser. Default: at the desk only."""
    _secret: str | None = PrivateAttr(default=None)
    _order_seed: int | None = PrivateAttr(default=None)
    _place_seed: int | None = PrivateAttr(default=None)
    _at_home: bool = PrivateAttr(default=False)
    _gone: dict[str, object] = PrivateAttr(default_factory=dict)

    @model_validator(mode="after")
    def _sections_agree(self) -> StudyProtocol:
        try:
            problems = problems_between(
                {name: getattr(self, name) for name in type(self).model_fields}
            )
        except (AssertionError, ValueError) as error:  # no mistake of the study
            if said := culprit(error):
                raise StudyError(said) from error
            raise
        if problems:
            raise ValueError("\n".join(map(str, problems)))
        return self

    @property
    def sha256(self) -> str:
        """Hash of everything the protocol says, and said in keys that were removed since."""
        plain = without_nothing(self.model_dump(mode="json"))
        for place, value in self._gone.items():
            section, _, key = place.partition(".")
            if (hashed := as_hashed(place, value)) is not None:
                plain[section][key] = hashed
        return sha256_json(plain)

    @property
    def gone_notes(self) -> list[str]:
        """Sentences on keys of a recorded study that were removed since, and are ignored."""
        return [f"{place} is ignored: it {gone(place)}" for place in self._gone]

    @property
    def order_seed(self) -> int:
        """Seed of the order of trials: the design's seed, with the study's secret if it has one; in
        a browser, the participant's own.

        Raises
        ------
        StudyError
            If the study has a secret, and it is not here.
        """
        if self._order_seed is not None:
            return self._order_seed
        if self.privacy.secret_sha256 is None:
            return self.design.seed
        return int(sha256_bytes(f"{self._known_secret}:{self.design.seed}".encode())[:15], 16)

    @property
    def place_seed(self) -> int:
        """Seed of places in the counterbalancing: the order's, or the export's key."""
        return self.order_seed if self._place_seed is None else self._place_seed

    @property
    def places_key(self) -> int | None:
        """Key by which all browsers of a study draw places; None where places are not drawn.

        Every export holds it: a hash, so that it tells neither the secret nor the order at the
        desk. `StudyError` as `order_seed` says.
        """
        if self.design.places != "drawn":
            return None
        secret = "" if self.privacy.secret_sha256 is None else self._known_secret
        label = f"places in browsers:{self.study.name}:{secret}"
        return int(sha256_bytes(label.encode())[:14], 16) >> 3  # 53 bits

    @property
    def _known_secret(self) -> str:
        if self._secret is None:
            raise StudyError(
                "privacy.secret_sha256: the study's secret must lie beside the study file, as"
                " NAME.secret (it does not): without it, the order of trials is not known. Copy it"
                " from the lab's folder; it cannot be made again"
            )
        return self._secret

    def with_secret(self, secret: str) -> StudyProtocol:
        """Return the same study with its secret at hand."""
        return self._beside("_secret", secret)

    def with_gone(self, said: dict[str, object]) -> StudyProtocol:
        """Return the same study with what its removed keys said, by dotted place."""
        return self._beside("_gone", said)

    def ordered_by(self, seed: int, places_key: int | None = None) -> StudyProtocol:
        """Return the same study with the seed of the order that one participant drew.

        Places in the counterbalancing follow from the export's key; left out: from the seed, too.
        """
        return self.at_home()._beside("_order_seed", seed)._beside("_place_seed", places_key)

    def at_home(self) -> StudyProtocol:
        """Return the same study as planned for browsers: with a share of the scenes, if it says."""
        return self._beside("_at_home", True)

    @property
    def headset(self) -> Headset | None:
        """Headset that the study runs in; None where it runs on a screen."""
        return self.web.headset if self.web is not None else None

    @property
    def scene_share(self) -> float:
        """Share of the scenes that one participant is shown: all, unless at home."""
        return self.web.share if self.web is not None and self._at_home else 1.0

    def _beside(self, name: str, value: object) -> StudyProtocol:
        copy = self.model_copy()
        setattr(copy, name, value)
        return copy

    def in_a_browser(self) -> StudyProtocol:
        """Return the study as a browser runs it: no gaze is watched.

        Raises
        ------
        StudyError
            If the study does not say that this is meant.
        """
        if self.stimuli.follows_gaze:
            raise StudyError(
                f"stimuli.live: {self.study.name!r} has pictures that follow the gaze, which no"
                " browser watches; run it at a desk, or leave live out"
            )
        if self.web is not None:
            gaze = self.gaze.model_copy(update={"mode": "none"})
            return self.model_copy(update={"gaze": gaze}).at_home()
        watched = (
            f"; the study watches gaze (gaze.mode = {self.gaze.mode!r}), which a browser cannot"
            if self.gaze.mode != "none"
            else ""
        )
        raise StudyError(
            f"web: a study that runs in a browser must have a section [web] (it has none){watched};"
            ' add [web] with gaze = "none" where the study may do without, and preregister it'
        )

    def in_any_order(self) -> StudyProtocol:
        """Return the study with some order of trials: for counts and lengths, which all share."""
        has_none = self.privacy.secret_sha256 is None or self._secret is not None
        return self if has_none else self.with_secret("")

    @property
    def stimuli_sha256(self) -> str:
        """Hash of what decides the pixels: the display and the recipe.

        Clips stay valid when wording, timing or design change.
        """
        display = self.display.model_dump(mode="json")
        return sha256_json({"display": display, **self.stimuli.identity()})

    @property
    def warped(self) -> WarpedClips:
        """The recipe, where it is `warped-clips`; `StudyError` where it is another."""
        if isinstance(self.stimuli, WarpedClips):
            return self.stimuli
        raise StudyError(
            f"stimuli.kind: this needs a study of 'warped-clips' (got {self.stimuli.kind!r}),"
            " whose clips are rendered from scenes"
        )

    def main_scenes(self) -> tuple[str, ...]:
        """Return the names of the scenes of the main trials; one empty name where none is told."""
        wanted = self.design.scenes
        known = [str(value) for value in self.stimuli.values("scene")]
        return tuple(name for name in known if not wanted or name in wanted) or ("",)

    @property
    def pool(self) -> Pool:
        """Stimuli, scenes and repeats of the main trials."""
        return Pool(self.stimuli, self.main_scenes(), self.design.repeats)

    def practice_cells(self) -> list[Cell]:
        """Return the conditions of practice trials; none where there is no practice."""
        practice = self.design.practice
        if practice is None:
            return []
        pool = replace(self.pool, scenes=practice.scenes or self.main_scenes())
        return self.task.judged_cells(pool) if practice.judged else self.task.cells(pool)

    def cells(self) -> list[Cell]:
        """Return the conditions of all trials: main, catch and practice."""
        return [
            *self.task.cells(self.pool),
            *self.task.catch_cells(self.pool),
            *self.practice_cells(),
        ]

    def shown(self) -> tuple[str, ...]:
        """Return the name of every stimulus the study shows, in the order of the pool."""
        cells = self.cells()
        names = {name for cell in cells for name in cell.arrangements[0].stimuli}
        return tuple(s.name for s in self.stimuli.pool() if s.name in names)


def without_nothing(plain: dict[str, Any]) -> dict[str, Any]:
    """Return a study's plain form without keys that were added later and say nothing.

    So the hash of a study that does not use them is what it was.
    """
    if plain["privacy"]["secret_sha256"] is None:
        privacy = {key: value for key, value in plain["privacy"].items() if key != "secret_sha256"}
        return plain | {"privacy": privacy}
    return plain


def problems_between(sections: Mapping[str, Any]) -> list[Problem]:
    """Return every mistake between sections.

    Parameters
    ----------
    sections : mapping
        The sections that are right by themselves. What is missing is not judged, so that a file
        with other mistakes still gets all that can be said about it.
    """
    if "task" in sections:
        check_returns(sections["task"])
    problems = cross_check(sections)
    if problems or not {"stimuli", "task", "design"} <= set(sections):
        return problems
    study = StudyProtocol.model_construct(**sections)
    problems += study.task.problems(study.pool)
    if not problems:
        check_returns(study.task, study.pool)
    problems += _taken_columns(study)
    problems += _shared_scenes(study)
    if "analysis" in sections:
        problems += study.analysis.problems(study.task, study.pool)
    return problems


def _shared_scenes(study: StudyProtocol) -> Iterator[Problem]:
    """Yield a problem where scenes cannot stand for each other, and participants share them."""
    if study.web is None or study.web.share == 1:
        return
    scenes, rule = study.main_scenes(), study.task.adaptation
    if len(scenes) < 2:
        said = "the stimuli name none" if scenes == ("",) else f"got {scenes[0]!r} alone"
        yield Problem("web.share", f"must be left out where there are no two scenes ({said})")
        return
    columns = (rule.column, *rule.by) if isinstance(rule, AdaptiveLevels) else ()
    met: dict[str, set[tuple[object, ...]]] = {scene: set() for scene in scenes}
    for cell in study.task.cells(study.pool):
        condition = cell.arrangements[0].condition
        met[cell.scene].add(tuple(condition.get(name) for name in columns if name != SCENE))
    for scene, found in met.items():
        if not found or found != met[scenes[0]]:
            yield Problem(
                "web.share",
                "every scene must have trials, and adaptive ones at the same levels, since any may"
                f" be all that a participant is shown (scene {scene!r} lacks some, or has more);"
                " leave it out of design.scenes, or leave share out",
            )
            return


def _taken_columns(study: StudyProtocol) -> list[Problem]:
    """Return a problem for every column of the stimuli that tables have already."""
    task = study.task
    columns = (*task.condition_columns(study.pool), *task.all_answer_columns())
    counts = Counter([*COMMON_COLUMNS, *(column.name for column in columns)])
    return [
        Problem(
            "stimuli",
            f"a column of the stimuli must not be called {name!r}, as one of the tables that"
            " attempts become is; rename it",
        )
        for name in study.stimuli.columns()
        if counts[name] > 1
    ]
