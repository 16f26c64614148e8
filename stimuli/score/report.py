"""Everything about a set of scores in one folder, and one page that needs no other file."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from markupsafe import Markup
from matplotlib.figure import Figure

from protocols.html_page import html_page
from protocols.revision import code_revision, package_version
from protocols.whole_file import write_whole
from stimuli.score import plots
from stimuli.score.available import versions
from stimuli.score.metrics import HOLES, METRICS
from stimuli.score.run import Results
from stimuli.score.tables import Duel, Table, all_duels, all_tables, tables_csv, tables_latex
from stimuli.score.write import (
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

_AGAINST_TIME = ("fvvdp-1.0", "fvvdp", "cvvdp", "lpips", "statistics")


@dataclass(frozen=True)
class _Drawn:
    name: str
    caption: str
    svg: Markup


def write_report(
    results: Results,
    out: Path,
    *,
    times_ms: dict[str, float] | None = None,
    renderer: str = "",
    report: Callable[[str], None] | None = None,
    focus: str | None = None,
) -> Path:
    """Write tables, figures and the page into `out`; return the page. JSON comes last.

    `focus` is the method that words compare with every other; see `all_duels`.
    """
    say = report or (lambda _: None)
    times_ms = times_ms or {}
    tables = all_tables(results)
    found = all_duels(tables, focus)
    say("drawing figures")
    drawn = _draw(results, tables, times_ms, out)
    say("writing tables")
    write_text(out / CSV_NAME, scores_csv(results))
    write_text(out / FRAMES_NAME, frames_csv(results))
    if results.curves:
        write_text(out / BANDS_NAME, bands_csv(results))
    write_text(out / TABLES_NAME, tables_markdown(tables, found))
    write_text(out / LATEX_NAME, tables_latex(tables))
    write_text(out / TABLES_CSV_NAME, tables_csv(tables))
    write_text(out / HTML_NAME, _page(results, tables, found, drawn, times_ms, renderer))
    write_text(out / JSON_NAME, json_text(scores_json(results, times_ms, renderer)))
    return out / HTML_NAME


def tables_markdown(tables: tuple[Table, ...], found: tuple[Duel, ...]) -> str:
    """Return all tables and what they say, for a document."""
    parts = [f"**{table.title}**\n\n{table.markdown()}\n" for table in tables]
    if found:
        parts.append(duels_markdown(found))
    return "\n".join(parts)


def duels_markdown(found: tuple[Duel, ...]) -> str:
    """Say of each metric whether the method beats its rival, and where it is worse."""
    lines = []
    for duel in found:
        lost = f" (worse in {', '.join(map(duel.table.shown, duel.lost))})" if duel.lost else ""
        lines.append(f"- {duel.sentence}{lost}.")
    return "\n".join(lines) + "\n"


def _draw(
    results: Results, tables: tuple[Table, ...], times_ms: dict[str, float], out: Path
) -> dict[str, list[_Drawn]]:
    drawn: dict[str, list[_Drawn]] = {"scenes": [], "bands": [], "time": [], "scale": []}

    def keep(group: str, name: str, caption: str, figure: Figure) -> None:
        drawn[group].append(
            _Drawn(name, caption, Markup(plots.figure_element(figure, name, caption)))
        )
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
    for metric in (METRICS[name] for name in _AGAINST_TIME):
        figure = plots.trade_off(results, metric, HOLES, times_ms)
        if metric in results.metrics and figure is not None:
            caption = f"{metric.label} in holes, mean of all scenes, against the time of one fill."
            keep("time", f"time-{metric.name}".replace(".", "-"), caption, figure)
    top, rows = plots.error_maps(results)
    if rows:
        label = f"{results.map_metric}, mean over the frames"
        keep("scale", "error-scale", label, plots.colour_bar(top, label))
    return drawn


def _page(
    results: Results,
    tables: tuple[Table, ...],
    found: tuple[Duel, ...],
    drawn: dict[str, list[_Drawn]],
    times_ms: dict[str, float],
    renderer: str,
) -> str:
    first = results.subjects.items[0].pair
    return html_page(
        "stimuli.score",
        "scores.html",
        title=results.subjects.origin.get("study") or results.subjects.items[0].name,
        tables=tables,
        verdicts=[
            (against, [duel for duel in found if duel.against == against])
            for against in dict.fromkeys(duel.against for duel in found)
        ],
        drawn=drawn,
        pictures=plots.middle_frames(results),
        maps=plots.error_maps(results)[1],
        map_metric=results.map_metric,
        holes=bool(first.masks),
        map_inside=bool(first.masks) and results.map_metric == "FLIP",
        metrics=results.metrics,
        missing=results.missing,
        notes=results.notes,
        origin=results.subjects.origin,
        viewing=results.settings.viewing,
        gaze=results.settings.gaze.points_px,
        versions=versions(results.metrics),
        made_with=f"{package_version()}, revision {code_revision()}",
        frames=first.frames,
        size=(first.width_px, first.height_px),
        fps=first.fps,
        clips=len(results.subjects.items),
        times_ms=times_ms,
        labels=results.subjects.labels,
        renderer=renderer,
    )
