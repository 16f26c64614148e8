"""Options of a table without a protocol: the section `[analysis]` of its kind, and more.

`metamerlab analysis import` keeps it as JSON beside the table, and commands take its keys as
options. It loads no statistics, so that they can list them.
"""

from collections.abc import Sequence
from functools import cache
from typing import Annotated, Literal

from pydantic import BeforeValidator, Field, create_model

from protocols.adaptive.answer_history import Shape
from protocols.disk.hashing import Json
from protocols.errors import StudyError, did_you_mean
from protocols.tasks.base import Analysis
from protocols.tasks.mixed import MixedAnalysis
from protocols.tasks.pairs import Preferences
from protocols.tasks.rates import RatesAnalysis
from protocols.tasks.rating import RatingsAnalysis
from protocols.tasks.yes_no import DetectionAnalysis
from protocols.units import Model, Scalar

NEVER_TOLD = frozenset({"kind", "exclusions"})
"""Keys of `[analysis]` that are of sessions, not of tables; the kind is said beside."""


def _listed(text: object) -> object:
    return tuple(one.strip() for one in text.split(",")) if isinstance(text, str) else text


def _scale(given: object) -> object:
    names = _listed(given)
    if names and isinstance(names, tuple) and ("" in names or len(set(names)) < max(2, len(names))):
        raise ValueError(
            "must name two different ratings or more, from the lowest on, with commas between"
            f" (got {given!r})"
        )
    return names


def _rate(value: object) -> object:
    number = value if isinstance(value, float | int) else -1.0
    if value is not None and value != "fit" and not 0.0 <= number < 1.0:
        raise ValueError(f"must be a rate from 0 to below 1, or 'fit' (got {value!r})")
    return None if value is None or value == "fit" else float(number)


Listed = Annotated[tuple[str, ...], BeforeValidator(_listed)]
"""Texts; in one text they have commas between."""


class ConditionNames(Model):
    """Names and order of conditions in a report of a table."""

    order: Listed = ()
    """Conditions in the order of the report, with commas between; others follow."""
    label: dict[str, str] = Field(default_factory=dict)
    """Name of a condition in the report, as label.NAME = "TEXT"."""

    def sort(self, names: Sequence[str], parts: Sequence[str] = ()) -> list[str]:
        """Return conditions in the order that is asked for.

        Raises
        ------
        StudyError
            If `order` or `label` name what is no condition, nor (`label`) one of its parts.
        """
        asked = ("order", self.order, names), ("label", self.label, (*names, *parts))
        for key, given, known in asked:
            for name in given:
                if name not in known:
                    raise StudyError(
                        f"--set {key}: must name conditions of the table ({', '.join(known)})"
                        f" (got {name!r}){did_you_mean(name, known)}"
                    )
        return sorted(names, key=lambda name: (*self.order, name).index(name))


class PreferenceTableSection(Preferences, ConditionNames):
    """Options of a table of preferences."""

    kind: Literal["preference"] = "preference"
    primary: str | None = None
    """The comparison that the report leads with and does not adjust, as METHOD/AGAINST or
    METHOD/AGAINST/SIZE. Default: none."""
    method: str | None = None
    """The method whose comparisons are reported, its share counted. Default: all."""
    against: str | None = None
    """The method that others are compared with. Default: all."""


class RateTableSection(RatesAnalysis, ConditionNames):
    """Options of a table of right and wrong answers."""

    by: str | tuple[str, ...] = ""
    """Column whose values are compared, or several with commas between, whose combinations are.
    Default: `method`, if there is one."""
    level: str | None = None
    """Column of numbers along which answers change."""
    interaction: str | None = None
    """A second column: tests whether the differences between values of `by` differ between its
    values."""
    shape: Shape = "gauss"
    """Shape of the curve: gauss, logistic, or weibull where levels are above 0."""


class DetectionTableSection(RateTableSection, DetectionAnalysis):
    """Options of a table of a yes-no task."""

    kind: Literal["detection"] = "detection"
    signal: str = "yes"
    """The answer that is right where the signal is, as the table writes it."""


class _OpenTableSection(RateTableSection):
    """Options of a table of a task whose answers its study names."""

    alternatives: Annotated[int, Field(ge=2)] | None = None
    """Number of answers. Default: as many as the columns expected and answer hold."""


@cache
def table_section(section: type[Analysis], *, open_ended: bool) -> type[RateTableSection]:
    """Return the options of a table of right answers to a task with this section.

    `open_ended`: the task has other answers in each study.
    """
    own: type[RateTableSection] = _OpenTableSection if open_ended else RateTableSection
    bases, kind = (own, section), section.own_kind()
    made = [create_model(f"{section.__name__}OfTable", __base__=bases, kind=(str, kind))]
    return next(one for one in made if issubclass(one, RateTableSection))


class CurveTableSection(RateTableSection):
    """Options of a table of right answers along a level."""

    kind: Literal["psychometric"] = "psychometric"
    by: str | tuple[str, ...] = ""
    """Column whose values are compared, or several with commas between."""
    guess: Annotated[float | None, BeforeValidator(_rate)] = 0.5
    """Rate of guessing, such as 0.5; fit: unknown."""
    log: bool = False
    """Fit on the logarithm of the level; weibull always does."""


class RatingTableSection(RatingsAnalysis):
    """Options of a table of ratings."""

    kind: Literal["ratings"] = "ratings"
    by: str = ""
    """Column whose values are compared. Default: each row rates a pair, `first` with `second`."""
    scale: Annotated[tuple[str, ...], BeforeValidator(_scale)] = ()
    """Ratings from the lowest, if they are not numbers."""


class TimeTableSection(MixedAnalysis):
    """Options of a table of reaction times."""

    kind: Literal["reaction"] = "reaction"
    by: str = ""
    """Column whose values are compared."""
    baseline: Scalar | None = None
    """The value of `by` that the others are compared with. Default: all pairs are compared."""


def check_contrasts(section: MixedAnalysis, known: Sequence[str]) -> None:
    """Refuse contrasts of what are no conditions of a table.

    Raises
    ------
    StudyError
        That says which.
    """
    wrong = list(section.contrast_problems(known))
    if wrong:
        raise StudyError(
            "\n".join(
                f"--set {one.place.removeprefix('analysis.')}: {one.message}" for one in wrong
            )
        )


def keys_of(section: type[Analysis]) -> list[str]:
    """Return the keys that a table is told."""
    return [name for name in section.model_fields if name not in NEVER_TOLD]


def said_of(section: Analysis) -> dict[str, Json]:
    """Return kind and keys as JSON has them."""
    kept: dict[str, Json] = section.model_dump(mode="json", exclude=set(NEVER_TOLD - {"kind"}))
    return {name: kept[name] for name in ("kind", *keys_of(type(section))) if name in kept}
