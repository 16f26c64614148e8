"""The trial list of one participant: a pure function of protocol, manifest, code and slot.

A slot has a place in the counterbalancing, in order of arrival or drawn. The place says which
arrangement comes first, which key stands for what, and which row orders the scenes; in a browser,
also which share of the scenes is shown. Places come round: every so many of them, a round has
balanced everything.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import replace
from math import gcd, lcm

from protocols.disk.hashing import Chance, sha256_json
from protocols.errors import StudyError
from protocols.journal import Attempt, Role, TrialId
from protocols.limits import check_trials
from protocols.manifest import Manifest, check_manifest
from protocols.study_file.schema import StudyProtocol
from protocols.tasks.base import Cell, Turn
from protocols.units import Count, Model, Name, ParticipantCode, Scalar, Seed, Sha256

_MOST = 2**32
"""A longer round is cut here: no study has as many participants."""


def place_of(study: StudyProtocol, slot: int) -> int:
    """Return the place of a slot; drawn ones are below the length of a round.

    They are a permutation of each round, which the study's secret decides, in browsers the export's
    key. Each short round, of arrangements and keys alone, is balanced too, so that a study of a few
    participants is.
    """
    if study.design.places != "drawn":
        return slot
    short, whole = rounds(study)
    seed = study.place_seed
    number, within = divmod(slot, short)
    rest = _drawn(within, short, Chance(seed, "places", "short", number))
    turn, nth = divmod(number, whole // short)
    block = _drawn(nth, whole // short, Chance(seed, "places", "whole", turn, rest))
    return block * short + rest


def arrival_shows(study: StudyProtocol) -> bool:
    """Return True if plans tell, by their places, in which order participants came."""
    return study.design.places != "drawn" and rounds(study)[1] > 1


def rounds(study: StudyProtocol) -> tuple[int, int]:
    """Return after how many places arrangements and keys are balanced, and the scenes as well."""
    design, task = study.design, study.task
    _, each, count = _walk(study)
    arrangements = {len(cell.arrangements) for cell in task.cells(study.pool)}
    keys = 4 if design.side == "by-participant" else 1  # they turn after every second place
    short = min(lcm(keys, *arrangements), _MOST)
    rows = each if design.scene_order == "balanced" and task.adaptation is None else 1
    if rows % 2 and rows > 1:
        rows *= 2  # an odd square needs its mirror image
    return short, lcm(short, rows) * count


def _walk(study: StudyProtocol) -> tuple[tuple[str, ...], int, int]:
    """Return all scenes, how many a place shows, and after how many places all are shown alike."""
    scenes = study.main_scenes()
    each = max(1, round(study.scene_share * len(scenes)))
    return scenes, each, len(scenes) // gcd(len(scenes), each)


def windows(study: StudyProtocol) -> int:
    """Return after how many places every scene is shown equally often; 1 if each shows all."""
    return _walk(study)[-1]


def scenes_at(study: StudyProtocol, place: int) -> tuple[str, ...]:
    """Return the scenes that a place shows, in the order of the pool.

    They are a window that moves on by its own length, from place to place. Where the windows have
    come round with arrangements and keys, it moves once more, so that each window meets each of
    these equally often in the end.
    """
    scenes, each, count = _walk(study)
    if count == 1:
        return scenes
    first = (place + place // lcm(rounds(study)[0], count)) % count * each
    shown = {(first + step) % len(scenes) for step in range(each)}
    return tuple(scene for index, scene in enumerate(scenes) if index in shown)


def _shown(study: StudyProtocol, scenes: tuple[str, ...], cells: list[Cell]) -> list[Cell]:
    """Return the cells of a participant's scenes; all, where no scene is among them."""
    if study.scene_share == 1.0:
        return cells
    return [cell for cell in cells if cell.scene in scenes] or cells


