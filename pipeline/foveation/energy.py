"""A metamer of pooled energies, found by gradient descent: offline, in the place of a full model.

Freeman and Simoncelli 2011, "Metamers of the ventral stream", Nature Neuroscience 14, match
hundreds of correlations in overlapping windows; no package offers it. This one matches less, and
is called an energy model: in Y', Cb and Cr of each level of a pyramid the magnitudes of 4
orientations (quadrature pairs of Freeman and Adelson 1991, "The design and use of steerable
filters", IEEE PAMI 13(9), tables III and VI), the highest frequencies, what lies below the last
level, and the colour itself. All are pooled by the same levels of detail as every condition here.
Adam (Kingma and Ba 2015) moves the pixels beyond the fovea until the pooled values agree.

What it does not match: correlations between places, scales and orientations. So it is no
implementation of Freeman and Simoncelli's model.

Needs torch, the extra `metamers`; without it the module imports and `EnergyMetamer` refuses.
"""

from __future__ import annotations

import hashlib
import io
import json
import math
from collections.abc import Callable, Sequence
from importlib.util import find_spec
from pathlib import Path
from typing import Any, Unpack

import numpy as np
from numpy.typing import NDArray

from pipeline.colour import YCBCR_FROM_RGB
from pipeline.errors import InputError, MissingExtraError
from pipeline.features.reference import check_levels, fitted_kernels
from pipeline.foveation.catalogue import Metamer, PooledCondition
from pipeline.foveation.chain import chain_length
from pipeline.foveation.panorama import by_charts
from pipeline.foveation.picture_fixation import Colour, PictureFixation
from pipeline.foveation.pooling import LAWS, PoolingParameters, Pools
from pipeline.foveation.reference import blurred, finished
from pipeline.frame import AnyArray, Floats
from pipeline.noise.tile import Stream, white_noise
from protocols.disk.whole_file import whole_file
from protocols.errors import must_be_one_of
from protocols.outside import reading

Tensor = Any  # torch may be absent
EnergyProgress = Callable[[int, int, float], None]
"""Called with steps done, steps in all, and the loss over the loss of the blur."""

STARTS = ("metamer", "noise")
ORIENTATIONS = 4
SPACING = 0.67  # between taps, as in Freeman and Adelson's tables
REACH = 4  # taps to each side
SMALLEST_MAGNITUDE = 1 / 512  # half a step of 255: keeps gradients finite where nothing is
LEAST_ENERGY = 1e-5  # of a band's mean square: flat bands are not to be matched to the last digit
RATE = 0.02  # Adam's, of encoded colour; it falls to 0 along half a cosine
START_NOISE = 0.15  # deviation around the blur
STEPS_PER_SAVE = 5
INSTALL = (
    "install it with: pip install 'metamerlab[metamers]' (in a checkout: script/setup --metamers)"
)


