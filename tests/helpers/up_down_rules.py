"""Published up-down rules, as `UpDown` takes their steps, and the share to which they converge."""

from protocols.adaptive.up_down import UpDown


def weighted(levels, *, start, target, harder):
    """Return Kaernbach's rule: it converges to `target` correct, a share in (0, 1).

    A wrong answer moves the track ``target / (1 - target)`` times as far as a correct one: three
    times for .75.
    """
    ratio = target / (1.0 - target)
    return UpDown(levels, start, harder, tuple(step * ratio for step in harder))


def transformed(levels, *, start, in_a_row, steps):
    """Return Levitt's rule: it converges to ``.5 ** (1 / in_a_row)`` correct."""
    return UpDown(levels, start, steps, steps, in_a_row=in_a_row)


def performance(settings):
    """Return the share of correct answers to which the last steps converge."""
    harder, easier = settings.harder[-1], settings.easier[-1]
    return float((easier / (easier + harder)) ** (1.0 / settings.in_a_row))
