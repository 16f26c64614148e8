"""The window as the loop's screen, and the overlay: rings around the gaze, and figures."""

from __future__ import annotations

from collections.abc import Sequence

import moderngl
import numpy as np
from numpy.typing import NDArray

from study_app.desktop.draw import VERTEX, Painter, uniform_of
from study_app.desktop.window import Window
from study_app.live.renderer import GazePlace, GazeState
from study_app.text_image import text_image, typeface_for

RINGS_DEG = (1.0, 5.0, 10.0, 20.0, 30.0)
_TEXT_PX = 16
_LINES = 4
_RINGS = f"""
#version 330
uniform vec2 corner;  // of the picture, from the upper left of the screen
uniform float height;  // of the screen
uniform vec2 centre_px;
uniform float distance_px;
uniform vec2 gaze;
out vec4 colour;
float away(vec2 at) {{
    vec3 look = normalize(vec3(gaze - centre_px, distance_px));
    vec3 ray = normalize(vec3(at - centre_px, distance_px));
    return degrees(2.0 * asin(clamp(0.5 * distance(look, ray), 0.0, 1.0)));
}}
void main() {{
    vec2 at = vec2(gl_FragCoord.x, height - gl_FragCoord.y) - corner;
    float here = away(at);
    float wide = max(abs(away(at + vec2(1, 0)) - here), abs(away(at + vec2(0, 1)) - here));
    const float rings[] = float[]({", ".join(map(str, RINGS_DEG))});
    bool on = distance(at, gaze) < 2.0;
    for (int i = 0; i < rings.length(); i++) on = on || abs(here - rings[i]) < 0.7 * wide;
    if (!on) discard;
    colour = vec4(1.0, 0.85, 0.1, 0.8);
}}
"""


class WindowScreen:
    """Paints pictures pixel for pixel into a window.

    Parameters
    ----------
    corner_px : (x, y)
        Of the picture on the screen, upper left.
    centre_px, distance_px
        Where the normal through the eye meets the picture, and how far the eye is, in its pixels.
    """

    def __init__(
        self, window: Window, corner_px: tuple[int, int], centre_px: GazePlace, distance_px: float
    ) -> None:
        self._window, self._corner, ctx = window, corner_px, window.ctx
        self._painter = Painter(ctx, window.size, 128)
        self._typeface = typeface_for(["".join(map(chr, range(32, 127)))], _TEXT_PX)
        self._wide = min(720, window.size[0])
        self._rings = ctx.program(vertex_shader=VERTEX, fragment_shader=_RINGS)
        self._over = ctx.vertex_array(self._rings, [])
        for name, value in (
            ("corner", corner_px), ("height", window.size[1]), ("centre_px", centre_px),
            ("distance_px", distance_px),
        ):  # fmt: skip
            self._rings[name] = value
        self._gaze = uniform_of(self._rings, "gaze")
        self._text = self._painter.texture(self._written(()))
        self.overlay = False

    @property
    def refresh_hz(self) -> float:
        """Nominal."""
        return self._window.display.refresh_hz

    def now(self) -> float:
        """Return the window's clock."""
        return self._window.now()

    def wait_until(self, t_s: float) -> None:
        """Take events until then."""
        self._window.pump_until(t_s)

    def write(self, lines: Sequence[str]) -> None:
        """Change what the overlay says."""
        self._text.write(self._written(lines).tobytes())

    def announce(self, words: str) -> None:
        """Show words alone until the first picture is ready."""
        self.write([words])
        self._painter.clear()
        self._painter.image(self._text, (0, 0))
        self._painter.finish()
        self.flip()

    def paint(self, picture: moderngl.Texture, gaze_state: GazeState) -> None:
        """Draw the picture, and over it the overlay where it is on."""
        self._painter.clear()
        self._painter.image(picture, self._corner)
        if self.overlay:
            self._gaze.value = gaze_state.gaze_px
            self._painter.over(self._over)
            self._painter.image(self._text, (0, 0))
        self._painter.finish()

    def flip(self) -> float:
        """Swap, and return when that was."""
        return self._window.flip().t_s

    def release(self) -> None:
        """Free what was made."""
        self._over.release()
        self._rings.release()
        self._text.release()
        self._painter.release()

    def _written(self, lines: Sequence[str]) -> NDArray[np.uint8]:
        padded = [*lines, *[""] * _LINES][:_LINES]
        image = text_image(padded, self._typeface, self._wide)
        image[..., :3] = image[..., 3:]  # white on black, through which the picture shines
        image[..., 3] = np.maximum(image[..., 3], 128)
        return image
