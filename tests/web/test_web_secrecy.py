"""An export tells participants no more than the page needs; its key draws places for all."""

import json
import re
import tomllib
from collections import Counter
from dataclasses import replace

import pytest
from command_line import metamerlab
from web_kernel import running_kernel
from web_study import FHD, WEB_CASES, BuiltWebStudy, brought_home, built, for_browsers

from protocols.browser.web_study import web_design
from protocols.disk.hashing import sha256_bytes
from protocols.errors import StudyError
from protocols.journal_file import read_journal
from protocols.load import load_protocol
from protocols.plan import place_of, rounds
from protocols.study_file.schema import StudyProtocol
from study_app.session_folders import find_sessions
from study_app.verification import verify
from study_app.web.export import WebBuild
from study_app.web.screens import screen_lines

SECRET = "0123456789abcdef" * 4


@pytest.fixture(scope="module")
def kernel(tmp_path_factory):
    with running_kernel(tmp_path_factory.mktemp("kernel")) as kernel:
        yield kernel


def drawn(study: StudyProtocol) -> StudyProtocol:
    """The study as `new-study` makes it: places are drawn, and a secret seeds the order."""
    design = study.design.model_copy(update={"places": "drawn"})
    secret_sha256 = sha256_bytes(SECRET.encode())
    privacy = study.privacy.model_copy(update={"secret_sha256": secret_sha256})
    return study.model_copy(update={"design": design, "privacy": privacy}).with_secret(SECRET)


@pytest.fixture(scope="module")
def lab(case, tmp_path_factory):
    """A study with drawn places and its export."""
    return built(drawn(case("two-interval").study), tmp_path_factory.mktemp("drawn"))


