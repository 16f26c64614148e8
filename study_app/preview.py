"""A study as one page: a trial of each condition to play, and every page of text, in any browser.

Nothing is measured, and nobody takes part: what is drawn comes from the same phases, places, texts
and pictures as a session's, made small.
"""

from __future__ import annotations

import base64
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, assert_never

import cv2
import numpy as np

from protocols.blocks import TableBlock, html_page
from protocols.display import Display, Viewing
from protocols.feasibility import virtual_manifest
from protocols.make_script import Scripts
from protocols.manifest import Manifest
from protocols.plan import PlannedTrial, make_plan
from protocols.recipes.base import SCENE
from protocols.script import (
    Drawn,
    Entry,
    Fill,
    Frames,
    Live,
    Picture,
    Place,
    ScriptPhase,
    TrialScript,
    Words,
)
from protocols.study_file.schema import StudyProtocol
from protocols.study_file.session_schema import key_label
from study_app.clips import read_frame
from study_app.paint import PixelBytes, bitmaps_of, drawn
from study_app.shown_texts import require_showable, shown_texts

MARK: Final = '<meta name="generator" content="metamerlab protocol preview">'
"""Stands in every such page: what bears it may be written over."""
STAGE_PX: Final = 960
MOST_FRAMES: Final = 30
OPEN_MS: Final = 800
"""Width, in ms of the timeline, of a phase that an answer ends."""
_KINDS: Final = {
    "dot": ("dot", "the dot"),
    "ring": ("image", "a Landolt ring"),
    "stored": ("image", "a picture"),
    "words": ("page", "the question and its answers"),
}
"""Colour of a picture in the timeline, and its name, by kind."""
ROLES: Final = {"main": "", "catch": "catch trial", "practice": "practice"}