class EnergyMetamer(PooledCondition):
    """Pixels that pool to the same energies, by descent; see the module.

    Raises
    ------
    MissingExtraError
        If torch is not installed, with the cure.
    InputError
        If a value is out of range.
    """

    on_charts = False  # one descent, of which one state is kept

    def __init__(
        self,
        *,
        start: str = "metamer",
        steps: int = 60,
        levels: int = 5,
        **pooling: Unpack[PoolingParameters],
    ) -> None:
        super().__init__(**pooling)
        if start not in STARTS:
            raise InputError(must_be_one_of("start", start, STARTS))
        if not 1 <= steps <= 100_000:
            raise InputError(f"steps must lie in 1..100000 (got {steps})")
        check_levels(levels)
        self.start, self.steps, self.levels = start, steps, levels
        if find_spec("torch") is None:
            raise MissingExtraError(
                f"energy-metamer needs torch, which is not installed here; {INSTALL}"
            )

    def apply(self, picture: Colour, fixation: PictureFixation) -> Colour:
        return self.descend(picture, fixation)

    def descend(
        self,
        picture: Colour,
        fixation: PictureFixation,
        *,
        state: Path | None = None,
        progress: EnergyProgress | None = None,
    ) -> Colour:
        """Find the metamer of one fixation, or go on where `state` ends.

        Parameters
        ----------
        state : Path, optional
            A file that is renewed every few steps, and read first if it is there. It may be
            deleted at the end.

        Raises
        ------
        InputError
            If `state` belongs to another picture, gaze, seed or setting, or is damaged.
        """
        import torch

        pools = fixation.pools(self.pooling)
        key = self._key(picture, fixation)
        model = PooledEnergies(pools, self.levels)
        wanted = model(_tensor(picture))
        weights = [1 / (float((value**2).mean()) + LEAST_ENERGY) for value in wanted]
        fade = _tensor(pools.fade().astype(np.float32)[..., None])
        fixed = _tensor(picture)

        def loss_of(pixels: Tensor) -> Tensor:
            found = model(fixed + fade * (pixels - fixed))
            terms = zip(weights, found, wanted, strict=True)
            return sum(weight * ((a - b) ** 2).mean() for weight, a, b in terms)

        with torch.no_grad():
            base = blurred(picture, pools).astype(np.float32)
            scale = max(1e-12, float(loss_of(_tensor(base))))
        kept = None if state is None else _read_state(state, key, picture.shape, self.steps)
        done = 0 if kept is None else int(kept["done"])
        first = self._first(picture, fixation, base) if kept is None else kept["pixels"]
        pixels = _tensor(first).clone().requires_grad_(True)
        descent = torch.optim.Adam([pixels], lr=RATE)
        if kept is not None and done > 0:
            descent.state[pixels] = {
                "step": torch.tensor(float(done)),
                "exp_avg": _tensor(kept["mean"]),
                "exp_avg_sq": _tensor(kept["square"]),
            }
        for step in range(done, self.steps):
            for group in descent.param_groups:
                group["lr"] = RATE * 0.5 * (1 + math.cos(math.pi * step / self.steps))
            descent.zero_grad()
            loss = loss_of(pixels)
            loss.backward()
            descent.step()
            with torch.no_grad():
                pixels.clamp_(0, 1)
            if state is not None and ((step + 1) % STEPS_PER_SAVE == 0 or step + 1 == self.steps):
                moments = descent.state[pixels]
                _write_state(
                    state, key, step + 1, _array(pixels),
                    _array(moments["exp_avg"]), _array(moments["exp_avg_sq"]),
                )  # fmt: skip
            if progress is not None:
                progress(step + 1, self.steps, float(loss.detach()) / scale)
        return finished(picture, _array(pixels).astype(np.float64), pools)

    def loss(self, picture: Colour, shown: Colour, fixation: PictureFixation) -> float:
        """Distance of `shown` from `picture`, over the distance of the blur of equal pooling."""
        import torch

        pools = fixation.pools(self.pooling)
        model = PooledEnergies(pools, self.levels)
        with torch.no_grad():
            wanted = model(_tensor(picture))
            blur = finished(picture, blurred(picture, pools), pools)
            ours, base = (
                sum(
                    float(((a - b) ** 2).mean()) / (float((b**2).mean()) + LEAST_ENERGY)
                    for a, b in zip(model(_tensor(image)), wanted, strict=True)
                )
                for image in (shown, blur)
            )
        return ours / max(1e-12, base)

    def _first(
        self, picture: Colour, fixation: PictureFixation, base: NDArray[np.float32]
    ) -> NDArray[np.float32]:
        if self.start == "metamer":
            law = self.pooling.law
            constant: Any = {LAWS[law][0]: self.pooling.constant}
            ours = Metamer(law=law, fovea_deg=self.pooling.fovea_deg, **constant)
            return (by_charts if fixation.geometry.wraps else Metamer.apply)(
                ours, picture, fixation
            )
        noise = white_noise(fixation.seed, picture.shape[:2], 1, Stream.START)
        return np.clip(base + START_NOISE * noise.astype(np.float32), 0, 1)

    def _key(self, picture: Colour, fixation: PictureFixation) -> str:
        """Hash all that decides the result."""
        parts = {
            "picture": hashlib.sha256(np.ascontiguousarray(picture).tobytes()).hexdigest(),
            "shape": list(picture.shape),
            "geometry": repr(fixation.geometry),
            "gaze": list(fixation.gaze_px),
            "seed": fixation.seed,
            "pooling": str(self.pooling),
            "start": self.start,
            "steps": self.steps,
            "levels": self.levels,
            "format": 1,
        }
        return hashlib.sha256(json.dumps(parts, sort_keys=True).encode()).hexdigest()


