"""Studies leave for browsers and come home by commands; what a browser cannot do is said first."""

import json
import zipfile
from pathlib import Path

import pytest
from command_line import result_of
from task_cases import CASES, case_text
from undrawn_reports import undrawn
from web_kernel import running_kernel
from web_study import FHD, BuiltWebStudy, with_pixels

from analysis.report.write_report import report_sessions
from protocols.browser.web_study import WebStudy
from protocols.errors import StudyError
from protocols.load import load_protocol, load_study
from protocols.manifest import read_manifest
from study_app.web import jzip

WEB = '\n[web]\ngaze = "none"\ntolerance_s = 0.01\ncompletion_code = "C0DE"\n'
metamerlab = result_of(terminal_width=200)


@pytest.fixture(scope="module")
def lab(tmp_path_factory):
    """A folder with a study for browsers, the same without the section, and its stimuli."""
    folder = tmp_path_factory.mktemp("lab")
    text = case_text(CASES["yes-no"])
    (folder / "study.toml").write_text(text + WEB, encoding="utf-8")
    (folder / "desk.toml").write_text(text, encoding="utf-8")
    study, _ = load_study(folder / "study.toml")
    with_pixels(study, folder / "clips")
    return folder


@pytest.fixture(scope="module")
def exported(lab):
    done = metamerlab(
        "session", "export-web", lab / "study.toml", "--stimuli", lab / "clips",
        "--out", lab / "web", "--jatos", lab / "study.jzip",
    )  # fmt: skip
    return done.output, lab / "web"


def test_an_export_says_what_it_takes_and_gives_a_link_for_everybody(exported):
    said, out = exported
    assert " px, at 50, 60, 72, 75, 90, 100, 120, 144, 165 or 240 Hz" in said
    assert "per participant: " in said
    assert [line for line in said.splitlines() if "?slot=" in line] == [
        f"  index.html?slot={slot}" for slot in range(3)
    ]
    study = WebStudy.model_validate_json((out / "study.json").read_text())
    assert study.completion_code == "C0DE"
    assert {path.name for path in out.iterdir() if not path.name.startswith(".")} >= {
        "index.html", "metamerlab.js", "metamerlab.css", "packs", "pictures", "study.json",
    }  # fmt: skip


def test_the_same_study_gives_the_same_bytes(exported, lab):
    _, out = exported
    again = lab / "again"
    metamerlab(
        "session", "export-web", lab / "study.toml", "--stimuli", lab / "clips", "--out", again
    )
    for path in out.rglob("*"):
        if path.is_file():
            assert (again / path.relative_to(out)).read_bytes() == path.read_bytes(), path


def test_no_secret_of_the_study_leaves_the_lab(tmp_path):
    """Neither the seed of the desk's order nor the secret: each orders everybody's trials."""
    metamerlab("new-study", tmp_path / "own", "--task", "yes-no")
    path = tmp_path / "own/study.toml"
    path.write_text(path.read_text() + WEB)
    study = load_protocol(path)
    with_pixels(study, tmp_path / "clips")
    metamerlab(
        "session", "export-web", path, "--stimuli", tmp_path / "clips", "--out", tmp_path / "out",
        "--display", "fhd27-60hz",
    )  # fmt: skip
    secret = (tmp_path / "own/study.secret").read_text().strip()
    texts = [p.read_bytes() for p in (tmp_path / "out").rglob("*") if p.is_file()]
    for hidden in (secret, str(study.order_seed), f'"seed":{study.design.seed}'):
        assert not any(hidden.encode() in text for text in texts)


# As JATOS 3.9 has them: keys of a study, and kinds of workers.
KEYS = {
    "uuid", "title", "description", "groupStudy", "linearStudy", "allowPreview", "dirName",
    "comments", "jsonData", "endRedirectUrl", "studyEntryMsg", "componentList", "batchList",
}  # fmt: skip
WORKERS = {
    "Jatos", "PersonalSingle", "PersonalMultiple", "GeneralSingle", "GeneralMultiple", "MT",
    "MTSandbox",
}  # fmt: skip