@dataclass(frozen=True)
class Preview:
    """A page, and what it holds."""

    html: str
    shown: int
    conditions: int
    """Number in the study, scenes aside: more than `shown` where they would not fit."""
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
        What is shown, and where.
    stimuli : Path, optional
        Folder of built clips, with its `manifest`; left out: frames with the stimulus' name.
    most : int
        Conditions at most; each shows one scene.

    Raises
    ------
    StudyError
        If the display cannot show the study, or a clip is missing or changed.
    """
    unwritten = require_showable(study, display, manifest)
    known = manifest or virtual_manifest(study, display)
    trials = _one_of_each(make_plan(study.in_any_order(), known, "P0", 0).trials)
    spread = np.linspace(0, len(trials) - 1, min(most, len(trials)))
    chosen = [trials[int(index)] for index in spread]
    maker = _Maker(study, display, known, stimuli)
    played = [maker.trial(trial) for trial in chosen]
    html = html_page(
        f"{study.study.title}: preview",
        "study_app/preview.html",
        heading=study.study.title,
        mark=MARK,
        study=study,
        display=display,
        data=maker.data(played),
        trials=[{**one, "table": maker.phase_table(one["phases"])} for one in played],
        languages={
            language: [
                {"name": name, "says": says, "text": text, "image": image}
                for name, says, text, image in maker.pages(language, unwritten)
            ]
            for language in study.text.languages
        },
        left_out=len(trials) - len(chosen),
        built=stimuli is not None,
        open_ms=OPEN_MS,
        design=study.task.design_sentence(study.pool),
        describes=study.task.description(study.pool),
    )
    notes = [
        f"{language}: {why} (the page shows these texts in the browser's font)"
        for language, why in unwritten.items()
    ]
    return Preview(html, len(chosen), len(trials), tuple(notes))


def _one_of_each(trials: tuple[PlannedTrial, ...]) -> list[PlannedTrial]:
    """Return the first trial of each condition, scenes aside; decisions before all others."""
    found: dict[tuple[object, ...], PlannedTrial] = {}
    for trial in trials:
        rest = tuple(item for item in trial.condition.items() if item[0] != SCENE)
        found.setdefault((trial.role, *rest), trial)
    return sorted(found.values(), key=lambda trial: list(ROLES).index(trial.role))


def _digits(ms: float) -> str:
    return f"{ms:.4g}" if ms < 1000 else f"{ms:.0f}"


class _Maker:
    """Makes what the page holds, at the stage's scale."""

    def __init__(
        self,
        study: StudyProtocol,
        display: Display,
        manifest: Manifest,
        folder: Path | None,
    ) -> None:
        self._study, self._display, self._folder = study, display, folder
        self._clips = {clip.name: clip for clip in manifest.clips}
        self._scripts = Scripts(study, display, study.text.default_language, manifest)
        self._bitmaps = bitmaps_of(study, display)
        self._scale = min(1.0, STAGE_PX / display.width_px)
        self._labels = study.stimuli.labels()
        self._used: dict[str, None] = {}
        self._indices: dict[Drawn, int] = {}
        self.images: list[str] = []
        self.grey = round(255 * study.display.background)
        self.stage = (
            round(display.width_px * self._scale),
            round(display.height_px * self._scale),
        )

    def trial(self, trial: PlannedTrial) -> dict[str, Any]:
        """Return a trial as the page plays it."""
        script = self._scripts.of(trial)
        self._used |= dict.fromkeys(trial.stimuli)
        phases = [self._phase(phase, script) for phase in script.phases]
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
            "stimuli": list(trial.stimuli),
            "correct": trial.correct,
        }

    def phase_table(self, phases: list[dict[str, Any]]) -> TableBlock:
        """Return the phases of a trial as a table."""
        return TableBlock.each(
            "",
            list(enumerate(phases, 1)),
            ("#", "l", lambda one: str(one[0])),
            ("phase", "l", lambda one: one[1]["name"]),
            ("ms", "n", lambda one: "open" if one[1]["ms"] is None else _digits(one[1]["ms"])),
            ("refreshes", "n", lambda one: str(one[1]["refreshes"] or "")),
            ("shows", "l c", lambda one: one[1]["says"]),
            ("ends, gaze", "l c", lambda one: self._ends(one[1])),
        )

    def _ends(self, phase: dict[str, Any]) -> str:
        """Return the end of a phase, and whether gaze is watched in it."""
        gaze, late_ms, waits_ms = self._study.gaze, phase["late_ms"], phase["waits_ms"]
        ends = ""
        if phase["answers"]:
            late = "" if late_ms is None else f", or void after {late_ms / 1000:g} s"
            ends = f"with an answer{late}"
        elif waits_ms is not None and gaze.mode == "enforce":
            ends = f"when gaze was held so long; waits up to {waits_ms / 1000:g} s"
        watched = "gaze watched" if phase["watched"] and gaze.mode != "none" else ""
        return "; ".join(filter(None, (ends, watched)))

    def data(self, played: Sequence[Mapping[str, object]]) -> dict[str, object]:
        """Return the trials that the page plays, and pictures of everything that they show."""
        return {
            "size": self.stage,
            "grey": self.grey,
            "hz": self._display.refresh_hz,
            "trials": played,
            "stimuli": {name: self._stimulus(name) for name in self._used},
            "images": self.images,
            "window": self.window(),
        }

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

    def pages(
        self, language: str, unwritten: Collection[str]
    ) -> Iterator[tuple[str, str, str, str]]:
        """Yield (name, when it is shown, text, image) of every page in one language.

        The image is empty in `unwritten` languages.
        """
        for shown in shown_texts(self._study, self._display, language):
            image = "" if language in unwritten else self._page(shown.lay().image())
            yield shown.name, shown.says, shown.text, image

    def _phase(self, phase: ScriptPhase, script: TrialScript) -> dict[str, Any]:
        told = phase.follows.get("right")  # feedback: as after a right answer
        shown = [self._shown(entry, script) for entry in ([told] if told else [*phase.show])]
        asked = phase.question
        return {
            "name": phase.name,
            "ms": self._ms(phase.frames),
            "refreshes": phase.frames,
            "waits_ms": self._ms(phase.gate_frames),
            "late_ms": self._ms(phase.timeout_frames),
            "watched": phase.watched,
            "answers": [
                {"key": key_label(keys[0]), "answer": answer}
                for keys, answer in (zip(asked.keys, asked.answers, strict=True) if asked else ())
            ],
            "show": shown,
            "says": ", ".join("feedback" if told else str(one["says"]) for one in shown) or "blank",
        }

    def _ms(self, refreshes: int | None) -> float | None:
        return None if refreshes is None else 1000 * refreshes / self._display.refresh_hz

    def _shown(self, entry: Entry, script: TrialScript) -> dict[str, Any]:
        """Return the kind, the text and the area of one entry of a phase."""
        match entry:
            case Frames(stimulus=stimulus, every=every, at=at, crop=crop):
                name = script.stimuli[stimulus].name if script.stimuli else ""
                whole = (0, 0, *script.stimulus_px)
                half = f", its {'right' if crop[0] else 'left'} half" if crop else ""
                left, top, *size = crop or whole
                return {
                    "kind": "stimulus",
                    "says": (name or "a stimulus") + (half if name else ""),
                    "name": name,
                    "each": every,
                    "whole": self._box((at[0] - left, at[1] - top), script.stimulus_px),
                    **self._box(at, (size[0], size[1])),
                }
            case Live(stimulus=stimulus, at=at):
                name = script.stimuli[stimulus].name if script.stimuli else ""
                box = self._box(at, script.stimulus_px)
                return {
                    "kind": "stimulus",
                    "says": f"{name or 'a stimulus'}, which follows the gaze (here undrawn)",
                    "name": name,
                    "each": 0,
                    "whole": box,
                    **box,
                }
            case Picture(of=of, at=at, size_px=size_px):
                kind, says = _KINDS[of.kind]
                box = self._box(at, size_px)
                return {"kind": kind, "says": says, "image": self._image(of), **box}
            case Fill(rect=(x, y, width, height), grey=grey):
                box = self._box((x, y), (width, height))
                return {"kind": "fill", "says": "a grey bar", "grey": grey, **box}
            case _:
                assert_never(entry)

    def _image(self, of: Drawn) -> int:
        """Return the number of a picture among the images; words are made as small as the stage."""
        if of not in self._indices:
            image = drawn(of, self._bitmaps)
            if isinstance(of, Words):
                alpha = cv2.resize(image[..., 3], self.stage, interpolation=cv2.INTER_AREA)
                image = np.dstack([np.full_like(alpha, image[..., 0].max())] * 3 + [alpha])
            self._indices[of] = len(self.images)
            self.images.append(_png(image))
        return self._indices[of]

    def _stimulus(self, name: str) -> dict[str, Any]:
        clip = self._clips[name]
        if self._folder is None:
            return {"strip": None, "frames": [0]}
        count = len(clip.frames_sha256)
        frames = sorted({int(k) for k in np.linspace(0, count - 1, min(MOST_FRAMES, count))})
        width, height = (max(1, round(self._scale * n)) for n in (clip.width_px, clip.height_px))
        tiles = []
        for index in frames:
            frame = read_frame(self._folder, clip, index)
            frame = np.ascontiguousarray(frame[..., :3])
            tiles.append(cv2.resize(frame, (width, height), interpolation=cv2.INTER_AREA))
        strip = np.ascontiguousarray(np.concatenate(tiles)[..., ::-1])
        _, data = cv2.imencode(".webp", strip, [cv2.IMWRITE_WEBP_QUALITY, 80])
        return {"strip": _address("image/webp", bytes(data)), "frames": frames}

    def _page(self, image: PixelBytes) -> str:
        """Return a page's address: letters on the screen's grey, at the stage's size."""
        alpha = image[..., 3:].astype(np.float32) / 255
        grey = (image[..., :1] * alpha + self.grey * (1 - alpha)).astype(np.uint8)
        small = cv2.resize(grey[..., 0], self.stage, interpolation=cv2.INTER_AREA)
        return _png(small.astype(np.uint8))

    def _box(self, place: Place, size: tuple[int, int]) -> dict[str, float]:
        """Return a rectangle of the stage, by a script's place."""
        corner = place[0] + self._display.width_px // 2, place[1] + self._display.height_px // 2
        named = zip("xywh", (*corner, *size), strict=True)
        return {name: round(value * self._scale, 2) for name, value in named}


def _png(image: PixelBytes) -> str:
    """Return grey, or straight RGBA, as an address."""
    stored = cv2.cvtColor(image, cv2.COLOR_RGBA2BGRA) if image.ndim == 3 else image
    _, data = cv2.imencode(".png", stored, [cv2.IMWRITE_PNG_COMPRESSION, 9])
    return _address("image/png", bytes(data))


def _address(kind: str, data: bytes) -> str:
    return f"data:{kind};base64,{base64.b64encode(data).decode()}"
