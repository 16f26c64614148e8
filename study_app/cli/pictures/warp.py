"""`metamerlab warp`: one picture, warped and filled by any method."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich.console import Console

from protocols.disk.result_folder import check_result
from protocols.errors import StudyError
from study_app.cli.pictures.one_picture_options import (
    FILE_ENDINGS,
    SeedOption,
    SettingsOption,
    check_outputs,
    choose_methods,
    list_option,
    method_option,
    print_methods,
    renderer,
)
from study_app.cli.pictures.warp_options import (
    EyeOptions,
    HoleOptions,
    SourceOptions,
    WarpFigureOptions,
)
from study_app.cli.terminal import PlainConsole, say, table_of

if TYPE_CHECKING:
    from pipeline.foveation.two_rates import TwoRates
    from pipeline.frame import WarpedFrame
    from pipeline.named_classes import Choice
    from pipeline.quality import Quality
    from stimuli.warp.one_frame import FillResult
    from study_app.cli.pictures.warp_source import LoadedSource

DEFAULT_METHOD = "metameric"
_SOURCE_HELP = (
    "A file of colour, depth and flow (.exr); a picture with motion (--flow) or with depth and"
    " two poses (--depth); an image of a stereo pair (with --disparity); a panorama with distance"
    " (--panorama); any picture with a mask of its holes (--mask); or a built-in pair: motorcycle."
)


def _print_methods(console: Console) -> None:
    from pipeline.methods.registry import METHODS, method_parameters

    print_methods(console, METHODS, method_parameters)


@dataclass(frozen=True)
class MethodOptions:
    """Methods, their parameters, and the seed."""

    methods: Annotated[list[str] | None, method_option("Fill method", DEFAULT_METHOD)] = None
    settings: SettingsOption = None
    _list: Annotated[bool, list_option("the methods and their parameters", _print_methods)] = False
    seed: SeedOption = 0


def warp(
    source: Annotated[str, typer.Argument(help=_SOURCE_HELP)],
    out: Annotated[
        Path | None,
        typer.Argument(
            help="The filled picture to write, .png or .exr; replaced if there."
            r" \[default: filled.png; none where anything else is asked for]"
        ),
    ] = None,
    *,
    method: MethodOptions,
    holes: HoleOptions,
    given: SourceOptions,
    eye: EyeOptions,
    looks: WarpFigureOptions,
) -> None:
    """Warp one picture and fill its holes.

    Holes are pixels that the new view shows and the old one did not see.
    If the true view is known (--truth, --right, builtin:SCENE), the fill is measured inside them.

    Examples:

        metamerlab warp motorcycle filled.png --methods telea

        metamerlab warp frame.exr filled.png --steps steps/

        metamerlab warp motorcycle --compare sheet.png

        metamerlab warp motorcycle --true-within 5 --gaze 300,250 -m metameric -m push-pull
        --coarser 2 --compare sheet.png

        metamerlab warp left.png out.png --disparity disp.png --units-per-px 4

        metamerlab warp photo.png out.png --depth depth.png

        metamerlab warp photo.png out.png --mask holes.png

        metamerlab warp photo.png out.png --depth depth.png -m coherence-transport
        --set fovea_deg=5 --gaze 300,250

        metamerlab warp around.exr out.png --panorama --move 0.2,0,-0.1 --look 90,-30
        --around moved.png

        metamerlab warp builtin:street --panorama --move 0.2,0,0 --compare sheet.png

        metamerlab warp frame10.png out.png --flow flow10.flo --truth frame11.png

        metamerlab warp 1.png out.png --depth 1.pgm --depth-scale 0.001
        --camera 518,519,325.5,253.5 --pose pose.txt:1 --target-pose pose.txt:2
    """
    from pipeline.warp.settings import WarpSettings
    from study_app.cli.pictures.warp_source import load

    if given.mask is not None and holes != HoleOptions():
        raise StudyError("--mask says what is hole: leave out --rim-px and --depth-speckle")
    WarpSettings(rim_px=holes.rim_px or 0)  # checks its range before anything is read
    given = given.with_unknown()
    choices = _choices(method.methods, method.settings, looks.compare is not None)
    others = looks.compare, looks.steps, given.panorama.around
    if out is None and not any(others):
        out = Path("filled.png")
    check_outputs(
        {
            "OUT": (out, FILE_ENDINGS),
            "--around": (given.panorama.around, FILE_ENDINGS),
            "--compare": (looks.compare, (".png",)),
        },
        [looks.steps],
        [Path(source), *given.files],
    )
    if looks.steps is not None:
        check_result(looks.steps, replace=True)
    loaded = load(source, given)
    asked = {name: value for name, value in vars(holes).items() if value is not None}
    loaded = replace(loaded, settings=replace(loaded.settings, **asked))
    choices, seen = _look(choices, loaded, eye)
    _run(loaded, choices, method.seed, out, looks, seen)
    if given.panorama.around is not None:
        _write_around(given.panorama.around, loaded, choices[0], method.seed)


def _run(
    loaded: LoadedSource,
    choices: list[Choice],
    seed: int,
    out: Path | None,
    looks: WarpFigureOptions,
    seen: Callable[..., TwoRates] | None,
) -> None:
    from pipeline.gl.context import describe
    from pipeline.pictures import drawing
    from pipeline.pictures.colour_file import save_colour
    from pipeline.warp.speckle import mends
    from stimuli.warp.one_frame import comparison, warp_and_fill
    from stimuli.warp.upsampled import periphery, upsampled, upsampled_sheet
    from stimuli.warp.warp_steps import write_warp_steps

    compare, steps = looks.compare, looks.steps
    frame, settings, truth = loaded.frame, loaded.settings, loaded.truth
    console = PlainConsole(soft_wrap=True)
    with renderer(console, False) as ctx:
        if ctx is not None:
            console.print(f"renderer: {describe(ctx)}")
        rates = None if seen is None else seen(seed=seed, ctx=ctx)
        with console.status("warping and filling ..."):
            warped, fills = warp_and_fill(
                ctx, frame, choices, seed=seed, settings=settings, truth=truth,
                truth_mask=None if rates is None else periphery(rates), hole=loaded.hole,
            )  # fmt: skip
        plain = fills
        if rates is not None and truth is not None:
            fills = upsampled(fills, truth, rates)
            rates.release()
    mended = len(mends(frame.source)[0]) if settings.depth_speckle else 0
    _print_results(console, warped, plain, settings.rim_px, mended, rates is not None)
    if out is not None:
        out.parent.mkdir(parents=True, exist_ok=True)
        save_colour(out, fills[0].colour)
        console.print(f"wrote {out} ({fills[0].choice.label})")
    if compare is not None:
        compare.parent.mkdir(parents=True, exist_ok=True)
        if rates is not None and truth is not None:
            sheet = upsampled_sheet(warped, fills, truth, rates)
        else:
            sheet = comparison(warped, fills, truth)
        drawing.save_picture(compare, sheet)
        console.print(f"wrote {compare} ({len(fills)} methods)")
    if steps is not None:
        with console.status("writing every step ..."):
            written = write_warp_steps(steps, frame, warped, plain, seed=seed, truth=truth)
        console.print(f"wrote {len(written)} pictures to {steps}; begin with {written[-1]}")


def _write_around(path: Path, loaded: LoadedSource, choice: Choice, seed: int) -> None:
    """Write the whole panorama from the moved eye."""
    from pipeline.methods.moved_panorama import move_panorama
    from pipeline.pictures.colour_file import save_colour

    assert loaded.around is not None
    console = PlainConsole(soft_wrap=True)
    with renderer(console, False) as ctx, console.status("filling all around ..."):
        colour = move_panorama(
            loaded.around, loaded.move_m, choice.name, seed=seed, settings=loaded.settings,
            ctx=ctx, **choice.parameters,
        )  # fmt: skip
    path.parent.mkdir(parents=True, exist_ok=True)
    save_colour(path, colour)
    height, width = colour.shape[:2]
    console.print(f"wrote {path} ({choice.label}, {width} x {height} px)")


def _choices(methods: list[str] | None, settings: list[str] | None, compare: bool) -> list[Choice]:
    from pipeline.methods.registry import METHODS, check_method, method_parameters
    from pipeline.named_classes import Choice

    every = [entry.name for entry in METHODS if not entry.takes_path]
    chosen = choose_methods(
        methods, settings, every=every, default=DEFAULT_METHOD, known=method_parameters,
        sheet=compare,
    )  # fmt: skip
    for name, parameters in chosen:
        check_method(name, parameters)
    return [Choice(name, parameters) for name, parameters in chosen]


def _look(
    choices: list[Choice], loaded: LoadedSource, eye: EyeOptions
) -> tuple[list[Choice], Callable[..., TwoRates] | None]:
    """Tell the methods that fill by eccentricity where somebody looks, and the true view."""
    from pipeline.foveation.geometry import FlatGeometry
    from pipeline.foveation.two_rates import TwoRates
    from stimuli.media.gaze_and_display import StatedViewing, gaze_words, read_gaze, width_deg

    if eye.true_within is None and (eye.coarser, eye.condition) != (1, "reference"):
        raise StudyError(
            "--coarser and --condition say what lies around the true view: give --true-within DEG"
        )
    by_gaze = any(choice.parameters.get("fovea_deg") for choice in choices)
    if eye.true_within is None and not by_gaze:
        for name, given in (("--gaze", eye.gaze), ("--display", eye.display), ("--fov", eye.fov)):
            if given is not None:
                raise StudyError(
                    f"{name} says where the true view is shown, or where coherence-transport works:"
                    " give --true-within DEG, or -m coherence-transport --set fovea_deg=DEG"
                )
        return choices, None
    if eye.true_within is not None and loaded.truth is None:
        raise StudyError(
            "--true-within needs the true view: give --truth, or --right with a stereo pair"
        )
    height, width = loaded.frame.size
    fov_deg = loaded.view_deg if eye.fov is None and eye.display is None else eye.fov
    looking = StatedViewing(display=eye.display, fov_deg=fov_deg).of((height, width))
    geometry = looking.geometry
    assert isinstance(geometry, FlatGeometry)
    say(looking.words)
    gaze_px = read_gaze(eye.gaze, geometry)
    if by_gaze:
        say(gaze_words(gaze_px, geometry))
        across, down = (round(angle, 4) for angle in geometry.angles_deg(gaze_px))
        told = {"gaze_x_deg": across, "gaze_y_deg": down, "width_deg": width_deg(geometry)}
        twice = sorted(told.keys() & choices[0].parameters)
        if twice:
            raise StudyError(
                f"--gaze, --display and --fov say {twice[0]}: use them, and leave it out of --set"
            )
        choices = [replace(one, parameters={**one.parameters, **told}) for one in choices]
    if eye.true_within is None:
        return choices, None
    return choices, partial(
        TwoRates, geometry, gaze_px, eye.true_within, coarser=eye.coarser, condition=eye.condition
    )


def _print_results(
    console: Console, warped: WarpedFrame, fills: list[FillResult], rim_px: int, mended: int,
    outside: bool,
) -> None:  # fmt: skip
    height, width = warped.size
    holes = f"holes {100 * warped.hole.mean():.2f} % of the frame"
    if rim_px > 0:
        holes += f", with a rim of {rim_px} px"
    if mended > 0:
        holes += f"; depth mended: {mended} px"
    console.print(f"{width} x {height} px, {holes}")
    every = [(fill.choice, fill.quality_all) for fill in fills]
    if outside:
        _print_quality(console, "inside holes where nothing of the true view is shown", every)
        return
    _print_quality(console, "inside the holes that do not touch the border",
                   [(fill.choice, fill.quality) for fill in fills])  # fmt: skip
    _print_quality(console, "inside all holes", every)


def _print_quality(
    console: Console, title: str, found: list[tuple[Choice, Quality | None]]
) -> None:
    if not any(quality for _, quality in found):
        return
    heads = ("method", "PSNR dB", "SSIM", "high-frequency ratio", "band error")
    rows = [
        (
            choice.label,
            f"{quality.psnr_db:.2f}",
            f"{quality.ssim:.3f}",
            f"{quality.high_frequency_ratio:.2f}",
            f"{quality.band_error:.3f}",
        )
        for choice, quality in found
        if quality is not None
    ]
    console.print(table_of(heads, rows, right=1, title=title, title_justify="left", box=None))
