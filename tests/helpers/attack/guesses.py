"""Guesses from a public export who came when, as anybody can who has the study file.

Places in the counterbalancing come round after a few slots. So every slot of a round is tried: what
would its session show? What fits best is guessed: scenes in their order, what came first, keys.
Rows of a file stand in some order; every number in them may hold the true one.
"""

import itertools
import re
import time
from collections import defaultdict
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from random import Random
from typing import Any

import pandas as pd
from attack.kills import CASES, write_study
from scipy.stats import binom

from analysis.export import FORMATS, ExportOptions, Format
from analysis.export.export_content import people_of
from analysis.export.write_export import export_study
from analysis.journals import read_study
from protocols.disk.hashing import sha256_bytes
from protocols.load import load_display, load_protocol, shipped
from protocols.plan import PlannedTrial, planned_trials, rounds
from protocols.study_file.schema import StudyProtocol
from protocols.tasks.task_kinds import TASKS
from study_app.simulate import SimulatedStudy, simulate_study

Row = dict[str, str]
STUDIES = (*(name for name, kind in TASKS.items() if kind.task.every_answer), "inpainting-2afc")
"""New studies by task, those whose answers swap keys or sides, and one that comes along."""
RARE = 1e-4
"""Chance below which luck alone does not guess so many."""
_ORDERS = ("", "onset", "order", "position", "trial", "row_id", "rt_s", "response_time")
_SEVERAL = ("first", "second", "a", "b", "x", "changed_to")
_NAMES = {"condition_A": "first", "condition_B": "second", "scene_name": "scene"}
_WHO = ("participant", "observer")


@dataclass(frozen=True)
class GuessResult:
    """Result of guessing the slots of an export, by what tells most of them."""

    right: float
    """Participants whose slot was guessed; of several that fit as well, each counts its share."""
    people: int
    round: int
    """After how many slots places come round: so many are to be told apart."""
    luck: float
    """Chance that luck alone finds as many among as few."""

    @property
    def told(self) -> bool:
        """True if the export tells more of slots than luck explains."""
        return self.luck < RARE


def secretly(path: Path, places: str, secret: str) -> StudyProtocol:
    """Give a study file a secret and a rule for places; return the study with its secret."""
    digest = sha256_bytes(secret.encode())
    text = path.read_text(encoding="utf-8").replace('\nplaces = "drawn"\n', "\n")
    text = text.replace("\n[design]\n", f'\n[design]\nplaces = "{places}"\n')
    text = text.replace("\n[privacy]\n", f'\n[privacy]\nsecret_sha256 = "{digest}"\n')
    path.write_text(text, encoding="utf-8")
    path.with_suffix(".secret").write_text(f"{secret}\n")
    return load_protocol(path)


def write_shipped(folder: Path, name: str) -> SimulatedStudy:
    """Write a study that comes with the program, with short trials and without gaze."""
    text = shipped("studies")[name].read_text(encoding="utf-8")
    for key in ("duration_s", "stimulus_s", "gap_s", "fixation_s", "iti_s"):
        text = re.sub(rf"^{key} = .*$", f"{key} = 0.1", text, flags=re.M)
    path = folder / "study.toml"
    path.write_text(re.sub(r"^mode = .*$", 'mode = "none"', text, flags=re.M), encoding="utf-8")
    study = load_protocol(path)
    return SimulatedStudy(study, load_display(study.display.display))


def recorded(folder: Path, name: str, places: str, people: int, secret: str) -> SimulatedStudy:
    """Write a study with a secret, and sessions of it into ``sessions``."""
    folder.mkdir(parents=True, exist_ok=True)
    made = write_study(folder, CASES[name]) if name in CASES else write_shipped(folder, name)
    path = folder / "study.toml"
    text = path.read_text(encoding="utf-8")
    path.write_text(re.sub(r"^mode = .*$", 'mode = "none"', text, flags=re.M), encoding="utf-8")
    simulation = replace(made, study=secretly(path, places, secret))
    simulate_study(simulation, folder / "sessions", people)
    return simulation


def export_and_guess(
    simulation: SimulatedStudy, folder: Path, form: Format, out: Path
) -> GuessResult:
    """Write the public export of `recorded` sessions, and guess its participants' slots."""
    study, sessions = simulation.study, folder / "sessions"
    options = ExportOptions(public=True, displays=(simulation.display,))
    export_study(sessions, study, out, form, options)
    readings = read_study(sessions, study)
    people, _ = people_of(readings, study, public=True)
    slots = {person.code: person.reading.start.slot for person in people}
    return guess(out, load_protocol(folder / "study.toml"), slots)


