"""The import believes nothing, costs one person at a time, and takes what honest pages send."""

import json
import resource
from contextlib import contextmanager
from datetime import UTC, datetime, timedelta

import pytest
from command_line import result_of
from web_kernel import running_kernel
from web_study import changed

from protocols.errors import StudyError
from study_app.web import import_lines
from study_app.web.import_lines import import_results
from study_app.web.read_results import BrowserResults

HOUR = timedelta(hours=1)


@pytest.fixture(scope="module")
def kernel(tmp_path_factory):
    with running_kernel(tmp_path_factory.mktemp("kernel")) as kernel:
        yield kernel


@pytest.fixture(scope="module")
def of(case):
    """A study with blocks, a break and closing questions."""
    return case("yes-no")


@pytest.fixture(scope="module")
def sent(kernel, of):
    """Return the lines of two participants."""
    return of.session(kernel)["results"], of.session(kernel, "W-2", slot=1, luck=2)["results"]


def imported(of, lines, root, **options):
    inbox = BrowserResults()
    inbox.read("results", "".join(lines).encode())
    return import_results(inbox, of.study, of.display, of.manifest, root, **options)


def shifted(line, **by):
    """Return fields of an attempt whose stamps are others."""
    flips, presses = list(line["flips_us"]), [dict(press) for press in line["presses"]]
    for press in presses:
        press["at_us"] += by.get("presses", 0)
    flips[0] += by.get("flips", 0)
    return {"flips_us": flips, "presses": presses}


YEARS_US = 10**14
EDITS = [
    ("start", {"language": "xx"}, "language must be one of en (got 'xx')"),
    ("start", {"rate_hz": 61.0}, "rate_hz must be one of 50, 60"),
    ("start", {"rate_hz": 50.0}, "machine.refresh_hz must be near rate_hz, 50"),
    ("start", {"slot": 2**20}, "slot must be below 1,048,576 (drawn) (got 1048576)"),
    ("start", {"slot": 2**53, "slot_from": "link"}, "slot must be below 1,000,000,000 (link)"),
    ("start", {"run": 1}, "run must be 0 at the start (got 1)"),
    ("start", {"identifier": "PANEL-7"}, "identifier must be left out"),
    ("start", {"revision": "r" * 201}, "revision must have at most 200 characters (got rrr"),
    ("start", {"t_s": -1.0}, "t_s must lie between 0 and 1e+07 (got -1.0)"),
    ("block-end", {"t_s": 1e9}, "t_s must lie between"),
    ("block-end", {"t_s": 0.5}, "t_s must lie between"),
    ("end", {"run": 5}, "run must be 0, as in the line before (got 5)"),
    ("block-end", {"at": "0000-00-00T00:00:00Z"}, "at must be a date and a time (got 0000-00"),
    ("block-end", {"at": "1960-01-01T00:00:00Z"}, "at must not fall by more than 1 day"),
    ("block-end", {"at": "2001-02-30T00:00:00Z"}, "at must be a date and a time"),
    ("consent", {"text_sha256": "0" * 64}, "of the consent page (got 000000"),
    ("break", {"duration_s": 0.0}, "duration_s must be at least"),
    ("break", {"duration_s": 1e6}, "the time since the line before (got 1000000.0)"),
    ("answer", {"text": "\u001b[2J"}, "text must be one of"),
    ("end", {"reason": "consent-refused"}, "reason must not be that, since there comes the end"),
    ("attempt", {"flips_us": []}, "flips_us must have entries"),
    ("attempt", {"disturbed": [999, "focus"]}, "disturbed must not be given (got (999, "),
    ("attempt", lambda of: shifted(of, flips=YEARS_US), "flips must come before t_s"),
    ("attempt", lambda of: shifted(of, flips=-2_500_000), "flips must come after the line before"),
    ("attempt", lambda of: shifted(of, presses=YEARS_US), "a press before flip"),
    ("attempt", lambda _: {"presses": [{"flip": 0, "key": "z", "at_us": 0}]}, "must lie about"),
    ("attempt", lambda _: {"presses": [{"flip": 999, "key": "z", "at_us": 0}]}, "after one of"),
    ("attempt", lambda _: {"presses": [{"flip": 0, "key": "z", "at_us": 0, "x": 0.1}]}, "a press"),
]  # fmt: skip


