"""Preferences as posteriors: the mixed model, ROPE, priors, and the cure without NumPyro.

JAX, which NumPyro brings, has threads, and other tests fork this process: it is read in others.
"""

from __future__ import annotations

import json
import multiprocessing
import os
import sys
from concurrent.futures import ProcessPoolExecutor
from importlib.util import find_spec

import forked
import numpy as np
import pandas as pd
import pytest
from typer.testing import CliRunner

from analysis.models import preference_posterior as module
from analysis.models.logistic import glmm_logit
from analysis.models.preference_posterior import Posterior, Prior, _verdict, bayesian_preference
from analysis.parts.bayes import BayesPart
from analysis.tasks import analysis_of
from protocols.errors import StudyError
from study_app.cli import app

needs_numpyro = pytest.mark.skipif(
    find_spec("numpyro") is None,
    reason="needs the extra `bayes`: pip install 'metamerlab[bayes]'",
)


def votes(seed: int = 3, people: int = 14, scenes: int = 6, repeats: int = 4) -> pd.DataFrame:
    """Choices with a typical logit of 0.8, and deviations of .6 and .4."""
    rng = np.random.default_rng(seed)
    person, scene = rng.normal(0, 0.6, people), rng.normal(0, 0.4, scenes)
    rows = []
    for who in range(people):
        for place in range(scenes):
            for repeat in range(repeats):
                share = 1 / (1 + np.exp(-(0.8 + person[who] + scene[place])))
                pair = ("ours", "theirs")[:: 1 if repeat % 2 else -1]
                chosen = "ours" if rng.random() < share else "theirs"
                rows.append((f"P{who:02}", f"s{place}", "all", *pair, chosen))
    return pd.DataFrame(rows, columns=["participant", "scene", "size", "first", "second", "chosen"])


@pytest.fixture(scope="module")
def fitted():
    with ProcessPoolExecutor(1, multiprocessing.get_context("spawn")) as apart:
        priors = {"default": Prior(), "tight": Prior(0.1, 0.1)}
        asked = apart.submit(bayesian_preference, votes(), "ours", "theirs", priors=priors)
        return asked.result()


@needs_numpyro
def test_the_posterior_agrees_with_the_mixed_model(fitted):
    rows = votes().assign(y=lambda r: (r["chosen"] == "ours").astype(int))
    mixed = glmm_logit("y ~ 1", rows, groups=("participant", "scene"))["Intercept"]

    # The posterior averages over deviations and has heavier tails: its sd is the larger.
    assert fitted.typical.mean == pytest.approx(mixed.estimate, abs=0.4 * mixed.standard_error)
    assert 0.95 < fitted.typical.sd / mixed.standard_error < 1.6
    assert fitted.typical.lower < 0.8 < fitted.typical.upper
    assert fitted.participant_sd.lower < 0.6 < fitted.participant_sd.upper
    assert fitted.r_hat < 1.02
    assert fitted.trials == 14 * 6 * 4


@needs_numpyro
def test_a_prior_that_rules_is_noted(fitted):
    default, tight = fitted.sensitivity

    assert abs(tight.share.median - 0.5) < abs(default.share.median - 0.5) - 0.02
    assert any("the prior matters" in note for note in fitted.warnings)
    assert fitted.share == default.share
    assert fitted.better > 0.95


SHORT_CHAINS = f"""
import {module.__name__} as module

module.WARM_UP = module.DRAWS = 150
module.CHAINS, module.LEAST_DRAWS, module.WORST_R_HAT = 2, 20, 1.2
"""


@needs_numpyro
def test_the_command_tells_and_writes(tmp_path):
    file, out = tmp_path / "votes.csv", tmp_path / "out"
    votes(people=5, scenes=3, repeats=2).to_csv(file, index=False)
    result = forked.run(
        "analysis", "bayes", file, "--against", "ours", "--out", out,
        code=SHORT_CHAINS + forked.METAMERLAB, env={**os.environ, "COLUMNS": "200"},
    )  # fmt: skip

    assert result.returncode == 0, result.stderr
    assert "theirs was chosen over ours with a share of" in result.stdout
    table = pd.read_csv(out / "tables" / "posteriors.csv")
    assert table["prior"].tolist() == ["default", "narrow", "wide"]
    assert (table["lower"] < table["share"]).all()
    assert (out / "figures" / "posteriors-1-column.pdf").is_file()


@pytest.mark.parametrize(
    ("centre", "sd", "verdict"),
    [
        (0.75, 0.03, "preferred"),
        (0.25, 0.03, "other preferred"),
        (0.52, 0.02, "practically equal"),
        (0.62, 0.05, "undecided"),
    ],
)
def test_the_verdict_is_where_the_limits_lie(centre, sd, verdict):
    draws = centre + sd * np.linspace(-3, 3, 601)
    inside, said = _verdict(draws, 0.1, 0.95)

    assert said == verdict
    assert inside == pytest.approx(np.mean(np.abs(draws - 0.5) < 0.1))


def test_without_numpyro_the_message_names_the_cure(monkeypatch):
    for name in ("jax", "numpyro"):
        monkeypatch.setitem(sys.modules, name, None)
    with pytest.raises(StudyError, match=r"metamerlab\[bayes\]"):
        bayesian_preference(votes(people=3), "ours", "theirs")


def test_what_cannot_be_compared_is_refused():
    rows = votes(people=3)

    with pytest.raises(ValueError, match="no decision compares"):
        bayesian_preference(rows, "ours", "blur")
    with pytest.raises(ValueError, match="two participants"):
        bayesian_preference(rows[rows["participant"] == "P00"], "ours", "theirs")


def test_chains_that_cannot_be_trusted_are_noted():
    flat = np.full(10, 0.5)
    draws = module._Draws(flat, flat, flat, flat, 1.2, 30.0, 4)
    one = module.PriorCheck("default", Posterior(0.5, 0.5, 0.1, 0.4, 0.6), 0.9, "undecided")
    notes = module._notes(draws, (one,), 12)

    assert any("do not agree" in note for note in notes)
    assert any("4 draws diverged" in note for note in notes)


def test_a_study_that_asks_for_posteriors_has_the_part_and_one_that_does_not_keeps_its_hash(
    demo_protocol,
):
    asked = demo_protocol.analysis.model_copy(update={"bayes": True})
    study = demo_protocol.model_copy(update={"analysis": asked})
    analysis = analysis_of("preference")

    for protocol, wanted in ((demo_protocol, False), (study, True)):
        settings = analysis.settings(protocol)
        assert BayesPart().wanted(votes(people=2), settings) == wanted
        assert analysis.told_by(settings).bayes == wanted
        assert ("bayes" in json.dumps(protocol.analysis.model_dump())) == wanted


def test_a_method_that_is_none_is_refused_by_the_option_that_named_it(tmp_path):
    votes(people=2, scenes=2, repeats=2).to_csv(tmp_path / "votes.csv", index=False)
    done = CliRunner().invoke(
        app, ["analysis", "bayes", str(tmp_path / "votes.csv"), "--method", "our"]
    )

    assert done.exit_code == 2
    assert "--method our: must be one of ours, theirs; did you mean 'ours'?" in " ".join(
        done.output.split()
    )
