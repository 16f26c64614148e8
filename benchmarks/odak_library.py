"""odak, the library of Beyond Blur's authors, where it is installed."""

from __future__ import annotations

import contextlib
import importlib
import importlib.util
import tempfile
from typing import Any


def perception() -> Any | None:
    """Return ``odak.learn.perception``, or None where odak is not installed.

    torch gets one thread: more of them wait for each other by counting, and on a busy machine that
    alone was five times the CPU time. odak writes a log beside whoever imports it: into a folder
    that goes, here.
    """
    if importlib.util.find_spec("odak") is None:
        return None
    importlib.import_module("torch").set_num_threads(1)
    with tempfile.TemporaryDirectory() as folder, contextlib.chdir(folder):
        return importlib.import_module("odak.learn.perception")
