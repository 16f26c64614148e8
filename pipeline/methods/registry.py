"""Configured methods from their names and parameters.

To add a method, write its class (one file in this folder) and add one line to `SHIPPED`. A package
of another lab adds its own by an entry point of the group ``metamerlab.methods``, which names the
class.
A class that draws on the GPU takes the context as its first parameter,
``ctx``; one whose name carries a path (``onnx:FILE``) takes it as ``path``.
"""

import inspect
from collections.abc import Mapping
from contextlib import suppress
from importlib import metadata
from pathlib import Path
from typing import Any, cast

import moderngl
import numpy as np
from numpy.typing import NDArray

from pipeline.errors import GLUnavailableError, InputError, MissingExtraError
from pipeline.frame import WarpedFrame, check_seed
from pipeline.methods.method import Method
from pipeline.named_classes import NamedClass, check_given, defaults_of, find


def _with_plugins(shipped: tuple[NamedClass, ...]) -> tuple[NamedClass, ...]:
    """Return the methods with those of installed packages; none of them is imported."""
    found = list(shipped)
    for point in metadata.entry_points(group="metamerlab.methods"):
        owner = point.dist.name if point.dist else point.value
        if any(point.name == entry.name for entry in found):
            raise InputError(
                f"package {owner!r}: a plug-in must have a name of its own in metamerlab.methods"
                f" (got {point.name!r}, which is taken); rename it, or uninstall the package"
            )
        found.append(NamedClass(point.name, f"of the package {owner}", point.value, owner=owner))
    return tuple(found)


SHIPPED = tuple(
    NamedClass(*line)
    for line in (
        (
            "metameric",
            "a metamer of the background (Kuffner dos Anjos et al. 2022)",
            "pipeline.methods.metameric:Metameric",
        ),
        (
            "metameric-paper",
            "the same as its paper prints it, without what was found since",
            "pipeline.methods.metameric:MetamericPaper",
        ),
        (
            "coherence-transport",
            "edges of the background go on (after Bornemann and März 2007)",
            "pipeline.methods.metameric:CoherenceTransport",
        ),
        (
            "push-pull-depth",
            "push-pull that keeps to the background",
            "pipeline.methods.metameric:PushPullDepth",
        ),
        (
            "push-pull",
            "classic push-pull (Gortler et al. 1996)",
            "pipeline.methods.pull_push:PushPull",
        ),
        (
            "weighted-pull-push",
            "pull-push with squared weights (2009 note)",
            "pipeline.methods.pull_push:WeightedPullPush",
        ),
        ("telea", "OpenCV's fast marching (Telea 2004)", "pipeline.methods.opencv:Telea"),
        (
            "navier-stokes",
            "OpenCV's fluid dynamics (Bertalmio et al. 2001)",
            "pipeline.methods.opencv:NavierStokes",
        ),
        ("oiio-push-pull", "OpenImageIO's push-pull", "pipeline.methods.opencv:OiioPushPull"),
        (
            "background-extension",
            "the background's edge, continued along the parallax",
            "pipeline.methods.background_extension:BackgroundExtension",
        ),
        ("onnx:", "a neural network exported to ONNX", "pipeline.methods.onnx:OnnxNetwork", "FILE"),
        ("frames:", "frames made elsewhere", "pipeline.methods.frames:FramesOnDisk", "FOLDER"),
    )
)

METHODS = _with_plugins(SHIPPED)

RETIRED = {
    "shift-map": "has left metamerlab, and 'coherence-transport' replaces it; for its own fills"
    " install revision 70b3711, the last that has it",
    "metameric.texture": "has left metamerlab, and metameric always fills with noise; leave it out,"
    " or take 'coherence-transport' for structure of the background; for the fills of"
    " texture = 'background' install revision 70b3711, the last that has them",
}
"""Messages about methods, and their parameters, that were here once."""


def method_names() -> list[str]:
    """Return every method's name as a user writes it."""
    return [entry.shown_name for entry in METHODS]


def check_method_name(name: str) -> NamedClass:
    """Return the entry that `name` means; nothing of the method is imported.

    Raises
    ------
    InputError
        If there is no such method, with the nearest name; or if its path is missing.
    """
    return find(METHODS, name, RETIRED)


