# SPDX-License-Identifier: Apache-2.0
# mypy: disable-error-code="no-untyped-def"
"""Compiled measurement of how much room a sheet has before the core."""

from __future__ import annotations

import numpy as np

from vega_planner.compiled import inner_kernel, kernel
from vega_planner.layers.grid_kernels import INSIDE
from vega_planner.layers.tree_kernels import first_hit, nearest
from vega_planner.layers.triangle_kernels import closest
from vega_planner.part.surface_kernels import cross_of

#: What ends the room in front of a point.
OPEN, OPPOSED, REGION, ASIDE = 0, 1, 2, 3

#: Least cosine between two fronts that meet where they count as opposed.
FACING = 0.85

#: Least cosine between the inward normal and the face where it leaves the part for another
#: front to be looked for, and how much farther than the limit it may meet the plane there.
AHEAD, FARTHER = 0.4, 1.15

#: Times the ball between two fronts shrinks at most, how much nearer another point must
#: be for it to shrink, and the least room that counts, in the limit.
SHRINKS, NEARER, LEAST = 10, 0.004, 0.1

#: Gap between two fronts, in t for each, from which a sheet between them is thick enough
#: to be laid well, so that those on both sides need not be thicker.
BETWEEN_RATIO = 0.35

#: Where a front from aside ends it this little before it would meet the opposed one, the
#: room is that of the opposed one.
BESIDE = 0.93


@kernel
def mark_last(
    points, inward, ahead, origin, h, shape, state, distance, gradient, depth, first, last, out
):
    """Mark the points in front of which the distance may stop growing.

    A point passes where the node nearest to a place just beyond `ahead` of it is inside
    and has the same gradient, if it is as deep as it must be. It passes as well where
    the gradient has turned aside, at a ridge between fronts that do not oppose each other.
    """
    beyond = ahead + 0.87 * h
    node = np.zeros(3, np.int64)
    for i in range(first, last):
        n = 0
        inside = True
        along = 0.0
        for k in range(3):
            x = points[i, k] + beyond * inward[i, k]
            q = int(np.floor((x - origin[k]) / h + 0.5))
            if q < 0 or q >= shape[k]:
                inside = False
                break
            node[k] = q
        out[i] = 1
        if not inside:
            continue
        n = (node[0] * shape[1] + node[1]) * shape[2] + node[2]
        if state[n] != INSIDE:
            continue
        for k in range(3):
            along += gradient[n, k] * inward[i, k]
        if along > -0.3 and (along < 0.8 or distance[n] > depth + ahead - 0.02 * h):
            out[i] = 0


@inner_kernel
def slot_at(slot, origin, h, shape, x, y, z):
    """Return what is nearest to the node of a grid next to a point; -1 outside."""
    if len(slot) == 0:
        return -1
    i = int(np.floor((x - origin[0]) / h + 0.5))
    j = int(np.floor((y - origin[1]) / h + 0.5))
    k = int(np.floor((z - origin[2]) / h + 0.5))
    if i < 0 or j < 0 or k < 0 or i >= shape[0] or j >= shape[1] or k >= shape[2]:
        return -1
    return np.int64(slot[(i * shape[1] + j) * shape[2] + k])


