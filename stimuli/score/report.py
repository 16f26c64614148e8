"""Everything about a set of scores in one folder, and one page that needs no other file."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path

from markupsafe import Markup
from matplotlib.figure import Figure as Plot

from protocols.blocks import (
    Block,
    Cautions,
    Figure,
    FigurePlace,
    Heading,
    MediaFile,
    MediaRow,
    Paragraph,
    Section,
    html_page,
)
from protocols.blocks import TableBlock as Rows
from protocols.disk.whole_file import write_whole
from protocols.errors import count_of
from protocols.revision import code_revision, package_version
from stimuli.score import plots
from stimuli.score.available import metric_versions
from stimuli.score.measure_clips import ScoreResults
from stimuli.score.tables import (
    BY_RING,
    PairedMethods,
    ScoreTable,
    all_duels,
    all_tables,
    tables_csv,
    tables_latex,
)
from stimuli.score.write_scores import (
    BANDS_NAME,
    CSV_NAME,
    FRAMES_NAME,
    HTML_NAME,
    JSON_NAME,
    LATEX_NAME,
    TABLES_CSV_NAME,
    TABLES_NAME,
    bands_csv,
    frames_csv,
    json_text,
    scores_csv,
    scores_json,
    write_text,
)

_WIDTHS_REM = {"scenes": 50.0, "bands": 50.0, "scale": 22.0}
"""Groups of figures, and how wide each is on the page."""


def write_pages(
    results: ScoreResults,
    out: Path,
    *,
    report: Callable[[str], None] | None = None,
    focus: str | None = None,
) -> Path:
    """Write tables, figures and the page into `out`; return the page. JSON comes last.

    `focus` is the method that words compare with every other; see `all_duels`.
    """
    say = report or (lambda _: None)
    tables = all_tables(results)
    found = all_duels(tables, focus)
    say("drawing figures")
    drawn = _draw(results, tables, out)
    say("writing tables")
    write_text(out / CSV_NAME, scores_csv(results))
    write_text(out / FRAMES_NAME, frames_csv(results))
    if results.curves:
        write_text(out / BANDS_NAME, bands_csv(results))
    write_text(out / TABLES_NAME, tables_markdown(tables, found))
    write_text(out / LATEX_NAME, tables_latex(tables))
    write_text(out / TABLES_CSV_NAME, tables_csv(tables))
    write_text(out / HTML_NAME, _page(results, tables, found, drawn))
    write_text(out / JSON_NAME, json_text(scores_json(results)))
    return out / HTML_NAME


def tables_markdown(tables: tuple[ScoreTable, ...], found: tuple[PairedMethods, ...]) -> str:
    """Return all tables and what they say, for a document."""
    parts = [f"**{table.title}**\n\n{table.markdown()}\n" for table in tables]
    if found:
        parts.append(duels_markdown(found))
    return "\n".join(parts)


def duels_markdown(found: tuple[PairedMethods, ...]) -> str:
    """Say of each metric whether the method beats its rival, and where it is worse."""
    lines = []
    for duel in found:
        lost = f" (worse in {', '.join(map(duel.table.shown, duel.lost))})" if duel.lost else ""
        lines.append(f"- {duel.sentence}{lost}.")
    return "\n".join(lines) + "\n"


def _draw(
    results: ScoreResults, tables: tuple[ScoreTable, ...], out: Path
) -> dict[str, dict[str, Figure]]:
    """Draw all figures into `out`, and return them by group and name."""
    drawn: dict[str, dict[str, Figure]] = {name: {} for name in _WIDTHS_REM}

    def keep(group: str, name: str, caption: str, figure: Plot) -> None:
        svg = Markup(plots.figure_element(figure, name, caption))
        drawn[group][name] = Figure(caption, svg, width_rem=_WIDTHS_REM[group])
        folder = out / "figures"
        folder.mkdir(parents=True, exist_ok=True)
        write_whole(folder / f"{name}.png", plots.png_bytes(figure))
        for kind in ("svg", "pdf"):
            write_whole(folder / f"{name}.{kind}", plots.vector_bytes(figure, kind))

    for table in tables:
        if plots.pictured(table):
            name = f"scenes-{table.metric.name}-{table.region}" + (
                f"-{table.size}" * bool(table.size)
            )
            how = (
                "The nearer to the line at 1 the better"
                if table.metric.better == "one"
                else "The farther to the right the better"
            )
            caption = f"{table.title}. {how}."
            keep("scenes", name.replace(".", "-"), caption, plots.dots(table))
    for number, scene in enumerate(dict.fromkeys(i.scene for i in results.subjects.items), 1):
        figure = plots.by_eccentricity(results, scene)
        if figure is not None:
            caption = (
                f"{results.subjects.shown(scene)}: deviation of the bands of each level (0 is the"
                " finest) over the reference's, in rings around the gaze. 1 is right."
            )
            keep("bands", f"bands-by-eccentricity-{number}", caption, figure)
    top, rows = plots.error_maps(results)
    if rows:
        label = f"{results.map_metric}, mean over the frames"
        keep("scale", "error-scale", label, plots.colour_bar(top, label))
    return drawn


def _page(
    results: ScoreResults,
    tables: tuple[ScoreTable, ...],
    found: tuple[PairedMethods, ...],
    drawn: dict[str, dict[str, Figure]],
) -> str:
    first, subjects = results.subjects.items[0].pair, results.subjects
    size = f"{first.width_px} x {first.height_px} px"
    rate = f", {first.fps:g} frames per second" if first.fps else ""
    viewing, gaze = results.settings.viewing, results.settings.gaze.points_px
    looks = (
        "not given (FovVideoVDP not foveated, statistics pooled around the middle)"
        if not gaze
        else "at {:g}, {:g} px".format(*gaze[0])
        if len(gaze) == 1
        else "given for every frame"
    )
    missing = tuple(
        Markup("<b>{}</b> not computed: {}.").format(", ".join(one.metrics), one.reason)
        for one in results.missing
    )
    sections = (
        *_verdicts(found),
        Section.of(
            "Tables", "A star marks the best of a row, by the digits shown.", *map(_rows, tables)
        ),
        Section.of("Pictures", *_pictures(results)),
        Section.of("Bands by eccentricity", *map(FigurePlace, drawn["bands"]), name="bands"),
        Section.of("Scene by scene", *map(FigurePlace, drawn["scenes"]), name="scenes"),
        Section.of("Where methods err", *_maps(results, drawn), name="maps"),
        Section.of("Metrics", *_metrics(results, masks=bool(first.masks))),
        Section.of("Provenance", _provenance(results)),
    )
    counted = f"{count_of(len(subjects.items), 'clip')} of {count_of(first.frames, 'frame')}"
    return html_page(
        f"Scores: {subjects.origin.get('study') or subjects.items[0].name}",
        under=f"{counted}, {size}{rate}; display {viewing.name}, {viewing.px_per_deg:.1f} px per"
        f" degree; gaze {looks}.",
        lead=(
            Cautions("What is not here, and why", (*missing, *(f"{n}." for n in results.notes))),
        ),
        sections=[one for one in sections if one.blocks],
        figures={name: one for group in drawn.values() for name, one in group.items()},
    )


def _verdicts(found: tuple[PairedMethods, ...]) -> Iterator[Section]:
    """Yield the verdict of each metric on the method against each rival."""
    for number, against in enumerate(dict.fromkeys(duel.against for duel in found)):
        duels = [duel for duel in found if duel.against == against]
        shown = duels[0].table.shown
        yield Section(
            f"verdict-{number}" if number else "verdict",
            f"{shown(duels[0].method)} against {shown(against)}",
            "" if number else "Verdict",
            ([_verdict(duel) for duel in duels],),
        )


def _verdict(duel: PairedMethods) -> str:
    said = '<span class="lost">{}.</span>' if duel.loses_on_average else "{}."
    lost = ", ".join(map(duel.table.shown, duel.lost))
    more = Markup(' <span class="muted">Worse in: {}.</span>').format(lost) if lost else ""
    return Markup(said).format(duel.sentence) + more


def _rows(table: ScoreTable) -> Rows:
    """Return the table of a page; the best of a row, as it is printed, bears a star."""
    rows = []
    for scene, values in table.rows:
        cells = table.cells(values, Markup('<b class="best">{}</b>').format)
        rows.append([table.shown(scene), *cells])
    totals = len(rows) > 1 and table.rows[-1][0] == "mean"
    heads = [
        ("ring" if table.region == BY_RING else "scene", "l"),
        *((head, "") for head in table.heads),
    ]
    return Rows.of(table.title, heads, rows, totals=totals)


def _pictures(results: ScoreResults) -> Iterator[Block]:
    shown = plots.middle_frames(results)
    if shown:
        yield (
            "Middle frames as they are seen, the gaze in the small ring. Look at the ring, and"
            " compare what is around it."
        )
    for scene, pictures in shown:
        yield Heading(scene)
        yield _shots(scene, pictures, 20.0)


def _shots(scene: str, pictures: list[tuple[str, str]], least_rem: float) -> MediaRow:
    return MediaRow(
        tuple(MediaFile(address, label, f"{scene}: {label}") for label, address in pictures),
        least_rem,
    )


def _maps(results: ScoreResults, drawn: dict[str, dict[str, Figure]]) -> Iterator[Block]:
    maps = plots.error_maps(results)[1]
    inside = bool(results.subjects.items[0].pair.masks) and results.map_metric == "FLIP"
    if maps:
        where = "the frames in which it is a hole" if inside else "all frames"
        yield (
            f"{results.map_metric} of every pixel, averaged over {where}; black is no error. One"
            " scale for all pictures:"
        )
        yield from map(FigurePlace, drawn["scale"])
    for scene, size, ((truth, address), *others) in maps:
        yield Heading(", ".join(filter(None, (scene, size))))
        yield _shots(scene, [(f"{truth}, middle frame", address), *others], 11.0)


def _metrics(results: ScoreResults, *, masks: bool) -> Iterator[Block]:
    yield Rows.each(
        "",
        results.metrics,
        ("metric", "l", lambda one: one.label + (f" ({one.unit})" if one.unit else "")),
        ("what", "l", lambda one: one.what),
        ("what it is blind to", "l", lambda one: one.blind),
        ("better", "l", lambda one: one.arrow),
        ("identical", "l", lambda one: f"{one.perfect:g}"),
        ("from", "l", lambda one: one.licence),
    )
    if masks:
        yield Paragraph(
            "Inside the disocclusions, every other pixel is set to the reference before anything"
            " is measured. Maps of errors (PSNR, SSIM, FLIP, statistics) are then averaged inside"
            " the holes; LPIPS and the video metrics give one number for the frame or clip.",
            muted=True,
        )


def _provenance(results: ScoreResults) -> Rows:
    rows = [
        ("scored with", f"metamerlab {package_version()}, revision {code_revision()}"),
        *results.subjects.origin.items(),
        *metric_versions(results.metrics).items(),
    ]
    return Rows.of("", [("", "l"), ("", "l")], [(key, str(value)) for key, value in rows])
