"""A whole batch: built, killed, resumed, checked, and refused where it must be."""

import dataclasses
import errno
import itertools
import json
import os
import re
import shutil
import signal
import types
from concurrent.futures import Future
from pathlib import Path

import forked
import numpy as np
import pytest
from attack.builds import contents, kill_builds
from built_study import box_document
from PIL import Image

import stimuli.batch.build
import stimuli.batch.clip
import stimuli.batch.clip_build
import stimuli.batch.estimate
import stimuli.batch.records
from pipeline.errors import InputError
from protocols.errors import StudyError
from protocols.load import load_protocol
from protocols.manifest import check_manifest, read_manifest
from stimuli.batch.batch_folder import claim, move_over, remove_strangers
from stimuli.batch.build import build
from stimuli.batch.check import check_batch
from stimuli.batch.jobs import describe_renderer
from stimuli.media.png import decode_png, is_whole_png


@pytest.fixture
def copy(batch, tmp_path):
    return Path(shutil.copytree(batch, tmp_path / "clips"))


@pytest.mark.slow
def test_a_batch_holds_every_clip_of_its_protocol(batch, plan):
    manifest = read_manifest(batch)
    check_manifest(plan.study, manifest)
    assert {clip.name for clip in manifest.clips} == {
        f"{scene}__small__{method}"
        for scene in ("box", "motorcycle")
        for method in ("reference", "push-pull", "telea")
    }
    for clip in manifest.clips:
        frame = decode_png(batch / clip.frame_path(0))
        assert frame.shape == (clip.height_px, clip.width_px, 3)
        assert 0 < clip.hole_share < 0.3
    assert not (batch / ".build").exists()
    assert check_batch(batch).in_order


def test_methods_differ_inside_holes_alone(batch):
    mask = decode_png(batch / "holes/box__small/000001.png") > 0
    first, second = (
        decode_png(batch / f"box__small__{method}/000001.png") for method in ("push-pull", "telea")
    )
    assert mask.any()
    assert np.array_equal(first[~mask], second[~mask])
    assert (first[mask] != second[mask]).any()


def test_the_other_photograph_is_the_truth_in_the_holes_of_a_pair(batch):
    mask = decode_png(batch / "holes/motorcycle__small/000003.png") > 0
    truth, fill = (
        decode_png(batch / f"motorcycle__small__{method}/000003.png").astype(float)
        for method in ("reference", "telea")
    )
    assert np.array_equal(truth[~mask], fill[~mask])
    assert np.abs(truth[mask] - fill[mask]).mean() > 1


def test_building_again_changes_nothing_even_after_a_commit(copy, plan, inline, monkeypatch):
    monkeypatch.setattr(stimuli.batch.records, "code_revision", lambda: "abcdef0")
    before = contents(copy)
    stamp = (copy / "manifest.json").stat().st_mtime_ns
    outcome = build(plan, copy, inline)
    assert outcome.built == []
    assert contents(copy) == before
    assert (copy / "manifest.json").stat().st_mtime_ns == stamp


def test_a_changed_method_makes_only_its_own_clips_again(
    copy, small_study, inline, tmp_path, monkeypatch, read_plan
):
    study = tmp_path / "study"
    shutil.copytree(small_study.parent, study)
    path = study / small_study.name
    text = path.read_text()
    path.write_text(
        text.replace('name = "telea"', 'name = "telea"\nparameters = { radius_px = 7 }')
    )
    monkeypatch.setattr(stimuli.batch.clip, "take_survey", None)  # nothing is to be surveyed again
    outcome = build(read_plan(path), copy, inline)
    assert [str(name) for name in outcome.built] == [
        f"{scene}__small__telea" for scene in ("box", "motorcycle")
    ]
    assert len(outcome.kept) == 4
    assert check_batch(copy).in_order