def test_the_archive_is_one_that_jatos_takes(exported, lab):
    assert exported
    with zipfile.ZipFile(lab / "study.jzip") as archive:
        whole, names = json.loads(archive.read("short.jas")), set(archive.namelist())
    said = whole["data"]
    (component,), (batch,) = said["componentList"], said["batchList"]
    assert whole["version"] == "3"
    assert set(said) <= KEYS
    assert {name.split("/")[0] for name in names} == {"short.jas", said["dirName"]}
    assert component["reloadable"]
    assert f"{said['dirName']}/{component['htmlFilePath']}" in names
    assert said["uuid"] != component["uuid"]
    assert batch["maxTotalWorkers"] == 3
    assert set(batch["allowedWorkerTypes"]) <= WORKERS
    assert {"short/study.json", "short/index.html"} <= names


@pytest.mark.parametrize(("title", "shown"), [("A <b>x", "A (>x"), ("é" * 300, "é" * 255)])
def test_a_title_is_one_that_jatos_takes(title, shown):
    said = jzip.jas_text("s", title, "index.html", "id", 1)
    assert said["title"] == said["componentList"][0]["title"] == shown


def test_an_archive_that_is_larger_than_jatos_takes_is_refused(tmp_path, monkeypatch):
    monkeypatch.setattr(jzip, "MOST_BYTES", 10)
    (tmp_path / "index.html").write_text("")
    said = jzip.jas_text("s", "T", "index.html", "id", 1)
    with pytest.raises(StudyError, match="JATOS would refuse the archive: must have at most"):
        jzip.write(tmp_path, said, tmp_path / "o.jzip")
    assert not (tmp_path / "o.jzip").exists()


def test_a_study_of_a_reserved_name_goes_into_another_folder(tmp_path):
    (tmp_path / "index.html").write_text("")
    jzip.write(tmp_path, jzip.jas_text("public", "T", "index.html", "id", 1), tmp_path / "o.jzip")
    with zipfile.ZipFile(tmp_path / "o.jzip") as archive:
        assert "public-study/index.html" in archive.namelist()


def test_check_says_what_a_browser_study_loses(lab):
    done = metamerlab("protocol", "check", lab / "study.toml", "--web")
    assert "dropped in a browser: gamma and luminance" in done.output


@pytest.mark.parametrize(
    ("study", "options", "message"),
    [
        ("desk.toml", (), 'must have a section [web] (it has none); add [web] with gaze = "none"'),
        ("study.toml", ("--budget-mb", "1"), None),
    ],
)
def test_what_no_browser_can_run_is_refused_with_a_cure(lab, tmp_path, study, options, message):
    done = metamerlab(
        "session", "export-web", lab / study, "--stimuli", lab / "clips",
        "--out", tmp_path / "out", *options, status=None
    )  # fmt: skip
    assert (done.exit_code == 2) == (message is not None)
    assert (message or "") in " ".join(done.output.split())
    assert (tmp_path / "out").exists() == (message is None)


def test_a_study_over_the_budget_is_told_what_would_fit():
    study = load_protocol(Path("inpainting-2afc"))
    text = study.model_copy(update={"web": {"gaze": "none"}})
    assert text is not study
    done = metamerlab("protocol", "check", "inpainting-2afc", "--web", status=2)
    assert "the study watches gaze (gaze.mode = 'enforce'), which a browser cannot" in done.output


def test_times_that_need_more_tolerance_are_refused_at_that_rate(lab, tmp_path):
    text = (lab / "study.toml").read_text().replace("tolerance_s = 0.01", "tolerance_s = 0.0")
    (tmp_path / "exact.toml").write_text(text.replace("iti_s = 0.1", "iti_s = 0.15"))
    done = metamerlab("protocol", "check", tmp_path / "exact.toml", "--web", status=None)
    assert " px, at 60, 100, 120 or 240 Hz" in done.output
    assert "not at 72 Hz: trial.fixation_s: must be whole refreshes at 72 Hz" in done.output


