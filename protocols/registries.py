"""Names in a protocol that other packages define: methods and built-in scenes.

`protocols` imports none of them; whoever knows the registries passes their names in.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping

from protocols.errors import Problem
from protocols.recipes.warped_clips import BuiltinScene, WarpedClips
from protocols.schema import StudyProtocol
from protocols.suggest import did_you_mean


def check_methods(
    protocol: StudyProtocol,
    known: Iterable[str],
    retired: Mapping[str, str] | None = None,
) -> list[Problem]:
    """Return a problem for every method that the registry does not know.

    Parameters
    ----------
    protocol : StudyProtocol
        The study.
    known : iterable of str
        Registry names; one with a colon (``onnx:FILE``) stands for every path after it.
        `reference`, the true view, is no method and always known.
    retired : mapping, optional
        What to say of methods that were there once.
    """
    recipe = protocol.stimuli
    if not isinstance(recipe, WarpedClips):
        return []
    names = ["reference", *known]
    prefixes = tuple(name[: name.index(":") + 1] for name in names if ":" in name)
    problems = []
    for index, method in enumerate(recipe.methods):
        name = method.registry_name
        place = f"stimuli.methods[{index}].{'method' if method.method else 'name'}"
        if name not in names and not name.startswith(prefixes or ("\0",)):
            gone = (retired or {}).get(name)
            said = f"must be a known method ({', '.join(names)}) (got {name!r})"
            said += did_you_mean(name, names)
            problems.append(Problem(place, f"method {name!r} {gone}" if gone else said))
    return problems


def check_scenes(protocol: StudyProtocol, known: Iterable[str]) -> list[Problem]:
    """Return a problem for every built-in scene that is not in `known`."""
    recipe = protocol.stimuli
    if not isinstance(recipe, WarpedClips):
        return []
    names = list(known)
    return [
        Problem(
            f"stimuli.scenes[{index}].builtin",
            f"must be a built-in scene ({', '.join(names)}) (got {scene.builtin!r})"
            f"{did_you_mean(scene.builtin, names)}",
        )
        for index, scene in enumerate(recipe.scenes)
        if isinstance(scene, BuiltinScene) and scene.builtin not in names
    ]
