# SPDX-License-Identifier: Apache-2.0
"""Which faces of a front the core still has to fill behind."""

from __future__ import annotations

import numpy as np

from vega_planner.datatypes import Bools, Floats, Ints, Layer, row_lengths
from vega_planner.layers.contour import Sheet
from vega_planner.layers.distance_field import DistanceField, distances_within
from vega_planner.layers.front import Front, face_areas, face_inward
from vega_planner.part.topology import connected_pieces

#: The middle between fronts is a surface where the part keeps this share of its depth a step
#: aside, of this share of the depth, on one side at least.
FLAT_SHARE, BESIDE_SHARE = 0.7, 0.5

#: A sheet that is this near to the middle of a thin wall, in t, fills it.
WITHIN_RATIO = 0.25

#: Where, in the thickness of a face, it is asked whether a wall's sheet fills it, and how
#: near is near enough, in t.
FILLED_AT, NEARLY = (0.1, 0.5, 0.9), 0.05


def leave_out(front: Front, chosen: Bools, sheet: Sheet, stays: Bools, t: float) -> None:
    """Leave out the faces of a thin wall through which a sheet that stays passes.

    Args:
        front: The walls.
        chosen: Faces of them, changed in place, shape (m,).
        sheet: The sheet.
        stays: Which of its faces stay.
        t: Layer thickness [mm].
    """
    rows = np.flatnonzero(chosen)
    corners = front.faces[rows]
    room = np.where(np.isfinite(front.room[corners]), front.room[corners], np.nan)
    middles = front.feet[corners].mean(1)
    middles += np.nanmean(room, axis=1)[:, None] * face_inward(front, rows)
    if stays.any():
        reach = WITHIN_RATIO * t
        near = distances_within(sheet.vertices, sheet.faces[stays], middles, reach)
        chosen[rows[near < reach]] = False


def is_flat(front: Front, rows: Ints, room: Floats, field: DistanceField) -> Bools:
    """Tell of which faces the middle of their room is a surface: in a rod it is a line.

    Args:
        front: The front.
        rows: The faces that are asked about, shape (k,).
        room: Room at its vertices, from S on [mm], shape (n,).
        field: Distances to S.

    Returns:
        Whether it is one, shape (k,).
    """
    corners, inward = front.faces[rows], face_inward(front, rows)
    reach = room[corners].mean(1)[:, None]
    middles = front.feet[corners].mean(1) + reach * inward
    least = np.eye(3)[np.argmin(np.abs(inward), axis=1)]
    flat = np.ones(len(rows), bool)
    for across in (np.cross(inward, least), np.cross(inward, np.cross(inward, least))):
        step = BESIDE_SHARE * reach * across / np.maximum(row_lengths(across), 1e-12)[:, None]
        near = FLAT_SHARE * reach[:, 0]
        found = [field.nearest(middles + way * step, near).distances for way in (1, -1)]
        flat &= np.isinf(found).any(0)
    return flat


def filled_by_wall(
    front: Front, chosen: Bools, room: Floats, wall: Layer, t: float, most: float
) -> Bools:
    """Find the chosen faces of a front whose room a thin wall's sheet fills.

    Args:
        front: The front.
        chosen: Its faces that are asked about, shape (m,).
        room: Room at its vertices, from S on [mm], shape (n,).
        wall: The sheet.
        t: Layer thickness [mm].
        most: Room from which on the front has t there [mm].

    Returns:
        Those of the chosen faces, shape (m,).
    """
    rows = np.flatnonzero(chosen)
    corners = front.faces[rows]
    free = np.where(room < most, room, t)[corners].mean(1)[:, None]
    feet, inward = front.feet[corners].mean(1), face_inward(front, rows)
    tree = DistanceField(wall.vertices, wall.faces)
    half = wall.thickness[wall.faces].mean(1) / 2
    filled = np.zeros(len(chosen), bool)
    filled[rows] = True
    for share in FILLED_AT:
        near = tree.nearest(feet + share * free * inward)
        filled[rows] &= near.distances <= half[near.faces] + NEARLY * t
    rest = np.flatnonzero(chosen & ~filled)
    if len(rest):
        # Bits smaller than a bead is wide are no sheet of their own.
        piece, _ = connected_pieces(len(front.vertices), front.faces[rest])
        filled[rest[np.bincount(piece, face_areas(front)[rest])[piece] < t * t]] = True
    return filled


def missing_ahead(
    front: Front, chosen: Bools, gap: Floats, sheet: Sheet, kept: Bools, moved: Layer | None,
    t: float,
) -> Bools:  # fmt: skip
    """Find the chosen faces ahead of which the next level has neither stayed nor moved.

    Args:
        front: The front.
        chosen: Its faces that are asked about, shape (m,).
        gap: Gap behind its faces [mm], shape (m,).
        sheet: The next level.
        kept: Its faces that stay.
        moved: What of it has moved, or None.
        t: Layer thickness [mm].

    Returns:
        Those of the chosen faces, shape (m,).
    """
    k = front.level + 1
    rows = np.flatnonzero(chosen)
    feet, inward = front.feet[front.faces[rows]].mean(1), face_inward(front, rows)
    there = sheet.faces[kept]
    if len(there):
        ahead = feet + (k + 0.5) * t * inward
        gone = distances_within(sheet.vertices, there, ahead, t / 2) > t / 2
        rows, feet, inward = rows[gone], feet[gone], inward[gone]
    if moved is not None and len(rows):
        ahead = feet + (k * t + gap[rows, None] / 2) * inward
        near = DistanceField(moved.vertices, moved.faces)
        rows = rows[near.distances(ahead) > t / 4]
    missing = np.zeros(len(chosen), bool)
    missing[rows] = True
    return missing
