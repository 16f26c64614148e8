"""Faults that are planted, and must be found and nothing else: of timing, and of what was shown."""

from collections.abc import Mapping
from random import Random

from attack.captured_flips import CapturedPicture, compare

from study_app.attempt import BLANK
from study_app.observers import ArtificialObserver, PreferenceModel
from study_app.pacing import LATE_SHARE, Pacer
from study_app.stage import FlipPicture
from study_app.virtual import Fault, VirtualClock, VirtualStage

RATES_HZ = (60, 90, 120, 144, 240)
FLIPS_PER_FAULT = 15


def stage_with(
    faults: Mapping[int, Fault], rate_hz: float, true_hz: float | None = None
) -> VirtualStage:
    """Return a virtual display with faults by number of flip, and no one before it."""
    observer = ArtificialObserver(PreferenceModel(), None, 0, "P01")  # type: ignore[arg-type]
    stage = VirtualStage(
        VirtualClock(),
        true_hz or rate_hz,
        observer,
        nominal_hz=rate_hz,
        on_prepare=lambda _trial, _attempt: faults,
    )
    stage.prepare(None, None, 1)  # type: ignore[arg-type]
    return stage


def planted(count: int, flips: int, seed: object) -> dict[int, Fault]:
    """Return faults at distinct flips, never at the first: no flip before judges it."""
    chance = Random(str(seed))
    faults = {}
    for flip in sorted(chance.sample(range(1, flips), count)):
        kind = chance.choice(["late", "missed", "doubled"])
        amount = {
            "late": chance.uniform(LATE_SHARE + 0.05, 0.45),
            "missed": float(chance.randint(1, 4)),
            "doubled": 0.0,
        }[kind]
        faults[flip] = Fault(kind, amount)  # type: ignore[arg-type]
    return faults


def check_timing(count: int, rate_hz: float, off_share: float, seed: object) -> None:
    """Plant faults into a display whose true rate is a little off; all are found, and no other.

    Raises
    ------
    AssertionError
        If one was missed, or found where none is.
    """
    flips = FLIPS_PER_FAULT * count
    faults = planted(count, flips, seed)
    stage = stage_with(faults, rate_hz, rate_hz * (1 + off_share))
    pacer = Pacer(stage.refresh_hz)
    found = {}
    for number in range(flips):
        flip = pacer.flip(stage.show(FlipPicture(BLANK)).t_s)
        if flip.kind not in ("first", "on-time"):
            found[number] = (flip.kind, flip.missed)
    wanted = {
        number: (fault.kind, int(fault.amount) if fault.kind == "missed" else 0)
        for number, fault in faults.items()
    }
    assert found == wanted  # precision and recall are both 1


def check_capture(seed: object) -> None:
    """Capture two attempts between pages as they were shown, then with one thing amiss.

    Raises
    ------
    AssertionError
        If the whole capture differs from its log, or the other one does not where it must.
    """
    chance = Random(str(seed))
    names = {f"pixels {n}": f"clip/{n:06d}" for n in range(9)}
    logged: dict[int, str | None] = {}
    capture, attempts, number = [], [], 0
    for _ in range(2):
        for _ in range(chance.randint(1, 4)):  # a page
            capture.append(CapturedPicture(number, "page"))
            number += 1
        first = number
        shown = [None, *chance.sample(sorted(names), 6), None]
        for content in shown:
            capture.append(CapturedPicture(number, content or "grey"))
            logged[number] = names.get(content or "")
            number += 1
        attempts.append(range(first, number))
    capture += [CapturedPicture(number, "page"), CapturedPicture(number + 1, "page")]
    assert compare(logged, capture, names, attempts=attempts) == []

    place = chance.choice([i for i, seen in enumerate(capture) if logged.get(seen.number)])
    seen = capture[place]
    match chance.randrange(6):
        case 0:  # it was never shown
            del capture[place]
        case 1:  # another frame was
            others = sorted(set(names) - {seen.content})
            capture[place] = seen._replace(content=chance.choice(others))
        case 2:  # something else was
            capture[place] = seen._replace(content="noise")
        case 3:  # the log has it not
            del logged[seen.number]
        case 4:  # an old one was shown again
            capture.insert(chance.randint(place + 2, len(capture)), seen)
        case _:  # a clip frame on a page
            page = chance.choice([i for i, s in enumerate(capture) if s.content == "page"])
            capture[page] = seen = capture[page]._replace(content=chance.choice(sorted(names)))
    found = compare(logged, capture, names, attempts=attempts)
    assert seen.number in {difference.number for difference in found}
