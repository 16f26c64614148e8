"""A study in one file: whole or not there, proven whole, and never a trap."""

import os
import re
import shutil
import stat
import zipfile
from pathlib import Path

import pytest
from command_line import metamerlab, result_of

from protocols.disk.hashing import sha256_bytes
from protocols.feasibility import virtual_manifest
from protocols.load import load_display, load_protocol, shipped
from protocols.manifest import write_manifest
from study_app.archive.read_archive import INDEX_NAME, ArchivedFile, Index
from study_app.cli import new_study_command
from study_app.simulate import SimulatedStudy, simulate_session

SECRET = "a secret of the lab"
session = result_of("session", terminal_width=200)


@pytest.fixture(scope="module")
def lab(tmp_path_factory) -> Path:
    """A study with a secret, its display, two sessions and the clips' manifest."""
    root = tmp_path_factory.mktemp("lab")
    folder = root / "my-study"
    folder.mkdir()
    text = shipped("studies")["demo"].read_text(encoding="utf-8")
    text = text.replace('display = "fhd27-60hz"', 'display = "my-display.toml"')
    text = text.replace(
        "[privacy]", f'[privacy]\nsecret_sha256 = "{sha256_bytes(SECRET.encode())}"'
    )
    (folder / "study.toml").write_text(text, encoding="utf-8")
    (folder / "study.secret").write_text(SECRET + "\n")
    shutil.copy(shipped("displays")["fhd27-60hz"], folder / "my-display.toml")
    study = load_protocol(folder / "study.toml")
    display = load_display("fhd27-60hz")
    manifest = virtual_manifest(study, display)
    (root / "clips").mkdir()
    write_manifest(root / "clips", manifest)
    simulation = SimulatedStudy(study, display, gaze_rate_hz=60, manifest=manifest)
    for code in ("S001", "S002"):
        simulate_session(simulation, root / "sessions", code)
    (root / "sessions" / "another-study").mkdir()
    return root


@pytest.fixture
def here(lab, tmp_path, monkeypatch) -> Path:
    """The lab's folder as a copy that a test may change, and is in."""
    shutil.copytree(lab, tmp_path / "lab")
    monkeypatch.chdir(tmp_path / "lab")
    return tmp_path / "lab"


@pytest.fixture(scope="module")
def made(lab) -> bytes:
    """An archive of the lab, with its secret."""
    out = lab / "made.zip"
    session(
        "archive", lab / "my-study/study.toml", "--sessions", lab / "sessions", "--out", out,
        "--with-secret",
    )  # fmt: skip
    data = out.read_bytes()
    out.unlink()
    return data


@pytest.fixture
def backup(made, tmp_path, monkeypatch) -> Path:
    """A folder with that archive alone, as the current one."""
    monkeypatch.chdir(tmp_path)
    Path("backup.zip").write_bytes(made)
    return tmp_path


def archived(*more: object, out: str = "backup.zip"):
    return session("archive", "my-study/study.toml", "--stimuli", "clips", "--out", out, *more)


def test_an_archive_holds_the_study_and_its_sessions_byte_for_byte(here):
    said = archived().output
    with zipfile.ZipFile("backup.zip") as archive:
        names = set(archive.namelist())
        for name in names - {INDEX_NAME, "study/study.toml", "study/my-display.toml"}:
            assert archive.read(name) == (here / name).read_bytes()
        index = Index.model_validate_json(archive.read(INDEX_NAME))

    assert "whole (demo: 2 sessions" in said
    assert index.sha256 in said
    assert {"study/my-display.toml", "clips/manifest.json"} < names
    assert {f"sessions/demo/S00{n}/journal.jsonl" for n in (1, 2)} < names
    kept = {p.relative_to(here).as_posix() for p in here.glob("sessions/demo/**/*") if p.is_file()}
    assert kept <= names
    assert stat.S_IMODE(Path("backup.zip").stat().st_mode) == 0o600
    session("verify", "backup.zip")


@pytest.mark.usefixtures("here")
def test_equal_studies_make_equal_archives_and_none_is_written_over():
    archived(out="one.zip")
    archived(out="two.zip")
    assert Path("one.zip").read_bytes() == Path("two.zip").read_bytes()

    Path("two.zip").write_bytes(b"mine")
    done = session("archive", "my-study/study.toml", "--out", "two.zip", status=None)
    assert (done.exit_code, Path("two.zip").read_bytes()) == (2, b"mine")
    assert "must not exist yet" in done.output


@pytest.mark.usefixtures("here")
def test_a_secret_is_in_it_where_it_is_asked_for():
    archived(out="plain.zip")
    archived("--with-secret", out="asked.zip")

    def held(name):
        with zipfile.ZipFile(name) as archive:
            return "study/study.secret" in archive.namelist()

    assert (held("plain.zip"), held("asked.zip")) == (False, True)
    assert "not compared with the plan" in session("verify", "plain.zip", status=None).output
    assert "not compared" not in session("verify", "asked.zip", status=None).output
    assert SECRET.encode() not in Path("plain.zip").read_bytes()


