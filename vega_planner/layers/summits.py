# SPDX-License-Identifier: Apache-2.0
"""Last small pieces of level sets that lie between the nodes of the grid.

Round its deepest point the distance may pass a level between the nodes, so that the grid
does not meet it. Such a summit is climbed with exact distances, and the piece about it is
measured along rays from the summit.
"""

from __future__ import annotations

import numpy as np

from vega_planner.datatypes import Floats, Ints
from vega_planner.layers import summit_kernels as kernels
from vega_planner.layers.contour import Sheet
from vega_planner.layers.distance_field import DistanceField
from vega_planner.layers.grid import Grid
from vega_planner.layers.grid_kernels import INSIDE
from vega_planner.parallel import map_threads
from vega_planner.part.topology import connected_pieces

#: Summits that are climbed; the deepest are the ones that matter.
MOST_SUMMITS = 24

#: Spacings to which a piece may reach; longer ones are left to the grid and the core.
REACH = 2.5

#: Rays to each piece: round the axis, and from the axis to the rim or the far end.
TURNS, TILTS = 12, 4


def with_summits(
    grid: Grid,
    field: DistanceField,
    brr: DistanceField | None,
    sheets: list[Sheet],
    t: float,
    least: float,
) -> list[Sheet]:
    """Add the small last pieces of level sets that the grid misses.

    Args:
        grid: Signed, straight distances at the nodes.
        field: Distances to S.
        brr: Distances to the restraint region, or None.
        sheets: The level sets found, at (N + 1/2) t.
        t: Distance between levels [mm].
        least: Height over its level [mm] from which a summit counts.

    Returns:
        The sheets, with one more where the deepest level was missed.
    """
    sheets = list(sheets)
    nodes, levels = _summit_nodes(grid, t, least)
    if len(nodes) == 0:
        return sheets
    goal = np.asarray((levels + 0.5) * t + least, np.float64)
    points, depths = _climb(grid.points(nodes), goal, grid.spacing, field, brr)
    pieces = []
    for point, depth, level in zip(points, depths, levels):
        if depth > (level + 0.5) * t + least:
            piece = _piece(point, (level + 0.5) * t, grid, field, brr)
            if piece is not None and _nodes_within(grid, point, piece, level) < 2:
                pieces.append((int(level), point, piece))
    for number, (level, point, piece) in enumerate(pieces):
        # Two climbs may have come to one summit.
        if any(level == m and np.ptp([point, p], axis=0).max() < grid.spacing
               for m, p, _ in pieces[:number]):  # fmt: skip
            continue
        if level < len(sheets):
            rest = _without(sheets[level], point, piece, grid.spacing)
            sheets[level] = sheets[level] if rest is None else _joined(rest, piece)
        elif level == len(sheets):
            sheets.append(piece)
    return sheets


def _summit_nodes(grid: Grid, t: float, least: float) -> tuple[Ints, Ints]:
    """Choose nodes deeper than their neighbours about which a level may be passed unseen.

    Returns:
        The nodes, and the level of each: the next one, or the one that it alone has passed.
    """
    _, ny, nz = grid.shape
    marks = np.zeros(len(grid.state), np.uint8)
    map_threads(
        lambda s: kernels.mark_summits(
            grid.state, grid.distance, grid.level, grid.spacing, ny, nz, *s, t, least, marks
        ),
        grid.slabs(),
    )
    nodes = np.flatnonzero(marks)
    level = grid.level[nodes].astype(np.int64) - (marks[nodes] == kernels.ALONE)
    order = np.argsort(-grid.distance[nodes], kind="stable")
    chosen: list[int] = []
    kept = np.zeros((0, 3))
    for row, place in zip(order, grid.points(nodes[order])):
        if len(kept) and np.abs(kept - place).max(1).min() < 1.5 * grid.spacing:
            continue
        chosen.append(int(row))
        kept = np.vstack([kept, place])
        if len(chosen) == MOST_SUMMITS:
            break
    return nodes[chosen], level[chosen]


