"""Fixed studies of every kind of task, and what is said of them: numbers, sentences, rows.

`python tests/helpers/fixed_studies.py NAME...` (no name: all) writes ``tests/stats/fixed/`` anew.
Do so only for a number that is meant to change.
"""

import html
import json
import re
import sys
import tempfile
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from command_line import metamerlab
from made_up_trials import (
    TaskDesign,
    simulate_abx,
    simulate_confidence,
    simulate_identification,
    simulate_yes_no,
)

from analysis.plans.table_sections import TimeTableSection
from analysis.report.write_report import report_decisions, report_sessions
from analysis.tasks import analysis_of
from analysis.tasks.note import write_note
from analysis.tasks.time_tables import TimesPlan

PLAN = TimesPlan(section=TimeTableSection(reaction="models"), study="s", title="s")
"""A plan of reaction times, whose parts correct by Holm."""
STORED = Path(__file__).parents[1] / "stats" / "fixed"
DIGITS = 6
"""Of stored numbers; a search for a maximum ends elsewhere in the last of a double."""
PARTS = ("results", "without_exclusions", "flow", "warnings")
"""Of `results.json`: the rest is of the machine or of the journals."""


def _gap(rng: np.random.Generator, rows: pd.DataFrame, values: Mapping[str, float]) -> pd.Series:
    """Add reaction times that differ by method and person."""
    person = rows["participant"].map(
        {who: rng.normal(0, 0.2) for who in sorted(rows["participant"].unique())}
    )
    return np.exp(rows["method"].map(values) + person + rng.normal(0, 0.3, len(rows))).round(4)


def _preference(seed: int = 3) -> pd.DataFrame:
    rng = np.random.default_rng(seed)
    quality = {"blur": -0.8, "ours": 0.5, "plain": 0.2}
    rows = []
    for person in range(6):
        taste = {name: rng.normal(0, 0.4) for name in quality}
        place = 0
        for scene in "abc":
            for size in ("large", "small"):
                for pair in (("blur", "ours"), ("ours", "plain"), ("plain", "blur")):
                    first, second = pair if (person + place) % 2 else pair[::-1]
                    gap = quality[first] + taste[first] - quality[second] - taste[second]
                    place += 1
                    chose = int(rng.random() < 1 / (1 + np.exp(-gap)))
                    rows.append((f"P{person}", scene, size, first, second, chose, place))
    columns = ["participant", "scene", "size", "first", "second", "chose_first", "order"]
    table = pd.DataFrame(rows, columns=columns)
    table["rt_s"] = np.exp(rng.normal(-0.1, 0.3, len(table)) - 0.002 * table["order"]).round(4)
    return table


def _yes_no() -> pd.DataFrame:
    rng = np.random.default_rng(5)
    design = TaskDesign(6, scenes=3, repeats=3)
    rows = simulate_yes_no(design, {"blur": 1.6, "ours": 0.6}, rng)
    return rows.assign(rt_s=_gap(rng, rows, {"blur": -0.3, "ours": 0.1}))


def _levels(alternatives: int, *, falling: bool = True) -> pd.DataFrame:
    rng = np.random.default_rng(alternatives)
    rows = simulate_identification(
        TaskDesign(6, repeats=6),
        {"blur": 9.0, "ours": 13.0},
        rng,
        levels=(4, 8, 12, 16),
        width=-8.0 if falling else 8.0,
        alternatives=alternatives,
        participant_sd=1.0,
        interaction_sd=0.5,
    )
    return rows.assign(rt_s=_gap(rng, rows, {"blur": -0.4, "ours": -0.2}))


def _scalings() -> pd.DataFrame:
    rng = np.random.default_rng(7)
    return simulate_abx(
        TaskDesign(6, repeats=10), {"ours": 0.2, "v2": 0.3}, rng, scalings=(0.1, 0.25, 0.5, 0.9)
    )


def _tracks() -> pd.DataFrame:
    """As an adaptive rule leaves them: each person's levels lie around the threshold."""
    rng = np.random.default_rng(9)
    rows = simulate_identification(
        TaskDesign(6, repeats=5),
        {"blur": 9.0, "ours": 13.0},
        rng,
        levels=(6, 8, 10, 12, 14),
        width=-8.0,
        alternatives=4,
        participant_sd=1.0,
    )
    return rows.assign(track=rows["method"], rt_s=_gap(rng, rows, {"blur": -0.4, "ours": -0.2}))


