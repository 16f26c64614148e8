"""A session on a virtual stage with a tracker's adapter: calibration, blink, loss, break, death.

The other end is a server of a test, which sends what an eye does up to the virtual clock.
"""

import time
from dataclasses import dataclass, field
from pathlib import Path

from protocols.display import Viewing
from protocols.journal_file import Journal, read_journal
from protocols.load import load_display, load_protocol
from protocols.study_file.schema import StudyProtocol
from study_app.conduct import conduct
from study_app.gaze.gaze_check import GazeCheck, Targets
from study_app.gaze.source import TrackerContext
from study_app.gaze.trusted import TrustedGaze
from study_app.observers import ArtificialObserver, PreferenceModel
from study_app.opening import begin
from study_app.simulate import SimulatedStudy
from study_app.virtual import VirtualClock, VirtualStage

FHD = load_display("fhd27-60hz")
VIEWING = Viewing.of(FHD)
MIDDLE_PX = (960.0, 540.0)
AT_S = 1.5
"""After the beginning of its attempt, something happens."""
FOREVER = 10**6
"""Targets: a tracker that is gone so long does not come back."""


@dataclass
class Eye:
    """Looks at the target, and does in each attempt what the plan says."""

    plan: tuple[str, ...] = ()
    """By attempt: `blink`, `loss`, `break`, `death`, or nothing."""
    target_px: tuple[float, float] = MIDDLE_PX
    attempt: int = -1
    began_s: float = 0.0
    offset_px: tuple[float, float] = (6.0, -4.0)
    targets: int = 0
    """Number of targets shown so far, by calibration, drift check and validation."""
    gone: range = range(0)
    """Targets at which the tracker is not there."""

    def now(self, t_s: float) -> str:
        """Return what happens at a time."""
        if self.targets in self.gone:
            return "death" if self.gone.stop >= FOREVER else "break"
        if not 0 <= self.attempt < len(self.plan):
            return ""
        what, since_s = self.plan[self.attempt], t_s - self.began_s - AT_S
        length_s = {"blink": 0.1, "loss": 0.4, "break": 0.5, "death": 1e9}.get(what, 0.0)
        return what if 0 <= since_s < length_s else ""

    def place(self, t_s: float) -> tuple[float, float] | None:
        """Return where it looks; None where it is not seen."""
        if self.now(t_s) in ("blink", "loss"):
            return None
        return self.target_px[0] + self.offset_px[0], self.target_px[1] + self.offset_px[1]


@dataclass
class Sat:
    """Results of a session."""

    journal: Journal
    source: TrustedGaze
    shown_px: list[tuple[float, float] | None] = field(default_factory=list)
    """Targets that the tracker had shown, without repeats."""


class Operated(ArtificialObserver):
    """Someone is there who brings the tracker back, and has it calibrated again."""

    tracker: tuple[Eye, TrustedGaze, VirtualClock]

    def turn_page(self, page):
        """Go on where a calibration is offered, as at every page."""
        turned = super().turn_page(page)
        if page.name != "calibration":
            return turned
        eye, gaze, clock = self.tracker
        if eye.gone.stop < FOREVER:
            eye.gone = range(0)
            clock.move_to(clock() + 1 / 60)  # samples are due: who polls waits for the connection
        gaze.poll()
        return turned._replace(key=self._response.continue_keys[0])


def pumped(adapter, server, eye: Eye, clock: VirtualClock):
    """Return an adapter's class whose other end keeps up with the virtual clock."""

    class Pumped(adapter):
        opened, at_s = False, 0.0

        def open(self):
            super().open()
            self.opened = True

        def poll(self):
            if not self.opened:
                clock.move_to(clock() + 1 / 60)
            due, samples, until_s = 0, [], time.monotonic() + 30.0
            while True:  # few at a time: after a page, a datagram too many would be lost
                self.at_s = min(self.at_s + 0.1, clock())
                due += server.advance(self.at_s)
                while True:
                    samples += super().poll()
                    if len(samples) >= due or time.monotonic() > until_s:
                        break
                    time.sleep(0.0005)
                if self.at_s >= clock():
                    return samples

        def calibrate(self, points_px):
            self.poll()  # or what was due over the page would be of the calibration
            return super().calibrate(points_px)

        def mark(self, text):
            eye.attempt, eye.began_s = eye.attempt + 1, clock()
            super().mark(text)

    return Pumped


def study_of(**changes) -> StudyProtocol:
    plain = load_protocol(Path("demo")).model_dump()
    plain["gaze"] |= {"mode": "enforce"}
    plain["design"] |= {"repeats": 1}
    plain["task"] |= {"pairings": (("metameric", "push-pull"),)}
    for section, values in changes.items():
        plain[section] |= values
    return StudyProtocol.model_validate(plain)


def sit(folder: Path, make, eye: Eye, clock: VirtualClock, *, validates=True, **changes) -> Sat:
    """Conduct a session; `make` makes the adapter of a `TrackerContext`."""
    study, shown = study_of(**changes), []
    observer = Operated(PreferenceModel(), study.response, 0, "S001")
    stage, targets = VirtualStage(clock, 60.0, observer), Targets()

    def look_at(place_px, duration_s, poll, _on_key=None):
        if shown[-1:] != [place_px]:
            shown.append(place_px)
            eye.targets += place_px is not None
        eye.target_px = place_px or MIDDLE_PX
        until_s = clock() + duration_s
        while True:
            clock.move_to(clock() + 1 / 60)
            poll()
            if clock() >= until_s:
                eye.target_px = MIDDLE_PX
                return True

    targets.show = look_at
    desk = TrackerContext(
        FHD, clock, lambda: MIDDLE_PX, 60.0, targets, store=study.privacy.store_gaze
    )
    gaze = TrustedGaze(make(desk), clock)
    gaze.open()
    observer.tracker = eye, gaze, clock
    setup = SimulatedStudy(study, FHD).setup(folder, clock, "S001")
    recorder, plan = begin(setup, stage, gaze)
    asked = []

    class Check(GazeCheck):
        def _calibrate(self):
            done = super()._calibrate()
            asked.extend(shown)
            return done

    check = Check(gaze, setup, stage, recorder, targets) if validates else None
    try:
        with recorder:
            conduct(setup, plan, recorder, stage, gaze, gaze_check=check)
    finally:
        gaze.close()
    return Sat(read_journal(recorder.path), gaze, asked)
