"""One picture file, shown to a gaze, into files: what `metamerlab foveate` does, as a call."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import moderngl
import numpy as np

from pipeline.errors import InputError
from pipeline.foveation.geometry import FlatGeometry
from pipeline.foveation.view import around_gaze, scored_view
from pipeline.frame import check_seed
from pipeline.gl.context import describe
from pipeline.named_classes import Choice
from pipeline.pictures import drawing
from pipeline.pictures.colour_file import (
    AnyPicture,
    PictureReading,
    check_drawable,
    read_any,
    save_colour,
)
from pipeline.pictures.size_limits import NEEDS
from protocols.disk.result_folder import whole_folder
from stimuli.foveate import metamer_page as pages
from stimuli.foveate.condition_sheet import ConditionPicture, check_choices, look_through, sheet_of
from stimuli.foveate.foveation_steps import write_foveation_steps
from stimuli.media import moving
from stimuli.media.frames_folder import SILENT, Reporter
from stimuli.media.gaze_and_display import (
    AS_ASSUMED,
    GazeAndDisplay,
    StatedViewing,
    gaze_words,
    read_gaze,
    width_deg,
)

LEAST_SCORED_PX = 32
ODD_BORDER = 0.15
"""Difference of an outermost row from the next one, in the mean, from which on a note tells it."""
METAMER = Choice("metamer")


@dataclass(frozen=True)
class Outputs:
    """Files to write. Folders are made; what is there is replaced.

    Parameters
    ----------
    out : Path, optional
        What the first choice shows: .png (of as many bits as the picture), or .exr.
    compare : Path, optional
        A sheet of the picture with its pools, and all choices: .png.
    steps : Path, optional
        A folder for every step of the first choice.
    score : Path, optional
        A folder for what metrics say of all choices.
    animate, flip : Path, optional
        Moving pictures of the first choice, .webp, .png or .apng: the gaze wanders; two seeds.
    page : Path, optional
        A page on which the first choice follows the mouse: .html.
    size_px : int, optional
        Longer edge of the moving pictures, and of the page's.
    """

    out: Path | None = None
    compare: Path | None = None
    steps: Path | None = None
    score: Path | None = None
    animate: Path | None = None
    flip: Path | None = None
    page: Path | None = None
    size_px: int | None = None


@dataclass(frozen=True, eq=False)
class _Work:
    """A picture, how it is looked at, and by what it is shown."""

    name: str
    opened: AnyPicture
    looking: GazeAndDisplay
    gaze_px: tuple[float, float]
    choices: tuple[Choice, ...]
    seed: int
    ctx: moderngl.Context | None
    reporter: Reporter

    @property
    def shown(self) -> moving.AnimatedPicture:
        return moving.AnimatedPicture(
            self.opened.colour, self.looking.viewing, self.choices[0], self.ctx
        )

    def count_frames(self, done: int, total: int) -> None:
        self.reporter.progress("drawing frames", done, total)


def foveate_file(
    picture: Path,
    outputs: Outputs | Path,
    *,
    viewing: StatedViewing = AS_ASSUMED,
    choices: Sequence[Choice] = (METAMER,),
    seed: int = 0,
    reading: PictureReading | None = None,
    ctx: moderngl.Context | None = None,
    reporter: Reporter = SILENT,
) -> list[ConditionPicture]:
    """Show a picture file to a gaze by every choice, and write what is asked for.

    Parameters
    ----------
    picture : Path
        Any picture that `read_any` reads.
    outputs : Outputs or Path
        A path alone: the picture that the first choice shows.
    viewing : StatedViewing
        Where the eye looks, and from how far.
    choices : sequence of Choice
        Conditions and their parameters; the first one makes OUT.
    seed : int
        Of noise and displacement.
    reading : PictureReading, optional
        What is said about the file.
    ctx : moderngl.Context, optional
        Work on the GPU, where a condition can; without it numpy does.
    reporter : Reporter
        Is told what was decided and written, and how far the work is.

    Returns
    -------
    list of ConditionPicture
        What each choice shows: `ConditionPicture.colour` is encoded R'G'B' of shape (H, W, 3). None
        where only moving pictures and a page are asked for.

    Raises
    ------
    InputError, StudyError, OSError
        Before anything is written, if the picture, the way it is looked at, a choice or a seed is
        not what it must be.
    """
    asked = outputs if isinstance(outputs, Outputs) else Outputs(outputs)
    tell = reporter.say
    if not choices:
        raise InputError("choices must hold at least one condition (got none)")
    check_choices(choices)
    check_seed(seed)
    by_numpy = ctx is None or asked.compare is not None or asked.steps is not None
    check_drawable(picture, ctx)
    lean = all(f"foveate {choice.name}" in NEEDS for choice in choices)
    command = f"foveate {max(choice.name for choice in choices)}" if lean else "foveate"
    opened = read_any(picture, reading, "foveate by numpy" if by_numpy else command)
    height, width = opened.size
    looking = viewing.of((height, width))
    work = _Work(
        picture.stem, opened, looking, read_gaze(viewing.gaze, looking.geometry), tuple(choices),
        seed, ctx, reporter,
    )  # fmt: skip
    if asked.score is not None:
        _check_scorable(work)
    if asked.page is not None:
        pages.check_page(looking.viewing, choices[0])
    tell(f"{width} x {height} px")
    tell(looking.words)
    tell(gaze_words(work.gaze_px, looking.geometry))
    reporter.note((*opened.notes, *looking.notes, *border_notes(opened)))
    return _write(work, asked)


def border_notes(picture: AnyPicture) -> tuple[str, ...]:
    """Return a note on outermost rows and columns that the next ones are nothing like."""
    stored, whole = picture.stored, 255 if picture.stored.dtype == np.uint8 else 1
    edges = {"upper row": stored, "lower row": stored[::-1]}
    edges |= {"left column": stored.swapaxes(0, 1), "right column": stored.swapaxes(0, 1)[::-1]}
    odd = []
    for name, lines in edges.items():
        if len(lines) < 8:
            continue
        apart = np.abs(np.diff(lines[:4].astype(np.float32), axis=0)).mean(axis=(1, 2)) / whole
        if apart[0] > max(ODD_BORDER, 3 * apart[1:].max()):
            odd.append(name)
    if not odd:
        return ()
    return (
        f"its {', '.join(odd)} differs much from the next: a frame? pools spread it; cut it off",
    )


def _check_scorable(work: _Work) -> None:
    """Refuse before the work what the metrics cannot measure."""
    geometry, (x, y) = work.looking.geometry, work.gaze_px
    if not (0 <= x <= geometry.width_px and 0 <= y <= geometry.height_px):
        raise InputError("--score needs a gaze on the picture: FovVideoVDP knows no other")
    edge = min(geometry.width_px, geometry.height_px)
    if geometry.wraps:
        edge = scored_view((geometry.width_px, geometry.height_px)).width_px
    if edge < LEAST_SCORED_PX:
        raise InputError(
            f"--score needs pictures of at least {LEAST_SCORED_PX} px an edge (has {edge})"
        )


def _write(work: _Work, outputs: Outputs) -> list[ConditionPicture]:
    viewing, state = work.looking.viewing, None
    for path in vars(outputs).values():
        if isinstance(path, Path):
            path.parent.mkdir(parents=True, exist_ok=True)
    if not any((outputs.out, outputs.compare, outputs.steps, outputs.score)):
        _write_moving(work, outputs)
        return []
    if (kept := outputs.out or outputs.compare) is not None:
        state = kept.with_name(f".{kept.name}.state.npz")
        if state.exists():
            work.reporter.say(f"going on where {state} ends")
    seen = look_through(
        work.opened.stored, work.gaze_px, viewing, work.choices, seed=work.seed, ctx=work.ctx,
        state=state, report=lambda now: work.reporter.progress(now, 0, 0),
    )  # fmt: skip
    _say_where(work, seen)
    if outputs.out is not None:
        _save(outputs.out, seen[0], work.opened.bits)
        work.reporter.say(f"wrote {outputs.out} ({seen[0].choice.label})")
    if outputs.compare is not None:
        drawing.save_picture(
            outputs.compare, sheet_of(work.opened.colour, work.gaze_px, viewing, seen)
        )
        work.reporter.say(
            f"wrote {outputs.compare} ({len(seen)} condition{'' if len(seen) == 1 else 's'})"
        )
    if outputs.steps is not None:
        written = write_foveation_steps(
            outputs.steps, work.opened.colour, work.gaze_px, viewing, seen[:1], seed=work.seed
        )
        work.reporter.say(
            f"wrote {len(written)} pictures to {outputs.steps}; begin with {written[-1]}"
        )
    if outputs.score is not None:
        page = _score(work, seen, outputs.score)
        work.reporter.say(f"wrote {page}, and beside it CSV, JSON, Markdown tables and figures")
    _write_moving(work, outputs)
    return seen


def _say_where(work: _Work, seen: Sequence[ConditionPicture]) -> None:
    if work.ctx is not None and any(one.on_gpu for one in seen):
        work.reporter.say(f"renderer: {describe(work.ctx)}")
    by_numpy = [one.choice.name for one in seen if not one.on_gpu]
    if by_numpy:
        work.reporter.say(f"worked out by numpy: {', '.join(by_numpy)}")


def _save(path: Path, one: ConditionPicture, bits: int) -> None:
    if path.suffix.lower() == ".exr":
        save_colour(path, one.colour, bits=32 if bits == 16 else 16)
    else:
        save_colour(path, one.colour, bits=bits)


def _score(work: _Work, seen: Sequence[ConditionPicture], out: Path) -> Path:
    """Score what was seen; a panorama in the flat view around the gaze."""
    from stimuli.score.foveated import (
        PANORAMA_NOTE,
        score_conditions,
        seen_wide,
        subjects_of_conditions,
    )
    from stimuli.score.write_scores import CACHE_FOLDER

    geometry, gaze_px, bits = work.looking.geometry, work.gaze_px, work.opened.bits
    truth_colour, around = work.opened.colour, geometry.wraps
    if around:
        truth_colour = around_gaze(truth_colour, gaze_px)
        geometry = scored_view((geometry.width_px, geometry.height_px))
    assert isinstance(geometry, FlatGeometry)
    height, width = truth_colour.shape[:2]
    with whole_folder(out, replace=True, keeps=CACHE_FOLDER) as results:
        folder = results / "pictures"
        folder.mkdir()
        truth = folder / "picture.png"
        save_colour(truth, truth_colour, bits=bits)
        tests = {}
        for one in seen:
            if one.choice.name == "reference" and len(seen) > 1:
                continue  # it is what the others are compared with
            path = folder / f"{one.choice.file_name}.png"
            colour = around_gaze(one.colour, gaze_px) if around else one.colour
            save_colour(path, colour, bits=bits)
            tests[one.choice.label] = path
        notes = (PANORAMA_NOTE,) if around else ()
        subjects = subjects_of_conditions(work.name, truth, tests, (height, width), notes)
        page = score_conditions(
            subjects,
            seen_wide(width, height, width_deg(geometry)),
            (width / 2, height / 2) if around else gaze_px,
            results,
            out / CACHE_FOLDER,
            report=lambda done, total, what: work.reporter.progress(what, done, total),
        )
    return out / page.name


def _write_moving(work: _Work, outputs: Outputs) -> None:
    """Write the moving pictures and the page of the first choice."""
    say, size_px = work.reporter.say, outputs.size_px
    if outputs.animate is not None:
        size = moving.wander(
            outputs.animate, work.shown, seed=work.seed, longest_px=size_px or moving.LONGEST_PX,
            report=work.count_frames,
        )  # fmt: skip
        say(f"wrote {outputs.animate} ({size / 1000:.0f} kB)")
    if outputs.flip is not None:
        size = moving.flip(
            outputs.flip, work.shown, work.gaze_px, seeds=(work.seed, work.seed + 1),
            longest_px=size_px or 2 * moving.LONGEST_PX, report=work.count_frames,
        )  # fmt: skip
        say(f"wrote {outputs.flip} ({size / 1000:.0f} kB)")
    if outputs.page is not None:
        width, height, size = pages.write_page(
            outputs.page, work.name, work.opened.colour, work.looking.viewing, work.choices[0],
            seed=work.seed, longest_px=size_px or pages.LONGEST_PX,
        )  # fmt: skip
        say(f"wrote {outputs.page} ({width} x {height} px, {size / 1e6:.1f} MB)")
