"""Turns what pydantic found wrong into places, values and cures that a person can act on."""

from __future__ import annotations

import re
import types
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Annotated, Any, Union, get_args, get_origin

from pydantic import BaseModel, ValidationError
from pydantic_core import ErrorDetails

from protocols.errors import Problem, did_you_mean
from protocols.study_file.session_schema import KEY_PATTERN
from protocols.units import CONVERSIONS, UNIT_OF_SUFFIX, form_of

_KEYS = ("left", "right", "up", "down", "space", "enter", "escape", "tab", "backspace")
_ALSO_CALLED = {
    "": "space",
    "blank": "space",
    "return": "enter",
    "esc": "escape",
    "back": "backspace",
    "bksp": "backspace",
}
_NUMBER_BLOCK = re.compile(r"(?:num|numpad|numlock|kp|keypad|numerickeypad|np|pad)([0-9]|enter)")
_MODIFIERS = re.compile(r"[lr]?(left|right)?(shift|ctrl|control|alt|option|cmd|command|meta)[lr]?")


def cure_for_key_name(name: str) -> str:
    """Return the cure for a key that other programs call `name`: ``num_4`` is our ``kp_4``."""
    low = name.strip().lower()
    plain = re.sub(r"[^a-z0-9]", "", low) if len(low) > 1 else low
    if _MODIFIERS.fullmatch(plain.removesuffix("key")):
        return "; shift, control and alt give no answer: take letters, such as 'z' and 'm'"
    if re.search("pointer|mouse|click|touch|tap$|^lmb|^rmb", plain):
        return "; a click or a touch is no key: pointer = true in [response] takes them"
    block = _NUMBER_BLOCK.fullmatch(plain) or re.fullmatch(r"\[([0-9])\]", low)
    if block:
        return f"; did you mean {'enter' if block[1] == 'enter' else f'kp_{block[1]}'!r}?"
    for meant in (low, plain, re.sub("arrow|key|bar|digit", "", plain)):
        meant = _ALSO_CALLED.get(meant, meant)
        if re.match(KEY_PATTERN, meant):
            return f"; did you mean {meant!r}?"
    return did_you_mean(plain, _KEYS)


def named_unit(name: str) -> tuple[str, str]:
    """Split ``gap_s`` into ``gap`` and ``s``; the unit is empty where there is none."""
    stem, _, last = name.rpartition("_")
    return (stem, last) if stem and last in UNIT_OF_SUFFIX else (name, "")


def cure_for_key(key: str, value: object, known: Iterable[str]) -> str:
    """Return the cure for an unknown key: another unit, a missing unit, or a near name."""
    stem, unit = named_unit(key)
    names = list(known)
    for name in names:
        right_stem, right_unit = named_unit(name)
        if right_unit and right_unit != unit and right_stem in {stem, key}:
            factor = CONVERSIONS.get((unit, right_unit))
            example = ""
            if factor and isinstance(value, (int, float)) and not isinstance(value, bool):
                example = f": {name} = {value * factor:.6g}"
            return f"; did you mean {name!r} ({UNIT_OF_SUFFIX[right_unit]}){example}?"
    return did_you_mean(key, names)


MOST_PROBLEMS = 150
"""Mistakes of one file that are told; their count stands among the lines that a command prints."""
_WANTED_TYPE = {
    "float_type": "a number",
    "int_type": "a whole number",
    "int_from_float": "a whole number",
    "string_type": "text in quotes",
    "bool_type": "true or false",
    "tuple_type": "a list",
    "list_type": "a list",
    "dict_type": "a table",
    "model_type": "a table",
    "model_attributes_type": "a table",
    "finite_number": "a finite number",
}
_BOUNDS = {
    "greater_than": ("greater than", "gt"),
    "greater_than_equal": ("at least", "ge"),
    "less_than": ("less than", "lt"),
    "less_than_equal": ("at most", "le"),
    "multiple_of": ("a multiple of", "multiple_of"),
}
_LENGTHS = {
    "too_short": ("least", "min_length", "entries"),
    "too_long": ("most", "max_length", "entries"),
    "string_too_short": ("least", "min_length", "characters"),
    "string_too_long": ("most", "max_length", "characters"),
}


