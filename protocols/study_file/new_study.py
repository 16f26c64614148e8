"""The files of a new study: templates, with every key explained from the schema itself.

A study is composed of what all studies have (``study.toml``), a recipe's part and a task's part.
``#@ NAME`` begins a section of a part; ``#@ NAME`` in ``study.toml``, and ``#+ NAME`` anywhere,
stands for that section, else for the one of ``shared.toml``. What is composed is valid TOML
with ``@WORD@`` for what differs between studies. Above the first use of each key come its meaning,
type and default, taken from the models that read the file, so that comments and program cannot
drift apart. A line ``#? key = value`` is a key that may be left out, and ``#? [header]`` a section
of such keys: they stay behind a ``#``. A study known by its numbers alone is made of one, too.
"""

from __future__ import annotations

import re
import textwrap
import tomllib
from collections.abc import Iterator, Mapping
from functools import cache
from importlib.resources import files
from itertools import takewhile
from pathlib import Path
from typing import Any, NamedTuple, get_args, get_origin

from pydantic import BaseModel

from protocols.disk.hashing import sha256_bytes
from protocols.display import Display
from protocols.errors import StudyError, must_be_one_of, shortest
from protocols.formats.format_reference import bounds_in_words, schema_text, toml_text
from protocols.limits import FIXED
from protocols.load import load_display, protocol_of, with_tuples
from protocols.study_file.own_stimuli import OwnStimuli
from protocols.study_file.schema import StudyProtocol
from protocols.tasks.single import RightOrWrong
from protocols.tasks.task_kinds import TASKS
from protocols.units import NAME_PATTERN

FOLDERS = ("clips", "sessions", "report")
TEMPLATES = tuple(name for name, kind in TASKS.items() if kind.recipe)
"""Tasks that a new study may have."""
_FOVEATED = "foveated-images"  # the recipe that photographs become


class Start(NamedTuple):
    """Beginning of a new study, by its recipe."""

    folder: str
    """Folder of its inputs."""
    inputs: str
    """Rows on these in the README's table."""
    catch_min_share: float = 0.5
    """Share of six catch trials that must be right. A plain right answer leaves room for one slip.
    A preference, even a plain one, is an opinion: only who mostly prefers the worse is left out."""
    power: str = "metamerlab analysis power study.toml --rate 0.65"


_STARTS = {
    "warped-clips": Start("scenes", "| `scenes/` | 3D files and pictures of your own |"),
    "files": Start(
        "pictures",
        "| `stimuli.csv` | a line per picture or video: its name, its file, what it shows |\n"
        "| `pictures/` | the files: some to start from, to be replaced by yours |",
        0.75,
        "metamerlab analysis power study.toml",
    ),
    _FOVEATED: Start("pictures", "| `pictures/` | your photographs |"),
}
WANTED_FPS = 30.0
GLIMPSE_S = 0.2
"""Shorter than the eye needs to look elsewhere."""
_LOOKED_AT = ("two-interval", "yes-no", "identification")  # tasks with stills where the eye looks
_WIDTH = 96
PICTURE_PX = 128
"""Edge of the pictures that a study of `files` starts from."""
_TAGS = ("kind", "rule")
_SECTION = re.compile(r"^#[@+] (\w+)$", flags=re.M)
_HEADER = re.compile(r"(#\? )?\[\[?([\w.]+)\]\]?$")
_KEY = re.compile(r"(#\? )?(\w+) = ")


