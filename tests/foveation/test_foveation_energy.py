"""energy-metamer: pooled energies in torch, and what it is without torch."""

import builtins
import importlib.util

import numpy as np
import pytest

from pipeline.colour import YCBCR_FROM_RGB
from pipeline.errors import InputError
from pipeline.foveation import energy
from pipeline.foveation.chain import enlarge, halve_around
from pipeline.foveation.conditions import condition_parameters, create_condition, foveate
from pipeline.foveation.energy import EnergyMetamer, PooledEnergies, quadrature_pairs
from pipeline.foveation.geometry import Equirectangular, Flat
from pipeline.foveation.picture_fixation import PictureFixation
from pipeline.foveation.pooling import Pooling, Pools
from pipeline.foveation.reference import blurred

HEIGHT, WIDTH = 40, 56


@pytest.fixture
def torch():
    """The module, on one thread: pictures are small. Without it these tests skip."""
    module = pytest.importorskip(
        "torch", reason="needs the extra `metamers`: script/setup --metamers installs it"
    )
    before = module.get_num_threads()
    module.set_num_threads(1)
    yield module
    module.set_num_threads(before)


@pytest.fixture
def picture(rng):
    coarse = rng.uniform(0.2, 0.8, (HEIGHT // 4, WIDTH // 4, 3))
    fine = rng.uniform(-0.15, 0.15, (HEIGHT, WIDTH, 1))
    return (np.kron(coarse, np.ones((4, 4, 1))) + fine).astype(np.float32)


@pytest.fixture
def fixation():
    return PictureFixation(Flat(width_deg=40).of(WIDTH, HEIGHT), (WIDTH / 2, HEIGHT / 2), seed=5)


def test_quadrature_pairs_give_gratings_one_magnitude_at_every_phase():
    """A grating at a pair's own angle: even and odd answers are sine and cosine."""
    axis = energy.SPACING * np.arange(-energy.REACH, energy.REACH + 1)
    x, y = np.meshgrid(axis, axis)
    pairs = quadrature_pairs()
    for index in range(energy.ORIENTATIONS):
        angle = np.pi * index / energy.ORIENTATIONS
        along = x * np.cos(angle) + y * np.sin(angle)
        even, odd = pairs[2 * index], pairs[2 * index + 1]
        answers = [
            np.hypot((even * wave).sum(), (odd * wave).sum())
            for wave in (np.cos(1.6 * along + phase) for phase in np.linspace(0, np.pi, 7))
        ]
        across = [
            np.hypot((even * wave).sum(), (odd * wave).sum())
            for wave in (np.cos(1.6 * (y * np.cos(angle) - x * np.sin(angle))),)
        ]
        assert max(answers) / min(answers) < 1.1
        assert max(across) < 0.25 * min(answers)
        assert abs(even.sum()) < 1e-12
        assert abs(odd.sum()) < 1e-12


@pytest.mark.parametrize(("size", "viewing"), [((23, 34), Flat()), ((20, 40), Equirectangular())])
def test_pooled_colour_is_the_blur_of_equal_pooling(torch, rng, size, viewing):
    picture = rng.random((*size, 3)).astype(np.float32)
    pools = Pools(viewing.of(size[1], size[0]), (7, 9), Pooling())

    model = PooledEnergies(pools, 3)
    found = model(torch.from_numpy(picture))[0][0].permute(1, 2, 0).numpy()

    np.testing.assert_allclose(found, blurred(picture, pools) @ YCBCR_FROM_RGB.T, atol=2e-6)


@pytest.mark.parametrize("viewing", [Flat(), Equirectangular()])
@pytest.mark.parametrize("size", [(1, 2), (8, 16), (9, 18)])
def test_halving_and_doubling_agree_with_numpy(torch, rng, size, viewing):
    image = rng.random((*size, 2)).astype(np.float32)
    model = PooledEnergies(Pools(viewing.of(size[1], size[0]), (1, 0.5), Pooling()), 1)
    tensor = torch.from_numpy(image).permute(2, 0, 1)[None]

    small = model.halve(tensor)[0].permute(1, 2, 0).numpy()
    large = model.double(tensor, (2 * size[0] - 1, 2 * size[1]))[0].permute(1, 2, 0).numpy()

    np.testing.assert_allclose(small, halve_around(image, wraps=model.wraps), atol=1e-6)
    twice = enlarge(image, (2 * size[0] - 1, 2 * size[1]), 1, wraps=model.wraps)
    np.testing.assert_allclose(large, twice, atol=1e-6)


@pytest.mark.slow
@pytest.mark.usefixtures("torch")
@pytest.mark.parametrize("start", energy.STARTS)
def test_descent_brings_the_energies_near(picture, fixation, start):
    condition = EnergyMetamer(start=start, steps=25)
    losses = []

    shown = condition.descend(picture, fixation, progress=lambda *step: losses.append(step))

    assert [step[:2] for step in losses] == [(k + 1, 25) for k in range(25)]
    assert losses[-1][2] < 0.4 * losses[0][2]
    assert condition.loss(picture, shown, fixation) < 0.5
    assert np.abs(shown - picture).mean() > 0.03
    assert shown.dtype == np.float32
    assert shown.min() >= 0
    assert shown.max() <= 1


@pytest.mark.usefixtures("torch")
def test_the_fovea_is_copied_and_seeds_differ(picture, fixation):
    a, again, b = (
        foveate(
            picture, fixation.gaze_px, method="energy-metamer", seed=seed, steps=2, fovea_deg=6.0
        )
        for seed in (1, 1, 2)
    )

    fovea = fixation.pools(Pooling(fovea_deg=6.0)).fade() == 0
    assert fovea.sum() > 50
    np.testing.assert_array_equal(a[fovea], picture[fovea])
    np.testing.assert_array_equal(a, again)
    assert np.abs(a - b)[~fovea].mean() > 0.02


@pytest.mark.usefixtures("torch")
def test_an_interrupted_descent_goes_on_to_the_same_picture(picture, fixation, tmp_path):
    state = tmp_path / "state.npz"
    condition = EnergyMetamer(start="noise", steps=12)
    whole = condition.descend(picture, fixation)

    def stop(done, _total, _loss):
        if done == 7:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        condition.descend(picture, fixation, state=state, progress=stop)
    steps = []
    resumed = condition.descend(
        picture, fixation, state=state, progress=lambda done, *_: steps.append(done)
    )

    assert steps == list(range(6, 13))  # 5 were kept
    np.testing.assert_allclose(resumed, whole, atol=1e-5)
    assert [path.name for path in tmp_path.iterdir()] == ["state.npz"]


@pytest.mark.usefixtures("torch")
def test_a_state_of_something_else_is_refused(picture, fixation, tmp_path):
    state = tmp_path / "state.npz"
    EnergyMetamer(steps=1).descend(picture, fixation, state=state)
    other = PictureFixation(fixation.geometry, fixation.gaze_px, seed=6)

    with pytest.raises(InputError, match="it is another's"):
        EnergyMetamer(steps=1).descend(picture, other, state=state)
    whole = state.read_bytes()
    held = dict(np.load(state))
    harmed = {
        "pixels of another shape": held | {"pixels": held["pixels"][:1, :1]},
        "pixels that are NaN": held | {"pixels": held["pixels"] * np.nan},
        "squares below 0": held | {"square": held["square"] - 1},
        "a step past the end": held | {"done": 9},
        "no means": {name: held[name] for name in held if name != "mean"},
    }
    files = [b"nothing of ours", b"", whole[: len(whole) // 2], whole[:-1]]
    for arrays in harmed.values():
        np.savez(state, **arrays)
        files.append(state.read_bytes())
    for data in files:
        state.write_bytes(data)
        with pytest.raises(InputError, match=r"must be a state of energy-metamer.*delete it"):
            EnergyMetamer(steps=1).descend(picture, fixation, state=state)


@pytest.mark.usefixtures("torch")
def test_a_flat_picture_stays_flat(fixation):
    grey = np.full((HEIGHT, WIDTH, 3), 0.5, np.float32)

    shown = EnergyMetamer(steps=3).descend(grey, fixation)

    np.testing.assert_allclose(shown, grey, atol=0.02)


def test_without_torch_the_condition_names_the_cure(monkeypatch):
    real = importlib.util.find_spec
    monkeypatch.setattr(energy, "find_spec", lambda n: None if n == "torch" else real(n))

    with pytest.raises(InputError, match=r"needs torch.*metamerlab\[metamers\]"):
        create_condition("energy-metamer")
    assert condition_parameters("energy-metamer")["steps"] == 60


def test_the_registry_needs_no_torch(monkeypatch):
    real = builtins.__import__

    def refuse(name, *rest):
        assert name.partition(".")[0] != "torch"
        return real(name, *rest)

    monkeypatch.setattr(builtins, "__import__", refuse)

    assert "start" in condition_parameters("energy-metamer")


@pytest.mark.parametrize(
    ("parameters", "said"),
    [
        ({"start": "blur"}, "start must be one of"),
        ({"steps": 0}, "steps must lie in"),
        ({"levels": 7}, "levels must lie in"),
        ({"step": 3}, "did you mean 'steps'"),
    ],
)
def test_wrong_parameters_are_refused(parameters, said):
    with pytest.raises(InputError, match=said):
        create_condition("energy-metamer", parameters)
