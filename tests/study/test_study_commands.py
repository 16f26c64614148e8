"""`metamerlab protocol` and `metamerlab session` as a user types them."""

import json
import re
import resource
import shutil
from pathlib import Path

import jsonschema
import pytest
from command_line import result_of
from typer.testing import Result

from protocols.feasibility import virtual_manifest
from protocols.formats.format_reference import schema_path
from protocols.journal_file import read_journal
from protocols.load import load_display, load_protocol, shipped
from protocols.manifest import write_manifest

DEMO = shipped("studies")["demo"].read_text(encoding="utf-8")
metamerlab = result_of(terminal_width=100)


def refused(result: Result) -> str:
    """The message of a user's mistake: status 2, nothing on stdout, no traceback."""
    assert result.exit_code == 2, result.output
    assert result.stderr.startswith("error: ")
    assert "Traceback" not in result.stderr
    assert result.stdout == ""
    return result.stderr.removeprefix("error: ").replace("\n       ", "\n").strip()


@pytest.fixture
def study(tmp_path):
    """A small valid study whose methods every installation has; edit it with replacements."""

    def write(*replacements: tuple[str, str]) -> Path:
        text = DEMO.replace('name = "metameric"\n', 'name = "metameric"\nmethod = "telea"\n', 1)
        text = text.replace('name = "push-pull"\n', 'name = "push-pull"\nmethod = "telea"\n', 1)
        for old, new in replacements:
            assert old in text
            text = text.replace(old, new, 1)
        path = tmp_path / "pilot.toml"
        path.write_text(text, encoding="utf-8")
        return path

    return write


def test_check_says_in_order_and_names_the_hash(study):
    path = study()
    result = metamerlab("protocol", "check", path)

    assert result.stdout.startswith("demo: in order. 24 decisions on fhd27-60hz, protocol ")
    assert load_protocol(path).sha256[:12] in result.stdout


def test_check_tells_unknown_methods_and_parameters_and_what_the_display_cannot_do(study):
    path = study(
        ('method = "telea"', 'method = "telae"'),
        ('label = "Metameric"', 'label = "Metameric"\nparameters = { radiuss_px = 3.0 }'),
        ("gap_s = 0.5", "gap_s = 0.513"),
    )
    lines = refused(metamerlab("protocol", "check", path, status=None)).splitlines()

    assert len(lines) == 3
    assert "stimuli.methods[1].method: method must be one of metameric" in lines[0]
    assert lines[0].endswith("; the true view is 'reference'")
    assert "did you mean 'telea'?" in lines[0]
    assert "stimuli.methods[2].parameters.radiuss_px: parameters of telea are:" in lines[1]
    assert "task.gap_s: must be whole refreshes at 60 Hz" in lines[2]


def test_check_tells_every_parameter_out_of_its_range_as_a_build_does(study, tmp_path):
    wrong = "{ share = 7.0, gaze_x_deg = 3.0, depth_threshold = 0.04 }"
    path = study(
        ('name = "metameric"\nmethod = "telea"',
         'name = "metameric"\nmethod = "coherence-transport"'),
        ('label = "Push-pull"', 'label = "Push-pull"\nparameters = { gamma = 1.0 }'),
        ('label = "Metameric"', f'label = "Metameric"\nparameters = {wrong}'),
    )  # fmt: skip
    for words in (("protocol", "check", path), ("stimuli", "build", path, "--out", tmp_path / "c")):
        said = refused(metamerlab(*words, status=None)).splitlines()
        assert [line.removeprefix(f"{path}: stimuli.methods") for line in said] == [
            "[1].parameters.gamma: parameters of telea are: radius_px (got 'gamma')",
            "[2].parameters.share: share must lie in [0, 1] (got 7.0)",
            "[2].parameters.gaze_x_deg: gaze_x_deg (got 3.0) is for a fill by eccentricity and"
            " needs fovea_deg above 0, how far around the gaze transport works; give it, too",
        ]


def test_check_on_another_display_and_with_clips_that_are_not_there(study, tmp_path):
    path = study()
    message = refused(
        metamerlab("protocol", "check", path, "--display", "fhd24-144hz", status=None)
    )
    assert "stimuli.clips.fps: every clip frame must last whole refreshes at 144 Hz" in message
    message = refused(metamerlab("protocol", "check", path, "--stimuli", tmp_path, status=None))
    assert "must hold a finished batch of clips (there is no manifest.json)" in message


