"""The base class of every format, and the types that carry unit and range.

The meaning of a key is the text below its attribute. It is read from the source when a schema or a
new study asks for it, and not on import: every command imports the formats, and few need these
texts.
"""

from __future__ import annotations

import ast
import inspect
import re
import sys
import unicodedata
from collections.abc import Mapping
from functools import cache
from itertools import pairwise
from typing import Annotated, Any, ClassVar, TypeAlias, TypeVar

from pydantic import (
    AfterValidator,
    BaseModel,
    ConfigDict,
    Field,
    GetJsonSchemaHandler,
    SerializerFunctionWrapHandler,
    StringConstraints,
    model_serializer,
)
from pydantic.json_schema import JsonSchemaValue
from pydantic_core import CoreSchema

from protocols.limits import FIXED


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


class Model(BaseModel):
    """A frozen record: unknown keys, wrong types and numbers that are not finite are refused."""

    model_config = ConfigDict(frozen=True, extra="forbid", strict=True, allow_inf_nan=False)

    @classmethod
    def __get_pydantic_json_schema__(
        cls, core_schema: CoreSchema, handler: GetJsonSchemaHandler
    ) -> JsonSchemaValue:
        """Return the schema, with what each key means."""
        schema = handler(core_schema)
        keys = handler.resolve_ref_schema(schema).get("properties", {})
        for owner in reversed(cls.__mro__):  # the last class to annotate a key has the word
            for key, text in key_docs(owner).items():
                if key in keys:
                    keys[key].pop("description", None)
                    keys[key] |= {"description": text} if text else {}
        return schema


class ExtendedModel(Model):
    """An entry with keys that were added later: at their defaults, its hash is what it was."""

    added_later: ClassVar[tuple[str, ...]] = ()

    @model_serializer(mode="wrap")
    def _without_new_defaults(self, plain: SerializerFunctionWrapHandler) -> dict[str, Any]:
        fields = type(self).model_fields
        unused = {
            key
            for key in self.added_later
            if getattr(self, key) == fields[key].get_default(call_default_factory=True)
        }
        return {key: value for key, value in plain(self).items() if key not in unused}


IN_WORDS: dict[str, str] = {
    r"[A-Za-z0-9_-]{2,32}": "2 to 32 letters, digits, dashes and underscores, like 'P01'"
}
"""Form that a text must have, within a message, by its pattern; first that of `code_pattern`."""


def form_of(pattern: str) -> str:
    """Return the form that a text must have, within a message."""
    return IN_WORDS.get(pattern, f"text that matches the regular expression {pattern}")


def matching(pattern: str, words: str, max_length: int | None = None) -> StringConstraints:
    """Return the rule that a text matches `pattern`; messages say `words` instead."""
    IN_WORDS[pattern] = words
    return StringConstraints(pattern=pattern, max_length=max_length)


NAME_PATTERN = r"^[a-z0-9]+([-_][a-z0-9]+)*$"
"""Lower-case words joined by single dashes or underscores: `__` stays free to join names."""

NAME_LENGTH = 48
DEVICE = re.compile(r"con|prn|aux|nul|com[0-9]|lpt[0-9]", re.IGNORECASE)
"""Names that Windows keeps for devices: it holds no file or folder that is called so."""
NAME_IN_WORDS = "lower-case words and numbers joined by single dashes or underscores"
Name = Annotated[str, matching(NAME_PATTERN, NAME_IN_WORDS, NAME_LENGTH)]


def require_visible(text: str) -> str:
    """Refuse texts of which nothing can be seen: spaces, line ends, marks of no width."""
    if not any(unicodedata.category(char)[0] in "LNPS" and char not in _BLANK for char in text):
        raise ValueError(f"must have at least one character that can be seen (got {text!a})")
    return text


_BLANK = "\u115f\u1160\u2800\u3164\uffa0"
"""Hangul fillers and the empty Braille pattern: letters and symbols by category."""
Text = Annotated[str, StringConstraints(min_length=1), AfterValidator(require_visible)]
Sha256 = Annotated[
    str, matching(r"^[0-9a-f]{64}$", "a SHA-256 hash: 64 digits and letters from a to f")
]
ParticipantCode = Annotated[
    str,
    matching(
        r"^[A-Za-z0-9]+([-_][A-Za-z0-9]+)*$",
        "letters and digits, joined by single dashes or underscores, like 'P01'",
        32,
    ),
]
LanguageCode = Annotated[
    str,
    matching(r"^[a-z]{2,3}(-[A-Za-z0-9]{2,8})*$", "a language's code, like 'en' or 'pt-BR'"),
]

N = TypeVar("N", int, float)


def storable(value: N) -> N:
    """Refuse numbers that no table holds exactly, and no sum of which is finite."""
    if abs(value) > 2**53:
        raise ValueError("must be at most 2^53, about 9e15")
    return value


def pixels(value: int) -> int:
    """Refuse edges that no screen and no picture has."""
    if value > (most := FIXED["edge"].most):
        raise ValueError(f"must be at most {most:,} px")
    return value


