"""Training: what a step sees, resumption, checkpoints; path-traced light by hand."""

import os
import pickle

import numpy as np
import pytest

from pipeline.denoising.maps import maps_of
from pipeline.denoising.network import DenoisingNetwork, NetworkFacts, inputs_of, seen_by
from pipeline.errors import InputError
from pipeline.foveation.geometry import Flat
from pipeline.foveation.lod import Pools
from pipeline.foveation.pooling import Pooling
from protocols.limits import LIMITS_VARIABLE
from stimuli.denoised import training_pictures as kept
from stimuli.denoised import unet
from stimuli.denoised.path_traced import PathTracer, encoded
from stimuli.denoised.train import (
    Trainer,
    Training,
    TrainingExample,
    batch_of,
    examples_of,
    rgb_path,
    scale_of,
)
from stimuli.denoised.training_pictures import Rendering, SceneView, TrainingPair
from stimuli.rendering.world import Light, Material, Mesh, MeshPart, Viewpoint, World

EDGE = 136  # the least that has five levels
TRAINING = Training(
    ("shed",), 1, gazes=2, steps=6, crops=2, crop_px=32, seed=3, rendering=Rendering(EDGE, 4)
)
CURE = "needs the extra `denoise`: script/setup --denoise installs it"


@pytest.fixture(scope="module")
def torch():
    """The module, on one thread: pictures are small."""
    module = pytest.importorskip("torch", reason=CURE)
    before = module.get_num_threads()
    module.set_num_threads(1)
    yield module
    module.set_num_threads(before)


@pytest.fixture(scope="module")
def pair():
    """Noise that halves with every doubling of the samples, about stripes."""
    rng = np.random.default_rng(0)
    y, x = np.indices((EDGE, EDGE))
    clean = 0.5 + 0.2 * np.sin(0.7 * x + 0.2 * y)[..., None] * np.array([1.0, 0.8, 0.6])
    noise = rng.uniform(-0.2, 0.2, (6, EDGE, EDGE, 3)) / np.arange(1, 7)[:, None, None, None]
    return TrainingPair(
        SceneView("shed", 0), (clean + noise).astype(np.float32), clean.astype(np.float32)
    )


@pytest.fixture(scope="module")
def examples(pair):
    return {kind: examples_of([pair], TRAINING, kind) for kind in ("moments", "rgb")}


def test_examples_are_noisy_pictures_and_clean_moments(pair, examples):
    rng = np.random.default_rng((TRAINING.seed, 0))
    for one, plain in zip(examples["moments"], examples["rgb"], strict=True):
        x, y = rng.uniform(0, (EDGE, EDGE))
        pools = Pools(pair.geometry, (x, y), TRAINING.pooling)
        noisy = pair.noisy(TRAINING.sampling, (x, y))
        wanted = maps_of(pair.clean, pools)

        seen = seen_by(noisy, pools)
        assert (one.fed == seen.planes[0]).all()
        assert (plain.fed == one.fed).all()
        assert np.allclose(noisy + plain.base.transpose(1, 2, 0), pair.clean, atol=1e-6)
        base = seen.own.base + one.base.transpose(1, 2, 0)
        assert np.allclose(base, wanted.base, atol=1e-6)
        maps = seen.own.packed() + one.maps.transpose(1, 2, 0)
        assert np.allclose(maps, wanted.packed(), atol=1e-6)


def test_a_flipped_example_is_the_example_of_the_flipped_picture(pair):
    """Moments are of squares: turned over they are those of the picture turned over."""
    edge, clean = 128, pair.clean[:128, :128]  # halved evenly, from either end
    geometry = Flat(40).of(edge, edge)
    pools = Pools(geometry, (20.0, 44.0), Pooling())
    maps = maps_of(clean, pools)
    noisy = seen_by(clean, pools).planes[0]
    one = TrainingExample(noisy, maps.base.transpose(2, 0, 1), maps.packed().transpose(2, 0, 1))

    turned = one.crop(0, 0, edge, (True, True))

    there = Pools(geometry, (edge - 20.0, edge - 44.0), Pooling())
    expected = maps_of(clean[::-1, ::-1], there)
    assert np.allclose(turned.base, expected.base.transpose(2, 0, 1), atol=1e-9)
    assert np.allclose(turned.maps, expected.packed().transpose(2, 0, 1), atol=1e-9)
    assert np.allclose(turned.fed, seen_by(clean[::-1, ::-1], there).planes[0], atol=1e-6)


