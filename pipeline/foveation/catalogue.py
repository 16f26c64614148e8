"""Interface of every condition, and the conditions by class.

Classes check and keep parameters; the modules beside do the work.

Keyword-only parameters of a class and of its bases are the parameters of its condition. Those of
pooling are the same for all: see `PooledCondition`.
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, ClassVar, Protocol, Unpack

from pipeline.errors import InputError
from pipeline.foveation import displacement, enhancement, reference
from pipeline.foveation.displacement import DisplacementSettings
from pipeline.foveation.geometry import Geometry
from pipeline.foveation.picture_fixation import Colour, PictureFixation
from pipeline.foveation.pooling import (
    CONSTANTS,
    Chroma,
    MetamerSettings,
    Pooling,
    PoolingParameters,
    Residual,
    make_pooling,
)
from pipeline.pictures.decode import read_integers

if TYPE_CHECKING:
    import moderngl

    from pipeline.foveation.gpu import FoveationPass


class Condition(Protocol):
    """A configured way to change a picture for a gaze.

    A pure function of picture, fixation and parameters: any state is only a cache.

    Attributes
    ----------
    on_charts : bool
        Whether a panorama is shown in three pictures, see panorama.py; it needs `pooling`.
    """

    on_charts: ClassVar[bool]

    @property
    def pooling(self) -> Pooling | None:
        """Width of the eye's pools; None where it plays no part."""
        ...

    def apply(self, picture: Colour, fixation: PictureFixation) -> Colour:
        """Return the picture that is shown: (H, W, 3), float32 in [0, 1]."""
        ...

    def on_gpu(
        self, ctx: moderngl.Context, geometry: Geometry, seed: int | None = None
    ) -> FoveationPass | None:
        """Build the passes that do the same, or None where only numpy does it.

        Noise of `seed` is made before they take their memory, which it needs for a while.
        """
        ...


ENHANCED_RATE = 1.40
"""Arcmin per degree of the blurs that are enhanced, unless a law is given: Beyond Blur's widest."""


class NumpyCondition:
    """A condition that numpy alone makes."""

    pooling: Pooling | None = None
    on_charts: ClassVar[bool] = False

    def on_gpu(
        self,
        ctx: moderngl.Context,  # noqa: ARG002
        geometry: Geometry,  # noqa: ARG002
        seed: int | None = None,  # noqa: ARG002
    ) -> FoveationPass | None:
        return None


class Reference(NumpyCondition):
    """The picture itself."""

    def apply(self, picture: Colour, fixation: PictureFixation) -> Colour:  # noqa: ARG002
        return picture.copy()


class PooledCondition(NumpyCondition):
    """A condition that pools; its parameters are those of `pooling.make_pooling`."""

    pooling: Pooling
    on_charts = True

    def __init__(
        self,
        *,
        law: str | None = None,
        scaling: float | None = None,
        alpha: float | None = None,
        rate: float | None = None,
        fovea_deg: float = 1.0,
    ) -> None:
        self.pooling = make_pooling(
            law, scaling=scaling, alpha=alpha, rate=rate, fovea_deg=fovea_deg
        )


class Blur(PooledCondition):
    """Every pixel is its pool's mean."""

    def on_gpu(
        self,
        ctx: moderngl.Context,
        geometry: Geometry,
        seed: int | None = None,  # noqa: ARG002
    ) -> FoveationPass:
        from pipeline.foveation.gpu import BlurPass

        return BlurPass(ctx, geometry, self.pooling)

    def apply(self, picture: Colour, fixation: PictureFixation) -> Colour:
        return reference.blur(picture, fixation.pools(self.pooling))


class Metamer(PooledCondition):
    """Noise with every pool's moments; see `MetamerSettings`."""

    def __init__(
        self,
        *,
        chroma: Chroma = "follow",
        residual: Residual = "kept",
        noise: float = 1.0,
        levels: int = 5,
        **pooling: Unpack[PoolingParameters],
    ) -> None:
        super().__init__(**pooling)
        self.settings = MetamerSettings(self.pooling, levels, chroma, residual, noise)

    def on_gpu(
        self, ctx: moderngl.Context, geometry: Geometry, seed: int | None = None
    ) -> FoveationPass | None:
        from pipeline.foveation.gpu import MetamerPass

        if self.settings.chroma == "full":
            return None
        return MetamerPass(ctx, geometry, self.settings, seed=seed)

    def apply(self, picture: Colour, fixation: PictureFixation) -> Colour:
        return reference.metamer(
            picture,
            fixation.pools(self.pooling),
            self.settings,
            fixation.seed,
            noise_shift_px=fixation.noise_shift_px,
        )


