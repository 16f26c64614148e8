"""The pyramid's kernels on the GPU: what bands.glsl declares. Twin: reference.py."""

from pipeline.features.reference import fitted_kernels


def band_constants() -> dict[str, float]:
    """The 3x3 kernels as the constants that bands.glsl declares."""
    kernels = fitted_kernels()
    return {
        "HIGH_EDGE": float(kernels.high[0, 1]),
        "HIGH_CORNER": float(kernels.high[0, 0]),
        "ORIENTED_EDGE": float(kernels.oriented[1, 2]),
        "ORIENTED_CORNER": float(kernels.oriented[0, 2]),
    }


def low_constants() -> dict[str, float]:
    """The low-pass's taps: of the inner two by two, beside them, and at the corners."""
    low = fitted_kernels().low
    return {
        "LOW_INNER": float(low[1, 1]),
        "LOW_MIXED": float(low[0, 1]),
        "LOW_OUTER": float(low[0, 0]),
    }