def test_check_tells_retired_methods_and_unknown_scenes(study):
    path = study(
        ('method = "telea"', 'method = "shift-map"'),
        ('builtin = "colonnade"', 'builtin = "colonade"'),
        ('name = "reference"\n', 'name = "reference"\nparameters = { noise = 1.0 }\n'),
    )
    first, gone, scene = refused(metamerlab("protocol", "check", path, status=None)).splitlines()
    assert first.endswith("methods[0].parameters.noise: the true view takes none (got noise)")
    assert "stimuli.methods[1].method: method 'shift-map' has left metamerlab" in gone
    assert "stimuli.scenes[1].builtin: a built-in scene must be one of garden" in scene
    assert "did you mean 'colonnade'?" in scene


@pytest.mark.parametrize("name", sorted(shipped("studies")))
def test_a_shipped_study_is_in_order(name):
    result = metamerlab("protocol", "check", name)

    assert result.stdout.startswith(f"{name}: in order.")


@pytest.mark.slow
@pytest.mark.parametrize("name", sorted(shipped("studies")))
def test_show_prints_trials_duration_memory_and_every_display(name):
    result = metamerlab("protocol", "show", name, "--slot", "1")

    for word in ("decisions", "duration", "memory", "MiB", "Trials of slot 1", "main-0000"):
        assert word in result.stdout
    for display in shipped("displays"):
        assert display in result.stdout
    assert load_protocol(Path(name)).sha256[:20] in result.stdout


@pytest.mark.parametrize("name", ["study", "display", "manifest", "journal"])
def test_schema_prints_the_published_file(name):
    result = metamerlab("protocol", "schema", name, status=None)

    assert result.stdout == schema_path(name).read_text(encoding="utf-8")
    jsonschema.Draft202012Validator.check_schema(json.loads(result.stdout))
    assert "nothing to change" in metamerlab("protocol", "schema", "--write", status=None).stdout


def test_schema_of_an_unknown_format_is_refused():
    message = refused(metamerlab("protocol", "schema", "clip", status=None))
    known = "study, display, manifest, journal, plan, script, web-study, web-line, results"
    assert message.startswith(f"FORMAT: must be one of {known} (got 'clip')")


@pytest.mark.parametrize("suffix", [".md", ".html"])
def test_preregister_writes_design_rules_and_hashes_once(study, tmp_path, suffix):
    path, out = study(("against", "against")), tmp_path / f"prereg{suffix}"
    metamerlab("protocol", "preregister", path, "--out", out)
    text = out.read_text(encoding="utf-8")

    protocol = load_protocol(path)
    for part in (
        protocol.sha256, protocol.stimuli_sha256, "24 decisions per participant",
        "Primary comparison: metameric against push-pull", "less than 80 % of the decisions",
        "alpha 0.05", "not built yet",
    ):  # fmt: skip
        assert part in text
    assert "never written over" in refused(
        metamerlab("protocol", "preregister", path, "--out", out, status=None)
    )
    assert out.read_text(encoding="utf-8") == text


def test_a_full_disk_leaves_no_half_of_a_new_file(study, tmp_path):
    """The kernel takes part of the text and refuses the rest; then there is room again."""
    path, written = study(), [tmp_path / name for name in ("copy.toml", "prereg.md")]
    commands = (
        ("protocol", "copy", "demo", written[0]),
        ("protocol", "preregister", path, "--out", written[1]),
    )
    for words, out in zip(commands, written, strict=True):
        limit = resource.getrlimit(resource.RLIMIT_FSIZE)
        resource.setrlimit(resource.RLIMIT_FSIZE, (700, limit[1]))
        try:
            said = refused(metamerlab(*words, status=None)).lower()
        finally:
            resource.setrlimit(resource.RLIMIT_FSIZE, limit)
        assert "file too large" in said
        assert not out.exists()
        metamerlab(*words)


def test_preregister_says_what_is_read_why_so_many_when_it_stops_and_its_power(study, tmp_path):
    path = study()
    bare = metamerlab("protocol", "preregister", path, status=None).stdout
    assert "The reason for this number is not stated." in bare
    assert "Power is not stated." in bare
    assert "no earlier looks are planned" in bare
    texts = load_protocol(path).text
    english = texts.languages[texts.default_language]
    for text in (english.consent, *english.instructions, english.question):
        assert " ".join(text.split()) in bare
    (tmp_path / "power").mkdir()
    found = {"participants": [4, 8], "planned": 8, "primary": [0.3, 0.612], "each": [0.1, 0.5],
             "studies": 900, "assumptions": {"rate": 0.65, "scene_sd": 0.4}}  # fmt: skip
    (tmp_path / "power" / "power.json").write_text(json.dumps(found))

    words = ("--power", tmp_path / "power", "--why", "A day of sessions.")
    told = metamerlab("protocol", "preregister", path, *words, status=None).stdout

    assert "Reason for this number: A day of sessions." in told
    assert "900 simulated studies of this design with 8 participants: 0.61 that the" in told
    assert "rate 0.65, scene sd 0.4" in told
    for harmed in ({"planned": 5}, {"participants": None}, {"assumptions": []}):
        (tmp_path / "power" / "power.json").write_text(json.dumps(found | harmed))
        message = refused(metamerlab("protocol", "preregister", path, *words, status=None))
        assert "--power: must be the power.json" in message


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("widht_px = 1920\nheight_px = 1080\n", "did you mean 'width_px'"),
        ("[display]\nname = 'x'\n", "must be a study, with [study]"),
        ("nme = 'x'\n", "or a display (has nme)"),
        ("", "(has nothing)"),
    ],
)
def test_a_file_that_is_no_study_is_told_in_few_lines(tmp_path, text, said):
    (tmp_path / "display.toml").write_text(text)
    message = refused(metamerlab("protocol", "check", tmp_path / "display.toml", status=None))
    assert said in message
    assert "stimuli: missing" not in message


