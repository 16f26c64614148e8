"""Buttons of the first gamepad, as key presses; a machine without one loses nothing."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

_BUTTONS = {
    "A": "pad_a",
    "B": "pad_b",
    "X": "pad_x",
    "Y": "pad_y",
    "DPAD_LEFT": "pad_left",
    "DPAD_RIGHT": "pad_right",
    "DPAD_UP": "pad_up",
    "DPAD_DOWN": "pad_down",
    "START": "pad_start",
    "BACK": "pad_back",
    "LEFT_BUMPER": "pad_lb",
    "RIGHT_BUMPER": "pad_rb",
}


class Gamepad:
    """Turns buttons that went down since the last poll into key names."""

    def __init__(self, glfw: Any) -> None:
        self._glfw = glfw
        self._buttons = [
            (getattr(glfw, f"GAMEPAD_BUTTON_{constant}"), name)
            for constant, name in _BUTTONS.items()
        ]
        self._down: frozenset[str] = frozenset()

    def poll(self, press: Callable[[str], None]) -> None:
        """Call `press` with the name of every button that went down."""
        glfw = self._glfw
        if not glfw.joystick_is_gamepad(glfw.JOYSTICK_1):
            return
        state = glfw.get_gamepad_state(glfw.JOYSTICK_1)
        if state is None:
            return
        down = frozenset(name for index, name in self._buttons if state.buttons[index])
        for name in sorted(down - self._down):
            press(name)
        self._down = down