def study_files(
    name: str,
    title: str,
    display: Display,
    task: str = "two-interval",
    secret: str | None = None,
    own: OwnStimuli | None = None,
) -> dict[str, str]:
    """Return the files of a new study by name.

    Parameters
    ----------
    name : str
        Name of the study, as the protocol's `study.name` may be.
    title : str
        What people read.
    display : Display
        The display to start from.
    task : str
        One of `TEMPLATES`.
    secret : str, optional
        Also seeds the order of trials; left out: the order follows from the code.
    own : OwnStimuli, optional
        Scenes and methods in place of the template's.

    Raises
    ------
    StudyError
        If there is no such task, with the nearest name; or it shows no scenes, and `own` has some;
        or it shows none in the middle of the gaze, and `own` has photographs; or there are too few
        conditions.
    """
    own = own or OwnStimuli()
    recipe = _recipe(task, own)
    part = task
    if not issubclass(TASKS[task].task, RightOrWrong):
        own.check_pairs()
    elif own.stills_px is not None:  # what is drawn into them gives a right answer
        part = f"photographs-{task}"
    sections = {**_sections("shared"), **_sections(part), **_sections(recipe), **own.sections()}
    study = _composed(_template("study.toml"), sections)
    answers = len(_toml(study)["text"]["languages"]["en"]["answers"])
    words = _words(name, title, display, own) | _words_of(task, recipe, answers, sections)
    study, screen, readme = (
        re.sub(r"@(\w+)@", lambda use: str(words[use[1]]), text)
        for text in (
            study,
            _template("display.toml"),
            _template("quick.md" if own.quick else "README.md"),
        )
    )
    if secret is not None:
        digest = sha256_bytes(secret.encode())
        study = study.replace("[privacy]\n", f'[privacy]\nsecret_sha256 = "{digest}"\n')
    return {
        "study.toml": explained(study, StudyProtocol),
        "display.toml": explained(screen, Display),
        "README.md": readme,
        "schemas/study.schema.json": schema_text("study"),
        "schemas/display.schema.json": schema_text("display"),
    } | ({} if secret is None else {"study.secret": f"{secret}\n", ".gitignore": "*.secret\n"})


def inputs_folder(task: str, own: OwnStimuli) -> str:
    """Return the folder of a new study's inputs."""
    return _STARTS[_recipe(task, own)].folder


def _recipe(task: str, own: OwnStimuli) -> str:
    """Return the recipe of a new study."""
    if task not in TEMPLATES:
        raise StudyError(must_be_one_of("--task:", task, TEMPLATES))
    recipe = TASKS[task].recipe
    if own.stills_px is not None:
        if task not in _LOOKED_AT and not own.quick:
            raise StudyError(
                f"--task: must be {' or '.join(_LOOKED_AT)} where photographs are given (got"
                f" {task!r}, which shows none where the eye looks)"
            )
        return _FOVEATED
    if own.sections() and recipe != "warped-clips":
        of_scenes = [name for name in TEMPLATES if TASKS[name].recipe == "warped-clips"]
        raise StudyError(
            f"--task: must be {' or '.join(of_scenes)} where scenes or methods are given (got"
            f" {task!r}, which starts from pictures and their table)"
        )
    return recipe


def _words(name: str, title: str, display: Display, own: OwnStimuli) -> dict[str, object]:
    """Return the values of ``@WORD@`` in every template: the study, its display, its clips."""
    fps = clip_fps(display.refresh_hz)
    frames = round(fps) if own.clips is None else own.clips.frames
    low_deg = min(display.angles_deg(*(own.stills_px or (display.width_px, display.height_px))))
    ring_deg = min(1.25, low_deg / 10)
    return {
        **own.words(),
        "NAME": name,
        "TITLE": title,
        "DESCRIPTION": display.description,
        "WIDTH_PX": display.width_px,
        "HEIGHT_PX": display.height_px,
        "WIDTH_MM": display.width_mm,
        "HEIGHT_MM": display.height_mm,
        "DISTANCE_MM": display.distance_mm,
        "REFRESH_HZ": display.refresh_hz,
        "CLIP_MEMORY_MIB": display.clip_memory_mib,
        "FPS": fps,
        "DURATION_S": whole_frames_s(frames, fps),
        "GLIMPSE_S": whole_frames_s(round(GLIMPSE_S * display.refresh_hz), display.refresh_hz),
        "PICTURE_PX": PICTURE_PX,
        "RING_DEG": f"{ring_deg:.3f}",
        "RINGS_DEG": [round((low_deg / 2 - ring_deg) * part / 3, 2) for part in (1, 2, 3)],
    }


def _words_of(
    task: str, recipe: str, answers: int, sections: Mapping[str, str]
) -> dict[str, object]:
    """Return the values of ``@WORD@`` that differ between tasks and recipes."""
    from protocols.answer_rules import answer_rule  # completion of names does without scipy

    kind, start = TASKS[task].task, _STARTS[recipe]
    guess = answer_rule(kind.rule, answers).chance if issubclass(kind, RightOrWrong) else 0.0
    return {
        "TASK": task,
        "INPUTS": start.inputs,
        "CATCH_MIN_SHARE": start.catch_min_share,
        "POWER": sections.get("power", start.power),
        "REPEATS": 1 if recipe == _FOVEATED and guess else 2,
        "SIDE": "fixed" if kind.sided or answers > 2 else "by-participant",
        "GUESS": guess,
    }