def test_results_come_home_by_a_command_from_archives_of_both_layouts(exported, lab, tmp_path):
    study, _ = load_study(lab / "study.toml")
    of = BuiltWebStudy(study, FHD, read_manifest(lab / "clips"), lab / "clips", exported[1])
    with running_kernel(tmp_path) as kernel:
        results = {who: of.session(kernel, who, slot=n) for n, who in enumerate(("W1", "W2"))}
    for number, (who, told) in enumerate(results.items(), 1):
        half = len(told["results"]) // 2
        with zipfile.ZipFile(tmp_path / f"{who}.zip", "w") as archive:
            folder = f"study_result_{number}/comp-result_" if who == "W1" else "comp-result_"
            archive.writestr(f"{folder}1/data.txt", "".join(told["results"][:half]))
            archive.writestr(f"{folder}2/data.txt", "".join(told["results"][half:]))
            archive.writestr("metadata.json", "{}")
    (tmp_path / "W1.zip").rename(tmp_path / "W1.jrzip")
    words = (
        "session", "import-web", tmp_path / "W1.jrzip", tmp_path / "W2.zip",
        "--protocol", lab / "study.toml", "--stimuli", lab / "clips",
        "--sessions", tmp_path / "sessions",
    )  # fmt: skip

    metamerlab(*words, "--check")
    assert not (tmp_path / "sessions").exists()
    done = metamerlab(*["--out" if word == "--sessions" else word for word in words])
    rows = [line.split()[:2] for line in done.output.splitlines() if line[:2].strip()[:1] == "W"]
    assert rows == [
        ["W1", "imported"],
        ["W2", "imported"],
    ]
    listed = metamerlab("session", "list", tmp_path / "sessions", status=None)
    assert listed.output.count("browser") == 2
    metamerlab("session", "verify", tmp_path / "sessions", "--protocol", lab / "study.toml")


@pytest.mark.slow
def test_commands_say_which_session_went_on_at_another_refresh_rate(exported, lab, tmp_path):
    study, _ = load_study(lab / "study.toml")
    of = BuiltWebStudy(study, FHD, read_manifest(lab / "clips"), lab / "clips", exported[1])
    with running_kernel(tmp_path) as kernel:
        told = of.session(kernel, "W1", rate_hz=120.0, luck=2, page={"most": 12})
        page = {"past": told["past"], "rates_hz": [60.0], "opened_s": 900}
        lines = told["results"] + of.session(kernel, "W1", luck=2, page=page)["results"]
    (tmp_path / "lines.txt").write_text("".join(lines))
    sessions, protocol = tmp_path / "sessions", ("--protocol", lab / "study.toml")
    metamerlab(
        "session", "import-web", tmp_path / "lines.txt", *protocol, "--stimuli", lab / "clips",
        "--sessions", sessions,
    )  # fmt: skip
    attempt = sum('"kind":"attempt"' in line for line in told["results"]) + 1
    change = f"60 Hz from attempt {attempt}"

    metamerlab("session", "verify", sessions, *protocol)
    assert "completed" in metamerlab("session", "list", sessions).output
    status = metamerlab("session", "status", sessions / "short/W1").output
    assert change in status
    assert "120 Hz" in status
    metamerlab("analysis", "tidy", sessions, *protocol, "--out", tmp_path / "tables")
    assert change in (tmp_path / "tables/sessions.csv").read_text()
    with undrawn():
        report_sessions(sessions, study, tmp_path / "report", figure_files="none")
    page = (tmp_path / "report/report.html").read_text(encoding="utf-8")
    assert f"Gone on at another refresh rate: short/W1 ({change})." in page
    bids = tmp_path / "bids"
    metamerlab(
        "analysis", "export", sessions, *protocol, "--format", "bids", "--out", bids,
        "--display", "fhd27-60hz",
    )  # fmt: skip
    runs = [json.loads(one.read_text()) for one in sorted(bids.rglob("*run-*_events.json"))]
    rates = [one["StimulusPresentation"]["ScreenRefreshRate"] for one in runs]
    assert rates == [120.0, 60.0]


def test_an_archive_that_is_damaged_or_of_nothing_of_ours_is_one_message(lab, tmp_path):
    whole = tmp_path / "whole.zip"
    with zipfile.ZipFile(whole, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("a/data.txt", "x" * 10_000)
    data = bytearray(whole.read_bytes())
    data[60:80] = bytes(20)
    (tmp_path / "torn.zip").write_bytes(data)
    for name, message in (
        ("torn.zip", "must be an archive that can be read"),
        ("whole.zip", "must hold lines of the study 'short' (found lines of: none)"),
    ):
        done = metamerlab(
            "session", "import-web", tmp_path / name, "--protocol", lab / "study.toml",
            "--stimuli", lab / "clips", "--sessions", tmp_path / "sessions", status=2
        )  # fmt: skip
        assert message in " ".join(done.output.split())
        assert not (tmp_path / "sessions").exists()
