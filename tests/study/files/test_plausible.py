"""Numbers that are allowed and hardly meant: `protocol check` notes them."""

from collections.abc import Iterator
from pathlib import Path

import pytest
from command_line import metamerlab, outcome_of
from pydantic import ValidationError

from protocols.display import Display
from protocols.errors import StudyError
from protocols.load import load_display, protocol_of, read_toml, shipped
from protocols.plausible_numbers import hardly_meant
from protocols.study_file.plausible import display_notes, study_notes

check = outcome_of("protocol", "check")


def writer(shipped_file: Path, path: Path):
    """Return a function that writes a shipped file with some of its lines changed."""

    def write(*changes: tuple[str, str]):
        text = shipped_file.read_text(encoding="utf-8")
        for old, new in changes:
            assert old in text, old
            text = text.replace(old, new)
        path.write_text(text, encoding="utf-8")
        return path

    return write


@pytest.fixture
def study(tmp_path):
    return writer(shipped("studies")["demo"], tmp_path / "study.toml")


@pytest.fixture
def display(tmp_path):
    return writer(shipped("displays")["fhd27-60hz"], tmp_path / "mine.toml")


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("gap_s = 0.5", "gap_s = 500.0",
         "task.gap_s: 500 s are 8.33 minutes; seconds are meant: should it be 0.5?"),
        ("fixation_s = 0.5\nfixation_timeout_s = 10.0",
         "fixation_s = 500.0\nfixation_timeout_s = 10000.0", "trial.fixation_s: 500 s are"),
        ("break_s = 10.0", "break_s = 10000.0", "design.break_s: 10000 s are 167 minutes"),
        ("repeats = 2", "repeats = 300", "trials), answers in 1.5 s; people tire"),
        ("duration_s = 1.0", "duration_s = 0.2", "what moves is shown for 0.2 s, hardly long"),
        ("repeats = 2", "repeats = 1", "each participant makes 12 decisions, which say little"),
        ('pairings = "all"', 'pairings = [["metameric", "push-pull"]]',
         "no planned comparison has the method 'reference', and no trial shows it"),
        ("width_deg = 8.0\nheight_deg = 6.0", "width_deg = 0.05\nheight_deg = 0.05",
         "stimuli are 2 x 2 px on this display, which shows little"),
        ('kind = "builtin"\nbuiltin = "garden"',
         'kind = "stereo"\nleft = "l.png"\nright = "r.png"\ndisparity = "d.png"\nfocal_px = 900.0\n'
         "baseline_m = 193.0\nreference = true",
         "baseline_m: the cameras are 193 m apart; metres are meant: should it be 0.193?"),
    ],
)  # fmt: skip
def test_a_study_with_a_number_that_is_hardly_meant_is_in_order_with_a_note(study, old, new, said):
    code, told, error = check(study((old, new)), status=None)
    assert (code, error) == (0, "")
    assert "in order" in told
    assert f"note: {said.split(':')[0]}" in told or said in told
    assert said in told


@pytest.mark.slow
def test_shipped_studies_and_displays_get_no_such_note():
    for name in shipped("studies"):
        _, told, _ = check(name)
        for word in ("should it be", "should they be", "people tire", "at rest"):
            assert word not in told, name
    assert not any(display_notes(load_display(name)) for name in shipped("displays"))


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ([("distance_mm = 700.0", "distance_mm = 70.0")],
         "the eye is 70 mm from the screen; millimetres are meant: should it be 700?"),
        ([("distance_mm = 700.0", "distance_mm = 7000.0")], "should it be 700?"),
        ([("width_mm = 597.7", "width_mm = 59.77"), ("height_mm = 336.2", "height_mm = 33.62")],
         "a pixel is 0.0311 mm wide (59.77 mm for 1920 px); millimetres are meant: should it be"),
    ],
)  # fmt: skip
def test_a_display_in_other_units_is_noted_with_a_study_and_alone(study, display, changes, said):
    told = check(study(), "--display", display(*changes), status=None)
    assert said in told[1] + told[2]
    _, told_alone, _ = check(display(*changes))
    assert said in told_alone


def test_a_picture_wider_than_an_eye_sees_is_noted(study, display):
    near = display(("distance_mm = 700.0", "distance_mm = 100.0"))
    wide = study(("width_deg = 8.0\nheight_deg = 6.0", "width_px = 1800\nheight_px = 900"))
    assert "more than an eye sees at rest" in check(wide, "--display", near, status=None)[1]


def test_check_of_a_display_file_checks_the_display(display):
    _, told, _ = check(display())
    assert told.startswith("fhd27-60hz: in order, a display of 1920 x 1080 px at 60 Hz")
    _, _, error = check(display(("refresh_hz = 60.0", "refresh_hz = -60.0")), status=2)
    assert error.count("\n") == 1
    assert "refresh_hz: must be at least 0.001 hertz" in error


def test_a_display_in_place_of_a_study_is_one_mistake(display):
    result = metamerlab("protocol", "show", str(display()), status=2)
    assert "must be a study (this is a display)" in result.stderr
    assert result.stderr.count("\n") <= 2


