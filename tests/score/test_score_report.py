"""Results of a run: tables, figures, one page; and that nothing is measured twice."""

import csv
import io
import json
import math
import re
import shutil
import tomllib
from dataclasses import replace

import numpy as np
import pytest

from protocols.blocks import html_page
from protocols.disk.hashing import sha256_file
from protocols.load import load_display
from protocols.study_file.new_study import study_files
from stimuli.score import measure_clips, plots, report
from stimuli.score.batch import subjects_of_batch
from stimuli.score.metrics import METRICS, choose_metrics
from stimuli.score.tables import ScoreTable, all_duels, all_tables, duels, tables_csv, tables_latex
from stimuli.score.viewing_conditions import ViewerGaze, open_viewing, standard_fhd
from stimuli.score.write_scores import CACHE_FOLDER

OURS = ("psnr", "ssim", "hf-ratio", "flicker", "statistics")


@pytest.fixture
def scored(batch, tmp_path):
    """Return results of our own metrics, with a cache."""
    settings = measure_clips.ScoreSettings(choose_metrics(OURS), standard_fhd())
    return measure_clips.score(subjects_of_batch(batch), settings, cache=tmp_path / "scores/.cache")


@pytest.mark.slow
def test_the_command_writes_everything(run_score, batch, tmp_path):
    out = tmp_path / "scores"
    done = run_score(batch, "--out", out, "--metrics", ",".join(OURS))

    assert "mean, in holes" in done.stdout
    rows = list(csv.DictReader(io.StringIO((out / "scores.csv").read_text())))
    # 2 scenes x 2 methods x (4 metrics x 2 regions + flicker in holes)
    assert len(rows) == 2 * 2 * 9
    assert {row["method"] for row in rows} == {"push-pull", "metameric"}
    numbers = json.loads((out / "scores.json").read_text())
    first = numbers["clips"][0]
    cell = next(
        row
        for row in rows
        if (row["scene"], row["method"]) == (first["scene"], first["method"])
        and (row["metric"], row["region"]) == ("ssim", "holes")
    )
    assert float(cell["value"]) == pytest.approx(first["scores"]["ssim holes"], rel=1e-6)
    assert numbers["versions"]["numpy"]
    assert numbers["display"]["name"] == "standard_fhd"
    frames = list(csv.DictReader(io.StringIO((out / "frames.csv").read_text())))
    flicker = [row["frame"] for row in frames if row["metric"] == "flicker"]
    assert sorted(set(flicker)) == ["1", "2", "3"]
    assert {path.suffix for path in (out / "figures").iterdir()} == {".png", ".svg", ".pdf"}
    page = (out / "scores.html").read_text()
    assert "data:image/jpeg;base64," in page
    assert page.count("<svg ") >= 5
    assert not re.findall(r'(?:src|href)="(?!data:|#)[^"]*"', page), "needs no other file"


def test_tables_have_the_papers_layout(scored):
    table = next(t for t in all_tables(scored) if (t.metric.name, t.region) == ("ssim", "holes"))

    assert table.methods == ("metameric", "push-pull")  # ours first, as in the paper
    assert [scene for scene, _ in table.rows] == ["lawn", "wall", "mean"]
    ours = [values[0] for _, values in table.rows]
    assert ours[2] == pytest.approx((ours[0] + ours[1]) / 2)
    lines = table.markdown().splitlines()
    assert lines[0] == "| | metameric | push-pull |"
    assert lines[-1].count("**") == 2, "the best of a row is marked"


def test_a_defeat_is_said(scored):
    """Heavy noise loses to blur in SSIM and wins nowhere that matters here."""
    found = {(d.table.metric.name, d.table.region): d for d in duels(all_tables(scored))}
    duel = found["ssim", "holes"]

    assert duel.loses_on_average
    assert duel.lost == ("lawn", "wall")
    assert "is worse than push-pull" in duel.sentence
    assert "better in 0 of 2 scenes" in duel.sentence


def test_a_second_run_measures_nothing(scored, batch, tmp_path, monkeypatch):
    def fail(*_):
        raise AssertionError("measured again")

    monkeypatch.setattr(measure_clips, "measure_job", fail)
    again = measure_clips.score(
        subjects_of_batch(batch), scored.settings, cache=tmp_path / "scores/.cache"
    )

    assert again.values == scored.values
    assert again.maps.keys() == scored.maps.keys()
    for name, found in scored.maps.items():
        assert found.dtype == np.float32
        assert again.maps[name].tobytes() == found.tobytes()