def meant_parameters(value: dict[str, object]) -> dict[str, object]:
    """Refuse parameters that no scene and no method means; these check them more closely."""
    for name, entry in value.items():
        for one in entry if isinstance(entry, tuple) else (entry,):
            most = 1e9 if isinstance(one, float) else 2**63
            if isinstance(one, int | float) and abs(one) > most:
                raise ValueError(f"{name} must lie between -{most:g} and {most:g}")
    return value


# Bounds are far from what laboratories do: what lies beyond is a slip, and may take a machine.
Seconds = Annotated[float, Field(ge=1e-4, le=1e6, json_schema_extra={"unit": "s"})]
SecondsOrNone = Annotated[float, Field(ge=0, le=1e6, json_schema_extra={"unit": "s"})]
"""Zero means that the wait is left out."""
Stamp = Annotated[float, Field(json_schema_extra={"unit": "s"}), AfterValidator(storable)]
"""A moment on one stated clock; its zero is arbitrary."""
Hertz = Annotated[float, Field(ge=1e-3, le=1e6, json_schema_extra={"unit": "Hz"})]
Degrees = Annotated[float, Field(ge=1e-3, lt=180, json_schema_extra={"unit": "deg"})]
"""Degrees of visual angle."""
SignedDegrees = Annotated[float, Field(ge=-3600, le=3600, json_schema_extra={"unit": "deg"})]
Pixels = Annotated[int, Field(gt=0, json_schema_extra={"unit": "px"}), AfterValidator(pixels)]
EvenPixels = Annotated[
    int,
    Field(gt=0, multiple_of=2, json_schema_extra={"unit": "px"}),
    AfterValidator(pixels),
]
"""Even, so that a centred picture lies on whole pixels."""
FocalPixels = Annotated[float, Field(ge=1e-2, le=1e6, json_schema_extra={"unit": "px"})]
Millimetres = Annotated[float, Field(ge=0.1, le=1e5, json_schema_extra={"unit": "mm"})]
Metres = Annotated[float, Field(ge=1e-6, le=1e6, json_schema_extra={"unit": "m"})]
Luminance = Annotated[float, Field(ge=0, le=1e6, json_schema_extra={"unit": "cd/m2"})]
Share = Annotated[float, Field(ge=0, le=1, json_schema_extra={"unit": "share of 1"})]
RimPixels = Annotated[int, Field(ge=0, le=4, json_schema_extra={"unit": "px"})]
"""Pixels of the clip, as it is rendered."""
Count = Annotated[int, Field(ge=0), AfterValidator(storable)]
"""Count or number of what was recorded, from 0."""
Magnitude = Annotated[float, Field(ge=0), AfterValidator(storable)]
"""A measured number that cannot be negative, such as a duration."""
Positive = Annotated[int, Field(ge=1, le=1_000_000)]
Few = Annotated[int, Field(ge=1, le=1000)]
Factor = Annotated[float, Field(ge=1e-9, le=1e9)]
Number = Annotated[float, Field(ge=-1e9, le=1e9)]
StoredNumber = Annotated[float, Field(ge=-4e38, le=4e38)]
Seed = Annotated[int, Field(ge=0, le=2**63 - 1)]
WebSeed = Annotated[int, Field(ge=0, le=2**53 - 1)]
"""Seed or key in a browser: JavaScript holds such whole numbers exactly."""
Vector3 = tuple[Number, Number, Number]

Scalar: TypeAlias = bool | int | float | str
Condition: TypeAlias = Mapping[str, Scalar]
"""Condition of a stimulus or a trial, column by column: ``scene``, ``method``, ..."""
Parameters: TypeAlias = Annotated[
    dict[str, Scalar | tuple[Scalar, ...]], AfterValidator(meant_parameters)
]
"""Free parameters of a scene or a method; whoever is named there checks them."""

UNIT_OF_SUFFIX: dict[str, str] = {
    "s": "seconds",
    "ms": "milliseconds",
    "us": "microseconds",
    "min": "minutes",
    "hz": "hertz",
    "fps": "frames per second",
    "deg": "degrees",
    "rad": "radians",
    "arcmin": "minutes of arc",
    "px": "pixels",
    "mm": "millimetres",
    "cm": "centimetres",
    "m": "metres",
    "share": "share of 1",
    "percent": "percent",
    "pct": "percent",
    "mib": "mebibytes",
    "gib": "gibibytes",
}
"""Unit by the last word of a name."""

CONVERSIONS: dict[tuple[str, str], float] = {
    ("ms", "s"): 1e-3,
    ("us", "s"): 1e-6,
    ("min", "s"): 60.0,
    ("rad", "deg"): 57.29577951308232,
    ("arcmin", "deg"): 1 / 60,
    ("cm", "mm"): 10.0,
    ("m", "mm"): 1e3,
    ("mm", "m"): 1e-3,
    ("cm", "m"): 1e-2,
    ("percent", "share"): 1e-2,
    ("pct", "share"): 1e-2,
    ("gib", "mib"): 1024.0,
    ("khz", "hz"): 1e3,
}
"""Factors that turn a value with a wrong unit into the right one, for the cure in a message."""
