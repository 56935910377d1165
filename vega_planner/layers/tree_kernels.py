# SPDX-License-Identifier: Apache-2.0
# mypy: disable-error-code="no-untyped-def"
"""Compiled queries of a tree over triangles: nearest point, first hit of a segment.

`tri` and the rings are those of `triangle_kernels`. `box` holds a balanced binary tree of
bounding boxes in heap order (children of i at 2i+1 and 2i+2) over leaves of `LEAF`
consecutive triangles.
"""

from __future__ import annotations

import numpy as np

from vega_planner.compiled import kernel
from vega_planner.layers.triangle_kernels import closest, measure, measure_below, walk

LEAF = 4


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
                d2 = measure_below(tri, s, x, y, z, least)
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
        if box[i, 0] > box[i, 3]:
            continue  # nothing is in there: a node beyond the last triangle
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
