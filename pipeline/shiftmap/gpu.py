"""Filling holes by a map of shifts, on the GPU. Twin: reference.py.

After push-pull: the ways of all hole pixels, their base, which also cuts the tiles; what the search
compares; each tile's first shift, and the sweeps; the detail; and all put together.
"""

import moderngl

from pipeline.background_texture.reference import MARGIN_PX, OCTANT_TANGENT
from pipeline.gl.shader import compile_compute
from pipeline.gl.texture import check_texture, create_texture, texture_bytes
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
    "ways": ("WIDE_PX",),
    "base": ("THIN_PX", "WIDE_PX", "EXTENSION_SHARE", *_GRID),
    "planes": (),
    "first": ("LENGTHS", *_SEARCH),
    "sweep": ("DISAGREEMENT_COST", "DISAGREEMENT_PX", *_SEARCH),
    "copy": ("EXTENSION_SHARE", "SQUARE_STEPS", *_GRID),
    "finish": _GRID,
}


class ShiftMapPass:
    """Fill the holes of one frame's colour, in place. Known pixels keep their bits.

    A call makes `dispatches` dispatches and allocates nothing.

    Parameters
    ----------
    size : (width, height)
        Any from 1x1.
    """

    def __init__(
        self, ctx: moderngl.Context, size: tuple[int, int], settings: ShiftMapSettings
    ) -> None:
        self.size, self.settings = size, settings
        self._ctx = ctx
        rows, columns = table_size((size[1], size[0]))
        self.base = GuidedBasePass(
            ctx,
            size,
            gamma=MetamericSettings.gamma,
            depth_threshold=settings.depth_threshold,
            tiles=rows * columns,
        )
        self.lists = self.base.lists
        self.textures = {
            name: create_texture(ctx, size, format_name) for name, format_name in _FORMATS.items()
        }
        self.tiles = ctx.buffer(reserve=TILE_BYTES * rows * columns)
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
        self._shaders = {
            name: compile_compute(
                ctx,
                f"shiftmap/{name}.comp.glsl",
                **{key: getattr(fixed, key) for key in keys},
                **more.get(name, {}),
            )
            for name, keys in _CONSTANTS.items()
        }
        for shader in self._shaders.values():
            for name, value in (
                ("depth_threshold", settings.depth_threshold),
                ("table_size", (columns, rows)),
                ("gain", settings.gain),
            ):
                if name in shader:
                    shader[name] = value

    @property
    def dispatches(self) -> int:
        """How many dispatches one call makes."""
        return self.base.dispatches + 7 + len(fixed.STEPS_PX)

    @property
    def held_bytes(self) -> int:
        """Memory beyond the caller's textures, bytes."""
        own = sum(map(texture_bytes, self.textures.values())) + self.tiles.size
        return self.base.held_bytes + own

    def __call__(
        self,
        image: moderngl.Texture,
        depth_m: moderngl.Texture,
        flow_px: moderngl.Texture,
        *,
        z_near_m: float,
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
        check_texture(depth_m, "depth_m", self.size, "r32f")
        check_texture(flow_px, "flow_px", self.size, "rg32f")
        self.tiles.bind_to_storage_buffer(4)
        self._shaders["reset"].run(self._reset_groups)
        self.base(image, depth_m, z_near_m)
        self.tiles.bind_to_storage_buffer(4)
        for shader in self._shaders.values():
            if "z_near_m" in shader:
                shader["z_near_m"] = z_near_m
        own = self.textures
        low = (self.base.chain.at(fixed.LOW_RESOLUTION), self.base.guide.at(fixed.LOW_RESOLUTION))
        holes = ("holes", 1)
        self._run("ways", holes, image, depth_m, flow_px, *low, own["ways"], own["ends"])
        self._run("base", holes, image, depth_m, flow_px, own["ways"], own["ends"], own["base"])
        self._run("planes", ("source", 1), image, depth_m, own["base"], *low, own["planes"])
        self._run("first", TILES, own["planes"])
        for turn, step_px in enumerate(fixed.STEPS_PX):
            self._shaders["sweep"]["before"] = turn % 2
            self._shaders["sweep"]["step_px"] = step_px
            self._run("sweep", TILES, own["planes"])
        self._run("copy", holes, image, depth_m, flow_px, own["base"], *low, own["detail"])
        self._run("finish", holes, image, flow_px, own["base"], own["detail"])

    def _run(self, name: str, key: tuple[str, int], *textures: moderngl.Texture) -> None:
        for unit, texture in enumerate(textures):
            texture.bind_to_image(unit)
        self.lists.run(self._shaders[name], key)

    def release(self) -> None:
        """Free everything this pass made."""
        self.base.release()
        self.tiles.release()
        for texture in self.textures.values():
            texture.release()
        for shader in self._shaders.values():
            shader.release()
