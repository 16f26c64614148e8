"""Time that gaze has to be elsewhere before the fixation rule is sure, as the protocol says it."""

import math

from protocols.study_file.session_schema import Gaze


def persistence_s(rules: Gaze, rate_hz: float) -> float:
    """Return how long gaze is outside, from its first sample there, until a violation is sure.

    At least `violation_samples` samples and `violation_s`, in whole sample intervals.
    """
    intervals = max(rules.violation_samples - 1, math.ceil(rules.violation_s * rate_hz - 1e-9))
    return intervals / rate_hz
