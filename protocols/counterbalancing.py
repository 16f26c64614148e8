"""A slot's place in the counterbalancing: in order of arrival, or drawn.

A place says which arrangement comes first, which key stands for what, and which row orders the
scenes. Places come round: every so many of them, a round has balanced everything.
"""

from __future__ import annotations

from math import lcm

from protocols.chance import Chance
from protocols.study_file.schema import StudyProtocol

_MOST = 2**32
"""A longer round is cut here: no study has as many participants."""


def place_of(protocol: StudyProtocol, slot: int) -> int:
    """Return the place of a slot; drawn ones are below the length of a round.

    They are a permutation of each round, which the study's secret decides. Each short round, of
    arrangements and keys alone, is balanced too, so that a study of a few participants is.
    """
    if protocol.design.places != "drawn":
        return slot
    short, whole = rounds(protocol)
    seed = protocol.order_seed
    number, within = divmod(slot, short)
    rest = _drawn(within, short, Chance(seed, "places", "short", number))
    turn, nth = divmod(number, whole // short)
    block = _drawn(nth, whole // short, Chance(seed, "places", "whole", turn, rest))
    return block * short + rest


def arrival_shows(protocol: StudyProtocol) -> bool:
    """Return True if plans tell, by their places, in which order participants came."""
    return protocol.design.places != "drawn" and rounds(protocol)[1] > 1


def rounds(protocol: StudyProtocol) -> tuple[int, int]:
    """Return after how many places arrangements and keys are balanced, and the scenes as well."""
    design, task, scenes = protocol.design, protocol.task, protocol.main_scenes()
    arrangements = {len(cell.arrangements) for cell in task.cells(protocol.pool)}
    keys = 4 if design.side == "by-participant" else 1  # they turn after every second place
    short = min(lcm(keys, *arrangements), _MOST)
    rows = len(scenes) if design.scene_order == "balanced" and task.adaptation is None else 1
    if rows % 2 and rows > 1:
        rows *= 2  # an odd square needs its mirror image
    return short, lcm(short, rows)


def _drawn(number: int, count: int, chance: Chance) -> int:
    """Return one entry of a permutation of range(count), without making those behind it."""
    moved: dict[int, int] = {}
    for place in range(number + 1):
        other = place + chance.below(count - place)
        moved[place], moved[other] = moved.get(other, other), moved.get(place, place)
    return moved[number]
