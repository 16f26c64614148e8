"""Preferences between methods: shares per pairing and size, with inference fit for people."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
import pandas as pd

from analysis.arrays import Floats
from analysis.models.clustered import (
    FEW_SCENES,
    ClusteredShare,
    holm,
    sign_flip_floor,
    sign_flip_p,
    two_way,
)
from analysis.models.compared_methods import ALL_SIZES, Comparisons, counts, found_pairings
from analysis.models.numeric import exact_binomial
from analysis.showable import two_scenes
from protocols.errors import count_of

Test = Literal["participant-scene", "participant", "pooled"]
Adjustment = Literal["holm", "none"]
Verdict = Literal["preferred", "rejected", "equivalent", "undecided"]

FEW_PARTICIPANTS = 6


@dataclass(frozen=True)
class ShareEstimate:
    """Share of trials in which a method was chosen, with limits.

    Attributes
    ----------
    share : float
        chosen / trials.
    lower, upper : float
        Of the test that gives `ShareTest.p`, by inverting it: they leave out .5 exactly where
        p < 1 - level.
    effective_n : float
        Independent trials that would tell as much.
    """

    share: float
    lower: float
    upper: float
    level: float
    effective_n: float


@dataclass(frozen=True)
class ShareTest:
    """The protocol's test of a share against one half.

    Attributes
    ----------
    t, df : float or None
        Of the clustered score test; None where participants agree.
    p, p_adjusted : float
        Adjusted over the family of comparisons.
    name : str
        What p is, in words: the largest of three (`clustered.ClusteredShare`).
    """

    t: float | None
    df: float | None
    p: float
    p_adjusted: float
    name: str


@dataclass(frozen=True)
class Preference:
    """Preference for `method` over `against`: share, test and verdict.

    Attributes
    ----------
    size : str
        "all" where sizes are taken together.
    chosen : int
        Trials in which `method` was.
    sign_flip_p, sign_flip_floor : float
        Participant-level sign-flip test, and the smallest p so many participants can give. It
        decides nothing, nor does the next.
    exact_p, exact_lower, exact_upper : float
        Pooled exact binomial and Clopper-Pearson, as the papers; takes trials as independent.
    cohens_h : float
        2 asin sqrt(share) - pi / 2.
    odds_ratio, odds_lower, odds_upper : float
        Odds of choosing the method, half a vote added where all answers agree; limits are those of
        the share.
    margin, equivalence_p, equivalence_p_adjusted : float
        Smallest effect of interest, and TOST's p against it; adjusted over the family as tests
        are, because several verdicts of equivalence err as several tests do.
    participant_sd : float
        Standard deviation of the participants' shares.
    warnings : tuple of str
        When not to trust it.
    """

    method: str
    against: str
    size: str
    trials: int
    chosen: int
    participants: int
    scenes: int
    estimate: ShareEstimate
    test: ShareTest
    sign_flip_p: float
    sign_flip_floor: float
    exact_p: float
    exact_lower: float
    exact_upper: float
    cohens_h: float
    odds_ratio: float
    odds_lower: float
    odds_upper: float
    margin: float
    equivalence_p: float
    equivalence_p_adjusted: float
    participant_sd: float
    verdict: Verdict
    warnings: tuple[str, ...]

    def row(self) -> dict[str, object]:
        """Return everything by the names that tables and `results.json` keep, in their order."""
        tested = dict(vars(self.test))
        parts = {"estimate": vars(self.estimate), "test": tested | {"test": tested.pop("name")}}
        found: dict[str, object] = {}
        for name, value in vars(self).items():
            found |= parts.get(name, {name: value})
        return found

    def adjusted(self, p: float, equivalence_p: float, alpha: float) -> "Preference":
        """Return it as one of a family, by the p-values adjusted over all."""
        return replace(
            self,
            test=replace(self.test, p_adjusted=p),
            equivalence_p_adjusted=equivalence_p,
            verdict=_verdict(self.estimate.share, p, equivalence_p, alpha),
        )


@dataclass(frozen=True)
class PreferenceTable:
    """All comparisons of a study, adjusted together."""

    cells: tuple[Preference, ...]
    correction: str
    alpha: float
    warnings: tuple[str, ...]

    def cell(self, method: str, against: str, size: str = ALL_SIZES) -> Preference:
        """Return the comparison of two methods, the way round they are asked for.

        Raises
        ------
        KeyError
            If these were not compared at this size, or the other way round; it names all that were.
        """
        for cell in self.cells:
            if cell.size == size and (cell.method, cell.against) == (method, against):
                return cell
        known = [f"{cell.method} / {cell.against} / {cell.size}" for cell in self.cells]
        raise KeyError(f"{method} / {against} / {size}; compared were {known}")


def preferences(
    decisions: pd.DataFrame | Comparisons,
    *,
    pairings: Sequence[tuple[str, str]] | None = None,
    sizes: Sequence[str] | None = None,
    alpha: float = 0.05,
    margin: float = 0.1,
    test: Test = "participant-scene",
    correction: Adjustment = "holm",
) -> PreferenceTable:
    """Test every pairing at every size against chance.

    Parameters
    ----------
    decisions : DataFrame, one row per decision
        Columns ``participant``, ``scene``, ``size``, ``first``, ``second``, ``chosen``, as
        `analysis.tidy` writes them; or the same, grouped already.
    pairings : sequence of (method, against), optional
        Their order gives whose share is counted; left out, every pairing found.
    margin : float
        Smallest effect of interest, as a distance of the share from one half.

    Raises
    ------
    ValueError
        If columns are missing, or no decision compares any pairing.
    """
    if isinstance(decisions, pd.DataFrame):
        _require(decisions, ("participant", "scene", "size", "first", "second", "chosen"))
        decisions = Comparisons(decisions)
    if pairings is None:
        pairings = found_pairings(decisions.decisions)
    if sizes is None:
        sizes = decisions.sizes
    cells, notes = [], []
    for size in sizes:
        for method, against in pairings:
            rows = decisions.rows(method, against, size)
            if rows.empty:
                at = f" at {size}" if size else ""
                notes.append(f"no decision compares {method} with {against}{at}")
                continue
            cells.append(
                preference(rows, method, against, size, alpha=alpha, margin=margin, test=test)
            )
    if not cells:
        raise ValueError(f"decisions must compare at least one of the pairings {list(pairings)}")
    return PreferenceTable(
        cells=_adjusted(cells, correction, alpha),
        correction=correction,
        alpha=alpha,
        warnings=tuple(notes),
    )


def preference(
    decisions: pd.DataFrame,
    method: str,
    against: str,
    size: str = ALL_SIZES,
    *,
    alpha: float = 0.05,
    margin: float = 0.1,
    test: Test = "participant-scene",
) -> Preference:
    """Test whether `method` is chosen over `against` more or less often than by chance.

    Takes the decisions of this comparison only, see `pairing_rows`. With one comparison the
    adjusted p equals p.

    Raises
    ------
    ValueError
        If there is no decision.
    """
    if decisions.empty:
        raise ValueError(f"decisions must compare {method} with {against} (there is none)")
    chosen, shown, people, scenes = counts(decisions, method)
    trials, wins = int(shown.sum()), int(chosen.sum())
    shares = chosen.sum(axis=1) / shown.sum(axis=1)
    level = 1.0 - alpha
    estimate = None
    if len(people) > 1:
        one_way = test == "participant" or len(scenes) == 1
        cells = [one.sum(axis=1, keepdims=True) if one_way else one for one in (chosen, shown)]
        estimate = two_way(*cells)
    share = wins / trials
    exact_p, exact_lower, exact_upper = exact_binomial(wins, trials, level=level)
    notes = _notes(shown, wins, claimed=test == "participant-scene")
    judged = _judged(estimate, len(people), alpha, margin, one_way=test == "participant")
    if judged.note:
        notes.append(judged.note)
    tested, ends = judged.test, judged.limits
    if test == "pooled":
        tested = replace(tested, name="pooled exact binomial", p=exact_p, p_adjusted=exact_p)
        ends = exact_lower, exact_upper
        notes.append("the protocol's test takes trials as independent: p is too small")
    equal = judged.equivalence_p
    odds_share = (wins + 0.5) / (trials + 1.0) if wins in (0, trials) else share
    return Preference(
        method=method,
        against=against,
        size=size,
        trials=trials,
        chosen=wins,
        participants=len(people),
        scenes=len(scenes),
        estimate=ShareEstimate(share, *ends, level, judged.effective_n),
        test=tested,
        sign_flip_p=sign_flip_p(shares - 0.5),
        sign_flip_floor=sign_flip_floor(len(people)),
        exact_p=exact_p,
        exact_lower=exact_lower,
        exact_upper=exact_upper,
        cohens_h=cohens_h(share),
        odds_ratio=odds_share / (1.0 - odds_share),
        odds_lower=_odds(ends[0]),
        odds_upper=_odds(ends[1]),
        margin=margin,
        equivalence_p=equal,
        equivalence_p_adjusted=equal,
        participant_sd=float(shares.std(ddof=1)) if len(people) > 1 else 0.0,
        verdict=_verdict(share, tested.p, equal, alpha),
        warnings=tuple(notes),
    )


@dataclass(frozen=True)
class _Judged:
    """Results of the clustered procedure for one comparison."""

    test: ShareTest
    limits: tuple[float, float] = (0.0, 1.0)
    effective_n: float = 1.0
    equivalence_p: float = 1.0
    note: str = ""


def _judged(
    estimate: ClusteredShare | None, people: int, alpha: float, margin: float, *, one_way: bool
) -> _Judged:
    if estimate is None:
        return _Judged(ShareTest(None, None, 1.0, 1.0, "none: one participant"))
    clustered, independent, _ = (float(part) for part in estimate.p_parts())
    p = float(estimate.p_value())
    lower, upper = (float(end) for end in estimate.limits(1.0 - alpha))
    agree = float(estimate.standard_error) == 0.0
    test, note = "participant score t" if one_way else "two-way clustered score t", estimate.held()
    if note:
        test = "participants as votes"
    elif independent > clustered:
        test = "score test of trials"
        note = (
            "answers differ less between participants and scenes than independent trials would:"
            " p and limits are those of independent trials, because such agreement can be luck"
        )
    t, df = (None, None) if agree else (float(estimate.score_t()), float(estimate.df))
    return _Judged(
        test=ShareTest(t, df, p, p, test),
        limits=(lower, upper),
        effective_n=float(people if agree else estimate.effective_n),
        equivalence_p=float(estimate.equivalence_p(margin)),
        note=note,
    )


def cohens_h(share: float) -> float:
    """Return Cohen's h of a share and one half: arcsine-transformed (Cohen 1988, ch. 6)."""
    return float(2.0 * np.arcsin(np.sqrt(share)) - 2.0 * np.arcsin(np.sqrt(0.5)))


