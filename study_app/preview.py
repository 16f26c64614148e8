"""A study as one page: a trial of each condition to play, and every page of text, in any browser.

Nothing is measured, and nobody takes part: what is drawn comes from the same phases, places, texts
and pictures as a session's, made small.
"""

from __future__ import annotations

import base64
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import cv2
import numpy as np
from jinja2 import Environment, PackageLoader, StrictUndefined
from numpy.typing import NDArray

from protocols.display import Display
from protocols.errors import StudyError
from protocols.feasibility import virtual_manifest
from protocols.manifest import Manifest
from protocols.phases import Bar, Clip, Image, Optotype, Phase, Text
from protocols.plan import PlannedTrial, make_plan
from protocols.recipes.base import SCENE
from protocols.schema import StudyProtocol
from protocols.session_schema import Texts
from protocols.viewing import Viewing
from study_app.clips import read_frame
from study_app.keys import key_label
from study_app.layout import Extras, Layout
from study_app.optotype import landolt_ring
from study_app.pages import Pages, answer_name, check_texts
from study_app.stage import Page
from study_app.target import target_image
from study_app.trial import Timeline
from study_app.wording import consent_text, fill

MARK: Final = '<meta name="generator" content="metamerlab protocol preview">'
"""Stands in every such page: what bears it may be written over."""
STAGE_PX: Final = 960
MOST_FRAMES: Final = 30
OPEN_MS: Final = 800
"""How wide a phase that an answer ends is drawn."""
ROLES: Final = {"main": "", "catch": "catch trial", "practice": "practice"}

Picture = NDArray[np.uint8]


@dataclass(frozen=True)
class Preview:
    """A page, and what it holds."""

    html: str
    shown: int
    conditions: int
    """Of the study, scenes aside: more than `shown` where they would not fit."""
    notes: tuple[str, ...]
    """Languages that no font of this machine writes."""


def preview_page(
    study: StudyProtocol,
    display: Display,
    *,
    stimuli: Path | None = None,
    manifest: Manifest | None = None,
    most: int = 24,
) -> Preview:
    """Return the page of a study.

    Parameters
    ----------
    study, display : StudyProtocol, Display
        Checked.
    stimuli : Path, optional
        Folder of built clips, with its `manifest`; left out: frames with the stimulus' name.
    most : int
        Conditions at most; each shows one scene.

    Raises
    ------
    StudyError
        If a clip is missing or changed, or a text cannot be written.
    """
    known = manifest or virtual_manifest(study, display)
    # The second slot's keys may be exchanged.
    plans = [make_plan(study.in_any_order(), known, f"P{slot}", slot) for slot in (0, 1)]
    orders = dict.fromkeys(trial.answers for plan in plans for trial in plan.trials)
    trials = _one_of_each(plans[0].trials)
    spread = np.linspace(0, len(trials) - 1, min(most, len(trials)))
    chosen = [trials[int(index)] for index in spread]
    maker = _Maker(study, display, known, stimuli, orders)
    played = [maker.trial(trial) for trial in chosen]
    environment = Environment(
        loader=PackageLoader("study_app", "."), autoescape=True, undefined=StrictUndefined
    )
    data = {
        "size": maker.stage,
        "grey": maker.grey,
        "hz": display.refresh_hz,
        "trials": played,
        "stimuli": maker.stimuli(),
        "images": maker.images,
        "dot": maker.dot(),
        "window": maker.window(),
        "language": study.text.default_language,
    }
    html = environment.get_template("preview.html").render(
        mark=MARK,
        title=study.study.title,
        study=study,
        display=display,
        data=data,
        trials=played,
        languages={
            language: [
                {"name": name, "says": says, "text": text, "image": image}
                for name, says, text, image in maker.pages(texts)
            ]
            for language, texts in study.text.languages.items()
        },
        left_out=len(trials) - len(chosen),
        built=stimuli is not None,
        open_ms=OPEN_MS,
        design=study.task.design_sentence(study.pool),
        describes=study.task.description(study.pool),
    )
    notes = [
        f"{language}: {why} (the page shows these texts in the browser's font)"
        for language, texts in study.text.languages.items()
        if (why := maker.unwritten(texts))
    ]
    return Preview(html, len(chosen), len(trials), tuple(notes))


