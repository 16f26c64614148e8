"""Metameric inpainting as printed, on the GPU. Twin: reference.py.

Dense, one pass after another, as the paper has it: it is here to be compared with, not to be fast.
"""

from collections.abc import Sequence
from itertools import pairwise

import moderngl
import numpy as np

from pipeline.features.gpu import band_constants
from pipeline.features.reference import fitted_kernels
from pipeline.gl.shader import Constant, compile_compute
from pipeline.gl.texture import check_size, check_texture, create_texture, texture_bytes
from pipeline.printed.noise import TILE as NOISE_TILE
from pipeline.printed.noise import printed_noise
from pipeline.printed.settings import PrintedSettings
from pipeline.pushpull.gpu import coarser_sizes
from pipeline.synthesis.settings import ANCHOR_REACH_PX, check_seed

TILE = 8  # work-group edge, pixels
BANDS = (3, 2)  # planes of a level: bands side by side, means and squares
SINGLE = (1, 1)  # planes of the residual

Size = tuple[int, int]


class PrintedPass:
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
        check_size(ctx, _stacked(size, BANDS))
        self._ctx = ctx
        self.size = size
        self.settings = settings
        levels = settings.levels
        self._shaders: list[moderngl.ComputeShader] = []
        self._textures: list[moderngl.Texture] = []
        low = fitted_kernels().low
        taps = {
            "LOW_INNER": float(low[1, 1]),
            "LOW_MIXED": float(low[0, 1]),
            "LOW_OUTER": float(low[0, 0]),
        }
        outer = {name: taps[name] for name in ("LOW_MIXED", "LOW_OUTER")}
        self._split = self._compile("split")
        self._halve = self._compile("halve", **taps)
        self._measure = self._compile("moments", RESIDUAL=False, **band_constants())
        self._residual = self._compile("moments", RESIDUAL=True, **band_constants())
        self._pull = {k: self._compile("pull", COLUMNS=k[0], ROWS=k[1]) for k in (BANDS, SINGLE)}
        self._push = {k: self._compile("push", COLUMNS=k[0], ROWS=k[1]) for k in (BANDS, SINGLE)}
        self._synthesise = self._compile("synthesise", **outer, **band_constants())
        self._shade = self._compile("shade", NOISE_TILE=NOISE_TILE, ANCHOR_REACH_PX=ANCHOR_REACH_PX)
        self._compose = self._compile("compose")
        for shader in self._pull.values():
            shader["depth_threshold"] = settings.depth_threshold
        for shader in self._push.values():
            shader["gamma"] = settings.gamma

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

    @property
    def held_bytes(self) -> int:
        """Memory beyond the caller's textures, bytes."""
        return sum(texture_bytes(texture) for texture in self._textures)

    @property
    def dispatches(self) -> int:
        """How many dispatches one call makes."""
        levels, steps = self.settings.levels, len(self._state) - 1
        chains = sum(2 * max(0, steps - level) for level in range(levels + 1))
        # Split and pull; per level halve, moments, synthesise, shade; residual's moments; compose.
        return 1 + self._last + 4 * levels + 1 + chains + 1

    def __call__(
        self,
        image: moderngl.Texture,
        depth_m: moderngl.Texture,
        flow_px: moderngl.Texture,
        *,
        z_near_m: float,
        seed: int,
    ) -> None:
        """Fill `image` in place.

        Parameters
        ----------
        image : rgba32f
            rgb: encoded colour; alpha: 1 known, 0 hole. Alpha stays as it is.
        depth_m : r32f
            With the background's depth inside holes.
        flow_px : rg32f
            Warped motion.
        z_near_m : float
            The clip's nearest depth.
        """
        check_texture(image, "image", self.size, "rgba32f")
        check_texture(depth_m, "depth_m", self.size, "r32f")
        check_texture(flow_px, "flow_px", self.size, "rg32f")
        self.set_seed(seed)
        self._split["z_near_m"] = z_near_m
        self._pull_colours(image, depth_m)
        levels = self.settings.levels
        for k in range(levels):
            self._run(
                self._measure,
                [self._low[k], self._guide[k], self._planes[k], self._state_of(k)],
                self._sizes[k],
            )
            self._inpaint(k, BANDS)
            finer = [self._low[k], self._guide[k]]
            coarser = [self._low[k + 1], self._guide[k + 1]]
            self._run(self._halve, [*finer, *coarser], self._sizes[k + 1])
        whole = [self._low[levels], self._guide[levels]]
        result = [self._planes[levels], self._state_of(levels)]
        pulled = [self._pulled, self._pulled_state]
        self._run(self._residual, [*whole, *result, *pulled], self._sizes[levels])
        self._inpaint(levels, SINGLE)
        below = self._planes[levels]
        for k in reversed(range(levels)):
            self._run(self._synthesise, [below, self._planes[k], self._image[k]], self._sizes[k])
            below = self._image[k]
        for k in range(levels):
            self._shade["level"] = k
            self._shade["level_size"] = self._sizes[k]
            bound = [below, self._planes[k], self._noise, flow_px, image]
            self._run(self._shade, bound, self.size)
        self._run(self._compose, [image, below], self.size)

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

    def release(self) -> None:
        """Free everything this pass made."""
        for texture in self._textures:
            texture.release()
        for shader in self._shaders:
            shader.release()

    @property
    def _pulled(self) -> moderngl.Texture:
        """Colours pulled to the residual's level."""
        return self._coarser[SINGLE][self._last - 1] if self._last else self._low[0]

    def _state_of(self, level: int) -> moderngl.Texture:
        return self._state[min(level, len(self._state) - 1)]

    def _pull_colours(self, image: moderngl.Texture, depth_m: moderngl.Texture) -> None:
        """Begin the pyramid, and pull its colours to the residual's level."""
        states = [*self._state[: self._last], self._pulled_state]
        first = [self._low[0], self._guide[0], states[0]]
        self._run(self._split, [image, depth_m, *first], self.size)
        chain = [self._low[0], *self._coarser[SINGLE][: self._last]]
        for fine, coarse in pairwise(zip(chain, states, strict=True)):
            self._run(self._pull[SINGLE], [*fine, *coarse], coarse[1].size)

    def _inpaint(self, level: int, planes: Size) -> None:
        """Pull a level's planes to 1x1 and push them back."""
        state = self._state[min(level, len(self._state) - 1) :]
        chain = [self._planes[level], *self._coarser[planes][len(self._state) - len(state) :]]
        steps = list(pairwise(zip(chain, state, strict=True)))
        for (fine, fine_state), (coarse, coarse_state) in steps:
            bound = [fine, fine_state, coarse, coarse_state]
            self._run(self._pull[planes], bound, coarse_state.size)
        for (fine, fine_state), (coarse, coarse_state) in reversed(steps):
            self._push[planes]["coarse_size"] = coarse_state.size
            self._run(self._push[planes], [fine, fine_state, coarse], fine_state.size)

    def _run(
        self, shader: moderngl.ComputeShader, bound: Sequence[moderngl.Texture], size: Size
    ) -> None:
        """Dispatch one invocation per pixel of `size`, textures bound in order."""
        for unit, texture in enumerate(bound):
            texture.bind_to_image(unit, read=True, write=True)
        shader.run(-(-size[0] // TILE), -(-size[1] // TILE))
        self._ctx.memory_barrier()

    def _compile(self, name: str, **constants: Constant) -> moderngl.ComputeShader:
        shader = compile_compute(self._ctx, f"printed/{name}.comp.glsl", TILE=TILE, **constants)
        self._shaders.append(shader)
        return shader

    def _texture(self, size: Size, format_name: str) -> moderngl.Texture:
        texture = create_texture(self._ctx, size, format_name)
        self._textures.append(texture)
        return texture


def _stacked(size: Size, planes: Size) -> Size:
    return size[0] * planes[0], size[1] * planes[1]
