"""A study as a folder that a browser runs: `study.json`, packs of frames, pictures, the page.

The same study, stimuli and revision give the same bytes. The study's secret stays in the lab.
"""

from __future__ import annotations

import io
import shutil
from collections import ChainMap, Counter
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from importlib.resources import files
from math import ceil
from pathlib import Path
from typing import TypeAlias

import numpy as np
from PIL import Image

from protocols.browser.web_study import (
    BUDGET_MB,
    DECODED_MB,
    MB,
    PIECE_PX,
    STUDY_FILE,
    PictureFile,
    RefreshRate,
    ShownPicture,
    WebDesign,
    WebEntry,
    WebHeadset,
    WebPages,
    WebPhase,
    WebScript,
    WebStudy,
    deviations_s,
    rates_of,
    scripts_at,
    web_design,
)
from protocols.disk.hashing import sha256_bytes, sha256_json
from protocols.disk.result_folder import whole_folder
from protocols.display import Display
from protocols.errors import StudyError
from protocols.feasibility import TRIALS_IN_MEMORY, require_feasible, session_duration_s
from protocols.manifest import Clip, Manifest, check_manifest
from protocols.plan import PlannedTrial, planned_trials, scenes_at, windows
from protocols.recipes.base import SCENE
from protocols.revision import code_revision
from protocols.script import Drawn, Entry, Frames, Live, Picture, PixelSize, Place, TrialScript
from protocols.study_file.schema import StudyProtocol
from protocols.study_file.session_schema import Headset, consent_text, filled_text, key_label
from study_app.clips import check_files
from study_app.paint import Bitmaps, PixelBytes, bitmaps_of, drawn
from study_app.web.packs import Packs, write_packs

PACKS, PICTURES = "packs", "pictures"
HEADSET_PAGE = "metamerlab-headset.js"
"""Script that only studies in headsets have."""
LARGEST_PX = 8192
"""Largest edge of a texture that every headset of the last years takes."""
_Rect: TypeAlias = tuple[float, float, float, float]
"""Left and top, from the middle of the screen, width and height, px."""
_SLOTS_LOOKED_AT = 8
"""Plans differ in order, and rarely in what they show: so many say how much that is."""
_MOST_LOOKED_AT = 40
BYTES_PER_PX = 1.2
"""Estimate for pictures as lossless WebP: photographs and rendered scenes took 0.9 to 1.2."""


@dataclass(frozen=True)
class BrowserNeeds:
    """Memory that a study takes of a participant's line and browser."""

    fetched_bytes: int
    """Bytes of the files that one participant fetches."""
    decoded_bytes: int
    """Bytes of the decoded stimuli of two trials."""
    estimated: bool = False
    """True if the stimuli were not built, and their bytes are an estimate."""