@kernel
def measure_room(
    tri, box, brr_tri, brr_box, slot, origin, h, shape, feet, inward, free_from, beside_from,
    limit, first, last, room, kind,
):  # fmt: skip
    """Measure how far from its foot on S a front runs before it meets another.

    There a ball that touches S at the foot touches it elsewhere too. It begins as large as
    wanted, or between the foot and where the inward normal leaves the part, and shrinks to
    the nearest point inside it until there is none [MaEtAl2012]_. Only fronts that nearly
    oppose each other count. Where the normal leaves through the restraint region before,
    the whole length is free.

    Args:
        tri: Triangle rows of S, with `box`.
        brr_tri: Triangle rows of the restraint region, with `brr_box`.
        slot: Nearest triangle at the nodes of a grid, in which a ball looks first; may be
            empty.
        origin: First node of the grid [mm].
        h: Spacing of the grid [mm].
        shape: Nodes along each axis, (3,).
        feet: Points of S, (n, 3).
        inward: Unit vectors into the part, (n, 3).
        free_from: Depth up to which nothing ends a front [mm].
        beside_from: Room from which fronts from aside are of interest [mm].
        limit: Room beyond which nothing is wanted [mm].
        first: First row.
        last: End of the rows.
        room: Result, unchanged where open.
        kind: Result: OPEN, OPPOSED, REGION, or ASIDE where another front comes from aside.
    """
    stack = np.zeros(64, np.int64)
    lower = np.zeros(64)
    for i in range(first, last):
        nx, ny, nz = inward[i, 0], inward[i, 1], inward[i, 2]
        reach = 2.5 * limit
        x, y, z = feet[i, 0] + 1e-5 * nx, feet[i, 1] + 1e-5 * ny, feet[i, 2] + 1e-5 * nz
        ax, ay, az = x + free_from * nx, y + free_from * ny, z + free_from * nz
        s, u = first_hit(
            tri, box, ax, ay, az, x + reach * nx, y + reach * ny, z + reach * nz, stack
        )
        gone, c = reach, 0.0
        if s >= 0:
            gone = free_from + u * (reach - free_from)
            c = nx * tri[s, 9] + ny * tri[s, 10] + nz * tri[s, 11]
            if free_from > 0.0:
                # Where bodies overlap, a wall of the other one is met from outside.
                c = abs(c)
        found, facing, plain = OPEN, 1.0, limit
        if len(brr_tri) > 0:
            ahead = min(limit, gone) if s >= 0 else limit
            q, v = first_hit(
                brr_tri, brr_box, x, y, z, x + ahead * nx, y + ahead * ny, z + ahead * nz, stack
            )
            if q >= 0:
                c = nx * brr_tri[q, 9] + ny * brr_tri[q, 10] + nz * brr_tri[q, 11]
                if c <= FACING:
                    continue
                found, plain = REGION, v * ahead
        if c < AHEAD or (found == OPEN and gone * c / (1.0 + c) > FARTHER * limit):
            continue
        free = min(limit, 0.5 * gone) if s >= 0 else limit
        if found == REGION:
            free = plain
        elif c > FACING:
            plain = gone * c / (1.0 + c)
        for _ in range(SHRINKS if found == OPEN else 0):
            cx, cy, cz = feet[i, 0] + free * nx, feet[i, 1] + free * ny, feet[i, 2] + free * nz
            bound = (free * (1.0 - NEARER)) ** 2
            along, qx, qy, qz = -1.0, 0.0, 0.0, 0.0
            q = slot_at(slot, origin, h, shape, cx, cy, cz)
            if 0 <= q < len(tri):
                d2, qx, qy, qz = closest(tri, q, cx, cy, cz)
                qx, qy, qz = qx - feet[i, 0], qy - feet[i, 1], qz - feet[i, 2]
                if d2 < bound:
                    along = qx * nx + qy * ny + qz * nz
            if along <= 0.0:
                q, _ = nearest(tri, box, cx, cy, cz, s, bound, stack, lower)
                if q < 0:
                    break
                _, qx, qy, qz = closest(tri, q, cx, cy, cz)
                qx, qy, qz = qx - feet[i, 0], qy - feet[i, 1], qz - feet[i, 2]
                along = qx * nx + qy * ny + qz * nz
            if along <= 0.0:
                facing = -1.0
                break
            free = (qx * qx + qy * qy + qz * qz) / (2.0 * along)
            facing = along / free - 1.0
            beyond = gone * c / (1.0 + c) > FARTHER * free
            if facing <= FACING and beyond and free < beside_from:
                break  # a front from aside; the one ahead is too far to end it before
        kind[i] = found
        if found == OPEN and facing > FACING and LEAST * limit < free < limit:
            kind[i] = OPPOSED
        elif plain < limit and (found == REGION or plain > LEAST * limit):
            cx, cy, cz = feet[i, 0] + plain * nx, feet[i, 1] + plain * ny, feet[i, 2] + plain * nz
            q, _ = nearest(tri, box, cx, cy, cz, -1, (BESIDE * plain) ** 2, stack, lower)
            if q >= 0 and free_from > 0.0:
                # What is that near to the foot is the wall of an overlapping body.
                d2, _, _, _ = closest(tri, q, feet[i, 0], feet[i, 1], feet[i, 2])
                if d2 < free_from * free_from:
                    q = -1
            if q < 0:
                free = plain
                if found == OPEN:
                    kind[i] = OPPOSED
            elif found == REGION:
                kind[i] = OPEN
            elif facing > -1.0:
                kind[i] = ASIDE
        elif -1.0 < facing < FACING and free < limit:
            kind[i] = ASIDE
        if kind[i] != OPEN:
            room[i] = free


