"""Small clips on disk, as a build leaves them, and the command that scores them."""

from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest
from command_line import result_of
from scipy import ndimage
from skimage import data

from protocols.disk.hashing import sha256_bytes
from protocols.manifest import Clip, Manifest, Renderer, write_manifest
from stimuli.media.png import encode_frame, encode_mask
from stimuli.score.pair import ScoredPair

EXTRA = ("torch", "torchvision", "flip_evaluator", "pyfvvdp", "pycvvdp", "lpips")
MISSING = [name for name in EXTRA if find_spec(name) is None]
SIZE = (48, 64)


@pytest.fixture(scope="session")
def with_metrics():
    """Skip where the extra `metrics` is not installed."""
    if MISSING:
        pytest.skip(f"needs the extra metrics (not installed: {', '.join(MISSING)}):"
                    " script/setup --metrics")  # fmt: skip


@pytest.fixture(scope="session")
def photographs():
    """Return photographs of skimage, 128x128, encoded colour, by name."""

    def cut(image):
        image = np.asarray(image, np.float32)[100:228, 150:278] / 255
        return np.repeat(image[..., None], 3, axis=2) if image.ndim == 2 else image

    names = ("grass", "gravel", "brick", "coffee", "astronaut")
    return {name: np.ascontiguousarray(cut(getattr(data, name)())) for name in names}


@dataclass
class Clips:
    """Frames of a reference that moves, of fills of it, and its holes."""

    truth: np.ndarray
    holes: np.ndarray
    fills: dict[str, np.ndarray]


@pytest.fixture
def clips(rng):
    """Return a 4-frame clip of coloured texture that moves right, with a hole, and two fills."""
    height, width = SIZE
    wide = rng.random((height, width + 8, 3))
    wide = ndimage.gaussian_filter(wide, (1, 1, 0))
    wide = ((wide - wide.min()) / (wide.max() - wide.min())).astype(np.float32)
    truth = np.stack([wide[:, k : k + width] for k in range(4)])
    holes = np.zeros((4, height, width), bool)
    for k in range(4):
        holes[k, 8:40, 16 + k : 30 + k] = True
    blurred = ndimage.gaussian_filter(truth, (0, 3, 3, 0))
    noisy = np.clip(truth + 0.3 * rng.standard_normal(truth.shape), 0, 1)
    inside = holes[..., None]
    return Clips(truth, holes, {
        "push-pull": np.where(inside, blurred, truth).astype(np.float32),
        "metameric": np.where(inside, noisy, truth).astype(np.float32),
    })  # fmt: skip


def write_frames(folder: Path, frames) -> list[str]:
    """Write frames as a clip has them; return their hashes."""
    folder.mkdir(parents=True)
    hashes = []
    for index, frame in enumerate(frames):
        encoded = encode_mask(frame) if frame.dtype == bool else encode_frame(frame, 8)
        (folder / f"{index:06d}.png").write_bytes(encoded)
        hashes.append(sha256_bytes(encoded))
    return hashes


@pytest.fixture(scope="session")
def frames_writer():
    """Give the function that writes frames."""
    return write_frames


def write_batch(folder: Path, clips: Clips, scenes=("lawn", "wall"), reference=True) -> Path:
    """Write a folder of clips as `stimuli build` leaves it."""
    entries = []
    for scene in scenes:
        turned = (lambda a: a[..., ::-1, :, :]) if scene == scenes[0] else (lambda a: a)
        write_frames(folder / "holes" / f"{scene}__small", _turn(turned, clips.holes))
        methods = ({"reference": clips.truth} if reference else {}) | clips.fills
        for method, frames in methods.items():
            hashes = write_frames(folder / f"{scene}__small__{method}", turned(frames))
            entries.append(_entry(scene, method, frames, hashes))
    write_manifest(folder, Manifest(
        format=2, study="tiny", stimuli_sha256="0" * 64, display="fhd27-60hz", revision="test",
        renderer=Renderer(vendor="none", renderer="none", version="0"), versions={},
        clips=tuple(entries),
    ))  # fmt: skip
    return folder


def _turn(turned, holes):
    return turned(holes[..., None])[..., 0]


def _entry(scene, method, frames, hashes) -> Clip:
    return Clip(
        name=f"{scene}__small__{method}",
        condition={"scene": scene, "size": "small", "method": method},
        width_px=frames.shape[2], height_px=frames.shape[1], fps=30.0, bit_depth=8, seed=0,
        parameters={"method": method}, hole_share=0.1, cache_key="0" * 64,
        frames_sha256=tuple(hashes),
    )  # fmt: skip


@pytest.fixture(scope="session")
def batch_writer():
    """Give the function that writes a batch."""
    return write_batch


@pytest.fixture
def batch(tmp_path, clips) -> Path:
    """Return a finished batch: two scenes, one size, reference and two fills."""
    return write_batch(tmp_path / "clips", clips)


@pytest.fixture
def pair(tmp_path, clips):
    """Give a function: frames of a test clip -> the pair with the reference, holes included."""

    def make(test, *, truth=None, holes=True, fps=30.0) -> ScoredPair:
        truth = clips.truth if truth is None else truth
        count = sum(1 for _ in tmp_path.glob("pair*"))
        root = tmp_path / f"pair{count}"
        for name, frames in (("test", test), ("truth", truth), ("holes", clips.holes)):
            write_frames(root / name, frames)
        paths = {
            name: tuple(sorted((root / name).iterdir())) for name in ("test", "truth", "holes")
        }
        return ScoredPair("pair", paths["test"], paths["truth"], paths["holes"] if holes else (),
                    truth.shape[2], truth.shape[1], fps)  # fmt: skip

    return make


@pytest.fixture
def run_score():
    """Give `metamerlab stimuli score ARGUMENTS`, run in this process."""
    return result_of("stimuli", "score", "--workers", "1")
