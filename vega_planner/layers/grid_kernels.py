# SPDX-License-Identifier: Apache-2.0
# mypy: disable-error-code="no-untyped-def"
"""Compiled work on the nodes of a regular grid: inside or outside, nearest triangles.

Node (i, j, k) stands at origin + h (i, j, k); arrays over nodes are flat, k running
fastest, and at least two nodes wide outside the part so that neighbours always exist.
"""

from __future__ import annotations

import numpy as np

from vega_planner.compiled import inner_kernel, kernel
from vega_planner.layers.tree_kernels import nearest
from vega_planner.layers.triangle_kernels import SAME_BASIN, closest, is_among, measure, walk

#: States of a node.
NONE, RING, INSIDE = 0, 1, 2

#: Least cosine between an edge and the gradients at its ends where fronts face each other.
FACING = 0.3

#: Distance of a node that has not been reached.
UNKNOWN = np.float32(1e30)

#: Whether a node waits to be swept, has been, or has its exact triangle from the start.
DONE, FRESH, STALE = 0, 1, 2

#: Least cosine between the gradient at a node and the normal of a triangle seen from outside.
FRONT = 0.5

#: Half the width of the narrowest level sets that are looked for between nodes [mm].
HIDDEN_MM = 0.02


@inner_kernel
def edge_side(px, py, qx, qy, x, y):
    """Tell on which side of the line pq a point lies, the same from both triangles."""
    turned = px > qx or (px == qx and py > qy)
    if turned:
        px, py, qx, qy = qx, qy, px, py
    side = (qx - px) * (y - py) - (qy - py) * (x - px)
    if side == 0.0:
        side = 1e-300
    return -side if turned else side


@kernel
def scan_columns(vertices, faces, origin, h, nx, ny, start, height, sign):
    """Cross every column of nodes with the surface.

    Called twice: with empty `height` it counts into start[column + 1]; then, start
    being the running sum, it fills heights [nodes] and signs (+1 facing up).
    """
    counting = len(height) == 0
    for f in range(len(faces)):
        a, b, c = faces[f, 0], faces[f, 1], faces[f, 2]
        ax, ay = (vertices[a, 0] - origin[0]) / h, (vertices[a, 1] - origin[1]) / h
        bx, by = (vertices[b, 0] - origin[0]) / h, (vertices[b, 1] - origin[1]) / h
        cx, cy = (vertices[c, 0] - origin[0]) / h, (vertices[c, 1] - origin[1]) / h
        for i in range(int(np.ceil(min(ax, bx, cx))), int(np.floor(max(ax, bx, cx))) + 1):
            for j in range(int(np.ceil(min(ay, by, cy))), int(np.floor(max(ay, by, cy))) + 1):
                wa = edge_side(bx, by, cx, cy, i, j)
                wb = edge_side(cx, cy, ax, ay, i, j)
                wc = edge_side(ax, ay, bx, by, i, j)
                up = wa > 0.0 and wb > 0.0 and wc > 0.0
                if not up and not (wa < 0.0 and wb < 0.0 and wc < 0.0):
                    continue
                column = i * ny + j
                if counting:
                    start[column + 1] += 1
                    continue
                z = (wa * vertices[a, 2] + wb * vertices[b, 2] + wc * vertices[c, 2]) / (
                    wa + wb + wc
                )
                height[start[column]] = (z - origin[2]) / h
                sign[start[column]] = 1 if up else -1
                start[column] += 1


@kernel
def mark_inside(start, height, sign, nz, state):
    """Mark the nodes with a winding number other than 0, column by column."""
    for column in range(len(start) - 1):
        first, last = start[column], start[column + 1]
        for i in range(first + 1, last):
            z, s = height[i], sign[i]
            j = i - 1
            while j >= first and height[j] > z:
                height[j + 1] = height[j]
                sign[j + 1] = sign[j]
                j -= 1
            height[j + 1] = z
            sign[j + 1] = s
        winding = 0
        for i in range(first, last - 1):
            winding -= sign[i]
            if winding != 0:
                low = int(np.ceil(height[i]))
                high = int(np.floor(height[i + 1]))
                for k in range(low, high + 1):
                    state[column * nz + k] = INSIDE


@kernel
def mark_ring(state, nx, ny, nz, first, last):
    """Mark the outside nodes that touch an inside one, also across corners."""
    for i in range(max(first, 1), min(last, nx - 1)):
        for j in range(1, ny - 1):
            for k in range(1, nz - 1):
                n = (i * ny + j) * nz + k
                if state[n] == INSIDE:
                    continue
                found = False
                for a in range(-1, 2):
                    for b in range(-1, 2):
                        m = n + (a * ny + b) * nz
                        if state[m - 1] == INSIDE or state[m] == INSIDE or state[m + 1] == INSIDE:
                            found = True
                if found:
                    state[n] = RING


