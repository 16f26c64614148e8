"""The warp as its paper defines it, in numpy.

Kuffner dos Anjos et al. 2022 ([MI]), section 3.1: neighbouring source pixels form quads, each
is moved by its corners' flow and drawn with a depth test. A quad that is torn apart, because
it ties foreground to background, is kept behind everything else and shows the background's
depth. Depth grows with distance, so eq. 1 holds as printed and the background is the
*maximum* of the corner depths.

Positions are rounded to 1/256 px, and every decision but the order in depth is made on
integers: both twins decide alike, and shared edges leave neither gaps nor double hits.

Twin: gpu.py with *.comp.glsl and shaderlib/warp_*.glsl. Change both or neither.
"""

from dataclasses import dataclass, fields, replace
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from pipeline.frame import (
    Bools,
    Floats,
    Ints,
    SourceFrame,
    TargetWindow,
    WarpedFrame,
    check_same_size,
)
from pipeline.warp.settings import SUBPIXELS, WarpSettings, checked_motion
from pipeline.warp.speckle import without_rim

RINGS = 2  # of vertices around the source pixels
GUARD = 16384 * SUBPIXELS  # vertices farther out are not drawn
REACH = 64 * SUBPIXELS  # how far beyond the window a torn quad's strips are looked for

Scalar = TypeVar("Scalar", bound=np.generic)


def warp(
    frame: SourceFrame,
    flow_px: NDArray[np.float32],
    *,
    target_depth_m: NDArray[np.float32] | None = None,
    window: TargetWindow | None = None,
    settings: WarpSettings = WarpSettings(),  # noqa: B008 (frozen)
) -> WarpedFrame:
    """Show `frame` as the target view sees it.

    Parameters
    ----------
    frame : SourceFrame of size (H, W)
        Colour and depth.
    flow_px : ndarray of float32, shape (H, W, 2)
        Target minus source position, x then y; finite.
    target_depth_m : ndarray of float32, shape (H, W), optional
        Depth of each source pixel as the target camera sees it; not positive behind it. By
        default the source's depth.
    window : TargetWindow, optional
        What is shown, in the source's pixel grid; all of it by default.
    settings : WarpSettings
        Variant and thresholds.

    Raises
    ------
    InputError
        If sizes or types differ, the flow is not finite, or `target_depth_m` is NaN.

    Notes
    -----
    [MI] 3.1, eq. 1.
    """
    flow_px, shown_m = checked_motion(frame, flow_px, target_depth_m, settings)
    depth_m = shown_m.astype(np.float64)
    window = window or TargetWindow.of(frame.size)
    mesh = moved_mesh(depth_m, flow_px, window)
    stretched = mesh.ring_0.copy()
    if settings.variant != "smear":
        stretched |= torn_quads(flow_px, settings.stretch_subpixels(window), settings.surface_px)
    drawn = mesh.drawable & ~mesh.ring_0
    if settings.variant == "full":
        drawn = mesh.drawable
    elif settings.variant == "remove":
        drawn &= ~stretched
    mesh, stretched, drawn = with_strips(mesh, stretched, drawn, frame.size, window)
    mesh, stretched, drawn = with_thin(mesh, stretched, drawn, flow_px, depth_m, window, settings)
    hits = coverage(mesh, drawn, window)
    shown = nearest(hits, partitioned_depth(mesh, stretched, hits), stretched)
    warped = resolve(frame, depth_m, flow_px, mesh, stretched, shown, window, settings)
    return without_rim(warped, settings.rim_px, settings.alike_px(window))


@dataclass(frozen=True, eq=False)
class QuadMesh:
    """Quads between neighbouring vertices; the last axis counts corners a b c d.

    Corners run clockwise from the top left. Vertices are the source pixels and two rings
    around them: the inner ends the border pixels' footprint half a pixel out, the outer
    (`ring_0`) lies beyond the window's edge, so that its quads carry the border's depth into
    what enters the view.
    """

    at: Ints  # (quads, 4, 2): x, y in the window, 1/256 px
    pixel: Ints  # (quads, 4): the source pixel each corner stands for, flat index
    depth_m: Floats  # (quads, 4)
    drawable: Bools  # (quads,): no corner behind the camera or beyond the guard
    ring_0: Bools  # (quads,)