def problems_of(error: ValidationError, raw: object, model: type[BaseModel]) -> list[Problem]:
    """Return one problem per place in the order of the file's model, then those between places.

    Parameters
    ----------
    error : ValidationError
        What validating `raw` against `model` raised.
    raw : object
        The parsed file: tables as dicts.
    model : type
        The class of the whole file.
    """
    found: dict[str, list[str]] = {}
    between: list[Problem] = []  # what the model checks itself: every mistake is one of its own
    details = error.errors()
    if len(details) > MOST_PROBLEMS:
        left = f"{len(details) - MOST_PROBLEMS:,} more mistakes; mend these first"
        between.append(Problem("", left))
    missing = [str(detail["loc"][-1]) for detail in details if detail["type"] == "missing"]
    for detail in details[:MOST_PROBLEMS]:
        for problem in _problems(detail, raw, model, missing):
            if not detail["loc"]:
                between.append(problem)
                continue
            messages = found.setdefault(problem.place, [])
            if problem.message not in messages:
                messages.append(problem.message)
    joined = [Problem(place, _either(messages)) for place, messages in found.items()]
    return joined + list(dict.fromkeys(between))


def _either(messages: Sequence[str]) -> str:
    """Join what the members of a union of types said about one value."""
    wanted = [message.partition(" (got ") for message in messages]
    if len(messages) > 1 and all(head.startswith("must be ") for head, _, _ in wanted):
        heads = [wanted[0][0], *(head.removeprefix("must be ") for head, _, _ in wanted[1:])]
        return " or ".join(heads) + max(("".join(rest) for _, *rest in wanted), key=len)
    return "; ".join(messages)


def _problems(
    detail: ErrorDetails, raw: object, model: type[BaseModel], missing: Sequence[str]
) -> Iterator[Problem]:
    kind, context = detail["type"], detail.get("ctx", {})
    if kind == "value_error" and not detail["loc"]:  # StudyProtocol's own checks: one line each
        for line in str(context["error"]).splitlines():
            place, colon, message = line.partition(": ")
            yield Problem(place, message) if colon and " " not in place else Problem("", line)
        return
    place, owner = _locate(detail["loc"], raw, model)
    if kind in {"union_tag_invalid", "union_tag_not_found"}:
        place = f"{place}.{_tag(context)}"
    if message := in_words(detail, owner, missing):
        yield Problem(place, message)


def in_words(
    detail: ErrorDetails, owner: type[BaseModel] | None = None, missing: Sequence[str] = ()
) -> str:
    """Return the rule, the value that was found, and a cure; empty where another mistake says it.

    `owner` is the model of the key that is wrong; an unknown one is rather a `missing` one.
    """
    kind, found, context = detail["type"], detail["input"], detail.get("ctx", {})
    key = str(detail["loc"][-1]) if detail["loc"] else ""
    if kind == "missing" and isinstance(detail["loc"][-1], int):  # a list of fixed length
        return f"must have {detail['loc'][-1] + 1} entries or more (got {_show(found)})"
    if kind in {"missing", "union_tag_not_found"}:
        return "missing"
    if kind == "extra_forbidden":
        known = list(owner.model_fields) if owner else []
        lacking = [name for name in known if name in missing]
        cure = cure_for_key(key, found, lacking) or cure_for_key(key, found, known)
        return "unknown key" + (cure or f"; known keys: {', '.join(known)}" * bool(known))
    if kind in _BOUNDS:
        word, name = _BOUNDS[kind]
        unit = UNIT_OF_SUFFIX.get(named_unit(key)[1], "")
        bound = f"{context[name]:,.10g}" + (f" {unit}" if unit else "")
        return f"must be {word} {bound} (got {_show(found)})"
    if kind in _WANTED_TYPE:
        return f"must be {_WANTED_TYPE[kind]} (got {_show(found)})"
    if kind == "literal_error":
        choices = re.findall("'([^']*)'", context["expected"])
        near = did_you_mean(found, choices)
        return f"must be {context['expected']} (got {_show(found)}){near}"
    if kind == "union_tag_invalid":
        tags = context["expected_tags"].replace("'", "").split(", ")
        near = did_you_mean(context["tag"], tags)
        return f"must be one of {', '.join(tags)} (got {_show(context['tag'])}){near}"
    if kind == "string_pattern_mismatch":
        pattern = context["pattern"]
        meant = cure_for_key_name(str(found)) if pattern == KEY_PATTERN else ""
        return f"must be {form_of(pattern)} (got {_show(found)}){meant}"
    if kind in _LENGTHS:
        word, name, what = _LENGTHS[kind]
        bound = context.get(name, 1)
        if kind == "too_short" and isinstance(found, (tuple, list)) and len(found) >= bound:
            return ""  # an entry is wrong, and said to be: there are enough
        return f"must have at {word} {bound} {what} (got {_show(found)})"
    if kind == "value_error":
        return str(context["error"])
    return f"{detail['msg']} (got {_show(found)})"


