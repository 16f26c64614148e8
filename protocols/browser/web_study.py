"""A study as a browser runs it: all of it in one file, beside pictures and packs of frames.

`study_app.web.export` fills a folder with it. The page reads this file first, checks every other
file against the hash that stands here, and needs nothing else. No secret of the study is in it.

The design is made of cells in place of tasks. The kernel in TypeScript
(`study_app/web/src/kernel/`) makes of it what `plan.py` and `study_app.session` make of a study. So
no task, recipe or rule is written twice, and a lab's own task runs in a browser, too.
"""

from __future__ import annotations

import json
import math
import string
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Annotated, Literal, TypeAlias

from pydantic import Field

from protocols.adaptive.section import AdaptiveLevels, QuestPlusLevels, UpDownLevels
from protocols.disk.hashing import Chance
from protocols.display import Display
from protocols.errors import StudyError
from protocols.feasibility import stated_times_s, timing_problems
from protocols.make_script import Scripts
from protocols.plan import rounds, scenes_at
from protocols.script import Fill, Frames, Grey, PixelSize, Place, ScriptQuestion, TrialScript
from protocols.study_file.schema import StudyProtocol
from protocols.study_file.session_schema import ClosingQuestion, KeyName, Keys
from protocols.tasks import base
from protocols.units import (
    Count,
    Few,
    Hertz,
    LanguageCode,
    Model,
    Name,
    Number,
    Positive,
    Sha256,
    Share,
    Text,
    WebSeed,
)


class WebArrangement(Model):
    """One way to show a condition."""

    stimuli: tuple[Text, ...]
    """Names among the study's stimuli, as the task counts them."""
    correct: Name | None
    """The right answer. Null where there is none, or the page can do without."""
    level: Number | None = None
    """Value in the column that an adaptive rule chooses. Null where there is none."""
    scene: str | None = None
    """Scene, where an adaptive rule chooses among several. Null elsewhere."""


class WebCell(Model):
    """One condition of the design. Its arrangements take turns over repeats and places."""

    scene: str
    parity: int
    """Index, modulo their number, of the arrangement that comes first at place 0."""
    arrangements: tuple[WebArrangement, ...]


class QuestPlusRule(Model):
    """The level whose answer is expected to tell most (QUEST+)."""

    kind: Literal["quest-plus"] = "quest-plus"
    levels: tuple[Number, ...]
    """Rising."""
    correct: tuple[tuple[Share, ...], ...]
    """Probability of a right answer: a row for each level, a column for each grid point."""
    log_prior: tuple[float | None, ...]
    """Logarithm of the prior of each grid point. Null where its prior is 0."""


class UpDownRule(Model):
    """An up-down track: the keys of the study's `[task.adaptive]`."""

    kind: Literal["up-down"] = "up-down"
    levels: tuple[Number, ...]
    """Rising."""
    start: Number
    harder: tuple[Number, ...]
    easier: tuple[Number, ...]
    in_a_row: Few
    one_at_first: bool
    falling: bool


AnyRule: TypeAlias = Annotated[QuestPlusRule | UpDownRule, Field(discriminator="kind")]


class WebTrack(Model):
    """Trials that are chosen from each other's answers."""

    name: Text
    options: tuple[WebArrangement, ...]
    """All that they may show."""


class WebAdaptive(Model):
    """Rule that chooses trials from answers."""

    trials: Positive
    """Per track."""
    tracks: tuple[WebTrack, ...]
    rule: AnyRule


class WebPractice(Model):
    """Practice trials."""

    trials: Positive
    """Trials of a round."""
    rounds: Positive
    criterion_share: Share | None
    """Share of right answers below which another round follows. Null: one round only."""
    cells: tuple[WebCell, ...]


class WebDesign(Model):
    """The design of a study, as a browser plans it."""

    answers: tuple[Name, ...]
    """Names from left to right, where keys are not swapped."""
    scenes: tuple[str, ...]
    """Scenes of the main trials, which are told apart and not named."""
    scenes_each: Positive
    """Number of scenes that one participant is shown."""
    repeats: Positive
    blocks: Few
    scene_order: Literal["random", "balanced"]
    side: Literal["by-participant", "by-trial", "fixed"]
    places: Literal["by-arrival", "drawn"]
    places_key: WebSeed | None
    """Key by which places are drawn, the same in all browsers. Null where they are not drawn."""
    rounds: tuple[Positive, Annotated[int, Field(ge=1, le=2**53)]]
    """After how many places arrangements and keys are balanced, and the scenes as well."""
    max_attempts: Few
    consent_required: bool
    questions: tuple[Name, ...]
    """The closing questions, which are the same in every language."""
    cells: tuple[WebCell, ...]
    """Cells of the main trials. Empty where a rule chooses."""
    catch_trials: Count
    catch_cells: tuple[WebCell, ...]
    practice: WebPractice | None
    adaptive: WebAdaptive | None


