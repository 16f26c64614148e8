"""Noisy pictures to denoised files: `metamerlab denoise`."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

import moderngl
import numpy as np
from numpy.typing import NDArray

from pipeline.denoising.gpu import DenoisePass
from pipeline.denoising.maps import metamer_of
from pipeline.denoising.network import DenoisingNetwork, Kind, NetworkFacts, shipped_network
from pipeline.errors import InputError
from pipeline.foveation.geometry import Geometry
from pipeline.foveation.pooling import Pools
from pipeline.frame import check_seed
from pipeline.pictures import drawing
from pipeline.pictures.colour_file import PictureReading
from stimuli.media.frames_folder import SILENT, Reporter
from stimuli.media.gaze_and_display import StatedViewing, gaze_words, read_gaze
from stimuli.media.picture_files import PictureFiles, save_pictures

NETWORKS: tuple[Kind, ...] = ("moments", "rgb")
"""Networks that come with metamerlab, by name."""
ENDINGS = (".png", ".exr")
DENSITIES_ALIKE = 1.5
"""A picture with so many times the pixels per degree of the training pictures is remarked on."""

Colour = NDArray[np.float32]


def open_network(name: str) -> DenoisingNetwork:
    """Open a network of ours by its name, or one of a file.

    Raises
    ------
    InputError, FileNotFoundError, MissingExtraError
        As `DenoisingNetwork`.
    """
    for kind in NETWORKS:
        if name == kind:
            return DenoisingNetwork(shipped_network(kind))
    if not name.lower().endswith(".onnx"):
        raise InputError(
            f"--network must be {' or '.join(NETWORKS)}, which come with metamerlab, or an .onnx"
            f" file that 'metamerlab denoise train' of version 0.3 made (got {name!r})"
        )
    return DenoisingNetwork(Path(name))


class Denoiser:
    """Pictures of one size for one gaze, denoised by one network.

    Parameters
    ----------
    ctx : moderngl.Context, optional
        Synthesis runs on it; without one in numpy.
    """

    def __init__(
        self,
        network: DenoisingNetwork,
        geometry: Geometry,
        gaze_px: tuple[float, float],
        ctx: moderngl.Context | None = None,
    ) -> None:
        self._network = network
        self._pools = Pools(geometry, gaze_px, network.facts.pooling)
        self._passes: DenoisePass | None = None
        if ctx is not None and network.facts.kind == "moments":
            facts = network.facts
            self._passes = DenoisePass(ctx, geometry, facts.pooling, facts.levels)

    def __call__(self, noisy: Colour, seed: int = 0) -> Colour:
        """The metamer of the predicted moments, or the predicted colour: (H, W, 3)."""
        check_seed(seed)
        if self._network.facts.kind == "rgb":
            return self._network.colour(noisy, self._pools)
        maps = self._network.moments(noisy, self._pools)
        if self._passes is None:
            return metamer_of(maps, self._pools, seed)
        return self._passes.apply(maps, self._pools.gaze_px, seed=seed)

    def release(self) -> None:
        """Free what is held on the GPU."""
        if self._passes is not None:
            self._passes.release()


def denoise_file(
    source: Path,
    out: Path,
    *,
    viewing: StatedViewing,
    network: str = "moments",
    seed: int = 0,
    compare: Path | None = None,
    ctx: moderngl.Context | None = None,
    reporter: Reporter = SILENT,
) -> list[Path]:
    """Denoise a picture, or a folder of frames of one size.

    Parameters
    ----------
    out : Path
        A picture, .png or .exr; for a folder a folder, which is made.
    viewing : StatedViewing
        Its gaze must be given: where the eye looked when the picture was rendered.
    network : str
        ``moments``, ``rgb`` or an .onnx file.
    compare : Path, optional
        A sheet (.png) of one picture: noisy, by the network for colour, by this one.

    Raises
    ------
    InputError, StudyError, OSError
        Nothing is written then.
    """
    tell = reporter.say
    if viewing.gaze is None:
        raise InputError(
            "--gaze X,Y must be given: a picture with more samples where the eye looks is"
            " denoised for that gaze (the middle of a picture of 512 x 512 px is 256,256)"
        )
    check_seed(seed)
    clip, files = source.is_dir(), PictureFiles(source, "denoise", PictureReading(clip=True))
    _check_places(source, out, compare)
    names = files.names if clip else None
    first = files.first.colour
    reporter.note(files.first.notes)
    height, width = files.size
    looking = viewing.of(files.size)
    gaze_px = read_gaze(viewing.gaze, looking.geometry)
    chosen = open_network(network)
    tell(looking.words)
    tell(gaze_words(gaze_px, looking.geometry))
    tell(network_words(network, chosen.facts))
    reporter.note(_unlike_training(chosen.facts, looking.geometry))
    denoiser = Denoiser(chosen, looking.geometry, gaze_px, ctx)
    try:
        denoised: Iterable[Colour] = (denoiser(noisy.colour, seed) for noisy in files)
        if compare is not None:  # of one picture
            denoised = list(denoised)
            rival = DenoisingNetwork(shipped_network("rgb"))
            plain = Denoiser(rival, looking.geometry, gaze_px)(first)
            shown = [first, plain, *denoised]
            labels = ("noisy", "network for colour", network)
        written = save_pictures(out, names, ((one, None) for one in denoised), reporter)
    finally:
        denoiser.release()
    if compare is not None:
        tiles = [(label, drawing.of_colour(one)) for label, one in zip(labels, shown, strict=True)]
        drawing.save_picture(compare, drawing.sheet(tiles, columns=3))
        tell(f"wrote {compare}")
    what = f", seed {seed}" if chosen.facts.kind == "moments" else ""
    tell(f"wrote {out}: {len(written)} x {width} x {height} px{what}")
    return written


def _check_places(source: Path, out: Path, compare: Path | None) -> None:
    clip = source.is_dir()
    if compare is not None and clip:
        raise InputError("--compare takes one picture, not frames; give it a frame")
    if clip and out.suffix.lower() in ENDINGS:
        raise InputError(f"{source}: is a folder of frames: OUT must be a folder")
    if not clip and out.suffix.lower() not in ENDINGS:
        raise InputError(f"{out}: must end in {' or '.join(ENDINGS)}")
    for path in (out, compare):
        if path is not None and path.exists() and path.samefile(source):
            raise InputError(f"{path}: is what is to be denoised; write somewhere else")
    if compare is not None and compare.absolute() == out.absolute():
        raise InputError(f"{out}: OUT and --compare must be different files")


def network_words(name: str, facts: NetworkFacts) -> str:
    """Purpose of a network, in a line."""
    what = "a metamer from moments" if facts.kind == "moments" else "the picture's colour"
    scenes = facts.made.get("scenes")
    trained = f", trained on {', '.join(map(str, scenes))}" if isinstance(scenes, list) else ""
    return f"network {name}: {what}; pools {facts.pooling}{trained}"


def _unlike_training(facts: NetworkFacts, geometry: Geometry) -> list[str]:
    """Return notes where the network guesses: it knows pictures like those it was trained on."""
    middle = np.array(geometry.width_px / 2), np.array(geometry.height_px / 2)
    density = float(geometry.px_per_deg(*middle))
    trained = StatedViewing(fov_deg=facts.width_deg).of((facts.edge_px, facts.edge_px)).geometry
    known = float(trained.px_per_deg(np.array(facts.edge_px / 2), np.array(facts.edge_px / 2)))
    if max(density / known, known / density) <= DENSITIES_ALIKE:
        return []
    return [
        f"the network was trained on pictures of {known:.3g} px per degree, and this one has"
        f" {density:.3g}: its pools are of other sizes than the network knows"
    ]