@pytest.mark.slow
def test_scores_from_the_cache_are_the_same_files_byte_for_byte(run_score, batch, tmp_path):
    """Each file is hashed, after a cold run, a warm one, and a cold one that knows times alone."""

    def files(folder):
        asked = ("--metrics", ",".join((*OURS, "band-ratio")), "--out", folder)
        run_score(batch, *asked)
        paths = sorted(p for p in folder.rglob("*") if CACHE_FOLDER not in p.parts and p.is_file())
        return {str(p.relative_to(folder)): sha256_file(p) for p in paths}

    cold = files(tmp_path / "scores")
    (tmp_path / "again" / CACHE_FOLDER).mkdir(parents=True)
    for times in (tmp_path / "scores" / CACHE_FOLDER).glob("*.times.json"):
        shutil.copy(times, tmp_path / "again" / CACHE_FOLDER)

    assert len(cold) > 5
    assert files(tmp_path / "scores") == cold
    assert files(tmp_path / "again") == cold


def counted(monkeypatch):
    calls = []
    real = measure_clips.measure_job

    def count(family, pair, *rest):
        calls.append((family, pair.name))
        return real(family, pair, *rest)

    monkeypatch.setattr(measure_clips, "measure_job", count)
    return calls


def test_a_changed_clip_is_measured_again_alone(scored, batch, tmp_path, monkeypatch):
    calls = counted(monkeypatch)
    frame = batch / "wall__small__metameric" / "000001.png"
    frame.write_bytes((batch / "wall__small__push-pull" / "000001.png").read_bytes())

    measure_clips.score(subjects_of_batch(batch), scored.settings, cache=tmp_path / "scores/.cache")

    assert sorted(calls) == [
        ("pixels", "wall__small__metameric"), ("statistics", "wall__small__metameric")
    ]  # fmt: skip


def test_another_gaze_measures_only_what_depends_on_it(scored, batch, tmp_path, monkeypatch):
    calls = counted(monkeypatch)
    settings = measure_clips.ScoreSettings(
        scored.settings.metrics, standard_fhd(), ViewerGaze(((1.0, 2.0),))
    )

    measure_clips.score(subjects_of_batch(batch), settings, cache=tmp_path / "scores/.cache")

    assert {family for family, _ in calls} == {"statistics"}


def test_an_interrupted_run_goes_on(batch, tmp_path, monkeypatch):
    settings = measure_clips.ScoreSettings(choose_metrics(OURS), standard_fhd())
    cache = tmp_path / "cache"
    real, done = measure_clips.measure_job, []

    def stop_at_third(*arguments):
        if len(done) == 3:
            raise KeyboardInterrupt
        done.append(arguments[:2])
        return real(*arguments)

    monkeypatch.setattr(measure_clips, "measure_job", stop_at_third)
    with pytest.raises(KeyboardInterrupt):
        measure_clips.score(subjects_of_batch(batch), settings, cache=cache)
    monkeypatch.setattr(measure_clips, "measure_job", real)
    calls = counted(monkeypatch)

    measure_clips.score(subjects_of_batch(batch), settings, cache=cache)

    assert len(calls) == 8 - 3


def test_a_damaged_measurement_is_made_again(scored, batch, tmp_path, monkeypatch):
    kept = sorted((tmp_path / "scores" / CACHE_FOLDER).glob("*.json"))
    kept[0].write_text("{")
    calls = counted(monkeypatch)

    again = measure_clips.score(
        subjects_of_batch(batch), scored.settings, cache=tmp_path / "scores/.cache"
    )

    assert len(calls) == 1
    assert again.values == scored.values


@pytest.mark.slow
def test_several_processes_give_the_same_numbers(scored, batch):
    found = measure_clips.score(subjects_of_batch(batch), scored.settings, workers=2)

    assert found.values == scored.values


