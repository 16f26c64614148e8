"""Names of keys and of a gamepad's buttons, as protocols write them."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

_NAMED = {
    "LEFT": "left",
    "RIGHT": "right",
    "UP": "up",
    "DOWN": "down",
    "SPACE": "space",
    "ENTER": "enter",
    "KP_ENTER": "enter",
    "ESCAPE": "escape",
    "TAB": "tab",
    "BACKSPACE": "backspace",
}


def key_name(glfw: Any, key: int, scancode: int) -> str:
    """Return a key's name in protocols, or an empty string for keys that have none.

    Letters and digits are those printed on the key, whatever the layout of the keyboard.
    """
    for constant, name in _NAMED.items():
        if key == getattr(glfw, f"KEY_{constant}"):
            return name
    if glfw.KEY_F1 <= key <= glfw.KEY_F12:
        return f"f{key - glfw.KEY_F1 + 1}"
    if glfw.KEY_KP_0 <= key <= glfw.KEY_KP_9:
        return f"kp_{key - glfw.KEY_KP_0}"
    printed = glfw.get_key_name(key, scancode)
    text = (printed.decode("utf-8", "replace") if isinstance(printed, bytes) else printed) or ""
    if len(text) == 1 and text.isascii() and text.isalnum():
        return text.lower()
    if glfw.KEY_A <= key <= glfw.KEY_Z or glfw.KEY_0 <= key <= glfw.KEY_9:
        return chr(key).lower()
    return ""


def edited(text: str, typed: str) -> str:
    """Return `text` after `typed`, in which ``\\b`` takes the last character away."""
    for char in typed:
        if char == "\b":
            text = text[:-1]
        elif char.isprintable():
            text += char
    return text


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
    """Turns buttons of the first gamepad that went down since the last poll into key names.

    A machine without one loses nothing.
    """

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
