# SPDX-License-Identifier: Apache-2.0
# mypy: disable-error-code="no-untyped-def"
"""Compiled work on the nodes of a regular grid: inside or outside, nearest triangles.

Node (i, j, k) stands at origin + h (i, j, k); arrays over nodes are flat, k running
fastest, and at least two nodes wide outside the part so that neighbours always exist.
"""

from __future__ import annotations

import numpy as np

from vega_planner.compiled import kernel
from vega_planner.layers.triangle_kernels import closest, measure, nearest, off_plane, walk

#: States of a node.
NONE, RING, INSIDE = 0, 1, 2

#: Least cosine between an edge and the gradients at its ends where fronts face each other.
FACING = 0.3

#: Half the width of the narrowest level sets that are looked for between nodes [mm].
HIDDEN_MM = 0.02


@kernel
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


@kernel
def start_band(tri, box, origin, h, state, nx, ny, nz, first, last, reach, d, slot, fixed, fresh):
    """Find exact nearest triangles for the nodes along the surface.

    Nodes within `reach` of S are fixed; the others that belong to the part or its ring
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
                fresh[n] = 1
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
                s, d2 = nearest(tri, box, x, y, z, hint, reach * reach, stack, lower)
                if s >= 0:
                    hint = s
                    slot[n] = s
                    d[n] = np.sqrt(d2)
                    fixed[n] = 1
                    fresh[n] = 0


@kernel
def sweep(
    tri,
    corner,
    ring_start,
    ring,
    origin,
    h,
    state,
    ny,
    nz,
    first,
    last,
    backwards,
    d,
    slot,
    fixed,
    fresh,
):
    """Hand nearest triangles from node to node along the raster.

    A fresh node tries the triangles of its 26 neighbours, walks from the best one to
    the local minimum, and makes its neighbours fresh when it changed.

    Returns:
        Number of nodes that changed.
    """
    tried = np.zeros(26, np.int64)
    changed = 0
    root2, root3 = np.sqrt(2.0) * h * 1.000001, np.sqrt(3.0) * h * 1.000001
    for ii in range(last - first):
        i = last - 1 - ii if backwards else first + ii
        for jj in range(1, ny - 1):
            j = ny - 1 - jj if backwards else jj
            for kk in range(1, nz - 1):
                k = nz - 1 - kk if backwards else kk
                n = (i * ny + j) * nz + k
                if fresh[n] == 0:
                    continue
                fresh[n] = 0
                x, y, z = origin[0] + h * i, origin[1] + h * j, origin[2] + h * k
                current = slot[n]
                reach = d[n] if current >= 0 else 1e30
                best = current
                count = 0
                for a in range(-1, 2):
                    for b in range(-1, 2):
                        for c in range(-1, 2):
                            m = n + (a * ny + b) * nz + c
                            s = slot[m]
                            if s < 0 or s == best:
                                continue
                            steps = abs(a) + abs(b) + abs(c)
                            gap = h * 1.000001 if steps == 1 else (root2 if steps == 2 else root3)
                            if d[m] - gap > reach:
                                continue
                            again = False
                            for q in range(count):
                                if tried[q] == s:
                                    again = True
                                    break
                            if again:
                                continue
                            tried[count] = s
                            count += 1
                            off = off_plane(tri, s, x, y, z)
                            if abs(off) >= reach:
                                continue
                            d2, _, _ = measure(tri, s, x, y, z)
                            r = np.sqrt(d2)
                            if r < reach * (1.0 - 1e-7):
                                reach = r
                                best = s
                if best == current:
                    continue
                best, d2, _, _, _ = walk(tri, corner, ring_start, ring, best, x, y, z)
                slot[n] = best
                d[n] = np.sqrt(d2)
                changed += 1
                for a in range(-1, 2):
                    for b in range(-1, 2):
                        for c in range(-1, 2):
                            m = n + (a * ny + b) * nz + c
                            if slot[m] != best and state[m] != NONE and fixed[m] == 0:
                                fresh[m] = 1
    return changed


@kernel
def finish_nodes(
    tri, brr_tri, brr_box, origin, h, state, ny, nz, first, last, r0, t, d, slot, gradient, level
):
    """Sign the distances, and compute gradients and level counts.

    A node outside the part is positive where the part's nearest face is restrained
    (the level sets go on through the restraint region) and negative elsewhere.
    """
    stack = np.zeros(64, np.int64)
    lower = np.zeros(64)
    for i in range(first, last):
        for j in range(ny):
            for k in range(nz):
                n = (i * ny + j) * nz + k
                if state[n] == NONE or slot[n] < 0:
                    continue
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
                        q, e2 = nearest(
                            brr_tri, brr_box, x, y, z, -1, d2 * (1.0 + 1e-9) + 1e-18, stack, lower
                        )
                        if q >= 0:
                            if e2 < d2 * (1.0 - 1e-6):
                                positive = True
                            else:
                                positive = gx * tri[s, 9] + gy * tri[s, 10] + gz * tri[s, 11] < 0.0
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