@pytest.mark.parametrize(("kind", "fields", "message"), EDITS, ids=range(len(EDITS)))
def test_a_line_that_no_page_sends_is_refused_and_costs_no_other(
    of, sent, tmp_path, kind, fields, message
):
    one, two = sent
    lines, place = changed(one, kind, fields)

    refused, other = imported(of, [*lines, *two], tmp_path)

    assert (refused.participant, refused.state) == ("W-1", "refused")
    assert refused.message.startswith(f"line number {place}: ")
    assert message in refused.message
    assert refused.message.isprintable()
    assert len(refused.message) < 500
    assert other.state == "imported"
    assert [path.name for path in (tmp_path / "short").iterdir()] == ["W-2"]


def test_what_comes_after_the_end_and_an_end_before_the_last_trial_are_refused(of, sent, tmp_path):
    one, _ = sent
    last = json.loads(one[-1])
    note = last | {"kind": "note", "text": "more", "n": last["n"] + 1}
    del note["reason"]
    (refused,) = imported(of, [*one, json.dumps(note) + "\n"], tmp_path)
    assert "after the end must come a resume (got note)" in refused.message
    early = json.loads(one[12]) | {"kind": "end", "reason": "completed"}
    early = {key: early[key] for key in last}
    (refused,) = imported(of, [*one[:12], json.dumps(early) + "\n"], tmp_path)
    assert "reason must not be that, since there comes attempt 1 at" in refused.message
    assert not list(tmp_path.iterdir())


def test_whatever_goes_wrong_in_one_participant_is_a_refusal_with_its_line(
    of, sent, tmp_path, monkeypatch
):
    one, two = sent
    real = import_lines.next_step

    def breaks(study, plan, events, language):
        if plan.participant == "W-1" and len(events) > 7:
            raise KeyError("\u001b[2J nothing that we thought of")
        return real(study, plan, events, language)

    monkeypatch.setattr(import_lines, "next_step", breaks)
    refused, other = imported(of, [*one, *two], tmp_path)
    assert refused.message.startswith("line number 8: must be one that a page sends (KeyError: ")
    assert refused.message.isprintable()
    assert (other.state, len(list((tmp_path / "short").iterdir()))) == ("imported", 1)


def test_a_session_is_verified_before_it_takes_its_place(of, sent, tmp_path, monkeypatch):
    """As 'session verify' does it, of lines of the journal; its line numbers are the browser's."""
    monkeypatch.setattr(import_lines.LineCheck, "check", lambda _check, _line: None)
    late = changed(sent[0], "attempt", lambda of: shifted(of, presses=10**9))[0]
    (refused,) = imported(of, late, tmp_path)
    place = next(n for n, line in enumerate(late) if line != sent[0][n])
    assert refused.message.startswith(f"line number {place}: ")
    assert "rt_s must be within the answer phase" in refused.message
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("n", [5, 31, 10**9, 2**53 - 1])
def test_whoever_knows_a_code_takes_back_no_session_that_was_completed(kernel, of, tmp_path, n):
    one, two = (of.session(kernel, who, slot=k, luck=k + 5)["results"]
        for k, who in enumerate(("W-1", "W-2")))  # fmt: skip
    n = len(one) if n == 31 else n
    foreign = json.loads(two[12]) | {"participant": "W-1", "n": n, "opening": 7}
    alone = imported(of, one, tmp_path / "alone")[0]
    found, other = imported(of, [*one, json.dumps(foreign) + "\n", *two], tmp_path / "both")
    assert (found.state, found.reason, other.state) == ("imported", "completed", "imported")
    assert "lines of another tab or device were left: 1 of run 0" in found.message
    journals = [tmp_path / root / "short/W-1/journal.jsonl" for root in ("alone", "both")]
    assert journals[0].read_bytes() == journals[1].read_bytes()
    assert alone.state == "imported"