def test_studies_of_twelve_in_browsers_are_balanced_as_at_the_desk(monkeypatch):
    """Each browser draws a seed of its own; before, places followed from it."""
    study = drawn(load_protocol("demo"))
    short, whole = rounds(study)
    monkeypatch.setattr("protocols.plan.rounds", lambda _: (short, whole))  # for speed: all alike
    keys, balanced = set(), {"export": 0, "browsers": 0}
    for number in range(400):
        lab = study.with_secret(f"{number}")
        key = lab.places_key
        keys.add(key)
        for who, of in (("export", key), ("browsers", None)):
            seeds = [1000 * number + slot for slot in range(12)]
            places = [place_of(lab.ordered_by(seed, of), slot) for slot, seed in enumerate(seeds)]
            counts = Counter(place % short for place in places)
            balanced[who] += set(counts.values()) == {12 // short}
        desk = Counter(place_of(lab, slot) % short for slot in range(12))
        assert set(desk.values()) == {12 // short}
    assert balanced["export"] == len(keys) == 400
    assert balanced["browsers"] < 40
    assert max(keys) < 2**53


def test_the_key_tells_neither_secret_nor_seed_and_stays_the_same(lab):
    study, key = lab.study, lab.exported["design"]["places_key"]
    assert key == study.places_key == study.in_a_browser().places_key
    assert key != study.with_secret("another").places_key
    assert str(study.order_seed) not in json.dumps(lab.exported)
    by_arrival = study.design.model_copy(update={"places": "by-arrival"})
    assert study.model_copy(update={"design": by_arrival}).places_key is None


def test_people_in_browsers_share_places_and_their_journals_hold_the_key(lab, kernel, tmp_path):
    """Once a session is in, its plan is checked without the secret."""
    people = rounds(lab.study)[0]
    for slot in range(people):
        results = lab.session(kernel, f"W{slot}", slot=slot, luck=slot)["results"]
        (imported,) = brought_home(lab, results, tmp_path)
        assert (imported.state, imported.reason) == ("imported", "completed"), imported.message
    sessions = find_sessions(tmp_path)
    without = lab.study.with_secret("").model_copy()
    for session in sessions:
        assert session.journal.start.remote.places_key == lab.study.places_key
        assert list(verify(session, without).problems) == []
    shown = Counter(
        (attempt.condition["scene"], attempt.condition["first"])
        for session in sessions
        for attempt in session.journal.attempts
        if attempt.role == "main" and attempt.outcome == "completed"
    )
    assert len(set(shown.values())) == 1  # each order of each pair, by as many


def told_by_seed(of: BuiltWebStudy, kernel) -> list[str]:
    """A session by a page of before: it drew places by its seed, and knew no key."""
    early = replace(of)
    early.exported["design"]["places_key"] = None
    results = early.session(kernel)["results"]
    first = json.loads(results[0])
    del first["places_key"]
    return [json.dumps(first) + "\n", *results[1:]]


def test_a_session_of_a_page_that_knew_no_key_is_imported_without_the_secret(lab, kernel, tmp_path):
    results = told_by_seed(lab, kernel)
    gone = replace(lab, study=drawn(lab.study)._beside("_secret", None))
    (imported,) = brought_home(gone, results, tmp_path)
    assert imported.state == "imported", imported.message
    journal = tmp_path / "short/W-1/journal.jsonl"
    assert read_journal(journal).start.remote.places_key is None
    assert b"places_key" not in journal.read_bytes()


@pytest.mark.parametrize("name", ["two-interval", "drawn"])
def test_a_key_that_is_not_the_export_s_is_refused(case, lab, kernel, tmp_path, name):
    of = lab if name == "drawn" else case(name)
    results = of.session(kernel)["results"]
    first = json.loads(results[0]) | {"places_key": 5}
    (refused,) = brought_home(of, [json.dumps(first) + "\n", *results[1:]], tmp_path)
    assert refused.state == "refused"
    assert "places_key must be the export's, as in its study.json (got 5)" in refused.message


def test_without_its_secret_a_study_with_a_key_says_what_is_missing(lab, kernel, tmp_path):
    gone = replace(lab, study=lab.study._beside("_secret", None))
    (refused,) = brought_home(gone, lab.session(kernel)["results"], tmp_path / "sessions")
    said = "the study's secret must lie beside the study file, as NAME.secret (it does not)"
    assert said in refused.message
    with pytest.raises(StudyError, match="secret must lie beside the study file"):
        WebBuild(gone.study, FHD, lab.manifest).write(lab.stimuli, tmp_path / "out")


def values(design: object) -> set[str]:
    """Every text in a design."""
    if isinstance(design, dict):
        return set().union(*map(values, design.values()))
    if isinstance(design, list):
        return set().union(*map(values, design))
    return {design} if isinstance(design, str) else set()


@pytest.mark.parametrize("name", WEB_CASES)
def test_neither_stimuli_nor_scenes_nor_tracks_are_named(case, name):
    of = case(name)
    stimuli = of.study.stimuli
    told = {str(value) for column in stimuli.columns() for value in stimuli.values(column)}
    told -= {*of.study.task.answers(), "1", "2"}  # levels, and numbers of scenes
    design = {key: value for key, value in of.exported["design"].items() if key != "answers"}
    files = {path.name for path in of.out.rglob("*") if path.is_file()}
    for text in values(design) | set(of.exported["stimuli"]) | files:
        assert not any(clip.name in text for clip in of.manifest.clips)
        assert text not in told
    assert "c" in told
    packs = [pack["file"] for pack in of.exported["stimuli"].values()]
    assert packs == sorted(packs)  # no order tells either


def test_stimuli_with_equal_frames_have_names_of_their_own(case):
    of = case("yes-no")
    first, second, *others = of.manifest.clips
    same = second.model_copy(update={"frames_sha256": first.frames_sha256})
    build = WebBuild(
        of.study, FHD, of.manifest.model_copy(update={"clips": (first, same, *others)})
    )
    assert len(set(build.names.values())) == len(of.manifest.clips)


def answers_told(design: dict, part: str) -> set[str | None]:
    return {one["correct"] for cell in design[part] for one in cell["arrangements"]}


@pytest.mark.parametrize("judged", [True, False])
def test_right_answers_are_sent_only_where_the_page_judges_by_them(case, judged):
    study = case("yes-no").study
    practice = study.design.practice.model_copy(
        update={"feedback": False, "criterion_share": 0.75 if judged else None}
    )
    design = study.design.model_copy(update={"practice": practice})
    said = web_design(study.model_copy(update={"design": design})).model_dump()
    assert answers_told(said, "cells") == answers_told(said, "catch_cells") == {None}
    assert answers_told(said["practice"], "cells") == ({"yes", "no"} if judged else {None})


def test_a_rule_that_chooses_from_right_answers_is_told_them(case):
    tracks = case("yes-no by up-down").exported["design"]["adaptive"]["tracks"]
    assert [track["name"] for track in tracks] == [str(number) for number in range(len(tracks))]
    assert {one["correct"] for track in tracks for one in track["options"]} == {"yes", "no"}


@pytest.mark.parametrize(
    "pattern", ["P[0-9]{2}", r"\d+", "[A-Z]{3}|[a-z]{3}", "(?i)P-[0-9]{3}", "w[0-9]*"]
)
def test_a_pattern_that_refuses_the_codes_of_browsers_is_refused_with_one_that_takes_both(
    case, pattern
):
    study = case("yes-no").study

    def patterned(text: str) -> StudyProtocol:
        privacy = study.privacy.model_copy(update={"code_pattern": text})
        return study.model_copy(update={"privacy": privacy})

    with pytest.raises(StudyError, match=r"privacy\.code_pattern: must match") as error:
        web_design(patterned(pattern))
    cure = tomllib.loads(str(error.value).partition("; write ")[2])["code_pattern"]
    mended = patterned(cure)
    web_design(mended)
    assert mended.privacy.accepts("wz0123456789abc")
    for code in ("P07", "12", "ABC", "abc", "P-123", "w12", "ww"):
        if patterned(pattern).privacy.accepts(code):
            assert mended.privacy.accepts(code)


def test_commands_refuse_such_a_pattern(case, tmp_path):
    of = case("yes-no")
    text = (of.out.parent / "study.toml").read_text() + '\n[web]\ngaze = "none"\n'
    path = tmp_path / "study.toml"
    path.write_text(text.replace("[privacy]", '[privacy]\ncode_pattern = "P[0-9]{2}"'))
    for words in (
        ("protocol", "check", path, "--web"),
        ("session", "export-web", path, "--stimuli", of.stimuli, "--out", tmp_path / "out"),
    ):
        done = metamerlab(*words, terminal_width=400, status=2)
        assert 'write code_pattern = "w[0-9a-z]{14}|P[0-9]{2}"' in done.output
    assert not (tmp_path / "out").exists()


def test_a_code_or_address_for_payment_is_said_to_be_public(case, tmp_path):
    of, path = case("yes-no"), tmp_path / "study.toml"
    web = '\n[web]\ngaze = "none"\ntolerance_s = 0.01\n'
    plain = (of.out.parent / "study.toml").read_text() + web
    for key in ("", 'completion_code = "C1"', 'completion_url = "https://example.org/"'):
        path.write_text(f"{plain}{key}\n")
        said = metamerlab("protocol", "check", path, "--web", terminal_width=400).output
        assert ("is public" in said) == bool(key)
        assert f"web.{key.partition(' ')[0]} is public" in said or not key


@pytest.mark.parametrize("tolerance_s", [0.0, 0.002])
def test_the_one_change_of_tolerance_admits_the_rates_it_names(case, tolerance_s):
    of = case("yes-no")
    task = of.study.task.model_copy(update={"stimulus_s": 0.15})
    study = for_browsers(of.study.model_copy(update={"task": task}), tolerance_s=tolerance_s)
    lines = "\n".join(screens(study, of))
    there = {float(rate) for rate in re.findall(r"[\d.]+", lines.split("at ")[2].split("\n")[0])}
    wanted, rates = re.search(r"web.tolerance_s = ([\d.]+) admits (.*) Hz, too", lines).groups()
    more = {float(rate) for rate in re.findall(r"[\d.]+", rates)}
    assert more
    assert not more & there
    admitted = WebBuild(for_browsers(study, tolerance_s=float(wanted)), FHD, of.manifest)
    assert set(admitted.rates_hz) == there | more


def screens(study: StudyProtocol, of: BuiltWebStudy) -> list[str]:
    build = WebBuild(study, FHD, of.manifest)
    return list(screen_lines(build))


def test_the_one_change_of_size_admits_the_screens_it_names(case):
    """Stimuli that fill the desk's screen; times are such as every rate has."""
    of = case("yes-no")

    def sized(width: int, height: int) -> BuiltWebStudy:
        stimuli = of.study.stimuli.model_copy(update={"width_px": width, "height_px": height})
        study = of.study.model_copy(update={"stimuli": stimuli})
        clips = tuple(
            clip.model_copy(update={"width_px": width, "height_px": height})
            for clip in of.manifest.clips
        )
        return replace(of, study=study, manifest=of.manifest.model_copy(update={"clips": clips}))

    large = sized(1900, 1000)
    *_, line = screens(large.study, large)
    found = re.search(
        r"stimuli of (\d+) x (\d+) px instead of 1900 x 1000 admit screens of (\d+) x (\d+) px",
        line,
    )
    width, height, wide, high = map(int, found.groups())
    small = sized(width, height)
    needs = WebBuild(small.study, FHD, small.manifest).window_px()
    assert (needs[0] <= wide, needs[1] <= high) == (True, True)
    assert (wide, high) < (1900, 1000)
    assert len(screens(of.study, of)) == 1  # all fits: nothing is to be changed


@pytest.mark.parametrize("what", ["folder", "above", "study.json", "renamed", "study.jzip"])
def test_an_export_is_no_results(case, tmp_path, what):
    of = case("yes-no")
    toml = tmp_path / "study.toml"
    toml.write_text((of.out.parent / "study.toml").read_text() + '\n[web]\ngaze = "none"\n')
    metamerlab(
        "session", "export-web", toml, "--stimuli", of.stimuli, "--out", tmp_path / "up/web",
        "--jatos", tmp_path / "study.jzip",
    )  # fmt: skip
    out = tmp_path / "up/web"
    (tmp_path / "renamed").write_bytes((out / "study.json").read_bytes())
    given = {"folder": out, "above": out.parent, "study.json": out / "study.json"}
    done = metamerlab(
        "session", "import-web", given.get(what, tmp_path / what), "--protocol", toml,
        "--stimuli", of.stimuli, "--sessions", tmp_path / "sessions", terminal_width=400, status=2,
    )  # fmt: skip
    assert done.output.count("must be results that browsers sent (this is the exported study)") == 1
    assert done.output.count(": must") == 1
    assert not (tmp_path / "sessions").exists()
