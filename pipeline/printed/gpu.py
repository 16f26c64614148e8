"""Metameric inpainting as printed, on the GPU. Twin: reference.py.

Dense, one pass after another, as the paper has it: it is here to be compared with, not to be fast.
"""

from itertools import pairwise

import moderngl
import numpy as np

from pipeline.features.reference import band_constants, low_constants
from pipeline.frame import check_seed
from pipeline.frame_textures import FrameTextures
from pipeline.gl.passes import Pass
from pipeline.gl.texture import check_size
from pipeline.printed.reference import TILE as NOISE_TILE
from pipeline.printed.reference import PrintedSettings, printed_noise
from pipeline.pushpull.gpu import coarser_sizes
from pipeline.synthesis.settings import ANCHOR_REACH_PX

TILE = 8  # work-group edge, pixels
BANDS = (3, 2)  # planes of a level: bands side by side, means and squares
SINGLE = (1, 1)  # planes of the residual

Size = tuple[int, int]


class PrintedPass(Pass):
    """Fill the holes of frames of one size by `metameric-paper`.

    Compiles and allocates once, on construction; the noise is made when the seed changes. A call
    binds and dispatches, reads nothing back, and writes hole pixels only.

    Parameters
    ----------
    size : (width, height)
        Any from 1x1.

    Raises
    ------
    InputError
        If the driver cannot hold textures three times as wide and twice as high.
    """

    def __init__(self, ctx: moderngl.Context, size: Size, settings: PrintedSettings) -> None:
        constants = {"TILE": TILE, "NOISE_TILE": NOISE_TILE, "ANCHOR_REACH_PX": ANCHOR_REACH_PX}
        super().__init__(ctx, {**low_constants(), **band_constants(), **constants})
        check_size(ctx, _stacked(size, BANDS))
        self.size = size
        self.settings = settings
        levels = settings.levels
        self._split, self._halve, self._synthesise, self._shade, self._compose = (
            self._shader(f"printed/{name}.comp.glsl")
            for name in ("split", "halve", "synthesise", "shade", "compose")
        )
        self._measure, self._residual = (
            self._shader("printed/moments.comp.glsl", RESIDUAL=residual)
            for residual in (False, True)
        )
        self._pull, self._push = (
            {
                (columns, rows): self._shader(
                    f"printed/{step}.comp.glsl", COLUMNS=columns, ROWS=rows
                )
                for columns, rows in (BANDS, SINGLE)
            }
            for step in ("pull", "push")
        )
        self._set(depth_threshold=settings.depth_threshold, gamma=settings.gamma)

        sizes = [size, *coarser_sizes(size)]
        # Past 1x1 nothing changes.
        self._sizes = sizes + [(1, 1)] * max(0, levels + 1 - len(sizes))
        here = self._sizes[: levels + 1]
        self._low = [self._texture(one, "rgba32f") for one in here]
        self._guide = [self._texture(one, "r32f") for one in here]
        # Finest planes of every level stay; what is coarser serves one level after the other.
        self._planes = [self._texture(_stacked(one, BANDS), "rgba32f") for one in here[:-1]]
        self._planes.append(self._texture(here[-1], "rgba32f"))
        self._coarser = {
            k: [self._texture(_stacked(one, k), "rgba32f") for one in sizes[1:]]
            for k in (BANDS, SINGLE)
        }
        self._state = [self._texture(one, "rg32f") for one in sizes]
        self._last = min(levels, len(sizes) - 1)
        self._pulled_state = self._texture(sizes[self._last], "rg32f")
        self._image = [self._texture(one, "rgba32f") for one in here[:-1]]
        self._noise = self._texture((3 * NOISE_TILE, levels * NOISE_TILE), "rgba32f")
        self._seed: int | None = None

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
        self._play(self._fill, frame)

    def _fill(self, frame: FrameTextures) -> None:
        frame.check(self.size)
        self._pull_colours(frame.colour, frame.depth_m)
        levels = self.settings.levels
        for k in range(levels):
            here = {"low": self._low[k], "guide": self._guide[k]}
            moments = {"planes": self._planes[k], "state": self._state_of(k)}
            self._measure.run_over(self._sizes[k], **here, **moments)
            self._inpaint(k, BANDS)
            self._halve.run_over(
                self._sizes[k + 1],
                fine=self._low[k],
                fine_guide=self._guide[k],
                coarse=self._low[k + 1],
                coarse_guide=self._guide[k + 1],
            )
        self._residual.run_over(
            self._sizes[levels],
            low=self._low[levels],
            guide=self._guide[levels],
            planes=self._planes[levels],
            state=self._state_of(levels),
            pulled=self._pulled,
            pulled_state=self._pulled_state,
        )
        self._inpaint(levels, SINGLE)
        below = self._planes[levels]
        for k in reversed(range(levels)):
            bands, result = self._planes[k], self._image[k]
            self._synthesise.run_over(self._sizes[k], coarse=below, planes=bands, image=result)
            below = result
        for k in range(levels):
            self._shade["level"] = k
            self._shade["level_size"] = self._sizes[k]
            self._shade.run_over(
                self.size,
                ycbcr=below,
                planes=self._planes[k],
                noise=self._noise,
                flow_px=frame.flow_px,
                image=frame.colour,
            )
        self._compose.run_over(self.size, image=frame.colour, ycbcr=below)

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
        noise = printed_noise(seed, self.settings.levels)
        # (levels, row, column, band, channel): bands side by side, levels below each other.
        rows = noise.transpose(0, 1, 3, 2, 4).reshape(-1, 3 * NOISE_TILE, 3)
        self._noise.write(np.pad(rows, ((0, 0), (0, 0), (0, 1))).tobytes())
        self._seed = seed

    @property
    def _pulled(self) -> moderngl.Texture:
        """Colours pulled to the residual's level."""
        return self._coarser[SINGLE][self._last - 1] if self._last else self._low[0]

    def _state_of(self, level: int) -> moderngl.Texture:
        return self._state[min(level, len(self._state) - 1)]

    def _pull_colours(self, image: moderngl.Texture, depth_m: moderngl.Texture) -> None:
        """Begin the pyramid, and pull its colours to the residual's level."""
        states = [*self._state[: self._last], self._pulled_state]
        first = {"low": self._low[0], "guide": self._guide[0], "state": states[0]}
        self._split.run_over(self.size, image=image, depth_m=depth_m, **first)
        chain = [self._low[0], *self._coarser[SINGLE][: self._last]]
        self._pull_down(SINGLE, list(zip(chain, states, strict=True)))

    def _inpaint(self, level: int, planes: Size) -> None:
        """Pull a level's planes to 1x1 and push them back."""
        state = self._state[min(level, len(self._state) - 1) :]
        chain = [self._planes[level], *self._coarser[planes][len(self._state) - len(state) :]]
        levels = list(zip(chain, state, strict=True))
        self._pull_down(planes, levels)
        for (fine, fine_state), (coarse, coarse_state) in reversed(list(pairwise(levels))):
            self._push[planes]["coarse_size"] = coarse_state.size
            self._push[planes].run_over(
                fine_state.size, fine=fine, fine_state=fine_state, coarse=coarse
            )

    def _pull_down(
        self, planes: Size, levels: list[tuple[moderngl.Texture, moderngl.Texture]]
    ) -> None:
        """Pull planes and state from each level to the next coarser one."""
        for (fine, fine_state), (coarse, coarse_state) in pairwise(levels):
            self._pull[planes].run_over(
                coarse_state.size,
                fine=fine,
                fine_state=fine_state,
                coarse=coarse,
                coarse_state=coarse_state,
            )


def _stacked(size: Size, planes: Size) -> Size:
    return size[0] * planes[0], size[1] * planes[1]