def test_a_code_copied_in_capitals_comes_after_the_browsers_own(kernel, of, sent, tmp_path):
    """Windows and macOS have one folder for both."""
    lines = of.session(kernel, "w-1", luck=2)["results"]
    own, other = imported(of, [*sent[0], *lines], tmp_path)
    assert (own.participant, own.state, other.state) == ("w-1", "imported", "refused")
    assert "must differ by more than case" in other.message


def test_whatever_goes_wrong_among_histories_is_a_refusal(of, sent, tmp_path, monkeypatch):
    real = import_lines.histories

    def breaks(told):
        if len(told) == len(sent[0]):
            raise OverflowError("\u001b[2J")
        return real(told)

    monkeypatch.setattr(import_lines, "histories", breaks)
    refused, other = imported(of, [*sent[0], *sent[1][:-1]], tmp_path)
    assert refused.message == "lines must be such as a page sends (OverflowError: \\x1b[2J)"
    assert other.state == "imported"


# --- what an honest page can send ----------------------------------------------------------------


def timed(results, when):
    """Return lines at other times of the participant's clock; `when` gets number and time."""
    lines = [json.loads(line) for line in results]
    for number, line in enumerate(lines):
        at = datetime(2026, 3, 1, 12, tzinfo=UTC) + timedelta(seconds=line["t_s"])
        line["at"] = when(number, at).strftime("%Y-%m-%dT%H:%M:%S.%f")[:-3] + "Z"
    return [json.dumps(line) + "\n" for line in lines]


@pytest.mark.parametrize(
    "when",
    [
        lambda n, at: at - HOUR * (n > 9),
        lambda n, at: at + HOUR * (n > 9),
        lambda n, at: at - 23 * HOUR * (n > 9),
        lambda n, at: at + timedelta(days=20_000) * (n > 9),  # its battery was dead
        lambda n, at: at + 9 * HOUR * (n > 9) + 9 * HOUR * (n > 14),  # asleep twice
    ],
    ids=["back", "forth", "other-side-of-the-world", "battery", "asleep"],
)
def test_a_clock_that_is_set_and_a_laptop_that_sleeps_are_accepted(of, sent, tmp_path, when):
    (one,) = imported(of, timed(sent[0], when), tmp_path)
    assert (one.state, one.reason, one.message) == ("imported", "completed", "")


