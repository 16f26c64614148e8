"""Photographs behind cut-outs: `script/bench paper --photos` knows the truth of every hole."""

import numpy as np
import pytest

from benchmarks.paper import METRICS, behind_cut_outs, main
from stimuli.pictures import save_picture


@pytest.fixture
def folder(tmp_path, rng):
    """Two photographs of a fine grain, 600 px wide: one red, one grey and brighter to the right."""
    ramp = np.linspace(-60, 60, 600)[:, None]
    for name, colour in (("grey", 120 + ramp), ("red", np.array((200, 20, 20)))):
        grain = rng.integers(-15, 16, (400, 600, 1))
        save_picture(tmp_path / f"{name}.png", (colour + grain + np.zeros(3)).astype(np.uint8))
    return tmp_path


def test_what_is_behind_a_cut_out_is_the_photograph_and_nothing_of_the_other(gl_context, folder):
    (name, (view,)), (other, _) = behind_cut_outs(gl_context, folder)

    assert (name, other) == ("grey", "red")
    hole, colour = view.mask, view.warped.colour
    assert 0.01 < hole.mean() < 0.3
    assert (view.warped.hole >= hole).all()
    red = view.truth[..., 0] - view.truth[..., 1] > 0.3
    assert red.mean() > 0.05  # what stands in front
    assert not red[hole].any()
    # The ramp goes on across the hole's border: truth is where the background moved.
    column = np.indices(hole.shape)[1]
    background = ~view.warped.hole & ~red
    ramp = np.polynomial.Polynomial.fit(column[background], colour[background][:, 1], 1)
    off = view.truth[hole][:, 1] - ramp(column[hole])
    assert abs(off.mean()) < 1 / 255  # a way of 20 px that is wrong would be 5 / 255


@pytest.mark.slow
def test_the_command_prints_means_and_a_row_for_every_photograph(folder, capsys, monkeypatch):
    def closeness(fill, truth, mask):
        return 10 - float(abs(fill - truth)[mask].mean())

    monkeypatch.setitem(METRICS, "fvvdp", lambda: closeness)

    methods = ("push-pull-depth", "background-extension")
    assert main(["--photos", str(folder), "--methods", *methods]) == 0

    rows = [line.split(" | ") for line in capsys.readouterr().out.splitlines()]
    means = {row[1]: float(row[2]) for row in rows if row[0] == "| mean" and len(row) > 3}
    assert set(means) == set(methods)
    assert min(means.values()) > 25  # PSNR: both fill with the photograph's colour
    assert {"| grey", "| red", "| mean"} <= {row[0] for row in rows if len(row) == 2}


def test_a_folder_without_photographs_is_refused(tmp_path, capsys):
    with pytest.raises(SystemExit) as end:
        main(["--photos", str(tmp_path)])

    assert end.value.code == 2
    assert "must hold .png or .jpg files" in capsys.readouterr().err