def _composed(text: str, sections: Mapping[str, str]) -> str:
    """Return a template with the sections that it names, and those that they name."""
    while (filled := _SECTION.sub(lambda use: sections[use[1]], text)) != text:
        text = filled
    return text


def _sections(part: str) -> dict[str, str]:
    """Return the sections of a part by name."""
    parts = re.split(r"^#@ (\w+)\n", _template(f"parts/{part}.toml"), flags=re.M)[1:]
    return {key: text.strip("\n") for key, text in zip(parts[::2], parts[1::2], strict=True)}


def clip_fps(refresh_hz: float) -> float:
    """Return the whole frame rate nearest to 30 that shows each frame for whole refreshes."""
    whole = [
        refresh_hz / each
        for each in range(1, 16)
        if abs(refresh_hz / each - round(refresh_hz / each)) < 1e-6
    ]
    return min(whole or [refresh_hz], key=lambda fps: abs(fps - WANTED_FPS))


def whole_frames_s(frames: int, fps: float) -> float:
    """Return the duration of so many frames, in as few digits as say it."""
    return float(shortest(frames / fps, lambda s: abs(s * fps - frames) <= 1e-6))


def explained(text: str, model: type[BaseModel]) -> str:
    """Return a TOML text with a comment above the first use of every key.

    Parameters
    ----------
    text : str
        With ``#? key = value`` for keys that stay commented out.
    model : type of BaseModel
        What reads the file.
    """
    return "\n".join(_explain(text.splitlines(), model)) + "\n"


def _explain(lines: list[str], model: type[BaseModel]) -> Iterator[str]:
    current, told = model, set[tuple[str, str]]()
    kinds: dict[str, str] = {}
    quoted = False  # inside a text of several lines
    for number, line in enumerate(lines):
        if header := _HEADER.match(line):
            kinds[header[2]] = _kind(lines[number + 1 :])
            current = _section(model, header[2].split("."), kinds)
            yield "# " + line.removeprefix("#? ") if header[1] else line
            continue
        key = None if quoted else _KEY.match(line)
        quoted ^= line.count('"""') % 2 == 1
        if not key:
            yield line
            continue
        owner = _owner(current, key[2])
        if (owner.__name__, key[2]) not in told:
            told.add((owner.__name__, key[2]))
            yield from _comment(owner, key[2])
        yield "# " + line.removeprefix("#? ") if key[1] else line


@cache
def _schema_of(model: type[BaseModel]) -> dict[str, Any]:
    return model.model_json_schema()


def _comment(owner: type[BaseModel], key: str) -> list[str]:
    """Return the schema's words on a key: meaning, then unit, range and default."""
    published = _schema_of(owner)
    schema: dict[str, Any] = published["properties"][key]
    said = " ".join(schema.get("description", "").split())
    details = _details(schema, published.get("$defs", {}))
    if not owner.model_fields[key].is_required():
        default = schema.get("default")
        left_out = default is None or default in ("", [], {})
        details.append("may be left out" if left_out else f"default {toml_text(default)}")
    text = f"{said} ({', '.join(details)})" if details else said
    return textwrap.wrap(
        text.strip(),
        _WIDTH,
        initial_indent="# ",
        subsequent_indent="#   ",
        break_long_words=False,
        break_on_hyphens=False,
    )


def _details(schema: dict[str, Any], definitions: dict[str, Any]) -> list[str]:
    """Return unit, range and choices of a value; nothing for what its example shows anyway."""
    options = [entry for entry in schema.get("anyOf", ()) if entry.get("type") != "null"]
    if len(options) == 1:
        return _details(options[0], definitions)
    if "discriminator" in schema:
        kinds = " | ".join(schema["discriminator"]["mapping"])
        return [f"{schema['discriminator']['propertyName']} = {kinds}"]
    if "$ref" in schema:
        entry = definitions[str(schema["$ref"]).rpartition("/")[2]]
        return ["with " + ", ".join(entry["properties"])]
    if "enum" in schema:
        return [" | ".join(map(toml_text, schema["enum"]))]
    if schema.get("type") == "boolean":
        return ["true | false"]
    if schema.get("pattern") == NAME_PATTERN:
        return ["lower-case words joined by dashes"]
    bounds = bounds_in_words(schema)
    return [schema["unit"], *bounds] if "unit" in schema else bounds


