"""What a lab's own package brings, part by part, and what is said of a package that is broken.

`tests/presenter/test_a_labs_study.py` runs a whole study with it.
"""

from __future__ import annotations

import pytest


def test_a_labs_method_and_metric_are_listed_with_their_package(with_packages, lab_site):
    done = with_packages(lab_site, ("warp", "--list"), ("stimuli", "score", "--list"))

    assert done.returncode == 0, done.stderr
    assert "of the package lab-package" in done.stdout
    for name in ("lab-mean", "lab-error"):
        assert name in done.stdout


@pytest.mark.parametrize(
    ("entry_points", "words", "message"),
    [
        ("[metamerlab.tasks]\nyes-no = broken:Task", ("protocol", "check", "demo"),
         "a plug-in must have a name of its own in metamerlab.tasks (got 'yes-no'"),
        ("[metamerlab.tasks]\nmine = broken:Missing", ("protocol", "check", "demo"),
         "its plug-in 'mine' of metamerlab.tasks must load"),
        ("[metamerlab.methods]\ntelea = broken:Task", ("warp", "--list"),
         "a plug-in must have a name of its own in metamerlab.methods (got 'telea'"),
        ("[metamerlab.builders]\nfiles = broken:Task", ("protocol", "check", "demo"),
         "a plug-in must have a name of its own in metamerlab.builders (got 'files'"),
        ("[metamerlab.trackers]\nlsl = broken:Task",
         ("session", "run", "demo", "--participant", "P1", "--display", "fhd27-60hz",
          "--stimuli", ".", "--out", "nowhere"),
         "a plug-in must have a name of its own in metamerlab.trackers (got 'lsl'"),
    ],
)  # fmt: skip
def test_a_broken_plug_in_is_named_with_its_package_and_a_cure(
    install_package, with_packages, entry_points, words, message
):
    site = install_package("broken", {"broken.py": "class Task: pass\n"}, entry_points + "\n")
    done = with_packages(site, words)

    assert done.returncode == 2, (done.stdout, done.stderr)
    assert "Traceback" not in done.stderr
    assert "package 'broken'" in done.stderr
    assert message in " ".join(done.stderr.split())
    assert "uninstall the package" in done.stderr