class _Enhanced(PooledCondition):
    """A blur to which something is given back, by `strength`."""

    most_strength: ClassVar[float]

    def __init__(self, *, strength: float = 1.0, **pooling: Unpack[PoolingParameters]) -> None:
        if not any(pooling.get(name) is not None for name in ("law", *CONSTANTS)):
            pooling["rate"] = ENHANCED_RATE
        super().__init__(**pooling)
        if not 0 <= strength <= self.most_strength:
            raise InputError(f"strength must lie in 0..{self.most_strength:g} (got {strength})")
        self.strength = strength


class NoiseEnhanced(_Enhanced):
    """A blur, and noise where the eye detects detail that it cannot resolve."""

    most_strength = 16

    def apply(self, picture: Colour, fixation: PictureFixation) -> Colour:
        return enhancement.noise_enhanced(
            picture, fixation.pools(self.pooling), fixation.seed, strength=self.strength
        )


class ContrastEnhanced(_Enhanced):
    """A blur whose local contrast is restored."""

    most_strength = 2

    def apply(self, picture: Colour, fixation: PictureFixation) -> Colour:
        return enhancement.contrast_enhanced(
            picture, fixation.pools(self.pooling), strength=self.strength
        )


class _Displaced(PooledCondition):
    """Base of conditions that displace at random; see `DisplacementSettings`."""

    match: ClassVar[bool]

    def __init__(
        self,
        *,
        reach: float = 0.35,
        smoothness: float = 0.5,
        **pooling: Unpack[PoolingParameters],
    ) -> None:
        super().__init__(**pooling)
        self.settings = DisplacementSettings(self.pooling, reach, smoothness)

    def on_gpu(
        self, ctx: moderngl.Context, geometry: Geometry, seed: int | None = None
    ) -> FoveationPass:
        from pipeline.foveation.displacement_gpu import DisplacementPass

        return DisplacementPass(ctx, geometry, self.settings, match=self.match, seed=seed)

    def apply(self, picture: Colour, fixation: PictureFixation) -> Colour:
        show = displacement.warped_metamer if self.match else displacement.eidolon
        return show(
            picture,
            fixation.pools(self.pooling),
            self.settings,
            fixation.seed,
            field_pools=fixation.field_pools(self.pooling),
            shift_px=fixation.noise_shift_px,
        )


class Eidolon(_Displaced):
    """The picture displaced at random."""

    match = False


class WarpedMetamer(_Displaced):
    """The picture displaced at random, and given its pools' moments again."""

    match = True

    def __init__(
        self,
        *,
        reach: float = 0.35,
        smoothness: float = 0.5,
        levels: int = 5,
        **pooling: Unpack[PoolingParameters],
    ) -> None:
        super().__init__(**pooling)
        self.settings = DisplacementSettings(self.pooling, reach, smoothness, levels)


class FilesOnDisk(NumpyCondition):
    """Pictures made elsewhere: ``FOLDER/000000.png``, ``000001.png``, ... by frame number.

    The fovea is theirs as well: what made them answers for it.

    Parameters
    ----------
    path : Path
        A folder of images of integers, named by number.

    Raises
    ------
    NotADirectoryError, FileNotFoundError
        If there is no such folder.
    InputError
        If it holds no numbered image, or one number twice.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self._files: dict[int, Path] = {}
        for file in sorted(path.iterdir()):
            if not (file.is_file() and file.stem.isdecimal()):
                continue
            number = int(file.stem)
            if number in self._files:
                raise InputError(
                    f"{path}: must hold each picture once (number {number} is in"
                    f" {self._files[number].name} and in {file.name})"
                )
            self._files[number] = file
        if not self._files:
            raise InputError(
                f"{path}: must hold pictures named 000000.png, 000001.png, ... (has none)"
            )

    def apply(self, picture: Colour, fixation: PictureFixation) -> Colour:
        file = self._files.get(fixation.frame)
        if file is None:
            raise InputError(
                f"{self.path}: must hold picture {fixation.frame:06d}"
                f" (has {len(self._files)}, from {min(self._files)} to {max(self._files)})"
            )
        found = read_integers(file)
        if found.shape != picture.shape:
            raise InputError(
                f"{file}: must be {picture.shape[1]} x {picture.shape[0]} px as the picture"
                f" (is {found.shape[1]} x {found.shape[0]})"
            )
        return found
