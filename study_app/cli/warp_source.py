"""What `metamerlab warp` is given: a file, a stereo pair, or a built-in one."""

from __future__ import annotations

from dataclasses import dataclass, fields
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pipeline.warp.settings import WarpSettings
from protocols.errors import StudyError
from stimuli.exr import Channels, Transfer, WarpInput, load_warp_input
from stimuli.scenes.stereo import BUILT_IN, PAIR_WARP, StereoPair, built_in_pair, load_pair


@dataclass(frozen=True)
class FileOptions:
    """What is said about a file of RGBZ and flow."""

    clip: bool = False
    encoded: bool = False
    channels: tuple[str, ...] = ()  # WHAT=NAME


@dataclass(frozen=True)
class PairOptions:
    """What is said about a stereo pair; see `stimuli.scenes.stereo.load_pair`."""

    disparity: Path | None
    right: Path | None
    units_per_px: float
    focal_px: float | None
    baseline_m: float
    offset_px: float
    amount: float


@dataclass(frozen=True)
class Loaded:
    """What to warp, how it is warped where nothing else is said, and the truth if it is known."""

    frame: WarpInput
    settings: WarpSettings
    truth: NDArray[np.float32] | None


def load(source: str, file: FileOptions, pair: PairOptions) -> Loaded:
    """Read what to warp.

    Raises
    ------
    StudyError
        If the source is nothing that can be warped, or an option belongs to another kind.
    OSError, InputError
        If a file is missing or not what it must be.
    """
    path = Path(source)
    if path.suffix.lower() == ".exr" and pair.disparity is None:
        if pair.amount != 1.0 or pair.right is not None:
            raise StudyError("--amount and --right belong to stereo pairs: a file has its flow")
        transfer = Transfer.ENCODED if file.encoded else None
        names = _channels(file.channels)
        frame = load_warp_input(path, channels=names, transfer=transfer, clip=file.clip)
        return Loaded(frame, WarpSettings(), None)
    if file != FileOptions():
        raise StudyError("--clip, --encoded and --channel belong to files of RGBZ and flow")
    loaded = _load_pair(source, pair)
    # Half way between the cameras there is no photograph to compare with.
    truth = loaded.right if pair.amount == 1.0 else None
    return Loaded(loaded.warp_input(pair.amount), PAIR_WARP, truth)


def _load_pair(source: str, options: PairOptions) -> StereoPair:
    path = Path(source)
    if source in BUILT_IN and not path.exists():
        return built_in_pair(source)
    if options.disparity is not None:
        return load_pair(
            path,
            options.disparity,
            options.right,
            units_per_px=options.units_per_px,
            focal_px=options.focal_px,
            baseline_m=options.baseline_m,
            offset_px=options.offset_px,
        )
    if path.exists():
        raise StudyError(
            f"{path}: must be an .exr file with RGBZ and flow, or come with --disparity FILE"
        )
    raise StudyError(f"{source}: no such file, and not a built-in pair ({', '.join(BUILT_IN)})")


def _channels(settings: tuple[str, ...]) -> Channels:
    known = [field.name for field in fields(Channels)]
    given: dict[str, tuple[str, ...]] = {}
    for setting in settings:
        what, equals, name = setting.partition("=")
        if what not in known or not equals or not name:
            raise StudyError(
                f"--channel must be WHAT=NAME with WHAT one of {', '.join(known)} (got {setting!r})"
            )
        given[what] = (name,)
    return Channels(**given)
