# SPDX-License-Identifier: Apache-2.0
# mypy: disable-error-code="no-untyped-def"
"""Compiled queries on a set of triangles: nearest point, first hit of a segment.

A triangle set is four arrays. `tri` holds one row of 13 numbers per triangle, in the
order of the tree: corner a, edges ab and ac, unit normal, and a head start that is
added to distances (0 but for the sources of `geodesic`). `box` holds a balanced
binary tree of bounding boxes in heap order (children of i at 2i+1 and 2i+2) over
leaves of `LEAF` consecutive triangles. `corner`, `ring_start` and `ring` list for each
triangle its vertices and for each vertex the triangles around it.
"""

from __future__ import annotations

import numpy as np

from vega_planner.compiled import kernel

LEAF = 4

#: Cosine between the ways to the nearest points of two places next to each other above
#: which walking from either ends at one triangle (8 degrees): they see one smooth sheet.
SAME_BASIN = 0.99


@kernel(error_model="numpy")
def measure(tri, s, x, y, z):
    """Measure the squared distance from (x, y, z) to triangle s.

    The seven cases are those of Ericson, Real-Time Collision Detection, 5.1.5.

    Returns:
        Squared distance, and where its nearest point is: a + u ab + v ac.
    """
    px, py, pz = x - tri[s, 0], y - tri[s, 1], z - tri[s, 2]
    bx, by, bz = tri[s, 3], tri[s, 4], tri[s, 5]
    cx, cy, cz = tri[s, 6], tri[s, 7], tri[s, 8]
    bb, bc, cc = tri[s, 13], tri[s, 14], tri[s, 15]
    d1 = bx * px + by * py + bz * pz
    d2 = cx * px + cy * py + cz * pz
    u = 0.0
    v = 0.0
    if d1 > 0.0 or d2 > 0.0:
        d3, d4 = d1 - bb, d2 - bc
        d5, d6 = d1 - bc, d2 - cc
        vb = d5 * d2 - d1 * d6
        vc = d1 * d4 - d3 * d2
        va = d3 * d6 - d5 * d4
        if va > 0.0 and vb > 0.0 and vc > 0.0:
            total = 1.0 / (va + vb + vc)
            u = vb * total
            v = vc * total
        elif d3 >= 0.0 and d4 <= d3:
            u = 1.0
        elif vc <= 0.0 and d1 >= 0.0 and d3 <= 0.0:
            u = d1 / bb
        elif d6 >= 0.0 and d5 <= d6:
            v = 1.0
        elif vb <= 0.0 and d2 >= 0.0 and d6 <= 0.0:
            v = d2 / cc
        else:
            v = (d4 - d3) / ((d4 - d3) + (d5 - d6))
            u = 1.0 - v
    px -= u * bx + v * cx
    py -= u * by + v * cy
    pz -= u * bz + v * cz
    d2 = px * px + py * py + pz * pz
    start = tri[s, 12]
    if start > 0.0:
        # A source with a head start acts as if it stood that much farther away.
        d2 = (np.sqrt(d2) + start) ** 2
    return d2, u, v


@kernel
def off_plane(tri, s, x, y, z):
    """Signed distance of a point from the plane of a triangle: none of it is nearer."""
    return (
        tri[s, 9] * (x - tri[s, 0]) + tri[s, 10] * (y - tri[s, 1]) + tri[s, 11] * (z - tri[s, 2])
    )


@kernel(error_model="numpy")
def foot(tri, s, u, v, x, y, z):
    """Place the point a + u ab + v ac of triangle s, as seen from (x, y, z)."""
    qx = tri[s, 0] + u * tri[s, 3] + v * tri[s, 6]
    qy = tri[s, 1] + u * tri[s, 4] + v * tri[s, 7]
    qz = tri[s, 2] + u * tri[s, 5] + v * tri[s, 8]
    start = tri[s, 12]
    if start > 0.0:
        e = np.sqrt((x - qx) ** 2 + (y - qy) ** 2 + (z - qz) ** 2)
        if e > 1e-9:
            f = start / e
            qx += f * (qx - x)
            qy += f * (qy - y)
            qz += f * (qz - z)
        else:
            qz -= start
    return qx, qy, qz


