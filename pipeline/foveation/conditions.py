"""Every condition under a name, and `foveate`: one call for stills, panoramas, pairs and clips.

To add a condition, write its class (in catalogue.py, or a module of its own) and add one line to
`CONDITIONS`.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, cast

import numpy as np
from numpy.typing import NDArray

from pipeline.errors import InputError
from pipeline.foveation.catalogue import Condition
from pipeline.foveation.geometry import Flat, Geometry, Viewing
from pipeline.foveation.panorama import by_charts
from pipeline.foveation.picture_fixation import (
    Colour,
    PictureFixation,
    check_held,
    check_picture_size,
    float_picture,
)
from pipeline.named_classes import NamedClass, check_given, defaults_of, find
from pipeline.pictures.decode import as_floats

if TYPE_CHECKING:
    import moderngl

    from pipeline.foveation.gpu import FoveationPass


_CATALOGUE = "pipeline.foveation.catalogue"
CONDITIONS = tuple(
    NamedClass(name, summary, target if ":" in target else f"{_CATALOGUE}:{target}", *path)
    for name, summary, target, *path in (
        ("reference", "the picture itself", "Reference"),
        ("blur", "each pixel is the mean of its pool", "Blur"),
        ("metamer", "noise with each pool's moments (Walton et al. 2021)", "Metamer"),
        ("noise-enhanced", "a blur and noise (Tariq et al. 2022)", "NoiseEnhanced"),
        ("contrast-enhanced", "a blur, contrast restored (Patney et al. 2016)", "ContrastEnhanced"),
        ("eidolon", "displaced at random (Koenderink et al. 2017)", "Eidolon"),
        ("warped-metamer", "displaced, with each pool's moments", "WarpedMetamer"),
        (
            "energy-metamer",
            "pooled energies matched by descent (torch, minutes)",
            "pipeline.foveation.energy:EnergyMetamer",
        ),
        ("files:", "pictures made elsewhere", "FilesOnDisk", "FOLDER"),
    )
)


def condition_names() -> list[str]:
    """Return every condition's name as a user writes it."""
    return [entry.shown_name for entry in CONDITIONS]


def check_condition_name(name: str) -> NamedClass:
    """Return the entry that `name` means; nothing of the condition is imported.

    Raises
    ------
    InputError
        If there is no such condition, with the nearest name; or if its path is missing.
    """
    return find(CONDITIONS, name)


def condition_parameters(name: str) -> dict[str, Any]:
    """Return the parameters of the condition `name` with their defaults.

    Raises
    ------
    InputError
        If there is no such condition, with the nearest name.
    """
    return defaults_of(check_condition_name(name).load())


LIVE = ("reference", "blur", "metamer", "eidolon", "warped-metamer")
"""The conditions that passes draw, and the picture itself: the others take longer than a frame."""


def check_live(name: str, parameters: Mapping[str, Any]) -> None:
    """Refuse a condition that cannot be drawn frame by frame.

    Raises
    ------
    InputError
        Naming those that can.
    """
    if name not in LIVE or parameters.get("chroma") == "full":
        raise InputError(
            "a live picture must be one that the GPU draws; the method must be one of"
            f" {', '.join(LIVE)}, and metamers have chroma follow or luma (got {name}"
            + "".join(f", {key} {value}" for key, value in parameters.items())
            + ")"
        )


def create_condition(name: str, parameters: Mapping[str, Any] | None = None) -> Condition:
    """Make the condition called `name`.

    Parameters
    ----------
    name : str
        One of `condition_names`; ``FOLDER`` stands for a path.
    parameters : mapping, optional
        Of `condition_parameters`; the rest keep their defaults.

    Raises
    ------
    InputError
        If the condition or a parameter is unknown (with the nearest name), or a value is of
        another type or out of range.
    """
    entry = check_condition_name(name)
    kind = entry.load()
    check_given(name, kind, parameters or {})
    return cast(Condition, kind(*entry.path_in(name), **(parameters or {})))


def foveate(
    picture: NDArray[np.floating],
    gaze_px: tuple[float, float],
    *,
    viewing: Viewing | None = None,
    method: str = "metamer",
    seed: int = 0,
    noise_shift_px: NDArray[np.floating] | None = None,
    field_gaze_px: tuple[float, float] | None = None,
    ctx: moderngl.Context | None = None,
    **parameters: Any,
) -> Colour:
    """Show a picture to an eye that looks at `gaze_px`.

    Parameters
    ----------
    picture : ndarray of shape (H, W, 3)
        Encoded R'G'B' in [0, 1], any floating type, any size from 1x1.
    gaze_px : (x, y)
        Pixels from the upper left corner, x right, y down; also off the picture.
    viewing : Flat or Equirectangular, optional
        How it is looked at; by default flat and 40 degrees wide. A panorama goes on at its other
        side, without a seam.
    method : str
        One of `condition_names`.
    seed : int
        Of noise or displacement, from 0 to 2**63 - 1. Both pictures of a stereo pair, and all
        frames of a clip, share one.
    noise_shift_px : ndarray of shape (H, W, 2), optional
        How far the surface at each pixel has moved since noise was laid on it. By default noise
        stays on the screen. For the second picture of a pair give each pixel's disparity (its x in
        this picture less its x in the other) and 0, for a clip what `carried` returns.
    field_gaze_px : (x, y), optional
        The gaze that displacements follow, by default `gaze_px`; for a live gaze what `SteadyGaze`
        says, so that nothing swims.
    ctx : moderngl.Context, optional
        Work on the GPU, where the condition can; without it numpy does.
    **parameters
        Of the method; see `condition_parameters`.

    Returns
    -------
    ndarray of float32, shape (H, W, 3)
        In [0, 1]. Up to `fovea_deg` around the gaze it is the picture, bit for bit.

    Raises
    ------
    InputError
        Naming what must hold and what was found.

    Notes
    -----
    For many pictures of one size, such as the frames of a clip, build a `Foveator` once.
    """
    image = float_picture(picture)
    foveator = Foveator(
        image.shape[:2], viewing=viewing, method=method, seed=seed, ctx=ctx, **parameters
    )
    try:
        foveator.hold(image)
        return foveator.show(
            gaze_px,
            seed=seed,
            noise_shift_px=noise_shift_px,
            field_gaze_px=field_gaze_px,
            last=True,
        )
    finally:
        foveator.release()