def test_two_textures_of_one_base_name_are_two_files(small_study, tmp_path, read_plan):
    """Each changes the key of its scene's clips, and of no others."""
    study = tmp_path / "study"
    shutil.copytree(small_study.parent, study)
    for folder in ("a", "b"):
        (study / folder).mkdir()
        shutil.copy(study / "wall.png", study / folder / "t.png")
    box = box_document() | {
        "images": [{"uri": "a/t.png"}, {"uri": "b/t.png"}],
        "textures": [{"source": 0}, {"source": 1}],
    }
    box["materials"][1]["pbrMetallicRoughness"] = {"baseColorTexture": {"index": 1}}
    (study / "box.gltf").write_text(json.dumps(box))

    def keys() -> dict[str, str]:
        plan = read_plan(study / small_study.name)
        return {str(name): plan.clip_key(name) for name in plan.clip_names}

    for folder in ("a", "b"):
        before = keys()
        with (study / folder / "t.png").open("ab") as file:
            file.write(b"changed")
        after = keys()
        assert {name for name in after if after[name] != before[name]} == {
            name for name in after if name.startswith("box__")
        }


def test_another_rim_makes_only_the_photographs_clips_again(
    batch, copy, small_study, inline, tmp_path, read_plan
):
    """From the protocol to the pixels: holes, fills, the true view and what the manifest says."""
    study = tmp_path / "study"
    shutil.copytree(small_study.parent, study)
    path = study / small_study.name
    path.write_text(path.read_text().replace("offset_px =", "rim_px = 0\noffset_px ="))

    outcome = build(read_plan(path), copy, inline)

    assert all(str(name).startswith("motorcycle__") for name in outcome.built)
    assert len(outcome.built) == len(outcome.kept) == 3
    for folder, rim_px in ((batch, 1), (copy, 0)):
        for clip in read_manifest(folder).clips:
            expected = rim_px if clip.column("scene") == "motorcycle" else None
            assert clip.parameters.get("rim_px") == expected
            mended = None if expected is None else True
            assert clip.parameters.get("depth_speckle") is mended
    place = "000003.png"
    with_rim, bare = (
        decode_png(folder / "holes/motorcycle__small" / place) > 0 for folder in (batch, copy)
    )
    assert (with_rim >= bare).all()
    rim = with_rim & ~bare
    assert rim.sum() > 10
    for method in ("push-pull", "telea", "reference"):
        ours, theirs = (
            decode_png(folder / f"motorcycle__small__{method}" / place).astype(float)
            for folder in (batch, copy)
        )
        np.testing.assert_array_equal(ours[~with_rim], theirs[~with_rim])
        # Without a rim these pixels are the left photograph's; the true view has the right one's.
        assert np.abs(ours[rim] - theirs[rim]).mean() > 1


@pytest.mark.parametrize(
    ("value", "message"),
    [
        ("5", "scenes[1].rim_px: must be at most 4 pixels (got 5)"),
        ("-1", "scenes[1].rim_px: must be at least 0 pixels (got -1)"),
        ("1.0", "scenes[1].rim_px: must be a whole number (got 1.0)"),
        ("true", "scenes[1].rim_px: must be a whole number (got true)"),
    ],
)
def test_a_rim_that_is_none_is_refused(small_study, tmp_path, value, message):
    path = tmp_path / small_study.name
    text = small_study.read_text().replace("offset_px =", f"rim_px = {value}\noffset_px =")
    path.write_text(text)

    with pytest.raises(StudyError) as caught:
        load_protocol(path)

    assert message in str(caught.value)


def test_a_damaged_frame_is_made_again(copy, plan, inline):
    frame = copy / "box__small__telea/000002.png"
    before = contents(copy)
    frame.write_bytes(frame.read_bytes()[:-20])
    outcome = build(plan, copy, inline)
    assert [str(name) for name in outcome.built] == ["box__small__telea"]
    assert contents(copy) == before


def test_a_build_killed_after_its_manifest_is_whole_and_cleared_up(copy, plan, inline):
    left = copy / ".build" / "records"
    left.mkdir(parents=True)
    (left / "box__small__telea.json").write_text("{}")
    assert check_batch(copy).in_order
    assert build(plan, copy, inline).built == []
    assert not (copy / ".build").exists()


