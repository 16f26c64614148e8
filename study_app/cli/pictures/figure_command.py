"""`metamerlab figure`: the figure that a paper opens with."""

from __future__ import annotations

import csv
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from protocols.disk.whole_file import decoded_text
from protocols.errors import StudyError
from protocols.limits import check_cells
from protocols.load import load_protocol
from protocols.manifest import read_manifest
from protocols.outside import bounded_bytes, lines_of, reading
from protocols.results import NAME, read_results
from study_app.cli.options import one_of
from study_app.cli.terminal import say

if TYPE_CHECKING:
    from pipeline.pictures.drawing import Crop
    from stimuli.warp.teaser import RowSettings

ENDINGS = (".pdf", ".svg", ".png")
MINUS = "\N{MINUS SIGN}"


@dataclass(frozen=True)
class ShownOptions:
    """Methods, scenes, places and scores that a figure shows, and its width."""

    crops: Annotated[list[str] | None, typer.Option(metavar="auto|X,Y,W,H")] = None
    """Crop to show, in pixels of the clip; may be given more than once. auto: where the methods
    differ most."""
    count: Annotated[int, typer.Option(min=1, max=4)] = 2
    """Number of crops that auto takes."""
    methods: Annotated[str | None, typer.Option(metavar="A,B,...")] = None
    """Methods, in this order; left out: all."""
    scene: list[str] | None = None
    """Scene; each gets a row. Left out: the one whose crops differ most."""
    size: str | None = None
    """Size of the holes. Left out: the one whose crops differ most."""
    frame: Annotated[int | None, typer.Option(min=0)] = None
    """Frame. Left out: the one whose crops differ most."""
    report: Path | None = None
    """Folder of the study's report: scores stand under the methods."""
    score: Annotated[str, typer.Option(metavar="jod|share")] = "jod"
    """Score of the report to print."""
    columns: Annotated[int, typer.Option(min=1, max=2)] = 2
    """Width in columns of a paper: 1 or 2."""

    def rows(self) -> RowSettings:
        """Return the choice of rows."""
        from stimuli.warp.teaser import RowSettings

        named = () if self.methods is None else self.methods.split(",")
        return RowSettings(
            tuple(name.strip() for name in named),
            tuple(self.scene or ()),
            self.size,
            self.frame,
            tuple(_crops(self.crops or ["auto"])),
            self.count,
        )


def figure(
    source: Annotated[
        Path,
        typer.Argument(
            help="Folder of built clips, a study's .toml file with its clips in clips/, or a folder"
            " of steps that 'metamerlab warp --steps' wrote.",
            metavar="CLIPS|STUDY|STEPS",
        ),
    ],
    out: Annotated[Path, typer.Option(help="Figure to write: .pdf, .svg or .png.")] = Path(
        "figure.pdf"
    ),
    protocol: Annotated[
        Path | None, typer.Option(help="Study of the clips, for its labels.")
    ] = None,
    *,
    shown: ShownOptions,
) -> None:
    """Draw the first figure of a paper: a true view, and crops of what each method shows.

    Crops are where the methods differ most, or where you say. Text stays text, and pixels are
    not smoothed.

    Examples:

        metamerlab figure clips --out teaser.pdf

        metamerlab figure study.toml --methods ours,push-pull,reference --report report \\
            --columns 1 --out narrow.pdf

        metamerlab figure clips --scene garden --size large --crops 120,80,64,48 --out figure.svg

        metamerlab figure steps --out fills.pdf
    """
    from protocols.disk.whole_file import write_whole
    from stimuli.score.plots import png_bytes, vector_bytes
    from stimuli.warp.teaser import figure_rows, of_clips, of_steps, teaser

    if out.suffix not in ENDINGS:
        raise StudyError(f"--out: must end in {', '.join(ENDINGS)} (got {out})")
    one_of("--score", shown.score, ("jod", "share"))
    is_study = source.suffix == ".toml"
    clips = source.parent / "clips" if is_study else source
    study = source if is_study else protocol
    labels = {} if study is None else dict(load_protocol(study, recorded=True).stimuli.labels())
    built = is_study or (clips / "manifest.json").exists() or not clips.is_dir()
    chosen, rows = figure_rows(
        of_clips(clips, read_manifest(clips)) if built else of_steps(clips),
        shown.rows(),
        labels,
    )
    scores: Mapping[str, str] = {}
    simulated = False
    if shown.report is not None:
        sizes = list(dict.fromkeys(row.size for row in rows))
        if len(sizes) > 1:
            raise StudyError(
                "--size: a figure shows scores of one size (the chosen crops are of"
                f" {' and '.join(map(str, sizes))}); choose one"
            )
        scores, simulated = _scores(shown.report, shown.score, sizes[0])
    made = teaser(
        chosen, rows, columns=shown.columns, labels=labels, scores=scores, simulated=simulated
    )
    data = png_bytes(made) if out.suffix == ".png" else None
    if data is None:
        data = vector_bytes(made, "svg" if out.suffix == ".svg" else "pdf")
    try:
        out.parent.mkdir(parents=True, exist_ok=True)
        write_whole(out, data)
    except OSError as error:
        raise StudyError(f"{out}: must be writable ({error.strerror})") from None
    for row in rows:
        places = " ".join(f"--crops {','.join(map(str, crop))}" for crop in row.crops)
        say(f"{', '.join(row.condition) or clips}: --frame {row.frame} {places}")
    say(f"wrote {out}")


