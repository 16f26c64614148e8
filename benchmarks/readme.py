"""The README's tables of measurements, from `benchmarks/results/`: `script/bench readme`."""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Callable
from functools import partial
from pathlib import Path

from benchmarks.shared.output import PagePart, Record

PART = PagePart("measured")
ROOT = Path(__file__).resolve().parents[1]
RESULTS = ROOT / "benchmarks/results"
GPUS = "gpu/*.json"  # of the results: what script/prove-gpu wrote, one a graphics card
EDGE_PX, MASK = 1024, "thin"


def main(argv: list[str]) -> int:
    """Put the tables into the README."""
    parser = argparse.ArgumentParser(prog="script/bench readme", description=__doc__)
    parser.add_argument("--results", type=Path, default=RESULTS)
    parser.add_argument("--readme", type=PART.page, default=ROOT / "README.md")
    arguments = parser.parse_args(argv)
    text = table(arguments.results)
    PART.replace(arguments.readme, text)
    print(text)
    return 0


def table(results: Path) -> str:
    """Return two tables in Markdown, and what they were measured on; each number is from a JSON.

    Raises
    ------
    OSError, KeyError, StopIteration
        If a file or a number is missing: run the benchmark that the table names.
    """
    data, cards = _Results(results), graphics_cards(results)
    head = ["milliseconds a frame", f"two cores, {EDGE_PX}²"]
    head += [f"{card}, {edge_px}²" for card in cards for edge_px in CARD_EDGES_PX]
    frames = [_line(head), _line(["---", *["---:"] * (len(head) - 1)])]
    for what, bench, name in FRAMES:
        own = f"{data.fill(name)['median_ms']:.0f}" if bench != "foveate" else "-"
        on_cards = [
            _on_card(card, (bench, name, edge_px))
            for card in cards.values()
            for edge_px in CARD_EDGES_PX
        ]
        frames.append(_line([what, own, *on_cards]))
    rows = [_line(["what", "measured", "`script/bench`", "revision"]), _line(["---"] * 4)]
    for what, name, measured in ROWS:
        rows.append(_line([what, measured(data), f"`{name}`", data.revision(name)]))
    said = (
        "From an idle GPU to an idle GPU; 5 % of the pixels are thin holes. Two cores have Mesa's"
        f" software renderer (revision {data.revision('fill')})."
    )
    if cards:
        revisions = ", ".join(f"{name} at {card['revision']}" for name, card in cards.items())
        said += f" Graphics cards were measured by `script/prove-gpu` ({revisions})."
        unprobed = [
            name for name, card in cards.items() if not all("probes_ms" in r for r in card["rows"])
        ]
        said += "".join(
            f" {name} was measured before the clock of cards was probed: single numbers may be up"
            " to four times too high."
            for name in unprobed
        )
    else:
        said += " No real GPU has been measured."
    return "\n".join([*frames, "", said, "", *rows])


def graphics_cards(results: Path) -> dict[str, Record]:
    """Return what `script/prove-gpu` found on each graphics card, by its name."""
    found = [json.loads(path.read_text(encoding="utf-8")) for path in sorted(results.glob(GPUS))]
    return {
        one["renderer"]["name"].partition("/")[0]: one
        for one in found
        if not one["renderer"]["software"] and not one["quick"]
    }


def _line(cells: list[str]) -> str:
    return f"| {' | '.join(cells)} |"


def _on_card(card: Record, frame: tuple[str, str, int]) -> str:
    """Time of a frame; one that the card did not measure has none."""
    rows = {(row["bench"], row["name"], row["edge_px"]): row for row in card["rows"]}
    return f"{rows[frame]['frame_ms']:.2f}" if frame in rows else "-"


class _Results:
    """The results by benchmark."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._read: dict[str, Record] = {}

    def __getitem__(self, name: str) -> Record:
        if name not in self._read:
            text = (self._folder / f"{name}.json").read_text(encoding="utf-8")
            self._read[name] = json.loads(text)
        return self._read[name]

    def revision(self, name: str) -> str:
        """Revision of the code that was measured."""
        return str(self[name]["revision"])

    def fill(self, method: str, edge_px: int = EDGE_PX) -> Record:
        """A method's timing with the mask `MASK`."""
        return next(
            entry
            for entry in self["fill"]["timings"]
            if (entry["method"], entry["edge_px"], entry["mask"]) == (method, edge_px, MASK)
        )


def _clips(data: _Results) -> str:
    speeds = {entry["method"]: entry["build_fps"] for entry in data["stimuli"]["speeds"]}
    return f"{speeds['metameric']:.0f} frames/s"


def _session(data: _Results) -> str:
    entry = next(one for one in data["session"]["sessions"] if one["gaze_hz"] == 250)
    return f"{entry['wall_s']:.1f} s"


def _bootstrap(data: _Results) -> str:
    entry = next(one for one in data["analysis"]["timings"] if "JOD" in one["name"])
    return f"{entry['median_ms']:.0f} ms"


def _false_positives(test: str, data: _Results) -> str:
    entry = next(
        one
        for one in data["analysis"]["test_rates"]
        if (one["participant_sd"], one["scene_sd"]) == (0.5, 0.5)
    )
    return f"{100 * entry[test]:.1f} %"


FRAMES = (
    ("warp", "warp", "warp"),
    *((f"fill: {name}", "fill", name) for name in ("push-pull", "push-pull-depth", "metameric")),
    ("fill: coherence-transport", "fill", "coherence-transport"),
    ("foveated metamer, from the picture on", "foveate", "metamer"),
)
CARD_EDGES_PX = (1024, 2048, 4096)
ROWS: tuple[tuple[str, str, Callable[[_Results], str]], ...] = (
    ("clips of `metameric`, 512 x 384 px, built and hashed", "stimuli", _clips),
    ("a simulated session, 72 decisions, gaze at 250 Hz", "session", _session),
    ("1,000 bootstraps of a JOD scale, 6 conditions x 11 observers", "analysis", _bootstrap),
    (
        "false positives at .05, people and scenes differ by .5 logits: ours",
        "analysis",
        partial(_false_positives, "two_way"),
    ),
    ("the same: the papers' pooled test", "analysis", partial(_false_positives, "pooled")),
)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
