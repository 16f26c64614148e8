"""Networks run by ONNX Runtime: what they compute, what they refuse, whole files."""

import json

import denoising_networks as unet
import numpy as np
import pytest
from command_line import outcome_of
from PIL import Image
from skimage import data

from pipeline.denoising.maps import maps_of
from pipeline.denoising.network import (
    FACTS_KEY,
    LOD_SCALE,
    DenoisingNetwork,
    NetworkFacts,
    inputs_of,
    seen_by,
    shipped_network,
)
from pipeline.errors import InputError, MissingExtraError
from pipeline.foveation import reference
from pipeline.foveation.geometry import Flat
from pipeline.foveation.pooling import MetamerSettings, Pooling, Pools
from pipeline.foveation.reference import metamer
from pipeline.pictures.decode import read_pixels
from stimuli.denoise.denoise_files import Denoiser

pytest.importorskip("onnxruntime", reason="needs the extra `onnx`")
onnx = pytest.importorskip("onnx", reason="needs the package onnx, of the extra `dev`")


@pytest.fixture(scope="module")
def picture():
    return (data.astronaut()[60:135, 120:221] / np.float32(255)).astype(np.float32)


def pools_of(picture, gaze_px=(40.0, 30.0)):
    height, width = picture.shape[:2]
    return Pools(Flat(40).of(width, height), gaze_px, Pooling())


def saved(path, kind="moments", seed=0, weights=None, facts=None):
    weights = unet.first_weights(kind, 5, seed) if weights is None else weights
    path.write_bytes(unet.to_onnx(weights, facts or NetworkFacts(kind)))
    return path


def saying(path, base, maps, facts):
    """A network that says the same of every picture: (H, W, 3) and (h, w, 25)."""
    from onnx import TensorProto, helper, numpy_helper

    nodes, held, outputs = [], [], []
    for name, values in (("base", base), ("maps", maps)):
        planes = np.ascontiguousarray(values.transpose(2, 0, 1)[None], np.float32)
        held.append(numpy_helper.from_array(planes, f"{name} held"))
        nodes.append(helper.make_node("Identity", [f"{name} held"], [name]))
        outputs.append(helper.make_tensor_value_info(name, TensorProto.FLOAT, planes.shape))
    fed = helper.make_tensor_value_info("noisy", TensorProto.FLOAT, [1, inputs_of(5), "h", "w"])
    model = helper.make_model(
        helper.make_graph(nodes, "saying", [fed], outputs, held),
        opset_imports=[helper.make_opsetid("", unet.OPSET)],
    )
    model.ir_version = 8
    helper.set_model_props(model, {FACTS_KEY: unet.as_json(facts)})
    path.write_bytes(model.SerializeToString())
    return path


def convolved(values, kernel, bias):
    """Plain sums: (C, H, W) by (O, C, 3, 3), zeros around."""
    padded = np.pad(values, ((0, 0), (1, 1), (1, 1)))
    windows = np.lib.stride_tricks.sliding_window_view(padded, (3, 3), axis=(1, 2))
    return np.einsum("chwij,ocij->ohw", windows, kernel) + bias[:, None, None]


