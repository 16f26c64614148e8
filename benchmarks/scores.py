"""The tables of benchmarks/results/scores.md: every built-in scene, three motions, by every metric.

`script/bench scores` builds the clips and scores them as `metamerlab stimuli score` does, one
batch per motion; with ``--docs benchmarks/results/scores.md`` it writes that page. Killed at
any point, it goes on where it was.
"""

from __future__ import annotations

import argparse
import json
import sys
import tomllib
from collections.abc import Sequence
from pathlib import Path

from benchmarks.shared.output import PagePart, Record, file_to_write
from pipeline.colour import YCBCR_FROM_RGB
from protocols.load import load_display, shipped
from protocols.study_file.schema import StudyProtocol
from stimuli.batch.build import build
from stimuli.batch.build_plan import BuildPlan
from stimuli.batch.executors import cores, local_processes
from stimuli.scenes.builtin_scenes import scene_names
from stimuli.score.batch import subjects_of_batch
from stimuli.score.measure_clips import ScoreResults, ScoreSettings, score
from stimuli.score.metrics import HOLES, choose_metrics
from stimuli.score.report import duels_markdown, write_pages
from stimuli.score.tables import OURS, RIVALS, ScoreTable, all_tables, duels, method_order
from stimuli.score.viewing_conditions import standard_fhd
from stimuli.score.write_scores import CACHE_FOLDER, JSON_NAME
from study_app.cli.progress import progress_line

MOTIONS: dict[str, Record] = {
    "lateral": {"kind": "line", "direction": (1.0, 0.0, 0.0)},
    "vertical": {"kind": "line", "direction": (0.0, 1.0, 0.0)},
    "6dof": {
        "kind": "keyframes",
        "keyframes": (
            {"t_s": 0.0, "position_m": (-0.8, 0.3, -0.4), "yaw_deg": -1.0, "roll_deg": -1.0},
            {"t_s": 0.2, "position_m": (0.2, -0.6, 0.3), "pitch_deg": 1.0},
            {"t_s": 0.4, "position_m": (0.9, 0.4, 0.5), "yaw_deg": 1.0, "roll_deg": 1.0},
        ),
    },
}
METHODS = ("reference", "metameric", "push-pull", "push-pull-depth", "background-extension")
SIZE = {"name": "medium", "hole_share": 0.05}
FRAMES, FPS = 12, 30.0
SCENE_SEED = 1
LEFT_OUT = {
    # What reaches from floor to ceiling uncovers too little when the camera rises: no path has 5 %.
    "vertical": ("colonnade", "street"),
}
HEADINGS = {
    "lateral": "Lateral motion",
    "vertical": "Vertical motion",
    "6dof": "Six degrees of freedom",
}
PART = PagePart("scores")


def protocol(motion: str, scenes: Sequence[str], methods: Sequence[str]) -> StudyProtocol:
    """Return a study of built-in scenes, each on the path of `MOTIONS` called `motion`."""
    raw: Record = tomllib.loads(shipped("studies")["demo"].read_text(encoding="utf-8"))
    raw["study"] |= {"name": f"quality-{motion}", "title": f"The built-in scenes, {motion}"}
    stimuli = raw["stimuli"]
    stimuli["scenes"] = [
        {
            "name": f"{scene}-{motion}",
            "kind": "builtin",
            "builtin": scene,
            "seed": SCENE_SEED,
            "camera": MOTIONS[motion],
        }
        for scene in scenes
    ]
    stimuli["sizes"] = [SIZE]
    stimuli["methods"] = [{"name": name} for name in methods]
    stimuli["clips"] |= {
        "width_deg": 5.7, "height_deg": 4.3, "fps": FPS, "duration_s": FRAMES / FPS,
        "preview": False,
    }  # fmt: skip
    del raw["design"]["practice"], raw["task"]["catch"]
    raw["analysis"]["primary"] = {"method": methods[-1], "against": methods[0]}
    return StudyProtocol.model_validate_json(json.dumps(raw))


