"""`metamerlab stimuli score`: how clips compare with their reference, by many metrics."""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich.console import Console

from protocols.errors import StudyError
from study_app.cli.progress import going_on, progress_line
from study_app.cli.terminal import PlainConsole, say, table_of

if TYPE_CHECKING:
    from protocols.manifest import Manifest
    from stimuli.score.batch import Subjects
    from stimuli.score.measure_clips import ScoreResults, ScoreSettings


@dataclass(frozen=True)
class ScoreOptions:
    """Options of `metamerlab stimuli score`: what is scored, how it is seen, what is written."""

    first: Annotated[Path | None, typer.Argument(metavar="DIR | TEST")] = None
    """Folder of built clips; or a clip (folder of frames) or picture to score."""
    second: Annotated[Path | None, typer.Argument(metavar="[REFERENCE]")] = None
    """The reference for TEST."""
    out: Path | None = None
    r"""Folder for tables, plots and the page. \[default for DIR: scores]"""
    metrics: Annotated[str | None, typer.Option(metavar="NAME,...")] = None
    r"""Only these, such as psnr,fvvdp. \[default: all that this machine can compute]"""
    display: str = "standard_fhd"
    """standard_fhd (as in the paper), a display's name, or a .toml file."""
    gaze: Annotated[str | None, typer.Option(metavar="X,Y | FILE")] = None
    """Gaze of the viewer, in pixels of the clip; or a CSV file with columns x_px and y_px and a
    line per frame. Left out: the dot of clips with a true view, at the distance they were made
    for; else not foveated."""
    mask: Path | None = None
    """For two clips or pictures: where the holes are (white), a picture or a folder."""
    panorama: bool = False
    """TEST and REFERENCE are equirectangular, 2:1: score the flat view around --gaze (left out: the
    middle), 90 degrees wide."""
    fps: Annotated[float, typer.Option(min=1.0, max=1000.0)] = 30.0
    """Frame rate of two folders of frames; videos have their own."""
    workers: Annotated[int | None, typer.Option(min=1)] = None
    r"""Processes at work. \[default: one per core]"""
    focus: Annotated[str | None, typer.Option(metavar="METHOD")] = None
    r"""For a batch: compare this method with every other. \[default: metameric against
    push-pull]"""
    protocol: Annotated[Path | None, typer.Option(metavar="STUDY")] = None
    r"""For a batch: its study, for labels instead of names on the page, in figures and in tables
    for people. \[default: names; of a shipped study its labels]"""


def score(
    *,
    options: ScoreOptions,
    list_metrics: Annotated[
        bool,
        typer.Option(
            "--list", help="List the metrics that this machine can compute, and what is missing."
        ),
    ] = False,
) -> None:
    """Score clips against their reference, in holes and over the frame.

    DIR scores a whole batch and writes tables, plots and one page; foveated images are scored
    around their gaze, at the distance they were made for. After an interruption the same
    command continues. docs/quality.md says what the metrics and JOD mean.

    Examples:

        metamerlab stimuli score clips --out scores

        metamerlab stimuli score filled.png truth.png --mask holes.png

        metamerlab stimuli score clips --metrics fvvdp,fvvdp-1.0 --display fhd27-60hz

        metamerlab stimuli score shown.png around.png --panorama --gaze 2048,900

        metamerlab stimuli score clips --focus ours --protocol study.toml

        metamerlab stimuli score --list
    """
    if list_metrics:
        _print_metrics()
        return
    if options.first is None:
        raise StudyError(
            "give a folder of built clips, or two clips or pictures; 'metamerlab stimuli"
            " score --help' has examples"
        )
    if options.panorama and (options.second is None or options.mask is not None):
        raise StudyError("--panorama is for TEST and REFERENCE, without --mask")
    with ExitStack() as gone:
        given = [_as_folder(gone, path) for path in (options.first, options.second, options.mask)]
        views = gone.enter_context(_views(options.panorama))
        rate = next((rate for _, rate in given if rate is not None), options.fps)
        first, second, mask = (path for path, _ in given)
        assert first is not None
        _score(replace(options, second=second, mask=mask, fps=rate), first, views)


def _labels(protocol: Path | None, manifest: Manifest) -> dict[str, str]:
    """Return the labels that a batch's study gives methods, sizes and scenes.

    Raises
    ------
    StudyError
        If the protocol given is another study's.
    """
    from protocols.load import load_protocol, shipped

    study = manifest.study
    if protocol is None:
        if study not in shipped("studies"):
            return {}
        found = load_protocol(Path(study))
        same = found.stimuli_sha256 == manifest.stimuli_sha256
        return dict(found.stimuli.labels()) if same else {}
    found = load_protocol(protocol, recorded=True)
    if found.study.name != study:
        raise StudyError(
            f"--protocol: must be the study of the clips, {study!r} (got {found.study.name!r})"
        )
    return dict(found.stimuli.labels())


def _as_folder(gone: ExitStack, path: Path | None) -> tuple[Path | None, float | None]:
    """Return a video as a folder of its frames, with its rate; all else as it is."""
    from pipeline.video_file import is_video
    from stimuli.media.video import unpacked_video

    if path is None or not is_video(path):
        return path, None
    unpacked = gone.enter_context(unpacked_video(path))
    for note in unpacked.notes:
        say(f"note: {path.name}: {note}")
    return unpacked.folder, unpacked.fps


@contextmanager
def _views(panorama: bool) -> Iterator[Path | None]:
    """A folder for flat views of panoramas, gone in the end."""
    if not panorama:
        yield None
        return
    with tempfile.TemporaryDirectory(prefix="metamerlab-views-") as folder:
        yield Path(folder)


