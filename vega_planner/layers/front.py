# SPDX-License-Identifier: Apache-2.0
"""The room in front of a sheet: how far it is to where the fronts from both sides meet."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from vega_planner.datatypes import Bools, Floats, Ints, Part
from vega_planner.layers import core_kernels as kernels
from vega_planner.layers.contour import Sheet
from vega_planner.layers.distance_field import DistanceField
from vega_planner.layers.grid import Grid
from vega_planner.layers.subdivide import split_long_edges
from vega_planner.parallel import map_threads

#: Sheets of the core end this far from the surface, in their depth: between the corners
#: their round ends leave open and what bulges out.
END_RATIO = 0.75

#: Depth half-way from a wall's middle to its other side, in its room, from which the part
#: is not thin there.
THICK_RATIO = 1.25

#: Rows of points along a triangle at most.
MOST_ROWS = 32

_CHUNK = 512


@dataclass(frozen=True, eq=False)
class Front:
    """A sheet with the room in front of it.

    Attributes:
        level: N, or -1 for the surface S itself.
        vertices: Points [mm], shape (n, 3).
        faces: Vertex indices, shape (m, 3).
        feet: Nearest points of S [mm], shape (n, 3).
        inward: Unit vectors from the feet into the part, shape (n, 3).
        room: Depth m at which the fronts meet [mm], infinite where far, shape (n,).
        opposed: True where they meet another front, False at the restraint region.
        measured: True where the room was measured, False where it was carried on.
        aside: Depth at which a front from aside is met where nothing else fills what lies
            before it [mm], infinite elsewhere, shape (n,).
    """

    level: int
    vertices: Floats
    faces: Ints
    feet: Floats
    inward: Floats
    room: Floats
    opposed: Bools
    measured: Bools
    aside: Floats


def sheet_front(
    level: int,
    sheet: Sheet,
    grid: Grid,
    field: DistanceField,
    brr: DistanceField | None,
    t: float,
    sliver: float,
) -> Front:
    """Measure the room in front of an envelope sheet, where it ends within reach."""
    count = len(sheet.vertices)
    ahead = t + sliver
    candidates = np.zeros(count, np.uint8)
    kernels.mark_last(
        sheet.vertices, sheet.inward, ahead, grid.origin, grid.spacing, np.array(grid.shape),
        grid.state, grid.distance, grid.gradient, sheet.depth, 0, count, candidates,
    )  # fmt: skip
    chosen = np.flatnonzero(candidates)
    feet = sheet.vertices - sheet.depth * sheet.inward
    # A ball of the sheet's depth touches S at the foot alone.
    met = np.full(len(chosen), np.inf)
    first = sheet.depth + t / 2
    room, kind = measure_rooms(
        field, brr, feet[chosen], sheet.inward[chosen], sheet.depth + ahead, 0.9 * sheet.depth,
        first, met, grid if level > 0 else None,
    )  # fmt: skip
    rooms, opposed = np.full(count, np.inf), np.zeros(count, bool)
    rooms[chosen] = room
    opposed[chosen] = kind == kernels.OPPOSED
    rows = np.flatnonzero((met > first) & (met < first + t / 2))
    aside = np.full(count, np.inf)
    if len(rows):
        places = feet[chosen[rows]] + met[rows, None] * sheet.inward[chosen[rows]]
        rows = rows[_deepest_about(grid, places) < level + 2]
        aside[chosen[rows]] = met[rows]
    return Front(
        level, sheet.vertices, sheet.faces, feet, sheet.inward, rooms, opposed,
        np.isfinite(rooms), aside,
    )  # fmt: skip


def _deepest_about(grid: Grid, points: Floats) -> Ints:
    """Find the most levels that a node of the grid next to a point has passed."""
    shape = np.array(grid.shape)
    node = np.clip(np.rint((points - grid.origin) / grid.spacing).astype(np.int64), 1, shape - 2)
    level = grid.level.reshape(grid.shape)
    near = (-1, 0, 1)
    deepest = np.zeros(len(points), np.int64)
    for step in [(i, j, k) for i in near for j in near for k in near]:
        np.maximum(deepest, level[tuple((node + step).T)], out=deepest)
    return deepest


def thin_walls(
    part: Part, grid: Grid, field: DistanceField, brr: DistanceField | None, limit: float
) -> Front:
    """Find the parts of S behind which the part is thin, as finely as the grid.

    Args:
        part: The part.
        grid: Distances at the nodes.
        field: Distances to S.
        brr: Distances to the restraint region, or None.
        limit: Half the thickness of a thin wall [mm].

    Returns:
        Those faces of S with the room behind them.
    """
    surface = part.faces[~part.restrained]
    normals = part.face_normals[~part.restrained]
    owner, points = _samples(part.vertices, surface, 2 * limit)
    inward = -normals[owner]
    candidates = np.zeros(len(points), np.uint8)
    kernels.mark_last(
        points, inward, limit, grid.origin, grid.spacing, np.array(grid.shape), grid.state,
        grid.distance, grid.gradient, 0.0, 0, len(points), candidates,
    )  # fmt: skip
    chosen = np.flatnonzero(candidates)
    # Where bodies overlap by less than that, the room goes on behind their walls.
    overlap = 2 * kernels.LEAST * limit if grid.gap_share > 0 else 0.0
    room, _ = measure_rooms(field, brr, points[chosen], inward[chosen], limit, overlap)
    thin = np.unique(owner[chosen[np.isfinite(room)]])
    used, faces = np.unique(surface[thin], return_inverse=True)
    vertices, faces = split_long_edges(
        part.vertices[used], faces.reshape(-1, 3), max(1.2 * limit, grid.spacing)
    )
    corners = vertices[faces]
    cross = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    inward = np.zeros_like(vertices)
    for corner in range(3):
        np.add.at(inward, faces[:, corner], -cross)
    length = np.linalg.norm(inward, axis=1, keepdims=True)
    inward /= np.where(length > 0, length, 1.0)
    room, kind = measure_rooms(field, brr, vertices, inward, limit, overlap)
    measured = np.isfinite(room)
    none = np.full(len(vertices), np.inf)
    front = Front(
        -1, vertices, faces, vertices, inward, room, kind == kernels.OPPOSED, measured, none
    )
    return _grown(front, field)


def _grown(front: Front, field: DistanceField) -> Front:
    """Carry the room of a thin wall on towards the wall's ends.

    Near an end the end itself is nearer than the other side, so nothing was measured;
    yet the wall is filled up to there.
    """
    room, opposed = front.room.copy(), front.opposed.copy()
    sources = np.isfinite(room)
    for _ in range(16):
        ends = np.isfinite(room[front.faces])
        rows = np.flatnonzero((sources[front.faces] & ends).any(1) & ~ends.all(1))
        if len(rows) == 0:
            break
        mean = np.where(ends[rows], room[front.faces[rows]], 0).sum(1) / ends[rows].sum(1)
        total, count = np.zeros(len(room)), np.zeros(len(room))
        meets = opposed[front.faces[rows]].any(1)
        for corner in range(3):
            fresh = ~ends[rows, corner]
            opposed[front.faces[rows[fresh & meets], corner]] = True
            np.add.at(total, front.faces[rows[fresh], corner], mean[fresh])
            np.add.at(count, front.faces[rows[fresh], corner], 1)
        new = np.flatnonzero(count)
        reach = (total[new] / count[new])[:, None]
        # Where it gets deeper farther in, the wall has come to something thick.
        beyond = field.distances(front.feet[new] + 1.5 * reach * front.inward[new])
        new = new[beyond < THICK_RATIO * reach[:, 0]]
        room[new] = total[new] / count[new]
        points = front.feet[new] + room[new, None] * front.inward[new]
        sources = np.zeros(len(room), bool)
        sources[new] = field.distances(points) > END_RATIO * room[new]
    return replace(front, room=room, opposed=opposed)


def _samples(vertices: Floats, faces: Ints, spacing: float) -> tuple[Ints, Floats]:
    """Spread points over triangles, at least one on each, about `spacing` apart."""
    none = np.zeros(0, np.int64), np.zeros((0, 3))
    count = kernels.spread_over(vertices, faces, spacing, MOST_ROWS, *none)
    owners, points = np.zeros(count, np.int64), np.zeros((count, 3))
    kernels.spread_over(vertices, faces, spacing, MOST_ROWS, owners, points)
    return owners, points


def measure_rooms(
    field: DistanceField,
    brr: DistanceField | None,
    feet: Floats,
    inward: Floats,
    limit: float,
    free_from: float = 0.0,
    beside_from: float = 0.0,
    aside: Floats | None = None,
    grid: Grid | None = None,
) -> tuple[Floats, Ints]:
    """Measure the room in front of points of S, as far as fronts oppose each other.

    Args:
        field: Distances to S.
        brr: Distances to the restraint region, or None.
        feet: Points of S [mm], shape (n, 3).
        inward: Unit vectors into the part, shape (n, 3).
        limit: Room beyond which nothing is wanted [mm].
        free_from: Depth up to which nothing ends a front [mm].
        beside_from: Room from which fronts from aside are of interest [mm].
        aside: Result: depth at which a front from aside is met [mm], where one is, (n,).
        grid: Distances at the nodes of a grid, which tell sooner what is near deep inside.

    Returns:
        Room [mm], infinite where open, and what ends it, both of shape (n,).

    Source:
        [MaEtAl2012]_, shrinking balls.
    """
    count = len(feet)
    room, kind = np.full(count, np.inf), np.zeros(count, np.int64)
    feet, inward = np.ascontiguousarray(feet), np.ascontiguousarray(inward, np.float64)
    brr_tri = brr.tri if brr else np.zeros((0, 16))
    brr_box = brr.box if brr else np.zeros((1, 6))
    least = np.inf if aside is None else beside_from
    near: tuple[Any, ...] = (np.zeros(0, np.int32), np.zeros(3), 1.0, np.ones(3, np.int64))
    if grid is not None:
        near = grid.slot, grid.origin, grid.spacing, np.array(grid.shape)

    def measure(first: int) -> None:
        kernels.measure_room(
            field.tri, field.box, brr_tri, brr_box, *near, feet, inward, free_from, least, limit,
            first, min(first + _CHUNK, count), room, kind,
        )  # fmt: skip

    map_threads(measure, range(0, count, _CHUNK))
    met = kind == kernels.ASIDE
    if aside is not None:
        aside[met] = room[met]
    room[met], kind[met] = np.inf, kernels.OPEN
    return room, kind


def face_middles(front: Front) -> Floats:
    """Middles of the faces [mm], shape (m, 3)."""
    a, b, c = front.faces.T
    return np.asarray((front.vertices[a] + front.vertices[b] + front.vertices[c]) / 3)


def face_areas(front: Front) -> Floats:
    """Areas of the faces [mm²], shape (m,)."""
    areas = np.zeros(len(front.faces))
    kernels.measure_areas(front.vertices, np.ascontiguousarray(front.faces, np.int64), areas)
    return areas


def face_gaps(front: Front, t: float) -> tuple[Floats, Bools]:
    """Average the room behind the own band over the corners where it ends.

    Returns:
        Gap at each face [mm], infinite where it is open, and whether fronts meet there.
    """
    gap, meets = np.zeros(len(front.faces)), np.zeros(len(front.faces), np.bool_)
    faces = np.ascontiguousarray(front.faces, np.int64)
    kernels.average_rooms(faces, front.room, front.opposed, (front.level + 1) * t, gap, meets)
    return gap, meets


def spread_room(front: Front) -> Floats:
    """Carry the room over to the corners that faces share with measured ones."""
    carried = np.zeros(len(front.room))
    kernels.carry_rooms(np.ascontiguousarray(front.faces, np.int64), front.room, carried)
    return carried


def face_inward(front: Front, rows: Ints) -> Floats:
    """Mean unit direction inwards at some of the faces, shape (len(rows), 3)."""
    mean = front.inward[front.faces[rows]].mean(1)
    length = np.linalg.norm(mean, axis=1, keepdims=True)
    return mean / np.where(length > 0, length, 1.0)
