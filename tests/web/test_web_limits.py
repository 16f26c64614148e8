"""Large studies and pictures with colours of their own, as exports see them."""

import io
import re
import zipfile
from dataclasses import replace

import numpy as np
import pytest
from command_line import metamerlab
from PIL import Image, ImageCms
from PIL.PngImagePlugin import PngInfo
from web_study import FHD, for_browsers

from protocols.browser.web_study import Pack, WebPhase, rates_of
from protocols.disk.hashing import sha256_file
from protocols.errors import StudyError
from protocols.study_file.preregister import preregistration, to_markdown
from stimuli.media.png import encode_bytes
from study_app.web.export import WebBuild, check_budget
from study_app.web.packs import colour_chunks
from study_app.web.read_results import BrowserResults, read_web_results


def test_packs_and_times_may_be_as_large_as_budgets_allow():
    sha = "0" * 64
    assert Pack(file="a.pack", bytes=300_000_000, sha256=(sha,), ends=(300_000_000,)).bytes > 1e6
    hours = 3 * 3600 * 240
    phase = WebPhase(
        name="answer", frames=None, show=(), gate_frames=None, watched=False, question=None,
        timeout_frames=hours, follows={},
    )  # fmt: skip
    assert phase.timeout_frames == hours


def png(*chunks: str, icc: bool = False) -> bytes:
    """Return a picture with such chunks before its pixels, and one of text."""
    info, file = PngInfo(), io.BytesIO()
    info.add_text("Comment", "gAMA")
    for name in chunks:
        info.add(name.encode(), bytes(4))
    profile = ImageCms.ImageCmsProfile(ImageCms.createProfile("sRGB")).tobytes() if icc else None
    Image.new("RGB", (64, 64), "red").save(file, "png", pnginfo=info, icc_profile=profile)
    return file.getvalue()


def test_colour_chunks_are_found_and_stimuli_of_ours_have_none():
    for name in ("gAMA", "cHRM", "sRGB", "cICP"):
        assert colour_chunks(png(name)) == [name]
    assert colour_chunks(png("gAMA", icc=True)) == ["iCCP", "gAMA"]
    assert colour_chunks(png()) == []
    assert colour_chunks(encode_bytes(np.zeros((4, 4, 3), np.uint8))) == []
    for torn in (b"", png()[:20], b"no picture at all"):
        assert colour_chunks(torn) == []


def test_a_stimulus_that_asks_for_other_colours_is_not_exported(case, tmp_path):
    of = case("yes-no")
    clip = of.manifest.clips[0]
    path = of.stimuli / clip.frame_path(0)
    plain = path.read_bytes()
    path.write_bytes(png("gAMA"))
    changed = clip.model_copy(update={"frames_sha256": (sha256_file(path),)})
    manifest = of.manifest.model_copy(update={"clips": (changed, *of.manifest.clips[1:])})
    try:
        with pytest.raises(StudyError, match=r"must hold no colour chunk \(has gAMA\).* build the"):
            WebBuild(of.study, FHD, manifest).write(of.stimuli, tmp_path / "out")
        assert not (tmp_path / "out").exists()
    finally:
        path.write_bytes(plain)


@pytest.mark.parametrize("stated_s", [0.15, 0.1])
def test_a_refused_rate_says_the_tolerance_that_admits_it(case, stated_s):
    of = case("yes-no")
    task = of.study.task.model_copy(update={"stimulus_s": stated_s})
    exact = for_browsers(of.study.model_copy(update={"task": task}))
    for rate, problems in rates_of(exact, FHD).items():
        if not problems:
            continue
        words, _, wanted = problems[0].rpartition("; or declare web.tolerance_s = ")
        assert "must be whole refreshes at" in words
        assert rates_of(for_browsers(exact, tolerance_s=float(wanted)), FHD)[rate] == []
        assert rates_of(for_browsers(exact, tolerance_s=float(wanted) - 2e-4), FHD)[rate] != []


