"""What a new study says of a user's own scenes and methods: the text of its file."""

from __future__ import annotations

import json
import re
from collections.abc import Collection, Sequence
from dataclasses import dataclass

from protocols.errors import StudyError
from protocols.units import NAME_LENGTH

REFERENCE = "reference"
PLAINLY_WORSE = "push-pull"
"""What catch trials show beside the true view, where the study has it."""


@dataclass(frozen=True)
class OwnScene:
    """One scene of a new study.

    Parameters
    ----------
    name, label : str
        As in the study.
    lines : tuple of str
        Everything else of its section, TOML.
    """

    name: str
    label: str
    lines: tuple[str, ...]


@dataclass(frozen=True)
class OwnMethod:
    """One method of a new study; `method` is its name in the registry where that differs."""

    name: str
    method: str | None = None


BUILT_IN_SCENES = ("garden", "shed")
BUILT_IN_METHODS = tuple(map(OwnMethod, ("coherence-transport", PLAINLY_WORSE, REFERENCE)))


@dataclass(frozen=True)
class OwnStimuli:
    """The scenes and methods that take the place of a template's; empty: the template's stay.

    The study's planned test compares the first method with the second; the true view is neither.
    """

    scenes: tuple[OwnScene, ...] = ()
    methods: tuple[OwnMethod, ...] = ()

    def __post_init__(self) -> None:
        if len(self.methods) == 1:
            raise StudyError(
                f"--methods: must name two or more, joined by commas (got {self.methods[0].name!r})"
            )

    def sections(self) -> dict[str, str]:
        """Return the parts of a template that differ from it, by name."""
        found = {}
        if self.scenes:
            found["scenes"] = "\n\n".join(map(_scene, self.scenes))
        if self.methods:
            found["methods"] = "\n\n".join(map(_method, self.methods))
            if not any(method.name == REFERENCE for method in self.methods):
                found["catch"] = (
                    "# No catch trials: they need a pair whose better one is known, such as"
                    " 'reference' and\n# another method (--methods reference,...)."
                )
        return found

    def words(self) -> dict[str, str]:
        """Return what templates have in the place of ``@WORD@``."""
        scenes = [scene.name for scene in self.scenes] or list(BUILT_IN_SCENES)
        methods = self.methods or BUILT_IN_METHODS
        judged = [method.name for method in methods if method.name != REFERENCE]
        worse = PLAINLY_WORSE if PLAINLY_WORSE in judged else judged[-1]
        return {
            "PRACTICE_SCENE": scenes[0],
            "SCENES": json.dumps(scenes),
            "PRIMARY": judged[0],
            "AGAINST": (*judged[1:], REFERENCE)[0],
            "CATCH_WORSE": worse,
        }


def quoted(text: str) -> str:
    """Return a text as TOML writes it."""
    return json.dumps(text, ensure_ascii=False).replace("\x7f", "\\u007f")


def unused_name(text: str, taken: Collection[str]) -> str:
    """Return `text` as a name of a study may be, with a number where it is taken already."""
    plain = re.sub(r"[^a-z0-9]+", "-", text.lower()).strip("-")[: NAME_LENGTH - 3].strip("-")
    plain = plain or "own"
    numbered = (f"{plain}-{number}" for number in range(2, 100))
    return plain if plain not in taken else next(name for name in numbered if name not in taken)


def methods_of(text: str, known: Sequence[str]) -> tuple[OwnMethod, ...]:
    """Return the methods that ``a,b,onnx:FILE`` names.

    Parameters
    ----------
    text : str
        Names of the registry, joined by commas.
    known : sequence of str
        What of it has no path: a method of this name keeps it.

    Raises
    ------
    StudyError
        If one is named twice, or an entry is empty.
    """
    found: list[OwnMethod] = []
    for entry in (part.strip() for part in text.split(",")):
        if not entry:
            raise StudyError(f"--methods: must be names joined by commas (got {text!r})")
        if entry in [each.method or each.name for each in found]:
            raise StudyError(f"--methods: names {entry!r} twice; name each once")
        if entry in known:
            found.append(OwnMethod(entry))
            continue
        kind, _, path = entry.partition(":")
        stem = re.sub(r"\{.*?\}", "", path).rstrip("/").rpartition("/")[2]
        name = unused_name(stem.removesuffix(f".{kind}"), {each.name for each in found})
        found.append(OwnMethod(name, entry))
    return tuple(found)


def _scene(scene: OwnScene) -> str:
    head = ("[[stimuli.scenes]]", f'name = "{scene.name}"', f"label = {quoted(scene.label)}")
    return "\n".join((*head, *scene.lines))


def _method(method: OwnMethod) -> str:
    lines = ["[[stimuli.methods]]", f'name = "{method.name}"']
    if method.method is not None:
        lines.append(f"method = {quoted(method.method)}")
    return "\n".join((*lines, f'label = "{method.name[:1].upper()}{method.name[1:]}"'))