def _drawn(number: int, count: int, chance: Chance) -> int:
    """Return one entry of a permutation of range(count), without making those behind it."""
    moved: dict[int, int] = {}
    for place in range(number + 1):
        other = place + chance.below(count - place)
        moved[place], moved[other] = moved.get(other, other), moved.get(place, place)
    return moved[number]


class PlannedTrial(Model):
    """One trial: what it shows, and which answer each response key stands for."""

    id: TrialId
    block: Count
    """0 is practice."""
    role: Role
    repeat: Count
    condition: dict[str, Scalar]
    """Condition shown, column by column, as the task defines it."""
    stimuli: tuple[str, ...]
    """Names in the manifest, as the task counts them; empty until an adaptive rule chooses."""
    answers: tuple[Name, ...]
    """The answer that each response key stands for, from left to right."""
    correct: Name | None = None
    """The right answer; null where there is none."""
    track: str | None = None
    """The adaptive track that chooses the condition; null: it is planned."""

    @property
    def shown(self) -> frozenset[str]:
        """Names of the stimuli, whatever the order: no two trials in a row show the same."""
        return frozenset(self.stimuli)


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
        return sum(trial.role == "main" for trial in self.trials)

    def block(self, number: int) -> tuple[PlannedTrial, ...]:
        """Return the trials of a block; 0 is practice."""
        return tuple(trial for trial in self.trials if trial.block == number)

    @property
    def blocks(self) -> tuple[int, ...]:
        """Numbers of the blocks that have trials, in order."""
        return tuple(sorted({trial.block for trial in self.trials}))


def make_plan(study: StudyProtocol, manifest: Manifest, participant: str, slot: int) -> Plan:
    """Return the trials of a participant.

    Counterbalancing by the slot's place (`protocols.plan`): bit 0 turns the arrangement
    of every trial, bit 1 the keys, and the scene order is a row of a Latin square. Within a
    participant the arrangements of a condition take turns over the repeats, and no two trials in a
    row show the same.

    Raises
    ------
    StudyError
        If the manifest does not belong to the protocol or lacks clips, or the design cannot be
        arranged.
    """
    check_manifest(study, manifest)
    return Plan(
        study=study.study.name,
        participant=participant,
        slot=slot,
        seed=study.order_seed,
        protocol_sha256=study.sha256,
        manifest_sha256=manifest.sha256,
        trials=planned_trials(study, participant, slot),
    )


def planned_trials(study: StudyProtocol, participant: str, slot: int) -> tuple[PlannedTrial, ...]:
    """Return the trials of a participant, which no clip decides: `make_plan` says how.

    Raises
    ------
    StudyError
        If the design cannot be arranged.
    """
    design = study.design
    chance = Chance(study.order_seed, participant, slot, "plan")
    place = place_of(study, slot)
    scenes = scenes_at(study, place)
    main = _main_trials(study, scenes, place, chance)
    if design.blocks > len(main):
        raise StudyError(
            f"design.blocks: must not be more than the main trials, {len(main)}"
            f" (got {design.blocks})"
        )
    blocks: dict[int, list[PlannedTrial]] = {0: _practice_trials(study, scenes, place, chance)}
    for index, trial in enumerate(main):
        number = 1 + index * design.blocks // len(main)
        blocks.setdefault(number, []).append(_changed(trial, block=number))
    for number, catch in _catch_trials(study, scenes, place, chance):
        after = chance.below(len(blocks[number])) + 1  # never the first of its block
        blocks[number].insert(after, _changed(catch, block=number))
    trials: list[PlannedTrial] = []
    for number in sorted(blocks):
        before = trials[-1].shown if trials else None
        trials += _keyed(study, place, chance, apart(blocks[number], before))
    return tuple(trials)


