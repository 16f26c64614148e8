"""Metameric inpainting on the GPU. Twin: reference.py.

Warp, then fill in place: lists of tiles near holes, the base colour, the pyramid's low
bands, moments of every level pulled and pushed together, what is lacking, composite.
"""

import moderngl
import numpy as np

from pipeline.errors import InputError
from pipeline.frame import check_seed
from pipeline.frame_textures import FrameTextures
from pipeline.gl.passes import Pass
from pipeline.inpaint.gpu import GuidedBasePass
from pipeline.noise.gains import LAGS
from pipeline.noise.tile import TEXELS_PER_PX, TILE_TEXELS, noise_bands
from pipeline.statistics.gpu import BANDS, LowBandPass, VariancePass
from pipeline.synthesis.reference import SMALLEST_LACKING
from pipeline.synthesis.settings import ANCHOR_REACH_PX, MetamericSettings


class MetamericPass(Pass):
    """Fill the holes of frames of one size with metamers of their background.

    Compiles and allocates once, on construction and when the seed changes. A call binds
    and dispatches, reads nothing back, and writes hole pixels only.

    Parameters
    ----------
    size : (width, height)
        Any from 1x1.
    base : GuidedBasePass, optional
        Of as many levels, which has run on each frame, whoever filled it: noise alone is added.
    gate : moderngl.Texture, optional
        As of `VariancePass`.
    attention : moderngl.Texture, optional
        Share of the noise that each pixel gets (r32f).

    Raises
    ------
    InputError
        If the driver cannot hold a frame of this size.
    """

    def __init__(
        self,
        ctx: moderngl.Context,
        size: tuple[int, int],
        settings: MetamericSettings,
        *,
        base: GuidedBasePass | None = None,
        gate: moderngl.Texture | None = None,
        attention: moderngl.Texture | None = None,
    ) -> None:
        super().__init__(ctx)
        check_limits(ctx, size)
        self.size = size
        self.settings = settings
        levels = settings.levels
        self._fills = base is None
        self.base = base or self._part(
            GuidedBasePass(
                ctx,
                size,
                levels=levels,
                gamma=settings.gamma,
                depth_threshold=settings.depth_threshold,
            )
        )
        self.low_bands = self._part(
            LowBandPass(ctx, self.base, levels, skip_depth_edges=settings.skip_depth_edges)
        )
        self._channels = 1 if settings.channels == "correlated" else 3
        self.variances = self._part(
            VariancePass(
                ctx,
                self.base,
                levels=levels,
                cross=settings.channels == "correlated",
                skip_depth_edges=settings.skip_depth_edges,
                gate=gate,
            )
        )
        self._composite = self._shader(
            "synthesis/composite.comp.glsl",
            LEVELS=levels,
            CHANNELS=self._channels,
            NOISE_TEXELS=TILE_TEXELS,
            NOISE_TEXELS_PER_PX=TEXELS_PER_PX,
            MOVES=settings.anchor == "flow",
            ANCHOR_REACH_PX=ANCHOR_REACH_PX,
            SMALLEST_LACKING=SMALLEST_LACKING,
            FOVEATED=attention is not None,
        )
        self._noise = self._texture((TILE_TEXELS * levels * self._channels, TILE_TEXELS), "rgba32f")
        self._hold(**self.base.lists.shared, noise=self._noise, variances=self.variances.texels)
        if attention is not None:
            self._hold(attention=attention)
        self._composite["depth_threshold"] = settings.depth_threshold
        self._composite["noise_scale"] = settings.noise
        self._composite["level_size"] = self.variances.places
        self._seed: int | None = None

    def set_seed(self, seed: int) -> None:
        """Make the noise of `seed`, unless it is the one at hand.

        Raises
        ------
        InputError
            If `seed` is not a whole number from 0 to 2**63 - 1.
        """
        seed = check_seed(seed)
        if seed == self._seed:
            return
        noise = noise_bands(seed, self.settings.levels, self._channels)
        # (levels, channels, row, column, band) to one texel's levels and channels together.
        texels = np.pad(noise.tiles.transpose(2, 3, 0, 1, 4), ((0, 0),) * 4 + ((0, 1),))
        self._noise.write(texels.tobytes())
        self._composite["lag_correlation"] = noise.lag_correlation.reshape(-1, len(LAGS))
        self._seed = seed

    def __call__(
        self,
        frame: FrameTextures,
        *,
        z_near_m: float,
        seed: int,
    ) -> None:
        """Fill the holes of `frame.colour` in place; alpha stays as it is.

        Parameters
        ----------
        z_near_m : float
            The clip's nearest depth.
        """
        self.set_seed(seed)
        self.tell(z_near_m=z_near_m)
        self._play(self.fill, frame)

    def fill(self, frame: FrameTextures) -> None:
        """Fill a frame, with the nearest depth that the passes were told and the noise at hand."""
        frame.check(self.size)
        if self._fills:
            self.base.fill(frame.colour, frame.depth_m)
        levels = self.low_bands(frame.colour, frame.depth_m)
        self.variances(levels, frame.depth_m)
        self.base.lists.run(
            self._composite,
            ("holes", 1),
            image=frame.colour,
            depth_m=frame.depth_m,
            flow_px=frame.flow_px,
        )


def check_limits(ctx: moderngl.Context, size: tuple[int, int]) -> None:
    """Require a driver for frames of `size`, (width, height).

    Variances of 2x2 pixels lie `BANDS` side by side in one image.

    Raises
    ------
    InputError
        If the frame is too wide.
    """
    edge = int(ctx.info["GL_MAX_TEXTURE_SIZE"])
    widest = edge // BANDS * 2
    if size[0] > widest:
        raise InputError(
            f"frames to fill with metamers must be at most {widest} px wide on this driver"
            f" (got {size[0]}x{size[1]})"
        )