@pytest.mark.parametrize(("name", "plain"), [("b.zip.age", "b.zip"), ("backup", "backup.zip")])
def test_an_archive_that_0_3_encrypted_is_refused_with_the_cure(tmp_path, name, plain):
    sealed = tmp_path / name
    sealed.write_bytes(b"age-encryption.org/v1\n-> scrypt c2FsdA 18\n" + bytes(range(256)))
    done = session("verify", sealed, status=2)

    assert done.output.startswith(f"error: {sealed}: must be a plain archive (it is encrypted")
    assert f"'age --decrypt --output {tmp_path / plain} {sealed}'" in done.output
    assert done.output.endswith(f"then verify {tmp_path / plain}\n")


@pytest.mark.usefixtures("backup")
def test_it_is_restored_whole_by_unzip():
    with zipfile.ZipFile("backup.zip") as archive:
        archive.extractall("two")

    session("verify", "two")
    session("verify", "two/sessions", "--protocol", "two/study/study.toml")
    assert Path("two/study/study.secret").read_text() == SECRET + "\n"
    Path("two/study/mine.txt").touch()
    assert "study/mine.txt is not of the archive" in session("verify", "two", status=None).output
    next(Path("two").rglob("flips/*.csv")).write_text("x")
    assert "was changed" in session("verify", "two", status=None).output


def test_what_is_not_as_it_was_recorded_is_archived_on_demand_alone(here):
    side = next(Path("sessions").rglob("flips/*.csv"))
    side.write_bytes(side.read_bytes() + b"\n")
    done = session("archive", "my-study/study.toml", "--out", "b.zip", status=None)

    assert (done.exit_code, Path("b.zip").exists()) == (2, False)
    assert f"{side.parent.name}/{side.name} was changed" in done.output
    assert not list(here.glob(".b.zip*"))
    archived("--as-it-is", out="b.zip")
    session("verify", "b.zip", status=2)


def test_frames_go_along_on_demand_and_must_be_those_of_the_manifest(here):
    study = load_protocol(Path("my-study/study.toml"))
    full = virtual_manifest(study, load_display("fhd27-60hz"))
    frames = {c.name: [f"{c.name} {n}".encode() for n in range(30)] for c in full.clips}
    clips = tuple(
        c.model_copy(update={"frames_sha256": tuple(map(sha256_bytes, frames[c.name]))})
        for c in full.clips
    )
    Path("clips/manifest.json").unlink()
    write_manifest(here / "clips", full.model_copy(update={"clips": clips}))
    for clip in clips:
        for number, data in enumerate(frames[clip.name]):
            place = Path("clips", clip.frame_path(number))
            place.parent.mkdir(exist_ok=True)
            place.write_bytes(data)
    archived("--with-clips")
    assert "clips, no secret" in session("verify", "backup.zip", status=None).output

    place.write_bytes(b"another")
    done = session(
        "archive",
        "my-study/study.toml",
        "--stimuli",
        "clips",
        "--with-clips",
        "--out",
        "c.zip",
        status=None,
    )
    assert (done.exit_code, "is not the frame that its manifest has" in done.output) == (2, True)


def rewritten(change) -> None:
    """Write the archive anew, its members changed by name."""
    with zipfile.ZipFile("backup.zip") as archive:
        members = {info.filename: archive.read(info) for info in archive.infolist()}
    change(members)
    with zipfile.ZipFile("backup.zip", "w", zipfile.ZIP_DEFLATED) as archive:
        for name, data in members.items():
            archive.writestr(name, data)


JOURNAL = "sessions/demo/S001/journal.jsonl"


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda m: m.pop(JOURNAL), "must hold the files of its list"),
        (lambda m: m.update({"sessions/demo/S009/journal.jsonl": b""}), "must hold the files"),
        (lambda m: m.update({JOURNAL: m[JOURNAL][:-200]}), f"{JOURNAL} was changed"),
        (lambda m: m.update({"study/study.toml": m["study/study.toml"] + b"\n# x"}), "was changed"),
        (lambda m: m.update({INDEX_NAME: m[INDEX_NAME].replace(b"demo/S001", b"demo/../.")}),
         "as it was written"),
        (lambda m: m.update({INDEX_NAME: b"{}"}), "as it was written"),
        (lambda m: m.pop(INDEX_NAME), "must be an archive of"),
        (lambda m: m.update({"../evil": b"x"}), "inside the archive's own folder"),
        (lambda m: m.update({"/evil": b"x"}), "inside the archive's own folder"),
        (lambda m: m.update({"C:\\evil": b"x"}), "a name must be plain"),
        (lambda m: m.update({"study/evil/": b""}), "inside the archive's own folder"),
    ],
)  # fmt: skip
def test_a_changed_or_hostile_archive_is_one_message_and_nothing_is_unpacked(backup, change, said):
    rewritten(change)
    before = set(backup.rglob("*"))
    done = session("verify", "backup.zip", status=2)
    assert said in done.output
    assert "Traceback" not in done.output
    assert set(backup.rglob("*")) == before