def halved(values):
    channels, height, width = values.shape
    return values.reshape(channels, height // 2, 2, width // 2, 2).max(axis=(2, 4))


def test_the_file_computes_the_eight_layers(picture, tmp_path):
    """By plain sums in numpy, from the description in the module."""
    part = picture[:16, :24]
    weights = [
        (kernel.astype(np.float64), bias + 0.01) for kernel, bias in unet.first_weights("rgb", 5, 4)
    ]
    network = DenoisingNetwork(saved(tmp_path / "rgb.onnx", "rgb", weights=weights))
    fed = seen_by(part, pools_of(part)).planes[0]
    level = [np.maximum(convolved(fed, *weights[0]), 0)]
    for index in (1, 2, 3):
        level.append(np.maximum(convolved(halved(level[-1]), *weights[index]), 0))
    up = level[3]
    for index in (4, 5, 6):
        wide = up.repeat(2, axis=1).repeat(2, axis=2)
        up = np.maximum(convolved(wide + level[6 - index], *weights[index]), 0)
    expected = part + convolved(up, *weights[7]).transpose(1, 2, 0)

    found = network.colour(part, pools_of(part))

    assert np.ptp(expected) > 0.5
    assert np.abs(found - np.clip(expected, 0, 1)).max() < 1e-4


def test_maps_are_the_means_of_blocks(picture, tmp_path):
    """The two kinds differ in their last layer alone; its bias tells the channels apart."""
    weights = unet.first_weights("moments", 5, 0)
    weights[-1] = (0 * weights[-1][0], np.arange(28, dtype=np.float32) / 100)
    network = DenoisingNetwork(saved(tmp_path / "m.onnx", weights=weights))

    flat = np.full_like(picture, 0.5)  # has no moments of its own
    maps = network.moments(flat, pools_of(flat))

    assert maps.base.shape == (75, 101, 3)
    assert maps.deviations.shape == (19, 26, 15)
    assert maps.slopes.shape == (19, 26, 5, 2)
    assert np.allclose(maps.base, [0.5, 0.51, 0.52])
    assert np.allclose(maps.deviations, np.arange(3, 18) / 100)
    # The second level's chroma, .20 and .21, over the root of .06^2 + .07^2 + .08^2.
    expected = np.array([0.20, 0.21]) / np.sqrt(0.0149 + 2.0**-20)
    assert np.allclose(maps.slopes[:, :, 1], expected)


def test_a_network_that_says_nothing_leaves_the_noisy_pictures_own_moments(picture, tmp_path):
    weights = unet.first_weights("moments", 5, 0)
    weights[-1] = (0 * weights[-1][0], 0 * weights[-1][1])
    pools = pools_of(picture)
    own = maps_of(picture, pools)

    maps = DenoisingNetwork(saved(tmp_path / "m.onnx", weights=weights)).moments(picture, pools)

    assert np.allclose(maps.base, own.base, atol=1e-6)
    known = 3 * own.levels  # a small picture has fewer levels than the network
    assert np.allclose(maps.deviations[..., :known], own.deviations, atol=1e-6)
    assert (maps.deviations[..., known:] == 0).all()
    assert np.allclose(maps.slopes[:, :, : own.levels], own.slopes, atol=1e-5)


def test_odd_sizes_are_padded_by_their_border(picture, tmp_path):
    network = DenoisingNetwork(saved(tmp_path / "rgb.onnx", "rgb", seed=3))
    pools = pools_of(picture)
    fed = seen_by(picture, pools).planes

    assert fed.shape == (1, inputs_of(5), 80, 104)
    assert (fed[0, :3, 75:, :101] == picture[74].T[:, None]).all()
    assert np.allclose(fed[0, 3, :75, :101] * LOD_SCALE, pools.lod(), atol=1e-6)
    assert network.colour(picture, pools).shape == picture.shape


def test_perfect_moments_come_out_as_the_clean_pictures_metamer(tmp_path, gl_context, monkeypatch):
    """The whole way: a file that knows the moments, ONNX Runtime, synthesis, in numpy and GL."""
    monkeypatch.setattr(
        reference, "reach_of", lambda *_: (np.full(3, 9.0), np.full(3, 9.0))
    )  # maps have none
    clean = data.astronaut()[60:188, 120:280].astype(np.float32) / 255  # of five levels
    pools = pools_of(clean)
    maps = maps_of(clean, pools)
    noise = np.random.default_rng(0).uniform(0, 1, clean.shape).astype(np.float32)
    own = maps_of(noise, pools)
    lacking = maps.base - own.base, maps.packed() - own.packed()
    path = saying(tmp_path / "knows.onnx", *lacking, NetworkFacts("moments"))
    expected = metamer(clean, pools, MetamerSettings(), 7)

    for ctx, tolerance in ((None, 1e-3), (gl_context, 0.5 / 255)):
        denoiser = Denoiser(DenoisingNetwork(path), pools.geometry, pools.gaze_px, ctx)
        assert np.abs(denoiser(noise, 7) - expected).max() < tolerance
        denoiser.release()


def test_equal_weights_give_equal_bytes():
    one, other = (
        unet.to_onnx(unet.first_weights("rgb", 5, 2), NetworkFacts("rgb")) for _ in range(2)
    )
    assert one == other
    assert one != unet.to_onnx(unet.first_weights("rgb", 5, 3), NetworkFacts("rgb"))


def test_facts_come_back_from_the_file(tmp_path):
    facts = NetworkFacts(
        "moments", pooling=Pooling("linear", 0.46), made={"seed": 9, "scenes": ["shed"]}
    )
    assert DenoisingNetwork(saved(tmp_path / "m.onnx", facts=facts)).facts == facts


def test_files_that_are_no_network_get_one_message(tmp_path):
    path = tmp_path / "n.onnx"
    with pytest.raises(FileNotFoundError):
        DenoisingNetwork(path)
    path.write_bytes(b"no network")
    with pytest.raises(InputError, match="must be an ONNX model"):
        DenoisingNetwork(path)

    model = onnx.load_from_string(
        unet.to_onnx(unet.first_weights("rgb", 5, 0), NetworkFacts("rgb"))
    )
    del model.metadata_props[:]
    path.write_bytes(model.SerializeToString())
    with pytest.raises(InputError, match="does not say what it is for"):
        DenoisingNetwork(path)
    facts = json.loads(unet.as_json(NetworkFacts("rgb")))
    for wrong in ({"version": 1}, {"kind": "sound"}, {"pooling": 3}, {"levels": 99}, {"made": 1}):
        onnx.helper.set_model_props(model, {FACTS_KEY: json.dumps(facts | wrong)})
        path.write_bytes(model.SerializeToString())
        with pytest.raises(InputError, match="must say what the network is for"):
            DenoisingNetwork(path)
    onnx.helper.set_model_props(model, {FACTS_KEY: unet.as_json(NetworkFacts("moments"))})
    path.write_bytes(model.SerializeToString())
    with pytest.raises(InputError, match="must take 32 channels and give 3 and 25"):
        DenoisingNetwork(path)


def test_maps_of_another_size_and_nan_are_refused(picture, tmp_path):
    pools = pools_of(picture)
    path = tmp_path / "says.onnx"
    for base, maps in (
        (np.zeros((8, 8, 3)), np.zeros((2, 2, 25))),
        (np.zeros((80, 104, 3)), np.full((20, 26, 25), np.nan)),
    ):
        network = DenoisingNetwork(saying(path, base, maps, NetworkFacts("moments")))
        with pytest.raises(InputError, match="finite maps of the picture's size"):
            network.moments(picture, pools)


def test_wrong_pictures_and_kinds_are_refused(picture, tmp_path):
    network = DenoisingNetwork(saved(tmp_path / "m.onnx"))
    with pytest.raises(InputError, match="must have the size"):
        network.moments(picture[:60], pools_of(picture))
    hurt = picture.copy()
    hurt[3, 4, 1] = np.nan
    with pytest.raises(InputError, match="must lie in"):
        network.moments(hurt, pools_of(picture))
    with pytest.raises(InputError, match="must be a network for rgb"):
        network.colour(picture, pools_of(picture))


def test_without_onnx_runtime_the_cure_is_named(tmp_path, monkeypatch):
    path = saved(tmp_path / "m.onnx")
    monkeypatch.setitem(__import__("sys").modules, "onnxruntime", None)
    with pytest.raises(MissingExtraError, match=r"metamerlab\[onnx\]"):
        DenoisingNetwork(path)


@pytest.mark.parametrize("kind", ["moments", "rgb"])
def test_shipped_networks_take_noise_away(kind):
    """A noisy grey wall in the periphery: what comes out is nearer to it by a third and more."""
    path = shipped_network(kind)
    assert path.stat().st_size < 5_000_000
    network = DenoisingNetwork(path)
    assert network.facts.kind == kind
    assert {"scenes", "seed", "steps", "torch", "mitsuba"} <= set(network.facts.made)
    clean = np.full((128, 128, 3), 0.5, np.float32)
    noise = np.random.default_rng(1).uniform(-0.25, 0.25, (128, 128, 1))
    pools = Pools(Flat(20).of(128, 128), (-120.0, 64.0), Pooling())
    noisy = np.clip(clean + noise, 0, 1).astype(np.float32)

    found = network.moments(noisy, pools).base if kind == "moments" else None
    found = network.colour(noisy, pools) if found is None else found

    assert np.abs(found - clean)[16:-16, 16:-16].mean() < 0.67 * np.abs(noisy - clean).mean()


run = outcome_of("denoise")


@pytest.fixture
def png(tmp_path, picture):
    path = tmp_path / "noisy.png"
    Image.fromarray(np.rint(255 * picture).astype(np.uint8)).save(path)
    return path


def test_the_command_writes_a_picture_and_a_sheet(png, tmp_path):
    out, sheet = tmp_path / "out.png", tmp_path / "sheet.png"
    _, said, _ = run("run", png, "--gaze", "40,30", "--out", out, "--numpy", "--compare", sheet)

    assert read_pixels(out).data.shape == (75, 101, 3)
    assert sheet.exists()
    assert "gaze: 40.0, 30.0 px" in said
    assert "note: the network was trained on pictures of 6.14 px per degree" in said
    first = out.read_bytes()
    run("run", png, "--gaze", "40,30", "--out", out, "--numpy", status=None)
    assert out.read_bytes() == first
    run("run", png, "--gaze", "40,30", "--out", out, "--numpy", "--seed", 1, status=None)
    assert out.read_bytes() != first


def test_frames_go_to_a_folder(png, tmp_path):
    frames, out = tmp_path / "frames", tmp_path / "out"
    frames.mkdir()
    for name in ("a.png", "b.png"):
        (frames / name).write_bytes(png.read_bytes())
    run("run", frames, "--gaze", "40,30", "--out", out, "--network", "rgb", "--numpy")

    assert sorted(path.name for path in out.iterdir()) == ["a.png", "b.png"]
    _, _, error = run("run", frames, "--gaze", "40,30", "--out", out, "--numpy", status=2)
    assert "out: must be empty or new" in error


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        ((), "--gaze X,Y must be given"),
        (("--gaze", "40"), "--gaze must be X,Y"),
        (("--gaze", "nan,3"), "--gaze must be X,Y"),
        (("--gaze", "40,30", "--network", "best"), "--network must be moments or rgb"),
        (("--gaze", "40,30", "--network", "there-is-none.onnx"), "there-is-none.onnx"),
        (("--gaze", "40,30", "--out", "x/y.tif"), "y.tif: must end in .png or .exr"),
        (("--gaze", "40,30", "--out", "noisy.png"), "is what is to be denoised"),
        (("--gaze", "40,30", "--out", "s.png", "--compare", "s.png"), "must be different files"),
    ],
)
def test_wrong_arguments_get_one_message(png, tmp_path, monkeypatch, arguments, said):
    monkeypatch.chdir(tmp_path)
    _, _, error = run("run", png, "--numpy", *arguments, status=2)

    assert error.startswith("error: ")
    assert said in error
    assert [path.name for path in tmp_path.iterdir()] == ["noisy.png"]


def test_frames_of_other_sizes_are_refused(png, tmp_path):
    frames = tmp_path / "frames"
    frames.mkdir()
    (frames / "a.png").write_bytes(png.read_bytes())
    Image.fromarray(np.zeros((64, 64, 3), np.uint8)).save(frames / "b.png")
    _, _, error = run(
        "run", frames, "--gaze", "40,30", "--out", tmp_path / "out", "--numpy", status=2
    )

    assert "b.png: must be as large as the first frame, 101 x 75 px (is 64 x 64)" in error
    assert not (tmp_path / "out").exists()