def _within(points: Floats, field: DistanceField, brr: DistanceField | None) -> Floats:
    """Bring points beyond the restraint region back onto it."""
    if brr is None:
        return points
    found = brr.nearest(points)
    out = ((points - found.points) * brr.normals(found.faces)).sum(1) > 0
    return np.where(out[:, None], found.points, points)


def _climb(
    points: Floats, goal: Floats, h: float, field: DistanceField, brr: DistanceField | None
) -> tuple[Floats, Floats]:
    """Climb to the deepest point nearby; give up where the goal is out of reach."""
    near = (-1.0, 0.0, 1.0)
    ways = np.array([(i, j, k) for i in near for j in near for k in near])
    points = points.copy()
    depths = field.distances(points)
    step = h / 2
    # Halved steps never lead farther than this.
    for _ in range(24):
        rows = np.flatnonzero(depths + 6 * step > goal)
        if len(rows) == 0 or step < 5e-3:
            break
        trial = (points[rows, None] + step * ways).reshape(-1, 3)
        trial = _within(trial, field, brr)
        found = field.distances(trial).reshape(len(rows), -1)
        best = np.argmax(found, axis=1)
        pick = np.arange(len(rows))
        better = found[pick, best] > depths[rows] + 1e-4
        moved = trial.reshape(len(rows), -1, 3)[pick, best]
        points[rows[better]] = moved[better]
        depths[rows[better]] = found[pick, best][better]
        if not better.any():
            step /= 2
    return points, depths


def _piece(
    summit: Floats, r: float, grid: Grid, field: DistanceField, brr: DistanceField | None
) -> Sheet | None:
    """Measure the piece {d = r} about a summit along rays; None where it reaches too far."""
    axis = np.array([0.0, 0.0, 1.0])
    on_region = False
    if brr is not None:
        found = brr.nearest(summit[None])
        if found.distances[0] < REACH * grid.spacing:
            on_region = bool(found.distances[0] < 1e-3)
            axis = -brr.normals(found.faces)[0]
            if not on_region:
                return None
    ways, faces, rim = _rays(axis, on_region)
    far = summit + REACH * grid.spacing * ways
    if (field.distances(_within(far, field, brr)) > r).any():
        return None
    low, high = np.zeros(len(ways)), np.full(len(ways), REACH * grid.spacing)
    for _ in range(14):
        middle = (low + high) / 2
        deep = field.distances(summit + middle[:, None] * ways) > r
        low, high = np.where(deep, middle, low), np.where(deep, high, middle)
    points = summit + ((low + high) / 2)[:, None] * ways
    if on_region and brr is not None and rim.any():
        ends = brr.nearest(points[rim])
        if ends.distances.max() > 5e-3:
            return None
        points[rim] = ends.points
    near = field.nearest(points)
    slot_of = np.argsort(field.faces)
    inward = (points - near.points) / near.distances[:, None]
    return Sheet(r, points, faces, slot_of[near.faces], rim, inward)


def _rays(axis: Floats, half: bool) -> tuple[Floats, Ints, np.ndarray]:
    """Directions over a ball, or half of it, the faces of their ends, and which are the rim."""
    side = np.cross(axis, np.eye(3)[np.argmin(np.abs(axis))])
    side /= np.linalg.norm(side)
    third = np.cross(axis, side)
    rows = TILTS if half else 2 * TILTS - 1
    tilt = np.arange(1, rows + 1) * np.pi / 2 / TILTS
    turn = np.arange(TURNS) * 2 * np.pi / TURNS
    flat = np.cos(turn)[:, None] * side + np.sin(turn)[:, None] * third
    rings = [np.cos(a) * axis + np.sin(a) * flat for a in tilt]
    ends = [axis[None], *rings] if half else [axis[None], *rings, -axis[None]]
    ways = np.concatenate(ends)
    here = np.arange(TURNS)
    there = (here + 1) % TURNS
    faces = [np.column_stack([np.zeros_like(here), 1 + here, 1 + there])]
    for row in range(rows - 1):
        a, b = 1 + row * TURNS, 1 + (row + 1) * TURNS
        faces.append(np.column_stack([a + here, b + here, b + there]))
        faces.append(np.column_stack([a + here, b + there, a + there]))
    rim = np.zeros(len(ways), bool)
    if half:
        rim[-TURNS:] = True
    else:
        a = 1 + (rows - 1) * TURNS
        faces.append(np.column_stack([a + here, np.full(TURNS, len(ways) - 1), a + there]))
    return ways, np.concatenate(faces).astype(np.int64), rim