def test_a_step_draws_the_same_crops_again_and_the_next_one_others(examples):
    one, again, other = (batch_of(examples["moments"], TRAINING, step) for step in (4, 4, 5))

    assert one.fed.shape == (2, inputs_of(5), 32, 32)
    assert one.maps.shape == (2, 25, 8, 8)
    assert (one.fed == again.fed).all()
    assert (one.maps == again.maps).all()
    assert (one.fed != other.fed).any()


def test_the_scale_is_deviation_and_mean_of_each_channel(examples):
    deviation, mean = scale_of(examples["moments"])
    blue = np.stack([one.base[2] for one in examples["moments"]])
    last = np.stack([one.maps[14] for one in examples["moments"]])

    assert deviation.shape == mean.shape == (28,)
    assert np.isclose(mean[2], blue.mean())
    assert np.isclose(deviation[2], blue.std(), rtol=1e-4)
    assert np.isclose(mean[17], last.mean(), atol=1e-6)


@pytest.mark.slow
def test_torch_and_the_file_compute_the_same(torch, pair, tmp_path):
    pytest.importorskip("onnxruntime")
    pytest.importorskip("onnx")
    pools = Pools(pair.geometry, (20.0, 44.0), Pooling())
    for kind in ("moments", "rgb"):
        weights = unet.first_weights(kind, 5, 1)
        path = tmp_path / "n.onnx"
        path.write_bytes(unet.to_onnx(weights, NetworkFacts(kind)))
        network = DenoisingNetwork(path)
        layers = [tuple(torch.from_numpy(part) for part in pair_of) for pair_of in weights]
        seen = seen_by(pair.clean, pools)
        fed = torch.from_numpy(seen.planes)
        expected = [part for part in unet.forward(layers, fed) if part is not None]
        found = network._run(seen)

        assert len(found) == len(expected)
        for ours, theirs in zip(found, expected, strict=True):
            assert np.abs(ours - theirs.numpy()[0].transpose(1, 2, 0)).max() < 1e-4


@pytest.mark.slow
@pytest.mark.usefixtures("torch")
def test_training_lowers_the_error(examples, tmp_path):
    training = Training(
        ("shed",), 1, gazes=2, steps=60, crops=4, crop_px=64, rendering=Rendering(EDGE, 4)
    )
    for kind in ("moments", "rgb"):
        trainer = Trainer(kind, training, examples[kind], tmp_path / kind)
        trainer.run()
        assert np.mean(trainer.losses[-5:]) < 0.9 * np.mean(trainer.losses[:3])


@pytest.mark.slow
@pytest.mark.usefixtures("torch")
def test_training_that_was_stopped_comes_to_the_same_weights(examples, tmp_path):
    straight = Trainer("moments", TRAINING, examples["moments"], tmp_path / "straight")
    straight.run()
    first = Trainer("moments", TRAINING, examples["moments"], tmp_path / "stopped")
    first.run(until=2)
    second = Trainer("moments", TRAINING, examples["moments"], tmp_path / "stopped")
    assert second.step == 2
    second.run()

    assert second.losses == straight.losses
    for (kernel, bias), (other, other_bias) in zip(
        second.weights(), straight.weights(), strict=True
    ):
        assert (kernel == other).all()
        assert (bias == other_bias).all()


