"""Metrics of others give what their own libraries give; each runs in a process of its own."""

import json
import subprocess
import sys
import textwrap

import numpy as np
import pytest

pytestmark = [pytest.mark.slow, pytest.mark.usefixtures("with_metrics")]

# Runs in a fresh interpreter: pyfvvdp and cvvdp cannot share one. `ours(family, ...)` is the
# command's own path, and `test`, `truth` the frames it read, masked where `region` is holes.
HEAD = """
import json, sys, warnings
from pathlib import Path
import numpy as np
from stimuli.score.pair import ScoredPair
from stimuli.score.measure_clips import measure_job
from stimuli.score.viewing_conditions import ViewerGaze, open_viewing, standard_fhd

root = Path(sys.argv[1])
files = {name: tuple(sorted((root / name).iterdir())) for name in ("test", "truth", "holes")}

def make(frames=None, fps=30.0, same=False):
    cut = {name: paths[:frames] for name, paths in files.items()}
    height, width = 48, 64
    return ScoredPair("clip", cut["truth" if same else "test"], cut["truth"], cut["holes"],
                width, height, fps)

def ours(family, pair, viewing=None, gaze=ViewerGaze()):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        return measure_job(family, pair, viewing or standard_fhd(), gaze).values

def arrays(pair, region):
    test = np.stack([pair.test_frame(k, region) for k in range(pair.frames)])
    return test, np.stack([pair.truth_frame(k) for k in range(pair.frames)])

out = {}
def compare(name, mine, theirs):
    out[name] = [float(mine), float(theirs)]
"""
TAIL = "\nprint(json.dumps(out))\n"


@pytest.fixture
def files(tmp_path, clips, frames_writer):
    """Return a folder with a clip, its reference and its holes."""
    for name, frames in (
        ("test", clips.fills["metameric"]), ("truth", clips.truth), ("holes", clips.holes)
    ):  # fmt: skip
        frames_writer(tmp_path / name, frames)
    return tmp_path


def compared(files, body, **environment):
    """Run `body` in a fresh interpreter; return {name: [ours, theirs]}."""
    import os

    done = subprocess.run(
        [sys.executable, "-c", HEAD + textwrap.dedent(body) + TAIL, str(files)],
        capture_output=True,
        text=True,
        timeout=280,
        env=os.environ | environment,
    )
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout.splitlines()[-1])


def check(found, least):
    """Require equality of every pair, and `least` of them."""
    assert len(found) >= least
    for name, (mine, theirs) in found.items():
        assert mine == pytest.approx(theirs, rel=1e-5, abs=1e-6), name


def test_flip_is_that_of_flip_evaluator(files):
    check(compared(files, """
        import flip_evaluator
        pair, viewing = make(), standard_fhd()
        values = ours("flip", pair)
        for region in ("holes", "frame"):
            test, truth = arrays(pair, region)
            means = []
            for index in range(pair.frames):
                errors, mean, _ = flip_evaluator.evaluate(
                    truth[index], test[index], "LDR", applyMagma=False,
                    parameters={"ppd": viewing.px_per_deg})
                if region == "holes":
                    mean = errors[..., 0][pair.mask(index)].mean()
                means.append(mean)
            compare(region, values["flip", region], np.mean(means))
        compare("identical", ours("flip", make(same=True))["flip", "frame"], 0.0)
    """), 3)  # fmt: skip


def test_fovvideovdp_is_that_of_pyfvvdp(files, tmp_path):
    (tmp_path / "gaze").mkdir()
    found = compared(files, """
        values = ours("fovvideovdp", make())
        same = ours("fovvideovdp", make(same=True))
        at = (20.0, 24.0)
        foveated = ours("fovvideovdp", make(), gaze=ViewerGaze((at,)))
        moving = ((10.0, 10.0), (20.0, 20.0), (30.0, 30.0), (40.0, 40.0))
        followed = ours("fovvideovdp", make(), gaze=ViewerGaze(moving))
        still = ours("fovvideovdp", make(1, 0.0))
        ours_fhd = ours("fovvideovdp", make(), open_viewing("fhd27-60hz"))
        import torch, pyfvvdp, tempfile, shutil
        from pyfvvdp import utils
        def direct(metric, region, frames=None, **more):
            test, truth = arrays(make(frames), region)
            if frames == 1:
                return metric.predict(test[0], truth[0], dim_order="HWC", **more)[0]
            return metric.predict(test, truth, dim_order="FHWC", frames_per_second=30, **more)[0]
        plain = pyfvvdp.fvvdp(display_name="standard_fhd")
        compare("px per degree", standard_fhd().px_per_deg, plain.pix_per_deg)
        for region in ("holes", "frame"):
            compare(region, values["fvvdp", region], direct(plain, region))
            compare("identical " + region, same["fvvdp", region], 10.0)
            compare("identical 1.0 " + region, same["fvvdp-1.0", region], 10.0)
        compare("picture", still["fvvdp", "holes"], direct(plain, "holes", 1))
        fixed = pyfvvdp.fvvdp(display_name="standard_fhd", foveated=True)
        compare("fixed gaze", foveated["fvvdp", "frame"],
                direct(fixed, "frame", fixation_point=np.array(at)))
        compare("moving gaze", followed["fvvdp", "frame"],
                direct(fixed, "frame", fixation_point=np.array(moving)))
        out["foveated has no 1.0"] = [float(("fvvdp-1.0", "frame") in foveated), 0.0]
        geometry = pyfvvdp.fvvdp_display_geometry(
            (1920, 1080), distance_m=0.7, diagonal_size_inches=np.hypot(597.7, 336.2) / 25.4)
        lab = pyfvvdp.fvvdp(display_name="standard_fhd", display_geometry=geometry)
        compare("our display", ours_fhd["fvvdp", "frame"], direct(lab, "frame"))
        compare("our px per degree", open_viewing("fhd27-60hz").px_per_deg, lab.pix_per_deg)
        # Version 1.0 by hand: its parameters set on the metric, one by one.
        shipped = Path(pyfvvdp.__file__).parent / "fvvdp_data/fvvdp_parameters_1_0.json"
        old = pyfvvdp.fvvdp(display_name="standard_fhd")
        for key, value in json.loads(shipped.read_text()).items():
            if key in vars(old) and key != "k_cm":  # in the fovea no magnification
                setattr(old, key, value)
        compare("1.0", values["fvvdp-1.0", "holes"], direct(old, "holes"))
        alike = values["fvvdp", "frame"] == values["fvvdp-1.0", "frame"]
        out["versions differ"] = [float(alike), 0.0]
        out["gaze matters"] = [float(values["fvvdp", "frame"] == foveated["fvvdp", "frame"]), 0.0]
    """)  # fmt: skip
    for name, (mine, theirs) in found.items():
        # Our display's pitch is its width's; the library takes it from diagonal and proportions.
        close = 1e-3 if name.startswith("our") else 1e-5
        assert mine == pytest.approx(theirs, rel=close), name
    assert len(found) >= 14


