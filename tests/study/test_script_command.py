"""`protocol show --script`: a participant's plan, and the scripts of its trials."""

import json
import re
from pathlib import Path

import jsonschema
import numpy as np
import pytest
from attack.kills import CASES, write_study
from command_line import metamerlab
from PIL import Image

from protocols.formats.format_reference import schema_path
from protocols.load import load_study, shipped
from protocols.make_script import Scripts, example_scripts
from protocols.phases import rgba_sha256
from protocols.plan import Plan
from protocols.script import TrialScript
from study_app.preview import preview_page
from study_app.simulate import SimulatedStudy


def script(*words):
    done = metamerlab(
        "protocol",
        "show",
        "--script",
        *map(str, words),
        catch_exceptions=False,
        env={"COLUMNS": "200"},
        status=None,
    )
    return done.exit_code, done.stdout, " ".join(done.stderr.split())


@pytest.mark.parametrize("name", ["demo", "beyond-blur-detection", "critical-scaling-halves"])
def test_the_json_is_what_the_published_schemas_say_and_what_a_session_compiles(name):
    code, out, _ = script(name, "--code", "P01", "--slot", 2, "--json")
    assert code == 0
    whole = json.loads(out)
    for kind, found in (("plan", whole["plan"]), ("script", whole["scripts"][-1])):
        jsonschema.validate(found, json.loads(schema_path(kind).read_text(encoding="utf-8")))
    study, display = load_study(shipped("studies")[name])
    plan = Plan.model_validate_json(json.dumps(whole["plan"]))
    assert (plan.slot, plan.participant) == (2, "P01")
    assert [one["trial"] for one in whole["scripts"]] == [trial.id for trial in plan.trials]
    manifest = SimulatedStudy(study, display).shown
    for trial, found in list(zip(plan.trials, whole["scripts"], strict=True))[::40]:
        made = Scripts(study, display, study.text.default_language, manifest).of(trial)
        assert TrialScript.model_validate_json(json.dumps(found)) == made


def test_a_script_names_places_from_the_middle_whatever_the_screen():
    """The same pitch and distance on a larger screen: all but words stays where it was."""
    study, display = load_study(Path("demo"))
    wide = display.model_copy(
        update={
            "width_px": display.width_px + 400,
            "width_mm": display.width_mm * (display.width_px + 400) / display.width_px,
        }
    )
    for small, large in zip(
        example_scripts(study, display), example_scripts(study, wide), strict=True
    ):
        for one, other in zip(small.phases, large.phases, strict=True):
            if one.question is None:
                assert [entry.at for entry in one.show] == [entry.at for entry in other.show]


def test_pictures_are_written_by_the_hash_of_their_pixels(tmp_path):
    code, out, _ = script(
        "demo", "--code", "P01", "--json", "--trial", "main-0000", "--pictures", tmp_path / "pics"
    )
    assert code == 0
    (made,) = json.loads(out)["scripts"]
    named = set(re.findall(r'"sha256": "(\w{64})"', json.dumps(made["phases"])))
    written = {path.stem: path for path in (tmp_path / "pics").iterdir()}
    assert set(written) == named
    assert len(named) == 4  # the target, the question, two notices
    for name, path in written.items():
        pixels = np.asarray(Image.open(path))
        assert pixels.shape[2] == 4
        assert rgba_sha256(pixels.shape[1], pixels.shape[0], pixels.tobytes()) == name
    assert '"words"' not in out


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("--code", "P01", "--trial", "main-99999"), "--trial: must be one of the plan"),
        (("--code", "_P"), "a code must be letters, digits"),
        (("--code", "P01", "--language", "fr"), "--language: must be one of en, de, ja (got 'fr')"),
        (("--code", "P01", "--language", ""), "--language: must be one of en, de, ja (got '')"),
        (("--code", "P01", "--slot", str(2**53 + 1)), "Invalid value for '--slot'"),
        (("--code", "P01", "--display", "fhd24-144hz"), "must be feasible on display"),
    ],
)
def test_what_cannot_be_printed_is_one_message(words, said):
    code, out, err = script("demo", *words)
    assert (code, out) == (2, "")
    assert said in err