def _adjusted(cells: Sequence[Preference], correction: str, alpha: float) -> tuple[Preference, ...]:
    found = np.array([[cell.test.p, cell.equivalence_p] for cell in cells]).T
    adjusted = holm(found) if correction == "holm" else found
    return tuple(
        cell.adjusted(float(p), float(equivalence), alpha)
        for cell, p, equivalence in zip(cells, *adjusted, strict=True)
    )


def _verdict(share: float, p: float, equivalence: float, alpha: float) -> Verdict:
    if p < alpha:
        return "preferred" if share > 0.5 else "rejected"
    return "equivalent" if equivalence < alpha else "undecided"


def _odds(share: float) -> float:
    """Return the odds of a limit; infinite where it is 1."""
    return share / (1.0 - share) if share < 1.0 else math.inf


def _notes(shown: Floats, wins: int, *, claimed: bool) -> list[str]:
    (people, scenes), by_person, by_scene = shown.shape, shown.sum(axis=1), shown.sum(axis=0)
    notes = []
    if people < 2:
        notes.append("one participant only: nothing can be said about other people")
    elif people < FEW_PARTICIPANTS:
        notes.append(
            f"only {count_of(people, 'participant')}: no participant-level test can reach p < .05"
            f" without assumptions (floor {sign_flip_floor(people):.2g})"
        )
    if scenes == 1:
        notes.append("one scene only: the result is about that scene")
    elif scenes == 2 and claimed:
        notes += two_scenes(scenes)
    elif scenes < FEW_SCENES:
        notes.append(
            f"only {scenes} scenes: variance between scenes is poorly known, and the claim does not"
            " reach far beyond them; more participants do not replace scenes"
        )
    if wins in (0, int(shown.sum())):
        notes.append(
            "all answers agree: no variance to estimate; p is the smallest that"
            f" {count_of(people, 'participant')} can show"
        )
    if by_person.min() < by_person.max() or by_scene.min() < by_scene.max():
        notes.append(
            f"unbalanced: {int(by_person.min())} to {int(by_person.max())} trials per participant,"
            f" {int(by_scene.min())} to {int(by_scene.max())} per scene"
        )
    if few := int((by_person < 4).sum()):
        notes.append(
            f"{few} participant{'s have' if few != 1 else ' has'} fewer than 4 trials here"
        )
    return notes


def _require(table: pd.DataFrame, columns: Sequence[str]) -> None:
    missing = [column for column in columns if column not in table.columns]
    if missing:
        raise ValueError(f"decisions must have the columns {list(columns)} (missing: {missing})")
    if table.empty:
        raise ValueError("decisions must hold at least one row")
