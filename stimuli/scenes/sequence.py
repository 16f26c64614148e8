"""OpenEXR pictures and sequences with depth and motion, as Blender, Nuke and Unreal write them.

Channel names, the first that a file has; `channels` in the protocol names others:

=========  ===============================================================================
colour     ``R`` ``G`` ``B``; Blender ``ViewLayer.Combined.R``, or any layer's ``.Combined``;
           Unreal ``FinalImage.R``
depth      ``Z``, ``depth.Z`` (Nuke); Blender ``ViewLayer.Depth.Z``; Unreal
           ``FinalImageMovieRenderQueue_WorldDepth.R``, in centimetres
motion     ``flow.x`` ``flow.y``: to the next frame, in pixels, right and down; Nuke
           ``forward.u`` ``forward.v``, up; Blender ``ViewLayer.Vector.Z`` ``.W``, up, and
           backwards (this frame minus the next)
=========  ===============================================================================

Parts of a file count as one: a channel of a part may be called by its own name or by
``PART.CHANNEL``.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import OpenImageIO as oiio  # noqa: N813  its own documentation calls it so
from numpy.typing import NDArray

from pipeline.camera import UPRIGHT, Camera
from pipeline.colour import encode_srgb
from pipeline.errors import InputError
from pipeline.frame import SourceFrame, WarpedFrame, check_depth
from protocols.stimuli_schema import ExrScene, StereoPath, UpsamplingPath
from stimuli.exr import EMPTY_DEPTH_M
from stimuli.paths import Pose
from stimuli.scenes.photo import PhotoScenery, fitted, nearest_plane


@dataclass(frozen=True)
class Name:
    """A channel's name, ending in this, and the factor that brings it to our units and axes."""

    pattern: str
    factor: float = 1.0


KNOWN: dict[str, tuple[Name, ...]] = {
    "r": (Name(r"R"), Name(r"[^.]+\.Combined\.R"), Name(r"FinalImage\.R")),
    "g": (Name(r"G"), Name(r"[^.]+\.Combined\.G"), Name(r"FinalImage\.G")),
    "b": (Name(r"B"), Name(r"[^.]+\.Combined\.B"), Name(r"FinalImage\.B")),
    "depth": (
        Name(r"Z"),
        Name(r"depth\.Z"),
        Name(r"([^.]+\.)?Depth\.(Z|V)"),
        Name(r"FinalImageMovieRenderQueue_WorldDepth\.R", 0.01),
    ),
    "motion_x": (Name(r"flow\.x"), Name(r"forward\.u"), Name(r"([^.]+\.)?Vector\.Z", -1.0)),
    "motion_y": (Name(r"flow\.y"), Name(r"forward\.v", -1.0), Name(r"([^.]+\.)?Vector\.W", 1.0)),
}
ASSUMED_FOCAL = 1.0  # image widths, where the protocol does not say


@dataclass(frozen=True)
class Picture:
    """One file: encoded colour, depth, and the motion to the next frame where there is one."""

    frame: SourceFrame
    motion_px: NDArray[np.float32] | None