def test_a_build_killed_while_it_wrote_its_contact_sheet_goes_on(copy, plan, inline):
    before = contents(copy)
    left = copy / ".contact-sheet.html.4711.part"
    left.write_text("<html>half a page")
    (copy / "contact-sheet.html").unlink()

    outcome = build(plan, copy, inline)

    assert outcome.built == []
    assert not left.exists()
    assert (copy / "contact-sheet.html").exists()
    assert contents(copy) == before
    assert check_batch(copy).in_order


def test_check_names_what_is_missing_changed_and_extra(copy):
    (copy / "box__small__telea/000001.png").unlink()
    frame = copy / "box__small__telea/000002.png"
    frame.write_bytes(frame.read_bytes()[:-1] + b"x")
    (copy / "box__small__telea/notes.txt").write_text("mine")
    mask = copy / "holes/box__small/000000.png"
    mask.write_bytes(mask.read_bytes() + b" ")
    verdict = check_batch(copy)
    assert verdict.missing == ["box__small__telea/000001.png"]
    assert verdict.changed[0] == "box__small__telea/000002.png"
    assert verdict.changed[1].startswith("holes/box__small")
    assert verdict.extra == ["box__small__telea/notes.txt"]


@pytest.mark.timeout(3600)  # --full on a busy machine
@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"hole_share": 0.5}, "hole_share must be"),
        ({"parameters": {"hole_share_most": 0.9}}, "hole_share must be"),
        ({"width_px": 8}, "its first frame has"),
        ({"bit_depth": 16}, "its first frame has"),
    ],
)
def test_check_finds_a_manifest_that_its_own_frames_and_masks_contradict(copy, changes, said):
    path = copy / "manifest.json"
    raw = json.loads(path.read_text())
    clip = next(clip for clip in raw["clips"] if clip["name"] == "box__small__telea")
    for key, value in changes.items():
        clip[key] = {**clip[key], **value} if isinstance(value, dict) else value
    path.write_text(json.dumps(raw))
    (found,) = check_batch(copy).changed
    assert found.startswith("manifest.json (box__small__telea: ")
    assert said in found


@pytest.mark.slow
def test_a_killed_build_goes_on_to_the_same_bytes(small_study, batch, tmp_path, proof_count):
    """kill -9 after random amounts of work, then the same command until it ends."""
    kill_builds(small_study, batch, tmp_path / "clips", proof_count(20))


def test_a_frame_that_a_kill_cut_short_does_not_reach_the_clip(tmp_path):
    """The next build writes that frame anew, under another name: its process has another id."""
    source, target = tmp_path / "work", tmp_path / "clips" / "clip"
    source.mkdir()
    (source / "000000.png").write_bytes(b"whole")
    (source / ".000000.png.3971.part").write_bytes(b"wh")
    (source / ".000000.3971.tmp.exr").write_bytes(b"wh")

    move_over(source, target)

    assert [entry.name for entry in target.iterdir()] == ["000000.png"]


def test_a_second_build_into_one_folder_is_refused(plan, tmp_path, inline_class):
    out = tmp_path / "clips"

    class Meddler(inline_class):
        def submit(self, fn, /, *args, **kwargs):  # noqa: ARG002
            with pytest.raises(StudyError, match="another build is at work"):
                build(plan, out, inline_class())
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        build(plan, out, Meddler())


def test_a_folder_with_other_things_is_refused(plan, inline, tmp_path):
    (tmp_path / "thesis.tex").write_text("mine")
    with pytest.raises(StudyError, match=r"it holds thesis\.tex"):
        build(plan, tmp_path, inline)
    assert (tmp_path / "thesis.tex").exists()


def snapshot(folder: Path) -> dict[str, bytes]:
    return {str(p.relative_to(folder)): p.read_bytes() for p in folder.rglob("*") if p.is_file()}


