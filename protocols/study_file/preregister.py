"""The preregistration of a study: what will be done and tested, with the hashes that prove it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from protocols.blocks import Block, Section, TableBlock
from protocols.browser.web_study import rates_of
from protocols.disk.hashing import sha256_json
from protocols.display import Display
from protocols.errors import StudyError
from protocols.feasibility import session_duration_s, virtual_manifest
from protocols.manifest import Manifest
from protocols.outside import markdown
from protocols.plan import make_plan
from protocols.study_file.schema import StudyProtocol
from protocols.study_file.session_schema import Gaze


def preregistration(
    study: StudyProtocol,
    display: Display,
    revision: str,
    manifest: Manifest | None = None,
    *,
    why: str | None = None,
    power: Mapping[str, Any] | None = None,
    limits: Sequence[str] = (),
) -> list[Section]:
    """Return the text of a preregistration.

    Parameters
    ----------
    study : StudyProtocol
        The study; everything said here is read from it.
    display : Display
        The display it runs on.
    revision : str
        Version and git revision of the program that will run it.
    manifest : Manifest, optional
        The clips, where they are built already: their hash is then part of the text.
    why : str, optional
        Why so many participants, in the author's words.
    power : mapping, optional
        What `metamerlab analysis power --out` wrote as ``power.json``.
    limits : sequence of str
        What so few participants or scenes cannot show.

    Raises
    ------
    StudyError
        If `power` is not what that command writes.
    """
    return [
        _overview(study),
        _sample(study, why, power),
        _hashes(study, display, revision, manifest),
        Section.of("Stimuli", *study.stimuli.described(display, study.main_scenes())),
        _procedure(study, display),
        _texts(study),
        _analysis(study, limits),
        Section.of(
            "Data",
            [
                "Participants are known by pseudonymous codes only.",
                (
                    "Consent is asked and recorded."
                    if study.privacy.consent_required
                    else "Consent is not asked by the program."
                ),
                _stored_gaze(study),
                (
                    f"Data is deleted after {study.privacy.retention_months} months."
                    if study.privacy.retention_months
                    else "How long data is kept is not stated."
                ),
            ],
        ),
    ]


def to_markdown(title: str, sections: list[Section]) -> str:
    """Return sections of paragraphs, lists and tables as Markdown."""
    lines = [f"# {markdown(title)}", ""]
    for section in sections:
        lines += [f"## {section.title}", ""]
        for block in section.blocks:
            if isinstance(block, TableBlock):
                heads = [column.title for column in block.columns]
                rows = [heads, ["---" for _ in heads], *block.rows]
                lines += ["| " + " | ".join(map(markdown, row)) + " |" for row in rows]
            elif isinstance(block, list):
                lines += [f"- {markdown(entry)}" for entry in block]
            elif isinstance(block, str):
                lines.append(markdown(block))
            lines.append("")
    return "\n".join(lines)


def _overview(study: StudyProtocol) -> Section:
    info = study.study
    blocks: list[Block] = [info.description] if info.description else []
    if info.source:
        blocks.append(f"Follows: {info.source}.")
    blocks.append(f"Study version {info.version}.")
    return Section.of("Study", *blocks)


def _sample(study: StudyProtocol, why: str | None, power: Mapping[str, Any] | None) -> Section:
    """Section on participants: how many, why so many, and when collection ends."""
    return Section.of(
        "Participants",
        [
            f"Planned participants: {study.study.participants}. Collection ends when this"
            " many have completed their session.",
            "The planned test is run once, after the last participant; no earlier looks are"
            " planned.",
            f"Reason for this number: {why}"
            if why
            else "The reason for this number is not stated.",
            "Power is not stated." if power is None else _power(power),
        ],
    )


def _power(found: Mapping[str, Any]) -> str:
    """Return the power that a simulation found for the planned participants."""
    try:
        people = [int(number) for number in found["participants"]]
        at = people.index(found["planned"])
        chances = [
            f"{float(found[name][at]):.2f} {said}"
            for name, said in (
                ("primary", "that the primary comparison is significant"),
                ("each", "for a comparison of the family, after correction"),
                ("every", "for all of them"),
            )
            if name in found
        ]
        chances += [
            f"{float(values[at]):.2f} for reaction {name}"
            for name, values in dict(found.get("also", {})).items()
            if name.startswith("times") and "false" not in name
        ]
        assumed = ", ".join(
            f"{name.replace('_', ' ')} {value:g}" for name, value in found["assumptions"].items()
        )
        studies = int(found["studies"])
    except (KeyError, TypeError, ValueError, IndexError, AttributeError):
        raise StudyError(
            "--power: must be the power.json of 'metamerlab analysis power --out', with the planned"
            " participants among those simulated"
        ) from None
    return (
        f"Power, by {studies} simulated studies of this design with {people[at]} participants:"
        f" {'; '.join(chances)}. Taken for true: {assumed}."
    )


def _texts(study: StudyProtocol) -> Section:
    """Section on what participants read, in the language of a session that names none."""
    language = study.text.default_language
    texts = study.text.languages[language]
    others = [name for name in study.text.languages if name != language]
    said = f"Language: {language}" + (f"; also in {', '.join(others)}." if others else ".")
    pages = [("consent", texts.consent)] if study.privacy.consent_required else []
    pages += [(f"instructions, page {n}", text) for n, text in enumerate(texts.instructions, 1)]
    pages.append(("question", texts.question))
    pages += [(f"answer {name}", texts.answers[name]) for name in study.task.answers()]
    pages += [(f"at the end: {entry.name}", entry.text) for entry in texts.questions]
    rows = tuple((name, " ".join(text.split())) for name, text in pages)
    return Section.of(
        "What participants read", said, TableBlock.of("", [("page", "l"), ("text", "l")], rows)
    )


def _hashes(
    study: StudyProtocol, display: Display, revision: str, manifest: Manifest | None
) -> Section:
    rows = [
        ("protocol", study.sha256),
        ("what decides the stimuli", study.stimuli_sha256),
        ("display", sha256_json(display)),
        ("clips (manifest)", manifest.sha256 if manifest else "not built yet"),
        ("metamerlab", revision),
    ]
    return Section.of(
        "Hashes",
        "SHA-256 of the canonical JSON of each part. Every session's journal repeats them, so"
        " that data can be traced to this text.",
        TableBlock.of("", [("part", "l"), ("SHA-256 or revision", "l hash")], rows),
    )


def _question(study: StudyProtocol) -> str:
    texts = study.text.languages[study.text.default_language]
    answers = " / ".join(texts.answers[name] for name in study.task.answers())
    said = f'The question: "{texts.question}" Answers: {answers}.'
    right = study.task.right_answer()
    said = f"{said} {right}" if right else said
    sure = study.task.confidence
    if sure is None:
        return said
    language = study.text.default_language
    steps = " / ".join(sure.labelled(language))
    return f'{said} Then, without time limit: "{sure.question[language]}" Answers: {steps}.'


def _procedure(study: StudyProtocol, display: Display) -> Section:
    design, timing = study.design, study.trial
    task, pool = study.task, study.pool
    secret = study.privacy.secret_sha256
    plan = make_plan(study.in_any_order(), virtual_manifest(study, display), "P000", 0)
    minutes = session_duration_s(study, len(plan.trials)) / 60
    feedback = design.practice is not None and design.practice.feedback
    entries = [
        f"{plan.main_trials} decisions per participant: {task.design_sentence(pool)}.",
        f"A trial: fixation {timing.fixation_s:g} s, {task.description(pool)}"
        + (
            f" within {study.response.timeout_s:g} s"
            if study.response.timeout_s
            else " without time limit"
        )
        + f", blank {timing.iti_s:g} s."
        + (" Feedback in practice alone." if feedback else " No feedback."),
        _question(study),
        f"Scene order: {design.scene_order}. Sides: {design.side}. Places in the counterbalancing:"
        f" {design.places}. {design.blocks}"
        f" block{'s' * (design.blocks != 1)}, breaks"
        f" of at least {design.break_s:g} s. Seed {design.seed}"
        + (f", and a secret with SHA-256 {secret}." if secret else "."),
        f"A void attempt is repeated later in its block, up to {design.max_attempts} attempts;"
        " attempts that a pause, the quit key or another window cut short do not count.",
        f"More than {timing.dropped_frames_max} missed refreshes make an attempt void.",
        _gaze(study.gaze),
        *_browser(study, display),
        f"Estimated length without instructions: {minutes:.0f} min.",
    ]
    practice = design.practice
    if practice:
        rounds = ""
        if practice.criterion_share is not None:
            rounds = (
                f" a round, up to {practice.rounds_max} rounds, until"
                f" {100 * practice.criterion_share:g} % of a round are right"
            )
        entries.append(f"{practice.trials} practice trials{rounds}, never analysed.")
    if task.catch_trials:
        entries.append(f"{task.catch_trials} catch trials ({task.catch_sentence()}).")
    return Section.of("Procedure", entries)


def _stored_gaze(study: StudyProtocol) -> str:
    if study.gaze.mode == "none":
        return "No gaze is recorded."
    return f"Gaze samples are {'' if study.privacy.store_gaze else 'not '}stored."


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


def _browser(study: StudyProtocol, display: Display) -> list[str]:
    """Return the guarantees that browsers do not give; nothing where none is meant."""
    web = study.web
    if web is None:
        return []
    rates = [f"{rate:g}" for rate, problems in rates_of(study, display).items() if not problems]
    share = f" Each is shown a share of {web.share:g} of the scenes there." * (web.share < 1)
    kept = f" The link's parameter {web.identifier} is kept." if web.identifier else ""
    return [
        "It may run in participants' own browsers, where gaze is not tracked, and neither luminance"
        " nor distance is known. Times may be off by at most"
        f" {1000 * web.tolerance_s:g} ms there, to be whole refreshes. Screens that need more are"
        f" refused: it runs at {', '.join(rates) or 'no rate'} Hz.{share}{kept}"
    ]


def _analysis(study: StudyProtocol, limits: Sequence[str] = ()) -> Section:
    analysis = study.analysis
    rules = analysis.exclusions
    slow = f" or slower than {rules.rt_max_s:g} s" if rules.rt_max_s else ""
    never: list[Block] = [
        "What this design can hardly or never show:",
        [f"{one}." for one in limits],
    ]
    return Section.of(
        "Analysis",
        [
            *analysis.plain_sentences(study.task, study.pool),
            *[
                "Reaction times are a question of their own: a log-normal mixed model compares"
                f" conditions (likelihood ratio, two-sided, alpha = {analysis.alpha:g},"
                " Holm-adjusted over its comparisons). Times decide nothing about the tests above."
            ]
            * (analysis.reaction != "summary"),
        ],
        *never * bool(limits),
        "Exclusions, fixed before the data:",
        [
            f"sessions with less than {100 * rules.completed_min_share:g} % of the decisions;",
            f"sessions with less than {100 * rules.catch_min_share:g} % of the catch trials"
            " right (where there are any);",
            *[
                f"sessions with more than {100 * rules.same_side_max_share:g} % of the answers with"
                " one key;"
            ]
            * (rules.same_side_max_share < 1),
            f"answers faster than {rules.rt_min_s:g} s{slow}.",
        ],
    )
