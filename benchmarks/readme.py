"""The README's table of measurements, from `benchmarks/results/`: `script/bench readme`."""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Callable, Sequence
from pathlib import Path

from benchmarks.shared.output import PagePart, Record

PART = PagePart("measured")
ROOT = Path(__file__).resolve().parents[1]
RESULTS = ROOT / "benchmarks/results"
GPUS = "gpu/*.json"  # of the results: what script/prove-gpu wrote, one a graphics card
EDGE_PX, MASK = 1024, "thin"


def main(argv: list[str]) -> int:
    """Put the table into the README."""
    parser = argparse.ArgumentParser(prog="script/bench readme", description=__doc__)
    parser.add_argument("--results", type=Path, default=RESULTS)
    parser.add_argument("--readme", type=PART.page, default=ROOT / "README.md")
    arguments = parser.parse_args(argv)
    text = table(arguments.results)
    PART.replace(arguments.readme, text)
    print(text)
    return 0


def table(results: Path) -> str:
    """Return the table in Markdown, and what it was measured on; every number comes from a JSON.

    Raises
    ------
    OSError, KeyError, StopIteration
        If a file or a number is missing: run the benchmark that the table names.
    """
    data = _Results(results)
    cards = graphics_cards(results)
    head = ["what", "measured", *cards, "`script/bench`", "revision"]
    lines = [_line(head), _line(["---"] * len(head))]
    rows = [*ROWS[:OWN_GPU_ROW], *(GPU_ROWS if cards else ()), *ROWS[OWN_GPU_ROW:]]
    for what, name, measured in rows:
        on_cards = [_on_card(card, CARD_FRAMES.get(what, ())) for card in cards.values()]
        lines.append(_line([what, measured(data), *on_cards, f"`{name}`", data.revision(name)]))
    said = "Measured on two cores with Mesa's software renderer. No real GPU has been measured."
    if cards:
        revisions = ", ".join(f"{name} at {card['revision']}" for name, card in cards.items())
        said = (
            "Measured on two cores with Mesa's software renderer, and on graphics cards by"
            f" `script/prove-gpu` ({revisions}): time on the GPU / time of the host, ms."
        )
    return "\n".join([*lines, "", said])


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


def _on_card(card: Record, wanted: Sequence[tuple[str, str, int]]) -> str:
    """Times of a card; a frame that it did not measure has none."""
    rows = {(row["bench"], row["name"], row["edge_px"]): row for row in card["rows"]}
    cells = []
    for frame in wanted:
        row = rows.get(frame)
        cells.append("-" if row is None else f"{row['gpu_ms']:.2f} / {row['host_ms']:.2f}")
    return "; ".join(cells)


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


def _ours(data: _Results) -> str:
    shown = [f"{data.fill(OUR_FILLS[0])['median_ms']:.0f} ms"]
    for name in OUR_FILLS[1:]:
        entry = data.fill(name)
        shown.append(f"{entry['median_ms']:.0f} ms ({entry['to_push_pull']:.2f} times)")
    return " / ".join(shown)


def _others(data: _Results) -> str:
    return " / ".join(
        f"{data.fill(name)['median_ms']:.0f} ms ({data.fill(name)['to_push_pull']:.2f} times)"
        for name in ("telea", "oiio-push-pull")
    )


def _clips(data: _Results) -> str:
    stimuli = data["stimuli"]
    speeds = {entry["method"]: entry["build_fps"] for entry in stimuli["speeds"]}
    width = stimuli["width_px"]
    return (
        f"{width} x {width * 3 // 4} px: {speeds['metameric']:.0f} frames/s; two processes"
        f" {stimuli['two_processes_over_one']['median']:.2f} times one"
    )


def _session(data: _Results) -> str:
    entry = next(one for one in data["session"]["sessions"] if one["gaze_hz"] == 250)
    return f"{entry['wall_s']:.1f} s, for {entry['shown_s']:.0f} s of trials"


def _bootstrap(data: _Results) -> str:
    entry = next(one for one in data["analysis"]["timings"] if "JOD" in one["name"])
    return f"{entry['median_ms']:.0f} ms"


def _false_positives(data: _Results) -> str:
    entry = next(
        one
        for one in data["analysis"]["test_rates"]
        if (one["participant_sd"], one["scene_sd"]) == (0.5, 0.5)
    )
    return f"{100 * entry['pooled']:.1f} % / {100 * entry['two_way']:.1f} %"


def _warps(data: _Results) -> str:
    return " / ".join(f"{data.fill('warp', edge)['median_ms']:.0f} ms" for edge in (1024, 2048))


OUR_FILLS = ("push-pull", "push-pull-depth", "coherence-transport", "metameric")
FILL = f"fill {EDGE_PX}², 5 % thin holes: {' / '.join(OUR_FILLS)}"
WARP, FILL_2048 = "warp 1024² / 2048²", "fill 2048², 5 % thin holes: metameric"
METAMER = "foveated metamer 1024² / 2048² / 4096²"
Row = tuple[str, str, Callable[[_Results], str]]
ROWS: tuple[Row, ...] = (
    (FILL, "fill", _ours),
    ("the same: OpenCV's Telea / OpenImageIO's push-pull, on the CPU", "fill", _others),
    ("clips of `metameric`, built and hashed", "stimuli", _clips),
    ("a simulated session, 72 decisions, gaze at 250 Hz", "session", _session),
    ("1,000 bootstraps of a JOD scale, 6 conditions x 11 observers", "analysis", _bootstrap),
    (
        "false positives at .05, people and scenes differ by .5 logits: pooled test / ours",
        "analysis",
        _false_positives,
    ),
)
OWN_GPU_ROW = 2  # behind the fills
GPU_ROWS: tuple[Row, ...] = (
    (FILL_2048, "fill", lambda data: f"{data.fill('metameric', 2048)['median_ms']:.0f} ms"),
    (WARP, "fill", _warps),
    (METAMER, "fill", lambda _: "[foveation](docs/foveation.md#time-and-memory)"),
)
CARD_FRAMES: dict[str, tuple[tuple[str, str, int], ...]] = {
    FILL: tuple(("fill", name, EDGE_PX) for name in OUR_FILLS),
    FILL_2048: (("fill", "metameric", 2048),),
    WARP: tuple(("warp", "warp", edge_px) for edge_px in (1024, 2048)),
    METAMER: tuple(("foveate", "metamer", edge_px) for edge_px in (1024, 2048, 4096)),
}


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