def test_an_adaptive_trial_has_a_script_once_it_is_chosen(tmp_path):
    write_study(tmp_path, CASES["yes-no by QUEST+"])
    words = (tmp_path / "study.toml", "--display", "fhd27-60hz", "--code", "P01")
    code, out, err = script(*words, "--json")
    assert code == 0, err
    whole = json.loads(out)
    open_ = [trial["id"] for trial in whole["plan"]["trials"] if not trial["stimuli"]]
    assert len(open_) + len(whole["scripts"]) == len(whole["plan"]["trials"])
    code, out, err = script(*words, "--trial", open_[0])
    assert (code, out) == (2, "")
    assert f"{open_[0]} is adaptive: what it shows follows from the answers" in err


def test_the_preview_has_the_answer_screen_of_both_orders_of_keys():
    study, display = load_study(Path("demo"))  # keys turn after every second slot
    page = preview_page(study, display, most=1).html
    assert {"answer-first-second", "answer-second-first"} <= set(
        re.findall(r'data-page="([\w-]+)"', page)
    )


def test_what_it_prints_is_for_people_unless_json_is_asked_for():
    code, out, _ = script("demo", "--code", "P01")
    assert code == 0
    assert "{" not in out
    assert out.count("main-0003") == 1  # in the plan; the script is that of all trials
    (title,) = [line for line in out.splitlines() if " and 24 more" in line]
    assert title.startswith("practice-0000, practice-0001, main-0001, main-0000 and 24 more: ")
    cells = [[cell.strip() for cell in line.split("│")[1:-1]] for line in out.splitlines()]
    (at,) = [place for place, row in enumerate(cells) if row[:1] == ["fixate"]]
    assert cells[at : at + 8] == [
        ["fixate", "30", "dot, 26 x 26 at -13 -13", "held, waits 600", ""],
        ["first", "60", "stimulus 1, each frame for 2, 314 x 236 at -157 -118", "watched", ""],
        ["gap", "30", "dot, 26 x 26 at -13 -13", "watched", ""],
        ["second", "60", "stimulus 2, each frame for 2, 314 x 236 at -157 -118", "watched", ""],
        ["respond", "until answered", '"Which video do you prefer?" over first, second', "",
         "answer:"],
        ["", "", "", "", "first: left, f"],
        ["", "", "", "", "second: right, j"],
        ["", "", "", "", "void after 1200"],
    ]  # fmt: skip
    assert cells[at + 8][2].startswith('gaze-break, no-fixation, data-loss, warned: "Please keep')


def test_a_trial_is_printed_with_the_names_of_its_stimuli():
    code, out, _ = script("critical-scaling-halves", "--code", "P01", "--trial", "main-0003")
    assert code == 0
    assert re.search(
        r"first +│ 12 +│ castle__[\w-]+, its left half, 960 x 1080 at -960 -540 +│ watched", out
    )
    assert "grey 128, 78 x 1080 at -39 -540" in out


def test_confidence_is_in_the_script_and_adaptive_trials_are_said_to_have_none(tmp_path):
    write_study(tmp_path, CASES["yes-no by QUEST+ with confidence"])
    code, out, _ = script(tmp_path / "study.toml", "--display", "fhd27-60hz", "--code", "P01")
    assert code == 0
    assert '"How sure are you?" over guessed, unsure, rather sure, sure' in out
    assert "trials are adaptive, and have a script in the session only" in out


@pytest.mark.parametrize("option", [["--json"], ["--code", "P01"]])
def test_options_of_scripts_need_script(option):
    done = metamerlab("protocol", "show", "demo", *option, status=None)
    assert (done.exit_code, done.stderr.endswith("are for --script; add it\n")) == (2, True)