@pytest.mark.usefixtures("torch")
def test_checkpoints_of_another_training_and_damaged_ones_are_refused(
    examples, tmp_path, monkeypatch
):
    path = tmp_path / "rgb.checkpoint"
    Trainer("rgb", TRAINING, examples["rgb"], path).run(until=1)
    other = Training(
        ("shed",), 1, gazes=2, steps=7, crops=2, crop_px=32, seed=3, rendering=Rendering(EDGE, 4)
    )
    for training, seen in ((other, examples["rgb"]), (TRAINING, examples["rgb"][:1])):
        with pytest.raises(InputError, match="another training"):
            Trainer("rgb", training, seen, path)
    whole = path.read_bytes()
    for harmed in (whole[: len(whole) // 2], b"", b"no checkpoint"):
        path.write_bytes(harmed)
        with pytest.raises(InputError, match="must be a checkpoint"):
            Trainer("rgb", TRAINING, examples["rgb"], path)
    path.write_bytes(whole)
    monkeypatch.setenv(LIMITS_VARIABLE, "memory=1000")
    with pytest.raises(InputError, match=r"must hold at most 1,000 bytes .*LIMITS=memory="):
        Trainer("rgb", TRAINING, examples["rgb"], path)


def _put(*keys, value):
    """Return what changes one entry of a checkpoint's state."""

    def change(state):
        for key in keys[:-1]:
            state = state[key]
        state[keys[-1]] = value(state[keys[-1]])

    return change


def _without(*keys):
    def change(state):
        for key in keys[:-1]:
            state = state[key]
        del state[keys[-1]]

    return change


HARMS = {
    "a kernel of another shape": _put("weights", 0, value=lambda t: t[:, :-1]),
    "a bias of another shape": _put("weights", 1, value=lambda t: t[:1]),
    "a kernel that would be spread": _put("weights", 2, value=lambda t: t[:1, :1]),
    "too few weights": _without("weights", 3),
    "no weights": _without("weights"),
    "an empty list of weights": _put("weights", value=lambda _: []),
    "weights that are none": _put("weights", value=lambda w: [0.0] * len(w)),
    "weights in double": _put("weights", 0, value=lambda t: t.double()),
    "a weight that is NaN": _put("weights", 0, value=lambda t: t * float("nan")),
    "a weight without end": _put("weights", 1, value=lambda t: t + float("inf")),
    "no memory": _without("adam"),
    "memory of too few weights": _without("adam", "state", 0),
    "memory of another shape": _put("adam", "state", 0, "exp_avg", value=lambda t: t[:1]),
    "memory that is NaN": _put("adam", "state", 1, "exp_avg", value=lambda t: t * float("nan")),
    "squares below 0": _put("adam", "state", 1, "exp_avg_sq", value=lambda t: t - 1),
    "memory of another step": _put("adam", "state", 1, "step", value=lambda t: t + 1),
    "a step below 0": _put("step", value=lambda _: -1),
    "a step past the end": _put("step", value=lambda _: 7),
    "a step that is text": _put("step", value=str),
    "losses that are NaN": _put("losses", value=lambda _: [float("nan")]),
    "too few losses": _put("losses", value=lambda _: []),
    "no key": _without("key"),
}


@pytest.fixture(scope="module")
def checkpoint(examples, tmp_path_factory):
    """Bytes of a checkpoint after one step."""
    pytest.importorskip("torch", reason=CURE)
    path = tmp_path_factory.mktemp("trained") / "rgb.checkpoint"
    Trainer("rgb", TRAINING, examples["rgb"], path).run(until=1)
    return path.read_bytes()


@pytest.mark.parametrize("harm", HARMS.values(), ids=HARMS)
def test_a_checkpoint_that_holds_no_numbers_for_these_weights_is_refused(
    torch, examples, checkpoint, tmp_path, harm
):
    path = tmp_path / "rgb.checkpoint"
    path.write_bytes(checkpoint)
    state = torch.load(path, weights_only=True)
    harm(state)
    torch.save(state, path)
    with pytest.raises(InputError, match=r"must be a checkpoint.*delete it to start over"):
        Trainer("rgb", TRAINING, examples["rgb"], path)


class _Runs:
    """Object that makes a folder where it is unpickled."""

    def __init__(self, folder):
        self.folder = str(folder)

    def __reduce__(self):
        return os.mkdir, (self.folder,)


def test_a_checkpoint_with_code_is_refused_and_not_run(torch, examples, tmp_path):
    path, made = tmp_path / "rgb.checkpoint", tmp_path / "made"
    for write in (lambda: torch.save({"key": _Runs(made)}, path),
                  lambda: path.write_bytes(pickle.dumps(_Runs(made))),
                  lambda: torch.save([1, 2], path),
                  lambda: torch.save(torch.nn.Linear(2, 2), path)):  # fmt: skip
        write()
        with pytest.raises(InputError, match="must be a checkpoint") as told:
            Trainer("rgb", TRAINING, examples["rgb"], path)
        assert "weights_only" not in str(told.value)  # nobody is to try it all the same
        assert not made.exists()


def test_the_network_for_colour_lies_beside_the_one_for_moments(tmp_path):
    assert rgb_path(tmp_path / "mine.onnx") == tmp_path / "mine-rgb.onnx"


def test_views_differ_and_the_first_is_the_scenes_own():
    world = World((_floor(),), Viewpoint((0, 2, 0), (0, 1, -6)), Light())
    poses = [SceneView("shed", n).camera(world, 64).world_from_camera for n in (0, 1, 2, 3)]

    assert np.allclose(poses[0][:3, 3], (0, 2, 0))
    assert len({pose.tobytes() for pose in poses}) == 4
    assert all(np.linalg.norm(pose[:3, 3] - (0, 2, 0)) < 2 for pose in poses)
    with pytest.raises(InputError, match="must be one of"):
        SceneView("moon", 0)


def test_pairs_on_disk_are_used_and_damaged_ones_refused(pair, tmp_path):
    rendering = Rendering(EDGE, 4)
    view = SceneView("shed", 0)
    kept._write(view.path(tmp_path, rendering), pair)

    (found,) = kept.pairs_of([view], rendering, tmp_path)
    assert np.abs(found.renders - pair.renders).max() < 2**-11
    view.path(tmp_path, rendering).write_bytes(b"PK\x03\x04 no pictures")
    with pytest.raises(InputError, match="delete it, and it is made again"):
        kept.pairs_of([view], rendering, tmp_path)
    wrong = TrainingPair(view, pair.renders[:3], pair.clean)
    kept._write(view.path(tmp_path, rendering), wrong)
    with pytest.raises(InputError, match="must hold pictures of shape"):
        kept.pairs_of([view], rendering, tmp_path)
    kept._write(
        view.path(tmp_path, rendering), TrainingPair(view, pair.renders * np.nan, pair.clean)
    )
    with pytest.raises(InputError, match="must hold finite numbers"):
        kept.pairs_of([view], rendering, tmp_path)


def _floor():
    corners = np.array([(-50, 0, -50), (50, 0, -50), (50, 0, 50), (-50, 0, 50)], np.float32)
    up = np.tile(np.array([0, 1, 0], np.float32), (4, 1))
    tint = np.tile(np.array([1.0, 0.5, 0.25], np.float32), (4, 1))
    mesh = Mesh(corners, up, corners[:, [0, 2]], tint, np.array([[0, 1, 2], [0, 2, 3]]))
    return MeshPart(mesh, Material(np.full((2, 2, 4), 188, np.uint8)))


@pytest.fixture(scope="module")
def floor():
    """A lit floor under an even sky, seen from above, and its tracer."""
    pytest.importorskip("mitsuba", reason=CURE)
    light = Light(sun_direction=(0, 3, 4), sun=(1, 1, 1), sky=(0.5, 0.5, 0.5), exposure=1)
    world = World((_floor(),), Viewpoint((0, 3, 0), (0.1, 0, -3)), light)
    return world, PathTracer(world)


def test_light_on_a_floor_is_that_of_sun_and_sky(floor):
    """Albedo .503 (188 of 255, decoded) times the tint, by sun at .6 of upright and the sky."""
    world, tracer = floor
    camera = world.viewpoint.camera(16, 16)
    found = tracer.render(camera, 256, 1).mean(axis=(0, 1))

    albedo = ((188 / 255 + 0.055) / 1.055) ** 2.4
    assert np.allclose(found, albedo * np.array([1, 0.5, 0.25]) * (0.6 + 0.5), rtol=0.03)
    assert (tracer.shown(found) == encoded(found.astype(np.float64))).all()


def test_more_samples_are_less_noisy_and_seeds_decide(floor):
    world, tracer = floor
    rendering = Rendering(64, 4)
    pair, again = (
        kept.render_pair(tracer, world, SceneView("shed", 1), rendering) for _ in range(2)
    )

    assert (pair.renders == again.renders).all()
    deviation = pair.renders[:, 40:, :, 0].std(axis=(1, 2))
    assert (np.diff(deviation) < 0).all()
    # 32 samples have the fifth root of a half five times of one's deviation, nearly.
    assert 4 < deviation[0] / deviation[5] < 8


def test_geometry_of_pairs_is_forty_degrees_wide(pair):
    assert pair.geometry == Flat(40.0).of(EDGE, EDGE)