@dataclass(frozen=True)
class WebBuild:
    """A study with what a browser is to show of it.

    Parameters
    ----------
    study : StudyProtocol
        With a section `[web]`.
    display : Display
        For which the stimuli were built.
    manifest : Manifest
        Of the stimuli.
    """

    study: StudyProtocol
    display: Display
    manifest: Manifest

    @cached_property
    def shown(self) -> StudyProtocol:
        """The study as a browser runs it."""
        return self.study.in_a_browser()

    @cached_property
    def rates(self) -> dict[float, list[str]]:
        """Reasons why the study does not run at a refresh rate; an empty list where it does."""
        return rates_of(self.study, self.display)

    @cached_property
    def rates_hz(self) -> tuple[float, ...]:
        """The refresh rates at which the study runs; `StudyError` where there is none."""
        if found := tuple(rate for rate, problems in self.rates.items() if not problems):
            return found
        own = self.display.refresh_hz
        rate = own if own in self.rates else min(self.rates)
        raise StudyError(
            "web: the study must run at a refresh rate that participants have (it runs at none"
            f" of {', '.join(f'{rate:g}' for rate in self.rates)} Hz); at"
            f" {rate:g} Hz: " + "; ".join(self.rates[rate])
        )

    @cached_property
    def trials(self) -> tuple[PlannedTrial, ...]:
        """The trials of some participant, of whom all have as many."""
        return planned_trials(self.shown.ordered_by(0), "web", 0)

    @property
    def decisions(self) -> int:
        """Main trials of a participant."""
        return sum(trial.role == "main" for trial in self.trials)

    @property
    def duration_s(self) -> float:
        """Length of a session, answers in 1.5 s."""
        return session_duration_s(self.shown, len(self.trials))

    @cached_property
    def scripts(self) -> dict[float, dict[str, list[TrialScript]]]:
        """Scripts by refresh rate and language, in the order of `scripts_at`."""
        return {
            rate: {
                language: list(scripts_at(self.study, self.at(rate), language).values())
                for language in self.study.text.languages
            }
            for rate in self.rates_hz
        }

    @cached_property
    def pictures(self) -> dict[str, tuple[PixelBytes, Place]]:
        """Every picture by the hash of what it shows, cut to its ink, and its corner's way."""
        bitmaps = bitmaps_of(self.shown, self.display)
        of = {sha256_json(p.of): p.of for s in self._all_scripts() for p in s.pictures()}
        return {name: cut_out(one, bitmaps) for name, one in sorted(of.items())}

    def window_px(self, share: float = 1.0) -> PixelSize:
        """Return the smallest part of the screen, about its middle, that shows all of a trial.

        Parameters
        ----------
        share : float
            Share of their size that stimuli have, about their own middle.
        """
        return _about_middle(
            rect for script in self._all_scripts() for rect in self._rects(script, share)
        )

    @cached_property
    def stimuli(self) -> list[Clip]:
        """The stimuli that some participant may see, in the manifest's order."""
        shown = set(self.shown.shown())
        return [clip for clip in self.manifest.clips if clip.name in shown]

    @cached_property
    def names(self) -> dict[str, str]:
        """Name of each stimulus in the export: a hash of its frames, which tells no condition."""
        met = Counter[str]()  # equal frames may be shown as two conditions
        found = {}
        for clip in self.stimuli:
            met[clip.sha256] += 1
            found[clip.name] = sha256_json([clip.sha256, met[clip.sha256]])[:16]
        return found

    def needs(self, packs: Mapping[str, Mapping[str, int]] | None = None) -> BrowserNeeds:
        """Return the memory that the study takes of a participant's line and browser.

        Parameters
        ----------
        packs : mapping, optional
            Bytes of the files that each stimulus takes, by their names. Left out: an estimate of
            1.2 bytes a pixel, as photographs take, and of what a scene's stimuli have in common.

        Raises
        ------
        StudyError
            If the study is not meant for browsers.
        """
        clip = self.stimuli[0]
        pixels = clip.width_px * clip.height_px * len(clip.frames_sha256)
        of_trial = TRIALS_IN_MEMORY * self.study.task.stimuli_per_trial * pixels * 4
        sizes = self._estimated(BYTES_PER_PX * pixels) if packs is None else packs
        fetched = 0
        for slot in range(min(max(_SLOTS_LOOKED_AT, windows(self.shown)), _MOST_LOOKED_AT)):
            files_seen = ChainMap(*(dict(sizes.get(name, {})) for name in self._seen(slot)))
            fetched = max(fetched, sum(files_seen.values()))
        return BrowserNeeds(fetched, of_trial, packs is None)

    def write(
        self,
        stimuli: Path,
        out: Path,
        *,
        budget_mb: float = BUDGET_MB,
        decoded_mb: float = DECODED_MB,
    ) -> BrowserNeeds:
        """Fill a folder with all that a browser needs.

        Parameters
        ----------
        stimuli : Path
            The folder of the manifest.
        out : Path
            Must not exist, be empty, or hold an earlier export.
        budget_mb, decoded_mb : float
            As `check_budget` takes them.

        Returns
        -------
        BrowserNeeds
            With the true sizes.

        Raises
        ------
        StudyError
            If stimuli and study do not belong together, or a browser cannot run the study.
        """
        check_manifest(self.study, self.manifest)
        require_feasible(self.shown, self.display, self.manifest)
        check_files(stimuli, self.manifest)
        design = web_design(self.shown, self.names)
        headset = self.headset
        check_budget(self.needs({}), self, budget_mb, decoded_mb)
        with whole_folder(out, replace=True, reads=[stimuli]) as work:
            (work / PACKS).mkdir()
            packs = write_packs(stimuli, self.stimuli, self.names, work / PACKS)
            needs = self.needs({one: packs.bytes_of(name) for one, name in self.names.items()})
            check_budget(needs, self, budget_mb, decoded_mb)
            pictures = self._write_pictures(work / PICTURES)
            written = self._study_file(design, needs, packs, pictures)
            for asset in sorted(files("study_app").joinpath("web/assets").iterdir(), key=str):
                if asset.name != HEADSET_PAGE or headset:
                    shutil.copyfile(str(asset), work / asset.name)
            (work / STUDY_FILE).write_text(
                written.model_dump_json(indent=1) + "\n", encoding="utf-8", newline="\n"
            )
        return needs

    def _study_file(
        self,
        design: WebDesign,
        needs: BrowserNeeds,
        packs: Packs,
        pictures: dict[str, PictureFile],
    ) -> WebStudy:
        return WebStudy(
            format=1,
            study=self.study.study.name,
            title=self.study.study.title,
            protocol_sha256=self.study.sha256,
            manifest_sha256=self.manifest.sha256,
            revision=code_revision(),
            default_language=self.study.text.default_language,
            pages={language: self.page(language) for language in self.study.text.languages},
            background=self._any_script.background,
            window_px=self.window_px(),
            screen_px=self._any_script.size_px,
            design=design,
            break_s=self.study.design.break_s,
            duration_s=self.duration_s,
            rates=tuple(map(self._rate, self.rates_hz)),
            dropped_max=self.study.trial.dropped_frames_max,
            continue_keys=self.study.response.continue_keys,
            pause_keys=self.study.response.pause_keys,
            quit_keys=self.study.response.quit_keys,
            stimulus_px=self._any_script.stimulus_px,
            stimuli=dict(sorted(packs.stimuli.items())),
            shared=packs.shared,
            piece_px=PIECE_PX,
            pictures=pictures,
            decoded_bytes=needs.decoded_bytes,
            headset=self.headset,
            **self.shown.web.model_dump(include={"identifier", "completion_url", "completion_code"})
            if self.shown.web
            else {},
        )

    @cached_property
    def headset(self) -> WebHeadset | None:
        """Show in a headset; `StudyError` where it cannot show the study; None for a screen."""
        asked = self.study.headset
        if asked is None:
            return None
        check_headset(self, asked)
        return WebHeadset(
            distance_px=self.display.distance_mm / self.display.pitch_x_mm,
            around=asked.around,
            turn_deg=asked.turn_deg,
            rates=tuple(rate for rate in asked.rates if rate in self.rates_hz),
        )

    def page(self, language: str) -> WebPages:
        """Return the texts that a participant reads beside trials."""
        texts, response = self.study.text.languages[language], self.study.response

        def filled(text: str) -> str:
            # Numbers of blocks are known when the page is shown.
            kept = text.replace("{done}", "\0").replace("{total}", "\1")
            return filled_text(kept, response).replace("\0", "{done}").replace("\1", "{total}")

        return WebPages(
            consent=filled(consent_text(texts, self.study.privacy.contact)),
            instructions=tuple(map(filled, texts.instructions)),
            practice=filled(texts.practice),
            start=filled(texts.start),
            break_page=filled(texts.break_page),
            paused=filled(texts.paused),
            preparing=filled(texts.preparing),
            quit_question=filled(texts.quit_question),
            thanks=filled(texts.thanks),
            key_names={key: key_label(key, texts.key_names) for key in self._keys},
            questions=texts.questions,
        )

    @cached_property
    def _keys(self) -> list[str]:
        """The keys that a participant may press, each once."""
        asked = (phase.question for script in self._all_scripts() for phase in script.phases)
        answers = [keys for question in asked if question for keys in question.keys]
        own = self.study.response
        every = (*answers, own.continue_keys, own.pause_keys, own.quit_keys)
        return sorted({key for keys in every for key in keys})

    @property
    def _any_script(self) -> TrialScript:
        return next(self._all_scripts())

    def _all_scripts(self) -> Iterator[TrialScript]:
        for by_language in self.scripts.values():
            for scripts in by_language.values():
                yield from scripts

    def at(self, refresh_hz: float) -> Display:
        """Return the display at a refresh rate, with the tolerance that the study declares."""
        tolerance_s = self.study.web.tolerance_s if self.study.web else 0.0
        return self.display.at_rate(refresh_hz, tolerance_s)

    def _rects(self, script: TrialScript, share: float) -> Iterator[_Rect]:
        for left, top, width, height in _stimuli_rects(script):
            cut = (1 - share) / 2
            yield left + cut * width, top + cut * height, share * width, share * height
        for picture in script.pictures():
            placed = self._placed(picture)
            height, width, _ = self.pictures[placed.of][0].shape
            yield *placed.at, width, height

    def _seen(self, slot: int) -> set[str]:
        """Return the stimuli that a participant may see, with the places in order of arrival."""
        design = self.shown.design.model_copy(update={"places": "by-arrival"})
        study = self.shown.model_copy(update={"design": design}).ordered_by(0)
        trials = planned_trials(study, "web", slot)
        seen = {name for trial in trials for name in trial.stimuli}
        if any(trial.track is not None for trial in trials):
            pool = replace(study.pool, scenes=scenes_at(study, slot))
            ways = [way for cell in study.task.cells(pool) for way in cell.arrangements]
            seen |= {name for way in ways for name in way.stimuli}
        return seen

    def _estimated(self, each: float) -> dict[str, dict[str, int]]:
        """Return the bytes of the files that stimuli take, of so many in a stimulus by itself."""
        shared, own = self.study.stimuli.overlap
        return {
            clip.name: {
                clip.name: round(own * each),
                f"scene:{clip.condition.get(SCENE)}": round(shared * each),
            }
            for clip in self.stimuli
        }

    def _rate(self, refresh_hz: float) -> RefreshRate:
        kinds = scripts_at(self.study, self.at(refresh_hz), self.study.text.default_language)
        return RefreshRate(
            refresh_hz=refresh_hz,
            deviations_s=deviations_s(self.shown, self.at(refresh_hz)),
            scripts={
                language: tuple(
                    self._script(*kind, script) for kind, script in zip(kinds, scripts, strict=True)
                )
                for language, scripts in self.scripts[refresh_hz].items()
            },
        )

    def _script(self, answers: tuple[str, ...], practice: bool, script: TrialScript) -> WebScript:
        return WebScript(
            answers=answers,
            practice=practice,
            phases=tuple(
                WebPhase(
                    **phase.model_dump(exclude={"show", "follows"}),
                    show=tuple(map(self._entry, phase.show)),
                    follows={how: self._placed(one) for how, one in phase.follows.items()},
                )
                for phase in script.phases
            ),
        )

    def _entry(self, entry: Entry) -> WebEntry:
        assert not isinstance(entry, Live), "in_a_browser refuses what follows the gaze"
        return self._placed(entry) if isinstance(entry, Picture) else entry

    def _placed(self, picture: Picture) -> ShownPicture:
        name = sha256_json(picture.of)
        _, (right, down) = self.pictures[name]
        return ShownPicture(of=name, at=(picture.at[0] + right, picture.at[1] + down))

    def _write_pictures(self, folder: Path) -> dict[str, PictureFile]:
        folder.mkdir()
        found = {}
        for name, (pixels, _) in self.pictures.items():
            data = picture_png(pixels)
            (folder / f"{name[:16]}.png").write_bytes(data)
            size = pixels.shape[1], pixels.shape[0]
            found[name] = PictureFile(
                file=f"{name[:16]}.png", sha256=sha256_bytes(data), size_px=size
            )
        return found