def test_links_bombs_and_doubled_names_are_refused(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)

    def refused(fill) -> str:
        Path("evil.zip").unlink(missing_ok=True)
        with zipfile.ZipFile("evil.zip", "w", zipfile.ZIP_DEFLATED) as archive:
            fill(archive)
        done = session("verify", "evil.zip", status=None)
        assert (done.exit_code, [*Path().iterdir()]) == (2, [Path("evil.zip")])
        return done.output

    link = zipfile.ZipInfo("study/link")
    link.external_attr = (stat.S_IFLNK | 0o777) << 16
    assert "no link" in refused(lambda archive: archive.writestr(link, "/etc/passwd"))
    with pytest.warns(UserWarning, match="Duplicate"):
        assert "once" in refused(lambda a: [a.writestr("x", b"1"), a.writestr("x", b"2")])

    monkeypatch.setenv("METAMERLAB_LIMITS", "unpacked=1e6")
    assert "must unpack to at most" in refused(lambda a: a.writestr("zeros", bytes(40 << 20)))


@pytest.mark.usefixtures("backup")
def test_no_byte_of_an_archive_can_be_harmed_unnoticed(made, rng, proof_count):
    data = made
    whole = session("verify", "backup.zip", status=None).output.splitlines()[-1]
    for place in rng.integers(0, len(data), proof_count(100)):
        Path("backup.zip").write_bytes(
            data[:place] + bytes([data[place] ^ 0x55]) + data[place + 1 :]
        )
        done = session("verify", "backup.zip", status=None)
        assert done.exit_code in (0, 2), done.exception
        if done.exit_code == 0:  # a byte that says nothing, such as a date
            assert done.output.splitlines()[-1] == whole


def test_a_full_disk_leaves_nothing_behind(here, monkeypatch):
    def full(*_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("study_app.archive.write_archive.os.fsync", full)
    done = session("archive", "my-study/study.toml", "--out", "b.zip", status=None)
    assert (done.exit_code, "the disk refused" in done.output) == (2, True)
    assert not [path for path in here.iterdir() if "b.zip" in path.name]


# --- secrets -------------------------------------------------------------------------------------


def test_a_secret_is_nobody_else_s_to_read_from_its_first_byte(tmp_path, monkeypatch):
    """Before, it was written for everybody to read, and closed a moment later."""
    modes = []
    open_new = new_study_command.open_new

    def seen(path: str, flags: int) -> int:
        descriptor = open_new(path, flags)
        if path.endswith(".secret"):
            modes.append(stat.S_IMODE(os.fstat(descriptor).st_mode))
        return descriptor

    monkeypatch.setattr(new_study_command, "open_new", seen)
    metamerlab("new-study", str(tmp_path / "mine"))

    assert modes == [0o600]
    assert stat.S_IMODE((tmp_path / "mine/study.secret").stat().st_mode) == 0o600


@pytest.mark.usefixtures("backup")
def test_what_is_wrong_inside_is_found_without_unpacking(monkeypatch):
    def changed(members):
        place = next(name for name in members if "/flips/" in name)
        members[place] += b"\n"
        index = Index.model_validate_json(members[INDEX_NAME])
        entries = tuple(
            entry.model_copy(
                update={"bytes": len(members[place]), "sha256": sha256_bytes(members[place])}
            )
            if entry.path == place
            else entry
            for entry in index.files
        )
        members[INDEX_NAME] = index.model_copy(update={"files": entries}).to_bytes()

    rewritten(changed)
    monkeypatch.setattr("tempfile.mkdtemp", lambda *_, **__: pytest.fail("a folder was made"))
    done = session("verify", "backup.zip", status=2)

    assert re.search(r"S00\d: flips/\d+\.csv was changed", done.output)


@pytest.mark.usefixtures("backup")
def test_a_file_that_is_a_folder_as_well_is_refused_by_verify_too():
    def both(members):
        index = Index.model_validate_json(members[INDEX_NAME])
        more = ArchivedFile(path="study/study.toml/x", bytes=1, sha256=sha256_bytes(b"x"))
        members[more.path] = b"x"
        entries = (*index.files, more)
        members[INDEX_NAME] = index.model_copy(update={"files": entries}).to_bytes()

    rewritten(both)
    done = session("verify", "backup.zip", status=None)
    assert (done.exit_code, "must not be a folder as well" in done.output) == (2, True)
