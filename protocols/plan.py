"""The trial list of one participant: a pure function of protocol, manifest, code and slot."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass

from protocols.chance import Chance
from protocols.errors import StudyError
from protocols.hashing import sha256_json
from protocols.journal import TrialId
from protocols.manifest import Manifest, check_manifest
from protocols.schema import ClipName, StudyProtocol
from protocols.session_schema import SideName
from protocols.units import Count, Model, Name, ParticipantCode, Seed, Sha256

PairKey = tuple[str, str, frozenset[str]]


class PlannedTrial(Model):
    """One comparison of two clips."""

    id: TrialId
    block: Count
    """0 is practice."""
    practice: bool
    catch: bool
    repeat: Count
    scene: Name
    size: Name
    first: Name
    """Method in interval 1."""
    second: Name
    expected: Name | None
    """Catch trials: the method an attentive participant picks."""
    first_side: SideName
    """Side of the key that stands for interval 1."""

    @property
    def clips(self) -> tuple[ClipName, ClipName]:
        """The clips of interval 1 and 2."""
        return (
            ClipName(self.scene, self.size, self.first),
            ClipName(self.scene, self.size, self.second),
        )

    @property
    def pair(self) -> PairKey:
        """The two clips, whatever their order."""
        return self.scene, self.size, frozenset((self.first, self.second))


class Plan(Model):
    """Every trial of one participant in the order without any repeated attempt."""

    study: Name
    participant: ParticipantCode
    slot: Count
    seed: Seed
    protocol_sha256: Sha256
    manifest_sha256: Sha256
    trials: tuple[PlannedTrial, ...]

    @property
    def sha256(self) -> str:
        """Hash of the whole plan."""
        return sha256_json(self)

    @property
    def main_trials(self) -> int:
        """Trials that are analysed."""
        return sum(not (trial.practice or trial.catch) for trial in self.trials)

    def block(self, number: int) -> tuple[PlannedTrial, ...]:
        """Return the trials of a block; 0 is practice."""
        return tuple(trial for trial in self.trials if trial.block == number)

    @property
    def blocks(self) -> tuple[int, ...]:
        """Numbers of the blocks that have trials, in order."""
        return tuple(sorted({trial.block for trial in self.trials}))


@dataclass(frozen=True)
class _Cell:
    """One pairing of methods in one scene at one size."""

    scene: str
    size: str
    pairing: tuple[str, str]
    parity: int
    """Which order comes first for slot 0."""


def make_plan(protocol: StudyProtocol, manifest: Manifest, participant: str, slot: int) -> Plan:
    """Return the trials of a participant.

    Counterbalancing by slot: bit 0 turns the order in every pair, bit 1 the sides, and the
    scene order is a row of a Latin square. Within a participant the orders of a pair alternate
    over the repeats, and no two clips meet twice in a row.

    Raises
    ------
    StudyError
        If the manifest does not belong to the protocol or lacks clips, or the design cannot be
        arranged.
    """
    check_manifest(protocol, manifest)
    design = protocol.design
    chance = Chance(design.seed, participant, slot, "plan")
    main = _main_trials(protocol, slot, chance)
    if design.blocks > len(main):
        raise StudyError(
            f"design.blocks: must not be more than the main trials, {len(main)}"
            f" (got {design.blocks})"
        )
    blocks: dict[int, list[PlannedTrial]] = {0: _practice_trials(protocol, slot, chance)}
    for index, trial in enumerate(main):
        number = 1 + index * design.blocks // len(main)
        blocks.setdefault(number, []).append(trial.model_copy(update={"block": number}))
    for number, catch in _catch_trials(protocol, slot, chance):
        place = chance.below(len(blocks[number])) + 1  # never the first of its block
        blocks[number].insert(place, catch.model_copy(update={"block": number}))
    trials: list[PlannedTrial] = []
    for number in sorted(blocks):
        before = trials[-1].pair if trials else None
        trials += _sided(protocol, slot, chance, apart(blocks[number], before))
    return Plan(
        study=protocol.study.name,
        participant=participant,
        slot=slot,
        seed=design.seed,
        protocol_sha256=protocol.sha256,
        manifest_sha256=manifest.sha256,
        trials=tuple(trials),
    )


def latin_row(count: int, row: int) -> list[int]:
    """Return a row of a Latin square in which every item follows every other equally often.

    Rows 0 ... count-1 make the square; for an odd count a second one, mirrored, follows, which
    is what balance of the neighbours takes (Williams 1949).
    """
    zigzag = [(step + 1) // 2 if step % 2 else -(step // 2) for step in range(count)]
    order = [(item + row) % count for item in zigzag]
    mirrored = count % 2 == 1 and (row // count) % 2 == 1
    return order[::-1] if mirrored else order


def apart(trials: Iterable[PlannedTrial], before: PairKey | None) -> list[PlannedTrial]:
    """Return the trials with no pair twice in a row, moved as little as possible.

    Raises
    ------
    StudyError
        If one pair is more than half of the trials, so that there is no such order.
    """
    left = list(trials)
    ordered: list[PlannedTrial] = []
    while left:
        counts = Counter(trial.pair for trial in left)
        pair, most = counts.most_common(1)[0]
        crowded = 2 * most > len(left)  # must come now, or it meets itself at the end
        allowed = [
            trial
            for trial in left
            if trial.pair != before and (not crowded or trial.pair == pair or before == pair)
        ]
        if not allowed:
            raise StudyError(
                f"design: no clip pair may come twice in a row (block {left[0].block} has too many"
                f" trials of {sorted(pair[2])} in {pair[0]}, {pair[1]}); add scenes, sizes or"
                " pairings, or take fewer repeats"
            )
        ordered.append(allowed[0])
        left.remove(allowed[0])
        before = allowed[0].pair
    return ordered


def _cells(protocol: StudyProtocol, scenes: Iterable[str]) -> list[_Cell]:
    cells = []
    for i, scene in enumerate(scenes):
        for j, size in enumerate(protocol.sizes):
            for k, pairing in enumerate(protocol.pairings()):
                if protocol.comparable(protocol.scene(scene), pairing):
                    cells.append(_Cell(scene, size.name, pairing, (i + j + k) % 2))
    return cells


def _trial(kind: str, number: int, cell: _Cell, repeat: int, slot: int) -> PlannedTrial:
    turned = (cell.parity + repeat + slot) % 2 == 1
    first, second = reversed(cell.pairing) if turned else cell.pairing
    return PlannedTrial(
        id=f"{kind}-{number:04d}",
        block=0,
        practice=kind == "practice",
        catch=kind == "catch",
        repeat=repeat,
        scene=cell.scene,
        size=cell.size,
        first=first,
        second=second,
        expected=None,
        first_side="left",
    )


def _main_trials(protocol: StudyProtocol, slot: int, chance: Chance) -> list[PlannedTrial]:
    """Return the main trials in order: all of the first repeat, then all of the second, ..."""
    scenes = [scene.name for scene in protocol.main_scenes()]
    cells = _cells(protocol, scenes)
    if not cells:
        raise StudyError(
            "design: must have at least one trial (no scene has clips for both methods of a"
            " pairing: pairings with the reference need a scene that has one)"
        )
    ordered: list[tuple[int, _Cell]] = []
    rounds = 0
    for repeat in range(protocol.design.repeats):
        if protocol.design.scene_order == "random":
            ordered += [(repeat, cell) for cell in chance.shuffled(cells)]
            continue
        queues = {
            scene: chance.shuffled([cell for cell in cells if cell.scene == scene])
            for scene in scenes
        }
        while any(queues.values()):
            for index in latin_row(len(scenes), slot + rounds):
                if queues[scenes[index]]:
                    ordered.append((repeat, queues[scenes[index]].pop()))
            rounds += 1
    return [
        _trial("main", number, cell, repeat, slot) for number, (repeat, cell) in enumerate(ordered)
    ]


def _practice_trials(protocol: StudyProtocol, slot: int, chance: Chance) -> list[PlannedTrial]:
    practice = protocol.design.practice
    if practice is None:
        return []
    names = practice.scenes or tuple(scene.name for scene in protocol.main_scenes())
    cells = chance.shuffled(_cells(protocol, names))
    if not cells:
        raise StudyError(
            "design.practice: must have a scene with clips for both methods of a pairing"
        )
    return [
        _trial("practice", number, cells[number % len(cells)], number // len(cells), slot)
        for number in range(practice.trials)
    ]


def _catch_trials(
    protocol: StudyProtocol, slot: int, chance: Chance
) -> list[tuple[int, PlannedTrial]]:
    """Return (block, trial) of every catch trial, spread evenly."""
    catch = protocol.design.catch
    if catch is None:
        return []
    pairing = (catch.better, catch.worse)
    scenes = [s.name for s in protocol.main_scenes() if protocol.comparable(s, pairing)]
    if not scenes:
        raise StudyError(
            f"design.catch: must have a scene with clips for {catch.better} and {catch.worse}"
        )
    order = chance.shuffled(scenes)
    trials = []
    for number in range(catch.trials):
        cell = _Cell(order[number % len(order)], catch.size, pairing, number % 2)
        trial = _trial("catch", number, cell, 0, slot)
        block = 1 + number * protocol.design.blocks // catch.trials
        trials.append((block, trial.model_copy(update={"expected": catch.better})))
    return trials


def _sided(
    protocol: StudyProtocol, slot: int, chance: Chance, trials: list[PlannedTrial]
) -> list[PlannedTrial]:
    """Return the trials of a block with their sides: equally often, or one for the session."""
    mode = protocol.design.side
    sides: list[SideName] = ["left", "right"]
    if mode == "by-trial":
        drawn = chance.shuffled([sides[index % 2] for index in range(len(trials))])
    else:
        turned = mode == "by-participant" and (slot // 2) % 2 == 1
        drawn = [sides[turned]] * len(trials)
    return [
        trial.model_copy(update={"first_side": side})
        for trial, side in zip(trials, drawn, strict=True)
    ]
