"""What the pipeline raises when its caller, or the machine, is at fault."""


class InputError(ValueError):
    """An array, parameter or name that breaks a stated rule.

    The message names the argument, what must hold and what was found.
    """


class MissingExtraError(InputError):
    """What was asked for needs a package that is not installed; the message names the extra."""


class GLUnavailableError(RuntimeError):
    """No OpenGL that can run the pipeline; the message says what was found and the cure."""