@pytest.mark.slow
def test_without_the_extra_the_rest_is_computed(run_score, batch, tmp_path, monkeypatch):
    from stimuli.score import available

    monkeypatch.setattr(
        available, "find_spec", lambda name: None if name in ("torch", "flip_evaluator") else 1
    )
    done = run_score(batch, "--out", tmp_path / "scores")

    told = " ".join(done.stdout.split())
    assert "left out: flip: not installed here: flip-evaluator; install them with" in told
    assert "metamerlab[metrics]" in told
    assert "fvvdp, fvvdp-1.0" in told
    page = (tmp_path / "scores/scores.html").read_text()
    assert "not installed here: torch" in page
    assert (tmp_path / "scores/scores.csv").read_text().count("statistics") == 8
    asked = run_score(batch, "--out", tmp_path / "more", "--metrics", "fvvdp", status=2)
    assert "no metric that was asked for can be computed" in asked.stderr


def test_the_list_names_every_metric_and_its_licence(run_score):
    done = run_score("--list")

    for name in METRICS:
        assert name in done.stdout
    assert "BY-NC" in done.stdout


def test_two_pictures_and_a_mask(run_score, batch):
    names = ["wall__small__metameric", "wall__small__reference", "holes/wall__small"]
    test, truth, mask = (batch / name / "000000.png" for name in names)
    done = run_score(test, truth, "--mask", mask, "--metrics", "psnr,flicker")

    assert "mean, in holes" in done.stdout
    assert "flicker: left out" in " ".join(done.stdout.split())


def test_rescaled_masks_cover_every_pixel_that_is_partly_a_hole(tmp_path, clips, frames_writer):
    from stimuli.score.pair import read_hole_mask

    frames_writer(tmp_path / "holes", clips.holes)
    half = read_hole_mask(tmp_path / "holes/000001.png", (24, 32))

    wanted = clips.holes[1].reshape(24, 2, 32, 2).any(axis=(1, 3))
    assert (half == wanted).all()


def test_a_display_of_ours_brings_its_own_angle_and_light(tmp_path):
    text = """name = "lab"
width_px = 1920
height_px = 1080
width_mm = 597.7
height_mm = 336.2
distance_mm = 700.0
refresh_hz = 60.0
peak_cd_m2 = 250.0
black_cd_m2 = 0.5
gamma = 2.2
"""
    (tmp_path / "lab.toml").write_text(text)
    viewing = open_viewing(str(tmp_path / "lab.toml"))

    assert viewing.px_per_deg == pytest.approx(39.246, abs=0.001)  # by hand: 0.3113 mm at 700 mm
    assert (viewing.peak_cd_m2, viewing.contrast, viewing.ambient_lux) == (250.0, 500.0, 0.0)
    assert standard_fhd().px_per_deg == pytest.approx(37.8425, abs=1e-4)


def test_a_report_of_one_pair_needs_no_batch(run_score, batch, tmp_path):
    run_score(batch / "wall__small__metameric", batch / "wall__small__reference",
                     "--out", tmp_path / "two", "--metrics", "psnr,ssim")  # fmt: skip

    assert (tmp_path / "two/scores.html").exists()


def table_of(better: str, values: tuple[float, ...]) -> ScoreTable:
    metric = replace(METRICS["ssim"], better=better, perfect=1.0 if better == "one" else math.inf)
    names = tuple("abc"[: len(values)])
    return ScoreTable(metric, "holes", "small", names, (("one_scene & co", values),))


@pytest.mark.parametrize("better", ["lower", "higher"])
def test_dots_lie_to_the_right_when_better_whatever_the_metric(better):
    values = (0.2, 0.9, 0.5) if better == "higher" else (0.9, 0.2, 0.5)
    axes = plots.dots(table_of(better, values)).axes[0]
    assert not axes.patches, "no bar, whose length would say what its end does not"
    drawn = [line.get_xydata()[0] for line in axes.lines if line.get_label() in "abc"]
    assert [x for x, _ in drawn] == list(values)
    to_the_right = axes.transData.transform(drawn)[:, 0]
    assert np.argsort(to_the_right).tolist() == [0, 2, 1]


def test_the_best_of_a_row_has_a_star():
    rows = report._rows(table_of("higher", (0.2, 0.9, 0.5))).rows
    assert [str(cell).startswith('<b class="best">') for cell in rows[0][1:]] == [
        False,
        True,
        False,
    ]
    assert r'.best::after { content: "\2605";' in html_page("any")


