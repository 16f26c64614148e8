"""The preregistration of a study: what will be done and tested, with the hashes that prove it."""

from __future__ import annotations

import html
from dataclasses import dataclass
from typing import TypeAlias

from protocols.display import Display
from protocols.feasibility import clip_size_px, session_duration_s, virtual_manifest
from protocols.hashing import sha256_json
from protocols.manifest import Manifest
from protocols.plan import make_plan
from protocols.schema import StudyProtocol
from protocols.session_schema import Gaze


@dataclass(frozen=True)
class Table:
    """Rows under a header."""

    header: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]


Block: TypeAlias = "str | list[str] | Table"


@dataclass(frozen=True)
class Section:
    """A heading with paragraphs, lists and tables."""

    title: str
    blocks: tuple[Block, ...]


def preregistration(
    protocol: StudyProtocol, display: Display, revision: str, manifest: Manifest | None = None
) -> list[Section]:
    """Return the text of a preregistration.

    Parameters
    ----------
    protocol : StudyProtocol
        The study; everything said here is read from it.
    display : Display
        The display it runs on.
    revision : str
        Version and git revision of the program that will run it.
    manifest : Manifest, optional
        The clips, where they are built already: their hash is then part of the text.
    """
    return [
        _overview(protocol),
        _hashes(protocol, display, revision, manifest),
        _stimuli(protocol, display),
        _procedure(protocol, display),
        _analysis(protocol),
        Section(
            "Data",
            (
                [
                    "Participants are known by pseudonymous codes only.",
                    (
                        "Consent is asked and recorded."
                        if protocol.privacy.consent_required
                        else "Consent is not asked by the program."
                    ),
                    _stored_gaze(protocol),
                    (
                        f"Data is deleted after {protocol.privacy.retention_months} months."
                        if protocol.privacy.retention_months
                        else "How long data is kept is not stated."
                    ),
                ],
            ),
        ),
    ]


def to_markdown(title: str, sections: list[Section]) -> str:
    """Return the sections as Markdown."""
    lines = [f"# {title}", ""]
    for section in sections:
        lines += [f"## {section.title}", ""]
        for block in section.blocks:
            if isinstance(block, Table):
                lines.append("| " + " | ".join(map(_cell, block.header)) + " |")
                lines.append("| " + " | ".join("---" for _ in block.header) + " |")
                lines += ["| " + " | ".join(map(_cell, row)) + " |" for row in block.rows]
            elif isinstance(block, list):
                lines += [f"- {entry}" for entry in block]
            else:
                lines.append(block)
            lines.append("")
    return "\n".join(lines)


def to_html(title: str, sections: list[Section]) -> str:
    """Return the sections as one self-contained HTML page."""
    body = [f"<h1>{html.escape(title)}</h1>"]
    for section in sections:
        body.append(f"<h2>{html.escape(section.title)}</h2>")
        for block in section.blocks:
            if isinstance(block, Table):
                head = "".join(f"<th>{html.escape(cell)}</th>" for cell in block.header)
                body.append(f"<table><tr>{head}</tr>")
                for row in block.rows:
                    cells = "".join(f"<td>{html.escape(cell)}</td>" for cell in row)
                    body.append(f"<tr>{cells}</tr>")
                body.append("</table>")
            elif isinstance(block, list):
                entries = "".join(f"<li>{html.escape(entry)}</li>" for entry in block)
                body.append(f"<ul>{entries}</ul>")
            else:
                body.append(f"<p>{html.escape(block)}</p>")
    return _PAGE.format(title=html.escape(title), body="\n".join(body))


_PAGE = """<!doctype html>
<html lang="en">
<head><meta charset="utf-8"><meta name="viewport" content="width=device-width">
<title>{title}</title>
<style>
body {{ font: 16px/1.5 sans-serif; max-width: 48rem; margin: 2rem auto; padding: 0 1rem; }}
table {{ border-collapse: collapse; display: block; overflow-x: auto; }}
th, td {{ border: 1px solid #999; padding: .25rem .6rem; text-align: left; }}
td {{ overflow-wrap: anywhere; }}
</style></head>
<body>
{body}
</body></html>
"""


def _cell(text: str) -> str:
    return text.replace("|", "\\|")


def _label(name: str, label: str | None) -> str:
    return f"{label} ({name})" if label and label != name else name


def _overview(protocol: StudyProtocol) -> Section:
    info = protocol.study
    blocks: list[Block] = [info.description] if info.description else []
    if info.source:
        blocks.append(f"Follows: {info.source}.")
    blocks.append(f"Planned participants: {info.participants}. Study version {info.version}.")
    return Section("Study", tuple(blocks))


def _hashes(
    protocol: StudyProtocol, display: Display, revision: str, manifest: Manifest | None
) -> Section:
    rows = [
        ("protocol", protocol.sha256),
        ("what decides the stimuli", protocol.stimuli_sha256),
        ("display", sha256_json(display)),
        ("clips (manifest)", manifest.sha256 if manifest else "not built yet"),
        ("metamerlab", revision),
    ]
    return Section(
        "Hashes",
        (
            "SHA-256 of the canonical JSON of each part. Every session's journal repeats them, so"
            " that data can be traced to this text.",
            Table(("part", "SHA-256 or revision"), tuple(rows)),
        ),
    )