def method_parameters(name: str) -> dict[str, Any]:
    """Return the parameters of the method `name` with their defaults.

    Raises
    ------
    InputError
        If there is no such method, with the nearest name.
    """
    return defaults_of(check_method_name(name).load())


def method_files(name: str) -> list[Path]:
    """Return every file that decides what a method with a path does; none for the others.

    A class that opens more than its file, or than the files of its folder, says so by a static
    method ``files``, from the path to a list of paths.

    Raises
    ------
    InputError, FileNotFoundError
        If there is no such method, or a file is missing or cannot be read.
    """
    entry = check_method_name(name)
    if not entry.takes_path:
        return []
    path = Path(name.removeprefix(entry.name))
    files = getattr(entry.load(), "files", None)
    if files is not None:
        return cast(list[Path], files(path))
    if path.is_dir():
        return sorted(file for file in path.rglob("*") if file.is_file())
    return [path]


def create_method(
    name: str, ctx: moderngl.Context | None = None, parameters: Mapping[str, Any] | None = None
) -> Method:
    """Make the method called `name`.

    Parameters
    ----------
    name : str
        One of `method_names`; ``FILE`` and ``FOLDER`` stand for a path.
    ctx : moderngl.Context, optional
        Of the methods that run on the GPU, ignored by the others. Without one, ours work by their
        numpy twins, slower.
    parameters : mapping, optional
        Of `method_parameters`; the rest keep their defaults.

    Raises
    ------
    InputError
        If the method or a parameter is unknown (with the nearest name), or a value is
        out of range.
    GLUnavailableError
        If there is no context, and the method has no twin: a plug-in's.
    """
    entry, method_class, needs_gpu = _checked(name, parameters or {})
    if needs_gpu and ctx is None:
        if not hasattr(method_class, "in_numpy"):
            raise GLUnavailableError(f"method {name!r} needs an OpenGL context (got none)")
        return cast(Method, method_class(None, **(parameters or {})).in_numpy())
    leading: list[object] = [ctx] if needs_gpu else []
    leading += entry.path_in(name)
    return cast(Method, method_class(*leading, **(parameters or {})))


def fill(
    warped: WarpedFrame,
    method: str = "metameric",
    *,
    seed: int = 0,
    ctx: moderngl.Context | None = None,
    **parameters: Any,
) -> NDArray[np.float32]:
    """Fill the holes of one warped frame. For many frames make the method by `create_method`.

    Parameters
    ----------
    warped : WarpedFrame of size (H, W)
        Colour, depth, holes and flow, as the warp gives them.
    method : str
        One of `method_names`.
    seed : int
        Of noise, from 0 to 2**63 - 1; the frames of a clip share one.
    ctx : moderngl.Context, optional
        Work on the GPU, where the method can; without it numpy does.
    **parameters
        Of the method; see `method_parameters`.

    Returns
    -------
    ndarray of float32, shape (H, W, 3)
        Encoded R'G'B' in [0, 1]. Outside the holes it is the colour of `warped`.

    Raises
    ------
    InputError, GLUnavailableError
        As `create_method`; also if everything is a hole.
    """
    filler = create_method(method, ctx, parameters)
    try:
        return filler.fill(warped, check_seed(seed))
    finally:
        filler.release()


def check_method(name: str, parameters: Mapping[str, Any]) -> None:
    """Check a method and all its parameters, as `create_method` does; no context is needed.

    The class has the ranges, and looks at them before it opens a file or asks the GPU for anything.
    A plug-in's that needs a context looks at them where it is made.

    Raises
    ------
    InputError
        As `create_method`.
    """
    entry, method_class, needs_gpu = _checked(name, parameters)
    if entry.owner and needs_gpu:
        return
    with suppress(OSError, MissingExtraError):  # a file, or what reads it, is not here
        leading = [None] if needs_gpu else []
        method_class(*leading, *entry.path_in(name), **parameters).release()


def _checked(name: str, parameters: Mapping[str, Any]) -> tuple[NamedClass, type[Any], bool]:
    """Return entry and class of a method, and whether it needs a context."""
    entry = check_method_name(name)
    method_class = entry.load()
    check_given(name, method_class, parameters, RETIRED)
    return entry, method_class, "ctx" in inspect.signature(method_class).parameters
