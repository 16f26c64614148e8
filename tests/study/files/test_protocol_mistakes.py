"""A protocol with mistakes: every one at once, with place, value and cure."""

from pathlib import Path

import pytest

from protocols.errors import StudyError
from protocols.load import load_display, load_protocol, load_toml, shipped
from protocols.study_file.schema import StudyProtocol

DEMO = shipped("studies")["demo"].read_text(encoding="utf-8")


@pytest.fixture
def mistakes(tmp_path):
    """Load the demo study with replacements; return the lines of the message."""

    def load(*replacements: tuple[str, str]) -> list[str]:
        text = DEMO
        for old, new in replacements:
            assert old in text, old
            text = text.replace(old, new, 1)
        path = tmp_path / "pilot.toml"
        path.write_text(text, encoding="utf-8")
        with pytest.raises(StudyError) as caught:
            load_protocol(path)
        return [line.removeprefix(f"{path}: ") for line in str(caught.value).splitlines()]

    return load


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("gap_s = 0.5", "gap_ms = 500",
         "task.gap_ms: unknown key; did you mean 'gap_s' (seconds): gap_s = 0.5?"),
        ("iti_s = 0.5", "iti = 0.5", "trial.iti: unknown key; did you mean 'iti_s' (seconds)?"),
        ("window_deg = 1.5", "window_arcmin = 90",
         "gaze.window_arcmin: unknown key; did you mean 'window_deg' (degrees): window_deg = 1.5?"),
        ("window_deg = 1.5", "window_deg = -1.5",
         "gaze.window_deg: must be at least 0.001 degrees (got -1.5)"),
        ("gap_s = 0.5", 'gap_s = "0.5"', "task.gap_s: must be a number (got '0.5')"),
        ("gap_s = 0.5", "gap_s = true", "task.gap_s: must be a number (got true)"),
        ("gap_s = 0.5", "gap_s = inf", "task.gap_s: must be a finite number (got inf)"),
        ("repeats = 2", "repeats = 2.5", "design.repeats: must be a whole number (got 2.5)"),
        ("[stimuli.clips]", "[stimuli.clip]", "stimuli.clip: unknown key; did you mean 'clips'?"),
        ("[stimuli.clips]", "[stimuli.clip]", "stimuli.clips: missing"),
        ('kind = "builtin"', 'kind = "bultin"',
         "stimuli.scenes[0].kind: must be one of builtin, mesh, stereo, rgbd, exr, around"
         " (got 'bultin'); did you mean 'builtin'?"),
        ("turns = 1.0", "turn = 1.0",
         "stimuli.scenes[0].camera.turn: unknown key; did you mean 'turns'?"),
        ('name = "large"', 'name = "small"',
         "stimuli.sizes[1].name: names must differ (got 'small', which stimuli.sizes[0] has);"
         " rename one of them"),
        ('name = "garden"', 'name = "gar__den"',
         "stimuli.scenes[0].name: must be lower-case words and numbers joined by single dashes or"
         " underscores (got 'gar__den')"),
        ('against = "push-pull"', 'against = "pushpull"',
         "analysis.primary.against: must name one of the methods (reference, push-pull,"
         " metameric) (got 'pushpull'); did you mean 'push-pull'?"),
        ('scenes = ["garden"]', 'scenes = ["gardn"]',
         "design.practice.scenes[0]: must name one of the scenes (garden, colonnade)"
         " (got 'gardn'); did you mean 'garden'?"),
        ('pairings = "all"', 'pairings = [["metameric", "metameric"]]',
         "task.pairings[0]: a pairing must hold two different methods"
         " (got 'metameric' twice)"),
        ('pairings = "all"',
         'pairings = [["metameric", "push-pull"], ["push-pull", "metameric"]]',
         "task.pairings[1]: every pairing must be given once (got ['push-pull', 'metameric'],"
         " which task.pairings[0] has); raise repeats instead"),
        ('default_language = "en"', 'default_language = "fr"',
         "text.default_language: must be one of the languages given (en, de, ja) (got 'fr')"),
        ('pause_keys = ["p"]', 'pause_keys = ["f"]',
         "response.pause_keys: a key must do one thing (got 'f' in keys[0] and pause_keys)"),
        ("hole_share = 0.02", "",
         "stimuli.sizes[0]: a size says either hole_share or extent_m (got neither), for scene"
         " 'garden'; OpenEXR sequences with their own motion alone need none"),
        ("duration_s = 1.0", "duration_s = 0.35",
         "stimuli.clips: duration_s x fps must be whole frames (got 0.35 s x 30 fps = 10.5);"
         " the nearest durations are 0.3333333 s and 0.36666667 s"),
        ("seed = 7", "seed = 7\nrender_width_px = 2048",
         "stimuli.clips: render_width_px = 2048 needs a declared filter; set rescale to 'box' or"
         " 'lanczos3', or leave render_width_px out"),
        ("Block {done} of {total}", "Block {don} of {total}",
         "text.languages.en.break_page: {...} must be one of left, right, continue, quit, done,"
         " total (got {don}); did you mean 'done'?"),
        ('choices = ["nein", "Brille", "Kontaktlinsen"]', 'choices = ["nein", "Brille"]',
         "text.languages.de.questions: must have the names and numbers of choices of 'en', or"
         " answers cannot be compared ([('strategy', 0), ('vision', 3)])"
         " (got [('strategy', 0), ('vision', 2)])"),
        ('pairings = "all"', 'pairings = [["reference", "push-pull"]]',
         "analysis.primary: must compare two methods that the task pairs (got 'metameric'"
         " against 'push-pull'); add the pairing, or choose another comparison"),
        ('against = "push-pull"', 'against = "metameric"',
         "analysis.primary.against: must differ from method ('metameric')"),
        ("rt_min_s = 0.1", "rt_min_s = 0.1\nrt_max_s = 0.05",
         "analysis.exclusions.rt_max_s: must be longer than rt_min_s = 0.1 s (got 0.05 s)"),
        ("fixation_timeout_s = 10.0", "fixation_timeout_s = 0.5",
         "trial.fixation_timeout_s: must be longer than fixation_s = 0.5 s (got 0.5 s)"),
    ],
)  # fmt: skip
def test_a_mistake_is_told_with_place_value_and_cure(mistakes, old, new, message):
    assert message in mistakes((old, new))


