"""Scripts that repeat main models in R and in Python, from the tables of a report.

Each is a template of code here. It reads ``tables/`` beside its folder, fits the model with a
package that others wrote, and ends with status 1 where a number of the report differs.
"""

from collections.abc import Iterable, Mapping
from pathlib import Path

from jinja2 import Environment, FileSystemLoader, StrictUndefined

from protocols.tasks.rates import BETWEEN

_TEMPLATES = Path(__file__).parent


def scripts(name: str, *languages: str, **settings: object) -> dict[str, str]:
    """Return scripts by file name.

    Parameters
    ----------
    name : str
        Of the model: what templates, and so scripts, are called.
    languages : str
        Of ``R`` and ``py``.
    settings
        What the templates take: texts, numbers, truths, sequences of them, or None.
    """
    environment = Environment(
        loader=FileSystemLoader(_TEMPLATES),
        autoescape=False,  # it is code, whose texts are literals
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
    )
    environment.filters |= {"R": _r, "py": _py}
    settings |= {"name": name, "between": BETWEEN}
    return {
        f"{name}.{language}": environment.get_template(f"{name}.{language}.jinja").render(settings)
        for language in languages
    }


def lme4_effects(names: Iterable[str], *, own_names: bool = False) -> list[str]:
    """Return the random effects of a model here as lme4 and ordinal write them.

    Intercepts have a group's name. In a condition ``x`` and what is compared follow, and a slope,
    whose group is named last, is along the level. With `own_names` these stand in their place.
    """
    found = []
    for name in names:
        slope, _, group = name.rpartition(" | ")
        inner, within, condition = group.partition(" x ")
        if slope:
            along = slope.partition(" from ")[0] if own_names else "centred"
            found.append(f"(0 + {along} | {group})")
        else:
            condition = condition if own_names else "condition"
            found.append(f"(1 | {inner}:{condition})" if within else f"(1 | {group})")
    return found


def _quoted(text: str) -> str:
    """Return a text as a literal of R and of Python alike."""
    plain = (c.isascii() and c.isprintable() and c not in '"\\' for c in text)
    letters = (c if own else f"\\U{ord(c):08X}" for c, own in zip(text, plain, strict=True))
    return f'"{"".join(letters)}"'


def _py(value: object) -> str:
    if isinstance(value, str):
        return _quoted(value)
    if isinstance(value, Mapping):
        return f"{{{', '.join(f'{_py(k)}: {_py(v)}' for k, v in value.items())}}}"
    if isinstance(value, list | tuple):
        return f"[{', '.join(map(_py, value))}]"
    return repr(value)


def _r(value: object) -> str:
    if isinstance(value, str):
        return _quoted(value)
    if value is None or isinstance(value, bool):
        return "NULL" if value is None else str(value).upper()
    if isinstance(value, Mapping):
        return f"list({', '.join(f'{_quoted(k)} = {_r(v)}' for k, v in value.items())})"
    if isinstance(value, list | tuple):
        return f"c({', '.join(map(_r, value))})"
    return repr(value)