class Foveator:
    """One condition for pictures of one size: what `foveate` builds anew for each call.

    `hold` a picture once and `show` it to many gazes, or call it with picture and gaze.

    Parameters
    ----------
    size : (height, width)
        Of the pictures.
    viewing, method, ctx, parameters
        See `foveate`.
    seed : int, optional
        Of the first fixation: its noise is made before the passes take their memory.

    Attributes
    ----------
    passes : FoveationPass or None
        With a context, for conditions that run on the GPU: takes and returns textures.
    """

    def __init__(
        self,
        size: tuple[int, int],
        *,
        viewing: Viewing | None = None,
        method: str = "metamer",
        seed: int | None = None,
        ctx: moderngl.Context | None = None,
        **parameters: Any,
    ) -> None:
        self.method = method
        height, width = check_picture_size(size)
        self.geometry: Geometry = (viewing or Flat()).of(width, height)
        self.condition = create_condition(method, parameters)
        self._holds = False
        self._image: Colour | NDArray[np.uint8] | None = None  # for numpy
        self.passes: FoveationPass | None = None
        if ctx is not None:
            self.passes = self._passes(ctx, seed)

    def __call__(
        self,
        picture: NDArray[np.floating],
        gaze_px: tuple[float, float],
        *,
        seed: int = 0,
        frame: int = 0,
        noise_shift_px: NDArray[np.floating] | None = None,
        field_gaze_px: tuple[float, float] | None = None,
    ) -> Colour:
        """Show one picture; see `foveate`."""
        self._hold(float_picture(picture))
        return self.show(
            gaze_px,
            seed=seed,
            frame=frame,
            noise_shift_px=noise_shift_px,
            field_gaze_px=field_gaze_px,
        )

    def hold(self, picture: NDArray[np.floating] | NDArray[np.uint8]) -> None:
        """Analyse a picture once, to `show` it to any number of gazes.

        Parameters
        ----------
        picture : ndarray of shape (H, W, 3)
            Encoded R'G'B' in [0, 1], or of 8 bits; on the GPU the latter are not converted. It is
            copied: changing it later changes nothing that is shown.

        Raises
        ------
        InputError
            If it is no picture, or of another size.
        """
        self._hold(check_held(picture))

    def show(
        self,
        gaze_px: tuple[float, float],
        *,
        seed: int = 0,
        frame: int = 0,
        noise_shift_px: NDArray[np.floating] | None = None,
        field_gaze_px: tuple[float, float] | None = None,
        last: bool = False,
    ) -> Colour:
        """Show the picture that is held, bit for bit as a call with it would; see `foveate`.

        The `last` time, all that is held on the GPU is freed before the picture is read back.

        Raises
        ------
        InputError
            If none is held, or as `foveate`.
        """
        if not self._holds:
            raise InputError("a foveator must hold a picture before it shows one: hold(picture)")
        fixation = PictureFixation(
            self.geometry, gaze_px, seed, frame, noise_shift_px, field_gaze_px
        )
        if self.passes is not None and (self.passes.carries_noise or noise_shift_px is None):
            passes = self.passes
            if last:
                self.passes, self._holds = None, False
            return passes.shown(fixation, last=last)
        assert self._image is not None
        image = as_floats(self._image)
        if self.geometry.wraps and self.condition.on_charts:
            return by_charts(self.condition, image, fixation)
        return self.condition.apply(image, fixation)

    def _hold(self, image: Colour | NDArray[np.uint8]) -> None:
        size = (self.geometry.height_px, self.geometry.width_px)
        if image.shape[:2] != size:
            raise InputError(
                f"picture must be {size[1]} x {size[0]} px, as this foveator was built"
                f" (got {image.shape[1]} x {image.shape[0]})"
            )
        if self.passes is not None:
            self.passes.upload(image)
        if self.passes is None or not self.passes.carries_noise:
            self._image = image.copy()
        self._holds = True

    def _passes(self, ctx: moderngl.Context, seed: int | None) -> FoveationPass | None:
        if not (self.geometry.wraps and self.condition.on_charts):
            return self.condition.on_gpu(ctx, self.geometry, seed)
        from pipeline.foveation.panorama_gpu import panorama_pass

        return panorama_pass(ctx, self.geometry, self.condition, seed)

    def release(self) -> None:
        """Free what is held on the GPU, and the picture."""
        self._holds, self._image = False, None
        if self.passes is not None:
            self.passes.release()
            self.passes = None
