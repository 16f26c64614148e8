"""`new-study --photos` and `--exr`: from files to a built study in three commands."""

import re
import tomllib
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from skimage import data

from pipeline.pictures.write import write_pixels
from protocols.errors import StudyError
from protocols.feasibility import virtual_manifest
from protocols.load import load_display, load_protocol
from protocols.plan import make_plan
from protocols.study_file.new_study import study_files
from protocols.study_file.own_stimuli import OwnClips, OwnMethod, OwnScene, OwnStimuli

BLENDER = (
    *(f"ViewLayer.Combined.{channel}" for channel in "RGB"), "ViewLayer.Depth.Z",
    *(f"ViewLayer.Vector.{channel}" for channel in "XYZW"),
)  # fmt: skip


@pytest.fixture
def photographs(tmp_path, monkeypatch) -> list[str]:
    """Three photographs of different sizes in the working folder."""
    monkeypatch.chdir(tmp_path)
    names = ["Astronaut.jpg", "Der Kaffee.png", "chelsea.jpg"]
    for name, picture in zip(names, (data.astronaut(), data.coffee(), data.chelsea()), strict=True):
        Image.fromarray(picture).resize((128, 96)).save(name)
    return names


def frames(folder: Path, count: int, names: tuple[str, ...] = BLENDER) -> None:
    """Write frames as Blender does: a square that goes to the right before a wall."""
    rng = np.random.default_rng(4)
    folder.mkdir()
    wall = rng.uniform(0.1, 0.9, (48, 64, 3)).astype(np.float32)
    square = rng.uniform(0.1, 0.45, (24, 12, 3)).astype(np.float32)
    for number in range(count):
        inside = np.zeros((48, 64, 1), np.float32)
        inside[12:36, 12 + 4 * number : 24 + 4 * number] = 1
        vector = np.concatenate([-4 * inside, 0 * inside, -4 * inside, 0 * inside], -1)
        colour = wall.copy()
        colour[inside[..., 0] > 0] = square[:, : int(inside[20].sum())].reshape(-1, 3)
        planes = np.concatenate([colour, 4 - 2 * inside, vector], -1)
        write_pixels(
            folder / f"shot_{number + 1:04d}.exr",
            planes[..., : len(names)], names, types=("float",) * len(names),
        )  # fmt: skip


@pytest.mark.slow
@pytest.mark.usefixtures("shared_gl_context")
def test_photographs_are_a_built_foveated_study_in_three_commands(metamerlab, photographs):
    for command in (
        ("new-study", "mine", "--photos", *photographs, "--methods", "blur,metamer"),
        ("protocol", "check", "mine/study.toml"),
        ("stimuli", "build", "mine/study.toml", "--out", "mine/clips"),
    ):
        metamerlab(*command)
    built = {path.name for path in Path("mine/clips").iterdir() if "__" in path.name}
    scenes = ("astronaut", "der-kaffee", "chelsea")
    assert built == {f"{scene}__{method}" for scene in scenes for method in ("blur", "metamer")}
    study = load_protocol(Path("mine/study.toml"))
    assert study.analysis.primary.method == "blur"
    assert study.trial.dot_over_clips
    texts = study.text.languages["en"]
    assert "video" not in " ".join((texts.consent, *texts.instructions, texts.question))


@pytest.mark.slow
@pytest.mark.usefixtures("shared_gl_context")
@pytest.mark.parametrize("task", ["yes-no", "identification"])
def test_one_photograph_is_a_study_of_detection_that_people_can_take(metamerlab, photographs, task):
    made = "new-study", "s", "--photos", photographs[0], "--task", task, "--methods", "blur,eidolon"
    metamerlab(*made)  # of pairs it would be a single condition
    checked = metamerlab("protocol", "check", "s/study.toml").stdout
    metamerlab("stimuli", "build", "s/study.toml", "--out", "s/clips")
    taken = ("s/study.toml", "--stimuli", "s/clips", "--out", "p", "--participants", "2")
    simulated = metamerlab("session", "simulate", *taken)
    metamerlab("analysis", "report", "p", "--protocol", "s/study.toml", "--out", "r")
    # Two methods, and cuts: 2 kinds x 6 angles; rings: 3 distances, open or closed, 2 places.
    assert "24 decisions on my-display" in checked
    assert "2 simulated sessions, 48 decisions" in simulated.stdout
    assert "Eidolon" in Path("r/report.html").read_text(encoding="utf-8")
    rings, (width_px, height_px) = load_protocol(Path("s/study.toml")).stimuli.rings, (128, 72)
    if rings is not None:  # they lie in the picture, whole
        reach_deg = max(rings.eccentricities_deg) + rings.height_deg / 2
        assert reach_deg < min(load_display("s/display.toml").angles_deg(width_px, height_px)) / 2


