# SPDX-License-Identifier: Apache-2.0
# ruff: noqa: E501
# mypy: disable-error-code="no-untyped-def"
"""Compiled dual contouring of all level sets of the distance in one pass.

Every node knows how many levels lie below it, so a cell meets the levels between the
least and the greatest count of its corners. One vertex is made for each sheet of each
level in a cell, and one quad for each edge of the grid that crosses a level inside the
part. Crossings beyond the restraint region are virtual: they give no quad, and a
vertex that has both kinds lies on the rim of its layer.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from vega_planner.layers.grid_kernels import FACING, INSIDE
from vega_planner.layers.triangle_kernels import (
    closest,
    first_hit,
    foot,
    heaviest,
    measure,
    nearest,
    nearest_or_walk,
    walk,
)

#: Cosine above which two gradients belong to one smooth sheet (21 degrees).
SAME_SHEET = 0.93


@njit(nogil=True, cache=True)
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


@njit(nogil=True, cache=True)
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


@njit(nogil=True, cache=True)
def crossing(d, gradient, level, lev, a, b, axis, h, r):
    """Estimate where a level crosses the edge of the grid from node a to node b.

    Both may lie before the level where it is narrower than the grid; the one that counts
    as before it then tells where it begins.

    Returns:
        Parameter from 0 at a to 1 at b.
    """
    f, g = d[a] - r, d[b] - r
    if (f > 0.0) != (g > 0.0):
        return f / (f - g)
    turned = level[a] > lev
    along = -gradient[b, axis] if turned else gradient[a, axis]
    u = 0.5
    if along > FACING:
        u = min(-(g if turned else f) / (h * along), 1.0)
    return 1.0 - u if turned else u


@njit(nogil=True, cache=True)
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


@njit(nogil=True, cache=True)
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


@njit(nogil=True, cache=True)
def solve3(a, b, damping, x):
    """Solve the damped normal equations a x = b for a symmetric 3 by 3 matrix."""
    e = damping + 1e-30
    p, q, s = a[0] + e, a[3] + e, a[5] + e
    c0 = q * s - a[4] * a[4]
    c1 = a[2] * a[4] - a[1] * s
    c2 = a[1] * a[4] - a[2] * q
    det = p * c0 + a[1] * c1 + a[2] * c2
    x[0] = (c0 * b[0] + c1 * b[1] + c2 * b[2]) / det
    x[1] = (c1 * b[0] + (p * s - a[2] * a[2]) * b[1] + (a[1] * a[2] - p * a[4]) * b[2]) / det
    x[2] = (c2 * b[0] + (a[1] * a[2] - p * a[4]) * b[1] + (p * q - a[1] * a[1]) * b[2]) / det


@njit(nogil=True, cache=True)
def walk_sheet(tri, corner, ring_start, ring, s, x, y, z, gx, gy, gz):
    """Walk to the local minimum, but stay on the sheet with gradient about g.

    Next to a sharp edge of the part the other side may be nearer; a step there would
    leave the sheet, and the crease between the two would be lost.
    """
    least, u, v = measure(tri, s, x, y, z)
    done = -1
    while True:
        vertex = corner[s, heaviest(u, v)]
        if vertex == done:
            break
        done = vertex
        for j in range(ring_start[vertex], ring_start[vertex + 1]):
            n = ring[j]
            if n == s:
                continue
            off = (
                tri[n, 9] * (x - tri[n, 0])
                + tri[n, 10] * (y - tri[n, 1])
                + tri[n, 11] * (z - tri[n, 2])
            )
            if off * off >= least:
                continue
            d2, a, b = measure(tri, n, x, y, z)
            if d2 < least * (1.0 - 1e-12):
                qx, qy, qz = foot(tri, n, a, b, x, y, z)
                along = gx * (x - qx) + gy * (y - qy) + gz * (z - qz)
                if along > 0.0 and along * along > 0.75 * d2:
                    least = d2
                    s = n
                    u, v = a, b
    qx, qy, qz = foot(tri, s, u, v, x, y, z)
    return s, least, qx, qy, qz


@njit(nogil=True, cache=True)
def walk_wall(tri, corner, ring_start, ring, s, x, y, z):
    """Walk to the local minimum over triangles with about the normal of the first."""
    gx, gy, gz = tri[s, 9], tri[s, 10], tri[s, 11]
    least, _, _ = measure(tri, s, x, y, z)
    while True:
        here = s
        for c in range(3):
            v = corner[here, c]
            for j in range(ring_start[v], ring_start[v + 1]):
                n = ring[j]
                if gx * tri[n, 9] + gy * tri[n, 10] + gz * tri[n, 11] < SAME_SHEET:
                    continue
                d2, _, _ = measure(tri, n, x, y, z)
                if d2 < least * (1.0 - 1e-12):
                    least = d2
                    s = n
        if s == here:
            return s


@njit(nogil=True, cache=True)
def place(
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
    sheets,
    normals,
    limits,
    sheet_count,
    walls,
    wall_count,
    h,
    r,
    v,
    stack,
    lower,
):
    """Move v onto the level set, onto every sheet that meets there, and onto the rim.

    Newton's method on {distance to sheet = r} for each distinct sheet, together with
    the planes of the restraint region, which count most.

    Args:
        tri: Triangle rows of S, with `corner`, `ring_start`, `ring` and `box`.
        brr_tri: Triangle rows of the restraint region, likewise.
        sheets: A triangle on each sheet, moved along as v moves.
        normals: Gradient of the distance to each sheet, about.
        limits: Distance past r, in spacings, up to which each sheet counts.
        sheet_count: How many of them count.
        walls: A triangle on each plane of the restraint region.
        wall_count: How many of them count.
        h: Grid spacing.
        r: Distance of the level.
        v: The point, changed in place.
        stack: Scratch.
        lower: Scratch.

    Returns:
        Slot of the nearest triangle of S.
    """
    a = np.zeros(6)
    b = np.zeros(3)
    step = np.zeros(3)
    g = np.zeros((16, 4))
    start = (v[0], v[1], v[2])
    hint = sheets[0]
    converged = False
    for attempt in range(2):
        for _ in range(12):
            x, y, z = v[0], v[1], v[2]
            near = 1e300
            rows = 0
            for q in range(sheet_count):
                s, d2, fx, fy, fz = walk_sheet(
                    tri, corner, ring_start, ring, sheets[q], x, y, z,
                    normals[q, 0], normals[q, 1], normals[q, 2],
                )  # fmt: skip
                sheets[q] = s
                e = np.sqrt(d2)
                if e < 1e-9:
                    continue
                nx, ny, nz = (x - fx) / e, (y - fy) / e, (z - fz) / e
                if e < near:
                    near = e
                    hint = s
                if e > r + limits[q] * h:
                    continue
                same = -1
                for p in range(rows):
                    if g[p, 0] * nx + g[p, 1] * ny + g[p, 2] * nz > SAME_SHEET:
                        same = p
                        break
                if same < 0:
                    same = rows
                    rows += 1
                elif g[same, 3] >= r - e:
                    # Of two triangles on one sheet the nearer one tells its distance.
                    continue
                g[same, 0], g[same, 1], g[same, 2], g[same, 3] = nx, ny, nz, r - e
            if rows == 0 or attempt == 1:
                # Only the nearest sheet, which is there in any case.
                hint, d2 = nearest_or_walk(
                    tri, corner, ring_start, ring, box, x, y, z, hint, stack, lower
                )
                e, fx, fy, fz = closest(tri, hint, x, y, z)
                e = max(np.sqrt(e), 1e-9)
                rows = 1
                g[0, 0], g[0, 1], g[0, 2], g[0, 3] = (
                    (x - fx) / e, (y - fy) / e, (z - fz) / e, r - e,
                )  # fmt: skip
            worst = 0.0
            for q in range(6):
                a[q] = 0.0
            for q in range(3):
                b[q] = 0.0
            sheet_rows = rows
            for q in range(wall_count):
                s = walk_wall(brr_tri, brr_corner, brr_start, brr_ring, walls[q], x, y, z)
                walls[q] = s
                nx, ny, nz = brr_tri[s, 9], brr_tri[s, 10], brr_tri[s, 11]
                known = False
                for p in range(sheet_rows, rows):
                    if g[p, 0] * nx + g[p, 1] * ny + g[p, 2] * nz > SAME_SHEET:
                        known = True
                if known:
                    continue
                g[rows, 0], g[rows, 1], g[rows, 2] = nx, ny, nz
                g[rows, 3] = (
                    nx * (brr_tri[s, 0] - x) + ny * (brr_tri[s, 1] - y) + nz * (brr_tri[s, 2] - z)
                )
                rows += 1
            for p in range(rows):
                w = 1.0 if p < sheet_rows else 30.0
                worst = max(worst, abs(g[p, 3]))
                nx, ny, nz, f = w * g[p, 0], w * g[p, 1], w * g[p, 2], w * g[p, 3]
                a[0] += nx * nx
                a[1] += nx * ny
                a[2] += nx * nz
                a[3] += ny * ny
                a[4] += ny * nz
                a[5] += nz * nz
                b[0] += nx * f
                b[1] += ny * f
                b[2] += nz * f
            if worst < 1e-5:
                converged = True
                break
            # Damping by the sheets' weight alone: by the walls', which is a thousandfold,
            # it would hold back the steps towards the level.
            solve3(a, b, 1e-3 * rows, step)
            length = np.sqrt(step[0] ** 2 + step[1] ** 2 + step[2] ** 2)
            scale = 0.7 * h / length if length > 0.7 * h else 1.0
            v[0] += scale * step[0]
            v[1] += scale * step[1]
            v[2] += scale * step[2]
        moved = np.sqrt((v[0] - start[0]) ** 2 + (v[1] - start[1]) ** 2 + (v[2] - start[2]) ** 2)
        if converged and moved < 1.6 * h:
            break
        if attempt == 0:
            v[0], v[1], v[2] = start
            converged = False
    return hint


@njit(nogil=True, cache=True)
def nearest_about(tri, corner, ring_start, ring, slot, origin, h, corner_step, x, y, z, hint):
    """Find the nearest triangle to a point by walking from those of the nodes around it.

    Returns:
        Slot and squared distance, and the nearest point.
    """
    best, least, fx, fy, fz = walk(tri, corner, ring_start, ring, hint, x, y, z)
    cell = 0
    for axis in range(3):
        w = x if axis == 0 else (y if axis == 1 else z)
        cell += int((w - origin[axis]) / h) * corner_step[1 << axis]
    if cell < 0 or cell + corner_step[7] >= len(slot):
        return best, least, fx, fy, fz
    for c in range(8):
        s = slot[cell + corner_step[c]]
        if s < 0 or s in (hint, best):
            continue
        again = False
        for e in range(c):
            if slot[cell + corner_step[e]] == s:
                again = True
        if again:
            continue
        s, d2, qx, qy, qz = walk(tri, corner, ring_start, ring, s, x, y, z)
        if d2 < least:
            best, least = s, d2
            fx, fy, fz = qx, qy, qz
    return best, least, fx, fy, fz


@njit(nogil=True, cache=True)
def settle_about(tri, corner, ring_start, ring, r, slot, origin, h, corner_step, hint, v):
    """Put a vertex at its depth from the nearest of all sheets about it."""
    s = hint
    for _ in range(3):
        s, d2, fx, fy, fz = nearest_about(
            tri, corner, ring_start, ring, slot, origin, h, corner_step, v[0], v[1], v[2], s
        )
        e = np.sqrt(d2)
        if abs(e - r) < 2e-3 or e < 1e-9:
            break
        v[0] = fx + (v[0] - fx) * r / e
        v[1] = fy + (v[1] - fy) * r / e
        v[2] = fz + (v[2] - fz) * r / e
    return s


@njit(nogil=True, cache=True)
def settle_rim(
    tri, corner, ring_start, ring, box, brr_tri, brr_box, h, r, hint, v, stack, lower
):  # fmt: skip
    """Slide a rim vertex along the region until it is at its depth."""
    s = hint
    x, y, z = v[0], v[1], v[2]
    least = 1e300
    bound = h * h
    for _ in range(8):
        q, _ = nearest(brr_tri, brr_box, x, y, z, -1, bound, stack, lower)
        if q < 0:
            break
        _, x, y, z = closest(brr_tri, q, x, y, z)
        if least > 1e299:
            s, _ = nearest_or_walk(tri, corner, ring_start, ring, box, x, y, z, s, stack, lower)
        k, d2, fx, fy, fz = walk(tri, corner, ring_start, ring, s, x, y, z)
        e = np.sqrt(d2)
        if abs(e - r) < least:
            least = abs(e - r)
            s = k
            v[0], v[1], v[2] = x, y, z
        if abs(e - r) < 2e-3:
            break
        # Newton's step on the plane of the region, damped where that runs along the level.
        gx, gy, gz = -tri[k, 9], -tri[k, 10], -tri[k, 11]
        if e > 1e-9:
            gx, gy, gz = (x - fx) / e, (y - fy) / e, (z - fz) / e
        nx, ny, nz = brr_tri[q, 9], brr_tri[q, 10], brr_tri[q, 11]
        along = gx * nx + gy * ny + gz * nz
        gx, gy, gz = gx - along * nx, gy - along * ny, gz - along * nz
        f = (r - e) / (gx * gx + gy * gy + gz * gz + 1e-2)
        x, y, z = x + f * gx, y + f * gy, z + f * gz
        bound = max(0.25 * h * h, 4.0 * (r - e) * (r - e))
    return s


@njit(nogil=True, cache=True)
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
    corner_step,
    ny,
    nz,
    first,
    last,
    base,
    position,
    vertex_level,
    vertex_slot,
    is_rim,
    inward,
):
    """Place the vertices of the cells in planes first:last."""
    stack = np.zeros(64, np.int64)
    lower = np.zeros(64)
    sheets = np.zeros(24, np.int64)
    walls = np.zeros(16, np.int64)
    normals = np.zeros((24, 3))
    limits = np.zeros(24)
    v = np.zeros(3)
    virtual = np.zeros((12, 3))
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
                vertex = base[n]
                for lev in range(low, high):
                    r = r0 + t * lev
                    inside = 0
                    for c in range(8):
                        if level[n + corner_step[c]] > lev:
                            inside |= 1 << c
                    for part in range(counts[inside]):
                        real, beyond, kinds = 0, 0, 0
                        v[0] = v[1] = v[2] = 0.0
                        for e in range(12):
                            if members[inside, e] != part:
                                continue
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
                                tri, origin, h, state, d, slot, leave, na, e // 4, nb - na, ny, nz, r
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
                        hint = sheets[0]
                        if beyond == 0 and kinds == 1:
                            # Least cosine between the sheet and any other in the cell.
                            least = 1.0
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
                            # Where another sheet is about, make sure that it is not nearer.
                            if least < 0.9:
                                hint = settle_about(
                                    tri, corner, ring_start, ring, r, slot, origin, h, corner_step,
                                    hint, v,
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
                                sheets, normals, limits, kinds, walls, wall_count, h, r, v, stack, lower,
                            )  # fmt: skip
                            if beyond > 0:
                                hint = settle_rim(
                                    tri, corner, ring_start, ring, box, brr_tri, brr_box, h, r,
                                    hint, v, stack, lower,
                                )  # fmt: skip
                            else:
                                hint = settle_about(
                                    tri, corner, ring_start, ring, r, slot, origin, h, corner_step,
                                    hint, v,
                                )  # fmt: skip
                        position[vertex, 0] = v[0]
                        position[vertex, 1] = v[1]
                        position[vertex, 2] = v[2]
                        vertex_slot[vertex] = hint
                        d2, fx, fy, fz = closest(tri, hint, v[0], v[1], v[2])
                        e2 = max(np.sqrt(d2), 1e-12)
                        inward[vertex, 0] = (v[0] - fx) / e2
                        inward[vertex, 1] = (v[1] - fy) / e2
                        inward[vertex, 2] = (v[2] - fz) / e2
                        is_rim[vertex] = 1 if beyond > 0 else 0
                        vertex += 1


@njit(nogil=True, cache=True)
def vertex_of(level, corner_step, counts, members, base, cell, lev, edge):
    """Number the vertex that an edge of a cell has at a level."""
    low = level[cell]
    for c in range(1, 8):
        low = min(low, level[cell + corner_step[c]])
    vertex = base[cell]
    for q in range(low, lev + 1):
        inside = 0
        for c in range(8):
            if level[cell + corner_step[c]] > q:
                inside |= 1 << c
        if q == lev:
            return vertex + members[inside, edge]
        vertex += counts[inside]
    return -1


@njit(nogil=True, cache=True)
def make_quads(
    tri,
    origin,
    h,
    state,
    d,
    slot,
    level,
    leave,
    r0,
    t,
    counts,
    members,
    corner_step,
    ny,
    nz,
    first,
    last,
    base,
    quads,
):
    """Join the vertices around each crossed edge, outward side up.

    Called twice: with empty `quads` it only counts.

    Returns:
        Number of quads.
    """
    step = (ny * nz, nz, 1)
    total = 0
    ring = np.zeros(4, np.int64)
    for i in range(first, last):
        for j in range(1, ny - 1):
            for k in range(1, nz - 1):
                n = (i * ny + j) * nz + k
                for axis in range(3):
                    m = n + step[axis]
                    la, lb = level[n], level[m]
                    if la == lb or (state[n] != INSIDE and state[m] != INSIDE):
                        continue
                    s1, s2 = step[(axis + 1) % 3], step[(axis + 2) % 3]
                    for lev in range(min(la, lb), max(la, lb)):
                        r = r0 + t * lev
                        if not is_real(
                            tri, origin, h, state, d, slot, leave, n, axis, step[axis], ny, nz, r
                        ):  # fmt: skip
                            continue
                        if len(quads) == 0:
                            total += 1
                            continue
                        ring[0] = vertex_of(
                            level, corner_step, counts, members, base, n, lev, 4 * axis
                        )
                        ring[1] = vertex_of(
                            level, corner_step, counts, members, base, n - s1, lev, 4 * axis + 1
                        )
                        ring[2] = vertex_of(
                            level, corner_step, counts, members, base, n - s1 - s2, lev,
                            4 * axis + 3,
                        )  # fmt: skip
                        ring[3] = vertex_of(
                            level, corner_step, counts, members, base, n - s2, lev, 4 * axis + 2
                        )
                        for q in range(4):
                            quads[total, q] = ring[q] if la > lb else ring[3 - q]
                        total += 1
    return total


@njit(nogil=True, cache=True)
def split_quads(
    tri,
    corner,
    ring_start,
    ring,
    position,
    vertex_level,
    vertex_slot,
    inward,
    quads,
    first,
    last,
    r0,
    t,
    faces,
):
    """Split each quad along the diagonal that lies nearer to the level set."""
    for q in range(first, last):
        a, b, c, e = quads[q, 0], quads[q, 1], quads[q, 2], quads[q, 3]
        r = r0 + t * vertex_level[a]
        bulge_ac, bulge_be = 0.0, 0.0
        ab, bc, ce, ea = 0.0, 0.0, 0.0, 0.0
        for x in range(3):
            bulge_ac += (position[c, x] - position[a, x]) * (inward[c, x] - inward[a, x])
            bulge_be += (position[e, x] - position[b, x]) * (inward[e, x] - inward[b, x])
            ab += inward[a, x] * inward[b, x]
            bc += inward[b, x] * inward[c, x]
            ce += inward[c, x] * inward[e, x]
            ea += inward[e, x] * inward[a, x]
        turn = min(ab, bc, ce, ea)
        along = abs(bulge_ac) <= abs(bulge_be)
        if turn < 0.9:
            _, d2, _, _, _ = walk(
                tri, corner, ring_start, ring, vertex_slot[a],
                0.5 * (position[a, 0] + position[c, 0]),
                0.5 * (position[a, 1] + position[c, 1]),
                0.5 * (position[a, 2] + position[c, 2]),
            )  # fmt: skip
            _, e2, _, _, _ = walk(
                tri, corner, ring_start, ring, vertex_slot[b],
                0.5 * (position[b, 0] + position[e, 0]),
                0.5 * (position[b, 1] + position[e, 1]),
                0.5 * (position[b, 2] + position[e, 2]),
            )  # fmt: skip
            along = abs(np.sqrt(d2) - r) <= abs(np.sqrt(e2) - r)
        if along:
            faces[2 * q] = (a, b, c)
            faces[2 * q + 1] = (a, c, e)
        else:
            faces[2 * q] = (a, b, e)
            faces[2 * q + 1] = (b, c, e)


@njit(nogil=True, cache=True)
def count_by_level(position, vertex_level, faces, used, vertex_start, face_start):
    """Count the vertices and faces of each level, and leave out faces without an area.

    A face with two corners at one place gets -1 as its first corner; `used` marks the
    vertices of the others. The starts become running sums, level + 1 ending at start.
    """
    for f in range(len(faces)):
        same = False
        for e in range(3):
            a, b = faces[f, e], faces[f, (e + 1) % 3]
            same |= (
                position[a, 0] == position[b, 0]
                and position[a, 1] == position[b, 1]
                and position[a, 2] == position[b, 2]
            )
        if same:
            faces[f, 0] = -1
            continue
        for e in range(3):
            used[faces[f, e]] = 1
        face_start[vertex_level[faces[f, 0]] + 1] += 1
    for v in range(len(used)):
        if used[v]:
            vertex_start[vertex_level[v] + 1] += 1
    for lev in range(len(face_start) - 1):
        face_start[lev + 1] += face_start[lev]
        vertex_start[lev + 1] += vertex_start[lev]


@njit(nogil=True, cache=True)
def sort_by_level(vertex_level, faces, used, vertex_start, face_start, rows, sorted_faces):
    """List the vertices level by level, and the faces with their numbers in that level."""
    fill = vertex_start.copy()
    number = np.zeros(len(used), np.int32)
    for v in range(len(used)):
        if used[v]:
            lev = vertex_level[v]
            rows[fill[lev]] = v
            number[v] = fill[lev] - vertex_start[lev]
            fill[lev] += 1
    fill = face_start.copy()
    for f in range(len(faces)):
        if faces[f, 0] >= 0:
            lev = vertex_level[faces[f, 0]]
            for e in range(3):
                sorted_faces[fill[lev], e] = number[faces[f, e]]
            fill[lev] += 1