@kernel
def closest(tri, s, x, y, z):
    """Find the point of triangle s nearest to (x, y, z).

    Returns:
        Squared distance, and the point's coordinates.
    """
    d2, u, v = measure(tri, s, x, y, z)
    qx, qy, qz = foot(tri, s, u, v, x, y, z)
    return d2, qx, qy, qz


@kernel
def heaviest(u, v):
    """Tell which corner the point a + u ab + v ac of a triangle belongs to most."""
    w = 1.0 - u - v
    if w >= u and w >= v:
        return 0
    return 1 if u >= v else 2


@kernel
def spread_bits(v):
    """Put two zero bits between the low 20 bits of v."""
    v = (v | (v << 32)) & 0x1F00000000FFFF
    v = (v | (v << 16)) & 0x1F0000FF0000FF
    v = (v | (v << 8)) & 0x100F00F00F00F00F
    v = (v | (v << 4)) & 0x10C30C30C30C30C3
    v = (v | (v << 2)) & 0x1249249249249249
    return v


@kernel
def morton_codes(vertices, faces, low, scale):
    """Number each triangle's centroid along the Z-order curve."""
    out = np.zeros(len(faces), np.int64)
    for f in range(len(faces)):
        code = np.int64(0)
        for k in range(3):
            middle = 0.0
            for c in range(3):
                middle += vertices[faces[f, c], k]
            q = np.int64((middle / 3.0 - low[k]) * scale)
            code |= spread_bits(q) << k
        out[f] = code
    return out


@kernel
def triangle_rows(vertices, faces, order):
    """Lay out the triangles in tree order: corner, two edges, unit normal."""
    tri = np.zeros((len(order), 16))
    for s in range(len(order)):
        f = order[s]
        for k in range(3):
            a = vertices[faces[f, 0], k]
            tri[s, k] = a
            tri[s, 3 + k] = vertices[faces[f, 1], k] - a
            tri[s, 6 + k] = vertices[faces[f, 2], k] - a
        nx = tri[s, 4] * tri[s, 8] - tri[s, 5] * tri[s, 7]
        ny = tri[s, 5] * tri[s, 6] - tri[s, 3] * tri[s, 8]
        nz = tri[s, 3] * tri[s, 7] - tri[s, 4] * tri[s, 6]
        length = np.sqrt(nx * nx + ny * ny + nz * nz)
        if length > 0.0:
            tri[s, 9] = nx / length
            tri[s, 10] = ny / length
            tri[s, 11] = nz / length
        for k in range(3):
            tri[s, 13] += tri[s, 3 + k] * tri[s, 3 + k]
            tri[s, 14] += tri[s, 3 + k] * tri[s, 6 + k]
            tri[s, 15] += tri[s, 6 + k] * tri[s, 6 + k]
    return tri


@kernel
def box_tree(tri, leaves):
    """Bound the leaves, then each pair of children."""
    box = np.zeros((2 * leaves - 1, 6))
    count = len(tri)
    for i in range(2 * leaves - 2, -1, -1):
        for k in range(3):
            box[i, k] = 1e300
            box[i, 3 + k] = -1e300
        if i >= leaves - 1:
            start = (i - leaves + 1) * LEAF
            for s in range(start, min(start + LEAF, count)):
                for k in range(3):
                    a = tri[s, k]
                    b = a + tri[s, 3 + k]
                    c = a + tri[s, 6 + k]
                    box[i, k] = min(box[i, k], a, b, c)
                    box[i, 3 + k] = max(box[i, 3 + k], a, b, c)
        else:
            for k in range(3):
                box[i, k] = min(box[2 * i + 1, k], box[2 * i + 2, k])
                box[i, 3 + k] = max(box[2 * i + 1, 3 + k], box[2 * i + 2, 3 + k])
    return box


