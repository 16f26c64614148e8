"""Width of the eye's pools, the level of detail that pools as widely, and settings of metamers.

A law gives the deviation f(e) of a pooling Gaussian. Inside the fovea, up to `fovea_deg`, nothing
is pooled, and beyond it variances differ by the law's: ``sigma(e)^2 = f(e)^2 - f(fovea)^2``. So
the level of detail, which goes with the variance, rises from 0 without a jump.

n halvings and n doublings average with the variance ``v_n = HALVED_VARIANCE * (4^n - 1)``, in
pixels squared along each axis. A mixture of two neighbouring levels, of shares 1 - a and a, has the
variance ``(1 - a) v_n + a v_(n+1)``; so ``n + a`` follows from the variance that is asked for.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Literal, TypedDict, get_args

import numpy as np

from pipeline.errors import InputError
from pipeline.features.reference import check_levels, fitted_kernels
from pipeline.foveation.geometry import Geometry, check_gaze, eccentricity_deg, pixel_centres
from pipeline.frame import Floats
from protocols.errors import must_be_one_of

FWHM = 2.354820045
"""Full width at half maximum of a Gaussian, in deviations."""
ELLIPSE_SHARE = 0.443
"""Half the root of pi / 4: see `Pooling`, law `quadratic`."""

Law = Literal["linear", "quadratic", "rate"]
# law: its constant's name, default, what it is
LAWS: dict[Law, tuple[str, float, str]] = {
    "linear": ("scaling", 0.25, "full width at half maximum over eccentricity"),
    "quadratic": ("alpha", 0.2, "widths grow with the eccentricity squared"),
    "rate": ("rate", 0.35, "arcmin of deviation per degree of eccentricity"),
}
# preset: law, constant. Freeman and Simoncelli 2011 for v1 and v2; the paper's library for authors.
PRESETS: dict[str, tuple[Law, float]] = {
    "v1": ("linear", 0.25),
    "v2": ("linear", 0.46),
    "authors": ("quadratic", 0.2),
}
DEFAULT_PRESET = "v1"
CONSTANTS = tuple(name for name, _, _ in LAWS.values())
"""Names of the laws' constants."""


class PoolingParameters(TypedDict, total=False):
    """Keywords of `make_pooling`, for what hands them on."""

    law: str | None
    scaling: float | None
    alpha: float | None
    rate: float | None
    fovea_deg: float


@dataclass(frozen=True)
class Pooling:
    """Deviation of the pooling Gaussian by eccentricity.

    Parameters
    ----------
    law : str
        ``linear``: ``constant * e / 2.355`` (`constant` is F&S's scaling);
        ``quadratic``: ``0.443 * constant * e^2`` in radians (Walton et al.'s library: the side of
        a square with the area of an ellipse of diameters ``constant * e^2``, halved);
        ``rate``: ``constant * e`` with `constant` in arcmin per degree.
    constant : float
        Of the law, above 0.
    fovea_deg : float
        Up to here nothing is pooled, at least 0.

    Raises
    ------
    InputError
        If the law is unknown or a number out of range.
    """

    law: Law = "linear"
    constant: float = 0.25
    fovea_deg: float = 1.0

    def __post_init__(self) -> None:
        if self.law not in LAWS:
            raise InputError(must_be_one_of("law", self.law, LAWS))
        if not 0 < self.constant < math.inf:
            raise InputError(
                f"{LAWS[self.law][0]} must be positive and finite (got {self.constant})"
            )
        if not 0 <= self.fovea_deg < 180:
            raise InputError(f"fovea_deg must lie in 0..180 (got {self.fovea_deg})")

    @property
    def slope(self) -> float:
        """Degrees of deviation per degree, or per degree squared with law ``quadratic``."""
        return {
            "linear": self.constant / FWHM,
            "quadratic": ELLIPSE_SHARE * self.constant * math.radians(1),
            "rate": self.constant / 60,
        }[self.law]

    @property
    def power(self) -> int:
        """Power of the eccentricity: 1, or 2 with law ``quadratic``."""
        return 2 if self.law == "quadratic" else 1

    def sigma_deg(self, eccentricity_deg: Floats) -> Floats:
        """Deviation in degrees, of the shape of `eccentricity_deg`."""
        beyond = np.maximum(eccentricity_deg, self.fovea_deg) ** (2 * self.power)
        return np.asarray(self.slope * np.sqrt(beyond - self.fovea_deg ** (2 * self.power)))

    def __str__(self) -> str:
        name = LAWS[self.law][0]
        law = "" if name == self.law else f"{self.law}, "
        return f"{law}{name} {self.constant:g}, fovea {self.fovea_deg:g} deg"


