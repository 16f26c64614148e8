"""Mistakes in studies of any task: one message each, with place and cure, and never a traceback."""

import re
from functools import cache
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from protocols.errors import StudyError
from protocols.feasibility import check_feasible, virtual_manifest
from protocols.load import load_display, load_protocol
from protocols.plan import make_plan
from protocols.study_file.new_study import TEMPLATES, study_files
from protocols.study_file.preregister import preregistration
from protocols.tasks.task_kinds import TASKS
from stimuli.recipes.example_pictures import example_files

DISPLAY = load_display("fhd27-60hz").model_copy(update={"name": "my-display"})
ADAPTIVE = """
[task.adaptive]
rule = "up-down"
trials = 10
column = "contrast"
by = ["noise"]
start = 0.2
harder = [0.04]
easier = [0.12]
"""


@cache
def text_of(task: str) -> str:
    """Return the study file of a new study."""
    return study_files("pilot", "Pilot", DISPLAY, task)["study.toml"]


@cache
def table_of(task: str) -> str:
    """Return the table of its stimuli, or nothing."""
    return example_files(task).get("stimuli.csv", b"").decode()


def with_adaptive(*replacements: tuple[str, str]) -> tuple[str, str]:
    """Return the change that gives `yes-no` adaptive levels with these replacements."""
    text = ADAPTIVE
    for old, new in replacements:
        assert old in text, old
        text = text.replace(old, new)
    return "# Trials whose answer is plain", text + "\n# Trials whose answer is plain"


@pytest.fixture
def mistakes(tmp_path):
    """Load a new study of a task with replacements; return the lines of the message."""

    def load(task: str, *changes: tuple[str, str], table: str | None = None) -> list[str]:
        text = text_of(task)
        for old, new in changes:
            assert old in text, old
            text = text.replace(old, new, 1)
        path = tmp_path / "pilot.toml"
        path.write_text(text, encoding="utf-8")
        (tmp_path / "stimuli.csv").write_text(table_of(task) if table is None else table)
        with pytest.raises(StudyError) as caught:
            load_protocol(path)
        return [line.removeprefix(f"{path}: ") for line in str(caught.value).splitlines()]

    return load