def _crops(given: list[str]) -> list[Crop]:
    from pipeline.pictures.drawing import Crop

    if given == ["auto"]:
        return []
    found = []
    for text in given:
        try:
            x, y, width, height = (int(part) for part in text.split(","))
        except ValueError:
            raise StudyError(
                f"--crops: must be auto, or x,y,width,height in whole pixels (got {text!r})"
            ) from None
        found.append(Crop(x, y, width, height))
    return found


def _scores(report: Path, kind: str, size: str | None) -> tuple[Mapping[str, str], bool]:
    """Return a line of a report for each method, and whether its data are simulated."""
    path = report / NAME
    try:
        read = read_results(path)
        if kind == "jod":
            scale: Any = read.results["scale"]
            return _jods(scale["sizes"], size), read.simulated
        path = report / "tables" / "preferences.csv"
        with reading(path, "a table of preferences in UTF-8", StudyError):
            text = decoded_text(bounded_bytes(path, StudyError, "table"), [])
            check_cells(path, text)
            rows = list(csv.DictReader(lines_of(text)))
        return _shares(rows, size), read.simulated
    except FileNotFoundError as error:
        raise StudyError(
            f"--report: must be a folder that 'metamerlab analysis report' wrote (there is no"
            f" {error.filename})"
        ) from None
    except (KeyError, TypeError, ValueError, StopIteration):
        raise StudyError(
            f"{path}: must be the report of preferences"
            + (f" with the size {size!r}" if size else "")
            + " (it has no such scores)"
        ) from None


def _jods(scales: list[dict[str, Any]], size: str | None) -> dict[str, str]:
    entry = next(each for each in scales if size is None or each["size"] in (size, "all"))
    scale, limits = entry["scale"], entry["intervals"]
    unit = str(scale["unit"])
    if limits is None:
        return {
            name: f"{value:z.2f} {unit}".replace("-", MINUS)
            for name, value in zip(scale["conditions"], scale["scores"], strict=True)
        }
    rows = zip(scale["conditions"], scale["scores"], limits["lower"], limits["upper"], strict=True)
    return {
        name: f"{value:z.2f} {unit}\n[{lower:z.2f}, {upper:z.2f}]".replace("-", MINUS)
        for name, value, lower, upper in rows
    }


def _shares(rows: list[dict[str, str]], size: str | None) -> dict[str, str]:
    """Return the share of choices of each method, over all that it was compared with."""
    chosen: dict[str, int] = {}
    trials: dict[str, int] = {}
    for row in rows:
        if size is not None and row["size"] != size:
            continue
        count, first = int(row["trials"]), int(row["chosen"])
        for name, won in ((row["method"], first), (row["against"], count - first)):
            chosen[name] = chosen.get(name, 0) + won
            trials[name] = trials.get(name, 0) + count
    if not trials:
        raise ValueError
    return {name: f"chosen in\n{100 * chosen[name] / trials[name]:.0f} %" for name in trials}
