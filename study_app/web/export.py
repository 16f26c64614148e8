"""A study as a folder that a browser runs: `study.json`, packs of frames, pictures, the page.

The same study, stimuli and revision give the same bytes. The study's secret stays in the lab.
"""

from __future__ import annotations

import io
import math
import shutil
from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from importlib.resources import files
from pathlib import Path

import numpy as np
from PIL import Image

from protocols.browser.web_study import (
    BUDGET_MB,
    DECODED_MB,
    MB,
    STUDY_FILE,
    Pack,
    PictureFile,
    RefreshRate,
    ShownPicture,
    WebDesign,
    WebEntry,
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
from protocols.plan import planned_trials
from protocols.revision import code_revision
from protocols.script import Drawn, Entry, Frames, Live, Picture, PixelSize, Place, TrialScript
from protocols.study_file.schema import StudyProtocol
from protocols.study_file.session_schema import consent_text, filled_text, key_label
from study_app.clips import check_files, frame_bytes
from study_app.paint import Bitmaps, PixelBytes, bitmaps_of, drawn

PACKS, PICTURES = "packs", "pictures"
_COLOUR_CHUNKS = ("cHRM", "cICP", "gAMA", "iCCP", "sRGB")
_SLOTS_LOOKED_AT = 8
"""Plans differ in order, and rarely in what they show: so many say how much that is."""


@dataclass(frozen=True)
class BrowserNeeds:
    """Needs of a study on a participant's browser."""

    rates: Mapping[float, list[str]]
    """Reasons why it does not run at a refresh rate; an empty list where it does."""
    fetched_bytes: int
    """Bytes of the frames that one participant sees, as PNG files."""
    decoded_bytes: int
    """Bytes of the decoded stimuli of two trials."""
    duration_s: float
    """Length of a session, answers in 1.5 s."""
    window_px: PixelSize
    """Smallest part of the screen that shows all of a trial."""

    @property
    def rates_hz(self) -> tuple[float, ...]:
        """The refresh rates at which the study runs."""
        return tuple(rate for rate, problems in self.rates.items() if not problems)


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
    def scripts(self) -> dict[float, dict[str, list[TrialScript]]]:
        """Scripts by refresh rate and language, in the order of `scripts_at`."""
        return {
            rate: {
                language: list(scripts_at(self.study, self._at(rate), language).values())
                for language in self.study.text.languages
            }
            for rate, problems in self.rates.items()
            if not problems
        }

    @cached_property
    def pictures(self) -> dict[str, tuple[PixelBytes, Place]]:
        """Every picture by its name, cut to its ink, and how far that moved its corner."""
        bitmaps = bitmaps_of(self.shown, self.display)
        of = {picture_name(p.of): p.of for s in self._all_scripts() for p in s.pictures()}
        return {name: cut_out(one, bitmaps) for name, one in sorted(of.items())}

    def window_px(self, share: float = 1.0) -> PixelSize:
        """Return the smallest part of the screen, about its middle, that shows all of a trial.

        Parameters
        ----------
        share : float
            Share of their size that stimuli have, about their own middle.
        """
        reach_x = reach_y = 1.0
        for script in self._all_scripts():
            for left, top, width, height in self._rects(script, share):
                reach_x = max(reach_x, -left, left + width)
                reach_y = max(reach_y, -top, top + height)
        return 2 * math.ceil(reach_x), 2 * math.ceil(reach_y)

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

    def needs(self, frame_bytes: Mapping[str, int] | None = None) -> BrowserNeeds:
        """Return the study's needs of a browser.

        Parameters
        ----------
        frame_bytes : mapping, optional
            Bytes of each stimulus; left out, 1.6 bytes a pixel, as photographs take.

        Raises
        ------
        StudyError
            If the study is not meant for browsers, or runs at no refresh rate.
        """
        if not any(not problems for problems in self.rates.values()):
            first = self.rates[self.display.refresh_hz]
            raise StudyError(
                "web: the study must run at a refresh rate that participants have (it runs at none"
                f" of {', '.join(f'{rate:g}' for rate in self.rates)} Hz); at"
                f" {self.display.refresh_hz:g} Hz: " + "; ".join(first)
            )
        clip = self.stimuli[0]
        pixels = clip.width_px * clip.height_px * len(clip.frames_sha256)
        of_trial = TRIALS_IN_MEMORY * self.study.task.stimuli_per_trial * pixels * 4
        sizes = frame_bytes or {one.name: round(1.6 * pixels) for one in self.stimuli}
        seen = max(
            (self._seen(slot) for slot in range(_SLOTS_LOOKED_AT)),
            key=lambda names: sum(sizes[name] for name in names),
        )
        trials = len(planned_trials(self.shown.ordered_by(0), "web", 0))
        return BrowserNeeds(
            self.rates,
            sum(sizes[name] for name in seen),
            of_trial,
            session_duration_s(self.shown, trials),
            self.window_px(),
        )

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
        sizes = {
            clip.name: sum(
                (stimuli / clip.frame_path(index)).stat().st_size
                for index in range(len(clip.frames_sha256))
            )
            for clip in self.stimuli
        }
        needs = self.needs(sizes)
        check_budget(needs, self, budget_mb, decoded_mb)
        with whole_folder(out, replace=True, reads=[stimuli]) as work:
            (work / PACKS).mkdir()
            packs = {
                self.names[clip.name]: write_pack(
                    stimuli, clip, work / PACKS / f"{self.names[clip.name]}.pack"
                )
                for clip in self.stimuli
            }
            pictures = self._write_pictures(work / PICTURES)
            written = self._study_file(design, needs, packs, pictures)
            for asset in sorted(files("study_app").joinpath("web/assets").iterdir(), key=str):
                shutil.copyfile(str(asset), work / asset.name)
            (work / STUDY_FILE).write_text(
                written.model_dump_json(indent=1) + "\n", encoding="utf-8", newline="\n"
            )
        return needs

    def _study_file(
        self,
        design: WebDesign,
        needs: BrowserNeeds,
        packs: dict[str, Pack],
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
            window_px=needs.window_px,
            screen_px=self._any_script.size_px,
            design=design,
            break_s=self.study.design.break_s,
            duration_s=needs.duration_s,
            rates=tuple(self._rate(rate) for rate in needs.rates_hz),
            dropped_max=self.study.trial.dropped_frames_max,
            continue_keys=self.study.response.continue_keys,
            pause_keys=self.study.response.pause_keys,
            quit_keys=self.study.response.quit_keys,
            stimulus_px=self._any_script.stimulus_px,
            stimuli=dict(sorted(packs.items())),
            pictures=pictures,
            decoded_bytes=needs.decoded_bytes,
            **self.shown.web.model_dump(include={"identifier", "completion_url", "completion_code"})
            if self.shown.web
            else {},
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

    def _at(self, refresh_hz: float) -> Display:
        tolerance_s = self.study.web.tolerance_s if self.study.web else 0.0
        return self.display.at_rate(refresh_hz, tolerance_s)

    def _rects(
        self, script: TrialScript, share: float
    ) -> Iterator[tuple[float, float, float, float]]:
        for phase in script.phases:
            for entry in phase.show:
                if isinstance(entry, Frames):
                    left, top = entry.at
                    width, height = (entry.crop or (0, 0, *script.stimulus_px))[2:]
                    cut = (1 - share) / 2
                    yield left + cut * width, top + cut * height, share * width, share * height
        for picture in script.pictures():
            pixels, (right, down) = self.pictures[picture_name(picture.of)]
            yield picture.at[0] + right, picture.at[1] + down, pixels.shape[1], pixels.shape[0]

    def _seen(self, slot: int) -> set[str]:
        """Return the stimuli that a participant may see."""
        trials = planned_trials(self.shown.ordered_by(slot), "web", slot)
        planned = {name for trial in trials for name in trial.stimuli}
        chosen = any(trial.track is not None for trial in trials)
        return planned | ({clip.name for clip in self.stimuli} if chosen else set())

    def _rate(self, refresh_hz: float) -> RefreshRate:
        kinds = scripts_at(self.study, self._at(refresh_hz), self.study.text.default_language)
        return RefreshRate(
            refresh_hz=refresh_hz,
            deviations_s=deviations_s(self.shown, self._at(refresh_hz)),
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
        name = picture_name(picture.of)
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


def picture_name(of: Drawn) -> str:
    """Return the name of a picture: the hash of what it shows."""
    return sha256_json(of)


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


def write_pack(stimuli: Path, clip: Clip, path: Path) -> Pack:
    """Write the frames of a stimulus into a file, one after the other, as they are.

    Raises
    ------
    StudyError
        If a frame is not the one that was hashed, or asks a browser for other colours.
    """
    end, ends = 0, []
    with path.open("wb") as pack:
        for index in range(len(clip.frames_sha256)):
            data = frame_bytes(stimuli, clip, index)
            if chunks := colour_chunks(data):
                raise StudyError(
                    f"{stimuli / clip.frame_path(index)}: must hold no colour chunk (has"
                    f" {', '.join(chunks)}): some browsers show other codes then than those that"
                    " were hashed; build the stimuli with 'metamerlab stimuli build', which writes"
                    " none"
                )
            pack.write(data)
            end += len(data)
            ends.append(end)
    return Pack(file=path.name, bytes=end, sha256=clip.frames_sha256, ends=tuple(ends))


def colour_chunks(png: bytes) -> list[str]:
    """Return the names of chunks that say how a PNG's codes are meant; they precede its pixels."""
    found, at = [], 8
    while png[at + 4 : at + 8] not in (b"IDAT", b""):
        found += [name for name in _COLOUR_CHUNKS if png[at + 4 : at + 8] == name.encode()]
        at += 12 + int.from_bytes(png[at : at + 4], "big")
    return found


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
    over = [
        (what, got / MB, most_mb, option)
        for what, got, most_mb, option in (
            ("one participant may fetch", needs.fetched_bytes, budget_mb, "--budget-mb"),
            ("stimuli of two trials may take", needs.decoded_bytes, decoded_mb, "--decoded-mb"),
        )
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
        + " ".join(f"{option} {np.ceil(got):.0f}" for _, got, _, option in over)
    )


def picture_png(pixels: PixelBytes) -> bytes:
    """Return a picture as a PNG file without any colour chunk: codes stay what they are."""
    file = io.BytesIO()
    Image.fromarray(np.ascontiguousarray(pixels)).save(file, "PNG", optimize=True)
    return file.getvalue()