def _ratings() -> pd.DataFrame:
    rng = np.random.default_rng(4)
    shift = {"ours": 1.2, "blur": 0.0, "fill": 0.5}
    rows = pd.DataFrame(
        [(f"P{p}", s, m) for p in range(6) for s in "abc" for m in shift for _ in range(2)],
        columns=["participant", "scene", "method"],
    )
    taste = rows["participant"].map({f"P{p}": rng.normal(0, 0.6) for p in range(6)})
    latent = rows["method"].map(shift) + taste + rng.standard_normal(len(rows))
    rows["rating"] = 1 + np.digitize(latent, (-0.5, 0.6, 1.6))
    rows["order"] = rows.groupby("participant").cumcount() + 1
    return rows.assign(rt_s=_gap(rng, rows, {"ours": 0.0, "blur": 0.3, "fill": 0.1}))


def _graded() -> pd.DataFrame:
    rng = np.random.default_rng(6)
    quality = {"ours": 0.9, "blur": 0.0, "fill": 0.4}
    rows = [
        (f"P{p}", s, a, b, int(np.clip(np.round(quality[a] - quality[b] + rng.normal()), -2, 2)))
        for p in range(6)
        for s in "abc"
        for a, b in (("ours", "blur"), ("blur", "fill"), ("fill", "ours"))
        for _ in range(2)
    ]
    return pd.DataFrame(rows, columns=["participant", "scene", "first", "second", "rating"])


def _sure() -> pd.DataFrame:
    return simulate_confidence(
        6, 200, {"blur": 1.5, "ours": 1.0}, np.random.default_rng(10), noise=0.5, signal_sd=1.3
    )


def _sure_preference() -> pd.DataFrame:
    rng, rows = np.random.default_rng(11), _preference(3)
    quality = {"blur": -0.8, "ours": 0.5, "plain": 0.2}
    clear = (rows["first"].map(quality) - rows["second"].map(quality)).abs()
    felt = clear + rng.normal(0, 0.5, len(rows))
    return rows.assign(confidence=1 + np.digitize(felt, (0.3, 0.7, 1.1)))


TABLES: Mapping[str, tuple[str, dict[str, Any], Callable[[], pd.DataFrame]]] = {
    "preference": (
        "preference",
        {"primary": "ours/blur", "reaction": "models", "interaction": "size"},
        _preference,
    ),
    "preference-plain": ("preference", {}, lambda: _preference(8).query("size == 'small'")),
    "detection": (
        "detection",
        {"signal": "inconsistent", "baseline": "ours", "reaction": "models"},
        _yes_no,
    ),
    "detection-plain": ("detection", {"signal": "inconsistent", "by": "method"}, _yes_no),
    "two-answers": (
        "identification",
        {"level": "level", "falling": True, "reaction": "models", "alternatives": 2},
        lambda: _levels(2),
    ),
    "four-answers": (
        "identification",
        {"level": "level", "falling": True, "reaction": "models", "baseline": "ours"},
        lambda: _levels(4),
    ),
    "rising": (
        "identification",
        {"level": "level", "shape": "weibull", "correction": "none"},
        lambda: _levels(3, falling=False),
    ),
    "adaptive": (
        "identification",
        {"level": "level", "falling": True, "reaction": "models"},
        _tracks,
    ),
    "abx": ("abx", {"level": "scaling", "reaction": "models"}, _scalings),
    "which-half": (
        "which-half",
        {"level": "scaling"},
        lambda: _scalings().replace({"A": "left", "B": "right"}),
    ),
    "confidence": ("detection", {"signal": "inconsistent", "by": "method"}, _sure),
    "preference-confidence": ("preference", {"primary": "ours/blur"}, _sure_preference),
    "ratings": ("ratings", {"by": "method", "baseline": "blur"}, _ratings),
    "graded-pairs": ("ratings", {}, _graded),
}
"""Kind of analysis, options and rows, by name."""
SESSIONS = ("sessions",)
"""Studies that are made of journals."""
_LEVELS = ("--level", "level", "--by", "method", "--falling")
COMMANDS: Mapping[str, tuple[str, tuple[str, ...]]] = {
    "command-psychometric": ("two-answers", ("psychometric", *_LEVELS)),
    "command-detection": ("detection", ("detection", "--signal", "inconsistent", "--by", "method")),
    "command-reaction": ("two-answers", ("reaction", "--by", "method", "--baseline", "ours")),
    "command-reaction-of-ratings": ("ratings", ("reaction", "--by", "method")),
    "command-ratings": ("ratings", ("ratings", "--by", "method")),
    "command-graded-pairs": ("graded-pairs", ("ratings",)),
}
"""Commands of one table, by name: whose rows, and the arguments."""


