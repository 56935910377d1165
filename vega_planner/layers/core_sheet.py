# SPDX-License-Identifier: Apache-2.0
"""A sheet of the core, from the faces of a front that it fills the room behind."""

from __future__ import annotations

import numpy as np

from vega_planner.datatypes import Bools, Floats, Ints, Layer
from vega_planner.layers.distance_field import DistanceField
from vega_planner.layers.front import END_RATIO, Front
from vega_planner.layers.touching import fans_parted
from vega_planner.part.topology import connected_pieces

#: Pieces of the core below this area, in t², are left out.
CRUMB_RATIO = 0.25


def add_core_sheet(
    cores: list[Layer],
    field: DistanceField,
    front: Front,
    chosen: Bools,
    room: Floats,
    start: float,
    middle: bool,
    t: float,
    most: float,
    end_ratio: float = END_RATIO,
) -> Layer | None:
    """Make a sheet of the core from chosen faces of a front.

    It fills the depths from `start` to the room's end: on the mid-surface, for both
    sides at once, or half-way for this side alone.

    Args:
        cores: The sheets so far; the new one is added.
        field: Distances to S.
        front: The front.
        chosen: Its faces to be filled behind, shape (m,).
        room: Room at its vertices, from S on [mm], shape (n,); not finite where unknown.
        start: Depth from which it is filled [mm].
        middle: Whether both sides of a room are filled by this sheet.
        t: Layer thickness [mm].
        most: Room for more than t that a sheet of one side takes whole if below this [mm].
        end_ratio: How far from S it stays where no room was measured, in its depth.

    Returns:
        The sheet; None where nothing is left of it.
    """
    if not chosen.any():
        return None
    faces = front.faces[chosen]
    used, numbers = np.unique(faces, return_inverse=True)
    faces = numbers.reshape(-1, 3)
    # Corners without a measured room, or with room for the next layer too, keep t.
    free = room[used] - start
    free = np.where(np.isfinite(free) & (middle | (free < most)), free, t)
    free = np.maximum(free, 0.05 * t)
    depth = room[used] if middle else start + free / 2
    points = front.feet[used] + depth[:, None] * front.inward[used]
    unsure = np.flatnonzero(~front.measured[used])
    ends = start + end_ratio * (depth[unsure] - start)
    for _ in range(3):
        found = field.nearest(points[unsure], ends)
        near = np.flatnonzero(found.faces >= 0)
        if len(near) == 0:
            break
        unsure, ends, distances = unsure[near], ends[near], found.distances[near]
        away = (points[unsure] - found.points[near]) / np.maximum(distances, 1e-9)[:, None]
        on_surface = distances < 1e-6
        away[on_surface] = -field.normals(found.faces[near[on_surface]])
        push = np.minimum(ends - distances, t)
        points[unsure] += away * push[:, None]
    thickness = 2 * free if middle else free
    if middle and start > 0:
        thickness = np.maximum(thickness, t / 2)
    if middle:
        faces = one_side(points, faces, front.inward[used], float(np.median(free)))
    faces = _without_crumbs(points, _without_slivers(points, faces), CRUMB_RATIO * t * t)
    if len(faces) == 0:
        return None
    faces, copied = fans_parted(faces, np.ones(len(points), bool))
    used, numbers = np.unique(faces, return_inverse=True)
    used = np.append(np.arange(len(points)), copied)[used]
    sheet = Layer(
        index=len(cores),
        kind="core",
        depth_mm=float(np.median(depth[used])),
        vertices=points[used],
        faces=numbers.reshape(-1, 3),
        thickness=thickness[used],
    )
    cores.append(sheet)
    return sheet


def _without_slivers(points: Floats, faces: Ints) -> Ints:
    corners = points[faces]
    cross = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    sides = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).max(1)
    return faces[np.linalg.norm(cross, axis=1) > 1e-3 * sides**2]


def _without_crumbs(points: Floats, faces: Ints, least: float) -> Ints:
    """Leave out connected pieces with less than an area [mm²]: no bead is so short."""
    piece, _ = connected_pieces(len(points), faces)
    corners = points[faces]
    cross = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    total = np.bincount(piece, np.linalg.norm(cross, axis=1) / 2)
    return faces[total[piece] >= least]


def one_side(points: Floats, faces: Ints, inward: Floats, reach: float) -> Ints:
    """Keep one of two coinciding sheets that came from opposite sides of a wall.

    Connected pieces are taken from the largest on; what lies on a taken piece that
    faces the other way is left out. A piece that folds back on itself is halved along
    its main normal first.

    Args:
        points: Points on the mid-surface [mm], shape (n, 3).
        faces: Faces of both sides, shape (m, 3).
        inward: Direction each point came from, shape (n, 3).
        reach: Distance within which sheets coincide [mm].

    Returns:
        The faces that stay.
    """
    face_inward = inward[faces].mean(1)
    piece, _ = connected_pieces(len(points), faces)
    for label in np.unique(piece):
        mine = face_inward[piece == label]
        axis = np.linalg.eigh(mine.T @ mine)[1][:, 2]
        side = mine @ axis
        if (side > 0.3).any() and (side < -0.3).any():
            piece[piece == label] = piece.max() + 1 + np.where(side >= 0, 0, 1)
    corners = points[faces]
    cross = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    areas = np.linalg.norm(cross, axis=1)
    numbers = np.unique(piece, return_inverse=True)[1]
    order = np.argsort(-np.bincount(numbers, areas), kind="stable")
    low, high, middle = corners.min(1) - reach, corners.max(1) + reach, corners.mean(1)
    along = np.argsort(low[:, 0], kind="stable")
    starts, widest = low[along, 0], float((high - low)[:, 0].max(initial=0.0))
    taken = np.zeros(len(faces), bool)
    for label in order:
        mine = np.flatnonzero(numbers == label)
        first, last = middle[mine].min(0), middle[mine].max(0)
        begin = int(np.searchsorted(starts, first[0] - widest))
        end = int(np.searchsorted(starts, last[0], side="right"))
        chosen = np.sort(along[begin:end])
        chosen = chosen[taken[chosen]]
        chosen = chosen[(low[chosen] <= last).all(1) & (high[chosen] >= first).all(1)]
        if len(chosen):  # what is farther away than `reach` does not matter
            near = DistanceField(points, faces[chosen]).nearest(middle[mine])
            facing = (face_inward[chosen[near.faces]] * face_inward[mine]).sum(1)
            mine = mine[~((near.distances < reach) & (facing < -0.3))]
        taken[mine] = True
    return faces[taken]
