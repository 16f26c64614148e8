"""Studies leave for browsers and come home by commands; what a browser cannot do is said first."""

from __future__ import annotations

import json
import zipfile

import pytest
from forked import METAMERLAB  # noqa: F401
