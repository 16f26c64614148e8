"""Filling holes by a map of shifts, on the GPU. Twin: reference.py.

After push-pull: the ways of all hole pixels, their base, which also cuts the tiles; what the search
compares; each tile's first shift, and the sweeps; the detail; and all put together.
"""

import moderngl

from pipeline.background_texture.reference import MARGIN_PX, OCTANT_TANGENT
from pipeline.frame_textures import FrameTextures
from pipeline.gl.passes import Pass
from pipeline.inpaint.gpu import GuidedBasePass
from pipeline.inpaint.region import CELL
from pipeline.shiftmap import settings as fixed
from pipeline.shiftmap.settings import ShiftMapSettings
from pipeline.shiftmap.tiles import table_size
from pipeline.synthesis.settings import MetamericSettings

TILE_BYTES = 56  # of the struct in shift_tiles.glsl
TILES = ("tiles", 0)
RESET_GROUP = 64
_FORMATS = {
    "ways": "rgba32i",
    "ends": "rgba32f",
    "base": "rgba32f",
    "planes": "rg32ui",
    "detail": "rgba32f",
}
_GRID = ("TILE", "SUBPIXELS")
_SEARCH = (
    *_GRID,
    *("TILE_PX", "WINDOW_PX", "WINDOW_STEP_PX", "LEAST_COMPARED"),
    *("COST_SCALE", "NOT_KNOWN_COST", "FARTHER_COST"),
)
_CONSTANTS: dict[str, tuple[str, ...]] = {  # of settings.py, by pass
    "reset": _GRID,
    "ways": ("THIN_PX", "WIDE_PX", "NEARER_SHARE"),
    "base": ("THIN_PX", "WIDE_PX", "EXTENSION_SHARE", *_GRID),
    "planes": (),
    "first": ("LENGTHS", *_SEARCH),
    "sweep": ("DISAGREEMENT_COST", "DISAGREEMENT_PX", *_SEARCH),
    "copy": ("EXTENSION_SHARE", "SQUARE_STEPS", *_GRID),
    "finish": _GRID,
}


class ShiftMapPass(Pass):
    """Fill the holes of one frame's colour, in place. Known pixels keep their bits.

    A call allocates nothing.

    Parameters
    ----------
    size : (width, height)
        Any from 1x1.
    """

    def __init__(
        self, ctx: moderngl.Context, size: tuple[int, int], settings: ShiftMapSettings
    ) -> None:
        super().__init__(ctx)
        self.size, self.settings = size, settings
        rows, columns = table_size((size[1], size[0]))
        self.base = self._part(
            GuidedBasePass(
                ctx,
                size,
                gamma=MetamericSettings.gamma,
                depth_threshold=settings.depth_threshold,
                tiles=rows * columns,
            )
        )
        self.lists = self.base.lists
        self.textures = {
            name: self._texture(size, format_name) for name, format_name in _FORMATS.items()
        }
        self.tiles = self._buffer(TILE_BYTES * rows * columns)
        self._reset_groups = -(-rows * columns // RESET_GROUP)
        tiles_list, tiles_first = self.lists.appendable(TILES)
        more: dict[str, dict[str, int | float]] = {
            "ways": {
                "REACH": fixed.WAY_REACH_PX,
                "MARGIN": float(MARGIN_PX),
                "OCTANT_TANGENT": OCTANT_TANGENT,
            },
            "base": {"TILES_LIST": tiles_list, "TILES_FIRST": tiles_first},
            "planes": {"TILE": CELL},
        }
        threshold = {"THRESHOLD_STEPS": round(fixed.GUIDE_STEPS * settings.depth_threshold)}
        more["first"] = more["sweep"] = {**threshold}
        self._steps = {
            name: self._shader(
                f"shiftmap/{name}.comp.glsl",
                **{key: getattr(fixed, key) for key in keys},
                **more.get(name, {}),
            )
            for name, keys in _CONSTANTS.items()
        }
        self._set(
            depth_threshold=settings.depth_threshold,
            table_size=(columns, rows),
            gain=settings.gain,
        )
        self._hold(**self.lists.shared, **self.textures, tiles=self.tiles)

    def __call__(
        self,
        frame: FrameTextures,
        *,
        z_near_m: float,
    ) -> None:
        """Fill the holes of `frame.colour` in place; alpha stays as it is.

        Parameters
        ----------
        z_near_m : float
            The clip's nearest depth.
        """
        frame.check(self.size)
        self._steps["reset"].run(self._reset_groups)
        self.base(frame.colour, frame.depth_m, z_near_m)
        self._set(z_near_m=z_near_m)
        self._hold(
            image=frame.colour,
            depth_m=frame.depth_m,
            flow_px=frame.flow_px,
            quarters=self.base.chain.at(fixed.LOW_RESOLUTION),
            quarter_guide=self.base.guide.at(fixed.LOW_RESOLUTION),
        )
        run, steps, holes = self.lists.run, self._steps, ("holes", 1)
        run(steps["ways"], holes)
        run(steps["base"], holes)
        run(steps["planes"], ("source", 1))
        run(steps["first"], TILES)
        for turn, step_px in enumerate(fixed.STEPS_PX):
            steps["sweep"]["before"] = turn % 2
            steps["sweep"]["step_px"] = step_px
            run(steps["sweep"], TILES)
        run(steps["copy"], holes)
        run(steps["finish"], holes)