def guess(folder: Path, study: StudyProtocol, slots: Mapping[str, int]) -> GuessResult:
    """Guess the slots in an export by every order that its rows may stand in; the best counts.

    Whoever guesses has the study, not its secret, and takes places for drawn by the public seed or
    by arrival.
    """
    rules = [
        study.model_copy(update={"design": study.design.model_copy(update={"places": places})})
        for places in ("by-arrival", "drawn")
    ]
    _, whole = rounds(study)
    tables = [each for people in _tables(folder, study).values() for each in _ordered(people)]
    found = [GuessResult(0.0, len(slots), whole, 1.0)]
    for rule in rules:
        plans = [_expected(rule.with_secret(""), slot) for slot in range(whole)]
        for people in tables:
            likely = {}
            for person, rows in people.items():
                fits = [_fit(rows, plan) for plan in plans]
                likely[person] = [slot for slot, fit in enumerate(fits) if fit == max(fits)]
            inside = [len(few) for who, few in likely.items() if slots[who] % whole in few]
            few = sum(map(len, likely.values())) / len(likely) / whole
            luck = float(binom.sf(len(inside) - 1, len(likely), few))
            found.append(GuessResult(sum(1 / n for n in inside), len(slots), whole, luck))
    return min(found, key=lambda each: (each.luck, -each.right))


def _tables(folder: Path, study: StudyProtocol) -> dict[str, dict[str, list[Row]]]:
    """Return one row per main trial, by kind of table and participant."""
    tables: dict[str, dict[str, list[Row]]] = defaultdict(dict)
    for path in sorted(folder.rglob("*.?sv")):
        table = pd.read_csv(path, sep="\t" if path.suffix == ".tsv" else ",", dtype=str)
        if "scene_name" in table:  # pwcmp's scene is scene and size
            table = table.drop(columns="scene").rename(columns=_NAMES)
        table = table.fillna("")
        who = next((column for column in _WHO if column in table), None)
        subject = re.search(r"sub-(\w+?)_", path.name)
        if (who is None and subject is None) or not {"trial", "is_A_selected"} & set(table):
            continue
        for person, rows in table.groupby(who) if who else [(subject and subject[1], table)]:
            found = list(_trials(rows.to_dict("records"), study))
            if found:
                tables[path.name.rpartition("_")[2] if subject else path.name][str(person)] = found
    return tables


def _trials(rows: list[dict[str, Any]], study: StudyProtocol) -> Iterator[Row]:
    """Yield the main trials: what rows of one trial show belongs together."""
    scenes = {entry.name: entry.scene for entry in study.stimuli.pool()}
    trials: dict[str, Row] = {}
    for number, row in enumerate(rows):
        trial = str(row.get("trial", number))
        if row.get("kind", "main") != "main" or not (trial.isdigit() or trial.startswith("main")):
            continue
        shown = row.pop("stimulus", "n/a")
        known = trials.setdefault(trial, row | {"stimulus": "", "number": str(number)})
        if row.get("attempt", "1") == "1" and shown not in ("", "n/a"):
            known["stimulus"] = f"{known['stimulus']} {shown}".strip()
    for row in trials.values():
        if row["stimulus"]:
            row.setdefault("scene", scenes.get(row["stimulus"].split()[0], ""))
        else:
            del row["stimulus"]
        yield {key: value for key, value in row.items() if value not in ("", "n/a")}


def _ordered(people: dict[str, list[Row]]) -> Iterator[dict[str, list[Row]]]:
    """Yield the rows of all participants in every order that a column can say, each once."""
    met = []
    for order in _ORDERS:
        if not order or all(order in row for rows in people.values() for row in rows):
            placed = {person: _sorted(rows, order) for person, rows in people.items()}
            if placed not in met:
                met.append(placed)
                yield placed


def _sorted(rows: list[Row], order: str) -> list[Row]:
    """Return rows by the number in a column: for reaction times, the slowest first."""
    if not order:
        return rows
    sign = -1 if order in ("rt_s", "response_time") else 1
    return sorted(rows, key=lambda row: sign * float(re.findall(r"[\d.]+", row[order])[-1]))