def test_a_line_stands_at_one_where_one_is_right():
    ratios = plots.dots(table_of("one", (0.5, 1.25))).axes[0]
    assert [1.0, 1.0] in [list(line.get_xdata()) for line in ratios.lines]
    plain = plots.dots(table_of("lower", (0.5, 1.25))).axes[0]
    assert [1.0, 1.0] not in [list(line.get_xdata()) for line in plain.lines]


def test_what_is_printed_alike_is_a_tie_and_no_defeat():
    (duel,) = duels((table_of("higher", (0.98541, 0.98549)),), "a", "b")
    assert not duel.loses_on_average
    assert (duel.lost, duel.tied) == ((), ("one_scene & co",))
    assert "a 0.985 is as good as b 0.985 on average" in duel.sentence
    assert duel.sentence.endswith("better in 0 of 1 scenes, equal in 1")
    (worse,) = duels((table_of("lower", (0.9, 0.2)),), "a", "b")
    assert "is worse than b" in worse.sentence
    assert (worse.lost, worse.tied) == (("one_scene & co",), ())


def test_tables_for_papers_and_for_programs_hold_what_is_printed():
    table = table_of("higher", (0.25, 0.5))
    latex = tables_latex((table,))
    assert r"one\_scene \& co & 0.250 & \textbf{0.500} \\" in latex
    assert latex.count(r"\begin{tabular}{lrr}") == latex.count(r"\end{table}") == 1
    rows = list(csv.DictReader(io.StringIO(tables_csv((table,)))))
    assert rows[0]["scene"] == "one_scene & co"
    assert (rows[0]["a"], rows[0]["b"], rows[0]["better"]) == ("0.250", "0.500", "higher")


def test_the_method_in_focus_is_compared_with_every_other():
    found = all_duels((table_of("higher", (0.5, 0.25, 0.75)),), "a")
    assert [(duel.against, duel.loses_on_average) for duel in found] == [("b", False), ("c", True)]


def test_people_read_labels_and_programs_read_names(run_score, batch, tmp_path):
    study = tmp_path / "study.toml"
    text = study_files("tiny", "Tiny", load_display("fhd27-60hz"), "two-interval")["study.toml"]
    raw = tomllib.loads(text)["stimuli"]
    first, second = (each["name"] for each in raw["scenes"][:2])
    labels = {each["name"]: each["label"] for part in ("scenes", "methods") for each in raw[part]}
    for old, new, label in (
        (first, "lawn", "The lawn"),
        (second, "wall", "The wall"),
        ("push-pull", "push-pull", "Pull & push"),
    ):
        text = text.replace(f'"{labels[old]}"', f'"{label}"').replace(f'"{old}"', f'"{new}"')
    study.write_text(text)
    out = tmp_path / "scores"

    done = run_score(
        batch, "--out", out, "--metrics", "psnr", "--focus", "push-pull", "--protocol", study
    )

    assert "Pull & push" in done.stdout
    page = (out / "scores.html").read_text()
    for shown in ("Pull &amp; push</th>", "The lawn", '<h2 id="verdict">Pull &amp; push against'):
        assert shown in page, shown
    assert "Pull & push" in (out / "figures/scenes-psnr-holes-small.svg").read_text().replace(
        "&amp;", "&"
    )
    assert r"Pull \& push" in (out / "tables.tex").read_text()
    assert "The lawn" in (out / "tables.md").read_text()
    for file in ("scores.csv", "tables.csv", "scores.json"):
        kept = (out / file).read_text()
        assert "push-pull" in kept, file
        assert "Pull" not in kept, file


def test_labels_of_another_study_are_refused(run_score, batch, tmp_path):
    done = run_score(batch, "--out", tmp_path / "scores", "--protocol", "demo", status=2)
    assert "must be the study of the clips, 'tiny' (got 'demo')" in " ".join(done.output.split())


def test_a_focus_that_is_no_method_is_refused_before_anything_is_measured(
    run_score, batch, tmp_path
):
    done = run_score(batch, "--out", tmp_path / "scores", "--focus", "metamerc", status=2)
    assert "--focus: must be a method of the clips, " in done.output
    assert "did you mean 'metameric'" in done.output
    assert not (tmp_path / "scores").exists()
