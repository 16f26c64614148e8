"""Plans that can never show anything: said, or refused, before the data."""

import re
from pathlib import Path

import pytest
from typer.testing import CliRunner

from analysis.models.sequential_bounds import plan_of, standing
from analysis.planning import look_problems, planning_notes
from analysis.showable import hopeless
from analysis.tasks import analysis_of
from protocols.load import load_protocol
from protocols.study_file.sequential import Sequential
from study_app.cli import app

ROOT = Path(__file__).parents[3]
TEXTS = {name: (ROOT / "protocols" / "studies" / f"{name}.toml").read_text() for name in
         ("demo", "inpainting-2afc", "beyond-blur-task", "beyond-blur-detection")}  # fmt: skip


def written(folder, looks, people, *, name="demo", rule="obrien-fleming", **changed):
    """Return a file with a shipped study that plans looks."""
    text = re.sub(r"\nparticipants = \d+\n", f"\nparticipants = {people}\n", TEXTS[name], count=1)
    for old, new in changed.items():
        text = text.replace(old.replace("_", " "), new)
    text += f'\n[analysis.sequential]\nrule = "{rule}"\nlooks = {list(looks)}\n'
    file = folder / "study.toml"
    file.write_text(text)
    return file


def run(*arguments):
    return CliRunner().invoke(app, [*map(str, arguments)], env={"COLUMNS": "400"})


@pytest.mark.parametrize(
    ("looks", "rule", "name"),
    [
        ((8, 16, 24), "obrien-fleming", "demo"),
        ((3, 5, 24), "pocock", "inpainting-2afc"),
        ((6, 12), "obrien-fleming", "beyond-blur-task"),
        ((4, 6), "pocock", "beyond-blur-detection"),
        ((4, 8), "bayes-factor", "demo"),
    ],
)
def test_looks_that_can_never_stop_have_a_cure_that_works(tmp_path, looks, rule, name):
    (problem,) = look_problems(load_protocol(written(tmp_path, looks, looks[-1], name=name,
                                                     rule=rule)))  # fmt: skip
    assert "each look must be able to stop the study" in problem
    if enough := re.search(r"plan (\d+) participants or more", problem):
        study = load_protocol(written(tmp_path, looks, looks[-1], name=name))
        least = analysis_of(study.analysis.kind).least_p(study, int(enough[1]))
        assert least <= study.analysis.alpha
        return
    (cure,) = re.findall(r"say looks = \[(.*?)\]", problem)
    better = tuple(map(int, cure.split(",")))
    assert better[-1] == looks[-1]
    file = written(tmp_path, better, looks[-1], name=name, rule=rule)
    assert not look_problems(load_protocol(file))


@pytest.mark.parametrize(
    "command", [("protocol", "check"), ("protocol", "preregister"), ("analysis", "sequential")]
)
def test_every_command_of_planning_refuses_looks_that_can_never_stop(tmp_path, command):
    refused = run(*command, written(tmp_path, (8, 16, 24), 24))

    assert refused.exit_code == 2
    assert "say looks = [11, 16, 24]" in refused.output


def test_the_examples_of_page_and_template_can_stop(tmp_path):
    page = (ROOT / "docs" / "analysis.md").read_text()
    template = (ROOT / "protocols" / "templates" / "study.toml").read_text()
    for text in (page, template):
        looks = tuple(map(int, re.search(r"looks = \[(.*?)\]", text)[1].split(",")))
        for name in ("demo", "beyond-blur-task"):
            file = written(tmp_path, looks, looks[-1], name=name)
            assert not look_problems(load_protocol(file)), (looks, name)


def test_pooled_trials_and_ratings_stop_at_any_look(tmp_path):
    file = written(tmp_path, (2, 24), 24, name="demo")
    pooled = load_protocol(file)
    pooled = pooled.model_copy(
        update={"analysis": pooled.analysis.model_copy(update={"test": "pooled"})}
    )
    assert look_problems(load_protocol(file))
    assert not look_problems(pooled)
    assert analysis_of("ratings").least_p(pooled, 2) == 0.0


def test_a_look_of_old_data_that_could_not_stop_says_so():
    plan = plan_of(Sequential(rule="obrien-fleming", looks=(8, 16, 24)), 0.05)

    assert "could never stop" in standing(plan, 8, 0.0078, 2 * 0.5**8).sentence
    assert "could never stop" not in standing(plan, 16, 0.03, 2 * 0.5**16).sentence


def test_a_family_needs_as_many_participants_as_are_said():
    (said,) = hopeless(8, 15, 0.05)
    enough = int(re.search(r"takes (\d+) participants", said)[1])

    assert 15 * 2 * 0.5**enough < 0.05 <= 15 * 2 * 0.5 ** (enough - 1)
    assert hopeless(enough, 15, 0.05) == []
    assert "the comparison cannot be significant" in hopeless(5, 1, 0.05)[0]


def test_planning_says_what_two_scenes_and_small_families_cannot_show():
    study = load_protocol(Path("demo"))
    participant = study.model_copy(
        update={"analysis": study.analysis.model_copy(update={"test": "participant"})}
    )

    assert [note.split()[0] for note in planning_notes(study)] == ["none", "two"]
    assert [note.split()[0] for note in planning_notes(participant)] == ["none"]
    assert planning_notes(load_protocol(Path("inpainting-2afc"))) == []
    said = " ".join(run("protocol", "check", "demo").output.split())
    assert "note: two scenes show hardly anything" in said