def stimuli_px(script: TrialScript) -> PixelSize:
    """Return the smallest part of the screen, about its middle, that shows a trial's stimuli.

    Texts are left out: their size is that of the fonts of the machine that exported the study.
    """
    return _about_middle(_stimuli_rects(script))


def _stimuli_rects(script: TrialScript) -> Iterator[_Rect]:
    """Yield the rectangles in which a trial shows stimuli."""
    for frames in (entry for phase in script.phases for entry in phase.show):
        if isinstance(frames, Frames):
            yield *frames.at, *(frames.crop or (0, 0, *script.stimulus_px))[2:]


def _about_middle(rects: Iterable[_Rect]) -> PixelSize:
    """Return the smallest part of the screen, about its middle, that holds such rectangles."""
    reach_x = reach_y = 1.0
    for left, top, width, height in rects:
        reach_x, reach_y = max(reach_x, -left, left + width), max(reach_y, -top, top + height)
    return 2 * ceil(reach_x), 2 * ceil(reach_y)


def cut_out(of: Drawn, bitmaps: Bitmaps) -> tuple[PixelBytes, Place]:
    """Return a picture without the empty rows and columns around it, and its corner's new place.

    A notice is as large as the screen that it was made for, and its words are in the middle.

    Returns
    -------
    ndarray of shape (height, width, 4)
        RGBA with straight alpha; one pixel where nothing is drawn.
    (right, down) : tuple of int
        How many columns and rows were cut off before it.
    """
    pixels = drawn(of, bitmaps)
    rows, columns = (np.flatnonzero(pixels[..., 3].any(axis=axis)) for axis in (1, 0))
    if not len(rows):
        return pixels[:1, :1], (0, 0)
    top, left = int(rows[0]), int(columns[0])
    return pixels[top : rows[-1] + 1, left : columns[-1] + 1], (left, top)