QUICK = ("new-study", "me", "--photos", "Astronaut.jpg", "chelsea.jpg", "--quick")


@pytest.mark.usefixtures("photographs")
@pytest.mark.parametrize("display", ["fhd27-60hz", "fhd24-144hz"])
def test_a_quick_study_of_oneself_is_in_order_and_needs_no_tracker(metamerlab, display):
    metamerlab(*QUICK, "--display", display)
    checked = metamerlab("protocol", "check", "me/study.toml").stdout
    study = load_protocol(Path("me/study.toml"))
    plan = make_plan(study, virtual_manifest(study, load_display("me/display.toml")), "me", 0)

    assert "60 decisions" in checked
    assert "note:" not in checked
    assert study.gaze.mode == "none"
    assert study.trial.dot_over_clips
    assert [trial.track for trial in plan.trials if trial.role == "main"] == ["all"] * 60
    assert "session run" in Path("me/README.md").read_text(encoding="utf-8")


@pytest.mark.slow
@pytest.mark.usefixtures("photographs")
@pytest.mark.parametrize(
    ("critical", "said"),
    [
        (0.14, r"Your s_c is (0\.\d+) \[(0\.\d+), (0\.\d+)\]; 0\.25 lies above, where two such"),
        (0.01, r"No number can be given for your s_c: even at the smallest scaling shown, 0\.0"),
        (9.0, r"No number can be given for your s_c: even at the largest scaling shown, 0\.\d+, the"
              r" answers may be guesses\."),
    ],
)  # fmt: skip
def test_a_quick_study_says_ones_critical_scaling_or_why_it_cannot(metamerlab, critical, said):
    metamerlab(*QUICK)
    alike = "--participant-sd", "0", "--scene-sd", "0", "--critical", f"noise={critical}"
    metamerlab("session", "simulate", "me/study.toml", "--out", "s", "--seed", "5", *alike)
    metamerlab("analysis", "report", "s", "--protocol", "me/study.toml", "--out", "r",
               "--no-figures")  # fmt: skip
    page = Path("r/report.html").read_text(encoding="utf-8")
    found = re.search(said, page)

    assert found, re.findall("[^<>]*s_c[^<>]*", page)
    if found.groups():
        assert float(found[2]) < critical < float(found[3]) < 0.25


