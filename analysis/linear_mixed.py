"""Linear mixed models with crossed random intercepts, by restricted maximum likelihood."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy import optimize, sparse
from scipy.sparse import linalg as splinalg

from protocols.errors import StudyError

Floats = NDArray[np.float64]

STARTS = (1.0, 0.3, 0.05)
"""Deviations, as shares of the residual's, from which the search begins."""

MOST_LEVELS = 50_000
"""Of all random intercepts together: more take minutes."""
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


def fit_linear_mixed(
    design: Floats, y: Floats, groups: Mapping[str, NDArray[np.int64]]
) -> LinearMixed:
    """Maximise the restricted likelihood of y = X beta + sum_k Z_k b_k + rest.

    Parameters
    ----------
    design : ndarray (rows, coefficients)
        Of full rank, with fewer columns than rows.
    y : ndarray (rows,)
    groups : mapping of name to ndarray (rows,)
        Level of each random intercept.

    Notes
    -----
    Bates, Maechler, Bolker and Walker 2015, Journal of Statistical Software 67(1), section 3: the
    likelihood is profiled over beta and the residual's variance, and searched over the deviations
    relative to the residual's. All of it needs cross-products only, made once.
    """
    columns, sizes = [], []
    for level in groups.values():
        codes = np.unique(level, return_inverse=True)[1].ravel()
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
    )
    tried = [
        optimize.minimize(
            lambda theta: products.profile(theta)[0],
            np.full(len(sizes), start),
            method="L-BFGS-B",
            bounds=[(0.0, LARGEST)] * len(sizes),
            options={"ftol": 1e-14, "gtol": 1e-7},
        )
        for start in STARTS
    ]
    best = min(tried, key=lambda one: float(one.fun)).x
    deviance, beta, covariance, variance = products.profile(best)
    residual = float(np.sqrt(variance))
    return LinearMixed(
        beta=beta,
        covariance=covariance,
        sd={name: float(theta) * residual for name, theta in zip(groups, best, strict=True)},
        residual_sd=residual,
        log_likelihood=-0.5 * deviance,
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

    @cached_property
    def places(self) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Row and column of each entry of `zz`, of which every diagonal one is above 0."""
        columns = np.repeat(np.arange(self.zz.shape[1]), np.diff(self.zz.indptr))
        return self.zz.indices.astype(np.int64), columns

    def profile(self, theta: Floats) -> tuple[float, Floats, Floats, float]:
        """Return the REML deviance, beta, its covariance, and the residual's variance."""
        scale = np.repeat(theta, self.sizes)
        # Sparse: participants are blocks that only shared scenes connect.
        rows, columns = self.places
        entries = self.zz.data * scale[rows] * scale[columns] + (rows == columns)
        inner = splinalg.splu(
            sparse.csc_array((entries, self.zz.indices, self.zz.indptr), self.zz.shape),
            permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options={"SymmetricMode": True},
        )  # fmt: skip
        zx, zy = scale[:, None] * self.zx, scale * self.zy
        answer = inner.solve(zy)
        left = self.xx - zx.T @ inner.solve(zx)
        right = self.xy - zx.T @ answer
        beta = np.linalg.solve(left, right)
        free = self.rows - self.xy.size
        squares = max(self.yy - float(zy @ answer) - float(beta @ right), 1e-300)
        variance = squares / free
        deviance = (
            float(np.log(np.abs(inner.U.diagonal())).sum())
            + float(np.linalg.slogdet(left)[1])
            + free * (1.0 + float(np.log(2.0 * np.pi * variance)))
        )
        return deviance, beta, variance * np.linalg.inv(left), variance
