"""Mixed noise on the GPU, in the very steps of its twin: `tile.mixed`, rounded to steps.

White noise is halved and softened level by level, and bands are brought up from the coarsest level
on. Their squares are summed, and read back: they say the weights with which bands are mixed.
"""

from __future__ import annotations

import moderngl
import numpy as np

from pipeline.gl.compute import Texture, let_go
from pipeline.gl.passes import Pass
from pipeline.gl.shader import Constant
from pipeline.noise.tile import (
    MIXED_STEP,
    TAP_BITS,
    WHITE_BITS,
    Steps,
    Stream,
    key_of,
    mixing_weights,
    noise_taps,
)

WORK_EDGE = 8  # of work groups
BLOCK = 64  # pixels, of which squares are summed together
BANDS_PER_LAYER = 8

WHITE_SHADER, HALVE_SHADER, RAISE_SHADER, MIX_SHADER = (
    f"noise/{name}.comp.glsl" for name in ("white", "halve", "raise", "mix")
)

Size = tuple[int, int]


class NoisePass(Pass):
    """One channel's noise of one size, (width, height) in pixels, made again for each seed.

    What it is worked out in is freed behind each seed: some 54 bytes a pixel.

    Parameters
    ----------
    step : float
        Of the noise, deviations; a power of two.
    most_steps : int
        To either side, at most 127.
    margin : int
        Pixels of noise made beyond the border, where the size is no multiple of ``2 ** levels``:
        farther than filters reach, it goes on without a seam.

    Attributes
    ----------
    texture : moderngl.TextureArray
        A word is a band of 2x2 pixels, signed bytes, four bands a layer; level by level, high,
        along x, along y.
    """

    def __init__(
        self,
        ctx: moderngl.Context,
        size: Size,
        levels: int,
        *,
        step: float,
        most_steps: int,
        margin: int = 0,
    ) -> None:
        super().__init__(ctx)
        width, height = self._size = size
        self._levels, self._margin = levels, margin
        cells = -(-width // 2), -(-height // 2)
        self.texture = self._array(cells, -(-3 * levels // 4), "rgba32ui")
        self._seed: int | None = None
        with_taps = filter_constants()
        self._white = self._shader(WHITE_SHADER, TILE=WORK_EDGE, WHITE_BITS=WHITE_BITS)
        self._halve = self._shader(HALVE_SHADER, **with_taps["halve"])
        self._raise = [
            self._shader(RAISE_SHADER, OLDER=older, **with_taps["raise"]) for older in range(levels)
        ]
        layers = layers_of(levels)
        self._squares = self._shader("noise/squares.comp.glsl", LAYERS=layers)
        self._mix = self._shader(MIX_SHADER, **mix_constants(levels, step, most_steps))

    def set_seed(self, seed: int) -> None:
        """Make the noise of `seed`, unless it is at hand."""
        if seed == self._seed:
            return
        work = Pass(self._ctx)
        try:
            raised = self._raised(work, seed)
            self._mix["weights"] = self._weights(work, raised).ravel()
            self._mix["margin"] = self._margin
            cells = self.texture.width, self.texture.height
            self._mix.run_over(cells, raised=raised, noise=self.texture)
        finally:
            work.release()
            let_go(self._ctx)
        self._seed = seed

    def _raised(self, work: Pass, seed: int) -> Texture:
        """All bands at full size, eight a layer, from the coarsest level on."""
        width, height = (
            edge + 2 * self._margin + -edge % (1 << self._levels) for edge in self._size
        )
        sizes = [(width >> level, height >> level) for level in range(self._levels + 1)]
        lows, softs = ([work._texture(size, "r32i") for size in sizes] for _ in range(2))
        self._white["key"] = key_of(seed, Stream.BANDS)
        self._white["first"] = tuple(-self._margin % edge for edge in self._size)
        self._white["period"] = self._size
        self._white.run_over(sizes[0], white=lows[0])
        for level in range(self._levels):
            self._halve.run_over(
                _cells(sizes[level]), low=lows[level], soft=softs[level], next=lows[level + 1]
            )
        raised: Texture | None = None
        for older, level in enumerate(reversed(range(self._levels))):
            given = {} if raised is None else {"coarse": raised}
            raised = work._array(sizes[level], layers_of(older + 1), "rgba32ui")
            self._raise[older].run_over(
                _cells(sizes[level]), low=lows[level], soft=softs[level], raised=raised, **given
            )
        assert raised is not None
        return raised

    def _weights(self, work: Pass, raised: Texture) -> Steps:
        columns, rows = -(-raised.width // BLOCK), -(-raised.height // BLOCK)
        layers = layers_of(self._levels)
        sums = work._buffer(columns * rows * layers * 4 * 16)
        self._squares.run(columns, rows, raised=raised, of_blocks=sums)
        # (block, layer, lower or upper band, low bits or rest, word)
        found = np.frombuffer(sums.read(), np.uint32).reshape(-1, layers, 2, 2, 4)
        low, rest = found.sum(axis=0, dtype=np.int64).transpose(2, 0, 3, 1).reshape(2, -1)
        bands = (low + (rest << 16))[: 3 * self._levels].reshape(self._levels, 3)[::-1]
        return mixing_weights(bands.ravel().tolist(), raised.width * raised.height)


def layers_of(levels: int) -> int:
    """Layers of raised bands."""
    return -(-3 * levels // BANDS_PER_LAYER)


def filter_constants() -> dict[str, dict[str, Constant]]:
    """Constants that the shaders `halve` and `raise` are compiled with."""
    taps = {name: tuple(own.ravel().tolist()) for name, own in vars(noise_taps()).items()}
    named = {"halve": ("soft", "halving"), "raise": ("high", "oriented", "raising")}
    return {
        shader: {
            "TILE": WORK_EDGE, "TAP_BITS": TAP_BITS, **{one.upper(): taps[one] for one in names}
        }
        for shader, names in named.items()
    }  # fmt: skip


def mix_constants(levels: int, step: float, most_steps: int) -> dict[str, Constant]:
    """Constants that the shader `mix` is compiled with."""
    bits = round(np.log2(step / MIXED_STEP))
    return {"TILE": WORK_EDGE, "LEVELS": levels, "STEP_BITS": bits, "MOST_STEPS": most_steps}


def _cells(size: Size) -> Size:
    return -(-size[0] // 2), -(-size[1] // 2)