def test_colorvideovdp_is_that_of_cvvdp(files):
    check(compared(files, """
        values = ours("colorvideovdp", make())
        same = ours("colorvideovdp", make(same=True))
        still = ours("colorvideovdp", make(1, 0.0))
        import pycvvdp
        metric = pycvvdp.cvvdp(display_name="standard_fhd", quiet=True)
        for region in ("holes", "frame"):
            test, truth = arrays(make(), region)
            compare(region, values["cvvdp", region],
                    metric.predict(test, truth, dim_order="FHWC", frames_per_second=30)[0])
            compare("identical " + region, same["cvvdp", region], 10.0)
        test, truth = arrays(make(1), "frame")
        compare("picture", still["cvvdp", "frame"],
                metric.predict(test[0], truth[0], dim_order="HWC")[0])
        ours("colorvideovdp", make(1, 0.0), open_viewing("fhd27-60hz"))
    """), 5)  # fmt: skip


def test_lpips_is_that_of_lpips_with_weights_from_a_file(files, tmp_path):
    """The file's place is where torch looks; here it holds weights drawn at random."""
    found = compared(files, """
        from stimuli.score.lpips_alex import weights_path
        from stimuli.score.torch_parts import load_torchvision, quiet_libraries
        with quiet_libraries():
            load_torchvision()
            import torch, torchvision
        assert not weights_path().exists()
        weights_path().parent.mkdir(parents=True)
        torch.manual_seed(1)
        torch.save(torchvision.models.alexnet(weights=None).state_dict(), weights_path())
        values = ours("lpips", make())
        same = ours("lpips", make(same=True))
        import lpips
        with quiet_libraries():
            model = lpips.LPIPS(net="alex", verbose=False)
        for region in ("holes", "frame"):
            test, truth = (torch.tensor(a).permute(0, 3, 1, 2) for a in arrays(make(), region))
            with torch.no_grad():
                each = [model(test[k:k+1], truth[k:k+1], normalize=True).item() for k in range(4)]
            compare(region, values["lpips", region], np.mean(each))
            compare("identical " + region, same["lpips", region], 0.0)
    """, TORCH_HOME=str(tmp_path / "torch"))  # fmt: skip
    check(found, 4)
    assert found["frame"][0] > 0


def test_without_lpips_weights_the_rest_goes_on(run_score, batch, tmp_path, monkeypatch):
    monkeypatch.setenv("TORCH_HOME", str(tmp_path / "torch"))
    done = run_score(batch, "--out", tmp_path / "scores", "--metrics", "lpips,psnr")

    told = " ".join(done.stdout.split())
    assert "alexnet-owt-7be5be79.pth" in told
    assert str(tmp_path / "torch/hub/checkpoints") in told
    assert "psnr" in (tmp_path / "scores/scores.csv").read_text()


def test_all_families_side_by_side(run_score, batch, tmp_path):
    """The video metrics, which cannot share a process, in one command."""
    names = "flip,fvvdp,fvvdp-1.0,cvvdp"
    run_score(batch, "--out", tmp_path / "scores", "--metrics", names)

    numbers = json.loads((tmp_path / "scores/scores.json").read_text())
    assert {"torch", "pyfvvdp", "cvvdp", "flip-evaluator"} <= numbers["versions"].keys()
    for clip in numbers["clips"]:
        assert len(clip["scores"]) == 8
        assert all(np.isfinite(value) for value in clip["scores"].values())
    page = (tmp_path / "scores/scores.html").read_text()
    assert "Table 2: FovVideoVDP 1.0" in page
    assert "not for commercial use" in page