def subjects_of(
    options: ScoreOptions, first: Path, views: Path | None
) -> tuple[Subjects, ScoreSettings]:
    """Return the subjects and settings of a comparison; panoramas by flat views in `views`.

    Raises
    ------
    StudyError
        If options exclude each other, or a file or folder is none to score.
    """
    from protocols.manifest import read_manifest
    from stimuli.score.batch import subjects_of_batch, subjects_of_two
    from stimuli.score.foveated import (
        METRICS_OF_FOVEATION,
        is_foveated,
        made_for,
        subjects_of_panoramas,
        subjects_of_stills,
    )
    from stimuli.score.measure_clips import ScoreSettings
    from stimuli.score.metrics import choose_metrics
    from stimuli.score.viewing_conditions import STANDARD_FHD, open_viewing, read_viewer_gaze

    second, mask, names = options.second, options.mask, options.metrics
    chosen = choose_metrics(None if names is None else [n.strip() for n in names.split(",")])
    settings = ScoreSettings(chosen, open_viewing(options.display), read_viewer_gaze(options.gaze))
    if second is None:
        if mask is not None:
            raise StudyError("--mask is for two clips or pictures: a batch has masks of its own")
        if first.is_file():
            raise StudyError(
                f"{first}: must be a folder of built clips (this is a file); to score a picture,"
                " give its reference as well: metamerlab stimuli score TEST REFERENCE"
            )
        manifest = read_manifest(first)
        if is_foveated(manifest):
            subjects, at, viewing = subjects_of_stills(first, manifest, settings.gaze)
            chosen = chosen if names is not None else choose_metrics(METRICS_OF_FOVEATION)
            settings = ScoreSettings(chosen, viewing, at)
        else:
            subjects = subjects_of_batch(first)
            if options.gaze is None and (known := made_for(manifest)) is not None:
                plain = options.display == STANDARD_FHD
                settings = ScoreSettings(chosen, known[1] if plain else settings.viewing, known[0])
        subjects = replace(subjects, labels=_labels(options.protocol, manifest))
    else:
        if options.protocol is not None:
            raise StudyError("--protocol is for a folder of built clips: two clips have no study")
        subjects = subjects_of_two(first, second, mask, options.fps)
        if views is not None:
            subjects, at, viewing = subjects_of_panoramas(subjects, settings.gaze, views)
            chosen = chosen if names is not None else choose_metrics(METRICS_OF_FOVEATION)
            settings = ScoreSettings(chosen, viewing, at)
    return subjects, settings


def _score(options: ScoreOptions, first: Path, views: Path | None) -> None:
    from protocols.disk.result_folder import whole_folder
    from stimuli.batch.executors import cores
    from stimuli.score.measure_clips import score as run
    from stimuli.score.report import write_pages
    from stimuli.score.tables import check_focus
    from stimuli.score.write_scores import CACHE_FOLDER, check_out

    focus = options.focus
    subjects, settings = subjects_of(options, first, views)
    folder = options.out or (Path("scores") if options.second is None else None)
    if focus is not None:
        check_focus(focus, list(dict.fromkeys(item.method for item in subjects.items)))
    reads = [path for path in (first, options.second, options.mask) if path is not None]
    if folder is not None:
        if folder.absolute().is_relative_to(first.absolute()):
            raise StudyError(
                f"{folder}: must not lie in the folder of clips, where only clips belong; choose"
                " another --out"
            )
        check_out(folder, reads)
    console = PlainConsole(soft_wrap=True)
    with going_on(), progress_line("starting") as report:
        results = run(
            subjects,
            settings,
            cache=None if folder is None else folder / CACHE_FOLDER,
            workers=options.workers or cores(),
            report=report,
        )
        page = None
        if folder is not None:
            with whole_folder(folder, replace=True, reads=reads, keeps=CACHE_FOLDER) as work:
                made = write_pages(
                    results, work, report=lambda what: report(1, 1, what), focus=focus
                )
            page = folder / made.name
    _print_results(console, results, focus)
    if page is not None:
        console.print(f"wrote {page}, and beside it CSV, JSON, Markdown tables and figures")


def _print_results(console: Console, results: ScoreResults, focus: str | None) -> None:
    from stimuli.score.metrics import FRAME, HOLES
    from stimuli.score.tables import BY_RING, all_duels, all_tables, summary

    for region, title in ((HOLES, "in holes"), (FRAME, "whole frame")):
        heads, rows = summary(results, region)
        if not any(cell != "-" for _, cells in rows for cell in cells):
            continue
        lines = [(method, *cells) for method, cells in rows]
        console.print(table_of((f"mean, {title}", *heads), lines, right=1, box=None))
    tables = all_tables(results)
    for table in tables:
        if table.region == BY_RING:
            lines = [(ring, *map(table.text, values)) for ring, values in table.rows]
            console.print(table_of((table.metric.name, *table.heads), lines, right=1, box=None))
    for duel in all_duels(tables, focus):
        if duel.table.region == HOLES:
            console.print(f"{duel.sentence}.")
    for note in results.notes:
        console.print(f"note: {note}")
    for entry in results.missing:
        console.print(f"left out: {', '.join(entry.metrics)}: {entry.reason}")


def _print_metrics() -> None:
    from stimuli.score.available import split_available
    from stimuli.score.metrics import METRICS

    there, missing = split_available(METRICS.values())
    rows = [
        (
            metric.name if metric in there else f"({metric.name})",
            metric.what,
            metric.arrow,
            str(metric.least_px),
            metric.licence,
        )
        for metric in METRICS.values()
    ]
    console = PlainConsole()
    console.print(table_of(("metric", "what", "better", "least px", "from"), rows, box=None))
    for entry in missing:
        console.print(f"missing: {', '.join(entry.metrics)}: {entry.reason}", soft_wrap=True)
