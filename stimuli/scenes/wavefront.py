"""Wavefront .obj and .mtl files as shapes."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from itertools import chain
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from pipeline.errors import InputError
from pipeline.image_file import check_picture, read_pixels, stated_size_px
from protocols.outside import visible_line
from stimuli.scenes.mesh_features import Notes, check_statement, row_of
from stimuli.scenes.mesh_inputs import libraries_of, name_and_options, place_of, statements
from stimuli.scenes.mesh_surface import Pixels, Shape, Surface, decoded, shares

Array = NDArray[np.float64]

_VALUES: Final = re.compile(r"[-+]?(\d+\.?\d*|\.\d+)([eE][-+]?\d+)?")
_CHANNELS: Final = {"r": 0, "g": 1, "b": 2, "m": 3}
_LENGTHS: Final = {"v": (3, 4, 6, 7), "vt": (1, 2, 3), "vn": (3,)}
_NUMBERED: Final = {*_LENGTHS, "f", "fo"}


@dataclass
class _Faces:
    """Faces of one material and smoothing group: their corners, as the file names them."""

    corners: list[str] = field(default_factory=list)
    lengths: list[int] = field(default_factory=list)


def read_obj(path: Path, notes: Notes) -> Iterator[Shape]:
    """Yield the shapes of an .obj file, by material and smoothing group.

    Raises
    ------
    InputError
        If it, or a library that it names, says what cannot be drawn.
    """
    lists: dict[str, list[str]] = {"v": [], "vt": [], "vn": []}
    groups: dict[tuple[str | None, str], _Faces] = {}
    material, smoothing = None, "off"
    for number, word, rest in statements(path):
        if word in _NUMBERED:
            rest = rest.partition("#")[0]
            if "_" in rest:  # Python takes it for a part of a number
                raise _wrong(path, number, f"numbers are written {rest[:40]!r}")
        if word in lists:
            lists[word].append(rest)
        elif word in ("f", "fo"):
            faces = groups.setdefault((material, smoothing), _Faces())
            corners = rest.split()
            if len(corners) < 3:
                raise _wrong(path, number, f"a face must have three corners, not {len(corners)}")
            if "-" in rest:
                corners = [_absolute(corner, lists) for corner in corners]
            faces.corners += corners
            faces.lengths.append(len(corners))
        elif not check_statement(notes, ".obj", word, number):
            continue
        elif word == "usemtl":
            material = rest or None
        elif word == "s":
            smoothing = "off" if rest in ("0", "") else rest.lower()
    materials = _materials(path, notes, {name for name, _ in groups if name is not None})
    known = {word: _rows(path, notes, word, rows) for word, rows in lists.items()}
    for (name, smooth), faces in groups.items():
        surface, laid = materials.get(name, (Surface(str(name)), _Laid()))
        yield from _shapes(path, notes, surface, laid, faces, known, smooth != "off")


def _wrong(path: Path, line: int, what: str) -> InputError:
    return InputError(f"{path}: must be a whole .obj file (line {line}: {what}); export it again")


def _absolute(corner: str, lists: dict[str, list[str]]) -> str:
    """Count a corner's negative numbers from the end of the lists as they are so far."""
    parts = corner.split("/")
    for place, word in enumerate(("v", "vt", "vn")[: len(parts)]):
        if parts[place].startswith("-"):
            parts[place] = str(len(lists[word]) + 1 + int(parts[place]))
    return "/".join(parts)


def _rows(path: Path, notes: Notes, word: str, rows: list[str]) -> Array:
    """Numbers of the lines of one kind; colours are NaN where a position has none."""
    split = [row.split() for row in rows]
    widths = set(map(len, split))
    if not widths <= set(_LENGTHS[word]):
        odd = next(row for row in split if len(row) not in _LENGTHS[word])
        wanted = " or ".join(map(str, _LENGTHS[word]))
        raise InputError(
            f"{path}: must be a whole .obj file ({word} must have {wanted} numbers, not"
            f" {len(odd)}); export it again"
        )
    if word == "v":  # x y z, and a weight or a colour, or a colour and its alpha
        if widths & {4, 7} and any(len(row) in (4, 7) and float(row[-1]) != 1 for row in split):
            notes.left_out("last number of v", "polygons have no weights, and corners no alpha")
        split = (
            [row if len(row) in (6, 7) else row[:3] + ["nan"] * 3 for row in split]
            if widths - {3}
            else split
        )
        split = [row[:6] for row in split]
    elif word == "vt":
        split = [[*row, "0"][:2] for row in split]
    numbers = np.fromiter(map(float, chain.from_iterable(split)), np.float64)
    numbers = numbers.reshape(-1, len(split[0]) if split else 3)
    if not np.isfinite(numbers[:, :3]).all():
        what = "positions" if word == "v" else word
        raise InputError(
            f"{path}: {what} must be finite (some of {len(rows)} are not); export it again"
        )
    return numbers