def check_headset(build: WebBuild, headset: Headset) -> None:
    """Refuse a study that no headset can show, or no two triggers answer.

    Raises
    ------
    StudyError
    """
    clip = build.stimuli[0]
    size = f"{clip.width_px} x {clip.height_px} px"
    if max(clip.width_px, clip.height_px) > LARGEST_PX:
        raise StudyError(
            f"web.headset: stimuli must have at most {LARGEST_PX} px an edge, as headsets take"
            f" textures (got {size}); build smaller ones"
        )
    if headset.around and clip.width_px != 2 * clip.height_px:
        raise StudyError(
            "web.headset.around: stimuli must be panoramas, twice as wide as high"
            f" (got {size}); leave around out, and they are on a flat screen"
        )
    for phase in (phase for script in build._all_scripts() for phase in script.phases):
        if phase.question is not None and len(phase.question.answers) != 2:
            answers = ", ".join(phase.question.answers)
            raise StudyError(
                "web.headset: every question of a trial must have two answers, one for each"
                f" trigger (got {phase.question.name!r} with {answers}); leave it out, or ask it"
                " after the last block"
            )
        shown = [entry for entry in phase.show if isinstance(entry, Frames)]
        if headset.around and (len(shown) > 1 or any(entry.crop for entry in shown)):
            raise StudyError(
                "web.headset.around: a panorama must be shown whole, and one at a time (phase"
                f" {phase.name!r} shows {len(shown)}, or a part); choose a task of one stimulus at"
                " a time"
            )


