"""Linear mixed models with crossed random intercepts, by restricted maximum likelihood."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import scipy

from analysis.arrays import Floats, Ints
from analysis.models.mixed.arrow_matrix import Arrow, ArrowMatrix, RandomEffects

STARTS = (1.0, 0.3, 0.05)
"""Deviations, as shares of the residual's, from which the search begins."""

LARGEST = 300.0
"""Largest such share: beyond it the levels take all there is, and the equations are singular."""
LEAST_RATIO = 1e-8
"""Ratio of variances in place of 0: the likelihood is the same to its digits, and has its slope."""
LEAST_SQUARES = 1e-30
"""Share of residuals in the squares of all values: below what arithmetic tells."""


@dataclass(frozen=True)
class LinearMixed:
    """Coefficients, their covariance, and the deviation of each random intercept."""

    beta: Floats
    covariance: Floats
    sd: Mapping[str, float]
    residual_sd: float
    log_likelihood: float


def fit_linear_mixed(
    design: Floats,
    y: Floats,
    groups: Mapping[str, Ints],
    *,
    restricted: bool = True,
    starts: Sequence[Mapping[str, float]] = (),
) -> LinearMixed:
    """Maximise the restricted likelihood of y = X beta + sum_k Z_k b_k + rest.

    Parameters
    ----------
    design : ndarray (rows, coefficients)
        Of full rank, with fewer columns than rows.
    y : ndarray (rows,)
    groups : mapping of name to ndarray (rows,)
        Level of each random intercept.
    restricted : bool
        False: the likelihood itself, whose ratios compare models of other designs.
    starts : sequence of mappings of group to deviation
        Where the search begins, relative to the residual's; left out, at `STARTS`.

    Notes
    -----
    Bates, Maechler, Bolker and Walker 2015, Journal of Statistical Software 67(1), section 3: the
    likelihood is profiled over beta and the residual's variance, and searched over the variances
    relative to the residual's: at 0 it is level in a deviation, and no search by slopes would leave
    that. All of it needs cross-products only, made once.
    """
    codes = [np.unique(own, return_inverse=True)[1].ravel() for own in groups.values()]
    effects = RandomEffects(codes, [np.ones(y.size)] * len(codes), y.size)
    products = _Products(
        effects=effects,
        zz=effects.products(np.ones(y.size)),
        zx=np.stack([effects.of_effects(column) for column in design.T], axis=1),
        zy=effects.of_effects(y),
        xx=design.T @ design,
        xy=design.T @ y,
        yy=float(y @ y),
        rows=y.size,
        restricted=restricted,
    )
    begins = [np.array([one[name] for name in groups]) for one in starts]
    tried = [
        scipy.optimize.minimize(
            products.profile,
            start**2,
            jac=True,
            method="L-BFGS-B",
            bounds=[(0.0, LARGEST**2)] * len(codes),
            options={"ftol": 1e-14, "gtol": 1e-7},
        )
        for start in begins or [np.full(len(codes), share) for share in STARTS]
    ]
    best = min(tried, key=lambda one: float(one.fun)).x
    at = products.at(best)
    variance = at.squares / products.free
    residual = float(np.sqrt(variance))
    sds = residual * np.sqrt(best)
    return LinearMixed(
        beta=at.beta,
        covariance=np.asarray(variance * np.linalg.inv(at.left), dtype=np.float64),
        sd=dict(zip(groups, sds.tolist(), strict=True)),
        residual_sd=residual,
        log_likelihood=-0.5 * products.profile(best)[0],
    )


@dataclass(frozen=True)
class _Products:
    """Cross-products of random effects (slots), coefficients and `y`: all that a fit needs."""

    effects: RandomEffects
    zz: ArrowMatrix
    zx: Floats
    zy: Floats
    xx: Floats
    xy: Floats
    yy: float
    rows: int
    restricted: bool

    @property
    def free(self) -> int:
        """Rows, without the coefficients where the likelihood is restricted."""
        return self.rows - self.xy.size * self.restricted

    def at(self, ratios: Floats) -> "_Solved":
        """Solve for coefficients and effects; `ratios` are of variances to the residual's."""
        scale = self.effects.scale(np.sqrt(np.maximum(ratios, LEAST_RATIO)))
        inner = self.zz.scaled(scale).plus_one_inverted()
        zx, zy = scale[:, None] * self.zx, scale * self.zy
        answer, reached = inner.solve(zy), inner.solve(zx)
        left = self.xx - zx.T @ reached
        right = self.xy - zx.T @ answer
        beta = np.asarray(np.linalg.solve(left, right), dtype=np.float64)
        squares = self.yy - float(zy @ answer) - float(beta @ right)
        squares = max(squares, LEAST_SQUARES * max(self.yy, LEAST_SQUARES))
        determinants = inner.log_det
        if self.restricted:
            determinants += float(np.linalg.slogdet(left)[1])
        modes = scale * (answer - reached @ beta)
        return _Solved(scale, inner, beta, left, squares, determinants, modes, reached)

    def slopes(self, at: "_Solved") -> tuple[Floats, Floats]:
        """Return the slopes of `determinants` and of `squares` in the ratios."""
        inverse = at.inner.inverse()
        own = (inverse * self.zz) @ at.scale
        determinants = self.effects.totals(own / np.where(at.scale > 0.0, at.scale, 1.0))
        # What V^-1 leaves of the residuals, and of the design, in each effect.
        left_y = self.zy - self.zx @ at.beta - self.zz @ at.modes
        if self.restricted:
            left_x = self.zx - self.zz @ (at.scale[:, None] * at.reached)
            share = (left_x @ np.linalg.inv(at.left) * left_x).sum(axis=1)
            determinants -= self.effects.totals(share)
        return determinants, -self.effects.totals(left_y**2)

    def profile(self, ratios: Floats) -> tuple[float, Floats]:
        """Return the deviance, where the residual's variance is the best one, and its slope."""
        at = self.at(ratios)
        determinants, squares = self.slopes(at)
        variance = at.squares / self.free
        deviance = at.determinants + self.free * (1.0 + float(np.log(2.0 * np.pi * variance)))
        return deviance, determinants + squares / variance


@dataclass(frozen=True)
class _Solved:
    """Equations solved: I + S Z'Z S inverted (`inner`), X' V^-1 X (`left`), squared residuals.

    `modes` are of the effects, and `reached` is `inner` times S Z'X.
    """

    scale: Floats
    inner: Arrow
    beta: Floats
    left: Floats
    squares: float
    determinants: float
    modes: Floats
    reached: Floats