def web_design(study: StudyProtocol, names: Mapping[str, str] | None = None) -> WebDesign:
    """Return the design of a study as data, which tells participants no more than the page needs.

    Scenes and tracks are numbers.

    Parameters
    ----------
    study : StudyProtocol
        Checked. Its secret, which drawn places need, is no part of the result.
    names : mapping, optional
        Names of stimuli in the export, by those in the manifest. Left out: the latter.

    Raises
    ------
    StudyError
        If a rule chooses the trials that a browser cannot follow, naming it; or the study refuses
        codes that browsers draw; or places are drawn, and the secret is not here.
    """
    check_codes(study)
    study = study.at_home()
    design, task, pool = study.design, study.task, study.pool
    texts = study.text.languages[study.text.default_language]
    practice = design.practice
    scenes = dict.fromkeys((*pool.scenes, *(practice.scenes if practice else ())))
    named = _Names(names or {}, {scene: str(number) for number, scene in enumerate(scenes)})
    adaptive = _adaptive(study, named)
    column = adaptive_column(study)
    return WebDesign(
        answers=task.answers(),
        scenes=tuple(named.scenes[scene] for scene in pool.scenes),
        scenes_each=len(scenes_at(study, 0)),
        repeats=design.repeats,
        blocks=design.blocks,
        scene_order=design.scene_order,
        side=design.side,
        places=design.places,
        places_key=study.places_key,
        rounds=rounds(study),
        max_attempts=design.max_attempts,
        consent_required=study.privacy.consent_required,
        questions=tuple(question.name for question in texts.questions),
        cells=() if adaptive else named.cells(task.cells(pool)),
        catch_trials=task.catch_trials,
        catch_cells=named.cells(task.catch_cells(pool)) if task.catch_trials else (),
        practice=WebPractice(
            trials=practice.trials,
            rounds=practice.rounds,
            criterion_share=practice.criterion_share,
            cells=named.cells(study.practice_cells(), column, judged=practice.judged),
        )
        if practice
        else None,
        adaptive=adaptive,
    )


def check_codes(study: StudyProtocol) -> None:
    """Refuse a study whose pattern of participant codes refuses those that browsers draw.

    Raises
    ------
    StudyError
        With a pattern that takes both.
    """
    chance, marks = Chance("codes"), string.digits + string.ascii_lowercase
    drawn = ["w" + "".join(marks[chance.below(36)] for _ in range(14)) for _ in range(30)]
    wrong = [code for code in drawn if not study.privacy.accepts(code)]
    if wrong:
        pattern = study.privacy.code_pattern
        cure = json.dumps(f"{DRAWN_CODES}|{pattern}", ensure_ascii=False)
        raise StudyError(
            "privacy.code_pattern: must match the codes that browsers draw, w and 14 digits and"
            f" small letters (got {pattern!r}, which does not match {wrong[0]}); write"
            f" code_pattern = {cure}"
        )


def adaptive_column(study: StudyProtocol) -> str | None:
    """Return the column that an adaptive rule chooses; None where there is none."""
    rule = study.task.adaptation
    return rule.column if isinstance(rule, AdaptiveLevels) else None


def _adaptive(study: StudyProtocol, named: _Names) -> WebAdaptive | None:
    rule, task, pool = study.task.adaptation, study.task, study.pool
    if rule is None:
        return None
    if not isinstance(rule, QuestPlusLevels | UpDownLevels):
        raise StudyError(
            "task.adaptive.rule: must be 'quest-plus' or 'up-down' in a browser, which cannot"
            f" follow any other (got {rule.rule!r}); plan all trials, or run the study at the desk"
        )
    levels = rule.levels(task, pool)
    options: dict[str, list[WebArrangement]] = {}
    for cell in task.cells(pool):
        for arrangement in cell.arrangements:
            name = rule.track_of(arrangement.condition)
            option = named.arrangement(arrangement, rule.column, judged=True)
            scene = named.scenes[cell.scene]
            options.setdefault(name, []).append(option.model_copy(update={"scene": scene}))
    return WebAdaptive(
        trials=rule.trials,
        tracks=tuple(
            WebTrack(name=str(number), options=tuple(options[name]))
            for number, name in enumerate(rule.tracks(task, pool))
        ),
        rule=_quest_plus(rule, levels)
        if isinstance(rule, QuestPlusLevels)
        else UpDownRule(
            levels=levels,
            **rule.model_dump(
                include={"start", "harder", "easier", "in_a_row", "one_at_first", "falling"}
            ),
        ),
    )


