# SPDX-License-Identifier: Apache-2.0
"""Carry the room of a front round corners.

Near the outer corner of a wall the other side of the corner is nearer than the other side
of the wall, and round an inner corner fronts meet obliquely: no room is measured there. Yet
the wall is filled up to there by the same sheet, which turns the corner.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from vega_planner.datatypes import Bools, Floats, Ints
from vega_planner.layers.contour import Sheet
from vega_planner.layers.distance_field import DistanceField, distances_within
from vega_planner.layers.front import Front

#: Rings of vertices over which room is carried at most.
RINGS = 16

#: Between these shares of the room carried to it, a front ends at its own depth.
NEAR, FAR = 0.95, 1.2

#: A front that ends before has come to an outer corner where the part is nowhere deeper
#: than this beyond the room, both in the room.
BEYOND, SHALLOW = 1.2, 1.08

#: Halvings in the search for the depth at which a front ends, between which shares of the
#: room, and how far its depth may be off before it has ended [mm].
HALVINGS, LOW, HIGH, OFF_MM = 7, 0.3, 1.3, 2e-3

#: A place this near to the next level is filled by it, in t.
NEXT_RATIO = 0.45


def carried_room(
    front: Front,
    chosen: Bools,
    room: Floats,
    field: DistanceField,
    following: Sequence[Sheet],
    t: float,
) -> Floats:
    """Carry the room on over faces, as long as the part stays about as thin.

    Args:
        front: The front.
        chosen: Its faces over which it is carried, shape (m,).
        room: Room at its vertices [mm], not finite where unknown, shape (n,).
        field: Distances to S.
        following: The sheet of the next level, if there is one.
        t: Layer thickness [mm].

    Returns:
        Room at the vertices [mm], shape (n,).
    """
    room = room.copy()
    faces = front.faces[chosen]
    for _ in range(RINGS):
        known = np.isfinite(room[faces])
        rows = np.flatnonzero(known.any(1) & ~known.all(1))
        mean = np.where(known[rows], room[faces[rows]], 0.0).sum(1) / known[rows].sum(1)
        fresh = ~known[rows]
        corners = faces[rows][fresh]
        count = np.bincount(corners, minlength=len(room))
        total = np.bincount(corners, np.repeat(mean, fresh.sum(1)), len(room))
        new = np.flatnonzero(count)
        reach = total[new] / count[new]
        depth = _depths(front, new, reach, field)
        beyond = front.feet[new] + BEYOND * reach[:, None] * front.inward[new]
        shallow = np.isfinite(field.nearest(beyond, SHALLOW * reach).distances)
        corner = (depth < NEAR * reach) & shallow
        own = (depth >= NEAR * reach) & (depth < FAR * reach)
        value = np.where(own, depth, reach)
        keep = corner | own
        for sheet in following:
            ends = front.feet[new] + np.minimum(value, depth)[:, None] * front.inward[new]
            away = distances_within(sheet.vertices, sheet.faces, ends, t / 2)
            keep &= away > NEXT_RATIO * t
        if not keep.any():
            break
        room[new[keep]] = value[keep]
    return room


def _depths(front: Front, rows: Ints, reach: Floats, field: DistanceField) -> Floats:
    """Find the depth up to which a front is nearest to its own foot [mm], up to a limit."""
    low, high = LOW * reach, HIGH * reach
    for _ in range(HALVINGS):
        depth = (low + high) / 2
        points = front.feet[rows] + depth[:, None] * front.inward[rows]
        runs = np.isinf(field.nearest(points, depth - OFF_MM).distances)
        low, high = np.where(runs, depth, low), np.where(runs, high, depth)
    return low