@pytest.mark.parametrize(
    ("task", "old", "new", "message"),
    [
        ("yes-no", 'kind = "yes-no"', 'kind = "yesno"',
         f"task.kind: must be one of {', '.join(TASKS)} (got 'yesno'); did you mean 'yes-no'?"),
        ("yes-no", 'kind = "yes-no"', "kind = {}",
         f"task.kind: must be one of {', '.join(TASKS)} (got '{{}}')"),
        ("yes-no", 'kind = "files"', 'kind = "file"',
         "stimuli.kind: must be one of warped-clips, files, foveated-images (got 'file'); did you"
         " mean 'files'?"),
        ("yes-no", 'kind = "detection"', 'kind = "detectoin"',
         "analysis.kind: must be one of preference, detection, identification, abx,"
         " which-half, ratings (got 'detectoin'); did you mean 'detection'?"),
        ("yes-no", 'kind = "detection"', 'kind = "abx"',
         "analysis.kind: must be 'detection' for the task 'yes-no' (got 'abx')"),
        ("yes-no", "stimulus_s = 0.5", "stimulus_s = 0.5\ngap_s = 0.5",
         "task.gap_s: unknown key; known keys: kind, stimulus_s, confidence, adaptive, catch,"
         " signal"),
        ("two-interval", "gap_s = 0.5", "separation_deg = 7.0",
         "task.separation_deg: unknown key; known keys: kind, stimulus_s, confidence, compare,"
         " pairings, catch, sampling, gap_s"),
        ("identification", 'named_by = "gap"', 'named_by = "gaps"',
         "task.named_by: must name a column of the stimuli (stroke, gap, contrast) (got 'gaps');"
         " did you mean 'gap'?"),
        ("identification", '"left", "up", "down", "right"]', '"left", "up", "down", "down"]',
         "task.alternatives: every answer must be given once (got left, up, down, down)"),
        ("identification", 'keys = [["left"], ["up"], ["down"], ["right"]]',
         'keys = [["left"], ["up"], ["up"], ["right"]]',
         "response.keys[2]: a key must do one thing (got 'up' in keys[1] and keys[2])"),
        ("identification", 'keys = [["left"], ["up"], ["down"], ["right"]]',
         'keys = [["left"], ["right"]]',
         "response.keys: must have an entry for each answer of the task (left, up, down, right)"
         " (got 2)"),
        ("identification", 'side = "fixed"', 'side = "by-trial"',
         "design.side: must be 'fixed' for the task 'identification', whose answers are more than"
         " two (got 'by-trial')"),
        ("yes-no", "where = { contrast = 0.2 }", "where = { contrast = 0.3 }",
         "task.catch.where.contrast: must be a value that the stimuli have (0.04, 0.08, 0.12, 0.16,"
         " 0.2) (got 0.3)"),
        ("yes-no", 'signal = { pattern = ["grating"] }', 'signal = { pattern = ["gratin"] }',
         "task.signal.pattern[0]: must be a value that the stimuli have (grating, none) (got"
         " 'gratin'); did you mean 'grating'?"),
        ("yes-no", 'signal = { pattern = ["grating"] }',
         'signal = { pattern = ["grating", "none"] }',
         "task.signal: must hold for some stimuli and not for others (every right answer is"
         " 'yes')"),
        ("abx", "standard = { blur_px = 0.0 }", "standard = { blur_px = 0.25 }",
         "task.standard.blur_px: must be a value that the stimuli have (0.0, 0.5, 1.0, 1.5, 2.0)"
         " (got 0.25)"),
        ("abx", "standard = { blur_px = 0.0 }\n", "", "task: must have standard, compare or both"),
        ("yes-no", 'by = "noise"', 'by = "nose"',
         "analysis.by: must name a column of the stimuli (scene, noise, pattern, contrast) (got"
         " 'nose'); did you mean 'noise'?"),
        ("yes-no", 'level = "contrast"', 'level = "pattern"',
         "analysis.level: must be a column of numbers (got 'grating' in pattern)"),
        ("yes-no", *with_adaptive(("start = 0.2", "start = 0.3")),
         "task.adaptive.start: must be one of the levels, which go from 0.04 to 0.2 (got 0.3)"),
        ("yes-no", *with_adaptive(('"contrast"', '"noise"')),
         "task.adaptive.column: must be a column of two numbers or more (got fine, coarse)"),
        ("yes-no", *with_adaptive(('"contrast"', '"contrst"')),
         "task.adaptive.column: must name a column of the stimuli (scene, noise, pattern, contrast)"
         " (got 'contrst'); did you mean 'contrast'?"),
        ("yes-no", *with_adaptive(("harder = [0.04]", "harder = [0.4]")),
         "task.adaptive.harder[0]: a step must be greater than 0 and no longer than the range of"
         " the levels, 0.16 (got 0.4); take smaller steps, or add levels"),
        ("yes-no", *with_adaptive(('"up-down"', '"up-and-down"')),
         "task.adaptive.rule: must be one of quest-plus, up-down (got 'up-and-down'); did you mean"
         " 'up-down'?"),
        ("yes-no",
         *with_adaptive(('"up-down"', '"quest-plus"'), ("start = 0.2", "threshold = [0.1, 0.5]"),
                        ("harder = [0.04]", "width = [0.1]"), ("easier = [0.12]\n", "")),
         "task.adaptive.threshold: must lie within the levels, from 0.04 to 0.2 (got 0.5); no level"
         " could tell such thresholds apart: add levels, or leave these values out"),
        ("yes-no",
         *with_adaptive(('"up-down"', '"quest-plus"'), ("start = 0.2", "threshold = [0.2, 0.1]"),
                        ("harder = [0.04]", "width = [0.1]"), ("easier = [0.12]\n", "")),
         "task.adaptive.threshold[1]: must be above the one before it, 0.2 (got 0.1);"
         " list each once, from the lowest to the highest"),
        ("yes-no", *with_adaptive(),
         "design.repeats: must be 1 where a rule chooses what is shown and has trials = 10 of its"
         " own (got 2)"),
        ("two-interval", "repeats = 2", "repeats = 0",
         "design.repeats: must be at least 1 (got 0)"),
    ],
)  # fmt: skip
def test_each_mistake_is_told_with_its_place_and_its_cure(mistakes, task, old, new, message):
    assert message in mistakes(task, (old, new))