def _one_of_each(trials: tuple[PlannedTrial, ...]) -> list[PlannedTrial]:
    """Return the first trial of each condition, scenes aside; decisions before all others."""
    found: dict[tuple[object, ...], PlannedTrial] = {}
    for trial in trials:
        rest = tuple(item for item in trial.condition.items() if item[0] != SCENE)
        found.setdefault((trial.role, *rest), trial)
    return sorted(found.values(), key=lambda trial: list(ROLES).index(trial.role))


class _Maker:
    """Makes what the page holds, at the stage's scale."""

    def __init__(
        self,
        study: StudyProtocol,
        display: Display,
        manifest: Manifest,
        folder: Path | None,
        orders: Iterable[tuple[str, ...]],
    ) -> None:
        self._orders = tuple(orders)
        self._study, self._display, self._folder = study, display, folder
        self._clips = {clip.name: clip for clip in manifest.clips}
        self._layout = Layout.of(display, study, manifest, Extras())
        self._scale = min(1.0, STAGE_PX / display.width_px)
        self._labels = study.stimuli.labels()
        self._used: dict[str, None] = {}
        self._target = target_image(
            self._layout.dot_diameter_px, round(255 * study.display.background)
        )
        self.images: list[str] = []
        self.grey = round(255 * study.display.background)
        self.stage = (
            round(display.width_px * self._scale),
            round(display.height_px * self._scale),
        )

    def trial(self, trial: PlannedTrial) -> dict[str, Any]:
        """Return a trial as the page plays it."""
        timeline = Timeline.of(self._study, self._display, trial)
        self._used |= dict.fromkeys(trial.stimuli)
        phases = [self._phase(phase, trial) for phase in timeline.phases]
        said = [
            f"{column.replace('_', ' ')} {self._labels.get(str(value), value)}"
            for column, value in trial.condition.items()
        ]
        if not trial.stimuli:
            said.append("level chosen from the answers")
        role = ROLES[trial.role]
        return {
            "title": ", ".join([*([role] if role else []), *said]) or trial.id,
            "phases": phases,
            "answers": [
                {"key": key_label(keys[0]), "answer": answer}
                for keys, answer in zip(self._study.response.keys, trial.answers, strict=True)
            ],
            "stimuli": list(trial.stimuli),
            "correct": trial.correct,
        }

    def stimuli(self) -> dict[str, dict[str, Any]]:
        """Return the pictures of everything that the trials show, by name."""
        return {name: self._stimulus(name) for name in self._used}

    def dot(self) -> dict[str, Any]:
        """Return the fixation target and its place."""
        x_px, y_px = self._layout.dot_px
        edge = len(self._target)
        place = round(x_px) - edge // 2, round(y_px) - edge // 2
        return {"src": _png(self._target), **self._box(place, (edge, edge))}

    def window(self) -> dict[str, float] | None:
        """Return the ellipse within which gaze counts as held, in pixels of the stage."""
        gaze, timing = self._study.gaze, self._study.trial
        if gaze.mode == "none":
            return None
        viewing = Viewing.of(self._display)
        x_deg, y_deg = timing.fixation_x_deg, timing.fixation_y_deg
        left, _ = viewing.to_px(x_deg - gaze.window_deg, y_deg)
        right, _ = viewing.to_px(x_deg + gaze.window_deg, y_deg)
        _, top = viewing.to_px(x_deg, y_deg - gaze.window_deg)
        _, bottom = viewing.to_px(x_deg, y_deg + gaze.window_deg)
        return {
            "x": (left + right) / 2 * self._scale,
            "y": (top + bottom) / 2 * self._scale,
            "rx": (right - left) / 2 * self._scale,
            "ry": (bottom - top) / 2 * self._scale,
        }

    def pages(self, texts: Texts) -> Iterator[tuple[str, str, str, str]]:
        """Yield (name, when it is shown, text, image) of every page in one language.

        The image is empty where no font of this machine writes the texts.
        """
        draws = not self.unwritten(texts)
        study, response = self._study, self._study.response
        size = self._display.width_px, self._display.height_px
        maker = Pages(size, texts, self.grey)
        key = response.continue_keys[0]
        blocks, practice = study.design.blocks, study.design.practice
        turned = [
            ("consent", "First", consent_text(texts, study.privacy.contact)),
            *(
                (f"instructions-{number}", "Instructions", text)
                for number, text in enumerate(texts.instructions, 1)
            ),
            *([("practice", "Before practice", texts.practice)] if practice else []),
            ("start", "Before the first block", texts.start),
            *([("break", "Between two blocks", texts.break_page)] if blocks > 1 else []),
            ("paused", "After the pause key", texts.paused),
            ("quit", "After the quit key", texts.quit_question),
        ]
        for name, says, text in turned:
            full = fill(text, response, done=1, total=blocks)
            yield name, says, full, self._page(maker.page(full, key)) if draws else ""
        for number, question in enumerate(texts.questions, 1):
            text = fill(question.text, response)
            page = Page("question", text, (), choices=question.choices)
            full = "\n".join((text, *question.choices))
            image = self._page(maker.question(page, "", 0)) if draws else ""
            yield f"question-{number}", "At the end", full, image
        thanks = fill(texts.thanks, response)
        yield "thanks", "Last", thanks, self._page(maker.page(thanks)) if draws else ""
        fixed = maker.fixed(response, study.task.answers()) if draws else {}
        for order in self._orders:
            name = answer_name(order)
            labels = [
                f"{texts.answers[answer]} [{key_label(keys[0], texts.key_names)}]"
                for answer, keys in zip(order, response.keys, strict=True)
            ]
            text = "\n".join((fill(texts.question, response), *labels))
            image = self._page(fixed[name]) if draws else ""
            yield name, "While the answer is awaited", text, image
        for name, says, notice in (
            ("preparing", "While stimuli are loaded", texts.preparing),
            ("gaze-lost", "After gaze left the dot", texts.gaze_lost),
            ("too-late", "After an answer that came too late", texts.too_late),
            ("right", "After a right answer in practice", texts.right),
            ("wrong", "After a wrong answer in practice", texts.wrong),
        ):
            if notice:
                image = self._page(fixed[name]) if draws else ""
                yield name, says, fill(notice, response), image

    def unwritten(self, texts: Texts) -> str:
        """Return why no font of this machine writes the texts; empty: one does."""
        try:
            check_texts(self._study, texts)
        except StudyError as error:
            return str(error)
        return ""

    def _phase(self, phase: Phase, trial: PlannedTrial) -> dict[str, Any]:
        frames = phase.frames
        shown = list(self._shown(phase, trial))
        return {
            "name": phase.name,
            "ms": None if frames is None else 1000 * frames / self._display.refresh_hz,
            "refreshes": frames,
            "waits_ms": None
            if phase.gate_frames is None
            else 1000 * phase.gate_frames / self._display.refresh_hz,
            "late_ms": None
            if phase.timeout_frames is None
            else 1000 * phase.timeout_frames / self._display.refresh_hz,
            "watched": phase.watched,
            "answered": bool(phase.ends_on),
            "show": shown,
            "says": ", ".join(map(_says, shown)) or "blank",
        }

    def _shown(self, phase: Phase, trial: PlannedTrial) -> Iterator[dict[str, Any]]:
        places = []
        for entry in phase.show:
            if isinstance(entry, Clip | Image):
                place = self._layout.places[entry.x_deg, entry.y_deg]
                places.append(place)
                named = trial.stimuli[entry.stimulus] if trial.stimuli else ""
                yield {
                    "kind": "stimulus",
                    "name": named,
                    "each": entry.refreshes_per_frame if isinstance(entry, Clip) else 0,
                    "half": entry.half if isinstance(entry, Image) else None,
                    **self._box(place, self._layout.stimulus_px),
                }
            elif isinstance(entry, Text):
                name = answer_name(trial.answers) if entry.name == "answer" else "right"
                yield {"kind": "page", "name": name}
            elif isinstance(entry, Bar):
                left, width = self._layout.bars[entry.width_deg]
                box = self._box((left, 0), (width, self._display.height_px))
                yield {"kind": "bar", **box}
            elif isinstance(entry, Optotype):
                image, place = landolt_ring(entry, self._display)
                self.images.append(_png(image))
                box = self._box(place, (image.shape[1], image.shape[0]))
                yield {"kind": "image", "image": len(self.images) - 1, **box}
            elif self._dot_shows(places):
                yield {"kind": "dot"}

    def _dot_shows(self, places: list[tuple[int, int]]) -> bool:
        """As the presenter has it: beside stimuli, or over them where the study says so."""
        over = self._study.trial.dot_over_clips
        return not places or over or self._layout.beside(places, len(self._target) // 2)

    def _stimulus(self, name: str) -> dict[str, Any]:
        clip = self._clips[name]
        if self._folder is None:
            return {"strip": None, "frames": [0]}
        count = len(clip.frames_sha256)
        frames = sorted({int(k) for k in np.linspace(0, count - 1, min(MOST_FRAMES, count))})
        width, height = (max(1, round(self._scale * n)) for n in self._layout.stimulus_px)
        tiles = []
        for index in frames:
            frame = read_frame(self._folder, clip, index)
            frame = np.ascontiguousarray(frame[..., :3])
            tiles.append(cv2.resize(frame, (width, height), interpolation=cv2.INTER_AREA))
        strip = np.ascontiguousarray(np.concatenate(tiles)[..., ::-1])
        _, data = cv2.imencode(".webp", strip, [cv2.IMWRITE_WEBP_QUALITY, 80])
        return {"strip": _address("image/webp", bytes(data)), "frames": frames}

    def _page(self, image: Picture) -> str:
        """Return a page's address: letters on the screen's grey, at the stage's size."""
        alpha = image[..., 3:].astype(np.float32) / 255
        grey = (image[..., :1] * alpha + self.grey * (1 - alpha)).astype(np.uint8)
        small = cv2.resize(grey[..., 0], self.stage, interpolation=cv2.INTER_AREA)
        return _png(small.astype(np.uint8))

    def _box(self, place: tuple[int, int], size: tuple[int, int]) -> Mapping[str, float]:
        named = zip("xywh", (*place, *size), strict=True)
        return {name: round(value * self._scale, 2) for name, value in named}


def _says(shown: Mapping[str, Any]) -> str:
    match shown["kind"]:
        case "stimulus":
            name = str(shown["name"] or "a stimulus")
            return f"{name}, its {shown['half']} half" if shown["half"] else name
        case "page":
            return "feedback" if shown["name"] == "right" else "the question and its answers"
        case "image":
            return "a Landolt ring"
        case "bar":
            return "a grey bar"
    return "the dot"


def _png(image: Picture) -> str:
    """Return grey, or straight RGBA, as an address."""
    stored = cv2.cvtColor(image, cv2.COLOR_RGBA2BGRA) if image.ndim == 3 else image
    _, data = cv2.imencode(".png", stored, [cv2.IMWRITE_PNG_COMPRESSION, 9])
    return _address("image/png", bytes(data))


def _address(kind: str, data: bytes) -> str:
    return f"data:{kind};base64,{base64.b64encode(data).decode()}"