class SequenceScenery:
    """A sequence for temporal up-sampling: every file is a true frame, and tells its motion."""

    def __init__(self, scene: ExrScene, files: list[Path]) -> None:
        self._scene, self._files = scene, files
        self._kept: tuple[int, Picture] | None = None

    def source(
        self, size_px: tuple[int, int], margin_px: int, pose: Pose, extent_m: float, frame: int
    ) -> tuple[SourceFrame, Camera]:
        """Return the real frame `frame`, cut to size."""
        del pose, extent_m
        cut, scale = fitted(self._picture(frame).frame, size_px, margin_px)
        height, width = cut.size
        focal = (self._scene.focal_px or ASSUMED_FOCAL * width / scale) * scale
        return cut, Camera(width, height, focal, focal, width / 2, height / 2, UPRIGHT)

    def truth(
        self,
        size_px: tuple[int, int],
        pose: Pose,
        extent_m: float,
        warped: WarpedFrame,
        margin_px: int,
    ) -> NDArray[np.float32]:
        """Return the sequence's own frame."""
        del pose, extent_m
        cut, _ = fitted(self._picture(warped.frame_index).frame, size_px, margin_px)
        height, width = cut.size
        inside = slice(margin_px, height - margin_px), slice(margin_px, width - margin_px)
        return np.ascontiguousarray(cut.colour[inside])

    def motion(
        self, size_px: tuple[int, int], margin_px: int, source: int, frame: int
    ) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """Follow every pixel of `source` from file to file, by the nearest pixel's motion."""
        first = self._picture(source).frame
        height, width = first.size
        y, x = np.mgrid[:height, :width].astype(np.float64)
        at_x, at_y = x.copy(), y.copy()
        for step in range(source, frame):
            motion = self._picture(step).motion_px
            if motion is None:
                raise InputError(
                    f"{self._files[step]}: must have motion channels to follow (see 'OpenEXR' in"
                    " docs/stimuli.md), or name them in channels"
                )
            row = np.rint(at_y).astype(int).clip(0, height - 1)
            column = np.rint(at_x).astype(int).clip(0, width - 1)
            at_x, at_y = at_x + motion[row, column, 0], at_y + motion[row, column, 1]
        flow = np.stack([at_x - x, at_y - y], axis=-1).astype(np.float32)
        _, scale = fitted(first, size_px, margin_px)
        planes = [nearest_plane(flow[..., c], size_px, margin_px) * scale for c in range(2)]
        depth = nearest_plane(first.depth_m, size_px, margin_px)
        return np.stack(planes, axis=-1).astype(np.float32), depth

    @property
    def typical_depth_m(self) -> float:
        """Near depth of the first file."""
        depth = self._picture(0).frame.depth_m
        return float(np.percentile(depth[np.isfinite(depth)], 5))

    @property
    def largest_extent_m(self) -> float:
        """The files' own motion is what there is: no extent changes it."""
        return float("inf")

    def release(self) -> None:
        """Hold nothing on the GPU."""

    def _picture(self, frame: int) -> Picture:
        if frame >= len(self._files):
            raise InputError(
                f"{self._scene.name}: the clip needs frame {frame}, and the sequence has"
                f" {len(self._files)} files; shorten the clip or render more"
            )
        if self._kept is None or self._kept[0] != frame:
            self._kept = (frame, load_picture(self._files[frame], self._scene))
        return self._kept[1]