def _shapes(
    path: Path,
    notes: Notes,
    surface: Surface,
    laid: _Laid,
    faces: _Faces,
    known: dict[str, Array],
    smooth: bool,
) -> Iterator[Shape]:
    """Yield the faces with normals of their own, and those without."""
    places: dict[str, int] = {}
    corners = np.array([places.setdefault(c, len(places)) for c in faces.corners], np.int64)
    named = np.array([_numbers_of(path, corner) for corner in places], np.int64)
    for column, word in enumerate(("v", "vt", "vn")):
        far = named[:, column] > len(known[word])
        if far.any() or (named[:, column] < 0).any() or (word == "v" and not named[:, 0].all()):
            raise InputError(
                f"{path}: must be a whole .obj file (a face names a {word} that is not there, among"
                f" {len(known[word])}); export it again"
            )
    position = known["v"][named[:, 0] - 1]
    triangles = _cut(position[:, :3], corners, np.array(faces.lengths))
    has_normal = (named[:, 2] > 0)[triangles].all(axis=1)
    pictured = surface.picture is not None or surface.glow is not None
    if pictured and not named[:, 1].all():
        notes.say(f"faces of material {surface.name!r} without vt show the corner of its picture")
    uv = None
    if pictured:
        coordinates = np.concatenate([np.zeros((1, 2)), known["vt"].reshape(-1, 2)])
        uv = coordinates[named[:, 1]] * laid.scale + laid.offset
    colour = None
    if position.shape[1] > 3 and not np.isnan(position[:, 3]).all():
        colour = shares(path, "colours of v", np.nan_to_num(position[:, 3:6], nan=1.0))
    normals = np.concatenate([np.zeros((1, 3)), known["vn"]])[named[:, 2]]
    for with_normal in (True, False):
        chosen = triangles[has_normal == with_normal]
        if not len(chosen):
            continue
        normal = normals if with_normal else None
        if not with_normal and smooth:
            normal = _smoothed(position[:, :3], named[:, 0], chosen)
        yield Shape(surface, position[:, :3], chosen, normal, uv, colour)


def _numbers_of(path: Path, corner: str) -> tuple[int, int, int]:
    parts = corner.split("/")
    if len(parts) > 3:
        raise InputError(
            f"{path}: must be a whole .obj file (a corner of a face is {corner[:40]!r}); export it"
            " again"
        )
    # 0 stands for a part that is left out: what is written so names nothing.
    first, second, third = (int(part) or -1 if part else 0 for part in [*parts, "", ""][:3])
    return first, second, third


def _smoothed(position: Array, vertex: NDArray[np.int64], triangles: NDArray[np.int64]) -> Array:
    """Normals of corners: the mean of the faces of a smoothing group at a place, by their area."""
    first, second, third = position[triangles].transpose(1, 0, 2)
    area = np.cross(second - first, third - first)
    sums = np.zeros((int(vertex.max()) + 1, 3))
    for corner in range(3):
        np.add.at(sums, vertex[triangles[:, corner]], area)
    normal: Array = sums[vertex]
    normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-30)
    return normal


# Faces of more than three corners


