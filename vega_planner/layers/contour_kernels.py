# SPDX-License-Identifier: Apache-2.0
# mypy: disable-error-code="no-untyped-def"
"""Compiled dual contouring of all level sets of the distance in one pass: the vertices.

Every node knows how many levels lie below it, so a cell meets the levels between the
least and the greatest count of its corners. One vertex is made for each sheet of each
level in a cell, and one quad for each edge of the grid that crosses a level inside the
part. Crossings beyond the restraint region are virtual: they give no quad, and a
vertex that has both kinds lies on the rim of its layer.
"""

from __future__ import annotations

import numpy as np

from vega_planner.compiled import inner_kernel, kernel
from vega_planner.layers.grid_kernels import FACING, INSIDE
from vega_planner.layers.rim_kernels import bring_back, meet_rim, settle_rim
from vega_planner.layers.tree_kernels import first_hit, nearest
from vega_planner.layers.triangle_kernels import closest, measure, walk
from vega_planner.layers.vertex_kernels import (
    SAME_SHEET,
    clear_about,
    place,
    settle_about,
)

#: What is to be told of a vertex besides its place.
ON_RIM, TOUCHING = 1, 2


@kernel
def find_exits(brr_tri, brr_box, origin, h, state, d, level, narrow, ny, nz, first, last, leave):
    """Find where edges from inside to beyond the restraint region leave the part.

    leave[n, axis] is the parameter along the edge from the inside node, and 2 where the
    edge does not leave. Where the part may have slots narrower than the grid (`narrow`),
    edges between inside nodes that cross a level are tried as well: -1 if they leave.
    """
    stack = np.zeros(64, np.int64)
    step = (ny * nz, nz, 1)
    for i in range(first, last):
        for j in range(1, ny - 1):
            for k in range(1, nz - 1):
                n = (i * ny + j) * nz + k
                for axis in range(3):
                    m = n + step[axis]
                    both = state[n] == INSIDE and state[m] == INSIDE
                    if both:
                        if not narrow or level[n] == level[m]:
                            continue
                    elif state[n] != INSIDE and state[m] != INSIDE:
                        continue
                    outer = m if state[n] == INSIDE else n
                    if d[outer] <= 0.0:
                        continue
                    x, y, z = origin[0] + h * i, origin[1] + h * j, origin[2] + h * k
                    u = x + h if axis == 0 else x
                    v = y + h if axis == 1 else y
                    w = z + h if axis == 2 else z
                    if outer == m:
                        s, e = first_hit(brr_tri, brr_box, x, y, z, u, v, w, stack)
                    else:
                        s, e = first_hit(brr_tri, brr_box, u, v, w, x, y, z, stack)
                    if s >= 0:
                        leave[n, axis] = -1.0 if both else e


@inner_kernel
def root_along(tri, sa, sb, px, py, pz, axis, length, da, db, r):
    """Find where the distance to two triangles passes r along an edge of the grid.

    Returns:
        Parameter from 0 to 1 from the first end, and the nearer triangle.
    """
    low, high = 0.0, 1.0
    f, g = da - r, db - r
    if (f > 0.0) == (g > 0.0):
        # The level lies between two nodes that have both not reached it.
        return (0.0, sa) if da > db else (1.0, sb)
    u = f / (f - g)
    s = sa
    for _ in range(6):
        u = low + (high - low) * f / (f - g)
        x = px + u * length if axis == 0 else px
        y = py + u * length if axis == 1 else py
        z = pz + u * length if axis == 2 else pz
        ea, _, _ = measure(tri, sa, x, y, z)
        eb, _, _ = measure(tri, sb, x, y, z)
        s = sa if ea <= eb else sb
        e = np.sqrt(min(ea, eb)) - r
        if abs(e) < 1e-6:
            break
        if (e > 0.0) == (f > 0.0):
            low, f = u, e
        else:
            high, g = u, e
    return u, s


@inner_kernel
def crossing(d, gradient, level, lev, a, b, axis, h, r):
    """Estimate where a level crosses the edge of the grid from node a to node b.

    Both may lie before the level where it is narrower than the grid; the one that counts
    as before it then tells where it begins. So it does where the distance has a ridge
    between the nodes, beyond which a straight line through both would put the crossing.

    Returns:
        Parameter from 0 at a to 1 at b.
    """
    f, g = d[a] - r, d[b] - r
    turned = level[a] > lev
    along = -gradient[b, axis] if turned else gradient[a, axis]
    u = 0.5
    if (f > 0.0) != (g > 0.0):
        u = f / (f - g)
        if gradient[a, axis] * gradient[b, axis] >= 0.0:
            return u
        u = 1.0 - u if turned else u
    if along > FACING:
        u = min(-(g if turned else f) / (h * along), 1.0)
    return 1.0 - u if turned else u


