"""Opens a session: checks that everything fits, gives a slot, begins or resumes the journal."""

from __future__ import annotations

import platform
import sys
from importlib import metadata

from protocols.against_plan import contradictions
from protocols.disk.hashing import sha256_json
from protocols.display import Display
from protocols.errors import StudyError
from protocols.feasibility import require_feasible
from protocols.journal import (
    Attempt,
    GazeInfo,
    SessionEnd,
    SessionResume,
    SessionStart,
)
from protocols.journal_file import JOURNAL_NAME
from protocols.manifest import check_manifest
from protocols.plan import Plan, make_plan
from protocols.revision import code_revision, package_version
from protocols.study_file.schema import StudyProtocol
from study_app.gaze.saccades import check_saccade_rate
from study_app.gaze.source import GazeSource
from study_app.recorder import Recorder
from study_app.session_folders import (
    claimed,
    next_slot,
    require_portable,
    require_unused,
)
from study_app.session_setup import SessionSetup
from study_app.stage import Stage


def begin(setup: SessionSetup, stage: Stage, gaze: GazeSource | None) -> tuple[Recorder, Plan]:
    """Give a new participant a slot and a plan, and write the first line.

    Raises
    ------
    StudyError
        If the display cannot do the protocol, the manifest is another study's, the code was
        used, the language is missing, or the folder cannot be written. Nothing is written then.
    """
    study = setup.study
    require_feasible(study, setup.display, setup.manifest)
    check_manifest(study, setup.manifest)
    _check_rate(setup.display, stage)
    _ = setup.texts  # refused where there are none
    info = _gaze_info(study, gaze)
    folder = setup.folder
    require_portable(folder)
    require_unused(folder)
    with claimed(setup.root):
        slot = next_slot(setup.root, study.study.name)
        plan = make_plan(study, setup.manifest, setup.participant, slot)
        torn = (folder / JOURNAL_NAME).exists()
        open_journal = Recorder.resume if torn else Recorder.create
        recorder = open_journal(folder, stage.now, setup.wall_clock)
        simulation = {_SIMULATION: setup.simulation} if setup.simulation else {}
        recorder.append(
            SessionStart(
                **recorder.stamps(),
                study=study.study.name,
                task=study.task.kind,
                participant=setup.participant,
                slot=slot,
                language=setup.spoken,
                seed=study.design.seed,
                simulated=setup.simulated,
                protocol_sha256=study.sha256,
                stimuli_sha256=study.stimuli_sha256,
                manifest_sha256=setup.manifest.sha256,
                plan_sha256=plan.sha256,
                trials=plan.main_trials,
                display=setup.display.name,
                display_sha256=sha256_json(setup.display),
                display_report=setup.display_report,
                refresh_hz=stage.refresh_hz,
                gaze_mode=study.gaze.mode,
                gaze=info,
                revision=f"{package_version()} {code_revision()}",
                versions=session_versions() | dict(setup.drawn_by) | simulation,
                platform=platform.platform(),
                timing_evidence=setup.timing_evidence,
            )
        )
    return recorder, plan


def resume(setup: SessionSetup, stage: Stage, gaze: GazeSource | None) -> tuple[Recorder, Plan]:
    """Go on with a session that stopped: same plan, same order.

    Raises
    ------
    StudyError
        If there is no such session, it is complete or withdrawn, its journal is damaged, or
        protocol, clips or display are not what it was begun with.
    """
    study = setup.study
    require_feasible(study, setup.display, setup.manifest)
    _check_rate(setup.display, stage)
    info = _gaze_info(study, gaze)
    recorder = Recorder.resume(setup.folder, stage.now, setup.wall_clock)
    try:
        plan = _same_plan(setup, recorder)
        recorder.append(
            SessionResume(
                **recorder.stamps(),
                revision=f"{package_version()} {code_revision()}",
                versions=session_versions() | dict(setup.drawn_by),
                display_report=setup.display_report,
                gaze=info,
                torn_file=recorder.torn_file,
            )
        )
    except StudyError:
        recorder.close()
        raise
    return recorder, plan


