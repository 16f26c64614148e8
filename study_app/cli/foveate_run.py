"""What `metamerlab foveate` does when all is checked: show the picture, write what was asked."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from rich.console import Console

from protocols.errors import StudyError
from study_app.cli.one_picture import FILE_ENDINGS, check_outputs
from study_app.cli.progress import one_line

if TYPE_CHECKING:
    import moderngl

    from pipeline.foveation.geometry import Viewing
    from stimuli.foveated.any_picture import AnyPicture
    from stimuli.foveated.look_through import Choice, Seen
    from stimuli.foveated.looking import Looking

MOVING_ENDINGS = (".webp", ".png", ".apng")
LEAST_SCORED_PX = 32


@dataclass(frozen=True)
class Outputs:
    """What is to be written, and from what."""

    picture: Path
    out: Path
    compare: Path | None
    steps: Path | None
    animate: Path | None
    flip: Path | None
    size_px: int | None
    score: Path | None

    def check(self) -> None:
        """Refuse before the work what could not be written after it."""
        check_outputs(
            {
                "OUT": (self.out, FILE_ENDINGS),
                "--compare": (self.compare, (".png",)),
                "--animate": (self.animate, MOVING_ENDINGS),
                "--flip": (self.flip, MOVING_ENDINGS),
            },
            [self.steps, self.score],
        )
        if self.score is not None:
            from stimuli.score.write import check_out

            check_out(self.score)


@dataclass(frozen=True, eq=False)
class Work:
    """A picture, how it is looked at, and by what it is shown; the first choice makes OUT."""

    opened: AnyPicture
    looking: Looking
    gaze_px: tuple[float, float]
    choices: tuple[Choice, ...]
    seed: int

    @property
    def viewing(self) -> Viewing:
        """How it is looked at."""
        return self.looking.viewing

    def check_scorable(self) -> None:
        """Refuse before the work what the metrics cannot measure.

        Raises
        ------
        StudyError
            If the gaze lies off the picture, or what is scored is too small.
        """
        from stimuli.foveated.flat_view import scored_view

        geometry = self.looking.geometry
        if not (0 <= self.gaze_px[0] <= geometry.width_px
                and 0 <= self.gaze_px[1] <= geometry.height_px):  # fmt: skip
            raise StudyError("--score needs a gaze on the picture: FovVideoVDP knows no other")
        edge = min(geometry.width_px, geometry.height_px)
        if geometry.wraps:
            edge = scored_view((geometry.width_px, geometry.height_px)).width_px
        if edge < LEAST_SCORED_PX:
            raise StudyError(
                f"--score needs pictures of at least {LEAST_SCORED_PX} px an edge (has {edge})"
            )


@contextmanager
def renderer(console: Console, numpy_only: bool) -> Iterator[moderngl.Context | None]:
    """A context where there is OpenGL; without it numpy works, and it is said."""
    from pipeline.errors import GLUnavailableError
    from pipeline.gl.context import create_context, release_context

    if numpy_only:
        yield None
        return
    try:
        ctx = create_context()
    except GLUnavailableError:
        console.print(
            "note: no OpenGL 4.3 here ('metamerlab doctor' says why): numpy works instead"
        )
        yield None
        return
    try:
        yield ctx
    finally:
        release_context(ctx)


def run(console: Console, work: Work, outputs: Outputs, ctx: moderngl.Context | None) -> None:
    """Show the picture by every choice, and write what was asked for."""
    from stimuli import pictures
    from stimuli.foveated.look_through import look_through, sheet_of
    from stimuli.foveated.steps import write_steps

    shown, viewing, gaze_px = work.opened.colour, work.viewing, work.gaze_px
    state = outputs.out.with_name(f".{outputs.out.name}.state.npz")
    if state.exists():
        console.print(f"going on where {state} ends")
    with Console(stderr=True).status("working ...") as status:
        seen = look_through(
            shown, gaze_px, viewing, work.choices, seed=work.seed, ctx=ctx, state=state,
            report=status.update,
        )  # fmt: skip
    _say_where(console, seen, ctx)
    outputs.out.parent.mkdir(parents=True, exist_ok=True)
    _save(outputs.out, seen[0], work.opened.bits)
    console.print(f"wrote {outputs.out} ({seen[0].choice.label})")
    if outputs.compare is not None:
        outputs.compare.parent.mkdir(parents=True, exist_ok=True)
        pictures.save_picture(outputs.compare, sheet_of(shown, gaze_px, viewing, seen))
        console.print(f"wrote {outputs.compare} ({len(seen)} conditions)")
    if outputs.steps is not None:
        written = write_steps(outputs.steps, shown, gaze_px, viewing, seen[:1], seed=work.seed)
        console.print(f"wrote {len(written)} pictures to {outputs.steps}; begin with {written[-1]}")
    if outputs.score is not None:
        page = _score(work, seen, outputs.score, outputs.picture.stem)
        console.print(f"wrote {page}, and beside it CSV, JSON, Markdown tables and figures")
    if outputs.animate is not None:
        _animate(console, work, outputs.animate, outputs.size_px, ctx)
    if outputs.flip is not None:
        _flip(console, work, outputs.flip, outputs.size_px, ctx)


def _say_where(console: Console, seen: list[Seen], ctx: moderngl.Context | None) -> None:
    from pipeline.gl.context import describe

    if ctx is not None and any(one.on_gpu for one in seen):
        console.print(f"renderer: {describe(ctx)}")
    by_numpy = [one.choice.name for one in seen if not one.on_gpu]
    if by_numpy:
        console.print(f"worked out by numpy: {', '.join(by_numpy)}")


def _save(path: Path, one: Seen, bits: int) -> None:
    from stimuli.exr import save_colour

    if path.suffix.lower() == ".exr":
        save_colour(path, one.colour, bits=32 if bits == 16 else 16)
    else:
        save_colour(path, one.colour, bits=bits)


def _score(work: Work, seen: list[Seen], out: Path, name: str) -> Path:
    """Score what was seen; a panorama in the flat view around the gaze."""
    from pipeline.foveation.geometry import FlatGeometry
    from stimuli.exr import save_colour
    from stimuli.foveated.flat_view import around_gaze, scored_view
    from stimuli.foveated.looking import width_deg
    from stimuli.score.foveated import (
        PANORAMA_NOTE,
        score_conditions,
        seen_wide,
        subjects_of_conditions,
    )

    geometry, gaze_px = work.looking.geometry, work.gaze_px
    truth_colour = work.opened.colour
    notes: tuple[str, ...] = ()
    around = geometry.wraps
    if around:
        truth_colour, notes = around_gaze(truth_colour, gaze_px), (PANORAMA_NOTE,)
        geometry = scored_view((geometry.width_px, geometry.height_px))
    assert isinstance(geometry, FlatGeometry)
    folder = out / "pictures"
    folder.mkdir(parents=True, exist_ok=True)
    height, width = truth_colour.shape[:2]
    truth = folder / "picture.png"
    save_colour(truth, truth_colour, bits=work.opened.bits)
    tests = {}
    for one in seen:
        if one.choice.name == "reference" and len(seen) > 1:
            continue  # it is what the others are compared with
        path = folder / f"{one.choice.file_name}.png"
        colour = around_gaze(one.colour, gaze_px) if around else one.colour
        save_colour(path, colour, bits=work.opened.bits)
        tests[one.choice.label] = path
    subjects = subjects_of_conditions(name, truth, tests, (height, width), notes)
    viewing = seen_wide(width, height, width_deg(geometry))
    at = (width / 2, height / 2) if around else gaze_px
    with one_line() as say:
        return score_conditions(
            subjects, viewing, at, out, report=lambda done, total, what: say(what, done, total)
        )


def _animate(
    console: Console, work: Work, path: Path, size_px: int | None, ctx: moderngl.Context | None
) -> None:
    from stimuli.foveated import moving

    with _frames(path) as report:
        size = moving.wander(
            path, work.opened.colour, work.viewing, work.choices[0], seed=work.seed, ctx=ctx,
            report=report, longest_px=size_px or moving.LONGEST_PX,
        )  # fmt: skip
    console.print(f"wrote {path} ({size / 1000:.0f} kB)")


def _flip(
    console: Console, work: Work, path: Path, size_px: int | None, ctx: moderngl.Context | None
) -> None:
    from stimuli.foveated import moving

    with _frames(path) as report:
        size = moving.flip(
            path, work.opened.colour, work.gaze_px, work.viewing, work.choices[0],
            seeds=(work.seed, work.seed + 1), ctx=ctx, report=report,
            longest_px=size_px or 2 * moving.LONGEST_PX,
        )  # fmt: skip
    console.print(f"wrote {path} ({size / 1000:.0f} kB)")


@contextmanager
def _frames(path: Path) -> Iterator[Callable[[int, int], None]]:
    """Make the folder, and tell of each frame."""
    path.parent.mkdir(parents=True, exist_ok=True)
    with one_line() as say:
        yield lambda done, total: say("drawing frames", done, total)