def _quest_plus(rule: QuestPlusLevels, levels: tuple[float, ...]) -> QuestPlusRule:
    from protocols.adaptive.quest_plus import tables

    table = tables(rule.grid(levels))
    prior = (float(value) for value in table.log_prior)
    return QuestPlusRule(
        levels=levels,
        correct=tuple(map(tuple, table.correct.tolist())),
        log_prior=tuple(value if value > float("-inf") else None for value in prior),
    )


@dataclass(frozen=True)
class _Names:
    """Names of stimuli and scenes in a design for browsers, by those of the study."""

    stimuli: Mapping[str, str]
    scenes: Mapping[str, str]

    def cells(
        self, cells: Iterable[base.Cell], column: str | None = None, *, judged: bool = False
    ) -> tuple[WebCell, ...]:
        """Return conditions; with their right answers only where the page judges by them."""
        return tuple(
            WebCell(
                scene=self.scenes.get(cell.scene, ""),
                parity=cell.parity,
                arrangements=tuple(
                    self.arrangement(one, column, judged=judged) for one in cell.arrangements
                ),
            )
            for cell in cells
        )

    def arrangement(
        self, given: base.Arrangement, column: str | None, *, judged: bool
    ) -> WebArrangement:
        """Return one way to show a condition."""
        level = given.condition.get(column) if column else None
        return WebArrangement(
            stimuli=tuple(self.stimuli.get(name, name) for name in given.stimuli),
            correct=given.correct if judged else None,
            level=None if level is None else float(level),
        )


DRAWN_CODES = "w[0-9a-z]{14}"
"""Codes that browsers draw, as a regular expression."""
STUDY_FILE = "study.json"
MB = 1_000_000
BUDGET_MB = 300.0
"""Largest size of what one participant has to fetch, in MB, unless an option says more."""
DECODED_MB = 500.0
"""Largest size of the decoded stimuli of two trials, in MB, unless an option says more."""
RATES_HZ = (50.0, 60.0, 72.0, 75.0, 90.0, 100.0, 120.0, 144.0, 165.0, 240.0)
"""Refresh rates of participants' displays that a study is made ready for, where it can be."""


class PictureFile(Model):
    """A picture that Python made: a PNG file."""

    file: Text
    """Name in the folder `pictures`."""
    sha256: Sha256
    size_px: PixelSize


class ShownPicture(Model):
    """A picture at its place."""

    kind: Literal["picture"] = "picture"
    of: Sha256
    """Its name among the study's pictures."""
    at: Place


WebEntry: TypeAlias = Annotated[Frames | ShownPicture | Fill, Field(discriminator="kind")]


class WebPhase(Model):
    """A phase of a trial, as `ScriptPhase` has it, with pictures by name."""

    name: Name
    frames: Count | None
    show: tuple[WebEntry, ...]
    gate_frames: Count | None
    watched: bool
    question: ScriptQuestion | None
    timeout_frames: Count | None
    follows: dict[str, ShownPicture]


class WebScript(Model):
    """The script of all trials that have these answers in this order."""

    answers: tuple[Name, ...]
    practice: bool
    phases: tuple[WebPhase, ...]


class RefreshRate(Model):
    """A refresh rate at which the study runs."""

    refresh_hz: Hertz
    deviations_s: dict[str, Number]
    """Excess of each time over the study's, by its place in the study file. Times that are kept are
    left out."""
    scripts: dict[LanguageCode, tuple[WebScript, ...]]


PIECE_PX = 256
"""Edge of the pieces that frames are cut into."""


class Pack(Model):
    """Pictures one after the other in one file, each as PNG or lossless WebP: frames or pieces."""

    file: Text
    """Name in the folder `packs`."""
    bytes: Count
    sha256: tuple[Sha256, ...]
    """Hash of each picture's bytes in the file: of a frame's PNG file, as the manifest has it."""
    ends: tuple[Count, ...]
    """End of each picture in the file, in bytes from its beginning."""
    shared: tuple[Text, ...] = ()
    """Packs of pieces that other stimuli have, too, by their names."""
    frames: tuple[tuple[Count, ...], ...] = ()
    """Pieces of each frame, row by row, by their numbers: those of shared packs come first. Empty:
    each picture is a frame."""


class WebPages(Model):
    """Texts that a participant reads beside trials, placeholders of keys filled."""

    consent: Text
    instructions: tuple[Text, ...]
    practice: Text
    start: Text
    break_page: Text
    """`{done}` and `{total}` stand for numbers of blocks."""
    paused: Text
    preparing: Text
    quit_question: Text
    thanks: Text
    key_names: dict[KeyName, Text]
    """Names of the keys that are used, for the first page."""
    questions: tuple[ClosingQuestion, ...]