@pytest.mark.slow
@pytest.mark.usefixtures("shared_gl_context")
def test_an_exr_sequence_is_a_built_study_in_three_commands(metamerlab, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    frames(tmp_path / "frames", 6)
    few = ["stimuli.clips.duration_s:", "design.repeats:", "1 scene"]  # six frames of one scene
    for command, notes in (
        (("new-study", "shot", "--exr", "frames/shot_####.exr"), []),
        (("protocol", "check", "shot/study.toml"), few),
        (("stimuli", "build", "shot/study.toml", "--out", "shot/clips", "--workers", "1"), []),
    ):
        done = metamerlab(*command)
        assert re.findall(r"note: (1 scene|\S+)", done.output) == notes
    read = tomllib.loads(Path("shot/study.toml").read_text(encoding="utf-8"))
    assert [size["name"] for size in read["stimuli"]["sizes"]] == ["own"]
    assert (read["stimuli"]["clips"]["width_px"], read["stimuli"]["clips"]["height_px"]) == (64, 48)
    assert read["task"]["catch"]["where"] == {"size": "own"}
    assert len(list(Path("shot/clips/shot__own__reference").glob("*.png"))) == 6


def test_files_may_stand_before_the_folder_and_a_pattern_need_no_shell(metamerlab, photographs):
    for folder, words in (
        ("last", ("--photos", *photographs, "last")),
        ("quoted", ("quoted", "--photos", "*.[jp][pn]g")),
        ("again", ("again", *(word for name in photographs for word in ("--photos", name)))),
    ):
        metamerlab("new-study", *words)
        copied = {path.name for path in Path(folder, "pictures").iterdir()}
        assert copied == {"astronaut.jpg", "der-kaffee.png", "chelsea.jpg"}
        assert not Path(folder, "scenes").exists()


def test_stills_are_as_large_as_the_smallest_photograph_allows(metamerlab, photographs):
    Image.fromarray(data.coffee()).resize((64, 96)).save("small.png")
    done = metamerlab("new-study", "s", "--photos", *photographs, "small.png")
    stimuli = load_protocol(Path("s/study.toml")).stimuli
    assert (stimuli.width_px, stimuli.height_px) == (64, 36)
    assert "no photograph is enlarged (the smallest is small.png, 64 x 96 px" in done.stdout


def test_a_shell_may_write_the_frames_out_and_channels_are_named(metamerlab, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    frames(tmp_path / "odd", 3, ("R", "G", "B", "far", "mx", "my"))
    files = sorted(map(str, Path("odd").iterdir()))
    named = ["--channel", "depth=far"]
    done = metamerlab("new-study", "s", "--exr", *files, *named, status=2)
    assert "for motion" in done.stderr
    assert "--channel motion_x=NAME" in done.stderr
    named += ["--channel", "motion_x=mx", "--channel", "motion_y=my"]
    done = metamerlab("new-study", "s", "--exr", *files, *named)
    (scene,) = tomllib.loads(Path("s/study.toml").read_text(encoding="utf-8"))["stimuli"]["scenes"]
    assert scene["file"] == "scenes/shot/shot_####.exr"
    assert scene["channels"] == {"depth": "far", "motion_x": "mx", "motion_y": "my"}
    assert len(list(Path("s/scenes/shot").iterdir())) == 3


def test_frames_that_the_display_has_no_room_for_are_cut_with_a_note(
    metamerlab, tmp_path, monkeypatch
):
    monkeypatch.chdir(tmp_path)
    frames(tmp_path / "frames", 2)
    display = (Path(__file__).parents[2] / "protocols/displays/fhd27-60hz.toml").read_text()
    small = re.sub(r"^((width|height)_(px|mm)) = .*", r"\1 = 33", display, flags=re.M)
    (tmp_path / "small.toml").write_text(small)
    words = ("new-study", "s", "--exr", "frames/shot_####.exr", "--display", "small.toml")
    done = metamerlab(*words)
    assert "clips show the middle 32 x 32 px of frames of 64 x 48" in " ".join(done.stdout.split())
    clips = tomllib.loads(Path("s/study.toml").read_text(encoding="utf-8"))["stimuli"]["clips"]
    assert (clips["width_px"], clips["height_px"]) == (32, 32)


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--photos", "none.jpg"], "none.jpg: no such file"),
        (["--photos", "circle.jpg"], "circle.jpg: must lead to a folder or a file"),
        (["--photos", "*.tiff"], "*.tiff: no such file"),
        (["--photos", "notes.txt"], "notes.txt"),
        (["--photos", "Astronaut.jpg", "--methods", "blur,metamer"], "name another scene"),
        (["--photos", "Astronaut.jpg", "--methods", "blur,metamr"], "did you mean 'metamer'"),
        (["--photos", "Astronaut.jpg", "--methods", "blur,push-pull"], "'push-pull'"),
        (["--photos", "Astronaut.jpg", "--scene", "garden"], "make a study of each"),
        (["--photos", "Astronaut.jpg", "--task", "two-alternative"], "or identification where"),
        (["--photos", "Astronaut.jpg", "--task", "abx"], "or identification where"),
        (["--exr", "shot_####.exr"], "shot_####.exr: no such file"),
        (["--exr", "Astronaut.jpg"], "Astronaut.jpg"),
        (["--exr", "a_1.exr", "b_1.exr"], "must be frames of one sequence"),
        (["--channel", "depth=far"], "is of OpenEXR frames (got none)"),
        (["--exr", "x.exr", "--channel", "deph=far"], "did you mean 'depth'"),
        (["--photos", "Astronaut.jpg", "./Astronaut.jpg"], "names Astronaut.jpg twice"),
        (["--photos", "."], "it is a folder); name a file in it"),
        (["--quick"], "--quick: must be given with --photos and without --task"),
        (["--quick", "--photos", "Astronaut.jpg", "--methods", "blur,metamer"], "--quick: must be"),
        (["--exr", "."], "this is a folder); name those in it, such as './shot_####.exr'"),
    ],
)
def test_what_cannot_be_a_study_is_told_before_anything_is_written(
    metamerlab, photographs, words, said
):
    Path("notes.txt").write_text("no picture")
    Path("circle.jpg").symlink_to("circle.jpg")
    before = sorted(path.name for path in Path().iterdir())
    done = metamerlab("new-study", "s", *words, status=2)
    assert said in " ".join(done.stderr.split())
    assert sorted(path.name for path in Path().iterdir()) == before
    assert photographs