def test_preregister_escapes_what_the_protocol_says(study, tmp_path):
    path = study(("A short version", "A <script>alert(1)</script> version"))
    out = tmp_path / "prereg.html"
    metamerlab("protocol", "preregister", path, "--out", out)

    text = out.read_text(encoding="utf-8")
    assert "<script>" not in text
    assert "&lt;script&gt;" in text
    message = refused(
        metamerlab("protocol", "preregister", path, "--out", tmp_path / "a.pdf", status=None)
    )
    assert "must end in .md or .html" in message


def test_simulate_list_and_status_tell_one_story(tmp_path):
    root = tmp_path / "sessions"
    result = metamerlab("session", "simulate", "demo", "--out", root, "--participants", 2)
    assert result.stdout.strip().endswith("2 simulated sessions, 48 decisions")

    listed = metamerlab("session", "list", root, status=None).stdout
    for word in ("S001", "S002", "completed", "24 of 24", "simulated"):
        assert word in listed
    status = metamerlab("session", "status", root / "demo" / "S002", status=None).stdout
    for word in ("SIMULATED", "slot", "24 of 24", "missed refreshes", "completed"):
        assert word in status

    again = metamerlab(
        "session", "simulate", "demo", "--out", root, "--participants", 3, status=None
    )
    assert again.stdout.strip().endswith("1 simulated session, 24 decisions")


@pytest.mark.parametrize(
    ("replacements", "options", "reason", "cure"),
    [
        ((), ("--missed-per-1000", 1000), "dropped-frames", "'metamerlab session check-display'"),
        ((("timeout_s = 20.0", "timeout_s = 0.1"),), (), "too-late", "response.timeout_s"),
    ],
)
def test_a_study_of_void_attempts_is_no_success(
    study, tmp_path, replacements, options, reason, cure
):
    path = study(("max_attempts = 3", "max_attempts = 2"), *replacements)
    root = tmp_path / "sessions"
    arguments = ("session", "simulate", path, "--out", root, "--participants", 2, *options)
    result = metamerlab(*arguments, status=2)

    attempts = [a for code in ("S001", "S002") for a in read_journal(
        root / "demo" / code / "journal.jsonl").attempts]  # fmt: skip
    counted = [a for a in attempts if a.role == "main"]
    assert len(counted) == 2 * 2 * 24
    assert {attempt.void_reason for attempt in counted} == {reason}
    assert f"recorded: none of 24 by S001, S002; void attempts: 96 {reason})" in result.stderr
    assert cure in result.stderr
    assert "begin again with another participant code" in result.stderr

    # The same command again makes nothing anew, alters nothing, and is no success either.
    kept = {p: p.read_bytes() for p in root.rglob("*") if p.is_file()}
    again = metamerlab(*arguments, status=2)
    assert f"96 {reason}" in again.stderr
    assert {p: p.read_bytes() for p in root.rglob("*") if p.is_file()} == kept


def test_one_decision_is_enough_to_be_a_session(study, tmp_path):
    path = study(("timeout_s = 20.0", "timeout_s = 0.75"), ("max_attempts = 3", "max_attempts = 1"))
    result = metamerlab("session", "simulate", path, "--out", tmp_path / "s")

    (done,) = re.findall(r"1 simulated session, (\d+) decisions", result.stdout)
    assert 0 < int(done) < 24  # some too late, some not


def test_the_list_counts_void_attempts_of_decisions_as_reports_do(tmp_path):
    words = ("--out", tmp_path, "--participants", 6, "--missed-per-1000", 6)
    metamerlab("session", "simulate", "demo", *words)
    rows = [
        line.split()
        for line in metamerlab("session", "list", tmp_path, status=None).stdout.splitlines()
    ]
    seen = set()
    for code in (f"S00{number}" for number in range(1, 7)):
        journal = tmp_path / "demo" / code / "journal.jsonl"
        events = [json.loads(line) for line in journal.read_text("utf-8").splitlines()]
        void = [event["role"] for event in events if event.get("outcome") == "void"]
        (row,) = (row for row in rows if code in row)
        assert str(void.count("main")) in row[row.index("of") + 2 :]
        seen |= set(void)
    assert seen == {"main", "catch", "practice"}