def check_budget(
    needs: BrowserNeeds,
    build: WebBuild,
    budget_mb: float = BUDGET_MB,
    decoded_mb: float = DECODED_MB,
) -> None:
    """Refuse a study that takes more than a participant's line or browser has, with what would fit.

    Parameters
    ----------
    budget_mb, decoded_mb : float
        Most that one participant may fetch, and the decoded stimuli of two trials may take, in
        millions of bytes.

    Raises
    ------
    StudyError
    """
    headset, in_memory = build.study.headset, "stimuli of two trials may take"
    memory = (in_memory, needs.decoded_bytes, decoded_mb, "--decoded-mb")
    if headset:
        memory = (in_memory, needs.decoded_bytes, headset.memory_mb, "web.headset.memory_mb =")
    fetched = ("one participant may fetch", needs.fetched_bytes, budget_mb, "--budget-mb")
    over = [
        (what, got / MB, most_mb, option)
        for what, got, most_mb, option in (fetched, memory)
        if got > most_mb * MB
    ]
    if not over:
        return
    clip, share = build.stimuli[0], min(most / got for _, got, most, _ in over)
    width, height = (2 * int(edge * share**0.5 / 2) for edge in (clip.width_px, clip.height_px))
    fits = [f"stimuli of {width}x{height} px instead of {clip.width_px}x{clip.height_px}"]
    if (fewer := int(len(clip.frames_sha256) * share)) > 1:
        fits.append(f"{fewer} frames instead of {len(clip.frames_sha256)}")
    if [option for *_, option in over] == ["--budget-mb"] and share >= 0.01:
        fits.append(f"{int(100 * share)}% of the scenes")
    raise StudyError(
        "web: "
        + " and ".join(f"{what} {most:g} MB (got {got:.0f} MB)" for what, got, most, _ in over)
        + f"; what would fit: {', or '.join(fits)}; or export with "
        + (" and " if headset else " ").join(
            f"{option} {np.ceil(got):.0f}" for _, got, _, option in over
        )
    )


def picture_png(pixels: PixelBytes) -> bytes:
    """Return a picture as a PNG file without any colour chunk: codes stay what they are."""
    file = io.BytesIO()
    Image.fromarray(np.ascontiguousarray(pixels)).save(file, "PNG", optimize=True)
    return file.getvalue()