def test_a_page_whose_own_clock_runs_while_it_sleeps_is_accepted(of, sent, tmp_path):
    night_s, lines = 8 * 3600, [json.loads(line) for line in sent[0]]
    for line in lines[len(lines) // 2 :]:
        line["t_s"] += night_s
        if line["kind"] == "attempt":
            line |= shifted(line, flips=night_s * 10**6, presses=night_s * 10**6)
    (one,) = imported(of, [json.dumps(line) + "\n" for line in lines], tmp_path)
    assert (one.state, one.message) == ("imported", "")


def test_a_completed_session_that_is_opened_again_is_accepted(of, sent, tmp_path):
    one = sent[0]
    last = json.loads(one[-1])
    machine = {"machine": json.loads(one[0])["machine"], "rate_hz": 60.0}
    resume = {k: v for k, v in last.items() if k != "reason"} | {
        "kind": "resume", "n": last["n"] + 1, "run": 1, "t_s": 0.001, **machine
    }  # fmt: skip
    again = [json.dumps(line) + "\n" for line in (resume, last | {"n": last["n"] + 2, "run": 1})]
    (found,) = imported(of, [*one, *again], tmp_path)
    assert (found.state, found.reason) == ("imported", "completed")


def test_keys_of_just_before_the_first_refresh_are_accepted(of, sent, tmp_path):
    """The page listens from the moment in which it asks for the first refresh."""

    def early(line):
        first = line["flips_us"][0]
        return {"presses": [{"flip": 0, "key": "z", "at_us": first - 40_000}, *line["presses"]]}

    lines, _ = changed(sent[0], "attempt", early)
    assert imported(of, lines, tmp_path)[0].state == "imported"


# --- nobody took part, and a disk that refuses ---------------------------------------------------


@pytest.mark.parametrize("kind", ["start", "resume"])
def test_simulated_participants_are_set_aside_with_a_word(kernel, of, sent, tmp_path, kind):
    luck = next(n for n in range(5, 50) if of.session(kernel, killed=0.05, luck=n)["deaths"])
    one = of.session(kernel, killed=0.05, luck=luck)["results"]
    lines = [line.replace('"simulated":false', '"simulated":true') if f'"kind":"{kind}"' in line
        else line for line in one]  # fmt: skip
    del lines[7]  # even if there is more amiss
    aside, other = imported(of, [*lines, *sent[1]], tmp_path)
    assert (aside.participant, aside.state) == ("W-1", "set aside")
    assert aside.message.startswith("simulated: nobody took part")
    assert other.state == "imported"
    assert [path.name for path in (tmp_path / "short").iterdir()] == ["W-2"]


@contextmanager
def disk_of(most_bytes):
    """Let no file grow larger."""
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (most_bytes, before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)


@pytest.mark.parametrize("most_bytes", [0, 700, 3000, 20_000])
def test_a_disk_that_refuses_is_one_message_and_leaves_nothing_half_written(
    of, sent, tmp_path, most_bytes
):
    one, two = sent
    with disk_of(most_bytes), pytest.raises((StudyError, OSError), match="File too large"):
        imported(of, [*one, *two], tmp_path / "sessions")
    assert not (tmp_path / "sessions").exists()
    half = one[: len(one) // 2]
    assert imported(of, half, tmp_path / "sessions")[0].state == "imported"
    assert imported(of, one, tmp_path / "whole")[0].state == "imported"
    folder, whole = (tmp_path / name / "short/W-1" for name in ("sessions", "whole"))
    before = (folder / "journal.jsonl").read_bytes()
    with disk_of(len(before) + 500), pytest.raises(OSError, match="File too large"):
        import_lines._continue(folder, whole)
    assert (folder / "journal.jsonl").read_bytes() == before
    assert imported(of, one, tmp_path / "sessions")[0].state == "continued"
    assert (folder / "journal.jsonl").read_bytes() == (whole / "journal.jsonl").read_bytes()


def test_the_command_names_files_participants_and_studies_in_plain_letters(of, sent, tmp_path):
    (tmp_path / "a.txt").write_text("".join(changed(sent[0], "start", {"language": "xx"})[0]))
    (tmp_path / "b\u001b[2J.txt").write_text("".join(sent[1]) + '{"study":"\u001b[2J"}\n')
    (tmp_path / "c.zip").write_bytes(b"PK\x03\x04 torn")
    study = of.out.parent / "study.toml"
    own = tmp_path / "study.toml"
    own.write_text(study.read_text() + '\n[web]\ngaze = "none"\ntolerance_s = 0.01\n')
    done = result_of(terminal_width=300)(
        "session", "import-web", tmp_path / "a.txt", tmp_path, "--protocol", own, "--stimuli",
        of.stimuli, "--out", tmp_path / "sessions", status=2,
    )  # fmt: skip
    assert "c.zip: must be an archive that can be read" in done.output
    assert "1 participant left out: W-1" in done.output
    assert "\u001b" not in done.output
    assert (tmp_path / "sessions/short/W-2").is_dir()