@kernel
def rings(faces, order, vertex_count):
    """List the triangles around each vertex, as slots in tree order."""
    corner = np.zeros((len(order), 3), np.int32)
    start = np.zeros(vertex_count + 1, np.int64)
    for s in range(len(order)):
        for c in range(3):
            v = faces[order[s], c]
            corner[s, c] = v
            start[v + 1] += 1
    for v in range(vertex_count):
        start[v + 1] += start[v]
    fill = start[:-1].copy()
    ring = np.zeros(3 * len(order), np.int32)
    for s in range(len(order)):
        for c in range(3):
            v = corner[s, c]
            ring[fill[v]] = s
            fill[v] += 1
    return corner, start, ring


@kernel
def box_distance2(box, i, x, y, z):
    """Squared distance from a point to box i; 0 inside."""
    dx = max(box[i, 0] - x, 0.0, x - box[i, 3])
    dy = max(box[i, 1] - y, 0.0, y - box[i, 4])
    dz = max(box[i, 2] - z, 0.0, z - box[i, 5])
    return dx * dx + dy * dy + dz * dz


@kernel
def nearest(tri, box, x, y, z, hint, bound, stack, lower):
    """Find the nearest triangle by the tree.

    Args:
        tri: Triangle rows.
        box: Box tree.
        x: Point.
        y: Point.
        z: Point.
        hint: A triangle likely near, or -1.
        bound: Squared distance beyond which nothing is wanted.
        stack: Scratch, int64 (64,).
        lower: Scratch, float64 (64,).

    Returns:
        Slot of the nearest triangle, -1 if none is within the bound, and the squared
        distance (the bound if none).
    """
    best = -1
    least = bound
    if hint >= 0:
        d2, _, _ = measure(tri, hint, x, y, z)
        if d2 < least:
            least = d2
            best = hint
    first_leaf = (len(box) - 1) // 2
    count = len(tri)
    top = 0
    stack[0] = 0
    lower[0] = box_distance2(box, 0, x, y, z)
    top = 1
    while top > 0:
        top -= 1
        if lower[top] >= least:
            continue
        i = stack[top]
        if i >= first_leaf:
            start = (i - first_leaf) * LEAF
            for s in range(start, min(start + LEAF, count)):
                off = off_plane(tri, s, x, y, z)
                if off * off >= least:
                    continue
                d2, _, _ = measure(tri, s, x, y, z)
                if d2 < least:
                    least = d2
                    best = s
        else:
            left = 2 * i + 1
            a = box_distance2(box, left, x, y, z)
            b = box_distance2(box, left + 1, x, y, z)
            if a < b:
                if b < least:
                    stack[top] = left + 1
                    lower[top] = b
                    top += 1
                stack[top] = left
                lower[top] = a
                top += 1
            else:
                if a < least:
                    stack[top] = left
                    lower[top] = a
                    top += 1
                stack[top] = left + 1
                lower[top] = b
                top += 1
    return best, least


@kernel
def nearest_many(tri, box, points, first, last, slot, distance, foot):
    """Answer the nearest-point query for points[first:last]."""
    stack = np.zeros(64, np.int64)
    lower = np.zeros(64)
    hint = -1
    for i in range(first, last):
        x, y, z = points[i, 0], points[i, 1], points[i, 2]
        hint, _ = nearest(tri, box, x, y, z, hint, 1e300, stack, lower)
        d2, qx, qy, qz = closest(tri, hint, x, y, z)
        slot[i] = hint
        distance[i] = np.sqrt(d2)
        foot[i, 0] = qx
        foot[i, 1] = qy
        foot[i, 2] = qz


