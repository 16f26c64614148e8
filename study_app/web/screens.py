"""Screens and headsets that can take part in a study in browsers, and the one change that would
admit most.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from protocols.browser.web_study import deviations_s, tolerance_for_s
from protocols.feasibility import stated_times_s
from protocols.script import PixelSize
from study_app.web.export import WebBuild

SIZES_PX = (
    (1280, 720), (1280, 800), (1366, 768), (1440, 900), (1600, 900), (1680, 1050), (1920, 1080),
    (1920, 1200), (2560, 1440), (2560, 1600), (2880, 1800), (3840, 2160),
)  # fmt: skip
"""Common sizes of participants' screens."""
_SHARES = tuple(number / 20 for number in range(19, 9, -1))
"""Sizes of smaller stimuli that are tried, as shares of an edge."""


def screen_lines(build: WebBuild) -> Iterator[str]:
    """Yield the least screens that can take part, and the change that admits most further kinds.

    Kinds are all common sizes at all common refresh rates.
    """
    window_px = build.window_px()
    width, height = window_px
    yield f"on screens of at least {width} x {height} px, at {_listed(build.rates_hz)} Hz"
    there = _admitted(window_px)
    changes = [*_tolerances(build, there), *_smaller_stimuli(build, there)]
    kinds, said = max(changes, key=lambda change: change[0], default=(0, ""))
    if kinds:
        yield f"one change would admit {kinds} more kinds of common screens: {said}"


def headset_lines(build: WebBuild) -> Iterator[str]:
    """Yield the needs of headsets that take part, and the times that are whole refreshes there."""
    clip, headset = build.stimuli[0], build.headset
    assert headset is not None
    where = "all around" if headset.around else f"flat at {headset.distance_px:.0f} px"
    yield (
        f"in headsets at {_listed(headset.rates)} Hz, with textures of {clip.width_px} x"
        f" {clip.height_px} px, {where}"
    )
    stated = stated_times_s(build.shown)
    for rate in headset.rates:
        off = deviations_s(build.shown, build.at(rate))
        changed = {stated[key]: stated[key] + by_s for key, by_s in off.items()}
        told = [
            f"{1000 * time_s:g} ms are {round(real_s * rate)} refreshes, {1000 * real_s:.1f} ms"
            for time_s, real_s in sorted(changed.items())
        ]
        if told:
            yield f"at {rate:g} Hz: {'; '.join(told)}"


def _tolerances(build: WebBuild, there: Sequence[PixelSize]) -> Iterator[tuple[int, str]]:
    wanted_s = {
        rate: tolerance_s
        for rate, problems in build.rates.items()
        if problems
        and (tolerance_s := tolerance_for_s(build.shown, build.display, rate)) is not None
    }
    for most_s in sorted(set(wanted_s.values())):
        rates = [rate for rate, tolerance_s in wanted_s.items() if tolerance_s <= most_s]
        kinds = len(rates) * len(there)
        yield kinds, f"web.tolerance_s = {most_s:g} admits {_listed(rates)} Hz, too"


def _smaller_stimuli(build: WebBuild, there: Sequence[PixelSize]) -> Iterator[tuple[int, str]]:
    clip = build.stimuli[0]
    for share in _SHARES:
        more = [size for size in _admitted(build.window_px(share)) if size not in there]
        if more:
            width, height = (2 * int(share * edge / 2) for edge in (clip.width_px, clip.height_px))
            least = " x ".join(map(str, more[0]))
            yield (
                len(more) * len(build.rates_hz),
                f"stimuli of {width} x {height} px instead of {clip.width_px} x {clip.height_px}"
                f" admit screens of {least} px, too",
            )


def _admitted(window_px: PixelSize) -> list[PixelSize]:
    return [size for size in SIZES_PX if size[0] >= window_px[0] and size[1] >= window_px[1]]


def _listed(rates: Sequence[float]) -> str:
    *first, last = (f"{rate:g}" for rate in rates)
    return f"{', '.join(first)} or {last}" if first else last
