"""Metrics that this machine can compute, and how to get the others."""

from __future__ import annotations

import platform
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cache
from importlib import metadata
from importlib.util import find_spec

from stimuli.score.lpips_alex import WEIGHTS_URL, weights_path
from stimuli.score.metrics import FAMILIES, Family, Metric

INSTALL = (
    "install them with: pip install 'metamerlab[metrics]' (in a checkout: script/setup --metrics)"
)


@dataclass(frozen=True)
class MissingMetrics:
    """Metrics that are left out, and why, in one sentence with its cure."""

    metrics: tuple[str, ...]
    reason: str


def split_available(
    metrics: Iterable[Metric],
) -> tuple[tuple[Metric, ...], tuple[MissingMetrics, ...]]:
    """Return the metrics that can be computed, and what is missing for the rest."""
    there: list[Metric] = []
    reasons: dict[str, list[str]] = {}
    for metric in metrics:
        reason = _reason(metric)
        if reason is None:
            there.append(metric)
        else:
            reasons.setdefault(reason, []).append(metric.name)
    return tuple(there), tuple(
        MissingMetrics(tuple(names), text) for text, names in reasons.items()
    )


def absent_packages(metric: Metric) -> list[str]:
    """Return the packages that a metric needs and that are not installed."""
    needs = FAMILIES[metric.family].packages
    return [package for module, package in needs if find_spec(module) is None]


def family_versions(family: Family) -> dict[str, str]:
    """Return the version of every package that takes part in a family's numbers."""
    packages = {package for _, package in family.packages}
    packages |= {"numpy", "scipy", "scikit-image", "opencv-python-headless"}
    return {package: _version_of(package) for package in sorted(packages)}


@cache
def _version_of(package: str) -> str:
    return metadata.version(package)


def metric_versions(metrics: Sequence[Metric]) -> dict[str, str]:
    """Return Python's version and those of all packages behind `metrics`."""
    found = {"python": platform.python_version()}
    for metric in metrics:
        found |= family_versions(FAMILIES[metric.family])
    return found


def _reason(metric: Metric) -> str | None:
    absent = absent_packages(metric)
    if absent:
        return f"not installed here: {', '.join(absent)}; {INSTALL}"
    if metric.family == "lpips" and not weights_path().is_file():
        return (
            f"the weights of AlexNet are not on this machine: put {WEIGHTS_URL} at {weights_path()}"
        )
    return None