def _nodes_within(grid: Grid, summit: Floats, piece: Sheet, level: int) -> int:
    """Count the inside nodes of the grid that a piece holds."""
    reach = float(np.linalg.norm(piece.vertices - summit, axis=1).max())
    width = int(np.ceil(reach / grid.spacing)) + 1
    centre = np.rint((summit - grid.origin) / grid.spacing).astype(np.int64)
    steps = np.arange(-width, width + 1)
    around = np.stack(np.meshgrid(steps, steps, steps, indexing="ij"), -1).reshape(-1, 3) + centre
    around = around[((around >= 0) & (around < np.array(grid.shape))).all(1)]
    nodes = np.ravel_multi_index(tuple(around.T), grid.shape)
    near = np.linalg.norm(grid.points(nodes) - summit, axis=1) < 1.02 * reach
    return int(((grid.level[nodes] > level) & (grid.state[nodes] == INSIDE) & near).sum())


def _without(sheet: Sheet, summit: Floats, piece: Sheet, h: float) -> Sheet | None:
    """Leave out what the grid has made of a piece from nodes beyond the region alone.

    Returns:
        The rest of the sheet; None where what is there goes on beyond the piece by more than
        the spacing h of the grid, which has seen it, then.
    """
    reach = float(np.linalg.norm(piece.vertices - summit, axis=1).max())
    away = np.linalg.norm(sheet.vertices - summit, axis=1)
    piece_of, _ = connected_pieces(len(away), sheet.faces)
    met = np.unique(piece_of[(away < 1.05 * reach)[sheet.faces].any(axis=1)])
    gone = np.isin(piece_of, met)
    if not gone.any():
        return sheet
    if away[sheet.faces[gone]].max() > reach + h:
        return None
    used, faces = np.unique(sheet.faces[~gone], return_inverse=True)
    return Sheet(
        sheet.depth, sheet.vertices[used], faces.reshape(-1, 3), sheet.slots[used],
        sheet.rim[used], sheet.inward[used],
    )  # fmt: skip


def low_pieces(
    starts: Floats, goal: float, h: float, field: DistanceField, brr: DistanceField | None
) -> np.ndarray:
    """Tell which small pieces of a level set have no summit as deep as the goal.

    Args:
        starts: The middle of each piece [mm], shape (n, 3).
        goal: Depth [mm].
        h: Grid spacing [mm].
        field: Distances to S, straight ones.
        brr: Distances to the restraint region, or None.

    Returns:
        True for those that are too low, shape (n,).
    """
    starts = _within(starts, field, brr)
    return _climb(starts, np.full(len(starts), goal), h, field, brr)[1] < goal


def _joined(sheet: Sheet, piece: Sheet) -> Sheet:
    """Put two sheets of one level together."""
    return Sheet(
        sheet.depth,
        np.concatenate([sheet.vertices, piece.vertices]),
        np.concatenate([sheet.faces, piece.faces + len(sheet.vertices)]),
        np.concatenate([sheet.slots, piece.slots]),
        np.concatenate([sheet.rim, piece.rim]),
        np.concatenate([sheet.inward, piece.inward]),
    )
