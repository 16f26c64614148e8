"""Limits of what so few participants, or scenes, can show at all."""

from analysis.models.clustered import least_p
from protocols.prose import count_of

MOST_PEOPLE = 1000
"""Up to which a number of participants that can show something is looked for."""


def hopeless(people: int, count: int, alpha: float) -> list[str]:
    """Say that so few participants cannot make any of a Holm family of comparisons significant."""
    least = float(least_p(people))
    if count * least < alpha or count < 1:
        return []
    enough = next(n for n in range(people, MOST_PEOPLE) if count * least_p(n) < alpha)
    if count == 1:
        return [
            f"the comparison cannot be significant: {count_of(people, 'participant')} can show no p"
            f" below {least:.2g}; that takes {enough} participants"
        ]
    return [
        f"none of {count} comparisons can be significant after Holm's adjustment: {people}"
        f" participants show no p below {least:.2g}; that takes {enough} participants, or fewer"
        " comparisons"
    ]


def two_scenes(scenes: int) -> list[str]:
    """Say what a test that claims further scenes can show with two."""
    if scenes != 2:
        return []
    return [
        "two scenes show hardly anything about further ones: p is seldom small, however many"
        " participants see them"
    ]
