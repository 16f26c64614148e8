"""Answers of one participant to a yes-no task, given as a table of counts."""

import pandas as pd

from analysis.models.detection import YesNoCondition, yes_no


def of_table(
    hits: int, misses: int, false_alarms: int, correct_rejections: int, correction: str = "none"
) -> YesNoCondition:
    """Return what `yes_no` says of such a table, its trials independent."""
    counts = {
        ("yes", "yes"): hits,
        ("yes", "no"): misses,
        ("no", "yes"): false_alarms,
        ("no", "no"): correct_rejections,
    }
    pairs = [pair for pair, count in counts.items() for _ in range(count)]
    rows = pd.DataFrame(pairs, columns=["expected", "answer"]).assign(participant="a")
    return yes_no(rows, signal="yes", correction=correction)["all"]