def _section(model: type[BaseModel], names: list[str], kinds: dict[str, str]) -> type[BaseModel]:
    """Return the model of a section; where several may stand there, the one of its kind."""
    for count, name in enumerate(names, start=1):
        if name in model.model_fields:
            kind = kinds.get(".".join(names[:count]), "")
            model = _model_in(model.model_fields[name].annotation, kind)
        # else: a key of a table, such as the language in text.languages.en
    return model


def _model_in(annotation: object, kind: str) -> type[BaseModel]:
    found = list(_models(annotation))
    for entry in found:
        tags = [getattr(entry.model_fields.get(key), "annotation", None) for key in _TAGS]
        if kind and any(kind in get_args(tag) for tag in tags):
            return entry
    return found[0]


def _models(annotation: object) -> Iterator[type[BaseModel]]:
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        yield annotation
    elif get_origin(annotation) is not None:
        for argument in get_args(annotation):
            yield from _models(argument)


def _owner(model: type[BaseModel], key: str) -> type[BaseModel]:
    """Return the class that defines a key, so that kinds which share it are told it once."""
    return next(
        entry
        for entry in reversed(model.__mro__)
        if issubclass(entry, BaseModel) and key in entry.model_fields
    )


def _kind(lines: list[str]) -> str:
    section = takewhile(lambda line: not _HEADER.match(line), lines)
    found = re.search(r'^(#\? )?(kind|rule) = "(.+)"$', "\n".join(section), flags=re.M)
    return found[3] if found else ""


def _template(name: str) -> str:
    path = Path(str(files("protocols"))) / "templates" / name
    return path.read_text(encoding="utf-8")


def _toml(text: str) -> dict[str, Any]:
    """Parse a template; a mistake of ours shows here, not at a user's."""
    return tomllib.loads(re.sub(r"@\w+@", "0", text))


_FROM_NUMBERS = "from-numbers"
_MOST = FIXED["design"].most
"""Largest number of pairs, scenes, repeats or participants: more is a slip of the hand."""


def preferences_of(*, pairs: int, scenes: int, repeats: int, participants: int) -> StudyProtocol:
    """Return a study in which everybody compares every pair in every scene so often.

    Parameters
    ----------
    pairs : int
        Pairs of methods; the planned test is that of the first, alone.
    scenes, repeats, participants : int
        How many scenes, how often everybody decides on a pair in each, and how many they are.

    Raises
    ------
    StudyError
        If a number is below 1 (scenes and participants: 2), or above 1000.
    """
    for name, value, least in (
        ("pairs", pairs, 1), ("scenes", scenes, 2), ("repeats", repeats, 1),
        ("participants", participants, 2),
    ):  # fmt: skip
        if not least <= value <= _MOST:
            raise StudyError(f"--{name}: must be {least} to {_MOST} (got {value})")
    text = study_files(_FROM_NUMBERS, "From numbers", load_display("fhd27-60hz"))["study.toml"]
    study: dict[str, Any] = tomllib.loads(text)
    study["study"]["participants"] = participants
    study["display"]["display"] = "fhd27-60hz"
    stimuli, first = study["stimuli"], study["stimuli"]["scenes"][0]
    stimuli["scenes"] = [
        first | {"name": f"scene-{k}", "label": f"scene {k}"} for k in range(scenes)
    ]
    stimuli["sizes"] = stimuli["sizes"][:1]
    stimuli["methods"] = [{"name": f"method-{k}", "method": "push-pull"} for k in range(pairs + 1)]
    study["task"]["pairings"] = [["method-0", f"method-{k + 1}"] for k in range(pairs)]
    del study["task"]["catch"], study["design"]["practice"]
    study["design"] |= {"repeats": repeats, "blocks": 1}
    study["analysis"]["primary"] = {"method": "method-0", "against": "method-1"}
    raw = {key: with_tuples(value) for key, value in study.items()}
    return protocol_of(raw, Path(f"{_FROM_NUMBERS}.toml"))
