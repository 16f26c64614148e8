"""Every published answer we were given is checked by a named test, or says why it is not."""

import ast
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

CHECKED = {
    "fig10_metameric_inpainting/n": "figure_10_p_values_and_limits",
    "fig10_metameric_inpainting/counts_consistent_with_rounding": ("figure_10_p_values_and_limits"),
    "fig10_metameric_inpainting/binom_p": "figure_10_p_values_and_limits",
    "fig10_metameric_inpainting/CP95": "figure_10_p_values_and_limits",
    "fig10_metameric_inpainting/pwcmp_JOD_default_prior[Ours,PP,Ref]": (
        "figure_10_on_the_jod_scale_equals_pwcmp_without_its_prior"
    ),
    "fig10_metameric_inpainting/BT_logit_R_glm_Large(ref=0)": "figure_10_bradley_terry_and_firth",
    "fig10_metameric_inpainting/BT_Firth_brglm2_Large": "figure_10_bradley_terry_and_firth",
    "fig10_metameric_inpainting/unanimous_132_of_132": "figure_10_bradley_terry_and_firth",
    "beyond_blur_table1": "table_1_standard_errors",
    "BT2_citations": "citations",
    "BT2_baseball": "baseball_with_and_without_the_home_advantage",
    "eba/thurstone_taste_David1988": "tasters_on_thurstones_scale",
    "eba/redwines_preference": "red_wines",
    "eba/SQpreference_BT_vs_Mono": "sound_quality",
    "Faces2": "faces",
    "pwcmp_tmo_octave": "tone_mapping_on_the_jod_scale_equals_pwcmp",
    "sureal_lukas": "subjective_video_votes",
    "choix/cycle_plus1 data [[0,1],[0,1],[1,2],[2,0]] ml": "a_cycle_with_one_more_vote",
    "psignifit_demo": "psychometric_functions",
    "HSP_SH_R2": "seeing_quanta",
    "sensR/AnotA(10,20,3,20)": "discrimination",
    "sensR/SDT 8/25,1/25 d": "discrimination",
    "sensR/logit d": "discrimination",
    "sensR/odor (Macmillan&Creelman) d per criterion": "odour_ratings_at_every_criterion",
    "sensR/discrim 2AFC 10/15": "discrimination",
    "sensR/psyinv(.8,2AFC)": "discrimination",
}
"""Entry (and all below it): the test that reads it, without its ``test_``."""

LOOSER = {
    "fig10_metameric_inpainting/pwcmp_JOD_default_prior[Ours,PP,Ref]": (
        "with pwcmp's prior: .03 JOD. Our scale has none, so that scores do not depend on the"
        " number of votes; without it 1e-4"
    ),
    "beyond_blur_table1/SE_printed": "printed with three digits",
    "beyond_blur_table1/SE_expected_information": "from coefficients read with three digits",
    "beyond_blur_table1/T_printed": "one of the five is a slip of the print",
    "eba/SQpreference_BT_vs_Mono/Holm_sig_pairs/participant_x_scene_quasi_t": (
        "12 by the textbook's quasi-t, 11 by ours, which leans to the safe side with four scenes"
    ),
    "eba/SQpreference_BT_vs_Mono/glmer_sd_id_median": "given with two digits",
    "eba/SQpreference_BT_vs_Mono/sd_scene_median": "given with two digits",
    "Faces2/statsmodels_VB": "known to be wrong by a factor of four: ours must differ",
    "pwcmp_tmo_octave/all18_gaussian": "pwcmp's prior, as above: .03 JOD",
    "pwcmp_tmo_octave/all16_gaussian": "pwcmp's prior, as above: .03 JOD",
    "pwcmp_tmo_octave/all16_boot500_sd": "500 random draws: 15 %",
    "pwcmp_tmo_octave/outlier_dist": "another distance: the same two observers lie farthest",
    "sureal_lukas/BT_MLE_sum": "through means that are given with three digits",
    "sureal_lukas/BT_MLE_var": "through means that are given with three digits",
    "sureal_lukas/BT_kurtosis": "through means that are given with three digits",
    "psignifit_demo/MATLAB_MAP": "the mode of all numbers; ours are the medians of each: 1 %",
    "psignifit_demo/MATLAB_CI95_threshold": "limits of a posterior on another grid: .1 %",
    "psignifit_demo/MATLAB_CI95_width": "limits of a posterior on another grid: 1 %",
    "psignifit_demo/py4.3_CI95_threshold": "limits of a posterior on another grid: 1 %",
}
"""Checked, but not to 1e-4, and why."""

