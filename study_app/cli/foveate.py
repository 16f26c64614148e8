"""`metamerlab foveate`: one picture, as a metamer or a rival shows it to a gaze."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich.console import Console
from rich.table import Table

from protocols.errors import StudyError
from study_app.cli.errors import user_errors
from study_app.cli.one_picture import check_file, check_folder, read_parameters
from study_app.cli.progress import one_line
from study_app.cli.terminal import PlainConsole

if TYPE_CHECKING:
    import moderngl

    from stimuli.foveated.any_picture import AnyPicture
    from stimuli.foveated.look_through import Choice, Seen
    from stimuli.foveated.looking import Looking

DEFAULT_METHOD = "metamer"
_LOOK = "To look at"
_FILE = "The file"


@dataclass(frozen=True)
class _Outputs:
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
        check_file(self.out, (".png", ".exr"))
        if self.compare is not None:
            check_file(self.compare, (".png",))
        for path in (self.animate, self.flip):
            if path is not None:
                check_file(path, (".webp", ".png", ".apng"))
        for folder in (self.steps, self.score):
            if folder is not None:
                check_folder(folder)
        if self.score is not None:
            from stimuli.score.write import check_out

            check_out(self.score)
        files = [p.absolute() for p in (self.out, self.compare, self.animate, self.flip) if p]
        if len(set(files)) < len(files):
            raise StudyError("OUT, --compare, --animate and --flip must be different files")


def _print_methods(asked: bool) -> None:
    if not asked:
        return
    from pipeline.foveation.conditions import CONDITIONS, condition_parameters
    from pipeline.foveation.pooling import LAWS, PRESETS

    table = Table("method", "what it is", "parameters (default)", box=None)
    for entry in CONDITIONS:
        probe = f"{entry.name}x" if entry.takes_path else entry.name
        known = condition_parameters(probe)
        shown = ", ".join(k if v is None else f"{k} ({v})" for k, v in known.items())
        table.add_row(entry.shown_name, entry.summary, shown or "-")
    console = PlainConsole()
    console.print(table)
    laws = Table("law", "how wide the eye pools", "parameter (default)", box=None)
    for name, (law, constant) in PRESETS.items():
        laws.add_row(name, f"law {law}, {LAWS[law][0]} {constant:g}", "-")
    for name, (parameter, default, what) in LAWS.items():
        laws.add_row(name, what, f"{parameter} ({default:g})")
    console.print()
    console.print(laws)
    console.print(
        "Without law, scaling, alpha and rate: law v1; the enhanced blurs have rate 1.40.",
        soft_wrap=True,
    )
    raise typer.Exit


def foveate(
    picture: Annotated[
        Path,
        typer.Argument(
            help="A picture: PNG, JPEG, TIFF, OpenEXR, Radiance, ...", show_default=False
        ),
    ],
    out: Annotated[
        Path, typer.Argument(help="The picture to write, .png or .exr; replaced if there.")
    ] = Path("foveated.png"),
    gaze: Annotated[
        str | None,
        typer.Option(
            metavar="X,Y",
            help="Where the eye looks: pixels from the upper left corner (512,384), or degrees"
            r" right of and below the middle (5deg,-3deg). \[default: the middle]",
            show_default=False,
        ),
    ] = None,
    display: Annotated[
        str | None,
        typer.Option(
            help="The screen it is seen on, pixel for pixel: a shipped display's name or a .toml"
            " file.",
            show_default=False,
        ),
    ] = None,
    fov: Annotated[
        float | None,
        typer.Option(
            metavar="DEG",
            help="Visual angle of the picture's width, instead of a display."
            r" \[default: 40, and it is said]",
            show_default=False,
        ),
    ] = None,
    panorama: Annotated[
        bool, typer.Option("--panorama", help="It is equirectangular, 2:1, all around.")
    ] = False,
    methods: Annotated[
        list[str] | None,
        typer.Option(
            "--method",
            "-m",
            help="Condition; the first one makes OUT. May be given more than once for"
            rf" --compare. \[default: {DEFAULT_METHOD}]",
            show_default=False,
        ),
    ] = None,
    settings: Annotated[
        list[str] | None,
        typer.Option(
            "--parameter",
            "--set",
            help="A parameter of the one method, as name=value.",
            metavar="P=V",
        ),
    ] = None,
    seed: Annotated[
        int, typer.Option(help="Of noise and displacement; same seed, same picture.", min=0)
    ] = 0,
    _list: Annotated[
        bool,
        typer.Option(
            "--list",
            help="List the conditions, their parameters and the pooling laws, then stop.",
            callback=_print_methods,
            is_eager=True,
        ),
    ] = False,
    numpy_only: Annotated[
        bool, typer.Option("--numpy", help="Work by the numpy reference, also where OpenGL is.")
    ] = False,
    stops: Annotated[
        float,
        typer.Option(
            help="Make light brighter (or darker, below 0) by this many stops.",
            rich_help_panel=_FILE,
        ),
    ] = 0.0,
    clip: Annotated[
        bool,
        typer.Option(
            "--clip",
            help="Clip light that a display cannot show instead of refusing it.",
            rich_help_panel=_FILE,
        ),
    ] = False,
    encoded: Annotated[
        bool,
        typer.Option(
            "--encoded",
            help="A file of floats holds display-referred colour, not scene-linear light.",
            rich_help_panel=_FILE,
        ),
    ] = False,
    background: Annotated[
        float,
        typer.Option(
            min=0.0, max=1.0, help="Grey behind transparent pixels.", rich_help_panel=_FILE
        ),
    ] = 0.5,
    compare: Annotated[
        Path | None,
        typer.Option(
            help="One labelled sheet: the picture with its pools drawn in, and all conditions"
            " (or those of --method).",
            rich_help_panel=_LOOK,
        ),
    ] = None,
    steps: Annotated[
        Path | None,
        typer.Option(
            help="Folder for pictures of every step: pools, level of detail, base, noise,"
            " displacement; sheet.png shows them all.",
            rich_help_panel=_LOOK,
        ),
    ] = None,
    score: Annotated[
        Path | None,
        typer.Option(
            help="Folder for scores: statistics, bands by eccentricity, FovVideoVDP and"
            " ColorVideoVDP (where installed), each beside what it is blind to; one page.",
            rich_help_panel=_LOOK,
        ),
    ] = None,
    animate: Annotated[
        Path | None,
        typer.Option(
            help="Moving picture (.webp, or .png for APNG) in which the gaze wanders.",
            rich_help_panel=_LOOK,
        ),
    ] = None,
    flip: Annotated[
        Path | None,
        typer.Option(
            help="Moving picture that flips between this seed and the next one.",
            rich_help_panel=_LOOK,
        ),
    ] = None,
    size_px: Annotated[
        int | None,
        typer.Option(
            min=64,
            max=4096,
            help=r"Longer edge of the moving pictures. \[default: 480, --flip 960]",
            show_default=False,
            rich_help_panel=_LOOK,
        ),
    ] = None,
) -> None:
    """Show one picture to a gaze: a metamer of the periphery, or what it is compared with.

    In the fovea, one degree around the gaze unless told otherwise, nothing changes.
    energy-metamer takes minutes: interrupted, the same command goes on where it was.

    Examples:

        metamerlab foveate photo.jpg out.png

        metamerlab foveate photo.jpg out.png --gaze 5deg,-3deg --display fhd27-60hz

        metamerlab foveate photo.jpg out.png -m warped-metamer --steps steps/

        metamerlab foveate photo.jpg --compare sheet.png --animate gaze.webp

        metamerlab foveate photo.jpg --score scores/

        metamerlab foveate around.exr out.png --panorama --clip
    """
    from pipeline.foveation.noise_plane import check_seed
    from stimuli.foveated.any_picture import Reading, read_any
    from stimuli.foveated.look_through import check_choices
    from stimuli.foveated.looking import gaze_words, look_at, read_gaze

    with user_errors():
        choices = _choices(methods, settings, compare is not None or score is not None)
        outputs = _Outputs(picture, out, compare, steps, animate, flip, size_px, score)
        outputs.check()
        check_choices(choices)
        check_seed(seed)
        opened = read_any(picture, Reading(background, clip, stops, encoded))
        height, width = opened.colour.shape[:2]
        looking = look_at((height, width), display=display, fov_deg=fov, panorama=panorama)
        gaze_px = read_gaze(gaze, looking.geometry)
        if score is not None:
            _check_scorable(looking, gaze_px)
        console = PlainConsole(soft_wrap=True)
        console.print(f"{width} x {height} px")
        for line in (looking.words, gaze_words(gaze_px, looking.geometry)):
            console.print(line)
        for note in (*opened.notes, *looking.notes):
            console.print(f"note: {note}")
        with _renderer(console, numpy_only) as ctx:
            _run(console, opened, looking, gaze_px, choices, seed, outputs, ctx)


def _run(
    console: Console,
    opened: AnyPicture,
    looking: Looking,
    gaze_px: tuple[float, float],
    choices: list[Choice],
    seed: int,
    outputs: _Outputs,
    ctx: moderngl.Context | None,
) -> None:
    from stimuli import pictures
    from stimuli.foveated import moving
    from stimuli.foveated.look_through import look_through, sheet_of
    from stimuli.foveated.steps import write_steps

    shown, viewing = opened.colour, looking.viewing
    outputs.out.parent.mkdir(parents=True, exist_ok=True)
    state = outputs.out.with_name(f".{outputs.out.name}.state.npz")
    if state.exists():
        console.print(f"going on where {state} ends")
    with PlainConsole(stderr=True).status("working ...") as status:
        seen = look_through(
            shown, gaze_px, viewing, choices, seed=seed, ctx=ctx, state=state, report=status.update
        )
    _say_where(console, seen, ctx)
    _save(outputs.out, seen[0], opened.bits)
    console.print(f"wrote {outputs.out} ({seen[0].choice.label})")
    if outputs.compare is not None:
        outputs.compare.parent.mkdir(parents=True, exist_ok=True)
        pictures.save_picture(outputs.compare, sheet_of(shown, gaze_px, viewing, seen))
        console.print(f"wrote {outputs.compare} ({len(seen)} conditions)")
    if outputs.steps is not None:
        written = write_steps(outputs.steps, shown, gaze_px, viewing, seen[:1], seed=seed)
        console.print(f"wrote {len(written)} pictures to {outputs.steps}; begin with {written[-1]}")
    if outputs.score is not None:
        page = _score(opened, looking, gaze_px, seen, outputs)
        console.print(f"wrote {page}, and beside it CSV, JSON, Markdown tables and figures")
    for path, kind in ((outputs.animate, "animate"), (outputs.flip, "flip")):
        if path is None:
            continue
        path.parent.mkdir(parents=True, exist_ok=True)
        with one_line() as say:

            def report(done: int, total: int, say=say) -> None:  # type: ignore[no-untyped-def]
                say("drawing frames", done, total)

            if kind == "animate":
                size = moving.wander(
                    path, shown, viewing, choices[0], seed=seed, ctx=ctx, report=report,
                    longest_px=outputs.size_px or moving.LONGEST_PX,
                )  # fmt: skip
            else:
                size = moving.flip(
                    path, shown, gaze_px, viewing, choices[0], seeds=(seed, seed + 1), ctx=ctx,
                    report=report, longest_px=outputs.size_px or 2 * moving.LONGEST_PX,
                )  # fmt: skip
        console.print(f"wrote {path} ({size / 1000:.0f} kB)")


def _check_scorable(looking: Looking, gaze_px: tuple[float, float]) -> None:
    """Refuse before the work what the metrics cannot measure."""
    geometry = looking.geometry
    if geometry.wraps:
        raise StudyError("--score is for flat pictures: no metric here knows panoramas")
    if not (0 <= gaze_px[0] <= geometry.width_px and 0 <= gaze_px[1] <= geometry.height_px):
        raise StudyError("--score needs a gaze on the picture: FovVideoVDP knows no other")
    if min(geometry.width_px, geometry.height_px) < 32:
        raise StudyError("--score needs pictures of at least 32 px an edge")


def _score(
    opened: AnyPicture,
    looking: Looking,
    gaze_px: tuple[float, float],
    seen: list[Seen],
    outputs: _Outputs,
) -> Path:
    from pipeline.foveation.geometry import FlatGeometry
    from stimuli.exr import save_colour
    from stimuli.foveated.looking import width_deg
    from stimuli.score.foveated import score_conditions, seen_wide, subjects_of_conditions

    if outputs.score is None or not isinstance(looking.geometry, FlatGeometry):
        raise AssertionError("checked before")
    folder = outputs.score / "pictures"
    folder.mkdir(parents=True, exist_ok=True)
    height, width = opened.colour.shape[:2]
    truth = folder / "picture.png"
    save_colour(truth, opened.colour, bits=opened.bits)
    tests = {}
    for one in seen:
        if one.choice.name == "reference" and len(seen) > 1:
            continue  # it is what the others are compared with
        path = folder / f"{one.choice.file_name}.png"
        save_colour(path, one.colour, bits=opened.bits)
        tests[one.choice.label] = path
    subjects = subjects_of_conditions(outputs.picture.stem, truth, tests, (height, width))
    viewing = seen_wide(width, height, width_deg(looking.geometry))
    with one_line() as say:
        return score_conditions(
            subjects, viewing, gaze_px, outputs.score,
            report=lambda done, total, what: say(what, done, total),
        )  # fmt: skip


@contextmanager
def _renderer(console: Console, numpy_only: bool) -> Iterator[moderngl.Context | None]:
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


def _choices(methods: list[str] | None, settings: list[str] | None, compare: bool) -> list[Choice]:
    from pipeline.foveation.conditions import check_condition_name
    from stimuli.foveated.look_through import Choice, usual_choices

    if not methods:
        every = [choice.name for choice in usual_choices()]
        methods = sorted(every, key=lambda name: name != DEFAULT_METHOD)  # it makes OUT
        methods = methods if compare else [DEFAULT_METHOD]
    for name in methods:
        check_condition_name(name)
    if len(methods) > 1 and not compare:
        raise StudyError(
            f"one --method makes one OUT (got {len(methods)}); add --compare FILE or --score FOLDER"
            " to see them all"
        )
    parameters = read_parameters(settings or [], methods)
    return [Choice(name, parameters) for name in methods]
