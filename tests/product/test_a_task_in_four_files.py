"""A task that does not ship, `odd-one-out`: three files and a row beside its schema, and it runs.

The files of `tests/odd_one_out` are laid into a copy of `protocols`, and nothing else is touched.
"""

import importlib.util
import json
import shutil
from pathlib import Path

import numpy as np
import pytest

FILES = Path(__file__).parents[1] / "odd_one_out"
PLACES = {
    "odd_one_out.py": "tasks/odd_one_out.py",
    "triangle.py": "triangle.py",
    "odd-one-out.toml": "templates/parts/odd-one-out.toml",
}
ROW = '    "odd-one-out": TaskKind(OddOneOut, *_DIFFERING, _TEXTURES),\n'
IMPORT = "from protocols.tasks.odd_one_out import OddOneOut\n"


@pytest.fixture
def site(tmp_path, repository):
    """A folder whose `protocols` knows the task."""
    protocols = tmp_path / "site" / "protocols"
    shutil.copytree(repository / "protocols", protocols, ignore=shutil.ignore_patterns("*.pyc"))
    for name, place in PLACES.items():
        assert not (protocols / place).exists()
        shutil.copyfile(FILES / name, protocols / place)
    kinds = protocols / "tasks" / "task_kinds.py"
    text = kinds.read_text(encoding="utf-8")
    after, row = "from protocols.tasks.identification import Identification\n", '    "rating": '
    assert text.count(after) == text.count(row) == 1
    text = text.replace(after, after + IMPORT).replace(row, ROW + row)
    kinds.write_text(text, encoding="utf-8")
    return tmp_path / "site"


def triangle():
    """The answer rule of the task."""
    spec = importlib.util.spec_from_file_location("triangle", FILES / "triangle.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module.Triangle(3)


def test_it_is_three_files_and_a_row():
    assert {path.name for path in FILES.iterdir() if path.is_file()} == set(PLACES)
    assert len(PLACES) + 1 <= 5


def test_the_odd_one_is_found_as_often_as_noise_lets_it(rng):
    """By drawing: the one that is not of the nearest two is taken."""
    rule = triangle()
    assert rule.share(0.0) == pytest.approx(rule.chance)
    for d_prime in (0.5, 1.5, 3.0):
        one, same, odd = rng.normal([[0], [0], [d_prime]], 1, (3, 200_000))
        found = abs(one - same) < np.minimum(abs(one - odd), abs(same - odd))
        assert rule.share(d_prime) == pytest.approx(found.mean(), abs=0.005)
        assert rule.d_prime(rule.share(d_prime)) == pytest.approx(d_prime)


@pytest.mark.slow
def test_it_runs_from_a_new_study_to_power_and_report(site, with_packages, tmp_path):
    made, report = tmp_path / "odd", tmp_path / "report"
    study, clips, sessions = made / "study.toml", made / "clips", made / "sessions"
    done = with_packages(
        site,
        ("new-study", made, "--task", "odd-one-out"),
        ("protocol", "check", study),
        ("stimuli", "build", study, "--out", clips),
        ("session", "simulate", study, "--stimuli", clips, "--out", sessions, "--participants", 3),
        ("analysis", "report", sessions, "--protocol", study, "--out", report),
        ("analysis", "power", study, "--studies", 100, "--out", tmp_path / "power"),
    )  # fmt: skip

    assert done.returncode == 0, (done.stdout, done.stderr)
    text = study.read_text(encoding="utf-8")
    assert "# guess = [0.3333333333333333]" in text
    assert 'side = "fixed"' in text
    results = json.loads((report / "results.json").read_text())
    sensitivity = results["results"]["sensitivity"]
    assert sensitivity["rule"] == "odd one out of three"
    found = sensitivity["conditions"][0]
    right = triangle().d_prime(found["correct"]["lower"])
    assert found["lower"] == pytest.approx(float(right))
    assert found["correct"]["chance"] == pytest.approx(1 / 3)


@pytest.mark.slow
def test_a_table_of_it_is_read_by_its_name(site, with_packages, tmp_path):
    rows = ["participant,scene,texture,correct"]
    rows += [f"p{k % 4},s{k % 3},fine,{int(k % 5 > 0)}" for k in range(60)]
    table = tmp_path / "table.csv"
    table.write_text("\n".join(rows) + "\n", encoding="utf-8")
    out = tmp_path / "imported"
    done = with_packages(
        site,
        ("analysis", "import", table, "--task", "odd-one-out", "--set", "by=texture", "--out", out),
    )
    assert done.returncode == 0, (done.stdout, done.stderr)