def chosen(
    study: StudyProtocol, plan: Plan, trial: PlannedTrial, attempts: Sequence[Attempt]
) -> PlannedTrial:
    """Return a trial with what it shows: for adaptive ones, given the attempts so far.

    Raises
    ------
    StudyError
        If the answers so far do not fit the rule.
    """
    rule = study.task.adaptation
    if trial.track is None or rule is None:
        return trial
    past = [
        attempt
        for attempt in attempts
        if attempt.track == trial.track and attempt.outcome == "completed"
    ]
    tries = sum(attempt.trial == trial.id for attempt in attempts)
    turn = Turn(trial.condition, past, (plan.seed, plan.participant, plan.slot), trial.id, tries)
    place = place_of(study, plan.slot)
    pool = replace(study.pool, scenes=scenes_at(study, place))
    cell = rule.choose(study.task, pool, turn)
    several = len(cell.arrangements) > 1
    arrangement = cell.arranged(len(past) + place if several else 0)
    return trial.model_copy(
        update={
            "condition": dict(arrangement.condition),
            "stimuli": arrangement.stimuli,
            "correct": arrangement.correct,
        }
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


def apart(trials: Iterable[PlannedTrial], before: frozenset[str] | None) -> list[PlannedTrial]:
    """Return the trials of a block so that no two in a row show the same, and few are moved.

    Trials of which an adaptive rule chooses what they show may stand anywhere. They count among
    what could meet itself, as they did in every plan so far, unless that finds no order. The last
    trial `before` the block, which a break parts from it, counts unless that leaves a block of
    several stimuli no order.

    Raises
    ------
    StudyError
        If more than half of the trials show the same, so that there is no such order.
    """
    left = list(trials)
    several = len({trial.shown for trial in left}) > 1
    for met in (before, None) if several else (before,):
        for open_counts in (True, False):
            ordered = _ordered_apart(left, met, open_counts=open_counts)
            if ordered is not None:
                return ordered
    most, _ = Counter(trial.shown for trial in left if trial.shown).most_common(1)[0]
    raise StudyError(
        f"design: no two trials in a row may show the same (block {left[0].block} has too many"
        f" trials of {' and '.join(sorted(most))}); add scenes or conditions, or take fewer"
        " repeats"
    )


def _ordered_apart(
    trials: Iterable[PlannedTrial], before: frozenset[str] | None, *, open_counts: bool
) -> list[PlannedTrial] | None:
    left = list(trials)
    ordered: list[PlannedTrial] = []
    counts = Counter(trial.shown for trial in left if trial.shown or open_counts)
    kinds = Counter(counts.values())  # how many of them have so many trials left
    most = max(kinds, default=0)
    shown: frozenset[str] = frozenset()
    while left:
        crowded = 2 * most > len(left)  # must come now, or it meets itself at the end
        if crowded and counts[shown] != most:
            shown = next(entry for entry, count in counts.items() if count == most)
        place = next(
            (
                index
                for index, trial in enumerate(left)
                if (open_counts and not trial.shown)
                or (
                    (trial.shown != before or not trial.shown)
                    and (not crowded or trial.shown == shown or before == shown)
                )
            ),
            None,
        )
        if place is None:
            return None
        trial = left.pop(place)
        if trial.shown in counts:
            kinds[counts[trial.shown]] -= 1
            counts[trial.shown] -= 1
            kinds[counts[trial.shown]] += 1
            most -= not kinds[most]
        ordered.append(trial)
        before = trial.shown
    return ordered


def _trial(
    study: StudyProtocol, kind: Role, number: int, cell: Cell, repeat: int, turn: int
) -> PlannedTrial:
    arrangement = cell.arranged(turn)
    return PlannedTrial(
        id=f"{kind}-{number:04d}",
        block=0,
        role=kind,
        repeat=repeat,
        condition=dict(arrangement.condition),
        stimuli=arrangement.stimuli,
        answers=study.task.answers(),
        correct=arrangement.correct,
    )


def _changed(trial: PlannedTrial, **update: object) -> PlannedTrial:
    """Return the trial with other values of some fields; itself where they are no others."""
    if all(getattr(trial, name) == value for name, value in update.items()):
        return trial
    return trial.model_copy(update=update)


def _main_trials(
    study: StudyProtocol, scenes: tuple[str, ...], place: int, chance: Chance
) -> list[PlannedTrial]:
    """Return the main trials in order: all of the first repeat, then all of the second, ..."""
    rule, pool = study.task.adaptation, replace(study.pool, scenes=scenes)
    if rule is not None:
        check_trials(rule.trials)
        return [
            PlannedTrial(
                id=f"main-{number:04d}",
                block=0,
                role="main",
                repeat=0,
                condition=dict(entry.condition),
                stimuli=(),
                answers=study.task.answers(),
                track=entry.track,
            )
            for number, entry in enumerate(rule.slots(study.task, pool, chance))
        ]
    cells = _shown(study, scenes, study.task.cells(study.pool))
    check_trials(len(cells) * study.design.repeats)
    if not cells:
        raise StudyError(
            "design: must have at least one trial (no scene has the stimuli that the task needs:"
            " pairings with the reference, say, need a scene that has one)"
        )
    of_scene: dict[str, list[Cell]] = {scene: [] for scene in scenes}
    for cell in cells:
        of_scene[cell.scene].append(cell)
    ordered: list[tuple[int, Cell]] = []
    row = place // windows(study)
    for repeat in range(study.design.repeats):
        if study.design.scene_order == "random":
            ordered += [(repeat, cell) for cell in chance.shuffled(cells)]
            continue
        queues = {scene: chance.shuffled(of_scene[scene]) for scene in scenes}
        while any(queues.values()):
            for index in latin_row(len(scenes), row):
                if queues[scenes[index]]:
                    ordered.append((repeat, queues[scenes[index]].pop()))
            row += 1
    return [
        _trial(study, "main", number, cell, repeat, repeat + place)
        for number, (repeat, cell) in enumerate(ordered)
    ]


def _practice_trials(
    study: StudyProtocol, scenes: tuple[str, ...], place: int, chance: Chance
) -> list[PlannedTrial]:
    practice = study.design.practice
    if practice is None:
        return []
    cells = chance.shuffled(_shown(study, scenes, study.practice_cells()))
    if not cells:
        raise StudyError("design.practice: must have a scene with the stimuli that the task needs")
    check_trials(practice.trials * practice.rounds)
    turns = (divmod(number, len(cells)) for number in range(practice.trials * practice.rounds))
    return [
        _trial(study, "practice", number, cells[index], repeat, repeat + place)
        for number, (repeat, index) in enumerate(turns)
    ]


def _catch_trials(
    study: StudyProtocol, scenes: tuple[str, ...], place: int, chance: Chance
) -> list[tuple[int, PlannedTrial]]:
    """Return (block, trial) of every catch trial, spread evenly."""
    wanted = study.task.catch_trials
    if not wanted:
        return []
    check_trials(wanted)
    cells = _shown(study, scenes, study.task.catch_cells(study.pool))
    if not cells:
        raise StudyError("task.catch: must fit stimuli of at least one scene")
    order = chance.shuffled(cells)
    return [
        (
            1 + number * study.design.blocks // wanted,
            _trial(study, "catch", number, order[number % len(order)], 0, number + place),
        )
        for number in range(wanted)
    ]


def _keyed(
    study: StudyProtocol, place: int, chance: Chance, trials: list[PlannedTrial]
) -> list[PlannedTrial]:
    """Return the trials of a block with the answers of their keys.

    The order of the answers is turned equally often, or for the whole session, or never.
    """
    mode = study.design.side
    answers = study.task.answers()
    orders = (answers, answers[::-1])
    if mode == "by-trial":
        drawn = chance.shuffled([orders[index % 2] for index in range(len(trials))])
    else:
        turned = mode == "by-participant" and (place // 2) % 2 == 1
        drawn = [orders[turned]] * len(trials)
    return [_changed(trial, answers=order) for trial, order in zip(trials, drawn, strict=True)]