@pytest.mark.parametrize(
    ("spoil", "words", "said"),
    [
        ("lack", "shot_####.exr", "(1 missing, the first is 2); render what is missing, or copy"),
        ("size", "shot_####.exr", "shot_0002.exr: frames of a sequence must have one size (got 32"),
        ("", "shot_0001.exr shot_0002.exr", "(got 2, and not frames/shot_0003.exr); name"),
        ("twice", "shot_####.exr", "--exr: names shot_####.exr twice"),
    ],
)
def test_frames_that_are_no_whole_sequence_are_refused_with_a_cure(
    metamerlab, tmp_path, monkeypatch, spoil, words, said
):
    monkeypatch.chdir(tmp_path)
    frames(tmp_path / "frames", 3)
    second = tmp_path / "frames" / "shot_0002.exr"
    if spoil == "lack":
        second.unlink()
    if spoil == "size":
        planes = np.ones((24, 32, len(BLENDER)), np.float32)
        write_pixels(second, planes, BLENDER, types=("float",) * len(BLENDER))
    given = ["--exr", *(f"frames/{word}" for word in words.split())]
    done = metamerlab("new-study", "s", *given, *(given if spoil == "twice" else []), status=2)
    assert said in " ".join(done.stderr.split())
    assert not Path("s").exists()


@pytest.mark.parametrize("pattern", ["frames/shot_%04d.exr", "frames/shot_*.exr", "frames/s_*"])
def test_frames_may_be_named_as_renderers_and_shells_do_and_counted_without_zeros(
    metamerlab, tmp_path, monkeypatch, pattern
):
    monkeypatch.chdir(tmp_path)
    frames(tmp_path / "frames", 3)
    if pattern.endswith("s_*"):
        for number, file in enumerate(sorted(Path("frames").iterdir()), 9):
            file.rename(f"frames/s_{number}.exr")
    metamerlab("new-study", "s", "--exr", pattern)
    assert load_protocol(Path("s/study.toml")).stimuli.clips.frames == 3
    assert len(list(Path("s/scenes").rglob("*.exr"))) == 3


@pytest.mark.parametrize("scenes", [1, 2, 3])
@pytest.mark.parametrize(
    "names", ["reference,telea", "telea,push-pull", "reference,telea,push-pull,metameric"]
)
@pytest.mark.parametrize("sequences", [True, False])
def test_every_small_study_has_an_order_without_neighbours_alike(
    tmp_path, scenes, names, sequences
):
    path = 'upsampling", real_every = 2' if sequences else 'circle"'
    lines = ('kind = "exr"', 'file = "x.exr"', f'camera = {{ kind = "{path} }}')
    own = [OwnScene(f"s{number}", None, lines, has_truth=sequences) for number in range(scenes)]
    methods = tuple(map(OwnMethod, names.split(",")))
    clips = OwnClips(64, 48, 4, alone=True) if sequences else None
    display = load_display("fhd27-60hz")
    pairs = len(methods) * (len(methods) - 1) // 2
    if "reference" in names and not sequences:
        pairs = (len(methods) - 1) * (len(methods) - 2) // 2
    if scenes * pairs * (1 if sequences else 2) == 1:
        with pytest.raises(StudyError, match="two conditions or more"):
            OwnStimuli(tuple(own), methods, clips).check_pairs()
        return
    if not pairs:
        return  # told by the check of methods
    files = study_files("small", "Small", display, own=OwnStimuli(tuple(own), methods, clips))
    (tmp_path / "study.toml").write_text(files["study.toml"], encoding="utf-8")
    study = load_protocol(tmp_path / "study.toml")
    manifest = virtual_manifest(study, display)
    for slot in range(4):
        assert make_plan(study, manifest, f"P{slot}", slot).trials