def test_of_very_many_mistakes_the_first_are_told_and_the_rest_counted(mistakes):
    lines = mistakes(("gap_s = 0.5", "\n".join(f"gap_{n} = 1" for n in range(700))))
    assert sum(": unknown key" in line for line in lines) == 150
    assert lines[-1] == "550 more mistakes; mend these first"


def test_mistakes_between_sections_are_told_beside_those_within_others(mistakes):
    """Sections that are right by themselves are judged together."""
    lines = mistakes(
        ("window_deg = 1.5", "window_deg = -1.5"),
        ('first = "erstes"', "first = 1"),
        ('against = "push-pull"', 'against = "nobody"'),
        ('better = "reference"', 'better = "refrence"'),
    )

    assert len(lines) == 4
    for place in (
        "gaze.window_deg:", "text.languages.de.answers.first:", "analysis.primary.against:",
        "task.catch.better:",
    ):  # fmt: skip
        assert sum(line.startswith(place) for line in lines) == 1, place


def test_every_single_unknown_key_is_refused(mistakes):
    for header in (
        "study", "display", "stimuli", "stimuli.clips", "task", "design", "trial", "gaze",
        "response", "analysis", "analysis.exclusions", "privacy",
    ):  # fmt: skip
        (line,) = mistakes((f"[{header}]\n", f"[{header}]\nnonsense_zzz = 1\n"))
        assert line.startswith(f"{header}.nonsense_zzz: unknown key; known keys: ")


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"\xff\xd8\xff\xe0\x00\x10JFIF\x00", "must be a text file (it holds other data, as pict"),
        (b"format = 1\nname = \xff\n", "line 2: must be UTF-8 text (got byte 0xff)"),
        (b"format = 1\nname = \n", "reader says: Invalid value (at line 2, column 8)); mend"),
        (b"[study]\n[study]\n", "reader says: Cannot declare ('study',) twice"),
        (b"", "must be a study, with [study], [stimuli], [task] and so on, or a display"),
    ],
)
def test_a_file_that_is_no_protocol_is_told_with_its_line(tmp_path, content, message):
    path = tmp_path / "broken.toml"
    path.write_bytes(content)
    with pytest.raises(StudyError) as caught:
        load_protocol(path)
    assert message in str(caught.value)
    assert all(line.startswith(f"{path}: ") for line in str(caught.value).splitlines())


def test_a_missing_file_and_an_unknown_name_are_told(tmp_path):
    with pytest.raises(StudyError, match="there is no such file"):
        load_protocol(tmp_path / "none.toml")
    with pytest.raises(StudyError, match="this is a folder"):
        load_protocol(tmp_path)
    with pytest.raises(StudyError, match="did you mean 'demo'"):
        load_protocol(Path("demos"))
    with pytest.raises(StudyError, match="did you mean 'fhd27-60hz'"):
        load_display("fhd27-60")


def test_a_display_with_wrong_size_is_refused(tmp_path):
    text = shipped("displays")["fhd27-60hz"].read_text(encoding="utf-8")
    path = tmp_path / "mine.toml"
    path.write_text(text.replace("height_mm = 336.2", "height_mm = 400.0"), encoding="utf-8")

    with pytest.raises(StudyError, match=r"square within 2 % \(got 0\.3113 x 0\.3704"):
        load_display(str(path))


def test_a_display_file_is_found_beside_the_protocol(tmp_path):
    (tmp_path / "mine.toml").write_bytes(shipped("displays")["qhd27-120hz"].read_bytes())

    assert load_display("mine.toml", beside=tmp_path / "study.toml").refresh_hz == 120.0


def test_a_bare_model_refuses_what_the_loader_refuses():
    protocol = load_toml(shipped("studies")["demo"], StudyProtocol)
    plain = protocol.model_dump()
    plain["stimuli"]["sizes"] = (plain["stimuli"]["sizes"][0], plain["stimuli"]["sizes"][0])

    with pytest.raises(ValueError, match="names must differ"):
        StudyProtocol.model_validate(plain)