@inner_kernel
def is_real(tri, origin, h, state, d, slot, leave, n, axis, step, ny, nz, r):
    """Tell whether a crossed edge of the grid meets the level inside the part."""
    m = n + step
    a, b = state[n] == INSIDE, state[m] == INSIDE
    if a and b:
        return len(leave) == 1 or leave[n, axis] >= 0.0
    if not a and not b:
        return False
    outer = m if a else n
    inner = n if a else m
    if d[outer] <= 0.0:
        return True
    if leave[n, axis] > 1.5:
        return True
    k = inner % nz
    j = inner // nz % ny
    i = inner // (nz * ny)
    length = h if a else -h
    u, _ = root_along(
        tri, slot[inner], slot[outer], origin[0] + h * i, origin[1] + h * j, origin[2] + h * k,
        axis, length, d[inner], d[outer], r,
    )  # fmt: skip
    return u < leave[n, axis]


@kernel
def count_vertices(level, corner_step, counts, ny, nz, first, last, base):
    """Count the vertices each cell will have, over all levels."""
    for i in range(first, last):
        for j in range(ny - 1):
            for k in range(nz - 1):
                n = (i * ny + j) * nz + k
                low = level[n]
                high = low
                for c in range(1, 8):
                    q = level[n + corner_step[c]]
                    low = min(low, q)
                    high = max(high, q)
                total = 0
                for q in range(low, high):
                    inside = 0
                    for c in range(8):
                        if level[n + corner_step[c]] > q:
                            inside |= 1 << c
                    total += counts[inside]
                base[n] = total