class PooledEnergies:
    """The model: pictures (H, W, 3) to a list of pooled values (1, channels, h, w)."""

    def __init__(self, pools: Pools, levels: int) -> None:
        geometry = pools.geometry
        self.wraps = geometry.wraps
        self.count = chain_length(geometry.width_px, geometry.height_px)
        self.levels = min(levels, self.count)
        self._to_ycc = _tensor(YCBCR_FROM_RGB.astype(np.float32))
        kernels = fitted_kernels()
        self._low = _kernel(kernels.low)
        self._high = _kernel(kernels.high)
        self._pairs = _tensor(np.stack(quadrature_pairs()).astype(np.float32))[:, None]
        self._shares: dict[tuple[int, int], Tensor] = {}
        for level in range(self.levels + 1):
            for halvings in range(self.count - level + 1):
                lod = pools.lod(level + halvings, level)
                share = np.clip(lod - halvings, 0, 1).astype(np.float32)
                self._shares[level, halvings] = _tensor(share)[None, None]

    def __call__(self, picture: Tensor) -> list[Tensor]:
        low = (picture @ self._to_ycc.T).permute(2, 0, 1)[None]
        found = [self.pooled(low, 0)]
        high = self._filtered(low, self._high, 1)
        found.append(self.pooled(_magnitude(high**2), 0))
        for level in range(self.levels):
            pairs = self._filtered(low, self._pairs, REACH)
            both = pairs.reshape(3, ORIENTATIONS, 2, *pairs.shape[2:])
            energy = _magnitude((both**2).sum(dim=2))
            found.append(self.pooled(energy.reshape(1, 3 * ORIENTATIONS, *pairs.shape[2:]), level))
            low = self.halve(low)
        found.append(self.pooled(_magnitude(low**2), self.levels))
        return found

    def pooled(self, values: Tensor, level: int) -> Tensor:
        """Choose each place's level of detail from halvings of a level's values; see chain.py."""
        chain = [values]
        for _ in range(self.count - level):
            chain.append(self.halve(chain[-1]))
        chosen = chain[-1]
        for halvings in reversed(range(len(chain) - 1)):
            fine = chain[halvings]
            share = self._shares[level, halvings]
            chosen = (1 - share) * fine + share * self.double(chosen, fine.shape[2:])
        return chosen

    def halve(self, values: Tensor) -> Tensor:
        """Low-pass and keep every second place, as chain.halve."""
        import torch.nn.functional as tools

        height, width = values.shape[2:]
        padded = self._padded(values, (1, 1 + width % 2), (1, 1 + height % 2))
        channels = values.shape[1]
        kernel = self._low.expand(channels, 1, 4, 4)
        return tools.conv2d(padded, kernel, stride=2, groups=channels)

    def double(self, values: Tensor, size: Sequence[int]) -> Tensor:
        """Interpolate by 3/4 and 1/4, as chain.enlarge."""
        import torch.nn.functional as tools

        padded = self._padded(values, (1, 1), (1, 1))
        fine = tools.interpolate(padded, scale_factor=2, mode="bilinear", align_corners=False)
        return fine[:, :, 2 : 2 + size[0], 2 : 2 + size[1]]

    def _filtered(self, values: Tensor, kernels: Tensor, reach: int) -> Tensor:
        import torch.nn.functional as tools

        channels = values.shape[1]
        padded = self._padded(values, (reach, reach), (reach, reach))
        each = kernels.repeat(channels, 1, 1, 1)
        return tools.conv2d(padded, each, groups=channels)

    def _padded(self, values: Tensor, x: tuple[int, int], y: tuple[int, int]) -> Tensor:
        import torch
        import torch.nn.functional as tools

        if not self.wraps:
            return tools.pad(values, (*x, *y), mode="replicate")
        # By index: a panorama of few pixels may go round more than once.
        width = values.shape[3]
        columns = torch.arange(-x[0], width + x[1]) % width
        return tools.pad(values[:, :, :, columns], (0, 0, *y), mode="replicate")


def quadrature_pairs() -> list[Floats]:
    """G2 and H2 of Freeman and Adelson at 4 orientations, in turn: 9x9, of zero sum."""
    axis = SPACING * np.arange(-REACH, REACH + 1)
    x, y = axis[None, :], axis[:, None]
    window = np.exp(-(x**2 + y**2))
    kernels = []
    for index in range(ORIENTATIONS):
        angle = math.pi * index / ORIENTATIONS
        along = x * math.cos(angle) + y * math.sin(angle)
        even = 0.9213 * (2 * along**2 - 1) * window
        odd = 0.9780 * (-2.254 * along + along**3) * window
        for kernel in (even, odd):
            plain = kernel - window * kernel.sum() / window.sum()
            kernels.append(plain / np.sqrt((plain**2).sum()))
    return kernels


def _magnitude(square: Tensor) -> Tensor:
    return (square + SMALLEST_MAGNITUDE**2).sqrt()


def _tensor(values: AnyArray) -> Tensor:
    import torch

    return torch.from_numpy(np.array(values, np.float32))  # a copy: what is given may be read-only


def _kernel(kernel: Floats) -> Tensor:
    return _tensor(kernel.astype(np.float32))[None, None]


def _array(values: Tensor) -> NDArray[np.float32]:
    return np.asarray(values.detach().cpu().numpy(), np.float32)


def _read_state(path: Path, key: str, shape: tuple[int, ...], steps: int) -> dict[str, Any] | None:
    if not path.exists():
        return None
    cure = "delete it to begin anew"
    with reading(path, "a state of energy-metamer", InputError, cure):
        with np.load(io.BytesIO(path.read_bytes()), allow_pickle=False) as kept:
            found = {name: kept[name] for name in ("key", "done", "pixels", "mean", "square")}
        if str(found["key"]) != key:
            raise InputError(
                f"{path}: must be the state of this picture, gaze, seed and settings (it is"
                f" another's); {cure}"
            )
        for name in ("pixels", "mean", "square"):
            lowest = -np.inf if name == "mean" else 0
            held = found[name]
            if held.shape != shape or not (np.isfinite(held) & (held >= lowest)).all():
                raise ValueError(f"{name} must be finite numbers of shape {shape}")
        if not 0 <= int(found["done"]) <= steps:
            raise ValueError(f"its step must lie in 0..{steps}")
    return found


def _write_state(
    path: Path,
    key: str,
    done: int,
    pixels: NDArray[np.float32],
    mean: NDArray[np.float32],
    square: NDArray[np.float32],
) -> None:
    """Write the state whole: under another name, flushed to the disk, then renamed."""
    with whole_file(path) as file:
        np.savez(
            file, key=np.array(key), done=np.array(done), pixels=pixels, mean=mean, square=square
        )