@pytest.mark.parametrize(
    "mine",
    [
        "my__own__notes/read-me.txt",
        "holes/mine/mask.png",
        "holes/box__small/notes.txt",
        "holes/my__own/000000.png",
        "previews/mine.txt",
        "previews/mine.0123456789ab.webm",
        "box__small__telea/notes.txt",
        "box__small__telea/000000.png.bak",
        "box__small__telea/sub/000000.png",
        "box__small__telea/000099.png",
        "holes/box__small/000099.png",
        ".build/mine.txt",
        ".build/debug/program",
        f".build/clips/{'a' * 64}/thesis.txt",
        f".build/clips/{'a' * 64}/box__small__telea/notes/000000.png",
        f".build/surveys/{'a' * 64}/thesis.txt",
        f".build/{'a' * 64}.npz",
        ".build/records/thesis.txt",
        ".thesis.7.part",
        ".box__small__telea.7.part",
        "box__small__telea/.thesis.7.part",
        "holes/box__small/.thesis.7.part",
        "box__small__telea/000000.exr",
    ],
)
def test_what_no_build_recorded_as_its_own_is_refused_and_stays(copy, plan, inline, mine):
    """Also where a clip has to be made again, and where a study lost its clips."""
    (copy / mine).parent.mkdir(parents=True, exist_ok=True)
    (copy / mine).write_text("mine")
    (copy / "box__small__telea/000001.png").write_bytes(b"damaged")
    before = snapshot(copy)

    with pytest.raises(StudyError, match="which no build recorded as its own") as told:
        build(plan, copy, inline)
    assert mine in str(told.value)
    assert snapshot(copy) == before


@pytest.mark.parametrize(
    "mine",
    [
        "holes/a.png",
        "previews/a.webm",
        "contact-sheet.html",
        "manifest.json",
        ".build/x",
        "a__b__c/x",
    ],
)
def test_a_folder_that_no_build_made_is_refused_whatever_its_names(plan, inline, tmp_path, mine):
    (tmp_path / mine).parent.mkdir(exist_ok=True)
    (tmp_path / mine).write_text('{"name": "an extension of a browser"}')
    before = snapshot(tmp_path)

    with pytest.raises(StudyError, match="must be an empty folder or one that a build made"):
        build(plan, tmp_path, inline)
    assert snapshot(tmp_path) == before


@pytest.mark.parametrize("name", ["holiday", "my__own__frames"])
@pytest.mark.parametrize(
    "mine", ["{}/000000.png", "previews/{}.0123456789ab.webm", "holes/my__own/000000.png"]
)
def test_what_lies_where_an_edited_manifest_has_clips_stays(copy, plan, inline, name, mine):
    raw = json.loads((copy / "manifest.json").read_text())
    raw["clips"].append(raw["clips"][0] | {"name": name})
    (copy / "manifest.json").write_text(json.dumps(raw))
    (copy / mine.format(name)).parent.mkdir(exist_ok=True)
    (copy / mine.format(name)).write_text("mine")
    before = snapshot(copy)

    with pytest.raises(StudyError, match="which no build recorded as its own") as told:
        build(plan, copy, inline)
    assert mine.format(name) in str(told.value)
    assert snapshot(copy) == before


def test_frames_at_the_place_of_a_wanted_clip_that_is_none_of_them_stay(copy, plan, inline):
    """The manifest names the folder, and every frame in it is another."""
    for frame in (copy / "box__small__telea").glob("*.png"):
        frame.write_text("mine")
    before = snapshot(copy)

    with pytest.raises(StudyError, match=r"holds box__small__telea/000000\.png, which no build"):
        build(plan, copy, inline)
    assert snapshot(copy) == before


def test_work_under_a_hash_that_no_build_noted_stays(copy, plan, inline):
    """Work that a killed build had begun, and noted, goes on beside it."""
    claim(copy, [], ["b" * 64])
    for key in ("a" * 64, "b" * 64):
        (copy / f".build/clips/{key}").mkdir(parents=True)
        (copy / f".build/clips/{key}/000000.png").write_text("mine")
    before = snapshot(copy)

    with pytest.raises(StudyError, match=f"holds .build/clips/{'a' * 64}/000000.png, which no"):
        build(plan, copy, inline)
    assert snapshot(copy) == before

    shutil.rmtree(copy / f".build/clips/{'a' * 64}")
    assert not build(plan, copy, inline).built
    assert not (copy / ".build").exists()