def report_of(name: str, folder: Path, write_journals: Callable[..., Path] | None = None) -> Path:
    """Write the report of a fixed study without figure files; return its folder."""
    if name in SESSIONS:
        assert write_journals is not None
        from protocols.load import load_protocol

        study = load_protocol(Path("demo"))
        analysis = study.analysis
        rules = analysis.exclusions.model_copy(update={"rt_max_s": 1.4})
        analysis = analysis.model_copy(update={"exclusions": rules})
        study = study.model_copy(update={"analysis": analysis})
        sessions = write_journals(folder / "sessions", people=4, study=study)
        report_sessions(sessions, study, folder / "report", figure_files="none")
        return folder / "report"
    kind, options, make = TABLES[name]
    make().to_csv(folder / f"{name}.csv", index=False)
    write_note(folder / f"{name}.csv", analysis_of(kind).options(**options))
    report_decisions(folder / f"{name}.csv", folder / "report", figure_files="none")
    return folder / "report"


def answer_of(name: str, folder: Path) -> dict[str, Any]:
    """Return what a command of one table says and writes."""

    study, (command, *rest) = COMMANDS[name]
    rows = TABLES[study][2]()
    if command == "reaction":
        rows = rows.drop(columns=["expected", "answer"], errors="ignore")
    rows.to_csv(folder / "rows.csv", index=False)
    arguments = ["analysis", command, str(folder / "rows.csv"), *rest, "--out", str(folder / "out")]
    metamerlab(*arguments, env={"COLUMNS": "200"})
    if (folder / "out" / "report.html").is_file():
        return told(folder / "out")
    said = json.loads((folder / "out" / "results.json").read_text())
    return {
        "numbers": rounded({"result": said["result"], "notes": said["notes"]}),
        "sentences": said["sentences"],
        "rows": [],
        "tables": _tables(folder / "out"),
    }


def told(report: Path) -> dict[str, Any]:
    """Return what a report says: numbers, sentences to paste, rows of the page's tables."""
    numbers = json.loads((report / "results.json").read_text())
    page = (report / "report.html").read_text(encoding="utf-8")
    page = re.sub(r"<svg.*?</svg>", "", page, flags=re.DOTALL)
    analysed, _, _ = page.partition('<h2 id="quality">')
    return {
        "numbers": {part: rounded(numbers[part]) for part in PARTS},
        "sentences": [_text(one) for one in re.findall(r"<p>(.*?)</p>", page.split('id="apa"')[1])],
        "notes": [_text(one) for one in re.findall(r"<li>(.*?)</li>", page)],
        "rows": [" | ".join(_cells(one)) for one in re.findall(r"<tr>.*?</tr>", analysed)],
        "tables": _tables(report / "tables"),
    }


def _tables(folder: Path) -> dict[str, Any]:
    own = ("decisions", "dictionary", "attempts", "sessions", "answers", "pwcmp")
    return {
        file.stem: rounded(pd.read_csv(file).astype(object).to_numpy().tolist())
        for file in sorted(folder.glob("*.csv"))
        if file.stem not in own
    }


def _cells(row: str) -> list[str]:
    return [_text(cell) for cell in re.findall(r"<t[dh][^>]*>(.*?)</t[dh]>", row)]


def _text(markup: str) -> str:
    return html.unescape(re.sub(r"<[^>]+>", "", markup)).strip()


def rounded(value: Any) -> Any:
    """Return nested values with stored digits; NaN becomes None."""
    if isinstance(value, float):
        return None if np.isnan(value) else float(f"{value:.{DIGITS}g}")
    if isinstance(value, Mapping):
        return {name: rounded(one) for name, one in value.items()}
    return [rounded(one) for one in value] if isinstance(value, list) else value


def leaves(value: Any, path: str = "") -> Iterator[tuple[str, Any]]:
    """Yield every single value with its path, such as ``results.rates.0.share``."""
    if isinstance(value, Mapping | list):
        pairs = value.items() if isinstance(value, Mapping) else enumerate(value)
        for name, one in pairs:
            yield from leaves(one, f"{path}.{name}" if path else str(name))
    else:
        yield path, value


def main(names: list[str]) -> None:
    """Store what is said of these studies, or of all but `SESSIONS`, which need a fixture."""
    from undrawn_reports import undrawn

    STORED.mkdir(exist_ok=True)
    for name in names or (*TABLES, *COMMANDS):
        with tempfile.TemporaryDirectory() as folder, undrawn():
            path = Path(folder)
            store(name, answer_of(name, path) if name in COMMANDS else told(report_of(name, path)))


def store(name: str, said: Mapping[str, Any]) -> None:
    """Write what is said of a study."""
    text = json.dumps(said, ensure_ascii=False, separators=(",", ":"), sort_keys=True)
    (STORED / f"{name}.json").write_text(text + "\n", encoding="utf-8")


if __name__ == "__main__":
    main(sys.argv[1:])
