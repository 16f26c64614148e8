"""Text of a new study's file for a user's own scenes, pictures and methods."""

from __future__ import annotations

import json
import re
from collections.abc import Collection, Sequence
from dataclasses import dataclass
from math import ceil, comb

from protocols.errors import StudyError
from protocols.units import NAME_LENGTH

REFERENCE = "reference"
PLAINLY_WORSE = "push-pull"
"""Method that catch trials show beside the true view, where the study has it."""
_OWN_SIZE = "own"


@dataclass(frozen=True)
class OwnScene:
    """One scene or picture of a new study.

    Parameters
    ----------
    name : str
        As in the study.
    label : str or None
        As in the study; None: a picture, which has none.
    lines : tuple of str
        Everything else of its section, TOML.
    """

    name: str
    label: str | None
    lines: tuple[str, ...]
    has_truth: bool = True
    """True if its true view is known, so that `reference` can be shown."""


@dataclass(frozen=True)
class OwnMethod:
    """One method of a new study; `method` is its name in the registry where that differs."""

    name: str
    method: str | None = None


BUILT_IN_SCENES = ("garden", "shed")
BUILT_IN_METHODS = tuple(map(OwnMethod, ("coherence-transport", PLAINLY_WORSE, REFERENCE)))
FOVEATED_METHODS = tuple(map(OwnMethod, ("metamer", "blur", REFERENCE)))


@dataclass(frozen=True)
class OwnClips:
    """Demands of a user's own sequences on every clip: they are shown pixel for pixel."""

    width_px: int
    height_px: int
    frames: int
    alone: bool
    """The study has no other scenes, so that its sizes say nothing."""


@dataclass(frozen=True)
class OwnStimuli:
    """The scenes and methods that take the place of a template's; empty: the template's stay.

    The study's planned test compares the first method with the second; the true view is neither.
    """

    scenes: tuple[OwnScene, ...] = ()
    methods: tuple[OwnMethod, ...] = ()
    clips: OwnClips | None = None
    stills_px: tuple[int, int] | None = None
    """Width and height of stills for a gaze: then scenes are pictures. None: clips."""
    quick: bool = False
    """Stills are for a metamer test of oneself, whose template has methods of its own."""

    def __post_init__(self) -> None:
        if len(self.methods) == 1:
            raise StudyError(
                f"--methods: must name two or more, joined by commas (got {self.methods[0].name!r})"
            )

    def check_pairs(self) -> None:
        """Refuse what leaves a task that compares methods a single condition."""
        if sum(self._cells.values()) == 1:
            raise StudyError(
                "a study must have two conditions or more, for no two trials in a row show the same"
                " (got one pair of methods, in one scene); name another scene or picture, or a"
                " third method"
            )

    @property
    def _every_method(self) -> tuple[OwnMethod, ...]:
        usual = BUILT_IN_METHODS if self.stills_px is None else FOVEATED_METHODS
        return self.methods or usual

    @property
    def _sizes(self) -> int:
        return 2 if self.stills_px is None and (self.clips is None or not self.clips.alone) else 1

    @property
    def _cells(self) -> dict[str, int]:
        """Conditions of each scene: pairs of methods at each size."""
        scenes = self.scenes or tuple(OwnScene(name, None, ()) for name in BUILT_IN_SCENES)
        shown = {
            scene.name: [m for m in self._every_method if scene.has_truth or m.name != REFERENCE]
            for scene in scenes
        }
        return {name: self._sizes * comb(len(methods), 2) for name, methods in shown.items()}

    @property
    def _practised(self) -> list[str]:
        """Scenes of the practice: enough for two trials that differ, where there are as many."""
        first, *others = self._cells
        return [first, *others[:1]] if self._cells[first] < 2 else [first]

    @property
    def _catch_trials(self) -> int:
        """Catch trials: six, or as many as a block can hold with others between them."""
        if not any(method.name == REFERENCE for method in self._every_method):
            return 0
        places = sum(scene.has_truth for scene in self.scenes) or (not self.scenes) * 2
        main = sum(self._cells.values())  # of a block: two repeats lie in two blocks
        return next(
            (
                trials
                for trials in (6, 4, 2)
                if places and 1 + ceil(trials / 2 / places) <= (main + trials // 2) // 2
            ),
            0,
        )

    def sections(self) -> dict[str, str]:
        """Return the parts of a template that differ from it, by name."""
        found = {}
        stills = self.stills_px is not None
        if self.scenes:
            section = "pictures" if stills else "scenes"
            found[section] = "\n\n".join(_scene(section, scene) for scene in self.scenes)
        if self.clips is not None:
            size = f"width_px = {self.clips.width_px}\nheight_px = {self.clips.height_px}"
            found["clip_size"] = f"{size}\n#? width_deg = 6.0\n#? height_deg = 4.5"
            if self.clips.alone:
                found["sizes"] = (
                    "# One, which says nothing: sequences bring their own motion.\n"
                    f'[[stimuli.sizes]]\nname = "{_OWN_SIZE}"\nlabel = "as rendered"'
                )
        if stills and not self.quick:
            found["methods"] = "\n\n".join(map(_method, self.methods or FOVEATED_METHODS))
        elif self.methods:  # which a quick test has not
            found["methods"] = "\n\n".join(map(_method, self.methods))
        if not stills and not self._catch_trials:
            found["catch"] = (
                "# No catch trials: they need a pair whose better one is known, such as"
                " 'reference' and\n# another method (--methods reference,...), and other trials"
                " between them."
            )
        return found

    def words(self) -> dict[str, str]:
        """Return the text that templates have in the place of ``@WORD@``."""
        stills = self.stills_px is not None
        methods = self._every_method
        width_px, height_px = self.stills_px or (0, 0)
        judged = [method.name for method in methods if method.name != REFERENCE]
        worse = PLAINLY_WORSE if PLAINLY_WORSE in judged else judged[-1]
        return {
            "PRACTICE_SCENES": json.dumps(self._practised),
            "PRACTICE_TRIALS": str(min(2, sum(self._cells[name] for name in self._practised))),
            "CATCH_TRIALS": str(self._catch_trials),
            "SCENES": json.dumps(list(self._cells)),
            "PRIMARY": judged[0],
            "AGAINST": (*judged[1:], REFERENCE)[0],
            "CATCH_WORSE": worse,
            "SIZE": _OWN_SIZE if self.clips is not None and self.clips.alone else "large",
            "FACTOR": "scene" if stills else "size",
            "STILL_WIDTH_PX": str(width_px),
            "STILL_HEIGHT_PX": str(height_px),
            "DOT_OVER_CLIPS": str(stills).lower(),
            "PARTICIPANTS": "1" if self.quick else "12",
            "GAZE": "none" if self.quick else "enforce",
            "CLIPS": "pictures" if stills else "short clips",
            "VIDEOS": "pictures" if stills else "short videos",
            "VIDEO": "picture" if stills else "video",
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


def _scene(section: str, scene: OwnScene) -> str:
    label = () if scene.label is None else (f"label = {quoted(scene.label)}",)
    return "\n".join((f"[[stimuli.{section}]]", f'name = "{scene.name}"', *label, *scene.lines))


def _method(method: OwnMethod) -> str:
    lines = ["[[stimuli.methods]]", f'name = "{method.name}"']
    if method.method is not None:
        lines.append(f"method = {quoted(method.method)}")
    return "\n".join((*lines, f'label = "{method.name[:1].upper()}{method.name[1:]}"'))