def test_status_and_list_show_damage_instead_of_failing(tmp_path):
    metamerlab("session", "simulate", "demo", "--out", tmp_path, "--participants", 2, status=None)
    journal = tmp_path / "demo" / "S001" / "journal.jsonl"
    lines = journal.read_bytes().splitlines(keepends=True)
    journal.write_bytes(
        b"".join([*lines[:4], b"garbage\n", b"\xe9t\xe9\n", *lines[6:-1], lines[-1][:20]])
    )

    assert "damaged" in metamerlab("session", "list", tmp_path, status=None).stdout
    status = metamerlab("session", "status", journal.parent, status=None).stdout
    assert "line 5: must be one JSON object" in status
    assert "line 6: must be UTF-8 text (got byte 0xe9 at column 1)" in status
    assert "torn" in status


def test_sessions_that_are_not_there_are_told(tmp_path):
    assert "no such folder" in refused(
        metamerlab("session", "list", tmp_path / "none", status=None)
    )
    assert "found no journal" in refused(metamerlab("session", "list", tmp_path, status=None))
    assert "found no journal there" in refused(
        metamerlab("session", "status", tmp_path, status=None)
    )


@pytest.mark.parametrize(
    ("option", "message"),
    [
        ("metamer=1", "NAME must be one of reference, push-pull, metameric (got 'metamer')"),
        ("metameric=high", "must be NAME=NUMBER with a number (got 'metameric=high')"),
        ("metameric", "must be NAME=NUMBER (got 'metameric')"),
    ],
)
def test_a_utility_that_is_none_is_refused(tmp_path, option, message):
    result = metamerlab(
        "session", "simulate", "demo", "--out", tmp_path, "--utility", option, status=None
    )
    assert message in refused(result)
    assert not list(tmp_path.iterdir())


def test_built_clips_are_checked_and_their_manifest_is_in_every_header(study, tmp_path):
    path, clips = study(), tmp_path / "clips"
    clips.mkdir()
    protocol = load_protocol(path)
    manifest = virtual_manifest(protocol, load_display("fhd27-60hz"))
    manifest = manifest.model_copy(update={"revision": "0.1.0 abcdef0"})
    write_manifest(clips, manifest)

    metamerlab("protocol", "check", path, "--stimuli", clips)
    out = tmp_path / "sessions"
    metamerlab("session", "simulate", path, "--out", out, "--stimuli", clips)
    journal = read_journal(out / "demo" / "S001" / "journal.jsonl")
    assert journal.start.manifest_sha256 == manifest.sha256
    result = metamerlab("protocol", "preregister", path, "--stimuli", clips, status=None)
    assert manifest.sha256 in result.stdout

    for command in (("protocol", "check", "demo"), ("session", "simulate", "demo", "--out", out)):
        message = refused(metamerlab(*command, "--stimuli", clips, status=None))
        assert "must be built from this protocol's" in message or "known method" in message


def test_show_on_a_display_that_cannot_do_it_says_why():
    result = metamerlab("protocol", "show", "demo", "--display", "fhd24-144hz")

    assert "fhd24-144hz" in result.stdout
    assert "nearest: 36 fps" in " ".join(result.stdout.replace("│", " ").split())


def test_a_folder_that_cannot_be_written_is_told_in_one_line(tmp_path):
    (tmp_path / "file").write_text("in the way")
    message = refused(
        metamerlab("session", "simulate", "demo", "--out", tmp_path / "file" / "x", status=None)
    )

    assert message == f"{tmp_path / 'file' / 'x'}: must be a writable folder (Not a directory)"


def test_simulate_goes_on_with_a_stopped_session_and_refuses_another_protocol(tmp_path, study):
    root = tmp_path / "sessions"
    path = study()
    metamerlab("session", "simulate", path, "--out", root)
    journal = root / "demo" / "S001" / "journal.jsonl"
    whole = journal.read_bytes().splitlines(keepends=True)
    journal.write_bytes(b"".join(whole[:10]) + whole[10][:50])

    result = metamerlab("session", "simulate", path, "--out", root, status=None)

    assert result.stdout.strip().endswith("1 simulated session, 24 decisions")
    assert (journal.parent / "torn-line.txt").read_bytes() == whole[10][:50]
    journal.write_bytes(b"".join(whole[:10]))
    other = study(("repeats = 2", "repeats = 4"))
    message = refused(metamerlab("session", "simulate", other, "--out", root, status=None))
    assert "the protocol must be the one the session began with" in message
    shutil.rmtree(root)