def test_two_mistakes_at_one_place_are_told_once_each(mistakes):
    lines = mistakes(
        "identification", ('"left", "up", "down", "right"]', '"left", "up", "down", "down"]')
    )
    told = [line for line in lines if line.startswith("task.alternatives: ")]
    assert len(told) == len(set(told)) == 2
    assert all(line.count("(got left, up, down, down") == 1 for line in told)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda t: t.replace("stimulus,file", "stimulus,path", 1),
         "stimuli.csv: line 1: must have a column 'file' (got stimulus, path, scene, noise,"
         " pattern, contrast)"),
        (lambda t: t.replace("stimulus,file", "stimuls,file", 1), "did you mean 'stimuls'?"),
        (lambda t: t.replace(",", ";"),
         "stimuli.csv: line 1: columns must be separated by commas (got ';' between them); save"
         " the table as CSV with commas, and decimals with a point"),
        (lambda t: t.splitlines()[0] + "\n", "must list at least one stimulus"),
        (lambda _: "", "line 1: must have a column 'stimulus' (got none)"),
        (lambda t: t.replace(",0.04\n", ",\n", 1), "line 2: column 'contrast' must not be empty"),
        (lambda t: t.replace(",0.04\n", ",0.04,5\n", 1), "line 2: must have 6 values (got more)"),
        (lambda t: t.replace("one-fine-grating-04,", "One Fine,", 1),
         "line 2: stimulus must be lower-case words and numbers joined by single dashes"),
        (lambda t: t.replace("one-fine-grating-04,", "nul,", 1),
         "line 2: stimulus must not be a name that Windows keeps for a device (got 'nul')"),
        (lambda t: t.replace("one-fine-grating-08,", "one-fine-grating-04,", 1),
         "line 3: every stimulus must be given once (got 'one-fine-grating-04', which line 2 has)"),
        (lambda t: t.replace("noise", "scene", 1), "every column must come once (got 'scene' 2x)"),
        (lambda t: t.replace("contrast", "correct", 1),
         "a column of the stimuli must not be called 'correct', as one of the tables"),
        (lambda t: t.replace("0.04", "low"), "analysis.level: must be a column of numbers"),
        (lambda t: t.replace("0.04", "nan"), "analysis.level: must be a column of numbers"),
        (lambda t: t.replace("noise", "Noise Level", 1), "Noise Level"),
    ],
)  # fmt: skip
def test_mistakes_in_the_table_name_its_line_or_column(mistakes, change, message):
    lines = mistakes("yes-no", table=change(table_of("yes-no")))
    assert any(message in line for line in lines), lines


def test_a_table_that_is_not_there_is_named(tmp_path):
    path = tmp_path / "pilot.toml"
    path.write_text(text_of("abx"), encoding="utf-8")
    with pytest.raises(StudyError, match=r"stimuli\.csv: the table of stimuli must exist"):
        load_protocol(path)


def test_columns_that_tables_have_are_those_that_no_stimulus_may_have(tmp_path):
    from analysis.data_dictionary import tables_of
    from protocols.columns import COMMON_COLUMNS

    for task in TEMPLATES:
        (tmp_path / "stimuli.csv").write_text(table_of(task))
        path = tmp_path / "pilot.toml"
        path.write_text(text_of(task), encoding="utf-8")
        study = load_protocol(path)
        own = {c.name for c in study.task.condition_columns(study.pool)}
        own |= {c.name for c in study.task.answer_columns()}
        tables = tables_of(study)
        names = [c.name for table in ("attempts", "decisions") for c in tables[table]]
        assert set(names) - own <= set(COMMON_COLUMNS)
        for table in ("attempts", "decisions"):
            columns = [c.name for c in tables[table]]
            assert len(set(columns)) == len(columns), task