def make_pooling(
    law: str | None = None,
    *,
    scaling: float | None = None,
    alpha: float | None = None,
    rate: float | None = None,
    fovea_deg: float = 1.0,
) -> Pooling:
    """Make a law from a preset or from the law's own constant.

    Parameters
    ----------
    law : str, optional
        A preset or a law. Left out: the law of the constant that is given, else `v1`.
    scaling, alpha, rate : float, optional
        The constant of `linear`, `quadratic` and `rate`; at most one, and none with a preset.

    Raises
    ------
    InputError
        If names and constants do not fit.
    """
    constants = {"scaling": scaling, "alpha": alpha, "rate": rate}
    given = {name: value for name, value in constants.items() if value is not None}
    if len(given) > 1:
        raise InputError(f"at most one of scaling, alpha, rate is given (got {', '.join(given)})")
    if law is None:
        owner: dict[str, str] = {LAWS[name][0]: name for name in LAWS}
        law = owner[next(iter(given))] if given else DEFAULT_PRESET
    if law in PRESETS:
        if given:
            raise InputError(
                f"law {law!r} fixes its constant (got {next(iter(given))} too);"
                f" use law {PRESETS[law][0]!r}"
            )
        return Pooling(*PRESETS[law], fovea_deg=fovea_deg)
    known = next((name for name in LAWS if name == law), None)
    if known is None:
        raise InputError(must_be_one_of("law", law, [*PRESETS, *LAWS]))
    own, default, _ = LAWS[known]
    if given and own not in given:
        raise InputError(f"law {law!r} takes {own} (got {next(iter(given))})")
    return Pooling(known, given.get(own, default), fovea_deg)


FADE_SHARE = 0.25
"""Share of the fovea's radius over which what is changed fades in."""


def halving_variance() -> float:
    """Variance of the pyramid's low-pass along an axis, pixels squared."""
    low = fitted_kernels().low.sum(axis=0)
    return float((low * (np.arange(4) - 1.5) ** 2).sum())


# The low-pass, and doubling by 3/4 and 1/4 (variance 3/16 of a coarse pixel, 3/4 of a fine one).
HALVED_VARIANCE = halving_variance() / 3 + 0.25


def lod_of(sigma_px: Floats) -> Floats:
    """Level of detail of pools with the deviation `sigma_px`, in pixels of the finest level."""
    variance = np.square(sigma_px) / HALVED_VARIANCE
    level = np.floor(0.5 * np.log2(variance + 1))
    power = 4.0**level
    return np.asarray(level + (variance - (power - 1)) / (3 * power))


@dataclass(frozen=True)
class Pools:
    """The pools of one picture under one gaze."""

    geometry: Geometry
    gaze_px: tuple[float, float]
    pooling: Pooling

    def __post_init__(self) -> None:
        object.__setattr__(self, "gaze_px", check_gaze(self.geometry, self.gaze_px))

    def eccentricity_deg(self, halvings: int = 0) -> Floats:
        """Eccentricity, degrees, at the texels of the picture halved so often: (h, w)."""
        return eccentricity_deg(
            self.geometry, self.gaze_px, *pixel_centres(self.geometry, halvings)
        )

    def sigma_px(self, halvings: int = 0) -> Floats:
        """Deviation of the pools at these texels, in pixels of the picture: (h, w)."""
        density = self.geometry.px_per_deg(*pixel_centres(self.geometry, halvings))
        return np.asarray(self.pooling.sigma_deg(self.eccentricity_deg(halvings)) * density)

    def lod(self, halvings: int = 0, level: int = 0) -> Floats:
        """Level of detail at these texels, in pyramid level `level`'s own chain: (h, w)."""
        return lod_of(self.sigma_px(halvings) / (1 << level))

    def fade(self) -> Floats:
        """Share of the change at each pixel: 0 in the fovea, 1 beyond its border: (H, W)."""
        fovea_deg = self.pooling.fovea_deg
        away_deg = self.eccentricity_deg() - fovea_deg
        if fovea_deg == 0:
            return np.asarray((away_deg > 0).astype(np.float64))
        return np.asarray(np.clip(away_deg / (FADE_SHARE * fovea_deg), 0, 1))


Chroma = Literal["follow", "full", "luma"]
Residual = Literal["kept", "pooled"]


@dataclass(frozen=True)
class MetamerSettings:
    """Switches of `metamer`.

    Parameters
    ----------
    pooling : Pooling
        How widely the eye pools.
    levels : int
        Of the pyramid, from 1 to 6; small pictures have fewer.
    chroma : str
        ``follow``: chroma goes with luma's noise; ``full``: and has noise of its own for what does
        not; ``luma``: none.
    residual : str
        What lies below the last level is ``kept`` (as it gives no noise), or ``pooled`` too.
    noise : float
        Times the noise's deviation, from 0 to 4.

    Raises
    ------
    InputError
        If a value is out of range.
    """

    pooling: Pooling = field(default_factory=Pooling)
    levels: int = 5
    chroma: Chroma = "follow"
    residual: Residual = "kept"
    noise: float = 1.0

    def __post_init__(self) -> None:
        check_levels(self.levels)
        for name, value, kind in (
            ("chroma", self.chroma, Chroma),
            ("residual", self.residual, Residual),
        ):
            if value not in get_args(kind):
                raise InputError(must_be_one_of(name, value, get_args(kind)))
        if not (0 <= self.noise <= 4 and math.isfinite(self.noise)):
            raise InputError(f"noise must lie in 0..4 (got {self.noise})")
