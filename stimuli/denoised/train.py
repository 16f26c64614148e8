"""Training of the denoising networks: crops of noisy pictures, moments of the clean ones.

Beyond Blur (Walton et al. 2021), section 5.3: one U-net maps noisy pictures to the moments of the
clean ones, an identical one to the clean picture, both under an L2 loss. The gaze is drawn anew for
every picture. What a step sees follows from the seed and its number alone, so training that was
stopped goes on to the same weights.
"""

from __future__ import annotations

import hashlib
import io
import math
import pickle
import time
import warnings
import zipfile
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipeline.denoising.maps import BLOCK_PX, LEVELS, maps_of
from pipeline.denoising.network import Kind, NetworkFacts, inputs_of, seen_by
from pipeline.denoising.samples import Sampling
from pipeline.errors import InputError
from pipeline.foveation.chain import chain_length
from pipeline.foveation.lod import Pools
from pipeline.foveation.pooling import Pooling
from protocols.disk.whole_file import write_whole
from protocols.limits import check_within
from protocols.outside import check_zip, reading
from stimuli.denoised.path_traced import need
from stimuli.denoised.training_pictures import (
    MOST_VIEWS,
    WIDTH_DEG,
    Rendering,
    SceneView,
    TrainingPair,
    pairs_of,
    seconds_for,
)
from stimuli.denoised.unet import (
    COLOURS,
    Weights,
    first_weights,
    forward,
    scaled,
    to_onnx,
)
from stimuli.reporter import SILENT, Reporter
from stimuli.scenes.builtin_scenes import scene_entry

KINDS: tuple[Kind, ...] = ("moments", "rgb")
RATE = 1e-3  # Adam's, at first; it falls to a hundredth along half a cosine
STEPS_PER_SAVE = 50
LEAST_DEVIATION = 1e-4
"""Of an output over the training pictures: what never varies is not magnified."""

Progress = Callable[[str, int, int], None]
Pictures = NDArray[np.float32]


@dataclass(frozen=True)
class Training:
    """Settings of a training.

    Parameters
    ----------
    scenes : tuple of str
        Built-in scenes.
    views : int
        Cameras in each scene.
    gazes : int
        For each view.
    steps : int
        Of Adam, for each network.
    crops, crop_px : int
        A step sees so many crops of so many pixels an edge, a multiple of 8.
    seed : int
    """

    scenes: tuple[str, ...] = ("colonnade", "garden", "shed")
    views: int = 3
    gazes: int = 4
    steps: int = 1200
    crops: int = 4
    crop_px: int = 96
    seed: int = 1
    rendering: Rendering = field(default_factory=Rendering)
    sampling: Sampling = field(default_factory=Sampling)
    pooling: Pooling = field(default_factory=Pooling)

    def __post_init__(self) -> None:
        if not self.scenes:
            raise InputError("training needs at least one scene (got none)")
        if len(set(self.scenes)) < len(self.scenes):
            raise InputError(f"each scene is named once (got {', '.join(self.scenes)})")
        for name in self.scenes:
            scene_entry(name)
        for name, value, most in (
            ("views", self.views, MOST_VIEWS),
            ("gazes", self.gazes, 1000),
            ("steps", self.steps, 10_000_000),
            ("crops", self.crops, 1024),
        ):
            if not 1 <= value <= most:
                raise InputError(f"{name} must lie in 1..{most} (got {value})")
        edge = self.rendering.edge_px
        if chain_length(edge, edge) < LEVELS:
            raise InputError(
                f"training pictures must have more than 128 px an edge, for {LEVELS} levels"
                f" (got {edge})"
            )
        if not (16 <= self.crop_px <= edge and self.crop_px % 8 == 0):
            raise InputError(
                f"crops must have a multiple of 8 from 16 to {edge} px an edge (got {self.crop_px})"
            )
        if self.rendering.halvings < self.sampling.halvings:
            raise InputError(
                f"pictures of 2^{self.sampling.halvings} samples must be rendered"
                f" (the most are 2^{self.rendering.halvings})"
            )

    @property
    def all_views(self) -> list[SceneView]:
        """Views in the order in which they are rendered."""
        return [SceneView(scene, number) for scene in self.scenes for number in range(self.views)]

    def facts(self, kind: Kind, made: Mapping[str, Any] | None = None) -> NetworkFacts:
        """Facts of a network of this training."""
        return NetworkFacts(
            kind, LEVELS, self.pooling, self.sampling, WIDTH_DEG, self.rendering.edge_px, made or {}
        )

    def described(self) -> dict[str, Any]:
        """Settings that decide the weights, for the network's file."""
        return asdict(self)