def _stimuli(protocol: StudyProtocol, display: Display) -> Section:
    width, height = clip_size_px(protocol, display)
    clips = protocol.clips
    sizes = [
        f"{_label(size.name, size.label)}: "
        + (
            f"mean hole share {100 * size.hole_share:g} %"
            if size.hole_share is not None
            else f"path extent {size.extent_m:g} m"
        )
        for size in protocol.sizes
    ]
    return Section(
        "Stimuli",
        (
            f"Clips of {clips.duration_s:g} s at {clips.fps:g} frames per second,"
            f" {clips.width_deg:g} x {clips.height_deg:g} deg ({width} x {height} px, never"
            f" rescaled) on {display.name}: {display.description or 'no description'}.",
            "Scenes: "
            + ", ".join(_label(scene.name, scene.label) for scene in protocol.main_scenes())
            + ".",
            "Sizes: " + "; ".join(sizes) + ".",
            Table(
                ("method", "registry name", "parameters"),
                tuple(
                    (
                        _label(method.name, method.label),
                        method.registry_name,
                        ", ".join(f"{k} = {v}" for k, v in method.parameters.items()) or "defaults",
                    )
                    for method in protocol.methods
                ),
            ),
        ),
    )


def _procedure(protocol: StudyProtocol, display: Display) -> Section:
    design, timing = protocol.design, protocol.trial
    plan = make_plan(protocol, virtual_manifest(protocol, display), "P000", 0)
    minutes = session_duration_s(protocol, len(plan.trials)) / 60
    entries = [
        f"{plan.main_trials} decisions per participant: pairings "
        + ", ".join(f"{a} / {b}" for a, b in protocol.pairings())
        + f", each in every scene and size {design.repeats} times, in both orders.",
        f"A trial: fixation {timing.fixation_s:g} s, first clip, blank {timing.gap_s:g} s, second"
        f" clip, answer"
        + (
            f" within {protocol.response.timeout_s:g} s"
            if protocol.response.timeout_s
            else " without time limit"
        )
        + f", blank {timing.iti_s:g} s. No feedback.",
        f"Scene order: {design.scene_order}. Sides: {design.side}. {design.blocks} block(s), breaks"
        f" of at least {design.break_s:g} s. Seed {design.seed}.",
        f"A void attempt is repeated later in its block, up to {design.max_attempts} attempts.",
        f"More than {timing.dropped_frames_max} missed refreshes make an attempt void.",
        _gaze(protocol.gaze),
        f"Estimated length without instructions: {minutes:.0f} min.",
    ]
    if design.practice:
        entries.append(f"{design.practice.trials} practice trials, never analysed.")
    if design.catch:
        entries.append(
            f"{design.catch.trials} catch trials ({design.catch.better} against"
            f" {design.catch.worse}, size {design.catch.size})."
        )
    return Section("Procedure", (entries,))


def _stored_gaze(protocol: StudyProtocol) -> str:
    if protocol.gaze.mode == "none":
        return "No gaze is recorded."
    return f"Gaze samples are {'' if protocol.privacy.store_gaze else 'not '}stored."


def _gaze(gaze: Gaze) -> str:
    if gaze.mode == "none":
        return "Gaze is not tracked."
    consequence = {
        "enforce": "makes the attempt void",
        "warn": "is told to the participant afterwards",
        "monitor": "is recorded",
    }[gaze.mode]
    return (
        f"Gaze outside {gaze.window_deg:g} deg for {1000 * gaze.violation_s:g} ms (at least"
        f" {gaze.violation_samples} samples) {consequence}. Lost data up to"
        f" {1000 * gaze.blink_s:g} ms is a blink; longer, or silence of"
        f" {1000 * gaze.silence_s:g} ms, or more than {100 * gaze.loss_max_share:g} % lost in all,"
        " is data loss."
    )


def _analysis(protocol: StudyProtocol) -> Section:
    analysis = protocol.analysis
    primary, rules = analysis.primary, analysis.exclusions
    where = f"at size {primary.size}" if primary.size else "over all sizes"
    respected = {
        "participant-scene": "respecting variation of participants and of scenes",
        "participant": "respecting variation of participants",
        "pooled": "taking all trials as independent",
    }[analysis.test]
    slow = f" or slower than {rules.rt_max_s:g} s" if rules.rt_max_s else ""
    return Section(
        "Analysis",
        (
            [
                f"Primary comparison: {primary.method} against {primary.against}, {where}:"
                f" preference rate against one half, two-sided, alpha {analysis.alpha:g},"
                f" {respected}.",
                f"Other comparisons: correction {analysis.correction}.",
                "Smallest effect of interest: a preference rate"
                f" {analysis.smallest_effect_rate:g} from one half.",
            ],
            "Exclusions, fixed before the data:",
            [
                f"sessions with less than {100 * rules.completed_min_share:g} % of the decisions;",
                f"sessions with less than {100 * rules.catch_min_share:g} % of the catch trials"
                " right (where there are any);",
                *(
                    [
                        f"sessions with more than {100 * rules.same_side_max_share:g} % of the"
                        " answers on one side;"
                    ]
                    if rules.same_side_max_share < 1
                    else []
                ),
                f"answers faster than {rules.rt_min_s:g} s{slow}.",
            ],
        ),
    )