def _tag(context: Mapping[str, object]) -> str:
    """Return the key that says which of several models a table is: `kind`, or a rule's `rule`."""
    return str(context.get("discriminator", "kind")).strip("'")


def _show(value: object) -> str:
    """Return a value as TOML writes it, cut short."""
    if isinstance(value, bool):
        text = str(value).lower()
    elif isinstance(value, Mapping):
        text = "{" + ", ".join(f"{key} = {_show(entry)}" for key, entry in value.items()) + "}"
    elif isinstance(value, (tuple, list)):
        text = "[" + ", ".join(_show(entry) for entry in value) + "]"
    else:
        text = repr(value)
    return text if len(text) <= 60 else text[:57] + "..."


def _locate(
    loc: tuple[int | str, ...], raw: object, model: type[BaseModel]
) -> tuple[str, type[BaseModel] | None]:
    """Return the place as the file's author would write it, and the model that owns the key.

    pydantic puts the names of union members into its locations; they are not in the file.
    """
    place, owner = "", None
    annotation: object = model
    for index, step in enumerate(loc):
        models = [entry for entry in _members(annotation) if _is_model(entry)]
        last = index == len(loc) - 1
        if isinstance(step, int):
            if not isinstance(raw, (tuple, list)) or step >= len(raw):
                continue
            place, raw = f"{place}[{step}]", raw[step]
            annotation = _item(annotation, step)
            continue
        owner = _choose(models, raw) or owner
        if len(models) > 1:  # the tag of a discriminated union, which the file has no key for
            annotation = owner
            continue
        in_file = isinstance(raw, Mapping) and step in raw
        field = step in owner.model_fields if owner and models else False
        if not in_file and not (last and (field or not models)):
            continue
        if not in_file and last and not field:
            continue
        place = f"{place}.{step}" if place else step
        raw = raw.get(step) if isinstance(raw, Mapping) else None
        if owner and models and field:
            annotation = owner.model_fields[step].annotation
        else:
            annotation = _item(annotation, step)
    return place, owner


def _is_model(entry: object) -> bool:
    return isinstance(entry, type) and issubclass(entry, BaseModel)


def _members(annotation: object) -> list[Any]:
    """Return the alternatives of a type, with wrappers taken off."""
    origin = get_origin(annotation)
    if origin is Annotated:
        return _members(get_args(annotation)[0])
    if origin in (Union, types.UnionType):
        return [member for part in get_args(annotation) for member in _members(part)]
    return [annotation]


def _item(annotation: object, step: int | str) -> object:
    """Return the type of an entry of a list or table."""
    for member in _members(annotation):
        arguments = get_args(member)
        if get_origin(member) is tuple and isinstance(step, int):
            several = len(arguments) > 1 and arguments[1] is not Ellipsis
            return arguments[min(step, len(arguments) - 1)] if several else arguments[0]
        if get_origin(member) is dict and isinstance(step, str):
            return arguments[1]
    return None


def _choose(models: Sequence[type[BaseModel]], raw: object) -> type[BaseModel] | None:
    """Return the member of a discriminated union that `raw` says it is."""
    if len(models) > 1 and isinstance(raw, Mapping):
        for entry in models:
            for tag in ("kind", "rule"):
                field = entry.model_fields.get(tag)
                if field and raw.get(tag) in get_args(field.annotation):
                    return entry
    return models[0] if models else None