@kernel
def spread_over(vertices, faces, spacing, most, owners, points):
    """Spread points over triangles, at least one on each, about `spacing` apart.

    Long thin triangles get a row of points along their longest side, not a square of them.

    Args:
        vertices: Points [mm], (n, 3).
        faces: Vertex indices, (m, 3).
        spacing: Distance between points [mm].
        most: Rows of points, and points of a row, at most.
        owners: Result: the face each point is on; empty where points are to be counted only.
        points: Result [mm], (k, 3).

    Returns:
        Number of points.
    """
    normal, side = np.zeros(3), np.zeros(3)
    total = 0
    for f in range(len(faces)):
        for c in range(3):
            a, b = faces[f, c], faces[f, (c + 1) % 3]
            side[c] = 0.0
            for k in range(3):
                side[c] += (vertices[b, k] - vertices[a, k]) ** 2
        first = np.argmax(side)
        width = np.sqrt(side[first])
        a, b, c = faces[f, first], faces[f, (first + 1) % 3], faces[f, (first + 2) % 3]
        height = cross_of(vertices, a, b, c, normal) / max(width, 1e-12)
        along = min(max(int(np.ceil(width / spacing)), 1), most)
        across = min(max(int(np.ceil(height / spacing)), 1), most)
        for j in range(across):
            v = (j + 1.0 / 3.0) / across
            count = int(np.ceil(along * (1.0 - v)))
            for i in range(count if len(owners) else 0):
                u = (i + 0.5) / count * (1.0 - v)
                owners[total + i] = f
                for k in range(3):
                    points[total + i, k] = (
                        (1.0 - u - v) * vertices[a, k] + u * vertices[b, k] + v * vertices[c, k]
                    )
            total += count
    return total


@kernel
def measure_areas(vertices, faces, areas):
    """Work out the area of each face."""
    normal = np.zeros(3)
    for f in range(len(faces)):
        areas[f] = 0.5 * cross_of(vertices, faces[f, 0], faces[f, 1], faces[f, 2], normal)


@kernel
def weigh_pieces(piece, areas, gap, opposed, t, next_from, sliver, wide, weights):
    """Add up the faces of each connected piece of a front.

    Args:
        piece: The piece each face belongs to, (m,).
        areas: Areas of the faces [mm²], (m,).
        gap: Gap behind each of them [mm], (m,).
        opposed: Whether fronts meet there, (m,).
        t: Layer thickness [mm].
        next_from: Gap from which the next level fills it [mm].
        sliver: Half the width of a sliver [mm].
        wide: Half width of gaps from which they get a sheet of their own [mm].
        weights: Result, 0 at first: area of each piece, of its faces behind which there is
            no room for a good sheet, and of those that are slivers [mm²], (3, pieces).

    Returns:
        Volume left open or laid twice if no piece moves [mm³].
    """
    volume = 0.0
    for f in range(len(piece)):
        weights[0, piece[f]] += areas[f]
        if gap[f] >= next_from:
            continue
        if gap[f] + t < 0.5 * t + sliver:
            weights[2, piece[f]] += areas[f]
        off = abs(gap[f])
        if opposed[f] and gap[f] >= wide:
            off = max(0.25 * t - gap[f], 0.0)
        volume += 0.5 * off * areas[f]
        if not opposed[f] or gap[f] < BETWEEN_RATIO * t:
            weights[1, piece[f]] += areas[f]
    return volume


@kernel
def average_rooms(faces, room, opposed, first, gap, meets):
    """Average the room over the corners of each face where it ends, less `first`."""
    for f in range(len(faces)):
        total, count = 0.0, 0
        for c in range(3):
            v = faces[f, c]
            if room[v] < 1e300:
                total += room[v]
                count += 1
            if opposed[v]:
                meets[f] = True
        gap[f] = total / count - first if count else np.inf


@kernel
def carry_rooms(faces, room, carried):
    """Give corners without a room the mean of what faces with measured corners have.

    Args:
        faces: Vertex indices, (m, 3).
        room: Room at the vertices, infinite where not measured, (n,).
        carried: Result, (n,).
    """
    total, count = np.zeros(len(room)), np.zeros(len(room), np.int64)
    for f in range(len(faces)):
        mean, ends = 0.0, 0
        for c in range(3):
            if room[faces[f, c]] < 1e300:
                mean += room[faces[f, c]]
                ends += 1
        if ends == 0 or ends == 3:
            continue
        for c in range(3):
            v = faces[f, c]
            if room[v] >= 1e300:
                total[v] += mean / ends
                count[v] += 1
    for v in range(len(room)):
        carried[v] = total[v] / count[v] if count[v] else room[v]
