"""Scripts of trials written by hand, for tests of the machine and of stages."""

from protocols.script import Frames, GazeMode, ScriptPhase, ScriptQuestion, TrialScript


def asking(*answers: str, name: str = "answer") -> ScriptQuestion:
    """Return a question with a key per answer: a, b, c, ..."""
    keys = tuple((key,) for key in "abcdefghi"[: len(answers)])
    return ScriptQuestion(name=name, answers=answers, keys=keys)


def shows(stimulus: int, every: int = 0, x_px: int = 0) -> Frames:
    """Return a stimulus at its place, `every` refreshes per frame."""
    return Frames(stimulus=stimulus, every=every, last=999, at=(x_px, 0))


def watched(name: str, frames: int | None, *show: Frames, **rest: object) -> ScriptPhase:
    return ScriptPhase(name=name, frames=frames, show=show, watched=True, **rest)


def a_script(
    phases: tuple[ScriptPhase, ...],
    dropped_max: int = 1,
    gaze: GazeMode = GazeMode.ENFORCE,
    correct: str | None = None,
) -> TrialScript:
    """Return a script of these phases on a small screen."""
    return TrialScript(
        trial="main-0000",
        language="en",
        display="small",
        size_px=(640, 480),
        refresh_hz=60.0,
        background=128,
        stimuli=(),
        stimulus_px=(64, 64),
        phases=phases,
        correct=correct,
        gaze=gaze,
        dropped_max=dropped_max,
        pause_keys=("p",),
        quit_keys=("escape",),
    )