def test_what_is_put_into_the_work_of_a_build_meanwhile_stays(copy, plan, inline, monkeypatch):
    (copy / "box__small__telea/000001.png").write_bytes(b"damaged")
    real = stimuli.batch.clip_build.remove_strangers

    def meanwhile(out: Path, names) -> None:
        (out / ".build" / "clips" / "thesis.txt").write_text("mine")
        real(out, names)

    monkeypatch.setattr(stimuli.batch.clip_build, "remove_strangers", meanwhile)
    build(plan, copy, inline)

    assert snapshot(copy / ".build") == {"clips/thesis.txt": b"mine"}


@pytest.mark.parametrize("noted", ["..", "../other", ".", "", "/"])
def test_notes_of_a_build_lead_to_nothing_outside_its_folder(copy, noted):
    beside = copy.parent / "000000.png"
    beside.write_text("mine")
    (copy.parent / "other").mkdir()
    (copy.parent / "other/000000.png").write_text("mine")
    (copy / ".build").mkdir()
    (copy / ".build/names.json").write_text(json.dumps([noted]))

    remove_strangers(copy, [clip.name for clip in read_manifest(copy).clips])

    assert beside.exists()
    assert (copy.parent / "other/000000.png").exists()


def test_clips_that_a_study_lost_go_and_nothing_else(copy, plan, inline, monkeypatch):
    """Files that somebody puts into a folder while the build is at work stay, too."""
    fewer = [name for name in plan.clip_names if name.method != "telea"]
    kept_method = plan.study.warped.methods[:-1]
    recipe = plan.study.warped.model_copy(update={"methods": kept_method})
    smaller = dataclasses.replace(plan, study=plan.study.model_copy(update={"stimuli": recipe}))
    assert list(smaller.clip_names) == fewer
    real = stimuli.batch.clip_build.remove_strangers

    def meanwhile(out: Path, names) -> None:
        (out / "box__small__telea" / "mine.txt").write_text("mine")
        real(out, names)

    monkeypatch.setattr(stimuli.batch.clip_build, "remove_strangers", meanwhile)
    build(smaller, copy, inline)

    left = sorted(p.name for p in (copy / "box__small__telea").iterdir())
    assert left == ["mine.txt"]
    assert not (copy / "motorcycle__small__telea").exists()
    assert not [p for p in (copy / "previews").iterdir() if "telea" in p.name]


def test_a_symbolic_link_is_neither_followed_nor_taken_for_a_frame(copy, plan, inline, tmp_path):
    elsewhere = tmp_path / "elsewhere"
    (copy / "box__small__telea").rename(elsewhere)
    (copy / "box__small__telea").symlink_to(elsewhere)
    assert check_batch(copy).extra == ["box__small__telea"]
    before = snapshot(elsewhere)
    with pytest.raises(StudyError, match="box__small__telea, a symbolic link"):
        build(plan, copy, inline)
    assert snapshot(elsewhere) == before

    (copy / "box__small__telea").unlink()
    shutil.copytree(elsewhere, copy / "box__small__telea")
    frame = copy / "box__small__telea" / "000001.png"
    frame.unlink()
    frame.symlink_to(elsewhere / "000001.png")
    assert check_batch(copy).changed == [
        "box__small__telea/000001.png (a symbolic link in its place)"
    ]


