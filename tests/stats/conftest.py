"""Fixtures of the statistics' tests: made-up decisions, made-up journals, published data."""

import json
from collections.abc import Callable, Collection, Mapping
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from protocols.journal import (
    Answer,
    AnyEvent,
    Attempt,
    BlockEnd,
    BlockStart,
    Consent,
    GazeQuality,
    Machine,
    Remote,
    SessionEnd,
    SessionStart,
    ShownStimulus,
    event_line,
)
from protocols.load import load_protocol
from protocols.study_file.schema import StudyProtocol

SHA = "0" * 64
AT = "2026-01-01T10:00:00.000000Z"
AT_HOME = Remote(
    study_file_sha256=SHA,
    revision="0.1.0 (abcdefa)",
    slot_from="link",
    machine=Machine(
        browser="Firefox 153",
        refresh_hz=75.02,
        missed_share=0.0,
        window_px=(1920, 1080),
        device_pixel_ratio=1.0,
        scale=1,
        color_gamut="srgb",
        full_screen=True,
        touch=False,
    ),
    deviations_s={"task.gap_s": -0.0066},
)
QUALITY = {"metameric": 0.6, "push-pull": -0.9, "reference": 1.6}


@pytest.fixture(scope="session")
def expected(shared_data: Path) -> dict[str, object]:
    """Return the published answers."""
    file = shared_data / "stats" / "expected.json"
    if not file.is_file():
        pytest.skip("needs expected.json of the test data, which is not here")
    loaded: dict[str, object] = json.loads(file.read_text())
    return loaded


@pytest.fixture(scope="session")
def stats_data(shared_data: Path) -> Callable[[str], pd.DataFrame]:
    """Return a reader of the published tables, which stay outside the repository."""

    def read(name: str, **options: object) -> pd.DataFrame:
        file = shared_data / "stats" / name
        if not file.is_file():
            pytest.skip(f"needs {name} of the test data, which is not here")
        return pd.read_csv(file, **options)  # type: ignore[call-overload, no-any-return]

    return read


@pytest.fixture(scope="session")
def demo_protocol() -> StudyProtocol:
    """Return the demonstration study."""
    return load_protocol(Path("demo"))


@pytest.fixture(scope="session")
def make_decisions() -> Callable[..., pd.DataFrame]:
    """Return a maker of decisions with known preferences, as tidy tables hold them."""

    def make(
        *,
        seed: int = 0,
        people: int = 11,
        scenes: int = 6,
        repeats: int = 2,
        participant_sd: float = 0.4,
        quality: Mapping[str, float] = QUALITY,
        sizes: tuple[str, ...] = ("small", "large"),
    ) -> pd.DataFrame:
        rng = np.random.default_rng(seed)
        names = sorted(quality)
        pairs = [(a, b) for i, a in enumerate(names) for b in names[i + 1 :]]
        rows = []
        for person in range(people):
            taste = {name: rng.normal(0.0, participant_sd) for name in names}
            for repeat in range(repeats):
                for scene in range(scenes):
                    for size in sizes:
                        for pair in pairs:
                            first, second = pair if repeat % 2 == 0 else pair[::-1]
                            gap = quality[first] + taste[first] - quality[second] - taste[second]
                            chose = rng.random() < 1.0 / (1.0 + np.exp(-gap))
                            rows.append(
                                {
                                    "participant": f"P{person:02d}",
                                    "session": f"P{person:02d}",
                                    "scene": f"scene-{scene}",
                                    "size": size,
                                    "repeat": repeat,
                                    "first": first,
                                    "second": second,
                                    "chosen": first if chose else second,
                                    "rejected": second if chose else first,
                                    "chose_first": int(chose),
                                    "chosen_side": "left" if rng.random() < 0.5 else "right",
                                    "rt_s": float(np.exp(rng.normal(0.0, 0.4))),
                                }
                            )
        table = pd.DataFrame(rows)
        table["order"] = table.groupby("participant")["chosen"].transform(
            lambda part: rng.permutation(len(part)) + 1
        )
        return table

    return make


@pytest.fixture(scope="session")
def write_journals(demo_protocol: StudyProtocol) -> Callable[..., Path]:
    """Return a writer of sessions of the demonstration study, one folder per participant."""

    def write(
        folder: Path,
        *,
        people: int = 4,
        study: StudyProtocol = demo_protocol,
        decided: int | None = None,
        choose: Callable[[str, str, np.random.Generator], bool] | None = None,
        simulated: bool = True,
        rt_s: float | None = None,
        answer: str = "the edges",
        seed: int = 1,
        remote: Collection[int] = (),
    ) -> Path:
        """`remote` are the numbers of those who took part in their own browser."""
        for number in range(people):
            code = f"P{number + 1:02d}"
            rng = np.random.default_rng([seed, number])
            events = _session(
                study,
                code,
                rng,
                decided=decided,
                choose=choose or _prefer,
                simulated=simulated,
                rt_s=rt_s,
                answer=answer,
                slot=number,
                remote=number in remote,
            )
            (folder / code).mkdir(parents=True)
            (folder / code / "journal.jsonl").write_bytes(b"".join(map(event_line, events)))
        return folder

    return write


