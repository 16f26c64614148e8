"""The advice of a message is tried on the input that caused it."""

import re
from pathlib import Path

import pytest
from pydantic import ValidationError

from protocols.errors import StudyError
from protocols.feasibility import check_feasible
from protocols.formats.format_reference import json_schema, schema_names
from protocols.load import load_display, load_protocol, protocol_of, read_toml
from protocols.recipes.warped_clips import Clips
from protocols.study_file.problems import cure_for_key_name, problems_of
from protocols.study_file.session_schema import KEY_PATTERN, Response
from protocols.units import IN_WORDS

STUDY = load_protocol(Path("inpainting-2afc"))
DISPLAY = load_display("fhd27-60hz")


def at(refresh_hz: float):
    return DISPLAY.model_copy(update={"refresh_hz": refresh_hz})


def changed(**task: float):
    return STUDY.model_copy(update={"task": STUDY.task.model_copy(update=task)})


@pytest.mark.parametrize("measured", [59.951, 59.94, 60.02, 119.88, 239.76, 143.86, 74.97])
def test_a_measured_rate_names_the_nominal_one_which_then_is_right(measured):
    first, *_ = check_feasible(STUDY, at(measured))
    named = float(re.search(r"write refresh_hz = (\d+)", first.message)[1])

    assert first.place == "refresh_hz"
    assert abs(named / measured - 1) < DISPLAY.refresh_tolerance_share
    # What is left is what a display of that rate has to say, and it says nothing of rates.
    assert [str(one) for one in check_feasible(STUDY, at(measured))[1:]] == [
        str(one) for one in check_feasible(STUDY, at(named))
    ]
    if named % 60 == 0:
        assert len(check_feasible(STUDY, at(measured))) == 1


@pytest.mark.parametrize("rate", [60.0, 61.0, 59.6, 144.0])
def test_a_rate_of_its_own_is_not_called_a_measured_one(rate):
    said = [str(one) for one in check_feasible(changed(gap_s=0.123), at(rate))]

    assert said
    assert not any("refresh_hz" in one for one in said)


@pytest.mark.parametrize("rate", [60.0, 90.0, 144.0, 165.0])
@pytest.mark.parametrize("gap_s", [0.123, 0.1547, 0.7013])
def test_the_nearest_times_are_whole_frames(rate, gap_s):
    def said(gap: float) -> list[str]:
        found = check_feasible(changed(gap_s=gap), at(rate))
        return [one.message for one in found if one.place == "task.gap_s"]

    nearest = re.findall(r"([\d.]+) s\b", said(gap_s)[0].split("nearest:")[1])

    assert len(nearest) == 2
    assert [said(float(near)) for near in nearest] == [[], []]


def with_clips(fps: float):
    clips = STUDY.stimuli.clips.model_copy(update={"fps": fps})
    return STUDY.model_copy(update={"stimuli": STUDY.stimuli.model_copy(update={"clips": clips})})


@pytest.mark.parametrize(("fps", "rate"), [(60.0, 144.0), (25.0, 165.0), (21.0, 144.0)])
def test_the_nearest_frame_rates_are_whole_refreshes(fps, rate):
    (said,) = (str(x) for x in check_feasible(with_clips(fps), at(rate)) if x.place.endswith("fps"))
    found = re.findall(r"([\d.]+) fps", said.split("nearest:")[1])

    assert found
    for near in found:
        again = check_feasible(with_clips(float(near)), at(rate))
        assert not any(one.place.endswith("fps") for one in again)


@pytest.mark.parametrize(("duration_s", "fps"), [(1.29, 24.0), (0.7, 13.0), (2.01, 30.0)])
def test_the_nearest_durations_of_clips_are_whole_frames(duration_s, fps):
    given = STUDY.stimuli.clips.model_dump() | {"fps": fps}
    with pytest.raises(ValueError, match="must be whole frames") as refused:
        Clips.model_validate(given | {"duration_s": duration_s})
    for near in re.findall(r"([\d.]+) s\b", str(refused.value).split("nearest durations are")[1]):
        Clips.model_validate(given | {"duration_s": float(near)})


