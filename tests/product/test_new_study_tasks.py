"""`new-study --task NAME`: a study of every task that works at once and explains every key."""

import math
import re
import tomllib
from pathlib import Path

import pytest
from pydantic import BaseModel
from scipy import stats

from protocols.feasibility import check_feasible
from protocols.journal_file import read_journal
from protocols.load import load_display, load_protocol, shipped
from protocols.plugins import named
from protocols.study_file.new_study import TEMPLATES, study_files
from protocols.study_file.schema import StudyProtocol
from protocols.study_file.session_schema import Web
from protocols.tasks.task_kinds import TASKS

OF_PICTURES = [name for name, kind in TASKS.items() if kind.recipe == "files"]
RIGHT_OR_WRONG = [task for task in OF_PICTURES if TASKS[task].task.decides]
UNJUDGED = {"confidence", "criterion_share", "rounds_max", "right", "wrong"}
"""Keys of no use where no answer is right or wrong."""


@pytest.fixture
def made(metamerlab, tmp_path):
    """Return a function that makes a new study of a task."""

    def make(task: str) -> Path:
        folder = tmp_path / task
        metamerlab("new-study", folder, "--task", task)
        return folder / "study.toml"

    return make


def uncommented(text: str, first: str, last: str) -> str:
    """Return a study with the keys of a commented section, from one line to another, set."""
    before, found, rest = text.partition(first)
    assert found, first
    block, found, after = (found + rest).partition(last)
    assert found, last
    lines = [
        line.removeprefix("# ") if re.match(r"# (\[|\w+ = )", line) else line
        for line in (block + found).splitlines()
    ]
    return before + "\n".join(lines) + after


def test_there_is_a_new_study_of_every_task_that_ships():
    assert set(TEMPLATES) == set(TASKS)


@pytest.mark.parametrize("task", TASKS)
def test_it_is_in_order_at_once(metamerlab, made, task):
    path = made(task)
    done = metamerlab("protocol", "check", path)

    assert "in order" in done.stdout
    # It begins with two scenes; that this is few is said, and nothing else.
    notes = [line for line in done.stdout.splitlines() if line.startswith("note:")]
    assert [note for note in notes if "two scenes show hardly anything" not in note] == []
    assert load_protocol(path).task.kind == task
    assert load_protocol(path).format == 2


@pytest.mark.parametrize("task", [task for task in TASKS if TASKS[task].task.decides])
def test_its_catch_trials_pass_who_slips_now_and_then_and_fail_who_guesses(made, task):
    """Binomial: a slip in 50 trials passes in 97 % and more, also before feedback teaches."""
    study = load_protocol(made(task))
    trials = study.task.catch_trials
    enough = math.ceil(study.analysis.exclusions.catch_min_share * trials - 1e-9)
    passed = {share: stats.binom.sf(enough - 1, trials, share) for share in (0.98, 0.5)}

    assert passed[0.98] >= 0.97
    # A preference is an opinion, so that the rule is milder there.
    assert passed[0.5] <= (0.12 if task in RIGHT_OR_WRONG else 0.7)


@pytest.mark.parametrize("task", TASKS)
def test_it_is_feasible_on_every_shipped_display(made, task):
    folder = made(task).parent
    for name in shipped("displays"):
        display = load_display(name).model_copy(update={"name": "my-display"})
        text = study_files(task, "Title", display, task)["study.toml"]
        (folder / "study.toml").write_text(text, encoding="utf-8")
        assert check_feasible(load_protocol(folder / "study.toml"), display) == [], name


def models_of(study: StudyProtocol) -> dict[str, type[BaseModel]]:
    """Return the sections that a study of a task must have, with the class of each."""
    sections: dict[str, type[BaseModel]] = {
        name: type(getattr(study, name))
        for name in StudyProtocol.model_fields
        if name not in ("format", "web")
    }
    sections["web"] = Web  # is there in comments
    sections["design.practice"] = type(study.design.practice)
    if study.task.catch_trials:
        sections["task.catch"] = type(study.task.catch)
    sections["analysis.exclusions"] = type(study.analysis.exclusions)
    if hasattr(study.analysis, "primary"):
        sections["analysis.primary"] = type(study.analysis.primary)
    (texts,) = study.text.languages.values()
    sections["text.languages.en"] = type(texts)
    sections["text.languages.en.questions"] = type(texts.questions[0])
    return sections