@kernel
def make_vertices(
    tri,
    corner,
    ring_start,
    ring,
    box,
    brr_tri,
    brr_corner,
    brr_start,
    brr_ring,
    brr_box,
    origin,
    h,
    state,
    d,
    slot,
    gradient,
    level,
    leave,
    r0,
    t,
    edges,
    counts,
    members,
    order,
    touching,
    corner_step,
    ny,
    nz,
    first,
    last,
    base,
    position,
    vertex_level,
    vertex_slot,
    kind,
    inward,
):
    """Place the vertices of the cells in planes first:last.

    Args:
        kind: Result: `ON_RIM` for vertices on the restraint region, and `TOUCHING` for those
            at which a sheet may touch itself.
    """
    stack = np.zeros(64, np.int64)
    lower = np.zeros(64)
    sheets = np.zeros(24, np.int64)
    walls = np.zeros(16, np.int64)
    normals = np.zeros((24, 3))
    limits = np.zeros(24)
    v = np.zeros(3)
    start = np.zeros(3)
    virtual = np.zeros((12, 3))
    square, right, newton, rows = np.zeros(6), np.zeros(3), np.zeros(3), np.zeros((16, 4))
    seen = np.zeros((9, 3))
    for i in range(first, last):
        for j in range(ny - 1):
            for k in range(nz - 1):
                n = (i * ny + j) * nz + k
                if base[n] == base[n + 1]:
                    continue
                low = level[n]
                high = low
                for c in range(1, 8):
                    q = level[n + corner_step[c]]
                    low = min(low, q)
                    high = max(high, q)
                near_region = False
                if len(leave) > 1:
                    for c in range(8):
                        m = n + corner_step[c]
                        if state[m] != INSIDE and not d[m] <= 0.0:
                            near_region = True
                            break
                vertex = base[n]
                for lev in range(low, high):
                    r = r0 + t * lev
                    inside = 0
                    for c in range(8):
                        if level[n + corner_step[c]] > lev:
                            inside |= 1 << c
                    at = 0
                    for part in range(counts[inside]):
                        real, beyond, kinds = 0, 0, 0
                        v[0] = v[1] = v[2] = 0.0
                        while at < 12 and members[inside, order[inside, at]] == part:
                            e = order[inside, at]
                            at += 1
                            ca, cb = edges[e, 0], edges[e, 1]
                            na, nb = n + corner_step[ca], n + corner_step[cb]
                            u = crossing(d, gradient, level, lev, na, nb, e // 4, h, r)
                            x = i + (ca & 1) + (u if e < 4 else 0.0)
                            y = j + (ca >> 1 & 1) + (u if 4 <= e < 8 else 0.0)
                            z = k + (ca >> 2 & 1) + (u if e >= 8 else 0.0)
                            x = origin[0] + h * x
                            y = origin[1] + h * y
                            z = origin[2] + h * z
                            other = -1
                            blocked = len(leave) > 1 and leave[na, e // 4] < 0.0
                            if blocked:
                                # A narrow slot lies between the nodes: the sheet ends at the
                                # side of the slot that its level belongs to.
                                mine, other = na, nb
                                if abs(d[nb] - r) < abs(d[na] - r):
                                    mine, other = nb, na
                                px = origin[0] + h * (mine // (ny * nz))
                                py = origin[1] + h * (mine // nz % ny)
                                pz = origin[2] + h * (mine % nz)
                                qx = origin[0] + h * (other // (ny * nz))
                                qy = origin[1] + h * (other // nz % ny)
                                qz = origin[2] + h * (other % nz)
                                _, u = first_hit(brr_tri, brr_box, px, py, pz, qx, qy, qz, stack)
                                x = px + u * (qx - px)
                                y = py + u * (qy - py)
                                z = pz + u * (qz - pz)
                            if not blocked and is_real(
                                tri, origin, h, state, d, slot, leave, na, e // 4, nb - na, ny,
                                nz, r,
                            ):  # fmt: skip
                                real += 1
                            else:
                                virtual[beyond, 0] = x
                                virtual[beyond, 1] = y
                                virtual[beyond, 2] = z
                                beyond += 1
                            v[0] += x
                            v[1] += y
                            v[2] += z
                            for m in (na, nb):
                                # The level of the sheet next to an outer node passes here;
                                # that of a sheet next to an inner node may not.
                                limit = 1.5 if level[m] <= lev else 0.4
                                known = False
                                for q in range(kinds):
                                    if (
                                        normals[q, 0] * gradient[m, 0]
                                        + normals[q, 1] * gradient[m, 1]
                                        + normals[q, 2] * gradient[m, 2]
                                    ) > 0.96:
                                        known = True
                                        limits[q] = max(limits[q], limit)
                                        break
                                if not known and slot[m] >= 0:
                                    if blocked and m == other:
                                        continue
                                    limits[kinds] = limit
                                    for q in range(3):
                                        normals[kinds, q] = gradient[m, q]
                                    sheets[kinds] = slot[m]
                                    kinds += 1
                        vertex_level[vertex] = lev
                        if real == 0:
                            vertex_level[vertex] = -1
                            vertex += 1
                            continue
                        total = real + beyond
                        v[0] /= total
                        v[1] /= total
                        v[2] /= total
                        start[0], start[1], start[2] = v[0], v[1], v[2]
                        hint = sheets[0]
                        fx, fy, fz = 0.0, 0.0, 0.0
                        know_foot = False
                        # Least cosine between the gradients of the nodes that count.
                        spread = 1.0
                        for q in range(1, kinds):
                            for p in range(q):
                                spread = min(
                                    spread,
                                    normals[q, 0] * normals[p, 0]
                                    + normals[q, 1] * normals[p, 1]
                                    + normals[q, 2] * normals[p, 2],
                                )
                        if beyond == 0 and spread > SAME_SHEET:
                            # Least cosine between the sheet and any other in the cell.
                            least = spread
                            for c in range(8):
                                m = n + corner_step[c]
                                if slot[m] >= 0:
                                    least = min(
                                        least,
                                        gradient[m, 0] * normals[0, 0]
                                        + gradient[m, 1] * normals[0, 1]
                                        + gradient[m, 2] * normals[0, 2],
                                    )
                            if least > 0.9:
                                c = 1 if v[0] > origin[0] + h * (i + 0.5) else 0
                                c += 2 if v[1] > origin[1] + h * (j + 0.5) else 0
                                c += 4 if v[2] > origin[2] + h * (k + 0.5) else 0
                                if slot[n + corner_step[c]] >= 0:
                                    hint = slot[n + corner_step[c]]
                            for _ in range(4):
                                hint, d2, fx, fy, fz = walk(
                                    tri, corner, ring_start, ring, hint, v[0], v[1], v[2]
                                )
                                e2 = np.sqrt(d2)
                                if e2 < 1e-9:
                                    break
                                v[0] = fx + (v[0] - fx) * r / e2
                                v[1] = fy + (v[1] - fy) * r / e2
                                v[2] = fz + (v[2] - fz) * r / e2
                                # Towards the foot it stays the foot; away from it another
                                # triangle may become nearer, by as much as it is turned.
                                if (r - e2) * (1.0 - least) < 5e-5:
                                    break
                            know_foot = least >= 0.9
                            # Where another sheet is about, make sure that it is not nearer.
                            if least < 0.9:
                                hint = settle_about(
                                    tri, corner, ring_start, ring, r, slot, d, gradient, origin,
                                    h, corner_step, hint, v, seen,
                                )  # fmt: skip
                        else:
                            wall_count = 0
                            for q in range(beyond):
                                s, _ = nearest(
                                    brr_tri, brr_box, virtual[q, 0], virtual[q, 1],
                                    virtual[q, 2], -1, 1e300, stack, lower,
                                )  # fmt: skip
                                known = False
                                for p in range(wall_count):
                                    o = walls[p]
                                    if (
                                        brr_tri[o, 9] * brr_tri[s, 9]
                                        + brr_tri[o, 10] * brr_tri[s, 10]
                                        + brr_tri[o, 11] * brr_tri[s, 11]
                                    ) > SAME_SHEET:
                                        known = True
                                if not known:
                                    walls[wall_count] = s
                                    wall_count += 1
                            hint = place(
                                tri, corner, ring_start, ring, box,
                                brr_tri, brr_corner, brr_start, brr_ring, brr_box,
                                sheets, normals, limits, kinds, walls, wall_count, h, r, v,
                                square, right, newton, rows, stack, lower,
                            )  # fmt: skip
                            if beyond > 0:
                                hint = settle_rim(
                                    tri, corner, ring_start, ring, box, brr_tri, brr_box, h, r,
                                    hint, v, stack, lower,
                                )  # fmt: skip
                                if len(box) > 0:
                                    hint = meet_rim(
                                        tri, corner, ring_start, ring, box, brr_tri, brr_box,
                                        sheets, normals, kinds, h, r, hint, v, start, stack,
                                        lower,
                                    )  # fmt: skip
                            else:
                                hint = settle_about(
                                    tri, corner, ring_start, ring, r, slot, d, gradient, origin,
                                    h, corner_step, hint, v, seen,
                                )  # fmt: skip
                        # Across a slot the nodes about a vertex may know a straight way only.
                        if beyond == 0 and len(box) > 0:
                            before = hint
                            hint = clear_about(
                                tri, corner, ring_start, ring, r, slot, d, gradient, origin, h,
                                corner_step, not know_foot, hint, v,
                            )  # fmt: skip
                            know_foot = know_foot and hint == before
                        if beyond == 0 and (near_region or (kinds > 1 and len(leave) > 1)):
                            x, y, z = v[0], v[1], v[2]
                            hint = bring_back(
                                tri, corner, ring_start, ring, box, brr_tri, brr_box, h, r, state,
                                slot, d, gradient, origin, corner_step, hint, v, start, stack,
                                lower, seen,
                            )  # fmt: skip
                            know_foot = know_foot and x == v[0] and y == v[1] and z == v[2]
                        position[vertex, 0] = v[0]
                        position[vertex, 1] = v[1]
                        position[vertex, 2] = v[2]
                        vertex_slot[vertex] = hint
                        if not know_foot:
                            _, fx, fy, fz = closest(tri, hint, v[0], v[1], v[2])
                        out = (v[0] - fx) * tri[hint, 9] + (v[1] - fy) * tri[hint, 10]
                        out += (v[2] - fz) * tri[hint, 11]
                        if out > 0.9 * r and beyond == 0:
                            # A crease beyond S, of the same distances.
                            v[0], v[1], v[2] = start[0], start[1], start[2]
                            hint = settle_about(
                                tri, corner, ring_start, ring, r, slot, d, gradient, origin, h,
                                corner_step, sheets[0], v, seen,
                            )  # fmt: skip
                            _, fx, fy, fz = closest(tri, hint, v[0], v[1], v[2])
                            for q in range(3):
                                position[vertex, q] = v[q]
                            vertex_slot[vertex] = hint
                        e2 = (v[0] - fx) ** 2 + (v[1] - fy) ** 2 + (v[2] - fz) ** 2
                        e2 = max(np.sqrt(e2), 1e-12)
                        inward[vertex, 0] = (v[0] - fx) / e2
                        inward[vertex, 1] = (v[1] - fy) / e2
                        inward[vertex, 2] = (v[2] - fz) / e2
                        kind[vertex] = ON_RIM if beyond > 0 else 0
                        if touching[inside] >> part & 1:
                            kind[vertex] |= TOUCHING
                        vertex += 1
