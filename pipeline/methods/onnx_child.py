"""Program of its own that runs one ONNX network: questions come by stdin, answers go to stdout.

`onnx_files.BoundedNetwork` starts it, and ends it where it takes too much memory or time.
"""

from __future__ import annotations

import os
import pickle
import signal
import sys
from typing import Any, BinaryIO

_OUTPUTS_MOST = 1 << 24
"""Bytes that outputs may hold, beside 16 times those of the inputs."""


def serve_network() -> None:
    """Open the network that is named, then run it on each question."""
    answers = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)  # what a library prints is no answer
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # who asks ends this
    session: Any = None
    while True:
        try:
            outputs, feed, seconds = pickle.load(sys.stdin.buffer)
        except EOFError:
            return
        if sys.platform != "win32":  # nobody else is left to end this, if who asks was killed
            signal.alarm(int(seconds) + 5)
        try:
            if session is None:
                session = _opened(feed)
                found: Any = _described(session)
            else:
                found = session.run(outputs, feed)
                held = sum(one.nbytes for one in found if hasattr(one, "nbytes"))
                if held > _OUTPUTS_MOST + 16 * sum(one.nbytes for one in feed.values()):
                    raise ValueError(f"its outputs hold {held} bytes")
        except Exception as error:  # its own classes are not public
            _answer(answers, (False, str(error) or type(error).__name__))
        else:
            _answer(answers, (True, found))
        if sys.platform != "win32":
            signal.alarm(0)


def _answer(answers: BinaryIO, answer: object) -> None:
    pickle.dump(answer, answers, protocol=5)
    answers.flush()


def _opened(path: str) -> Any:
    import onnxruntime

    options = onnxruntime.SessionOptions()
    options.log_severity_level = 4  # what is wrong comes as an exception
    # One order of summation on any number of cores: same input, same bytes.
    options.use_deterministic_compute = True
    return onnxruntime.InferenceSession(
        path, options, providers=["CPUExecutionProvider"], enable_fallback=0
    )  # a second try would print to the terminal


def _described(session: Any) -> object:
    sides = (session.get_inputs(), session.get_outputs())
    tensors = [[(one.name, one.type, one.shape) for one in side] for side in sides]
    return (*tensors, dict(session.get_modelmeta().custom_metadata_map))


if __name__ == "__main__":
    serve_network()