@inner_kernel
def note(tri, s, d2, qx, qy, qz, x, y, z, n, slot, known):
    """Note the nearest triangle of a node, the distance to it and its gradient."""
    r = np.sqrt(d2)
    slot[n] = s
    known[n, 0] = r
    if r > 1e-9:
        known[n, 1] = (x - qx) / r
        known[n, 2] = (y - qy) / r
        known[n, 3] = (z - qz) / r
    else:
        known[n, 1] = -tri[s, 9]
        known[n, 2] = -tri[s, 10]
        known[n, 3] = -tri[s, 11]
    return r


@kernel
def start_band(tri, box, origin, h, state, nx, ny, nz, first, last, reach, slot, known, fresh):
    """Find exact nearest triangles for the nodes along the surface.

    Nodes within `reach` of S are done; the others that belong to the part or its ring
    are marked fresh, for `sweep` to fill.
    """
    stack = np.zeros(64, np.int64)
    lower = np.zeros(64)
    for i in range(first, last):
        for j in range(ny):
            hint = -1
            for k in range(nz):
                n = (i * ny + j) * nz + k
                if state[n] == NONE:
                    continue
                fresh[n] = FRESH
                at_surface = state[n] == RING
                if not at_surface:
                    at_surface = (
                        state[n - 1] != INSIDE
                        or state[n + 1] != INSIDE
                        or state[n - nz] != INSIDE
                        or state[n + nz] != INSIDE
                        or state[n - ny * nz] != INSIDE
                        or state[n + ny * nz] != INSIDE
                    )
                if not at_surface:
                    continue
                x, y, z = origin[0] + h * i, origin[1] + h * j, origin[2] + h * k
                s, _ = nearest(tri, box, x, y, z, hint, reach * reach, stack, lower)
                if s >= 0:
                    hint = s
                    d2, qx, qy, qz = closest(tri, s, x, y, z)
                    note(tri, s, d2, qx, qy, qz, x, y, z, n, slot, known)
                    fresh[n] = DONE


@kernel
def sweep(
    tri, corner, ring_start, ring, origin, h, ny, nz, first, last, backwards, slot, known, fresh
):
    """Hand nearest triangles from node to node along the raster.

    The foot of a neighbour at d with the gradient g is |d g + s| away, s being the step
    from the neighbour; its triangle is no nearer than d + g . s, since it is convex. A
    fresh node walks from the nearest foot to the local minimum, tries the triangles of
    those neighbours that may still be nearer, and makes the neighbours fresh that its own
    triangle may be nearer to. Nodes with one gradient share a basin: walking finds its
    minimum, so they do not try each other's triangles.

    Args:
        tri: Triangle rows of S, with `corner`, `ring_start` and `ring`.
        origin: Position of node (0, 0, 0).
        h: Spacing.
        ny: Nodes along y.
        nz: Nodes along z.
        first: First plane to sweep.
        last: End of the planes.
        backwards: Whether to go from the last node to the first.
        slot: Nearest triangle of each node.
        known: Distance of each node, `UNKNOWN` at first, and its gradient, (n, 4).
        fresh: FRESH, STALE or DONE.

    Returns:
        Number of nodes that changed.
    """
    tried = np.zeros(26, np.int64)
    step = np.zeros(26, np.int64)
    move = np.zeros((26, 3))
    square = np.zeros(26)
    least = np.zeros(26)
    count = 0
    for a in range(-1, 2):
        for b in range(-1, 2):
            for c in range(-1, 2):
                if a == 0 and b == 0 and c == 0:
                    continue
                step[count] = (a * ny + b) * nz + c
                move[count, 0], move[count, 1], move[count, 2] = h * a, h * b, h * c
                square[count] = h * h * (a * a + b * b + c * c)
                count += 1
    slack = 1e-5 * h
    changed = 0
    for ii in range(last - first):
        i = last - 1 - ii if backwards else first + ii
        for jj in range(1, ny - 1):
            j = ny - 1 - jj if backwards else jj
            for kk in range(1, nz - 1):
                k = nz - 1 - kk if backwards else kk
                n = np.uint64((i * ny + j) * nz + k)
                if fresh[n] != FRESH:
                    continue
                fresh[n] = STALE
                x, y, z = origin[0] + h * i, origin[1] + h * j, origin[2] + h * k
                nearest_foot = 1e30
                side = -1
                for q in range(26):
                    m = np.uint64(np.int64(n) + step[q])
                    e = np.float64(known[m, 0])
                    along = -(
                        known[m, 1] * move[q, 0]
                        + known[m, 2] * move[q, 1]
                        + known[m, 3] * move[q, 2]
                    )
                    least[q] = e + along - slack
                    away = e * e + 2.0 * e * along + square[q]
                    if away < nearest_foot:
                        nearest_foot = away
                        side = q
                if side < 0:
                    continue
                current = np.int64(slot[n])
                best = np.int64(slot[np.uint64(np.int64(n) + step[side])])
                now = current
                reach = np.float64(known[n, 0])
                if best != current and nearest_foot < reach * reach:
                    now, d2, qx, qy, qz = walk(tri, corner, ring_start, ring, best, x, y, z)
                    reach = note(tri, now, d2, qx, qy, qz, x, y, z, n, slot, known)
                count = 0
                other = -1
                nearer = reach * (1.0 - 1e-7)
                for q in range(26):
                    if least[q] >= nearer:
                        continue
                    m = np.uint64(np.int64(n) + step[q])
                    if (
                        known[n, 1] * known[m, 1]
                        + known[n, 2] * known[m, 2]
                        + known[n, 3] * known[m, 3]
                    ) > SAME_BASIN:
                        continue
                    s = np.int64(slot[m])
                    if s in (now, best, current):
                        continue
                    if is_among(tried, count, s):
                        continue
                    tried[count] = s
                    count += 1
                    d2, _, _ = measure(tri, s, x, y, z)
                    if d2 < nearer * nearer:
                        nearer = np.sqrt(d2)
                        other = s
                if other >= 0:
                    now, d2, qx, qy, qz = walk(tri, corner, ring_start, ring, other, x, y, z)
                    reach = note(tri, now, d2, qx, qy, qz, x, y, z, n, slot, known)
                if now == current:
                    continue
                changed += 1
                for q in range(26):
                    m = np.uint64(np.int64(n) + step[q])
                    if fresh[m] != STALE:
                        continue
                    may = reach + (
                        known[n, 1] * move[q, 0]
                        + known[n, 2] * move[q, 1]
                        + known[n, 3] * move[q, 2]
                    )
                    if (
                        may - slack < known[m, 0]
                        and (
                            known[n, 1] * known[m, 1]
                            + known[n, 2] * known[m, 2]
                            + known[n, 3] * known[m, 3]
                        )
                        <= SAME_BASIN
                    ):
                        fresh[m] = FRESH
    return changed


