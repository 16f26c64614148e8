"""Denoising networks: ONNX files of ours, run by ONNX Runtime on the CPU.

A network takes the planes of `seen_by`: a noisy picture, encoded R'G'B' in [0, 1], the level of
detail of every pixel's pool, and the noisy picture's own moments, for pools reach further than a
network of eight layers sees. It gives corrections. One of kind ``moments`` gives ``base``
(1, 3, H, W) and ``maps`` (1, 25, H / 4, W / 4), to be added to the noisy picture's own (see
`MomentMaps.packed`); one of kind ``rgb`` gives ``base`` alone, to be added to the picture. What it
was trained for stands in the file.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from importlib import resources
from pathlib import Path
from typing import Any, Literal, get_args

import numpy as np
from numpy.typing import NDArray

from pipeline.denoising.maps import BLOCK_PX, LEVELS, MomentMaps, Sampling, maps_of
from pipeline.errors import InputError
from pipeline.foveation.geometry import WIDEST_FLAT_DEG
from pipeline.foveation.picture_fixation import float_picture
from pipeline.foveation.pooling import Pooling, Pools
from pipeline.methods.onnx_files import BoundedNetwork, NetworkError, on_one_line, open_session
from protocols.errors import must_be_one_of
from protocols.outside import reading

Kind = Literal["moments", "rgb"]
Colour = NDArray[np.float32]

VALUES = 5
"""Number of values of a level, in ``maps``: deviations of three bands, Cb and Cr."""
LOD_SCALE, MAPS_SCALE = 8.0, 1 / 8
"""Levels of detail and moments are divided by these, to be about as large as colours."""
MULTIPLE_PX = 8
"""Pictures are padded to a multiple of this: the network halves three times."""
FACTS_KEY = "metamerlab.denoise"
_CURE = "version 0.3 made them, with: metamerlab denoise train"


@dataclass(frozen=True)
class NetworkFacts:
    """Purpose of a network, and how it was made.

    Parameters
    ----------
    kind : {"moments", "rgb"}
    levels : int
        Of the pyramid, from 1 to 6.
    pooling : Pooling
        Whose moments it predicts.
    sampling : Sampling
        Of the noisy pictures.
    width_deg, edge_px : float, int
        Of its training pictures on the eye.
    made : mapping
        How it was trained: scenes, views, steps, seed, versions.
    """

    kind: Kind
    levels: int = 5
    pooling: Pooling = field(default_factory=Pooling)
    sampling: Sampling = field(default_factory=Sampling)
    width_deg: float = 40.0
    edge_px: int = 256
    made: Mapping[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if self.kind not in get_args(Kind):
            raise InputError(must_be_one_of("kind", self.kind, get_args(Kind)))
        for name, value, most in (("levels", self.levels, 6), ("edge_px", self.edge_px, 1 << 15)):
            if not (isinstance(value, int) and 1 <= value <= most):
                raise InputError(f"{name} must be a whole number in 1..{most} (got {value!r})")
        if not 0 < self.width_deg < WIDEST_FLAT_DEG:
            raise InputError(f"width_deg must lie between 0 and 180 (got {self.width_deg})")
        if not isinstance(self.made, Mapping):
            raise InputError(f"made must be a table (got {type(self.made).__name__})")

    @classmethod
    def from_json(cls, text: str) -> NetworkFacts:
        """Read the facts in a file's metadata.

        Raises
        ------
        ValueError, TypeError, KeyError, InputError
            If it is something else.
        """
        held = dict(json.loads(text))
        if held.pop("version") != 2:
            raise ValueError("it is of another version")
        held["pooling"] = Pooling(**held["pooling"])
        held["sampling"] = Sampling(**held["sampling"])
        return cls(**held)


def shipped_network(kind: Kind) -> Path:
    """The small network that comes with metamerlab."""
    return Path(str(resources.files("pipeline.denoising").joinpath(f"{kind}.onnx")))


class DenoisingNetwork:
    """A network from `path`.

    Raises
    ------
    FileNotFoundError
        If there is no such file.
    MissingExtraError
        If ONNX Runtime is not installed.
    InputError
        If the file is no network of ours.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self._session = open_session(path, "denoising needs")
        self.facts = _facts(path, self._session)
        with reading(path, "a denoising network", InputError):  # its names may be no text
            takes, gives = self._session.inputs, self._session.outputs
            shapes = [list(one.shape or ())[1:2] for one in (*takes, *gives)]
            names = [one.name for one in gives]
        wanted = [[inputs_of(self.facts.levels)], [3]]
        if self.facts.kind == "moments":
            wanted.append([VALUES * self.facts.levels])
        if len(takes) != 1 or shapes != wanted:
            raise InputError(
                f"{path}: a network for {self.facts.kind} must take {wanted[0][0]} channels and"
                f" give {' and '.join(str(one[0]) for one in wanted[1:])} (channels are {shapes});"
                f" {_CURE}"
            )
        self._takes, self._gives = takes[0].name, names

    def moments(self, noisy: NDArray[np.floating], pools: Pools) -> MomentMaps:
        """Predict the moments of the clean picture.

        Parameters
        ----------
        noisy : ndarray of shape (H, W, 3)
            Encoded R'G'B' in [0, 1].
        pools : Pools
            Of a geometry of this size, with the network's own law.

        Raises
        ------
        InputError
            If the picture is none, has another size than the pools, or the network fails on it.
        """
        self._need("moments")
        seen = seen_by(noisy, pools, self.facts.levels)
        base, maps = self._run(seen)
        height, width = noisy.shape[:2]
        blocks = maps[: -(-height // BLOCK_PX), : -(-width // BLOCK_PX)]
        return MomentMaps.unpacked(
            seen.own.base + base[:height, :width], seen.own.packed() + blocks
        )

    def colour(self, noisy: NDArray[np.floating], pools: Pools) -> Colour:
        """Predict the clean picture itself: (H, W, 3) in [0, 1]. See `moments`."""
        self._need("rgb")
        height, width = noisy.shape[:2]
        (base,) = self._run(seen_by(noisy, pools, self.facts.levels))
        return np.ascontiguousarray(np.clip(noisy + base[:height, :width], 0, 1), np.float32)

    def _need(self, kind: Kind) -> None:
        if self.facts.kind != kind:
            raise InputError(
                f"{self.path}: must be a network for {kind} (it is one for {self.facts.kind})"
            )

    def _run(self, seen: NetworkInput) -> list[Colour]:
        height, width = seen.planes.shape[2:]
        try:
            found = self._session.run(self._gives, {self._takes: seen.planes})
        except NetworkError as error:
            raise InputError(
                f"{self.path}: the network must run on {width} x {height} px"
                f" (ONNX Runtime says: {on_one_line(error)}); {_CURE}"
            ) from error
        shrunk = (1, BLOCK_PX)
        for values, by in zip(found, shrunk, strict=False):
            if values.shape[2:] != (height // by, width // by) or not np.isfinite(values).all():
                raise InputError(
                    f"{self.path}: the network must give finite maps of the picture's size (gave"
                    f" {values.shape}); {_CURE}"
                )
        return [values[0].transpose(1, 2, 0) for values in found]


def inputs_of(levels: int) -> int:
    """Planes that a network sees: colour, level of detail, averaged colour, moments."""
    return 7 + VALUES * levels


@dataclass(frozen=True, eq=False)
class NetworkInput:
    """Input of a network, and the maps that it corrects.

    Parameters
    ----------
    planes : ndarray of float32, shape (1, C, H, W)
        Padded by their border to a multiple of 8 px.
    own : MomentMaps
        Of the noisy picture.
    """

    planes: Colour
    own: MomentMaps


def seen_by(noisy: NDArray[np.floating], pools: Pools, levels: int = LEVELS) -> NetworkInput:
    """Prepare a noisy picture (H, W, 3) for a network.

    Raises
    ------
    InputError
        If the picture is none, or has another size than the pools.
    """
    picture = float_picture(noisy)
    geometry = pools.geometry
    if picture.shape[:2] != (geometry.height_px, geometry.width_px):
        raise InputError(
            f"the noisy picture must have the size that the gaze is given for,"
            f" {geometry.width_px} x {geometry.height_px} px"
            f" (has {picture.shape[1]} x {picture.shape[0]})"
        )
    own = maps_of(picture, pools, levels)
    absent = levels - own.levels  # of a small picture
    own = MomentMaps(
        own.base,
        np.pad(own.deviations, ((0, 0), (0, 0), (0, 3 * absent))),
        np.pad(own.slopes, ((0, 0), (0, 0), (0, absent), (0, 0))),
    )
    height, width = picture.shape[:2]
    moments = own.packed().repeat(BLOCK_PX, axis=0).repeat(BLOCK_PX, axis=1)[:height, :width]
    planes = np.concatenate(
        [picture, pools.lod()[..., None] / LOD_SCALE, own.base, moments / MAPS_SCALE], axis=2
    )
    below, right = -height % MULTIPLE_PX, -width % MULTIPLE_PX
    padded = np.pad(planes, ((0, below), (0, right), (0, 0)), mode="edge")
    return NetworkInput(np.ascontiguousarray(padded.transpose(2, 0, 1)[None], np.float32), own)


def _facts(path: Path, session: BoundedNetwork) -> NetworkFacts:
    text = session.metadata.get(FACTS_KEY)
    if text is None:
        raise InputError(
            f"{path}: must be a denoising network of metamerlab (it does not say what it is for);"
            f" {_CURE}"
        )
    try:
        return NetworkFacts.from_json(text)
    except (ValueError, TypeError, KeyError, RecursionError) as error:
        raise InputError(
            f"{path}: must say what the network is for, in its metadata {FACTS_KEY!r}"
            f" ({on_one_line(error)}); {_CURE}"
        ) from error
