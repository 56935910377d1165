# SPDX-License-Identifier: Apache-2.0
"""Last small pieces of level sets that lie between the nodes of the grid.

Round its deepest point the distance may pass a level between the nodes, so that the
grid does not meet it. The surroundings of such a node are sampled more finely.
"""

from __future__ import annotations

import numpy as np

from vega_planner.datatypes import Ints, Part
from vega_planner.layers import grid_kernels, triangle_kernels
from vega_planner.layers.contour import Sheet, contour_levels
from vega_planner.layers.distance_field import DistanceField
from vega_planner.layers.geodesic import Sources
from vega_planner.layers.grid import Grid, finish, inside_states

#: Height of a summit over its level, in t, up to which nothing is looked for: a bead is
#: wider than such a piece.
LOWEST_RATIO = 0.15

#: Nodes of the fine grid to one spacing of the coarse one.
FINENESS = 4

#: Spacings from the summit's node to the sides of the fine grid.
_REACH = 2

#: Summits that are looked at; the deepest are the ones that matter.
MOST_SUMMITS = 24


def with_summits(
    part: Part,
    grid: Grid,
    field: DistanceField,
    brr: DistanceField | None,
    sheets: list[Sheet],
    t: float,
) -> list[Sheet]:
    """Add the pieces of level sets that the grid has missed.

    Pieces that reach farther than two spacings are left to the core.

    Args:
        part: The part.
        grid: Signed distances at the nodes.
        field: Distances to S, straight ones.
        brr: Distances to the restraint region, or None.
        sheets: The level sets found, from t/2 on, t apart.
        t: Distance between levels [mm].

    Returns:
        The sheets, with one more where the deepest level was missed.
    """
    sheets = list(sheets)
    pieces: list[tuple[int, Sheet]] = []
    for node in _summits(grid, t):
        level = int(grid.level[node])
        piece = _piece(part, grid, field, brr, node, (level + 0.5) * t)
        if piece is not None:
            pieces.append((level, piece))
    for level, piece in sorted(pieces, key=lambda item: item[0]):
        if level < len(sheets):
            sheets[level] = _joined(sheets[level], piece)
        elif level == len(sheets):
            sheets.append(piece)
    return sheets


def _summits(grid: Grid, t: float) -> list[int]:
    """Choose nodes about which the distance may pass the next level unseen."""
    h = grid.spacing
    _, ny, nz = grid.shape
    d = grid.distance
    inside = np.flatnonzero(grid.state == grid_kernels.INSIDE)
    short = (grid.level[inside] + 0.5) * t - d[inside]
    nodes = inside[short < np.sqrt(0.75) * h - LOWEST_RATIO * t]
    offsets = [
        (i * ny + j) * nz + k
        for i in (-1, 0, 1)
        for j in (-1, 0, 1)
        for k in (-1, 0, 1)
        if (i, j, k) != (0, 0, 0)
    ]
    for offset in sorted(offsets, key=abs):
        other = nodes + offset
        deeper = (d[other] > d[nodes]) & (grid.state[other] == grid_kernels.INSIDE)
        nodes = nodes[~deeper]
    nodes = nodes[np.argsort(-d[nodes], kind="stable")]
    chosen: list[int] = []
    places = grid.points(nodes)
    kept = np.zeros((0, 3))
    for node, place in zip(nodes, places):
        if len(kept) and np.abs(kept - place).max(1).min() < h * 1.5:
            continue
        chosen.append(int(node))
        kept = np.vstack([kept, place])
        if len(chosen) == MOST_SUMMITS:
            break
    return chosen


def _piece(
    part: Part, grid: Grid, field: DistanceField, brr: DistanceField | None, node: int, r: float
) -> Sheet | None:
    """Contour one level round a node finely; None where nothing, or nothing new, is there."""
    from scipy.ndimage import label

    margin = 2
    h = grid.spacing / FINENESS
    width = 2 * (_REACH * FINENESS + margin) + 1
    shape = (width, width, width)
    centre = grid.points(np.array([node]))[0]
    origin = centre - (width // 2) * h
    box = inside_states(part.vertices, part.faces, origin, h, shape).reshape(shape)
    for axis in range(3):
        ends = np.moveaxis(box, axis, 0)
        ends[:margin] = ends[-margin:] = grid_kernels.NONE
    state = box.ravel()
    grid_kernels.mark_ring(state, *shape, 1, width - 1)
    nodes = np.flatnonzero(state != grid_kernels.NONE)
    slots, distances = np.zeros(len(nodes), np.int64), np.zeros(len(nodes))
    feet = np.zeros((len(nodes), 3))
    points = origin + h * np.stack(np.unravel_index(nodes, shape), axis=1)
    triangle_kernels.nearest_many(
        field.tri, field.box, points, 0, len(nodes), slots, distances, feet
    )
    if distances.max(initial=0.0) <= r:
        return None
    distance, slot = np.zeros(width**3, np.float32), np.full(width**3, -1, np.int32)
    distance[nodes], slot[nodes] = distances, slots
    gradient, level = np.zeros((width**3, 3), np.float32), np.zeros(width**3, np.int16)
    fine = Grid(origin, h, shape, state, distance, slot, gradient, level)
    once = 1e3 * r
    finish(fine, field.tri, brr, r, once)
    above = ((level > 0) & (state == grid_kernels.INSIDE)).reshape(shape)
    numbers, _ = label(above, np.ones((3, 3, 3)))
    deepest = int(np.argmax(np.where(above.ravel(), distance, -1.0)))
    number = numbers.ravel()[deepest]
    if number == 0 or not _is_new(numbers == number, margin):
        return None
    others = ((numbers > 0) & (numbers != number)).ravel()
    level[others] = 0
    found = contour_levels(fine, Sources.straight(field), brr, r, once)
    if not found or len(found[0].faces) == 0:
        return None
    return found[0]


def _is_new(piece: np.ndarray, margin: int) -> bool:
    """Tell whether a piece ends within the fine grid and holds no node of the coarse one."""
    inner = np.zeros_like(piece)
    inner[(slice(margin + 1, -margin - 1),) * 3] = True
    coarse = piece[(slice(margin, None, FINENESS),) * 3]
    return not (piece & ~inner).any() and not coarse.any()


def _joined(sheet: Sheet, piece: Sheet) -> Sheet:
    """Put two sheets of one level together."""
    faces: Ints = np.concatenate([sheet.faces, piece.faces + len(sheet.vertices)])
    return Sheet(
        sheet.depth,
        np.concatenate([sheet.vertices, piece.vertices]),
        faces,
        np.concatenate([sheet.slots, piece.slots]),
        np.concatenate([sheet.rim, piece.rim]),
        np.concatenate([sheet.inward, piece.inward]),
    )
