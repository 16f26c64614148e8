"""Meaning of a format's keys: the text below each attribute of its class.

Read from the source when a schema or a new study asks for it, and not on import: every command
imports the formats, and few need these texts.
"""

from __future__ import annotations

import ast
import inspect
import sys
from functools import cache
from itertools import pairwise


def key_docs(owner: type) -> dict[str, str]:
    """Return the text below each attribute that a class annotates; empty where there is none."""
    return _of_module(owner.__module__).get(owner.__qualname__.rpartition(".")[2], {})


@cache
def _of_module(name: str) -> dict[str, dict[str, str]]:
    try:
        tree = ast.parse(inspect.getsource(sys.modules[name]))
    except (KeyError, OSError, TypeError):  # made in a session, or a package without sources
        return {}
    return {node.name: _of_class(node) for node in ast.walk(tree) if isinstance(node, ast.ClassDef)}


def _of_class(node: ast.ClassDef) -> dict[str, str]:
    found = {}
    for one, after in pairwise([*node.body, ast.Pass()]):
        if isinstance(one, ast.AnnAssign) and isinstance(one.target, ast.Name):
            text = after.value if isinstance(after, ast.Expr) else None
            said = text.value if isinstance(text, ast.Constant) else None
            found[one.target.id] = inspect.cleandoc(said) if isinstance(said, str) else ""
    return found