@kernel
def walk(tri, corner, ring_start, ring, s, x, y, z):
    """Step from triangle to triangle round the vertex next to the foot, downhill.

    Returns:
        Slot and squared distance of a local minimum, and the nearest point on it.
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
            off = off_plane(tri, n, x, y, z)
            if off * off >= least:
                continue
            d2, a, b = measure(tri, n, x, y, z)
            if d2 < least * (1.0 - 1e-12):
                least = d2
                s = n
                u, v = a, b
    qx, qy, qz = foot(tri, s, u, v, x, y, z)
    return s, least, qx, qy, qz


@kernel
def nearest_or_walk(tri, corner, ring_start, ring, box, x, y, z, hint, stack, lower):
    """Find the nearest triangle to 1e-3 mm, or without a tree what walking reaches."""
    s, d2, _, _, _ = walk(tri, corner, ring_start, ring, hint, x, y, z)
    if len(box) == 0:
        return s, d2
    # Deep inside, a great many triangles are almost as near as the nearest; they are
    # not worth the search.
    bound = max(np.sqrt(d2) - 1e-3, 0.0)
    q, e2 = nearest(tri, box, x, y, z, -1, bound * bound, stack, lower)
    if q < 0:
        return s, d2
    return q, e2


@kernel
def first_hit(tri, box, px, py, pz, qx, qy, qz, stack):
    """Find where the segment from p to q first meets a triangle.

    Returns:
        Slot of the triangle, -1 if there is none, and the parameter in [0, 1].
    """
    dx, dy, dz = qx - px, qy - py, qz - pz
    ix = 1.0 / dx if dx != 0.0 else 1e300
    iy = 1.0 / dy if dy != 0.0 else 1e300
    iz = 1.0 / dz if dz != 0.0 else 1e300
    best = -1
    least = 1.0 + 1e-9
    first_leaf = (len(box) - 1) // 2
    count = len(tri)
    stack[0] = 0
    top = 1
    while top > 0:
        top -= 1
        i = stack[top]
        a = (box[i, 0] - 1e-9 - px) * ix
        b = (box[i, 3] + 1e-9 - px) * ix
        near, far = min(a, b), max(a, b)
        a = (box[i, 1] - 1e-9 - py) * iy
        b = (box[i, 4] + 1e-9 - py) * iy
        near, far = max(near, min(a, b)), min(far, max(a, b))
        a = (box[i, 2] - 1e-9 - pz) * iz
        b = (box[i, 5] + 1e-9 - pz) * iz
        near, far = max(near, min(a, b)), min(far, max(a, b))
        if near > far or far < -1e-9 or near > least:
            continue
        if i < first_leaf:
            stack[top] = 2 * i + 1
            stack[top + 1] = 2 * i + 2
            top += 2
            continue
        start = (i - first_leaf) * LEAF
        for s in range(start, min(start + LEAF, count)):
            bx, by, bz = tri[s, 3], tri[s, 4], tri[s, 5]
            cx, cy, cz = tri[s, 6], tri[s, 7], tri[s, 8]
            hx, hy, hz = dy * cz - dz * cy, dz * cx - dx * cz, dx * cy - dy * cx
            det = bx * hx + by * hy + bz * hz
            if abs(det) < 1e-14:
                continue
            sx, sy, sz = px - tri[s, 0], py - tri[s, 1], pz - tri[s, 2]
            u = (sx * hx + sy * hy + sz * hz) / det
            if u < -1e-9 or u > 1.0 + 1e-9:
                continue
            kx, ky, kz = sy * bz - sz * by, sz * bx - sx * bz, sx * by - sy * bx
            v = (dx * kx + dy * ky + dz * kz) / det
            if v < -1e-9 or u + v > 1.0 + 1e-9:
                continue
            w = (cx * kx + cy * ky + cz * kz) / det
            if -1e-9 <= w < least:
                least = w
                best = s
    return best, max(least, 0.0)


@kernel
def first_hit_many(tri, box, starts, ends, first, last, slot, parameter):
    """Answer the segment query for rows first:last."""
    stack = np.zeros(64, np.int64)
    for i in range(first, last):
        s, u = first_hit(
            tri,
            box,
            starts[i, 0],
            starts[i, 1],
            starts[i, 2],
            ends[i, 0],
            ends[i, 1],
            ends[i, 2],
            stack,
        )
        slot[i] = s
        parameter[i] = u