@pytest.mark.parametrize(
    ("theirs", "ours"),
    [
        # PsychoPy, pyglet
        ("num_4", "kp_4"), ("return", "enter"), ("num_enter", "enter"), ("SPACE", "space"),
        # Psychtoolbox
        ("LeftArrow", "left"), ("RightArrow", "right"), ("ESCAPE", "escape"), ("1!", "1"),
        ("Return", "enter"), ("KP_7", "kp_7"),
        # jsPsych: KeyboardEvent.key and .code
        ("ArrowLeft", "left"), (" ", "space"), ("Enter", "enter"), ("F", "f"), ("Numpad4", "kp_4"),
        ("KeyJ", "j"), ("Digit3", "3"), ("NumpadEnter", "enter"), ("Backspace", "backspace"),
        # OpenSesame, pygame
        ("space bar", "space"), ("[4]", "kp_4"), ("keypad 6", "kp_6"), ("left arrow", "left"),
        # E-Prime, and slips
        ("{SPACE}", "space"), ("{LEFTARROW}", "left"), ("Esc", "escape"), ("rigth", "right"),
        ("kp4", "kp_4"), ("F5", "f5"), ("spacebar", "space"),
    ],
)  # fmt: skip
def test_a_key_as_another_program_names_it_leads_to_ours(theirs, ours):
    given = STUDY.response.model_dump()

    wrong = given | {"pause_keys": (theirs,)}
    with pytest.raises(ValidationError) as refused:
        Response.model_validate(wrong)
    (said,) = (str(one) for one in problems_of(refused.value, wrong, Response))
    named = re.search(r"did you mean '(\w+)'\?", said)[1]
    assert named == ours
    assert Response.model_validate(given | {"pause_keys": (named,)}).pause_keys == (ours,)


@pytest.mark.parametrize("theirs", ["lctrl", "Shift", "right shift", "ControlLeft", "alt"])
def test_a_key_that_changes_others_is_not_mistaken_for_one(theirs):
    said = cure_for_key_name(theirs)

    assert "did you mean" not in said
    for named in re.findall(r"'(\w+)'", said):
        assert re.match(KEY_PATTERN, named)


@pytest.mark.parametrize("theirs", ["pointer", "mouse", "Click", "left_click", "touch", "Mouse1"])
def test_a_click_is_no_key_and_its_cure_is_the_pointer(theirs):
    given = STUDY.response.model_dump()
    wrong = given | {"keys": ((theirs,), ("right",))}
    with pytest.raises(ValidationError) as refused:
        Response.model_validate(wrong)
    (said,) = (str(one) for one in problems_of(refused.value, wrong, Response))
    assert "did you mean" not in said
    assert said.endswith("; a click or a touch is no key: pointer = true in [response] takes them")
    assert Response.model_validate(given | {"pointer": True}).pointer


def patterns_in(schema: object):
    """Yield the patterns that a JSON Schema states, those of the keys of tables too."""
    if isinstance(schema, dict):
        yield from schema.get("patternProperties", {})
        own = schema.get("pattern")
        yield from [own] if isinstance(own, str) else []
    for one in schema.values() if isinstance(schema, dict) else schema:
        if isinstance(one, dict | list):
            yield from patterns_in(one)


@pytest.mark.parametrize("name", schema_names())
def test_no_message_shows_a_pattern_of_a_published_format_bare(name):
    assert {*patterns_in(json_schema(name))} <= {*IN_WORDS}


@pytest.mark.parametrize(
    ("section", "key", "wrong", "place", "cured"),
    [
        ("text", "default_language", "English", "text.default_language", "en"),
        ("privacy", "secret_sha256", "my secret", "privacy.secret_sha256", "0" * 64),
        ("web", "identifier", "1 code", "web.identifier", "PANEL_ID"),
        (
            "web",
            "completion_url",
            "example.org",
            "web.completion_url",
            "https://example.org/thanks",
        ),
    ],
)
def test_a_text_of_the_wrong_form_is_told_its_form_and_an_example_that_works(
    section, key, wrong, place, cured
):
    def with_text(text: str):
        raw = read_toml(Path("protocols/studies/demo.toml"))
        (raw.setdefault(section, {"gaze": "none"} if section == "web" else {}))[key] = text
        return protocol_of(raw, Path("study.toml"))

    with pytest.raises(StudyError, match=re.escape(f"{place}: must be a")) as told:
        with_text(wrong)
    assert f"(got {wrong!r})" in str(told.value)
    assert "[" not in str(told.value)
    assert "like" not in str(told.value) or f"'{cured}'" in str(told.value)
    with_text(cured)