class WebHeadset(Model):
    """A study's show in a headset."""

    distance_px: Annotated[float, Field(gt=0)]
    """Distance of the flat screen from the eyes, in its pixels."""
    around: bool
    """Stimuli are panoramas, all around; all else is on the flat screen before them."""
    turn_deg: Annotated[float, Field(gt=0)] | None
    """Largest angle of the head from straight ahead in watched phases. Null: any."""
    rates: tuple[Hertz, ...]
    """Refresh rates of the study, the one wanted most first."""


class WebStudy(Model):
    """The file `study.json` of an exported folder."""

    format: Literal[1]
    """Version of the file format."""
    study: Name
    title: Text
    protocol_sha256: Sha256
    manifest_sha256: Sha256
    revision: Text
    """Version and git revision of metamerlab."""
    default_language: LanguageCode
    pages: dict[LanguageCode, WebPages]
    background: Grey
    window_px: PixelSize
    """Smallest part of the screen, about its middle, that shows all of a trial."""
    screen_px: PixelSize
    """Size of the screen that the study was made for: a click answers by its share of the width."""
    design: WebDesign
    break_s: Annotated[float, Field(ge=0)]
    """Shortest break between two blocks."""
    duration_s: Annotated[float, Field(ge=0)]
    """Length of a session, answers in 1.5 s: the first page says it."""
    rates: Annotated[tuple[RefreshRate, ...], Field(min_length=1)]
    dropped_max: Count
    """More missed refreshes than this make an attempt void."""
    continue_keys: Keys
    pause_keys: Keys
    quit_keys: Keys
    stimulus_px: PixelSize
    stimuli: dict[str, Pack]
    """Stimuli by names that tell nothing."""
    shared: dict[str, Pack]
    """Packs of pieces that several stimuli have, by names that tell nothing."""
    piece_px: Positive
    """Edge of the square pieces, of which those at the right and the bottom may be smaller."""
    pictures: dict[Sha256, PictureFile]
    """Pictures by the hash of what they show."""
    decoded_bytes: Count
    """Largest memory that a trial's stimuli and the next one's take."""
    identifier: str | None
    """Parameter of the link whose value is kept."""
    completion_url: str | None
    completion_code: str | None
    headset: WebHeadset | None = None
    """The study runs in a headset. Null: on a screen."""


def rates_of(study: StudyProtocol, display: Display) -> dict[float, list[str]]:
    """Return for each refresh rate why the study does not run at it; an empty list where it does.

    Parameters
    ----------
    study : StudyProtocol
        With a section `[web]`, whose tolerance counts.
    display : Display
        For which stimuli are built.

    Raises
    ------
    StudyError
        If the study is not meant for browsers.
    """
    study = study.in_a_browser()
    tolerance_s = study.web.tolerance_s if study.web else 0.0
    headset = study.web.headset if study.web else None
    wanted = headset.rates if headset else (*RATES_HZ, display.refresh_hz)

    def problems(rate: float) -> list[str]:
        found = [str(p) for p in timing_problems(study, display.at_rate(rate, tolerance_s))]
        wanted_s = tolerance_for_s(study, display, rate) if found else None
        if wanted_s is not None:
            found[0] += f"; or declare web.tolerance_s = {wanted_s:g}"
        return found

    return {rate: problems(rate) for rate in sorted({*wanted})}


def tolerance_for_s(study: StudyProtocol, display: Display, rate_hz: float) -> float | None:
    """Return the tolerance, in steps of 0.1 ms, that a refresh rate needs; None if none helps."""
    times = stated_times_s(study).values()
    wanted_s = max(abs(round(stated_s * rate_hz) / rate_hz - stated_s) for stated_s in times)
    wanted_s = math.ceil(1e4 * wanted_s) / 1e4
    return None if timing_problems(study, display.at_rate(rate_hz, wanted_s)) else wanted_s


def deviations_s(study: StudyProtocol, display: Display) -> dict[str, float]:
    """Return the surplus of each time on a display over the study's, where there is one."""
    found = {
        place: (display.frames(stated_s) or 0) / display.refresh_hz - stated_s
        for place, stated_s in stated_times_s(study).items()
    }
    return {place: round(off_s, 9) for place, off_s in found.items() if abs(off_s) > 1e-9}


def scripts_at(study: StudyProtocol, display: Display, language: str) -> dict[WebKind, TrialScript]:
    """Return the scripts of all kinds of trials: by the order of their answers, and practice."""
    made = Scripts(study.in_a_browser(), display, language)
    answers = study.task.answers()
    return {
        (order, practice): made.script(order, practice)
        for order in dict.fromkeys((answers, answers[::-1]))
        for practice in (False, True)
        if not practice or study.design.practice is not None
    }


WebKind: TypeAlias = tuple[tuple[str, ...], bool]
"""The order of the answers, and whether it is practice."""