@dataclass(frozen=True, eq=False)
class QuadCoverage:
    """Quads that cover pixel centres, and the weights of their corners there."""

    quad: Ints  # (hits,)
    pixel: Ints  # (hits,): flat index in the window
    weight: Floats  # (hits, 4): 0 for the corner outside the covering triangle


def moved_mesh(depth_m: Floats, flow_px: NDArray[np.float32], window: TargetWindow) -> QuadMesh:
    """Move every vertex by the flow of its pixel."""
    height, width = depth_m.shape
    column, row = (
        np.clip(np.arange(-RINGS, length + RINGS), 0, length - 1) for length in (width, height)
    )
    pixel = row[:, None] * width + column
    home = [
        np.clip(2 * np.arange(-RINGS, length + RINGS) + 1, 0, 2 * length) * (SUBPIXELS // 2)
        for length in (width, height)
    ]
    moved = displacement(flow_px)[row][:, column]
    x = home[0] + moved[..., 0] - SUBPIXELS * window.x_px
    y = home[1][:, None] + moved[..., 1] - SUBPIXELS * window.y_px
    x[:, 0] = np.minimum(x[:, 0], -SUBPIXELS)
    y[0] = np.minimum(y[0], -SUBPIXELS)
    x[:, -1] = np.maximum(x[:, -1], (window.width_px + 1) * SUBPIXELS)
    y[-1] = np.maximum(y[-1], (window.height_px + 1) * SUBPIXELS)
    at = corners(np.stack([x, y], axis=-1))
    depth = corners(depth_m.ravel()[pixel])
    ring = np.ones((height + 2 * RINGS - 1, width + 2 * RINGS - 1), np.bool_)
    ring[1:-1, 1:-1] = False
    return QuadMesh(
        at=at,
        pixel=corners(pixel),
        depth_m=depth,
        drawable=np.logical_and((depth > 0).all(axis=1), (abs(at) <= GUARD).all(axis=(1, 2))),
        ring_0=ring.ravel(),
    )


def with_strips(
    mesh: QuadMesh,
    stretched: Bools,
    drawn: Bools,
    source_size: tuple[int, int],
    window: TargetWindow,
) -> tuple[QuadMesh, Bools, Bools]:
    """Let surfaces reach into the torn quads beside them, by half of their last quad.

    So a surface ends where its outermost pixels end, not at their centres. A torn quad gets a
    strip along each side that it shares with a quad that is whole. Pixels between two torn
    quads, as those inside a blurred step in depth, get none.
    """
    height, width = (length + 2 * RINGS - 1 for length in source_size)
    row, column = np.divmod(np.arange(height * width), width)
    whole = mesh.drawable & ~stretched
    torn = mesh.drawable & stretched & ~mesh.ring_0 & within_reach(mesh.at, window)
    parts = []
    for k, (right, down) in enumerate(((0, -1), (1, 0), (0, 1), (-1, 0))):
        # Torn quads are not in ring 0, so there is always a quad beyond.
        quad = np.flatnonzero(torn)
        beyond = (row[quad] + down) * width + column[quad] + right
        quad, beyond = quad[whole[beyond]], beyond[whole[beyond]]
        ends = [k, (k + 1) % 4]
        side = mesh.at[quad[:, None], ends]
        reach = side + (side - mesh.at[beyond[:, None], ends]) // 2
        order = [*ends, *ends[::-1]]
        at = np.concatenate([side, reach[:, ::-1]], axis=1)
        parts.append(
            surface_quads(at, mesh.pixel[quad[:, None], order], mesh.depth_m[quad[:, None], order])
        )
    return with_surfaces(mesh, stretched, drawn, parts)


def with_thin(
    mesh: QuadMesh,
    stretched: Bools,
    drawn: Bools,
    flow_px: NDArray[np.float32],
    depth_m: Floats,
    window: TargetWindow,
    settings: WarpSettings,
) -> tuple[QuadMesh, Bools, Bools]:
    """Let what is one pixel thin in the source show, though all quads around it are torn.

    Two neighbouring pixels whose side is whole, while both of its quads are torn, are joined by
    a band as wide as the side is long, half of it on either hand: at least one of the two must
    be thin and neither mixed. A thin pixel whose four quads are torn shows one pixel of itself.

    Parameters
    ----------
    mesh, stretched, drawn
        The mesh's quads first; what `with_strips` added may follow.
    flow_px : ndarray of float32, shape (H, W, 2)
        Motion of the source's pixels.
    depth_m : ndarray of shape (H, W)
        Their depth in the target's view.
    """
    stretch = settings.stretch_subpixels(window)
    size = flow_px.shape[:2]
    grid = (size[0] + 2 * RINGS - 1, size[1] + 2 * RINGS - 1)
    count = grid[0] * grid[1]
    at, ring_0 = mesh.at[:count], mesh.ring_0[:count]
    torn = mesh.drawable[:count] & stretched[:count] & ~ring_0
    listed = (torn & within_reach(at, window)).reshape(grid)
    torn = torn.reshape(grid)
    # Per vertex; those beyond the source's pixels are taken for mixed.
    thin, mixed = np.zeros((2, grid[0] + 1, grid[1] + 1), np.bool_)
    mixed[...] = True
    real = tuple(slice(RINGS, RINGS + length) for length in size)
    thin[real], mixed[real] = thin_and_mixed(flow_px, depth_m, stretch, settings.surface_px)
    across, downwards = mesh_sides(flow_px, stretch, settings.surface_px)
    parts = []
    for down, right, severed in ((0, 1, across[:-1]), (1, 0, downwards[:, :-1])):
        # The quad at a side's first vertex lies below it, or right of it.
        beyond = np.roll(torn, (right, down), axis=(0, 1))
        end = slice(down, grid[0] + down), slice(right, grid[1] + right)
        either = (thin[:-1, :-1] | thin[end]) & ~mixed[:-1, :-1] & ~mixed[end]
        quad = np.flatnonzero(listed & beyond & either & ~severed)
        order = [0, 1, 1, 0] if right else [0, 3, 3, 0]
        first, second = at[quad, order[0]], at[quad, order[1]]
        along = second - first
        width = np.stack([along[:, 1], -along[:, 0]], axis=-1)
        half = width // 2
        corner = [first + half, second + half, second + half - width, first + half - width]
        parts.append(
            surface_quads(
                np.stack(corner, axis=1),
                mesh.pixel[quad[:, None], order],
                mesh.depth_m[quad[:, None], order],
            )
        )
    alone = torn & np.roll(torn, 1, axis=0)
    alone &= np.roll(alone, 1, axis=1)
    quad = np.flatnonzero(listed & alone & thin[:-1, :-1])
    square = np.array([(-1, -1), (1, -1), (1, 1), (-1, 1)]) * (SUBPIXELS // 2)
    order = [0, 0, 0, 0]
    parts.append(
        surface_quads(
            at[quad[:, None], order] + square,
            mesh.pixel[quad[:, None], order],
            mesh.depth_m[quad[:, None], order],
        )
    )
    return with_surfaces(mesh, stretched, drawn, parts)


def thin_and_mixed(
    flow_px: NDArray[np.float32], depth_m: Floats, stretch: int, surface_px: int
) -> tuple[Bools, Bools]:
    """Return True for pixels that are a thing of their own, and for those in between two others.

    Along a row, a column or a diagonal, with both sides torn: a pixel lies in between if the
    change of motion goes on (both steps together are longer than either) and its depth is not
    beyond both neighbours'.
    Such a pixel is *mixed*, as those inside a blurred step in depth; it would stand alone in the
    hole. Any other is *thin*: it stands out on both hands. What is mixed along one line is not
    thin along another.

    Returns
    -------
    thin, mixed : ndarray of bool, shape (H, W)
    """
    height, width, _ = flow_px.shape
    row, column = np.indices((height, width)) * SUBPIXELS
    change = displacement(flow_px)
    place = np.stack([column, row], axis=-1) + change
    thin, mixed = np.zeros((2, height * width), np.bool_)
    lines = grid_lines(np.arange(height * width).reshape(height, width))
    if not lines:
        return thin.reshape(height, width), mixed.reshape(height, width)
    pixel = np.concatenate(lines)
    line = np.repeat(np.arange(len(lines)), [len(one) for one in lines])
    sides = torn_sides(place.reshape(-1, 2)[pixel], line, stretch, surface_px)
    both = sides[:-2] & sides[1:-1]
    step = np.diff(change.reshape(-1, 2)[pixel], axis=0)
    single = np.maximum(abs(step[:-1]).max(axis=-1), abs(step[1:]).max(axis=-1))
    onwards = abs(step[:-1] + step[1:]).max(axis=-1) > single
    depth = depth_m.ravel()[pixel]
    before, here, after = depth[:-2], depth[1:-1], depth[2:]
    within = (np.minimum(before, after) <= here) & (here <= np.maximum(before, after))
    mixed[pixel[1:-1][both & onwards & within]] = True
    thin[pixel[1:-1][both & ~(onwards & within)]] = True
    thin &= ~mixed
    return thin.reshape(height, width), mixed.reshape(height, width)


def grid_lines(plane: NDArray[Scalar]) -> list[NDArray[Scalar]]:
    """List the rows, columns and diagonals of `plane` that have three cells or more."""
    height, width = plane.shape
    places = range(1 - height, width)
    diagonals = [np.diagonal(one, k) for one in (plane, plane[:, ::-1]) for k in places]
    return [line for line in (*plane, *plane.T, *diagonals) if len(line) >= 3]


def within_reach(at: Ints, window: TargetWindow) -> Bools:
    """Return True for torn quads that are looked at for the surfaces that reach into them."""
    low, high = pixel_box(at, window, REACH)
    near: Bools = np.asarray((low <= high).all(axis=1))
    return near


def surface_quads(at: Ints, pixel: Ints, depth_m: Floats) -> QuadMesh:
    """Make quads that are drawn beside the mesh's own."""
    none = np.zeros(len(at), np.bool_)
    return QuadMesh(at=at, pixel=pixel, depth_m=depth_m, drawable=~none, ring_0=none)


def with_surfaces(
    mesh: QuadMesh, stretched: Bools, drawn: Bools, parts: list[QuadMesh]
) -> tuple[QuadMesh, Bools, Bools]:
    """Append whole quads to `mesh`."""
    added = sum(len(part.at) for part in parts)
    joined = QuadMesh(
        *(
            np.concatenate([getattr(part, field.name) for part in (mesh, *parts)])
            for field in fields(QuadMesh)
        )
    )
    return (
        joined,
        np.concatenate([stretched, np.zeros(added, np.bool_)]),
        np.concatenate([drawn, np.ones(added, np.bool_)]),
    )


def displacement(flow_px: NDArray[np.float32]) -> Ints:
    """Round the flow to 1/256 px, ties to even."""
    subpixels: Ints = np.rint((flow_px * SUBPIXELS).clip(-2 * GUARD, 2 * GUARD)).astype(np.int64)
    return subpixels


def corners(vertices: NDArray[Scalar]) -> NDArray[Scalar]:
    """Gather the four vertices around each quad of a grid, clockwise from the top left."""
    around = (vertices[:-1, :-1], vertices[:-1, 1:], vertices[1:, 1:], vertices[1:, :-1])
    return np.stack(around, axis=2).reshape(-1, 4, *vertices.shape[2:])


def torn_quads(flow_px: NDArray[np.float32], stretch: int, surface_px: int) -> Bools:
    """Return True for quads that tie two surfaces together: those with a torn side.

    A side is torn if it is longer than `stretch` (1/256 px) and belongs to no surface: a
    surface is `surface_px` sides in line, this one among them, that differ from it by at most
    half its length. So a slanted surface under a strong zoom stays whole, and a step in depth,
    also one blurred over a few pixels, does not. Lengths are the larger of the extents in x
    and y.
    """
    across, down = mesh_sides(flow_px, stretch, surface_px)
    torn: Bools = across[:-1] | across[1:] | down[:, :-1] | down[:, 1:]
    return torn.ravel()


def mesh_sides(flow_px: NDArray[np.float32], stretch: int, surface_px: int) -> tuple[Bools, Bools]:
    """Return True for torn sides of the mesh, by the vertex left of or above them.

    Between horizontal neighbours, shape (H + 4, W + 3); between vertical ones, (H + 3, W + 4).
    """
    height, width, _ = flow_px.shape
    row, column = np.indices((height, width)) * SUBPIXELS
    moved = np.stack([column, row], axis=-1) + displacement(flow_px)
    index = np.arange(height * width).reshape(height, width)

    def torn(vertex: Ints) -> Bools:
        line = np.repeat(np.arange(len(vertex)), vertex.shape[1])
        sides = torn_sides(moved.reshape(-1, 2)[vertex.ravel()], line, stretch, surface_px)
        return sides.reshape(vertex.shape)[:, :-1]

    across, down = torn(index), torn(index.T).T
    # In the mesh, a row or column repeats its border pixel: those sides have no length.
    across = np.pad(np.pad(across, ((RINGS, RINGS), (0, 0)), mode="edge"), ((0, 0), (RINGS, RINGS)))
    down = np.pad(np.pad(down, ((0, 0), (RINGS, RINGS)), mode="edge"), ((RINGS, RINGS), (0, 0)))
    return across, down


def torn_sides(moved: Ints, line: Ints, stretch: int, surface_px: int) -> Bools:
    """Return True for vertices that are torn from the next one of their line; see `torn_quads`.

    Parameters
    ----------
    moved : (n, 2)
        Where the vertices are, one line after the other.
    line : (n,)
        Which line each is of.

    Returns
    -------
    ndarray of bool, shape (n,)
        False for the last vertex of a line.
    """
    side = np.diff(moved, axis=0)
    length = np.where(line[1:] == line[:-1], abs(side).max(axis=-1), 0)
    long = np.flatnonzero(length > stretch)
    run = np.ones(len(long), np.int64)
    for direction in (-1, 1):
        alike = np.ones(len(long), np.bool_)
        for steps in range(1, surface_px):
            if not alike.any():
                break
            other = np.clip(long + direction * steps, 0, len(side) - 1)
            # Past the end of a line there is no side.
            there = (line[other] == line[long]) & (line[other + 1] == line[long])
            there &= abs(other - long) == steps
            change = abs(side[other] - side[long]).max(axis=-1)
            alike &= there & (2 * change <= length[long])
            run += alike
    torn = np.zeros(len(moved), np.bool_)
    torn[long] = run < surface_px
    return torn


def coverage(mesh: QuadMesh, drawn: Bools, window: TargetWindow) -> QuadCoverage:
    """Find every pixel centre that each drawn quad covers.

    Quads fall into the triangles abc and acd. A centre on a shared edge belongs to the
    triangle below or, on a vertical edge, right of it (the edge is its top or left one), as if
    centres were shifted right by an infinitely small amount and down by one smaller still. A
    triangle turned over by the motion covers nothing; another surface always covers its place.
    """
    quads = np.flatnonzero(drawn)
    low, high = pixel_box(mesh.at[quads], window)
    box = np.maximum(high - low + 1, 0)
    count = box.prod(axis=1)
    # One candidate for each pixel of each bounding box.
    which = np.repeat(np.arange(len(quads)), count)
    rank = np.arange(len(which)) - np.repeat(count.cumsum() - count, count)
    x = low[which, 0] + rank % box[which, 0]
    y = low[which, 1] + rank // box[which, 0]
    centre = np.stack([x, y], axis=-1) * SUBPIXELS + SUBPIXELS // 2
    corner = mesh.at[quads[which]] - centre[:, None]
    weight = np.zeros((len(which), 4))
    for triangle in ((0, 1, 2), (0, 2, 3)):
        found, shares = inside(corner[:, triangle])
        weight[np.flatnonzero(found)[:, None], triangle] = shares
    hit = weight.any(axis=1)
    return QuadCoverage(quads[which[hit]], (y * window.width_px + x)[hit], weight[hit])


def pixel_box(at: Ints, window: TargetWindow, reach: int = 0) -> tuple[Ints, Ints]:
    """Give the first and last pixel (x, y) of each quad's bounding box, grown by `reach`.

    Centres on the box's right or lower edge belong to the next quad.
    """
    low = (at.min(axis=1) - reach + SUBPIXELS // 2 - 1) // SUBPIXELS
    high = (at.max(axis=1) + reach - SUBPIXELS // 2 - 1) // SUBPIXELS
    last = (window.width_px - 1, window.height_px - 1)
    return np.maximum(low, 0), np.minimum(high, last)


def inside(corner: Ints) -> tuple[Bools, Floats]:
    """Return True for triangles, shape (n, 3, 2), that hold the origin, and corners' weights."""
    after = np.roll(corner, -1, axis=1)
    # Twice the area between the origin and each edge; each weighs the corner opposite.
    side = corner[..., 0] * after[..., 1] - corner[..., 1] * after[..., 0]
    edge = after - corner
    top_left = (edge[..., 1] < 0) | ((edge[..., 1] == 0) & (edge[..., 0] > 0))
    found = ((side > 0) | ((side == 0) & top_left)).all(axis=1)
    opposite = np.roll(side[found], -1, axis=1)
    return found, opposite / opposite.sum(axis=1, keepdims=True)


def partitioned_depth(mesh: QuadMesh, stretched: Bools, hits: QuadCoverage) -> Floats:
    """Partition depth so that one test serves surfaces and holes ([MI] eq. 1).

    With d in [0, 1] growing with distance, a surface gets ``0.5 d`` and a stretched quad
    ``1 - 0.5 d``: it loses against every surface, and against a farther stretched one.

    d is ``1 - z_near / z``, linear in the image plane. Any z_near gives the same order, so
    the nearest depth there is will do.
    """
    with np.errstate(divide="ignore"):  # quads behind the camera are not among the hits
        inverse = np.where(mesh.depth_m > 0, 1 / mesh.depth_m, 0)
    near = inverse.max() or 1.0
    d = 1 - inverse[hits.quad] / near
    base = d[:, 0]  # exact where all corners are equally far
    surface = 0.5 * (base + (hits.weight * (d - base[:, None])).sum(axis=1))
    background = 1 - 0.5 * d.max(axis=1)
    partitioned: Floats = np.where(stretched[hits.quad], background, surface)
    return partitioned


def nearest(hits: QuadCoverage, depth: Floats, stretched: Bools) -> QuadCoverage:
    """Keep, at each pixel, the hit of least depth.

    At infinity, where the halves of eq. 1 meet, the surface; then the first quad among equals.
    """
    order = np.lexsort((hits.quad, stretched[hits.quad], depth, hits.pixel))
    _, first = np.unique(hits.pixel[order], return_index=True)
    kept = order[first]
    return QuadCoverage(hits.quad[kept], hits.pixel[kept], hits.weight[kept])


def resolve(
    frame: SourceFrame,
    depth_m: Floats,
    flow_px: NDArray[np.float32],
    mesh: QuadMesh,
    stretched: Bools,
    shown: QuadCoverage,
    window: TargetWindow,
    settings: WarpSettings,
) -> WarpedFrame:
    """Give each pixel what its quad carries: interpolated, or the background's depth."""
    size = (window.height_px, window.width_px)
    colour = np.zeros((size[0] * size[1], 3))
    depth = np.zeros(size[0] * size[1])
    flow = np.zeros((size[0] * size[1], 2))
    hole = np.ones(size[0] * size[1], np.bool_)

    surface = ~stretched[shown.quad]
    at, pixel = shown.pixel[surface], mesh.pixel[shown.quad[surface]]
    weight = shown.weight[surface, :, None]
    hole[at] = False
    colour[at] = (weight * frame.colour.reshape(-1, 3)[pixel]).sum(axis=1).clip(0, 1)
    flow[at] = (weight * flow_px.reshape(-1, 2)[pixel]).sum(axis=1)
    with np.errstate(divide="ignore"):  # 1 / depth is linear in the image plane
        depth[at] = 1 / (weight[..., 0] / depth_m.ravel()[pixel]).sum(axis=1)

    at, pixel = shown.pixel[~surface], mesh.pixel[shown.quad[~surface]]
    # Of equally far corners the first in reading order: a b d c.
    candidates = pixel[:, [0, 1, 3, 2]]
    farthest = depth_m.ravel()[candidates].argmax(axis=1)
    source = np.take_along_axis(candidates, farthest[:, None], axis=1)[:, 0]
    depth[at] = depth_m.ravel()[source]
    flow[at] = flow_px.reshape(-1, 2)[source]

    plane, motion = depth.reshape(size), flow.reshape(*size, 2)
    if settings.variant == "full":
        plane, motion = continued(plane, motion)
    return WarpedFrame(
        colour.reshape(*size, 3).astype(np.float32),
        np.where(plane > 0, plane, np.inf).astype(np.float32),
        hole.reshape(size),
        motion.astype(np.float32),
    )


def continued(depth_m: Floats, flow_px: Floats) -> tuple[Floats, Floats]:
    """Continue depth and motion into pixels that no quad reached (depth 0).

    Along rows each run of them takes the farther of its two ends; then along columns. They
    are rare: quads behind the camera leave them.
    """
    depth, flow = depth_m.copy(), flow_px.copy()
    for _ in range(2):
        for row in np.flatnonzero((depth == 0).any(axis=1) & (depth > 0).any(axis=1)):
            known = np.flatnonzero(depth[row] > 0)
            for column in np.flatnonzero(depth[row] == 0):
                after = np.searchsorted(known, column)
                ends = known[max(after - 1, 0) : after + 1]
                source = ends[depth[row, ends].argmax()]
                depth[row, column] = depth[row, source]
                flow[row, column] = flow[row, source]
        depth, flow = depth.T.copy(), flow.swapaxes(0, 1).copy()
    return depth, flow


def completed(first: WarpedFrame, second: WarpedFrame) -> WarpedFrame:
    """Take from `second` what is a hole in `first`: colour, depth and motion.

    Parameters
    ----------
    first, second : WarpedFrame
        The same view of the same moment, warped from two pictures.

    Returns
    -------
    WarpedFrame
        Holes are where both have holes, with the first picture's background behind them.

    Raises
    ------
    InputError
        If their sizes differ.
    """
    check_same_size(first=first.depth_m, second=second.depth_m)
    take = first.hole & ~second.hole
    return replace(
        first,
        colour=np.where(take[..., None], second.colour, first.colour),
        depth_m=np.where(take, second.depth_m, first.depth_m),
        flow_px=np.where(take[..., None], second.flow_px, first.flow_px),
        hole=first.hole & second.hole,
    )