def _cut(
    position: Array, corners: NDArray[np.int64], lengths: NDArray[np.int64]
) -> NDArray[np.int64]:
    """Cut faces into triangles, in their order: fans, or by ears where they are not convex."""
    ends, stops = np.cumsum(lengths), np.cumsum(lengths - 2)
    starts, pieces = ends - lengths, lengths - 2
    owner = np.repeat(np.arange(len(lengths)), pieces)
    step = np.arange(len(owner)) - np.repeat(stops - pieces, pieces)

    def fans(tip: NDArray[np.int64]) -> NDArray[np.int64]:
        places = [(tip[owner] + ahead) % lengths[owner] for ahead in (0, step + 1, step + 2)]
        return np.stack([corners[starts[owner] + place] for place in places], axis=1)

    triangles = fans(0 * lengths)
    if (lengths == 3).all():
        return triangles
    a, b, c = position[triangles].transpose(1, 0, 2)
    normal = np.add.reduceat(np.cross(b - a, c - a), stops - pieces, axis=0)
    # In a convex face every corner turns to the same side.
    face = np.repeat(np.arange(len(lengths)), lengths)
    before, after = np.arange(len(corners)) - 1, np.arange(len(corners)) + 1
    before[starts], after[ends - 1] = ends - 1, starts
    here = position[corners]
    turn = np.cross(here - here[before], here[after] - here)
    side = (turn * normal[face]).sum(axis=1) / np.maximum((normal**2).sum(axis=1), 1e-30)[face]
    dents = np.flatnonzero(side < -1e-6)
    tip = 0 * lengths
    tip[face[dents]] = dents - starts[face[dents]]  # from its only dent all of a face is seen
    triangles = fans(tip)
    for bent in np.flatnonzero(np.bincount(face[dents], minlength=len(lengths)) > 1):
        ring = corners[starts[bent] : ends[bent]]
        triangles[stops[bent] - pieces[bent] : stops[bent]] = _ears(position, ring, normal[bent])
    return triangles


def _ears(position: Array, ring: NDArray[np.int64], normal: Array) -> NDArray[np.int64]:
    """Triangles of a face that is not convex: corners whose triangle holds no other are cut off."""
    axes = np.delete(np.arange(3), int(np.abs(normal).argmax()))
    flat = position[ring][:, axes]
    u, v = flat[:, 0], flat[:, 1]
    if (u * np.roll(v, -1) - v * np.roll(u, -1)).sum() < 0:
        flat = flat[:, ::-1]

    left, found = np.arange(len(ring)), []
    while len(left) > 3:
        here, ahead, behind = flat[left], flat[np.roll(left, -1)], flat[np.roll(left, 1)]
        convex = _turn(behind, here, ahead) > 0
        # Corners may be repeated, where a bridge leads to a hole: a cut must begin and end inside.
        inside = ~np.roll(convex, 1) | (_turn(np.roll(behind, 1, axis=0), behind, ahead) >= 0)
        inside &= ~np.roll(convex, -1) | (_turn(behind, ahead, np.roll(ahead, -1, axis=0)) >= 0)
        folded = (here == ahead).all(axis=1) | (behind == ahead).all(axis=1)
        dents = here[~convex]
        ears = (
            place
            for place in [*np.flatnonzero(folded), *np.flatnonzero(convex & inside)]
            if folded[place] or not _holds(behind[place], here[place], ahead[place], dents)
        )
        place = int(next(ears, 0))  # none: it crosses itself, and any cut is as good
        found.append((left[place - 1], left[place], left[(place + 1) % len(left)]))
        left = np.delete(left, place)
    found.append((left[0], left[1], left[2]))
    triangles: NDArray[np.int64] = ring[np.array(found)]
    return triangles


def _turn(a: Array, b: Array, c: Array) -> Array:
    """Twice the area of triangles in the plane; positive where they turn to the left."""
    found: Array = (b - a)[..., 0] * (c - a)[..., 1] - (b - a)[..., 1] * (c - a)[..., 0]
    return found


def _holds(a: Array, b: Array, c: Array, points: Array) -> bool:
    """True if a triangle holds any of some points besides its corners."""
    inside = (_turn(a, b, points) >= 0) & (_turn(b, c, points) >= 0) & (_turn(c, a, points) >= 0)
    corner = ((points == a) | (points == b) | (points == c)).all(axis=1)
    return bool((inside & ~corner).any())


# Materials


@dataclass(frozen=True)
class _Laid:
    """Placement of a picture on the coordinates of a mesh: by -s, -o and -clamp."""

    scale: tuple[float, float] = (1.0, 1.0)
    offset: tuple[float, float] = (0.0, 0.0)
    clamp: bool = False