@kernel
def mend_fronts(tri, box, origin, h, state, ny, nz, first, last, slot, known, fresh):
    """Look up inside nodes anew whose triangle turns its outer side to them.

    Of two faces across a gap narrower than the grid, the wrong one has been handed to a
    node then, from a node beyond the gap; both have one gradient there.

    Returns:
        Number of nodes that have changed.
    """
    stack = np.zeros(64, np.int64)
    lower = np.zeros(64)
    changed = 0
    for i in range(first, last):
        for j in range(1, ny - 1):
            for k in range(1, nz - 1):
                n = (i * ny + j) * nz + k
                s = np.int64(slot[n])
                if state[n] != INSIDE or s < 0:
                    continue
                if (
                    known[n, 1] * tri[s, 9] + known[n, 2] * tri[s, 10] + known[n, 3] * tri[s, 11]
                ) < FRONT:
                    continue
                x, y, z = origin[0] + h * i, origin[1] + h * j, origin[2] + h * k
                bound = np.float64(known[n, 0]) * (1.0 - 1e-6)
                q, d2 = nearest(tri, box, x, y, z, -1, bound * bound, stack, lower)
                if q < 0:
                    continue
                d2, fx, fy, fz = closest(tri, q, x, y, z)
                note(tri, q, d2, fx, fy, fz, x, y, z, n, slot, known)
                changed += 1
                for a in range(-1, 2):
                    for b in range(-1, 2):
                        for c in range(-1, 2):
                            m = n + (a * ny + b) * nz + c
                            if fresh[m] == STALE:
                                fresh[m] = FRESH
    return changed


@kernel
def part_known(known, first, last, d, gradient):
    """Copy distances and gradients into arrays of their own; unknown distances are 0."""
    for n in range(first, last):
        d[n] = known[n, 0] if known[n, 0] < UNKNOWN else 0.0
        for k in range(3):
            gradient[n, k] = known[n, k + 1]


