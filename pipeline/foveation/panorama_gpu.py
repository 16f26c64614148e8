"""A panorama in three pictures, and flat views out of one, on the GPU.

Noise of flat views lies on directions. Twins: panorama.py, view.py. Change both or neither.
"""

from __future__ import annotations

import math

import moderngl
import numpy as np

from pipeline.foveation.catalogue import Condition
from pipeline.foveation.displacement import CUBIC
from pipeline.foveation.geometry import CapGeometry, FlatGeometry, Geometry
from pipeline.foveation.gpu import Call, FoveationPass
from pipeline.foveation.panorama import cap_gaze_px, cap_of
from pipeline.foveation.picture_pass import TILE, PicturePass, PoolUniforms, sphere_constants
from pipeline.foveation.pooling import Pooling
from pipeline.foveation.view import NOISE_BELT_DEG, belt_px, samples_of, turn
from pipeline.gl.passes import Pass
from pipeline.gl.texture import check_texture


def panorama_pass(
    ctx: moderngl.Context, geometry: Geometry, condition: Condition, seed: int | None = None
) -> FoveationPass | None:
    """Build the passes of a whole panorama, or None for a condition that numpy alone does."""
    belt = condition.on_gpu(ctx, geometry, seed)
    if belt is None or condition.pooling is None:
        return None
    caps = [cap_of(geometry, upper=upper) for upper in (True, False)]
    inner = [condition.on_gpu(ctx, cap, seed) for cap in caps]
    return PanoramaPass(
        ctx,
        geometry,
        condition.pooling,
        belt,
        [(cap, made) for cap, made in zip(caps, inner, strict=True) if made is not None],
    )


class PanoramaPass(FoveationPass):
    """A condition for a panorama: the belt's passes, and those of the caps around both poles.

    Noise that surfaces carry along is left to numpy.
    """

    carries_noise = False

    def __init__(
        self,
        ctx: moderngl.Context,
        geometry: Geometry,
        pooling: Pooling,
        belt: FoveationPass,
        caps: list[tuple[CapGeometry, FoveationPass]],
    ) -> None:
        super().__init__(ctx, geometry, pooling)
        self._belt, self._caps = belt, caps
        self._inner = [self._part(made) for made in (belt, *(made for _, made in caps))]
        self.chains = [chain for made in self._inner for chain in made.chains]
        self._join = join = self._compile("charts", CUBIC=CUBIC, **sphere_constants())
        join["cap_radian_px"] = caps[0][0].radian_px
        self._shown = [self._texture(made.size) for made in self._inner]
        self._seen = [self._texture(made.size) for _, made in caps]
        self._look_up = [
            self._part(_CapLookUp(ctx, PoolUniforms(cap, pooling), seen))
            for (cap, _), seen in zip(caps, self._seen, strict=True)
        ]
        join.hold(**dict(zip(("belt", "upper", "lower"), self._shown, strict=True)))

    def _analyse(self, source: moderngl.Texture) -> None:
        self._belt.hold(source)
        for (_, made), look_up, seen in zip(self._caps, self._look_up, self._seen, strict=True):
            look_up(source)
            made.hold(seen)

    def _choose(self, source: moderngl.Texture, call: Call) -> None:  # noqa: ARG002
        shown, seed = self._shown, call.seed
        self._belt.show(shown[0], call.gaze_px, seed=seed, field_gaze_px=call.field_gaze_px)
        for (cap, made), found in zip(self._caps, shown[1:], strict=True):
            gaze_px, field_gaze_px = (
                cap_gaze_px(self.geometry, cap, at) for at in (call.gaze_px, call.field_gaze_px)
            )
            made.show(found, gaze_px, seed=seed, field_gaze_px=field_gaze_px)

    def _spare(self) -> None:
        for made in self._inner:
            made.release()

    def _finish(self, source: moderngl.Texture, target: moderngl.Texture, call: Call) -> None:  # noqa: ARG002
        self._play(self._joined, source, target)

    def _joined(self, source: moderngl.Texture, target: moderngl.Texture) -> None:
        self._join.run_over(self.size, source=source, target=target)


class _CapLookUp(PicturePass):
    """A pole's surroundings, looked up in the panorama."""

    def __init__(self, ctx: moderngl.Context, pooled: PoolUniforms, cap: moderngl.Texture) -> None:
        super().__init__(ctx, cap.size, pooled)
        self._shader_of_all = self._compile("cap", CUBIC=CUBIC)
        self._shader_of_all.hold(cap=cap)

    def __call__(self, panorama: moderngl.Texture) -> None:
        self._play(self._look_up, panorama)

    def _look_up(self, panorama: moderngl.Texture) -> None:
        self._shader_of_all.run_over(self.size, panorama=panorama)


class ViewPass(Pass):
    """Looks at a panorama in any direction.

    Parameters
    ----------
    panorama_px : (width, height)
        Of the panorama.
    geometry : FlatGeometry
        Of the view.
    """

    def __init__(
        self, ctx: moderngl.Context, panorama_px: tuple[int, int], geometry: FlatGeometry
    ) -> None:
        super().__init__(ctx)
        self._panorama_px = panorama_px
        self.size = geometry.width_px, geometry.height_px
        self._shader_of_all = shader = self._shader(
            "foveation/shaders/view.comp.glsl",
            TILE=TILE,
            SAMPLES=samples_of(geometry, panorama_px[0]),
            BELT_SINE=math.sin(math.radians(NOISE_BELT_DEG)),
            CUBIC=CUBIC,
        )
        shader["centre_px"] = geometry.centre_px
        shader["distance_px"] = geometry.distance_px
        shader["belt_px"] = belt_px(geometry)
        self._turned = shader.uniform("turned")

    def __call__(
        self,
        panorama: moderngl.Texture,
        view: moderngl.Texture,
        shift_px: moderngl.Texture,
        *,
        right_deg: float = 0.0,
        down_deg: float = 0.0,
    ) -> None:
        """Look into a direction: `view` (rgba32f), and its `noise_shift_px` (rg32f)."""
        # OpenGL has a matrix column by column.
        self._turned.write(turn(right_deg, down_deg).T.astype(np.float32).tobytes())
        self._play(self._look, panorama, view, shift_px)

    def _look(
        self, panorama: moderngl.Texture, view: moderngl.Texture, shift_px: moderngl.Texture
    ) -> None:
        check_texture(panorama, "panorama", self._panorama_px, "rgba32f", "rgba8")
        check_texture(view, "view", self.size, "rgba32f")
        check_texture(shift_px, "shift_px", self.size, "rg32f")
        self._shader_of_all.run_over(self.size, panorama=panorama, view=view, shift_px=shift_px)