# --- fuzzed --------------------------------------------------------------------------------------

LINE = re.compile(r"^(\w+) = (.+)$")
VALUES = st.one_of(
    st.sampled_from([
        "true", "0", "-1", "1.5", '""', '"x"', "[]", "{}", "[[]]", '["a"]', '{ contrast = 0.2 }',
        "1e308", "inf", "nan", "9223372036854775807", '"yes-no"', '"abx"', '"files"', '"all"',
        "0.2", "1", "2", '"fixed"', '[["left"], ["right"]]', "1979-05-27", '"contrast"',
    ]),
    st.integers(-(2**63), 2**63 - 1).map(str),
    st.floats(allow_nan=False, allow_infinity=False).map(lambda x: repr(float(x))),
)  # fmt: skip


@st.composite
def damaged(draw: st.DrawFn) -> tuple[str, str]:
    """Return a task, and its study with a few lines changed, doubled, moved or gone."""
    task = draw(st.sampled_from(TEMPLATES))
    lines = [line for line in text_of(task).splitlines() if line and not line.startswith("#")]
    if draw(st.booleans()) and task == "yes-no":
        at = lines.index("[task.catch]")
        lines[at:at] = [line for line in ADAPTIVE.splitlines() if line]
    for _ in range(draw(st.integers(1, 4))):
        at = draw(st.integers(0, len(lines) - 1))
        what = draw(st.sampled_from(["value", "gone", "key", "borrowed"]))
        match = LINE.match(lines[at])
        if what == "gone":
            del lines[at]
        elif match and what == "value":
            lines[at] = f"{match[1]} = {draw(VALUES)}"
        elif match and what == "key":
            lines[at] = f"{match[1]}_{draw(st.sampled_from('xyz'))} = {match[2]}"
        elif what == "borrowed":  # a line of another task
            other = text_of(draw(st.sampled_from(TEMPLATES))).splitlines()
            candidates = [line for line in other if LINE.match(line)]
            lines.insert(at + 1, draw(st.sampled_from(candidates)))
    return task, "\n".join(lines) + "\n"


@pytest.mark.slow
@settings(
    max_examples=150, suppress_health_check=[HealthCheck.function_scoped_fixture], deadline=None
)
@given(case=damaged())
def test_fuzzed_studies_give_messages_or_work(tmp_path, case):
    task, text = case
    folder = tmp_path / task
    folder.mkdir(exist_ok=True)
    path = folder / "pilot.toml"
    path.write_text(text, encoding="utf-8")
    if table_of(task):
        (folder / "stimuli.csv").write_text(table_of(task))
    try:
        study = load_protocol(path)
        if check_feasible(study, DISPLAY):
            return
        if study.design.repeats * study.task.stimuli_per_trial > 50:
            return  # a plan as long as that is valid, and takes its time
        make_plan(study, virtual_manifest(study, DISPLAY), "P1", 0)
        preregistration(study, DISPLAY, "x", None)
    except StudyError as error:
        said = str(error)
    else:
        return
    assert said.strip()
    assert all(len(line) < 2000 for line in said.splitlines()), said


@settings(
    max_examples=100, suppress_health_check=[HealthCheck.function_scoped_fixture], deadline=None
)
@given(
    rows=st.lists(st.lists(st.text(max_size=8), max_size=8), max_size=5), cut=st.integers(0, 2000)
)
def test_fuzzed_tables_give_messages_or_work(tmp_path, rows, cut):
    path = tmp_path / "pilot.toml"
    path.write_text(text_of("yes-no"), encoding="utf-8")
    text = table_of("yes-no")[:cut] + "\n".join(",".join(row) for row in rows)
    (tmp_path / "stimuli.csv").write_text(text, encoding="utf-8", errors="replace")
    try:
        load_protocol(Path(path))
    except StudyError as error:
        said = str(error)
    else:
        return
    assert str(tmp_path) in said
