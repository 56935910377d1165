# SPDX-License-Identifier: Apache-2.0
# mypy: disable-error-code="no-untyped-def"
"""Compiled placing of one vertex of a level set: on a sheet, a crease, or the rim."""

from __future__ import annotations

import numpy as np

from vega_planner.compiled import inner_kernel, kernel
from vega_planner.layers.tree_kernels import nearest_or_walk
from vega_planner.layers.triangle_kernels import (
    SAME_BASIN,
    closest,
    foot,
    heaviest,
    is_farther,
    measure,
    measure_below,
    walk,
)

#: Cosine above which two gradients belong to one smooth sheet (21 degrees).
SAME_SHEET = 0.93

#: Distances to its sheets to which a vertex is placed [mm], at the restraint region and
#: elsewhere.
PLACED_MM, NEARLY_PLACED_MM = 5e-5, 5e-4

#: How much nearer than its level a triangle may be that no walk has led to [mm].
UNSEEN_MM = 0.01


@inner_kernel
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


@inner_kernel
def walk_sheet(tri, corner, ring_start, ring, s, x, y, z, gx, gy, gz):
    """Walk to the local minimum, but stay on the sheet with gradient about g.

    Next to a sharp edge of the part the other side may be nearer; a step there would
    leave the sheet, and the crease between the two would be lost.
    """
    least, u, v = measure(tri, s, x, y, z)
    fx, fy, fz = foot(tri, s, u, v, x, y, z)
    done = -1
    while True:
        vertex = corner[s, heaviest(u, v)]
        if vertex == done:
            break
        done = vertex
        for j in range(ring_start[vertex], ring_start[vertex + 1]):
            n = ring[j]
            if n == s or is_farther(tri, n, x, y, z, fx, fy, fz, least):
                continue
            d2, a, b = measure(tri, n, x, y, z)
            if d2 < least * (1.0 - 1e-12):
                qx, qy, qz = foot(tri, n, a, b, x, y, z)
                along = gx * (x - qx) + gy * (y - qy) + gz * (z - qz)
                if along > 0.0 and along * along > 0.75 * d2:
                    least = d2
                    s = n
                    u, v = a, b
                    fx, fy, fz = qx, qy, qz
    return s, least, fx, fy, fz


@inner_kernel
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


@inner_kernel
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
    a,
    b,
    step,
    g,
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
        a: Scratch, (6,).
        b: Scratch, (3,).
        step: Scratch, (3,).
        g: Scratch, (16, 4).
        stack: Scratch.
        lower: Scratch.

    Returns:
        Slot of the nearest triangle of S.
    """
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
            if worst < (PLACED_MM if wall_count > 0 else NEARLY_PLACED_MM):
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


@inner_kernel
def nearest_about(
    tri, corner, ring_start, ring, slot, d, gradient, origin, h, corner_step, x, y, z, hint, seen
):
    """Find the nearest triangle to a point by walking from those of the nodes around it.

    Of nodes with one gradient only the first is walked from, and none that is so much
    farther from its triangle that walking could not make up for it.

    Args:
        seen: Scratch, (9, 3).

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
    e = max(np.sqrt(least), 1e-9)
    seen[0, 0], seen[0, 1], seen[0, 2] = (x - fx) / e, (y - fy) / e, (z - fz) / e
    count = 1
    for c in range(8):
        m = cell + corner_step[c]
        s = slot[m]
        if s < 0 or s in (hint, best) or abs(d[m]) > e + 2.0 * h:
            continue
        again = False
        for q in range(count):
            if (
                seen[q, 0] * gradient[m, 0]
                + seen[q, 1] * gradient[m, 1]
                + seen[q, 2] * gradient[m, 2]
            ) > SAME_BASIN:
                again = True
                break
        if again:
            continue
        for q in range(3):
            seen[count, q] = gradient[m, q]
        count += 1
        s, d2, qx, qy, qz = walk(tri, corner, ring_start, ring, s, x, y, z, best)
        if d2 < least:
            best, least = s, d2
            fx, fy, fz = qx, qy, qz
    return best, least, fx, fy, fz


