"""Artificial observers through the real session, state machine and recorder.

Only the stage and the eye are virtual. Every journal says that it is simulated.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property, partial
from pathlib import Path

import numpy as np

from protocols.disk.hashing import Json, sha256_json
from protocols.display import Display, Viewing
from protocols.feasibility import virtual_manifest
from protocols.journal import Attempt
from protocols.manifest import Manifest
from protocols.plan import PlannedTrial
from protocols.study_file.schema import StudyProtocol
from study_app.conduct import RunOutcome, conduct
from study_app.gaze.simulated import HUMAN, GazeBehaviour, SimulatedGaze
from study_app.observers import ArtificialObserver, ObserverModel, default_model, rng_of
from study_app.opening import begin, resume
from study_app.session_folders import find_sessions, is_stillborn
from study_app.session_setup import SessionListener, SessionSetup
from study_app.shown_texts import require_showable
from study_app.virtual import Fault, VirtualClock, VirtualStage


@dataclass(frozen=True)
class SimulatedStudy:
    """Everything a simulated study depends on."""

    study: StudyProtocol
    display: Display
    seed: int = 0
    model: ObserverModel | None = None
    """Left out: the default population of the study's task."""
    gaze: GazeBehaviour = HUMAN
    gaze_rate_hz: float = 250.0
    missed_per_flip: float = 0.0
    """Probability that a flip misses one refresh."""
    late_per_flip: float = 0.0
    """Probability that a flip comes late within its refresh."""
    doubled_per_flip: float = 0.0
    """Probability that a flip does not wait for its refresh."""
    manifest: Manifest | None = None
    """Clips that were built; left out: clips without pixels."""

    @cached_property
    def shown(self) -> Manifest:
        """The clips of the sessions."""
        return self.manifest or virtual_manifest(self.study, self.display)

    @property
    def described(self) -> str:
        """Seed, and a hash of all else that decides what observers do."""
        model = self.model or default_model(self.study)
        options: list[Json] = [
            repr(model), repr(self.gaze), self.gaze_rate_hz, self.missed_per_flip,
            self.late_per_flip, self.doubled_per_flip,
        ]  # fmt: skip
        return f"seed {self.seed}, observers {sha256_json(options)[:12]}"

    def setup(
        self, root: Path, clock: VirtualClock, participant: str, language: str | None = None
    ) -> SessionSetup:
        """Return the setup of a session below `root`."""
        return SessionSetup(
            study=self.study,
            display=self.display,
            manifest=self.shown,
            root=root,
            participant=participant,
            language=language,
            wall_clock=clock.wall,
            simulated=True,
            timing_evidence="virtual",
            simulation=self.described,
        )


def participant_code(number: int) -> str:
    """Return the code of a simulated participant: S001, S002, ..."""
    return f"S{number + 1:03d}"


def simulate_study(
    simulation: SimulatedStudy,
    root: Path,
    participants: int,
    *,
    on_attempt: Callable[[str, Attempt], None] = lambda _p, _a: None,
) -> dict[str, RunOutcome]:
    """Run the sessions of several observers; one that stopped is gone on with.

    Parameters
    ----------
    simulation : SimulatedStudy
        The study and its observers.
    root : Path
        Folder of sessions: ``root/STUDY/S001/journal.jsonl`` and so on.
    participants : int
        How many observers.
    on_attempt : callable
        Told each participant and attempt, for a progress bar.

    Returns
    -------
    dict
        Outcome by participant, of those whose session was not complete before.

    Raises
    ------
    StudyError
        If the display cannot show the study, or a folder holds something else.
    """
    require_showable(simulation.study, simulation.display, simulation.shown)
    outcomes = {}
    finished = (
        {
            session.participant
            for session in find_sessions(root, simulation.study.study.name)
            if session.state == "completed"
        }
        if root.is_dir()
        else set()
    )
    for code in map(participant_code, range(participants)):
        if code in finished:
            continue
        outcomes[code] = simulate_session(
            simulation, root, code, on_attempt=partial(on_attempt, code)
        )
    return outcomes


def simulate_session(
    simulation: SimulatedStudy,
    root: Path,
    participant: str,
    *,
    language: str | None = None,
    on_attempt: Callable[[Attempt], None] = lambda _: None,
) -> RunOutcome:
    """Run, or go on with, one observer's session.

    Raises
    ------
    StudyError
        As `begin` and `resume` say.
    """
    clock = VirtualClock()
    setup = simulation.setup(root, clock, participant, language)
    setup = replace(setup, late_most=sys.maxsize)  # what is missed was asked for
    stage, gaze = _stage(simulation, participant, clock)
    folder = root / simulation.study.study.name / participant
    goes_on = folder.exists() and not is_stillborn(folder)
    recorder, plan = (resume if goes_on else begin)(setup, stage, gaze)
    recorder.waits_for_disk = False  # it can be simulated anew
    listener = SessionListener(on_attempt=lambda attempt, _: on_attempt(attempt))
    with recorder:
        return conduct(setup, plan, recorder, stage, gaze, listener)


def _stage(
    simulation: SimulatedStudy, participant: str, clock: VirtualClock
) -> tuple[VirtualStage, SimulatedGaze | None]:
    """Return the virtual display and, where the protocol watches gaze, the eye."""
    study, display = simulation.study, simulation.display
    model = simulation.model or default_model(study)
    observer = ArtificialObserver(model, study.response, simulation.seed, participant)
    gaze = None
    if study.gaze.mode != "none":
        dot = (study.trial.fixation_x_deg, study.trial.fixation_y_deg)
        gaze = SimulatedGaze(
            clock,
            Viewing.of(display),
            dot,
            rate_hz=simulation.gaze_rate_hz,
            behaviour=simulation.gaze,
        )
    shown_s = study.trial.fixation_s + study.task.shown_s(study.pool)
    flips = round(4 * shown_s * display.refresh_hz)

    def on_prepare(trial: PlannedTrial, attempt: int) -> Mapping[int, Fault]:
        rng = rng_of(simulation.seed, "attempt", participant, trial.id, attempt)
        if gaze is not None:
            gaze.restart(int(rng.integers(2**63)))
        return _faults(simulation, flips, rng)

    stage = VirtualStage(clock, display.refresh_hz, observer, on_prepare=on_prepare)
    stage.show_live(display, simulation.shown)
    return stage, gaze


def _faults(
    simulation: SimulatedStudy, flips: int, rng: np.random.Generator
) -> Mapping[int, Fault]:
    """Draw what goes wrong with the flips of one attempt; the first has none to be judged by."""
    kinds: tuple[tuple[float, Fault], ...] = (
        (simulation.missed_per_flip, Fault("missed", 1.0)),
        (simulation.late_per_flip, Fault("late", 0.3)),
        (simulation.doubled_per_flip, Fault("doubled")),
    )
    faults: dict[int, Fault] = {}
    for probability, fault in kinds:
        if probability > 0:
            drawn = (rng.uniform(size=flips) < probability).nonzero()[0]
            faults |= {int(flip): fault for flip in drawn if flip}
    return faults