def make(motion: str, scenes: Sequence[str], methods: Sequence[str], out: Path) -> ScoreResults:
    """Build the clips of one motion and score them; what is there already stays."""
    study = protocol(motion, scenes, methods)
    orders = BuildPlan(study, load_display(study.display.display), Path.cwd())
    with progress_line(f"{motion}: building") as line:

        def report(done: int, total: int, what: str) -> None:
            line(done, total, f"{motion}: {what}")

        with local_processes(cores()) as pool:
            build(orders, out / "clips", pool, parallel=cores(), report=report)
        subjects = subjects_of_batch(out / "clips")
        settings = ScoreSettings(choose_metrics(None), standard_fhd())
        folder = out / "scores"
        results = score(
            subjects, settings, cache=folder / CACHE_FOLDER, workers=cores(), report=report
        )
        write_pages(results, folder)
    return results


def document(results: dict[str, ScoreResults]) -> str:
    """Return the tables of all motions, the paper's first, and where metameric is not ahead."""
    parts = []
    for motion, found in results.items():
        tables = all_tables(found)
        parts.append(f"### {HEADINGS[motion]}\n")
        parts += [f"{table.title}.\n\n{table.markdown()}\n" for table in tables if shown(table)]
        parts.append(f"Mean error of luma in holes, /255 (0 is right).\n\n{luma_error(found)}")
        for against in RIVALS:
            met = tuple(duel for duel in duels(tables, OURS, against) if shown(duel.table))
            parts.append(f"Metameric against {against}:\n\n{duels_markdown(met)}")
    return "\n".join(parts)


def luma_error(results: ScoreResults) -> str:
    """Return a table of the mean signed error of luma in holes: too bright is above 0."""
    methods = method_order(results)
    found: dict[str, dict[str, float]] = {}
    for item in results.subjects.items:
        errors = [
            float(((test - truth)[hole] @ YCBCR_FROM_RGB[0]).mean())
            for _, test, truth, hole in item.pair.walk()
            if hole.any()
        ]
        found.setdefault(item.scene, {})[item.method] = 255 * sum(errors) / len(errors)
    lines = [
        "| | " + " | ".join(methods) + " |",
        "| --- |" + " ---: |" * len(methods),
    ]
    for scene, row in found.items():
        lines.append(f"| {scene} | " + " | ".join(f"{row[name]:+.1f}" for name in methods) + " |")
    return "\n".join(lines) + "\n"


def shown(table: ScoreTable) -> bool:
    """True if a table goes into the document: all in holes, and two over the whole frame."""
    return table.region == HOLES or table.metric.name in ("fvvdp", "statistics")


def main(argv: list[str]) -> int:
    """Build, score, and write the document's tables and the stored numbers where asked."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, default=Path("out/scores"))
    parser.add_argument("--scenes", nargs="+", choices=scene_names(), default=scene_names())
    parser.add_argument("--motions", nargs="+", choices=list(MOTIONS), default=list(MOTIONS))
    parser.add_argument("--methods", nargs="+", default=list(METHODS))
    parser.add_argument("--docs", type=PART.page, help="document whose tables are replaced")
    parser.add_argument("--json", type=file_to_write, help="file to store the numbers in")
    arguments = parser.parse_args(argv)
    results = {
        motion: make(
            motion,
            [name for name in arguments.scenes if name not in LEFT_OUT.get(motion, ())],
            arguments.methods,
            arguments.out / motion,
        )
        for motion in arguments.motions
    }
    text = document(results)
    print(text)
    if arguments.docs is not None:
        PART.replace(arguments.docs, text)
    if arguments.json is not None:
        record = {
            motion: json.loads((arguments.out / motion / "scores" / JSON_NAME).read_bytes())
            for motion in results
        }
        text = json.dumps(record, indent=1).replace(str(Path.home()), "~")  # where weights belong
        arguments.json.write_text(text + "\n", encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