@inner_kernel
def clear_about(
    tri, corner, ring_start, ring, r, slot, d, gradient, origin, h, corner_step, wide, hint, v
):
    """Move a vertex away from triangles of the nodes about it that are nearer than r.

    Bumps of the surface make local minima where walks stop; of the nodes about one has
    nearly always got past them. A node's triangle is convex: none of it is nearer than the
    plane through its nearest point across the way there.

    Args:
        wide: Whether to ask the 27 nodes about a vertex instead of the 8 of its cell.

    Returns:
        The last triangle it was moved from; the hint where none was nearer.
    """
    bound = r - UNSEEN_MM
    if bound <= 0.0:
        return hint
    sx, sy = corner_step[1], corner_step[2]
    low, shift = (-1, 0.5) if wide else (0, 0.0)
    last = hint
    for _ in range(6):
        x, y, z = v[0], v[1], v[2]
        a, b = int((x - origin[0]) / h + shift), int((y - origin[1]) / h + shift)
        c = int((z - origin[2]) / h + shift)
        node = a * sx + b * sy + c
        ax, ay, az = x - origin[0] - h * a, y - origin[1] - h * b, z - origin[2] - h * c
        if node + low * (sx + sy + 1) < 0 or node + sx + sy + 1 >= len(slot):
            break
        least = bound * bound
        found, before = -1, last
        for i in range(low, 2):
            for j in range(low, 2):
                for k in range(low, 2):
                    m = node + i * sx + j * sy + k
                    along = gradient[m, 0] * (ax - h * i) + gradient[m, 1] * (ay - h * j)
                    along += gradient[m, 2] * (az - h * k) + d[m]
                    if (along if d[m] >= 0.0 else -along) > bound + 1e-4:
                        continue
                    s = np.int64(slot[m])
                    if s < 0 or s in (before, last):
                        continue
                    before = s
                    d2 = measure_below(tri, s, x, y, z, least)
                    if d2 < least:
                        least = d2
                        found = s
        if found < 0:
            break
        last, d2, fx, fy, fz = walk(tri, corner, ring_start, ring, found, x, y, z)
        if d2 < 1e-18:
            break
        f = r / np.sqrt(d2)
        v[0] = fx + (x - fx) * f
        v[1] = fy + (y - fy) * f
        v[2] = fz + (z - fz) * f
    return last


@inner_kernel
def settle_about(
    tri, corner, ring_start, ring, r, slot, d, gradient, origin, h, corner_step, hint, v, seen
):
    """Put a vertex at its depth from the nearest of all sheets about it."""
    s = hint
    for _ in range(3):
        s, d2, fx, fy, fz = nearest_about(
            tri, corner, ring_start, ring, slot, d, gradient, origin, h, corner_step,
            v[0], v[1], v[2], s, seen,
        )  # fmt: skip
        e = np.sqrt(d2)
        if abs(e - r) < 2e-3 or e < 1e-9:
            break
        v[0] = fx + (v[0] - fx) * r / e
        v[1] = fy + (v[1] - fy) * r / e
        v[2] = fz + (v[2] - fz) * r / e
    return s


@kernel
def measure_about(
    tri, corner, ring_start, ring, slot, d, gradient, origin, h, corner_step, points, first, last,
    distance,
):  # fmt: skip
    """Measure the distance of points first:last by walking from the nodes about them.

    A local minimum of a bumpy surface may end a walk: a distance is never too small.

    Args:
        points: Points between nodes of the grid [mm], (n, 3).
        first: First row.
        last: End of the rows.
        distance: Result [mm], infinite where no node about a point knows a triangle, (n,).
    """
    seen = np.zeros((9, 3))
    for i in range(first, last):
        cell = 0
        for axis in range(3):
            cell += int((points[i, axis] - origin[axis]) / h) * corner_step[1 << axis]
        hint = -1
        for c in range(8):
            hint = max(hint, np.int64(slot[cell + corner_step[c]]))
        distance[i] = np.inf
        if hint >= 0:
            _, d2, _, _, _ = nearest_about(
                tri, corner, ring_start, ring, slot, d, gradient, origin, h, corner_step,
                points[i, 0], points[i, 1], points[i, 2], hint, seen,
            )  # fmt: skip
            distance[i] = np.sqrt(d2)