def _materials(path: Path, notes: Notes, used: set[str]) -> dict[str | None, tuple[Surface, _Laid]]:
    described: dict[str, tuple[Path, dict[str, str]]] = {}
    libraries = [place_of(path, name) for name in libraries_of(path)]
    for library in dict.fromkeys(libraries):
        for name, entries in _entries(library).items():
            if described.setdefault(name, (library, entries))[1] != entries:
                raise InputError(
                    f"{library}: must describe each material once ({name!r} is there twice, and"
                    " differs); delete one of them"
                )
    lost = sorted(used - described.keys())
    if libraries and lost:
        raise InputError(
            f"{path}: must use materials that its libraries have"
            f" ({', '.join(file.name for file in libraries)} lack {lost[0][:200]!r}); export it"
            " again, with its materials"
        )
    if lost:
        names = visible_line(", ".join(lost))[:80]
        notes.say(f"its materials are white, because it names no mtllib ({names})")
    pictures: dict[Path, Pixels] = {}
    found: dict[str | None, tuple[Surface, _Laid]] = {}
    for library in dict.fromkeys(libraries):
        beside = notes.beside(library)
        for number, word, _ in statements(library):
            check_statement(beside, ".mtl", word, number)
        for name, (place, entries) in described.items():
            if place == library and name in used:
                found[name] = _Described(path, beside, name, entries, pictures).surface()
    return found


def _entries(library: Path) -> dict[str, dict[str, str]]:
    found: dict[str, dict[str, str]] = {}
    now: dict[str, str] = {}
    for number, word, rest in statements(library):
        if word in ("kd", "ke", "d", "tr"):
            rest = rest.partition("#")[0].rstrip()
        if word == "newmtl":
            if rest in found:
                raise InputError(
                    f"{library}: line {number}: must describe each material once ({rest!r} is there"
                    " twice); delete one of them"
                )
            now = found[rest] = {}
        elif found and now.setdefault(word, rest) != rest:
            raise InputError(
                f"{library}: line {number}: must say {word!r} once for a material; delete one of"
                " the lines"
            )
    return found


