"""Linear mixed models with crossed random intercepts, by restricted maximum likelihood."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, partial

import numpy as np
from numpy.typing import NDArray
from scipy import optimize, sparse
from scipy.sparse import linalg as splinalg

from analysis.models.mixed.deviations import Deviation, FittedEffects
from protocols.errors import StudyError
from protocols.limits import FIXED

Floats = NDArray[np.float64]

STARTS = (1.0, 0.3, 0.05)
"""Deviations, as shares of the residual's, from which the search begins."""

MOST_LEVELS = FIXED["effects"].most
"""Of all random intercepts together: more take minutes."""
IMPOSSIBLE = 1e10
"""Minus the log likelihood where the equations are singular."""
LARGEST = 300.0
"""Largest such share: beyond it the levels take all there is, and the equations are singular."""


@dataclass(frozen=True)
class LinearMixed:
    """Coefficients, their covariance, and the deviation of each random intercept."""

    beta: Floats
    covariance: Floats
    sd: Mapping[str, float]
    residual_sd: float
    log_likelihood: float
    deviations: tuple[Deviation, ...] = ()


def fit_linear_mixed(
    design: Floats,
    y: Floats,
    groups: Mapping[str, NDArray[np.int64]],
    *,
    names: Mapping[str, Sequence[str]] | None = None,
    level: float | None = None,
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
    names : mapping of group to names of its levels, optional
        Whose levels are wanted in `LinearMixed.deviations`.
    level : float, optional
        Coverage of profile limits of the deviations, the last of them the residual's; left out,
        there are none.
    restricted : bool
        False: the likelihood itself, whose ratios compare models of other designs.
    starts : sequence of mappings of group to deviation
        Where the search begins, relative to the residual's; left out, at `STARTS`.

    Notes
    -----
    Bates, Maechler, Bolker and Walker 2015, Journal of Statistical Software 67(1), section 3: the
    likelihood is profiled over beta and the residual's variance, and searched over the deviations
    relative to the residual's. All of it needs cross-products only, made once.
    """
    columns, sizes = [], []
    for own in groups.values():
        codes = np.unique(own, return_inverse=True)[1].ravel()
        sizes.append(int(codes.max()) + 1)
        if sum(sizes) > MOST_LEVELS:
            raise StudyError(
                f"a mixed model must have at most {MOST_LEVELS:,} participants and their"
                f" combinations with conditions (there are {sum(sizes):,} and more); leave"
                " participants out with --where, or give each row the code of its participant"
            )
        columns.append(
            sparse.csr_array(
                (np.ones(y.size), (np.arange(y.size), codes)), shape=(y.size, sizes[-1])
            )
        )
    z = sparse.hstack(columns, format="csr")
    zz = (z.T @ z).tocsc()
    zz.sort_indices()  # as the solver takes for granted
    products = _Products(
        zz=zz,
        zx=np.asarray(z.T @ design),
        zy=np.asarray(z.T @ y),
        xx=design.T @ design,
        xy=design.T @ y,
        yy=float(y @ y),
        sizes=tuple(sizes),
        rows=y.size,
        restricted=restricted,
    )
    begins = [np.array([one[name] for name in groups]) for one in starts]
    tried = [
        optimize.minimize(
            lambda theta: products.profile(theta)[0],
            start,
            method="L-BFGS-B",
            bounds=[(0.0, LARGEST)] * len(sizes),
            options={"ftol": 1e-14, "gtol": 1e-7},
        )
        for start in begins or [np.full(len(sizes), share) for share in STARTS]
    ]
    best = min(tried, key=lambda one: float(one.fun)).x
    deviance, beta, covariance, variance = products.profile(best)
    residual = float(np.sqrt(variance))
    deviations: tuple[Deviation, ...] = ()
    if level is not None:
        deviations = products.deviations(list(groups), best, residual, names or {}, level)
    return LinearMixed(
        beta=beta,
        covariance=covariance,
        sd={name: float(theta) * residual for name, theta in zip(groups, best, strict=True)},
        residual_sd=residual,
        log_likelihood=-0.5 * deviance,
        deviations=deviations,
    )


@dataclass(frozen=True)
class _Products:
    zz: sparse.csc_array
    zx: Floats
    zy: Floats
    xx: Floats
    xy: Floats
    yy: float
    sizes: tuple[int, ...]
    rows: int
    restricted: bool = True

    @cached_property
    def places(self) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Row and column of each entry of `zz`, of which every diagonal one is above 0."""
        columns = np.repeat(np.arange(self.zz.shape[1]), np.diff(self.zz.indptr))
        return self.zz.indices.astype(np.int64), columns

    def profile(self, theta: Floats) -> tuple[float, Floats, Floats, float]:
        """Return the REML deviance, beta, its covariance, and the residual's variance."""
        inner, scale = self._factor(theta)
        determinants, beta, left, squares, _ = self._solved(inner, scale)
        free = self.rows - self.xy.size * self.restricted
        variance = squares / free
        deviance = determinants + free * (1.0 + float(np.log(2.0 * np.pi * variance)))
        covariance = np.asarray(variance * np.linalg.inv(left), dtype=np.float64)
        return deviance, beta, covariance, variance

    def deviations(
        self,
        groups: Sequence[str],
        theta: Floats,
        residual: float,
        names: Mapping[str, Sequence[str]],
        level: float,
    ) -> tuple[Deviation, ...]:
        """Return the deviations with profile limits (of REML), shares of variance, and levels."""
        sd = np.append(theta * residual, residual)
        best = -0.5 * self._deviance(theta, residual)
        inner, scale = self._factor(theta)
        _, beta, _, _, answer = self._solved(inner, scale)
        modes = scale * (answer - inner.solve(scale[:, None] * self.zx) @ beta)
        ends = np.cumsum(self.sizes)[:-1]
        return FittedEffects(
            sd=dict(zip([*groups, "residual"], sd.tolist(), strict=True)),
            errors=0.2 * sd,
            held=partial(self._held, sd),
            best=best,
            modes=np.split(modes, ends),
            solve=inner.solve,
            rest=residual**2,
            slopes=["residual"],
        ).deviations(level, names)

    def _held(self, sd: Floats, place: int, value: float) -> float:
        """Return the largest restricted log likelihood where one deviation is held."""

        unit = float(sd[-1])  # the residual's, which is above 0

        def cost(free: Floats) -> float:
            whole = np.maximum(np.insert(unit * free, place, value), 0.0)
            whole[-1] = max(float(whole[-1]), unit / LARGEST)
            theta = np.minimum(whole[:-1] / whole[-1], LARGEST)
            try:
                return 0.5 * self._deviance(theta, float(whole[-1]))
            except (np.linalg.LinAlgError, RuntimeError):  # the levels take all there is
                return IMPOSSIBLE

        keep = np.arange(sd.size) != place
        found = optimize.minimize(
            cost,
            sd[keep] / unit,
            method="L-BFGS-B",
            bounds=[(0.0, LARGEST)] * (sd.size - 1),
            options={"ftol": 1e-9, "gtol": 1e-5},
        )
        return -float(found.fun)

    def _deviance(self, theta: Floats, residual: float) -> float:
        """Return the REML deviance where the residual's deviation is not the best one."""
        inner, scale = self._factor(theta)
        determinants, _, _, squares, _ = self._solved(inner, scale)
        free = self.rows - self.xy.size
        return (
            determinants + free * float(np.log(2.0 * np.pi * residual**2)) + squares / residual**2
        )

    def _factor(self, theta: Floats) -> tuple[splinalg.SuperLU, Floats]:
        """Return I + S Z'Z S, factored, and S, what each effect is scaled by."""
        scale = np.repeat(theta, self.sizes)
        # Sparse: participants are blocks that only shared scenes connect.
        rows, columns = self.places
        entries = self.zz.data * scale[rows] * scale[columns] + (rows == columns)
        inner = splinalg.splu(
            sparse.csc_array((entries, self.zz.indices, self.zz.indptr), self.zz.shape),
            permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options={"SymmetricMode": True},
        )  # fmt: skip
        return inner, scale

    def _solved(
        self, inner: splinalg.SuperLU, scale: Floats
    ) -> tuple[float, Floats, Floats, float, Floats]:
        """Return log determinants, beta, X'V^-1 X, its residual squares, and what y solves to."""
        zx, zy = scale[:, None] * self.zx, scale * self.zy
        answer = inner.solve(zy)
        left = self.xx - zx.T @ inner.solve(zx)
        right = self.xy - zx.T @ answer
        beta = np.linalg.solve(left, right)
        squares = max(self.yy - float(zy @ answer) - float(beta @ right), 1e-300)
        determinants = float(np.log(np.abs(inner.U.diagonal())).sum())
        if self.restricted:
            determinants += float(np.linalg.slogdet(left)[1])
        return determinants, beta, left, squares, answer