def open_sequence(scene: ExrScene, folder: Path) -> PhotoScenery | SequenceScenery:
    """Open a sequence; on other paths than up-sampling its middle file is the one picture.

    Raises
    ------
    InputError, OSError
        If there is no file, or one lacks colour or depth.
    """
    if isinstance(scene.camera, StereoPath):
        raise InputError(f"{scene.name}: the stereo path needs a stereo pair")
    files = frame_files(scene, folder)
    if isinstance(scene.camera, UpsamplingPath):
        return SequenceScenery(scene, files)
    picture = load_picture(files[len(files) // 2], scene)
    focal = scene.focal_px or ASSUMED_FOCAL * picture.frame.size[1]
    return PhotoScenery(scene.name, picture.frame, focal)


def frame_files(scene: ExrScene, folder: Path) -> list[Path]:
    """Return the files of a sequence in order; ``####`` stands for the frame's number.

    Raises
    ------
    FileNotFoundError
        If there is none.
    InputError
        If a number is missing in between.
    """
    match = re.search(r"#+", scene.file)
    if match is None:
        if not (folder / scene.file).is_file():
            raise FileNotFoundError(2, "No such file", str(folder / scene.file))
        return [folder / scene.file]
    head, tail = scene.file[: match.start()], scene.file[match.end() :]
    place = folder / Path(head).parent if "/" in head else folder
    name = re.compile(
        re.escape(Path(head).name if not head.endswith("/") else "")
        + rf"(\d{{{len(match[0])},}})" + re.escape(tail) + "$"
    )  # fmt: skip
    entries = sorted(place.iterdir()) if place.is_dir() else []
    numbered = {int(m[1]): e for e in entries if (m := name.fullmatch(e.name))}
    if not numbered:
        raise FileNotFoundError(2, "No such file", str(folder / scene.file))
    missing = sorted(set(range(min(numbered), max(numbered) + 1)) - numbered.keys())
    if missing:
        raise InputError(
            f"{folder / scene.file}: must have every frame from {min(numbered)} to"
            f" {max(numbered)} ({len(missing)} missing, the first is {missing[0]})"
        )
    return [numbered[number] for number in sorted(numbered)]


def load_picture(path: Path, scene: ExrScene) -> Picture:
    """Read one file.

    Raises
    ------
    InputError
        If it is damaged, lacks colour or depth, or a value breaks the rules of
        `pipeline.frame`.
    """
    channels = read_parts(path)
    given: dict[str, str] = {str(key): value for key, value in scene.channels.items()}
    light = np.stack([_find(path, channels, key, given) for key in "rgb"], axis=-1)
    if not np.isfinite(light).all():
        row, column = np.argwhere(~np.isfinite(light).all(axis=-1))[0]
        raise InputError(
            f"{path}: colour must be finite (found {light[row, column]} at row {row},"
            f" column {column}); render it again, or mend these pixels"
        )
    depth = _find(path, channels, "depth", given)
    depth = np.where(depth >= EMPTY_DEPTH_M, np.float32(np.inf), depth).astype(np.float32)
    check_depth(depth, f"{path}: depth")
    motion = None
    if all(_name(channels, key, given) for key in ("motion_x", "motion_y")):
        motion = np.stack(
            [_find(path, channels, key, given) for key in ("motion_x", "motion_y")], axis=-1
        )
        if not np.isfinite(motion).all():
            raise InputError(f"{path}: motion must be finite; render it again without holes in it")
    return Picture(
        SourceFrame(_encoded(light.clip(0, 1).astype(np.float64), scene.transfer), depth), motion
    )


def read_parts(path: Path) -> dict[str, NDArray[np.float32]]:
    """Read every channel of every part, half or float, by name."""
    if not path.is_file():
        raise FileNotFoundError(2, "No such file", str(path))
    source = oiio.ImageInput.open(str(path))
    if source is None:
        raise InputError(f"{path}: must be an OpenEXR file ({oiio.geterror().strip()[:200]})")
    channels: dict[str, NDArray[np.float32]] = {}
    size: tuple[int, int] | None = None
    try:
        part = 0
        while source.seek_subimage(part, 0):
            spec = source.spec()
            data: Any = source.read_image(part, 0, 0, spec.nchannels, "float")
            if data is None or source.geterror():
                raise InputError(
                    f"{path}: must be a whole image; the file is damaged or was cut short"
                )
            if size is not None and (spec.height, spec.width) != size:
                raise InputError(
                    f"{path}: its parts must have one size (got {size[1]}x{size[0]} and"
                    f" {spec.width}x{spec.height})"
                )
            size = (spec.height, spec.width)
            planes = np.asarray(data, np.float32).reshape(*size, spec.nchannels)
            label = spec.get_string_attribute("oiio:subimagename") or spec.get_string_attribute(
                "name"
            )
            for index, name in enumerate(spec.channelnames):
                plane = np.ascontiguousarray(planes[..., index])
                channels.setdefault(name, plane)
                if label:
                    channels.setdefault(f"{label}.{name}", plane)
            part += 1
    finally:
        source.close()
    return channels


def _name(
    channels: dict[str, NDArray[np.float32]], key: str, given: dict[str, str]
) -> tuple[str, float] | None:
    if key in given:
        return (given[key], 1.0) if given[key] in channels else None
    for known in KNOWN[key]:
        for name in channels:
            if re.fullmatch(known.pattern, name):
                return name, known.factor
    return None


def _find(
    path: Path, channels: dict[str, NDArray[np.float32]], key: str, given: dict[str, str]
) -> NDArray[np.float32]:
    found = _name(channels, key, given)
    if found is None:
        wanted = given.get(key) or " or ".join(name.pattern for name in KNOWN[key])
        wanted = wanted.replace("\\", "").replace("[^.]+", "*")
        raise InputError(
            f"{path}: must have a channel for {key} ({wanted}) (has {', '.join(channels)});"
            f' name it in the protocol: channels = {{ {key} = "..." }}'
        )
    name, factor = found
    return (channels[name] * np.float32(factor)).astype(np.float32)


def _encoded(light: NDArray[np.float64], transfer: str) -> NDArray[np.float32]:
    if transfer == "srgb":
        return encode_srgb(light).astype(np.float32)
    if transfer == "rec709":
        curve = np.where(light < 0.018, 4.5 * light, 1.099 * light**0.45 - 0.099)
        return curve.clip(0, 1).astype(np.float32)
    return light.astype(np.float32)