@dataclass
class _Described:
    """A material of a library, on its way to a surface."""

    path: Path
    notes: Notes
    name: str
    entries: dict[str, str]
    pictures: dict[Path, Pixels]
    laid: _Laid | None = None

    def surface(self) -> tuple[Surface, _Laid]:
        """Return the surface, and how its pictures lie."""
        picture, mask, glow = (self._picture(key) for key in ("map_kd", "map_d", "map_ke"))
        colour = self._colour("kd", (0.4, 0.4, 0.4) if picture is None else (1.0, 1.0, 1.0))
        emission = self._colour("ke", (0.0, 0.0, 0.0) if glow is None else (1.0, 1.0, 1.0))
        if picture is not None and colour != (1.0, 1.0, 1.0):
            self.notes.left_out("Kd beside map_Kd", "the picture replaces it")
            colour = (1.0, 1.0, 1.0)
        if glow is not None and emission != (1.0, 1.0, 1.0):
            self.notes.left_out("Ke beside map_Ke", "the picture replaces it")
            emission = (1.0, 1.0, 1.0)
        alpha = self._alpha()
        if mask is not None:
            picture = _masked(picture, mask)
        laid = self.laid or _Laid()
        plain = mask is None and alpha == 1
        surface = Surface(
            self.name,
            colour,
            alpha,
            picture,
            glow,
            emission,
            "BLEND" if not plain else "OPAQUE" if picture is None else "CUT",
            wrap=("clamp", "clamp") if laid.clamp else ("repeat", "repeat"),
        )
        return surface, laid

    def _wrong(self, key: str, wanted: str, cure: str) -> InputError:
        return InputError(
            f"{self.notes.path}: material {self.name!r}: {key} must be {wanted} (got"
            f" {self.entries[key][:80]!r}); {cure}"
        )

    def _colour(self, key: str, default: tuple[float, float, float]) -> tuple[float, float, float]:
        if key not in self.entries:
            return default
        words = self.entries[key].split()
        words = words * 3 if len(words) == 1 else words
        if len(words) != 3 or not all(map(_VALUES.fullmatch, words)):
            raise self._wrong(key, "three numbers, red, green and blue", "write it so")
        red, green, blue = map(float, words)
        if key == "kd":
            shares(self.notes.path, f"kd of material {self.name!r}", np.array([red, green, blue]))
        return red, green, blue

    def _alpha(self) -> float:
        """Return d, or 1 - Tr where there is no d."""
        found = {}
        for key in ("d", "tr"):
            if key in self.entries:
                if not _VALUES.fullmatch(self.entries[key]):
                    raise self._wrong(key, "one number from 0 to 1", "write it so")
                found[key] = float(self.entries[key])
                what = f"{key} of material {self.name!r}"
                shares(self.notes.path, what, np.array([found[key]]))
        alpha = found.get("d", 1 - found.get("tr", 0.0))
        if "tr" in found and abs(alpha - (1 - found["tr"])) > 1e-3:
            self.notes.left_out("Tr beside d", "d counts")
        if alpha <= 0:
            key = "d" if "d" in found else "tr"
            raise self._wrong(
                key, "a surface that can be seen", "write d 1, or delete the faces of the material"
            )
        return alpha

    def _picture(self, key: str) -> Pixels | None:
        if key not in self.entries:
            return None
        if not self.entries[key]:
            raise self._wrong(key, "the name of a picture", "write it, or delete the line")
        name, options = name_and_options(self.path, self.notes.path, self.entries[key])
        laid, channel = _Laid(), ""
        for option, values in options:
            numbers = tuple(map(float, values)) if option in ("-s", "-o", "-mm", "-t") else ()
            given = numbers or values[0].lower()
            if option == "-s":
                laid = replace(laid, scale=_two(numbers, 1.0))
            elif option == "-o":
                laid = replace(laid, offset=_two(numbers, 0.0))
            elif option == "-clamp":
                laid = replace(laid, clamp=given == "on")
            elif option == "-imfchan" and key == "map_d":
                channel = values[0].lower()
            elif option == "-imfchan":
                self.notes.left_out(f"{option} of {key}", "colours are three")
            elif row := row_of("options of map_", option):
                found = f"{key} of material {self.name!r} has {option} {' '.join(values)}"
                self.notes.judge(row, f"{option} of {key}", given, found)
        if self.laid not in (None, laid):
            raise InputError(
                f"{self.notes.path}: the pictures of material {self.name!r} must lie alike (-s, -o"
                " and -clamp differ); bake one of them to the coordinates of the other"
            )
        self.laid = laid
        place = place_of(self.path, name, self.notes.path)
        if place not in self.pictures:
            what = f"which {self.notes.path.name} names"
            self.pictures[place] = decoded(place.read_bytes(), str(place), what)
            if stated_size_px(place) is not None:  # else it is of a kind that only Pillow reads
                check_picture(place, read_pixels(place), ("PixelAspectRatio",))
        pixels = self.pictures[place]
        return _channel(pixels, channel) if key == "map_d" else pixels


def _two(numbers: tuple[float, ...], default: float) -> tuple[float, float]:
    return numbers[0], numbers[1] if len(numbers) > 1 else default


def _channel(pixels: Pixels, channel: str) -> Pixels:
    """Return the values of a mask, shape (H, W): by -imfchan, or its alpha if any, or its grey.

    Grey is the luminance, which a picture of black and white has in every channel.
    """
    if channel in _CHANNELS or (not channel and (pixels[..., 3] < 255).any()):
        return pixels[..., _CHANNELS.get(channel, 3)]
    return np.rint(pixels[..., :3] @ [0.2126, 0.7152, 0.0722]).astype(np.uint8)


def _masked(picture: Pixels | None, mask: Pixels) -> Pixels:
    """Return a picture with a mask as its alpha, as large as the larger of both."""
    colour = np.full((1, 1, 3), 255, np.uint8) if picture is None else picture[..., :3]
    height, width = (max(colour.shape[axis], mask.shape[axis]) for axis in (0, 1))
    both = (
        plane if plane.shape[:2] == (height, width)
        else np.asarray(Image.fromarray(plane).resize((width, height), Image.Resampling.BILINEAR))
        for plane in (np.ascontiguousarray(colour), np.ascontiguousarray(mask))
    )  # fmt: skip
    return np.dstack([*both])