def test_a_true_view_away_from_the_dot_is_noted(study):
    clips = "[stimuli.clips]\n"
    there = check(
        study((clips, clips + "true_view = { within_deg = 3, x_deg = 2 }\n")), status=None
    )
    same = check(study((clips, clips + "true_view = { within_deg = 3 }\n")), status=None)

    assert "the true view is around (2, 0) deg, and the dot at (0, 0) deg" in " ".join(
        there[1].split()
    )
    assert "true view" not in same[1]
    assert there[0] == same[0] == 0


UNBOUND = ("seed", "texture_seed")
"""Any whole number will do."""


def numbers(value: object, place: tuple = ()) -> Iterator[tuple]:
    """Yield the place of every number of a parsed file that a key of ours holds."""
    if isinstance(value, dict):
        for key, entry in value.items():
            if key not in (*UNBOUND, "columns", "where", "signal"):
                yield from numbers(entry, (*place, key))
    elif isinstance(value, tuple):
        for index, entry in enumerate(value):
            yield from numbers(entry, (*place, index))
    elif isinstance(value, int | float) and not isinstance(value, bool):
        yield place, value


def changed(value: object, place: tuple, number: float) -> object:
    if not place:
        return number
    key, *rest = place
    if isinstance(value, dict):
        return value | {key: changed(value[key], tuple(rest), number)}
    return tuple(
        changed(one, tuple(rest), number) if index == key else one
        for index, one in enumerate(value)
    )


@pytest.mark.slow
@pytest.mark.parametrize(
    ("kind", "read"),
    [
        ("studies", lambda raw: protocol_of(raw, shipped("studies")["demo"])),
        ("displays", Display.model_validate),
    ],
)
def test_no_number_of_a_shipped_file_may_be_beyond_all_measure(kind, read):
    seen = set()
    for path in shipped(kind).values():
        raw = read_toml(path)
        for place, found in numbers(raw):
            name = tuple(key for key in place if isinstance(key, str))
            if name in seen:
                continue
            seen.add(name)
            for huge in (10**12, -(10**12)) if isinstance(found, int) else (1e12, -1e12, 1e300):
                with pytest.raises((StudyError, ValidationError)):
                    read(changed(raw, place, huge))
    assert len(seen) > 5


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("participants = 4", "participants = 1_000_000_000_000",
         "study.participants: must be at most 100,000 (got 1000000000000)"),
        ("turns = 1.0", "turns = 1e300", "camera.turns: must be at most 1,000"),
        ("turns = 1.0", "turns = 1e-9", "camera.turns: must be at least 0.001"),
        ("max_attempts = 3", "max_attempts = 1_000_000_000",
         "design.max_attempts: must be at most 1,000 (got 1000000000)"),
        ("width_deg = 8.0", "width_deg = 1e-9", "width_deg: must be at least 0.001 degrees"),
        ("hole_share = 0.02", "hole_share = 1e-12", "hole_share: must be at least 0.0001"),
        ("duration_s = 1.0", "duration_s = 1e7", "duration_s: must be at most 1,000,000 seconds"),
        ("fps = 30.0", "fps = 1e9", "fps: must be at most 1,000,000"),
    ],
)  # fmt: skip
def test_a_number_that_no_machine_can_do_is_refused(study, old, new, said):
    _, _, error = check(study((old, new)), status=2)
    assert said in " ".join(error.split())


@pytest.mark.parametrize(
    ("quantity", "value", "meant"),
    [
        ("distance_mm", 0.6, "should it be 600?"), ("distance_mm", 60, "should it be 600?"),
        ("refresh_hz", 0.06, "should it be 60?"), ("refresh_hz", 60_000, "should it be 60?"),
        ("view_deg", 1.05, "should it be 60.16?"), ("window_deg", 0.026, "should it be 1.49?"),
        ("window_deg", 90, "should it be 1.5?"), ("baseline_m", 193, "should it be 0.193?"),
        ("baseline_m", 0.06, None), ("window_deg", 1, None), ("view_deg", 40, None),
        ("refresh_hz", 59.94, None), ("view_deg", 179, "degrees are meant"),
    ],
)  # fmt: skip
def test_a_number_in_another_unit_is_asked_about_with_what_is_meant(quantity, value, meant):
    asked = hardly_meant(quantity, value)
    assert asked.endswith(meant) if meant else not asked


def test_angles_of_a_study_in_radians_are_noted(study):
    mesh = 'kind = "mesh"\nfile = "a.glb"\nview = {{ position_m = [0, 0, 1], look_at_m = [0, 0, 0],'
    mesh += " vertical_fov_deg = {} }}"
    for window, view, noted in ((0.026, 1.05, True), (1.5, 60, False)):
        path = study(
            ("window_deg = 1.5", f"window_deg = {window}"),
            ('kind = "builtin"\nbuiltin = "garden"\nseed = 1', mesh.format(view)),
        )
        raw = protocol_of(read_toml(path), path)
        told = " ".join(map(str, study_notes(raw, load_display("fhd27-60hz"), 9)))
        assert ("gaze may lie 0.026 deg from the dot; degrees" in told) == noted
        assert ("scenes[0].view.vertical_fov_deg: the camera sees 1.05 deg" in told) == noted