def _prefer(first: str, second: str, rng: np.random.Generator) -> bool:
    return bool(rng.random() < 1.0 / (1.0 + np.exp(QUALITY[second] - QUALITY[first])))


def _session(
    study: StudyProtocol,
    code: str,
    rng: np.random.Generator,
    *,
    decided: int | None,
    choose: Callable[[str, str, np.random.Generator], bool],
    simulated: bool,
    rt_s: float | None,
    answer: str,
    slot: int,
    remote: bool,
) -> list[AnyEvent]:
    trials = [
        (scene, size, pair if repeat % 2 == 0 else pair[::-1], repeat)
        for repeat in range(study.design.repeats)
        for scene in study.main_scenes()
        for size in study.stimuli.values("size")
        for pair in study.task.paired(study.pool)
    ]
    order = rng.permutation(len(trials))
    events: list[AnyEvent] = []

    def stamp() -> dict[str, object]:
        return {"n": len(events), "t_s": float(len(events)), "at": AT}

    events.append(
        SessionStart(
            **stamp(),
            study=study.study.name,
            participant=code,
            slot=slot,
            language="en",
            seed=1,
            simulated=simulated,
            protocol_sha256=study.sha256,
            stimuli_sha256=SHA,
            manifest_sha256=SHA,
            plan_sha256=SHA,
            trials=len(trials),
            display="fhd27-60hz",
            display_sha256=SHA,
            display_report=None,
            refresh_hz=75.0 if remote else 60.0,
            gaze_mode="none" if remote else "monitor",
            gaze=None,
            revision="0.1.0 (abcdefa)",
            versions={},
            platform="test",
            timing_evidence="animation frame" if remote else "virtual",
            remote=AT_HOME if remote else None,
        )
    )
    events.append(Consent(**stamp(), agreed=True, language="en", text_sha256=SHA))
    events.append(BlockStart(**stamp(), block=1, trials=len(trials)))
    catch = study.task.catch
    plan = [("main", *trials[index]) for index in order]
    if catch is not None:
        scene = study.main_scenes()[0]
        plan.insert(3, ("catch", scene, catch.where["size"], (catch.better, catch.worse), 0))
    done, position = 0, 0
    for number, (kind, scene, size, (first, second), repeat) in enumerate(plan):
        if decided is not None and done >= decided:
            break
        tries = 2 if kind == "main" and number % 7 == 2 else 1
        for attempt in range(1, tries + 1):
            void = attempt < tries
            picked = choose(first, second, rng) if kind == "main" else True
            choice = "first" if picked else "second"
            side = "left" if picked else "right"
            events.append(
                Attempt(
                    **stamp(),
                    trial=f"{kind}-{number:04d}",
                    attempt=attempt,
                    position=position,
                    block=1,
                    role=kind,
                    repeat=repeat,
                    condition={"scene": scene, "size": size, "first": first, "second": second},
                    track=None,
                    stimuli=(_shown(scene, size, first), _shown(scene, size, second)),
                    answers=("first", "second"),
                    expected="first" if kind == "catch" else None,
                    outcome="void" if void else "completed",
                    void_reason="gaze-break" if void else None,
                    answer=None if void else choice,
                    correct=True if kind == "catch" else None,
                    key=None if void else side,
                    rt_s=None if void else (rt_s or float(np.exp(rng.normal(0.0, 0.3)))),
                    phases=(),
                    dropped=int(rng.random() < 0.05),
                    warned=False,
                    gaze=GazeQuality(
                        samples=250,
                        lost_share=0.01,
                        blinks=1,
                        violations=int(void),
                        mean_deg=0.4,
                        max_deg=1.2,
                    ),
                    gaze_file=None,
                    flips_file=None,
                )
            )
            position += 1
        done += kind == "main"
    if decided is None:
        events.append(BlockEnd(**stamp(), block=1))
        events.append(Answer(**stamp(), question="strategy", text=answer))
        events.append(SessionEnd(**stamp(), reason="completed", completed_trials=done))
    return events


def _shown(scene: str, size: str, method: str) -> ShownStimulus:
    return ShownStimulus(
        name=f"{scene}__{size}__{method}", sha256=SHA, frames_shown=30, frames_planned=30
    )
