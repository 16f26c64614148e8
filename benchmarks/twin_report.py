"""Report of the twins' tests for `script/prove-gpu`: a plug-in of pytest.

``-p benchmarks.twin_report --twins-to FILE`` leaves out tests that need no GPU. It writes one line
of JSON with the names of all tests, and one for each test that ended. A failure comes with the
largest difference between the arrays that its test compared.
"""

from __future__ import annotations

import ast
import inspect
import json
import textwrap
from collections.abc import Generator, Iterator
from pathlib import Path
from types import FrameType
from typing import Any

import numpy as np
import pytest

OPENS_CONTEXTS = "create_context"  # in the text of a file of tests
_LIBRARIES = "site-packages"
SAID = 400  # characters of a failure
_PURE = (
    ast.Name, ast.Attribute, ast.Subscript, ast.Slice, ast.Constant, ast.UnaryOp, ast.BinOp,
    ast.Compare, ast.Tuple, ast.expr_context, ast.operator, ast.unaryop, ast.cmpop,
)  # fmt: skip


def pytest_addoption(parser: pytest.Parser) -> None:
    """Add ``--twins-to``."""
    parser.addoption("--twins-to", type=Path, required=True, metavar="FILE")


def pytest_configure(config: pytest.Config) -> None:
    """Write from the process that hears of every test; the others only look at failures."""
    if not hasattr(config, "workerinput"):
        config.pluginmanager.register(Writer(config.getoption("--twins-to")), "twin-writer")


@pytest.hookimpl(trylast=True)
def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Leave out what needs no GPU."""
    kept = [item for item in items if needs_gpu(item)]
    config.hook.pytest_deselected(items=[item for item in items if item not in kept])
    items[:] = kept


def needs_gpu(item: pytest.Item) -> bool:
    """True if a test asks for a context, or its file opens contexts of its own."""
    asked = getattr(item, "fixturenames", ())
    return "shared_gl_context" in asked or OPENS_CONTEXTS in item.path.read_text(encoding="utf-8")


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport(call: pytest.CallInfo[None]) -> Generator[None, Any, Any]:
    """Add the largest difference to the report of a failure."""
    report = yield
    if report.failed and call.excinfo is not None:
        frames = [entry.frame.raw for entry in call.excinfo.traceback]
        found = largest_difference(frames)
        said = str(call.excinfo.value).strip()[:SAID] or call.excinfo.typename
        report.user_properties.append(("twins", {"largest": found, "says": said}))
    return report


class Writer:
    """Lines of JSON, each written when it is known."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._named = False

    def pytest_collection_finish(self, session: pytest.Session) -> None:
        """Name the tests."""
        self._name([item.nodeid for item in session.items])

    @pytest.hookimpl(optionalhook=True)
    def pytest_xdist_node_collection_finished(self, node: object, ids: list[str]) -> None:  # noqa: ARG002
        """Name the tests, as the first process has found them."""
        self._name(ids)

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        """Tell how a test ended; what fails before or after it counts as its failure."""
        if report.when != "call" and report.passed:
            return
        found = dict(report.user_properties).get("twins", {})
        self._write({"test": report.nodeid, "outcome": report.outcome, **found})  # type: ignore[dict-item]

    def _name(self, names: list[str]) -> None:
        if names and not self._named:
            self._named = True
            self._write({"tests": names})

    def _write(self, line: dict[str, Any]) -> None:
        with self._path.open("a", encoding="utf-8") as file:
            file.write(json.dumps(line) + "\n")


def largest_difference(frames: list[FrameType]) -> float | None:
    """Largest difference of arrays that the innermost frame with any compares; None without.

    Arrays are compared where the source subtracts them inside ``abs``, hands them to
    ``np.testing.assert_...`` or ``np.array_equal``, or compares their ``tobytes()``.
    """
    for frame in reversed(frames):
        if _LIBRARIES in frame.f_code.co_filename:
            continue
        found = [
            float(np.nanmax(np.abs(np.subtract(one, other, dtype=np.float64))))
            for one, other in _compared(frame)
        ]
        if found:
            return max(found)
    return None


def _compared(frame: FrameType) -> Iterator[tuple[Any, Any]]:
    try:
        tree = ast.parse(textwrap.dedent(inspect.getsource(frame.f_code)))
    except (OSError, SyntaxError):
        return
    for node in ast.walk(tree):
        match node:
            case ast.Call(func=function, args=[ast.BinOp(left, ast.Sub(), right)]) if (
                _name_of(function) == "abs"
            ):
                pair = left, right
            case ast.Call(func=function, args=[left, right, *_]) if _name_of(function).startswith(
                ("assert_", "array_equal")
            ):
                pair = left, right
            case ast.Compare(
                ast.Call(func=ast.Attribute(value=left, attr="tobytes")),
                [ast.Eq()],
                [ast.Call(func=ast.Attribute(value=right, attr="tobytes"))],
            ):
                pair = left, right
            case _:
                continue
        arrays = [_value(side, frame) for side in pair]
        if all(_is_number(array) for array in arrays) and any(np.ndim(a) for a in arrays):
            yield arrays[0], arrays[1]


def _name_of(function: ast.expr) -> str:
    return str(getattr(function, "attr", getattr(function, "id", "")))


def _value(expression: ast.expr, frame: FrameType) -> Any:
    """Value of an expression without calls in a frame; None where it cannot be known."""
    if not all(isinstance(node, _PURE) for node in ast.walk(expression)):
        return None
    try:
        code = compile(ast.Expression(expression), "<compared>", "eval")
        return eval(code, frame.f_globals, frame.f_locals)
    except Exception:  # not there yet, or no longer
        return None


def _is_number(array: Any) -> bool:
    try:
        return np.asarray(array).dtype.kind in "biuf" and np.size(array) > 0
    except Exception:
        return False
