"""Files of format 1, read as what they say in format 2, for ever.

Format 1 knew one task, two intervals of warped clips, and wrote it into every section. What it
said is changed to format 2 before it is checked. Hashes of what was written stay what they were,
so that sessions, clips and protocol of format 1 still belong together.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from protocols.errors import StudyError
from protocols.hashing import Json

if TYPE_CHECKING:
    from protocols.schema import StudyProtocol

Raw = dict[str, Any]

_RECIPE = ("scenes", "sizes", "methods", "clips")
_TO_TASK = (("design", "pairings"), ("trial", "gap_s"))
_KEYS = (("left_keys", ("left",)), ("right_keys", ("right",)))
_ANSWERS = ("first", "second")
_STIMULI = {"first": [0], "second": [1]}


def upgraded_protocol(raw: Raw) -> Raw:
    """Return a protocol of format 1 as one of format 2; what it does not know stays in place.

    Parameters
    ----------
    raw : dict
        The parsed file. It is not changed.
    """
    new: Raw = {
        key: dict(value) if isinstance(value, Mapping) else value
        for key, value in raw.items()
        if key not in _RECIPE
    }
    new["stimuli"] = {"kind": "warped-clips"} | {key: raw[key] for key in _RECIPE if key in raw}
    task: Raw = {"kind": "two-interval"}
    for section, key in _TO_TASK:
        if isinstance(new.get(section), dict) and key in new[section]:
            task[key] = new[section].pop(key)
    design, trial, response = (new.get(name) for name in ("design", "trial", "response"))
    if isinstance(design, dict) and "catch" in design:
        catch = design.pop("catch")
        if isinstance(catch, Mapping) and "size" in catch:
            catch = {key: value for key, value in catch.items() if key != "size"} | {
                "where": {"size": catch["size"]}
            }
        task["catch"] = catch
    new["task"] = task
    if isinstance(trial, dict) and trial.get("kind", "2afc") == "2afc":
        trial.pop("kind", None)
    if isinstance(response, dict):
        response["keys"] = tuple(response.pop(key, default) for key, default in _KEYS)
    if isinstance(new.get("analysis"), dict):
        new["analysis"] = {"kind": "preference"} | new["analysis"]
    if isinstance(new.get("text"), dict) and isinstance(new["text"].get("languages"), Mapping):
        new["text"]["languages"] = {
            language: _texts(texts) for language, texts in new["text"]["languages"].items()
        }
    return new


def _texts(texts: object) -> object:
    if not isinstance(texts, Mapping):
        return texts
    new = {key: value for key, value in texts.items() if key not in _ANSWERS}
    return new | {"answers": {key: texts[key] for key in _ANSWERS if key in texts}}


def protocol_as_written(study: StudyProtocol) -> Json:
    """Return a study as the models of format 1 held it: what its hash is made from.

    Raises
    ------
    StudyError
        If the study says what format 1 could not.
    """
    from protocols.schema import without_nothing

    plain = without_nothing(study.model_dump(mode="json"))
    stimuli, task, response = (plain.pop(name) for name in ("stimuli", "task", "response"))
    if stimuli["kind"] != "warped-clips" or task["kind"] != "two-interval":
        raise StudyError("format: must be 2 for this task and recipe (got 1); set format = 2")
    for key in _RECIPE:
        plain[key] = stimuli[key]
    design, trial = plain["design"], plain["trial"]
    design["pairings"] = task["pairings"]
    catch = task["catch"]
    if catch is not None:
        catch["size"] = catch.pop("where")["size"]
    design["catch"] = catch
    if design["practice"] is not None:
        design["practice"] = {key: design["practice"][key] for key in ("trials", "scenes")}
    trial |= {"kind": "2afc", "gap_s": task["gap_s"]}
    del trial["feedback_s"]
    left, right = response.pop("keys")
    plain["response"] = response | {"left_keys": left, "right_keys": right}
    del plain["analysis"]["kind"]
    for texts in plain["text"]["languages"].values():
        texts |= texts.pop("answers")
        del texts["right"], texts["wrong"]
    result: Json = plain
    return result


def says_format_1(study: StudyProtocol) -> bool:
    """Return whether format 1 can say all of a study: only then do hashes tell studies apart."""
    try:
        written = protocol_as_written(study)
        assert isinstance(written, dict)
        again = type(study).model_validate_json(json.dumps(upgraded_protocol(written)))
    except (KeyError, ValueError, StudyError):
        return False
    return again == study


def upgraded_attempt(raw: Raw) -> Raw:
    """Return an attempt of a journal of format 1 as one of format 2.

    Raises
    ------
    ValueError
        If it contradicts itself.
    """
    new = dict(raw)
    del new["trial_kind"]
    practice, catch = new.pop("practice"), new.pop("catch")
    condition = {key: new.pop(key) for key in ("scene", "size", "first", "second")}
    sides = new.pop("first_side"), new.pop("chosen_side")
    answer, chosen, expected = new.pop("choice"), new.pop("chosen"), new["expected"]
    if answer is not None:
        if chosen != condition[answer]:
            raise ValueError(f"chosen must be the method of the {answer} interval")
        if (answer == "first") != (sides[0] == sides[1]):
            raise ValueError("chosen_side must be the side of the chosen interval")
    right = None
    if expected is not None:
        right = next((name for name in _ANSWERS if condition[name] == expected), None)
        if right is None:
            raise ValueError("expected must be one of the methods shown")
    return new | {
        "role": "practice" if practice else "catch" if catch else "main",
        "condition": condition,
        "track": None,
        "stimuli": [
            {"name": shown["clip"], "sha256": shown["clip_sha256"]}
            | {key: shown[key] for key in ("frames_shown", "frames_planned")}
            for shown in new.pop("clips")
        ],
        "phases": [
            phase | {"stimuli": _STIMULI.get(phase["phase"], [])} for phase in new.pop("phases")
        ],
        "answers": _ANSWERS if sides[0] == "left" else _ANSWERS[::-1],
        "expected": right,
        "answer": answer,
        "correct": None if answer is None or right is None else answer == right,
    }


def upgraded_clip(raw: Raw) -> Raw:
    """Return a clip of a manifest of format 1 as one of format 2."""
    condition = {key: raw[key] for key in ("scene", "size", "method")}
    rest = {key: value for key, value in raw.items() if key not in condition}
    return rest | {"name": "__".join(map(str, condition.values())), "condition": condition}


def clip_as_written(plain: Raw) -> Raw:
    """Return a clip as the models of format 1 held it."""
    rest = {key: value for key, value in plain.items() if key not in ("name", "condition")}
    return rest | dict(plain["condition"])