NOT_OURS = {
    "fig10_metameric_inpainting/meaning": "a remark",
    "beyond_blur_table1/note": "a remark",
    "beyond_blur_table1/TOST_ours": "equivalence of a coefficient: ours is of a share, by its test",
    "beyond_blur_table1/TOST_blur35": "as above",
    "BT2_baseball/published": "a remark",
    "psignifit_demo/ML_plain": "maximum likelihood of one curve: ours are posteriors, or of many",
    "psignifit_demo/test1_2AFC_gauss": "the mode of a broad posterior, of ten trials a level",
    "psignifit_demo/yesno_gauss": "as above",
    "HSP_SH_R2/probit_log10Q": "maximum likelihood of one curve, as above",
    "HSP_SH_R2/probit_dev": "as above",
    "pwcmp_tmo_octave/README_claim": "a remark",
    "sureal_lukas/BT_std_sum": (
        "sureal's own formula, with 'n / pp * 2' where the second derivative has 'n / pp**2'"
    ),
    "sureal_lukas/Thurstone_std_sum": (
        "sureal's 'simplified' second derivative, which is not that of its likelihood"
    ),
    "choix/lsr": "Luce spectral ranking, which is not maximum likelihood: no method of ours",
    "choix/opt_8random_alpha.5": "a ridge penalty, no method of ours, on data that are not here",
    "sensR/twoAC(2,2,6)": "a model of ties: no task of ours lets people say that they see none",
    "geepack_ohio_exch": "estimating equations: clustered and mixed models stand in their place",
    "Faces2/obs_only/se_gee": "as above",
    "eba/dog_circular": "circular triads: who reports them takes eba (R) on decisions.csv",
    "eba/kendall_u_boys": "Kendall's u: as above",
    "eba/kendall_u_girls": "as above",
    "eba/redwines_preference/kendall_u": "as above",
    "eba/redwines_preference/u_chi2": "as above",
    "eba/redwines_preference/u_p": "as above",
    "eba/redwines_preference/circular_T": "as above",
    "eba/redwines_preference/zeta": "as above",
    "eba/redwines_preference/MST_viol": "as above",
    "eba/redwines_preference/SST_viol": "as above",
    "BF10_binomial_uniform": "Bayes factors: brms and bambi compute them, nothing of ours does",
    "sensR/power d=1 n=30": "exact power of one binomial test: ours simulates clustered studies",
    "sensR/SS pd=.5 power .8": "as above",
    "sensR/SS d=1 power .9": "as above",
    "sensR/betabin x=[3,2,6,8,3,4,6,0,9,9,0,2,1,2,8,9,5,7] n=[10,9,8,9,8,6,9,10,10,10,9,9,10,10,"
    "10,10,9,10]": "beta-binomial model: participants vary in our mixed and clustered models",
}
"""Not checked, and why."""

ITERATED = {
    # Read without naming them, by going through the entry above.
    "fig10_metameric_inpainting/counts_consistent_with_rounding",
    "fig10_metameric_inpainting/binom_p",
    "fig10_metameric_inpainting/CP95",
    "BT2_citations/coef",
    "BT2_baseball/coef",
    "eba/redwines_preference/BT_vs_Bourgogne",
    "pwcmp_tmo_octave/outlier_dist",
}


def leaves(node: Any, path: tuple[str, ...] = ()) -> Iterator[tuple[str, ...]]:
    """Yield the keys that lead to every answer; lists are one answer."""
    if not isinstance(node, dict):
        yield path
        return
    for key, value in node.items():
        yield from leaves(value, (*path, key))


def under(path: tuple[str, ...], entry: str) -> bool:
    """Say whether `path` is `entry` or lies below it; keys may hold slashes."""
    text = "/".join(path)
    return text == entry or text.startswith(entry + "/")


def test_every_published_answer_is_checked_by_a_test_or_says_why_not(expected):
    source = Path(__file__).with_name("test_published_answers.py").read_text()
    tests = {
        node.name.removeprefix("test_"): ast.get_source_segment(source, node) or ""
        for node in ast.parse(source).body
        if isinstance(node, ast.FunctionDef) and node.name.startswith("test_")
    }
    silent = []
    for path in leaves(expected):
        if any(under(path, entry) for entry in NOT_OURS):
            continue
        test = next((name for entry, name in CHECKED.items() if under(path, entry)), "")
        body = tests.get(test, "")
        through = any(under(path, entry) for entry in ITERATED)
        named = path[:-1] if through else path
        # A test reads what it names: f"OR{ratio:g}" is made from parts.
        if not body or not all(
            f'"{key}"' in body or key.startswith(("OR1", "OR2")) for key in named
        ):
            silent.append("/".join(path))
    assert silent == []


@pytest.mark.parametrize("table", [CHECKED, LOOSER, NOT_OURS], ids=["checked", "looser", "not"])
def test_the_lists_of_answers_name_nothing_that_does_not_exist(expected, table):
    every = list(leaves(expected))
    assert [entry for entry in table if not any(under(path, entry) for path in every)] == []
    assert all(table.values())