@pytest.mark.parametrize("task", TASKS)
def test_every_key_is_there_and_explained(made, task):
    path = made(task)
    text = path.read_text(encoding="utf-8")
    study = load_protocol(path)
    heads = re.findall(r"^(?:# )?\[\[?([\w.]+)\]\]?$", text, flags=re.M)
    parts = re.split(r"^(?:# )?\[\[?[\w.]+\]\]?$", text, flags=re.M)[1:]
    sections: dict[str, str] = {}
    for head, part in zip(heads, parts, strict=True):
        sections[head] = sections.get(head, "") + part

    for name, model in models_of(study).items():
        lines = sections[name].splitlines()
        for key in model.model_fields:
            if f"{name}.{key}" in sections or (name, key) == ("text", "languages"):
                continue  # a section of its own
            if key in UNJUDGED and not study.task.decides:
                continue
            at = [i for i, line in enumerate(lines) if re.match(rf"(# )?{key} = ", line)]
            assert at, f"[{name}] {key} is missing"
            assert lines[at[0] - 1].startswith("# "), f"[{name}] {key} is not explained"


@pytest.mark.slow
@pytest.mark.parametrize("task", RIGHT_OR_WRONG)
@pytest.mark.parametrize(
    ("rule", "first", "last"),
    [
        ("quest-plus", "# [task.adaptive]\n", "# falling = false"),
        ("up-down", '# [task.adaptive]\n# rule = "up-down"', "# falling = false"),
    ],
)
def test_the_examples_of_adaptive_levels_are_valid_and_run(
    metamerlab, made, tmp_path, task, rule, first, last
):
    path = made(task)
    text = path.read_text(encoding="utf-8")
    text = uncommented(text, first, last).replace("repeats = 2", "repeats = 1")
    path.write_text(text, encoding="utf-8")

    assert load_protocol(path).task.adaptation.rule == rule
    metamerlab("session", "simulate", path, "--out", tmp_path / "s", "--participants", 1)
    attempts = read_journal(tmp_path / "s" / task / "S001" / "journal.jsonl").attempts
    decided = [a for a in attempts if a.role == "main" and a.outcome == "completed"]
    study = load_protocol(path)
    assert len(decided) == study.task.adaptation.trials_of(study.task, study.pool)
    assert all(attempt.track for attempt in decided)


@pytest.mark.slow
@pytest.mark.parametrize("task", ["two-interval", "two-alternative"])
def test_the_example_of_active_pairs_is_valid_and_runs(metamerlab, made, tmp_path, task):
    path = made(task)
    text = uncommented(path.read_text(encoding="utf-8"), "# [task.sampling]", "# trials = 60")
    text = text.replace('pairings = "all"\n', "").replace("repeats = 2", "repeats = 1")
    path.write_text(text, encoding="utf-8")

    metamerlab("session", "simulate", path, "--out", tmp_path / "s", "--participants", 1)
    attempts = read_journal(tmp_path / "s" / task / "S001" / "journal.jsonl").attempts
    decided = [a for a in attempts if a.role == "main" and a.outcome == "completed"]
    assert len(decided) == 60


OPTIONAL = {
    "source", "stimulus_s", "scenes", "timeout_s", "choices", "rt_max_s", "retention_months",
    "criterion_share", "right", "wrong", "compare", "fps", "duration_s", "size",
}  # fmt: skip
TOGETHER = {
    "stimulus_s": "clips",  # only for stills
    "compare": "standard",
    "fps": "videos",
    "duration_s": "videos",
}
"""Keys that need another one changed as well."""


@pytest.mark.parametrize("task", TASKS)
def test_examples_of_optional_keys_are_valid_themselves(made, task):
    path = made(task)
    text = path.read_text(encoding="utf-8")
    columns = load_protocol(path).stimuli.columns()
    before, _, rest = text.partition("# A 3D file of yours")  # other kinds of scenes: whole entries
    text = before + ("# Size of" + rest.partition("# Size of")[2] if rest else "")
    examples = re.findall(r"^# (\w+) = .+$", text, flags=re.M)
    tried = 0
    for key in dict.fromkeys(examples):
        needs_scene = key == "scenes" and "scene" not in columns
        if key not in OPTIONAL or key in TOGETHER or needs_scene:
            continue
        path.write_text(re.sub(rf"^# ({key} = .+)$", r"\1", text, count=1, flags=re.M))
        load_protocol(path)
        tried += 1
    assert tried >= 5