@dataclass(frozen=True, eq=False)
class TrainingExample:
    """One view for one gaze: what a network sees, and the corrections that it should give.

    Parameters
    ----------
    fed : ndarray of float32, shape (C, H, W)
    base : ndarray of float32, shape (3, H, W)
        What averaged colour lacks, or the noisy picture.
    maps : ndarray of float32, shape (5 * levels, H / 4, W / 4), or (0, ...)
        What moments lack.
    """

    fed: Pictures
    base: Pictures
    maps: Pictures

    def crop(self, row: int, column: int, edge: int, flips: tuple[bool, bool]) -> TrainingExample:
        """A part, turned over; variances of bands stay what they are then."""
        found = []
        for values, scale in ((self.fed, 1), (self.base, 1), (self.maps, BLOCK_PX)):
            rows = slice(row // scale, (row + edge) // scale)
            columns = slice(column // scale, (column + edge) // scale)
            part = values[:, rows, columns]
            part = part[:, ::-1] if flips[0] else part
            found.append(part[:, :, ::-1] if flips[1] else part)
        return TrainingExample(*found)


def examples_of(
    pairs: Sequence[TrainingPair], training: Training, kind: Kind, progress: Progress | None = None
) -> list[TrainingExample]:
    """Noisy pictures for several gazes each, and what moments or colour lack."""
    found = []
    for index, pair in enumerate(pairs):
        if progress is not None:
            progress(f"{kind} of training pictures", index, len(pairs))
        geometry = pair.geometry
        rng = np.random.default_rng((training.seed, index))
        size = (geometry.width_px, geometry.height_px)
        for _ in range(training.gazes):
            x, y = rng.uniform(0, size)
            pools = Pools(geometry, (float(x), float(y)), training.pooling)
            noisy = pair.noisy(training.sampling, pools.gaze_px)
            seen = seen_by(noisy, pools)
            if kind == "rgb":
                base = pair.clean.astype(np.float64) - noisy
                maps = np.zeros((*(edge // BLOCK_PX for edge in pair.clean.shape[:2]), 0))
            else:
                wanted = maps_of(pair.clean, pools)
                base = wanted.base - seen.own.base
                maps = wanted.packed() - seen.own.packed()
            lacking = (_single(part.transpose(2, 0, 1)) for part in (base, maps))
            found.append(TrainingExample(seen.planes[0], *lacking))
    return found


def scale_of(examples: Sequence[TrainingExample]) -> tuple[Pictures, Pictures]:
    """Deviation and mean of every output channel over all examples."""
    means, squares = [], []
    for part in ("base", "maps"):
        values = [getattr(one, part).astype(np.float64) for one in examples]
        means.append(np.mean([v.mean(axis=(1, 2)) for v in values], axis=0))
        squares.append(np.mean([(v**2).mean(axis=(1, 2)) for v in values], axis=0))
    mean, square = np.concatenate(means), np.concatenate(squares)
    deviation = np.maximum(np.sqrt(np.maximum(square - mean**2, 0)), LEAST_DEVIATION)
    return _single(deviation), _single(mean)


def batch_of(examples: Sequence[TrainingExample], training: Training, step: int) -> TrainingExample:
    """The crops of one step, stacked: fed (N, C, h, w), base, maps."""
    rng = np.random.default_rng((training.seed, 1 << 32, step))
    edge = training.crop_px
    crops = []
    for _ in range(training.crops):
        one = examples[int(rng.integers(len(examples)))]
        height, width = one.fed.shape[1:]
        row, column = (8 * int(rng.integers((size - edge) // 8 + 1)) for size in (height, width))
        flips = bool(rng.integers(2)), bool(rng.integers(2))
        crops.append(one.crop(row, column, edge, flips))
    return TrainingExample(
        *(np.stack(parts) for parts in zip(*(_parts(c) for c in crops), strict=True))
    )


class Trainer:
    """One network in training: its weights, Adam's memory, and how far it has come.

    Parameters
    ----------
    checkpoint : Path
        Written every `STEPS_PER_SAVE` steps; what is there already is gone on with.

    Raises
    ------
    InputError
        If the checkpoint is damaged, or of another training.
    """

    def __init__(
        self, kind: Kind, training: Training, examples: Sequence[TrainingExample], checkpoint: Path
    ) -> None:
        need("torch", "training")
        import torch

        self._torch = torch
        self.kind, self.training, self._examples = kind, training, examples
        self._checkpoint = checkpoint
        self._deviation, self._mean = scale_of(examples)
        self.step = 0
        self._losses: list[float] = []
        self._tensors = _tensors(first_weights(kind, LEVELS, training.seed))
        self._adam = torch.optim.Adam(self._tensors, lr=RATE)
        if checkpoint.exists():
            self._go_on()

    @property
    def losses(self) -> list[float]:
        """Loss of each step: the mean square error in deviations of the outputs."""
        return self._losses

    def run(self, until: int | None = None, progress: Progress | None = None) -> None:
        """Train up to a step, by default the last one."""
        steps = self.training.steps
        until = steps if until is None else until
        while self.step < until:
            if progress is not None:
                recent = np.mean(self._losses[-20:]) if self._losses else 1.0
                progress(f"{self.kind} network, loss {recent:.3f}", self.step, steps)
            self._losses.append(self._one())
            self.step += 1
            if self.step % STEPS_PER_SAVE == 0 or self.step == until:
                self.save()

    def weights(self) -> Weights:
        """Weights as they are now; the last layer gives values as they are, see `scaled`."""
        arrays = [np.ascontiguousarray(one.detach().numpy()) for one in self._tensors]
        return scaled(_layers(arrays), self._deviation, self._mean)

    def save(self) -> None:
        """Write the checkpoint whole."""
        held = io.BytesIO()
        state = {
            "key": self._key(),
            "step": self.step,
            "losses": self._losses,
            "weights": [one.detach() for one in self._tensors],
            "adam": self._adam.state_dict(),
        }
        self._torch.save(state, held)
        self._checkpoint.parent.mkdir(parents=True, exist_ok=True)
        write_whole(self._checkpoint, held.getvalue())

    def _one(self) -> float:
        torch = self._torch
        share = self.step / self.training.steps
        for group in self._adam.param_groups:
            group["lr"] = RATE * (0.01 + 0.99 * 0.5 * (1 + math.cos(math.pi * share)))
        batch = batch_of(self._examples, self.training, self.step)
        fed = torch.from_numpy(batch.fed).contiguous(memory_format=torch.channels_last)
        base, maps = forward(_layers(self._tensors), fed)
        loss = self._error(base, batch.base, slice(0, COLOURS))
        if maps is not None:
            loss = (loss + self._error(maps, batch.maps, slice(COLOURS, None))) / 2
        self._adam.zero_grad()
        loss.backward()
        self._adam.step()
        return float(loss.detach())

    def _error(self, found: Any, wanted: Pictures, channels: slice) -> Any:
        """Mean square error; networks give, and should give, deviations from the mean."""
        mean, deviation = (v[channels, None, None] for v in (self._mean, self._deviation))
        return ((found - self._torch.from_numpy((wanted - mean) / deviation)) ** 2).mean()

    def _key(self) -> str:
        """Hash of all that decides the weights, the pictures too."""
        digest = hashlib.sha256(repr((self.kind, self.training)).encode())
        for one in self._examples:
            for part in _parts(one):
                digest.update(np.ascontiguousarray(part).tobytes())
        return digest.hexdigest()

    def _go_on(self) -> None:
        torch, path = self._torch, self._checkpoint
        with reading(path, "a checkpoint of this command", InputError, "delete it to start over"):
            try:
                _check_bytes(path)
                with warnings.catch_warnings(action="ignore"):  # of files that are none
                    state = torch.load(path, map_location="cpu", weights_only=True)
            except (pickle.UnpicklingError, zipfile.BadZipFile):
                # Torch's message says how to load it all the same.
                raise ValueError("it holds more than numbers, or is damaged") from None
            if state["key"] != self._key():
                raise InputError(
                    f"{path}: was made by another training (other scenes, steps, seed or pictures);"
                    " delete it to start over, or choose another --work"
                )
            step, losses, memory = state["step"], state["losses"], state["adam"]["state"]
            if type(step) is not int or not 1 <= step <= self.training.steps:
                raise ValueError(f"its step must lie in 1..{self.training.steps}")
            if len(losses) != step or not np.isfinite(losses).all():
                raise ValueError("it must hold a finite loss of each step")
            kept = [memory[index] for index in range(len(memory))]
            self._check("weights", state["weights"])
            self._check("exp_avg", [one["exp_avg"] for one in kept])
            self._check("exp_avg_sq", [one["exp_avg_sq"] for one in kept], lowest=0.0)
            if any(float(one["step"]) != step for one in kept):
                raise ValueError("Adam must have come as far as the losses")
            with torch.no_grad():
                for tensor, held in zip(self._tensors, state["weights"], strict=True):
                    tensor.copy_(held)
            ours = self._adam.state_dict()["param_groups"]  # rates are of this program
            self._adam.load_state_dict({"state": memory, "param_groups": ours})
            self.step, self._losses = step, list(losses)

    def _check(self, name: str, held: Sequence[Any], lowest: float = -math.inf) -> None:
        """Raise ValueError where what a checkpoint holds are no numbers for these weights."""
        for ours, theirs in zip(self._tensors, held, strict=True):
            fits = theirs.shape == ours.shape and theirs.dtype == ours.dtype
            if not (fits and bool(self._torch.isfinite(theirs).all() and (theirs >= lowest).all())):
                raise ValueError(f"its {name} must be finite, of shape {tuple(ours.shape)}")


def rgb_path(out: Path) -> Path:
    """Path of the network for colour, beside the one for moments."""
    return out.with_name(f"{out.stem}-rgb{out.suffix}")


def train(
    training: Training,
    out: Path,
    work: Path,
    *,
    estimate_only: bool = False,
    reporter: Reporter = SILENT,
) -> list[Path]:
    """Render pairs, train both networks, write them.

    Parameters
    ----------
    out : Path
        The network for moments, .onnx; the one for colour goes beside it, see `rgb_path`.
    work : Path
        A folder for pictures and checkpoints. What it holds already is gone on with.
    estimate_only : bool
        Say how long it takes, and stop.

    Returns
    -------
    list of Path
        The two networks; none with `estimate_only`.

    Raises
    ------
    MissingExtraError
        If torch, Mitsuba or onnx is not installed.
    InputError
        If what the work folder holds is damaged, or of another training.
    """
    for module in ("torch", "mitsuba", "onnx", "onnxruntime"):
        need(module, "training")
    tell, progress = reporter.say, reporter.progress
    views = training.all_views
    missing = [view for view in views if not view.path(work / "pairs", training.rendering).exists()]
    seconds = estimated_s(training, missing)
    tell(
        f"{len(views)} views of {', '.join(training.scenes)}, {training.rendering.edge_px} px,"
        f" up to {training.sampling.most} samples a pixel, clean with"
        f" {training.rendering.clean_samples}"
    )
    tell(
        f"rendering {len(missing)} of them takes about {_minutes(seconds['rendering'])},"
        f" {training.steps} steps of the network for moments {_minutes(seconds['moments'])}, of the"
        f" one for colour {_minutes(seconds['rgb'])}; stopped, it goes on from {work}"
    )
    if estimate_only:
        return []
    pairs = pairs_of(views, training.rendering, work / "pairs", progress)
    written = []
    for kind, path in zip(KINDS, (out, rgb_path(out)), strict=True):
        examples = examples_of(pairs, training, kind, progress)
        trainer = Trainer(kind, training, examples, work / f"{kind}.checkpoint")
        if trainer.step:
            tell(f"{kind}: goes on after step {trainer.step}")
        trainer.run(progress=progress)
        facts = training.facts(kind, training.described() | versions())
        path.parent.mkdir(parents=True, exist_ok=True)
        write_whole(path, to_onnx(trainer.weights(), facts))
        written.append(path)
        last = float(np.mean(trainer.losses[-100:]))
        tell(
            f"wrote {path}: {path.stat().st_size / 1e6:.2f} MB,"
            f" mean loss of the last {min(100, len(trainer.losses))} steps {last:.3f}"
        )
    return written


def estimated_s(training: Training, missing: Sequence[SceneView]) -> dict[str, float]:
    """Seconds of rendering the missing views and of training, from a few paths and two steps."""
    import torch

    names = sorted({view.scene for view in missing})
    a_view = {scene: seconds_for(scene, training.rendering) for scene in names}
    found = {"rendering": sum(a_view[view.scene] for view in missing)}
    edge, crops = training.crop_px, training.crops
    fed = torch.zeros((crops, inputs_of(LEVELS), edge, edge))
    fed = fed.contiguous(memory_format=torch.channels_last)
    for kind in KINDS:
        weights = _layers(_tensors(first_weights(kind, LEVELS, 0)))
        taken = []
        for _ in range(2):
            started = time.perf_counter()
            base, maps = forward(weights, fed)
            (base.sum() if maps is None else base.sum() + maps.sum()).backward()
            taken.append(time.perf_counter() - started)
        found[kind] = training.steps * taken[-1]
    return found


def versions() -> dict[str, str]:
    """Versions of the packages that made a network, and our revision, by name."""
    from importlib.metadata import version

    from protocols.revision import code_revision

    known = {name: version(name) for name in ("torch", "mitsuba", "numpy")}
    return {**known, "revision": code_revision()}


def _check_bytes(path: Path) -> None:
    """Refuse a checkpoint that is no zip file, or unpacks to more than the limit of memory."""
    with path.open("rb") as file:
        check_zip(path, file, InputError)
        with zipfile.ZipFile(file) as packed:
            size = sum(entry.file_size for entry in packed.infolist())
    check_within("memory", size, InputError, path, "bytes", "hold")


def _tensors(weights: Weights) -> list[Any]:
    """Kernels and biases in turn, to be trained; channels last, which the CPU likes best."""
    import torch

    found = []
    for kernel, bias in weights:
        laid_out = torch.from_numpy(kernel.copy()).contiguous(memory_format=torch.channels_last)
        found += [laid_out.requires_grad_(), torch.from_numpy(bias.copy()).requires_grad_()]
    return found


def _layers(flat: Sequence[Any]) -> list[tuple[Any, Any]]:
    return list(zip(flat[::2], flat[1::2], strict=True))


def _minutes(seconds: float) -> str:
    return f"{seconds / 60:.0f} min" if seconds >= 90 else f"{seconds:.0f} s"


def _single(values: NDArray[np.floating]) -> Pictures:
    return np.ascontiguousarray(values, np.float32)


def _parts(one: TrainingExample) -> tuple[Pictures, Pictures, Pictures]:
    return one.fed, one.base, one.maps