@dataclass(frozen=True)
class _Expected:
    """Session that a slot would show."""

    scenes: list[str]
    arranged: dict[tuple[str, frozenset[str]], list[Row]]
    """By repeat and condition, however arranged."""
    columns: frozenset[str]
    keys: tuple[str, ...]


def _expected(study: StudyProtocol, slot: int) -> _Expected:
    trials = [trial for trial in planned_trials(study, "S001", slot) if trial.role == "main"]
    arranged = defaultdict(list)
    rows = [_row(study, trial) for trial in trials]
    columns = frozenset(rows[0]) - {"stimulus", "repeat", "expected"}
    for row in rows:
        for kind in (columns, frozenset({"stimulus"})):
            arranged[row["repeat"], _condition(row, kind)].append(row)
    scenes = [str(trial.condition.get("scene", "")) for trial in trials]
    return _Expected(scenes, dict(arranged), columns, trials[0].answers)


def _row(study: StudyProtocol, trial: PlannedTrial) -> Row:
    """Return what tables would say of a trial."""
    names: dict[str, str] = {}
    if study.analysis.kind == "preference":
        names = dict(zip(study.task.answers(), ("first", "second"), strict=True))
    said = {names.get(key, key): str(value) for key, value in trial.condition.items()}
    said |= {"stimulus": " ".join(trial.stimuli), "repeat": str(trial.repeat)}
    return said | ({"expected": trial.correct} if trial.correct else {})


def _condition(row: Row, columns: frozenset[str]) -> frozenset[str]:
    """Return what a trial is about, however it is arranged."""
    return frozenset(word for key in columns for word in row.get(key, "").split())


def _fit(rows: list[Row], plan: _Expected) -> float:
    """Return how well a session fits a slot, by scenes, arrangements and keys, at most 3."""
    scenes = [row["scene"] for row in rows if "scene" in row]
    score = 0.0
    if len(scenes) == len(plan.scenes):
        score += sum(a == b for a, b in zip(scenes, plan.scenes, strict=True)) / len(scenes)
    met: dict[frozenset[str], int] = defaultdict(int)
    hits, tried = 0, 0
    for row in rows:
        kind = frozenset({"stimulus"}) if "stimulus" in row else plan.columns
        condition = _condition(row, kind)
        repeat = row.get("repeat", str(met[condition]))
        met[condition] += 1
        wanted = plan.arranged.get((repeat, condition), [])
        shared = [set(row) & set(other) & {*_SEVERAL, "stimulus", "expected"} for other in wanted]
        tried += any(shared)
        hits += any(
            keys and all(row[key] == other[key] for key in keys)
            for keys, other in zip(shared, wanted, strict=True)
        )
    keys = [_key_fits(row, plan.keys) for row in rows]
    keyed = [fits for fits in keys if fits is not None]
    return score + hits / max(tried, 1) + sum(keyed) / max(len(keyed), 1)


def _key_fits(row: Row, answers: tuple[str, ...]) -> bool | None:
    """Return whether the keys are those of a slot; None where no column tells."""
    if "first_side" in row:
        first = "left" if answers[0] in ("first", "left") else "right"
        return row["first_side"] == first
    answer = row.get("answer", row.get("choice"))
    if "key_place" in row and answer in answers:
        return answers.index(answer) == int(float(row["key_place"]))
    return None


def guess_studies(
    count: int, seed: int, folder: Path, until_s: float, on_guess: Callable[[], None]
) -> tuple[int, list[str]]:
    """Guess the slots of study after study, until `count` were tried in one export each.

    Returns how many, and the exports that told more than luck explains.
    """
    chance, done, failures = Random(seed), 0, list[str]()
    studies = itertools.cycle(itertools.product(("drawn", "by-arrival"), STUDIES))
    while done < count and time.monotonic() < until_s:
        places, name = next(studies)
        people = min(chance.randint(8, 16), count - done)
        at = folder / str(done)
        made = recorded(at, name, places, people, f"{chance.getrandbits(256):064x}")
        preference = made.study.analysis.kind == "preference"
        form = chance.choice([each for each in FORMATS if preference or each != "pwcmp"])
        found = export_and_guess(made, at, form, at / form)
        if found.told:
            failures.append(f"{name}, places {places}, {form}: {found}")
        done += people
        for _ in range(people):
            on_guess()
    return done, failures