def test_a_full_disk_leaves_nothing_that_looks_finished(tmp_path, plan, inline, monkeypatch, batch):
    """fsync is where a full disk speaks up; after it has room again, the build goes on."""
    out = tmp_path / "clips"
    calls = []

    def full(handle: int) -> None:
        calls.append(handle)
        if len(calls) > 12:
            raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(OSError, match="No space left"):
        build(plan, out, inline)
    monkeypatch.undo()
    assert not (out / "manifest.json").exists()
    assert not list(out.rglob("*.part"))
    assert all(is_whole_png(path.read_bytes()) for path in out.rglob("*.png"))
    build(plan, out, inline)
    assert contents(out) == contents(batch)


@pytest.mark.slow
def test_a_limit_on_file_size_ends_with_one_message(small_study, tmp_path):
    """The real thing, in a process of its own: files may not grow past 4 KiB."""
    script = (
        "import resource; resource.setrlimit(resource.RLIMIT_FSIZE, (4096, 4096));"
        "from study_app.cli import main; main()"
    )
    result = forked.run(
        "stimuli", "build", small_study, "--out", tmp_path / "clips", "--workers", "1",
        code=script, timeout=240, env={**os.environ, "MESA_SHADER_CACHE_DISABLE": "1"},
    )  # fmt: skip
    assert result.returncode == 2, result.stderr
    assert "Traceback" not in result.stderr
    assert not (tmp_path / "clips/manifest.json").exists()


def test_a_killed_worker_ends_with_a_message(plan, tmp_path, inline_class):
    from stimuli.batch.executors import local_processes

    with local_processes(1) as pool:

        class Murderer(inline_class):
            count = 0

            def submit(self, fn, /, *args, **kwargs):
                self.count += 1
                if self.count == 2:
                    return pool.submit(os.kill, next(iter(pool._processes)), signal.SIGKILL)
                return pool.submit(fn, *args, **kwargs)

        with pytest.raises(StudyError, match="a worker process was killed"):
            build(plan, tmp_path / "clips", Murderer())
    assert not (tmp_path / "clips/manifest.json").exists()


def test_no_scheduler_at_the_address_is_said():
    from stimuli.batch.executors import dask_cluster

    pytest.importorskip("distributed")
    import stimuli.batch.executors

    before, stimuli.batch.executors.CONNECT_S = stimuli.batch.executors.CONNECT_S, 0.3
    try:
        with (
            pytest.raises(StudyError, match="must be the address of a running Dask scheduler"),
            dask_cluster("tcp://127.0.0.1:9"),
        ):
            pass
    finally:
        stimuli.batch.executors.CONNECT_S = before


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ('name = "telea"', 'name = "telia"', "did you mean 'telea'"),
        ('file = "box.gltf"', 'file = "bax.gltf"', "bax.gltf"),
        ('kind = "mesh"\nfile = "box.gltf"', 'kind = "builtin"\nbuiltin = "gardn"', "garden"),
        ("extent_m = 0.16", "extent_m = 90.0", r"^\w+, \w+: (?!motor)[^:]*extent[^:]* must "),
        ("extent_m = 0.16", "hole_share = 0.45", r"^\w+, \w+: the path must uncover 45 %"),
    ],
)
def test_what_cannot_be_built_is_said_in_one_message(
    small_study, tmp_path, old, new, message, inline_class, read_plan
):
    from typer.testing import CliRunner

    from study_app.cli.stimuli_commands import app

    study = tmp_path / "study"
    shutil.copytree(small_study.parent, study)
    path = study / small_study.name
    text = path.read_text().replace(old, new).replace('worse = "telea"', 'worse = "push-pull"')
    if "telia" in new:
        text = text.replace('"telea"', '"telia"')
    path.write_text(text)
    if "must" in message:
        with pytest.raises(InputError, match=message):
            build(read_plan(path), tmp_path / "clips", inline_class())
    else:
        result = CliRunner().invoke(app, ["build", str(path), "--out", str(tmp_path / "clips")])
        assert result.exit_code == 2
        assert message in result.stderr
    assert not (tmp_path / "clips/manifest.json").exists()