@pytest.mark.slow
@pytest.mark.parametrize("task", OF_PICTURES)
def test_its_pictures_are_built_simulated_and_listed(metamerlab, made, tmp_path, task):
    path = made(task)
    clips, sessions = tmp_path / "clips", tmp_path / "sessions"

    metamerlab("stimuli", "build", path, "--out", clips)
    metamerlab("stimuli", "check", clips)
    metamerlab("protocol", "check", path, "--stimuli", clips)
    metamerlab(
        "session", "simulate", path, "--stimuli", clips, "--out", sessions, "--participants", 1
    )
    attempts = read_journal(sessions / task / "S001" / "journal.jsonl").attempts
    main = [a for a in attempts if a.role == "main" and a.outcome == "completed"]
    right = [attempt.correct for attempt in main]
    if task == "rating":
        assert len(main) == 40
        assert len({attempt.answer for attempt in main}) >= 4
        return
    assert 0.5 < sum(right) / len(right) < 1  # levels from hard to plain


@pytest.mark.parametrize("task", TASKS)
def test_show_and_preregister_say_the_task_the_question_and_the_right_answer(
    metamerlab, made, task
):
    path = made(task)
    shown = metamerlab("protocol", "show", path, "--slot", 1)
    assert f"{task}: " in shown.stdout
    written = metamerlab("protocol", "preregister", path)
    study = load_protocol(path)
    assert f'"{study.text.languages["en"].question}"' in written.stdout
    assert study.task.right_answer() in written.stdout


def test_an_unknown_task_gets_the_nearest_name_and_leaves_nothing(metamerlab, tmp_path):
    done = metamerlab("new-study", tmp_path / "x", "--task", "yesno", status=2)

    said = " ".join(done.stderr.split())
    assert "--task: must be one of two-interval, two-alternative, yes-no" in said
    assert "did you mean 'yes-no'?" in said
    assert not (tmp_path / "x").exists()


@pytest.mark.parametrize("task", OF_PICTURES)
def test_the_readme_names_what_lies_there(made, task):
    path = made(task)
    text = (path.parent / "README.md").read_text(encoding="utf-8")
    here = {entry.name + ("/" if entry.is_dir() else "") for entry in path.parent.iterdir()}
    assert here - {"README.md"} <= set(re.findall(r"^\| `(.+?)` \|", text, flags=re.M))
    assert not re.search(r"@[A-Z_]+@", text + path.read_text(encoding="utf-8"))
    assert tomllib.loads(path.read_text(encoding="utf-8"))["stimuli"]["table"] == "stimuli.csv"


@pytest.mark.slow
def test_a_column_called_condition_is_compared_from_check_to_report(metamerlab, made):
    """Before, the report overwrote that column, and ended in a traceback."""
    path = made("yes-no")
    table = path.parent / "stimuli.csv"
    table.write_text(table.read_text().replace("noise", "condition", 1))
    path.write_text(path.read_text().replace('by = "noise"', 'by = "condition"'))
    folders = {name: path.parent / name for name in ("clips", "sessions", "report")}

    for words in (
        ("protocol", "check", path),
        ("stimuli", "build", path, "--out", folders["clips"]),
        ("session", "simulate", path, "--stimuli", folders["clips"],
         "--out", folders["sessions"], "--participants", 3),
        ("analysis", "report", folders["sessions"], "--protocol", path,
         "--out", folders["report"], "--no-figures"),
    ):  # fmt: skip
        metamerlab(*words)

    page = (folders["report"] / "report.html").read_text(encoding="utf-8")
    assert "coarse minus fine" in page
    assert "condition all" not in page


@pytest.mark.parametrize("task", TASKS)
def test_all_that_a_task_names_is_there(task):
    """Other packages import it when they are asked for it."""
    kind = TASKS[task]
    for place in (kind.analysis, kind.observer, *[kind.example] * (kind.recipe == "files")):
        assert callable(named(place))