def test_a_preregistration_says_what_a_browser_study_gives_up(case):
    of = case("yes-no")

    def text(study) -> str:
        sections = preregistration(study, FHD, revision="0.1.0")
        return to_markdown("T", sections).replace("\n", " ")

    said = text(for_browsers(of.study, tolerance_s=0.0067, identifier="PANEL"))
    assert "gaze is not tracked, and neither luminance nor distance is known" in said
    assert "off by at most 6.7 ms there" in said
    assert "it runs at 50, 60," in said
    assert "parameter PANEL is kept" in said
    assert "browsers" not in text(of.study.model_copy(update={"web": None}))


@pytest.mark.parametrize("line", ['"kind": "pause"', '"kind": "break", "after_block": 1'])
@pytest.mark.parametrize(("duration", "damaged"), [("1.5", 0), ("1e300", 1), ("Infinity", 1)])
def test_a_line_whose_duration_no_journal_could_hold_is_named(line, duration, damaged):
    of_every = '"study": "s", "participant": "P", "run": 0, "n": 0, "t_s": 1.0'
    at = '"at": "2026-01-31T12:00:00Z"'
    results = BrowserResults()
    text = f'{{{of_every}, {at}, {line}, "duration_s": {duration}}}\n'

    results.read("home.txt", text.encode())

    assert len(results.damaged) == damaged
    assert len(results.found) == 1 - damaged


@pytest.mark.parametrize("kept", [4, 30, 3000])
def test_an_archive_that_is_cut_short_is_no_text_and_nothing_of_it_counts(tmp_path, kept):
    whole = io.BytesIO()
    with zipfile.ZipFile(whole, "w", zipfile.ZIP_STORED) as archive:
        archive.writestr("study_result_1/comp-result_1/data.txt", '{"kind":"note"}\n' * 500)
    path = tmp_path / "results.zip"
    path.write_bytes(whole.getvalue()[:kept])
    with pytest.raises(StudyError, match=r"results\.zip: must be an archive .* download it again"):
        read_web_results([path])


def test_a_study_over_its_budgets_is_refused_with_what_fits_and_options_that_admit_it(case):
    of = case("two-interval")
    build, most = WebBuild(of.study, FHD, of.manifest), 1_000_000

    def said(fetched: float, decoded: float, *options: float) -> str:
        needs = replace(
            build.needs(), fetched_bytes=int(fetched * most), decoded_bytes=int(decoded * most)
        )
        with pytest.raises(StudyError) as error:
            check_budget(needs, build, *options)
        given = dict(re.findall(r"(--[a-z]+-mb) (\d+)", str(error.value)))
        raised = float(given.get("--budget-mb", 300)), float(given.get("--decoded-mb", 500))
        check_budget(needs, build, *raised)
        return str(error.value)

    alone = said(975.4, 20)
    assert "one participant may fetch 300 MB (got 975 MB)" in alone
    assert "30% of the scenes" in alone  # 31 % would be too many
    assert "or export with --budget-mb 976" in alone
    both = said(400, 2000.5)
    assert both.endswith("or export with --budget-mb 400 --decoded-mb 2001")
    assert "stimuli of 30x30 px instead of 64x64" in both  # by the worse of the two
    assert "scenes" not in both
    assert "--budget-mb" not in said(20, 501)


@pytest.mark.parametrize(
    ("place", "said"),
    [
        ("nowhere", "--jatos: must lie in a folder that exists, and not in --out"),
        ("web", "--jatos: must lie in a folder that exists, and not in --out"),
        ("circle", "circle/study.jzip: must lead to a folder or a file"),
    ],
)
def test_an_archive_goes_into_a_folder_that_is_there_or_nothing_is_written(
    case, tmp_path, place, said
):
    of = case("yes-no")
    (tmp_path / "circle").symlink_to("circle")
    path = tmp_path / "study.toml"
    text = (of.out.parent / "study.toml").read_text()
    path.write_text(text + '\n[web]\ngaze = "none"\ntolerance_s = 0.01\n')
    words = (
        "session", "export-web", path, "--stimuli", of.stimuli, "--out", tmp_path / "web",
        "--jatos", tmp_path / place / "study.jzip",
    )  # fmt: skip
    done = metamerlab(*words, terminal_width=300, status=2)
    assert said in done.output
    assert not (tmp_path / "web").exists()