@kernel
def finish_nodes(
    tri, brr_tri, brr_box, origin, h, state, ny, nz, first, last, r0, t, bent, d, slot, gradient,
    level
):  # fmt: skip
    """Sign the distances, and compute gradients and level counts.

    A node outside the part is positive where the part's nearest face is restrained
    (the level sets go on through the restraint region) and negative elsewhere. Where
    distances are bent, those at inside nodes and their gradients are worked out anew.
    """
    stack = np.zeros(64, np.int64)
    lower = np.zeros(64)
    for i in range(first, last):
        for j in range(ny):
            for k in range(nz):
                n = (i * ny + j) * nz + k
                if state[n] == NONE or slot[n] < 0:
                    continue
                if bent or state[n] == RING:
                    x, y, z = origin[0] + h * i, origin[1] + h * j, origin[2] + h * k
                    s = slot[n]
                    d2, qx, qy, qz = closest(tri, s, x, y, z)
                    r = np.sqrt(d2)
                    d[n] = r
                    if r > 1e-9:
                        gx, gy, gz = (x - qx) / r, (y - qy) / r, (z - qz) / r
                    else:
                        gx, gy, gz = -tri[s, 9], -tri[s, 10], -tri[s, 11]
                    if state[n] == RING:
                        positive = False
                        if len(brr_tri) > 0:
                            bound = d2 * (1.0 + 1e-9) + 1e-18
                            q, e2 = nearest(brr_tri, brr_box, x, y, z, -1, bound, stack, lower)
                            if q >= 0:
                                if e2 < d2 * (1.0 - 1e-6):
                                    positive = True
                                else:
                                    positive = (
                                        gx * tri[s, 9] + gy * tri[s, 10] + gz * tri[s, 11] < 0.0
                                    )
                        if not positive:
                            d[n] = -r
                            gx, gy, gz = -gx, -gy, -gz
                    gradient[n, 0] = gx
                    gradient[n, 1] = gy
                    gradient[n, 2] = gz
                if d[n] > r0:
                    level[n] = int(np.ceil((np.float64(d[n]) - r0) / t))


@kernel
def mark_hidden(state, d, gradient, level, h, ny, nz, first, last, r0, t, raised):
    """Mark the nodes between which and a neighbour a level is passed there and back.

    Where two fronts face each other and the level set between them is narrower than the
    grid, it may lie between two nodes that have both not reached it. The deeper one is
    marked; both of its neighbours see the level then, each from its own side.

    Args:
        raised: Result, 1 at the marked nodes; planes first:last + 1 are written.
    """
    step = (ny * nz, nz, 1)
    for i in range(first, last):
        for j in range(1, ny - 1):
            for k in range(1, nz - 1):
                n = (i * ny + j) * nz + k
                if d[n] <= 0.0 or state[n] == NONE:
                    continue
                for axis in range(3):
                    m = n + step[axis]
                    if level[m] != level[n] or d[m] <= 0.0 or state[m] == NONE:
                        continue
                    along, against = gradient[n, axis], -gradient[m, axis]
                    if along < FACING or against < FACING:
                        continue
                    x = (d[m] - d[n] + against * h) / (along + against)
                    if x <= 0.0 or x >= h:
                        continue
                    if d[n] + along * x > r0 + t * level[n] + HIDDEN_MM:
                        raised[n if d[n] >= d[m] else m] = 1


@kernel
def mark_bridges(state, d, gradient, level, h, ny, nz, first, last, r0, t, raised):
    """Mark nodes through which a narrow level set goes on from a node to one diagonal to it.

    Of the corners of a square two opposite ones are past a level and two are not. Where
    the level is passed between the two that are, the deeper of the others is marked, or
    the set would be pierced there.

    Args:
        raised: Result, 1 at the marked nodes; planes first:last + 1 are written.
    """
    step = (ny * nz, nz, 1)
    for i in range(first, last):
        for j in range(1, ny - 1):
            for k in range(1, nz - 1):
                n = (i * ny + j) * nz + k
                if state[n] == NONE:
                    continue
                for axis in range(3):
                    for other in range(axis + 1, 3):
                        a, b = n + step[axis], n + step[other]
                        c = a + step[other]
                        if state[a] == NONE or state[b] == NONE or state[c] == NONE:
                            continue
                        p, q, e, f = n, c, a, b
                        way = 1.0
                        if min(level[a], level[b]) > max(level[n], level[c]):
                            p, q, e, f = a, b, n, c
                            way = -1.0
                        elif min(level[n], level[c]) <= max(level[a], level[b]):
                            continue
                        if d[e] <= 0.0 or d[f] <= 0.0:
                            continue
                        x = way * gradient[p, axis] + gradient[p, other]
                        y = way * gradient[q, axis] + gradient[q, other]
                        middle = min(d[p] + 0.5 * h * x, d[q] - 0.5 * h * y)
                        deeper = e if d[e] >= d[f] else f
                        if middle > r0 + t * level[deeper]:
                            raised[deeper] = 1