_SIMULATION = "simulation"


def session_versions() -> dict[str, str]:
    """Return the versions a session depends on."""
    found = {"python": sys.version.split()[0]}
    for name in ("moderngl", "glfw", "numpy", "pydantic", "pillow", "pylsl"):
        try:
            found[name] = metadata.version(name)
        except metadata.PackageNotFoundError:
            found[name] = "missing"
    return found


def _check_rate(display: Display, stage: Stage) -> None:
    off = stage.refresh_hz / display.refresh_hz - 1
    if abs(off) > display.refresh_tolerance_share:
        raise StudyError(
            f"display {display.name!r}: must refresh at {display.refresh_hz:g} Hz within"
            f" {100 * display.refresh_tolerance_share:g} % (got {stage.refresh_hz:.6g} Hz); set"
            " the mode, or name the display that is there"
        )


def _gaze_info(study: StudyProtocol, gaze: GazeSource | None) -> GazeInfo | None:
    mode = study.gaze.mode
    if mode == "none":
        return None
    if gaze is None:
        raise StudyError(
            f"gaze: mode {mode!r} needs a gaze source; connect one, or set gaze.mode = 'none'"
        )
    info = gaze.info()
    if info.rate_hz < study.gaze.rate_min_hz:
        raise StudyError(
            f"gaze: the source must send at least {study.gaze.rate_min_hz:g} Hz"
            f" (got {info.rate_hz:g} Hz from {info.source})"
        )
    if any(one.change != "always" for one in study.stimuli.live_methods().values()):
        check_saccade_rate("stimuli.change: during-saccades", info.rate_hz)
    return GazeInfo(
        source=info.source,
        description=info.description,
        rate_hz=info.rate_hz,
        clock_offset_s=info.clock_offset_s,
    )


def _same_plan(setup: SessionSetup, recorder: Recorder) -> Plan:
    """Return the plan the session was begun with, or say what has changed since."""
    events = recorder.events
    if not events or not isinstance(events[0], SessionStart):
        raise StudyError(
            f"{recorder.path}: must begin with a session-start event; start a new session"
        )
    start = events[0]
    last = events[-1]
    if isinstance(last, SessionEnd) and last.reason in {"completed", "consent-refused"}:
        raise StudyError(f"{recorder.path}: the session is over ({last.reason})")
    for what, now, then in (
        ("protocol", setup.study.sha256, start.protocol_sha256),
        ("manifest of the clips", setup.manifest.sha256, start.manifest_sha256),
        ("display", sha256_json(setup.display), start.display_sha256),
    ):
        if now != then:
            raise StudyError(
                f"{recorder.path}: the {what} must be the one the session began with (hash"
                f" {then[:12]}, got {now[:12]}); restore it to continue"
            )
    if start.simulated != setup.simulated:
        raise StudyError(f"{recorder.path}: simulated and real sessions must not be mixed")
    before = start.versions.get(_SIMULATION, setup.simulation)
    if before != setup.simulation:
        raise StudyError(
            f"{recorder.path}: a simulated session must continue with the same observer"
            f" ({before or 'none stated'}, got {setup.simulation or 'none stated'}); give the"
            " same --seed and options, or another folder"
        )
    plan = make_plan(setup.study, setup.manifest, setup.participant, start.slot)
    if plan.sha256 != start.plan_sha256:
        raise StudyError(
            f"{recorder.path}: the plan must come out as it did (hash {start.plan_sha256[:12]},"
            f" got {plan.sha256[:12]}); resume with revision {start.revision}"
        )
    attempts = [event for event in events if isinstance(event, Attempt)]
    for attempt, reason in contradictions(setup.study, plan, attempts):
        raise StudyError(
            f"{recorder.path}: line {attempt.n + 1}: {reason}; the journal was changed after it"
            " was written: restore it from a copy"
        )
    return plan