def test_a_refused_build_shows_its_message_and_no_bar(small_study, tmp_path):
    from typer.testing import CliRunner

    from study_app.cli.stimuli_commands import app

    taken = tmp_path / "clips"
    taken.write_text("a file of one's own")

    result = CliRunner().invoke(app, ["build", str(small_study), "--out", str(taken)])

    assert result.exit_code == 2
    assert result.stderr.strip().startswith(f"error: {taken}")
    assert taken.read_text() == "a file of one's own"


@pytest.mark.parametrize(
    ("said", "told"),
    [
        ("extent_m must be at most 1 m", "box, small: extent_m must be at most 1 m"),
        ("box: extent_m must be at most 1 m", "box, small: extent_m must be at most 1 m"),
        ("box, small: the path must end", "box, small: the path must end"),
        ("box__small__reference: no frame", "box__small__reference: no frame"),
        ("box__small__reference: box: no frame", "box__small__reference: no frame"),
        ("box.gltf: is broken", "box, small: box.gltf: is broken"),
    ],
)
def test_a_mistake_is_placed_once(plan, tmp_path, inline_class, said, told):
    class Failing(inline_class):
        def submit(self, fn, /, *args, **kwargs):
            if fn is describe_renderer:
                return super().submit(fn, *args, **kwargs)
            future = Future()
            if args[1].scene == "box":
                future.set_exception(InputError(said))
            return future

    with pytest.raises(InputError) as error:
        build(plan, tmp_path / "clips", Failing())
    assert str(error.value) == told


def test_a_dry_run_states_clips_frames_disk_and_time_and_writes_nothing(small_study, tmp_path):
    result = forked.run("stimuli", "build", small_study, "--out", tmp_path / "clips", "--dry-run")
    assert result.returncode == 0, result.stderr
    assert re.search(r"clips\s+6", result.stdout)
    assert re.search(r"frames\s+24, 78 x 58 px", result.stdout)
    assert re.search(r"disk\s+[\d.]+ GiB", result.stdout)
    assert re.search(r"time\s+about \d+ ", result.stdout)
    assert re.search(r"measured\s+one frame of \S+ by every method", result.stdout)
    assert not (tmp_path / "clips").exists()


@pytest.mark.parametrize("files", [False, True])
def test_software_times_a_smaller_frame_and_counts_its_pixels(
    small_study, read_plan, tmp_path, monkeypatch, files
):
    """A clock that ticks once per reading makes the estimate a count of frames' work."""
    shapes = []

    def told(colour, _):
        shapes.append(colour.shape)
        return b"x" * (3 * colour.shape[0] * colour.shape[1])

    if files:  # what is on disk fits one size
        study = Path(shutil.copytree(small_study.parent, tmp_path / "study")) / small_study.name
        (study.parent / "filled").mkdir()
        for index in range(4):
            Image.new("RGB", (78, 58)).save(study.parent / f"filled/{index:06d}.png")
        text = study.read_text()
        study.write_text(text.replace('name = "telea"', 'name = "telea"\nmethod = "frames:filled"'))
    plan = read_plan(study if files else small_study)
    ticks = itertools.count()
    monkeypatch.setattr(
        stimuli.batch.estimate,
        "time",
        types.SimpleNamespace(perf_counter=lambda: float(next(ticks))),
    )
    monkeypatch.setattr(stimuli.batch.estimate, "encode_frame", told)
    monkeypatch.setattr("pipeline.gl.context.SOFTWARE_RENDERERS", ("",))  # every name
    width, height = plan.render_px
    found = []
    for edge in (width, 39):
        monkeypatch.setattr(stimuli.batch.estimate, "TRIED_PX", edge)
        found.append(stimuli.batch.estimate.estimated_build(plan, tmp_path, 1))
    whole, part = found
    opened_s = 2.0  # a tick for each of two scenes
    ratio = 1.0 if files else 4.0
    assert shapes[-1] == ((height, width, 3) if files else (29, 39, 3))
    assert (part.time_s - opened_s) / (whole.time_s - opened_s) == pytest.approx(ratio)
    assert part.disk_bytes == whole.disk_bytes
    assert part.size_px == whole.size_px
