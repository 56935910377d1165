# SPDX-License-Identifier: Apache-2.0
# mypy: disable-error-code="no-untyped-def"
"""Compiled queries of a tree over triangles: nearest point, first hit of a segment.

`tri` and the rings are those of `triangle_kernels`. `box` holds a balanced binary tree of
bounding boxes in heap order (children of i at 2i+1 and 2i+2) over leaves of consecutive
triangles: lowest and highest corner, then a unit vector and the least and
greatest extent along it. The last four bound a few triangles of a smooth surface much
more closely than a box does.
"""

from __future__ import annotations

import numpy as np

from vega_planner.compiled import inner_kernel, kernel
from vega_planner.layers.triangle_kernels import closest, measure, measure_below, walk

#: Triangles of a leaf at most, and at least half as many.
LEAF = 8

#: Most triangles that are bounded by planes as well; more than these are hardly ever flat.
MOST_BETWEEN = 128


@kernel
def triangle_middles(vertices, faces):
    """Work out the centroid of each triangle, (m, 3)."""
    out = np.zeros((len(faces), 3))
    for f in range(len(faces)):
        for k in range(3):
            middle = 0.0
            for c in range(3):
                middle += vertices[faces[f, c], k]
            out[f, k] = middle / 3.0
    return out


@inner_kernel
def leaf_start(leaf, leaves, count):
    """First triangle of a leaf: all have as many, to one."""
    return leaf * count // leaves


@inner_kernel
def part_at(points, order, first, last, at, axis):
    """Order points first:last so that none before `at` is farther along an axis, Hoare's way."""
    low, high = first, last - 1
    while low < high:
        a, b, c = points[low, axis], points[(low + high) // 2, axis], points[high, axis]
        pivot = max(min(a, b), min(max(a, b), c))
        i, j = low, high
        while i <= j:
            while points[i, axis] < pivot:
                i += 1
            while points[j, axis] > pivot:
                j -= 1
            if i <= j:
                for k in range(3):
                    points[i, k], points[j, k] = points[j, k], points[i, k]
                order[i], order[j] = order[j], order[i]
                i += 1
                j -= 1
        if j < at:
            low = i
        if i > at:
            high = j


@kernel
def sort_leaves(points, order, leaves, first, last, most):
    """Order the triangles of leaves first:last, halving the longest side again and again.

    Args:
        points: Centroids of all triangles, ordered in place, (m, 3).
        order: Numbers of the triangles, likewise, (m,).
        leaves: Number of all leaves, a power of two.
        first: First leaf, at which a subtree begins.
        last: End of the leaves.
        most: Leaves up to which a subtree is left as it is, a power of two.
    """
    ends = np.zeros((64, 2), np.int64)
    ends[0, 0], ends[0, 1] = first, last
    top = 1
    while top > 0:
        top -= 1
        first, last = ends[top, 0], ends[top, 1]
        if last - first <= most:
            continue
        middle = (first + last) // 2
        start = leaf_start(first, leaves, len(order))
        end = leaf_start(last, leaves, len(order))
        longest, axis = -1.0, 0
        for k in range(3):
            low, high = points[start, k], points[start, k]
            for i in range(start, end):
                low, high = min(low, points[i, k]), max(high, points[i, k])
            if high - low > longest:
                longest, axis = high - low, k
        part_at(points, order, start, end, leaf_start(middle, leaves, len(order)), axis)
        ends[top, 0], ends[top, 1] = first, middle
        ends[top + 1, 0], ends[top + 1, 1] = middle, last
        top += 2


@kernel
def bound_boxes(tri, leaves, top, bottom, first, last, box):
    """Bound the boxes of a subtree, those with the most leaves last.

    Args:
        tri: Triangle rows.
        leaves: Number of all leaves, a power of two.
        top: Leaves of the largest boxes that are bounded.
        bottom: Leaves of the smallest ones; 1 bounds the leaves themselves, otherwise
            boxes of half as many are there already.
        first: First leaf of the subtree.
        last: End of its leaves.
        box: Result, (2 leaves - 1, 11).
    """
    count = len(tri)
    size = bottom
    while size <= top:
        before = leaves // size - 1
        for i in range(before + first // size, before + last // size):
            start = leaf_start((i - before) * size, leaves, count)
            end = leaf_start((i - before + 1) * size, leaves, count)
            for k in range(3):
                low, high = 1e300, -1e300
                if size == 1:
                    for s in range(start, end):
                        a = tri[s, k]
                        b = a + tri[s, 3 + k]
                        c = a + tri[s, 6 + k]
                        low, high = min(low, a, b, c), max(high, a, b, c)
                else:
                    low = min(box[2 * i + 1, k], box[2 * i + 2, k])
                    high = max(box[2 * i + 1, 3 + k], box[2 * i + 2, 3 + k])
                box[i, k], box[i, 3 + k] = low, high
            if end - start <= MOST_BETWEEN:
                lay_planes(tri, start, end, box[i])
            else:
                box[i, 9], box[i, 10] = -1e300, 1e300
        size *= 2


@inner_kernel
def lay_planes(tri, first, last, row):
    """Bound some triangles by two planes across their mean normal, in row[6:]."""
    x, y, z = 0.0, 0.0, 0.0
    for s in range(first, last):
        x += tri[s, 9]
        y += tri[s, 10]
        z += tri[s, 11]
    length = max(np.sqrt(x * x + y * y + z * z), 1e-9)
    x, y, z = x / length, y / length, z / length
    low, high = 1e300, -1e300
    for s in range(first, last):
        a = x * tri[s, 0] + y * tri[s, 1] + z * tri[s, 2]
        b = a + x * tri[s, 3] + y * tri[s, 4] + z * tri[s, 5]
        c = a + x * tri[s, 6] + y * tri[s, 7] + z * tri[s, 8]
        low, high = min(low, a, b, c), max(high, a, b, c)
    row[6], row[7], row[8], row[9], row[10] = x, y, z, low, high


@inner_kernel
def box_distance2(box, i, x, y, z):
    """Squared distance from a point to box i; 0 inside."""
    dx = max(box[i, 0] - x, 0.0, x - box[i, 3])
    dy = max(box[i, 1] - y, 0.0, y - box[i, 4])
    dz = max(box[i, 2] - z, 0.0, z - box[i, 5])
    return dx * dx + dy * dy + dz * dz


@inner_kernel
def plane_distance2(box, i, x, y, z):
    """Squared distance from a point to what is between the planes of box i; 0 between them."""
    along = box[i, 6] * x + box[i, 7] * y + box[i, 8] * z
    off = max(box[i, 9] - along, along - box[i, 10], 0.0)
    return off * off


@inner_kernel
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
    leaves = (len(box) + 1) // 2
    count = len(tri)
    top = 0
    i = 0
    reached = 0.0
    while True:
        if reached < least and i >= leaves - 1:
            leaf = i - leaves + 1
            for s in range(leaf_start(leaf, leaves, count), leaf_start(leaf + 1, leaves, count)):
                d2 = measure_below(tri, s, x, y, z, least)
                if d2 < least:
                    least = d2
                    best = s
        elif reached < least:
            # Down to the nearer child at once; the other one waits.
            left = 2 * i + 1
            a, b = box_distance2(box, left, x, y, z), box_distance2(box, left + 1, x, y, z)
            first = a < b
            a = max(a, plane_distance2(box, left, x, y, z))
            b = max(b, plane_distance2(box, left + 1, x, y, z))
            if first:
                i, reached = left, a
                if b < least:
                    stack[top], lower[top] = left + 1, b
                    top += 1
            else:
                i, reached = left + 1, b
                if a < least:
                    stack[top], lower[top] = left, a
                    top += 1
            continue
        if top == 0:
            return best, least
        top -= 1
        i, reached = stack[top], lower[top]


@kernel
def nearest_many(tri, box, points, reach, first, last, slot, distance, foot):
    """Answer the nearest-point query for points[first:last].

    What is not nearer than a point's reach is left out: slot -1, at an infinite distance.
    """
    stack = np.zeros(64, np.int64)
    lower = np.zeros(64)
    hint = -1
    for i in range(first, last):
        x, y, z = points[i, 0], points[i, 1], points[i, 2]
        bound = min(reach[i] * reach[i], 1e300)
        s, _ = nearest(tri, box, x, y, z, hint, bound, stack, lower)
        slot[i] = s
        if s < 0:
            distance[i] = np.inf
            continue
        hint = s
        d2, qx, qy, qz = closest(tri, s, x, y, z)
        distance[i] = np.sqrt(d2)
        foot[i, 0] = qx
        foot[i, 1] = qy
        foot[i, 2] = qz


@inner_kernel
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


@inner_kernel
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
    leaves = (len(box) + 1) // 2
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
        if i < leaves - 1:
            stack[top] = 2 * i + 1
            stack[top + 1] = 2 * i + 2
            top += 2
            continue
        leaf = i - leaves + 1
        for s in range(leaf_start(leaf, leaves, count), leaf_start(leaf + 1, leaves, count)):
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


@kernel
def mark_cells(points, reach, low, size, cells):
    """Mark the cells of a lattice that come within a distance of points, along each axis.

    Args:
        points: Points [mm], (n, 3).
        reach: The distance [mm].
        low: Where the lattice begins, `reach` or more before all points [mm].
        size: Size of its cells [mm].
        cells: Result, 0 at first, (i, j, k).
    """
    first, last = np.zeros(3, np.int64), np.zeros(3, np.int64)
    for n in range(len(points)):
        for k in range(3):
            first[k] = int((points[n, k] - reach - low[k]) / size)
            last[k] = min(int((points[n, k] + reach - low[k]) / size), cells.shape[k] - 1)
        cells[first[0] : last[0] + 1, first[1] : last[1] + 1, first[2] : last[2] + 1] = 1


@kernel
def mark_faces(vertices, faces, low, size, cells, marked):
    """Mark the faces whose boxes meet a marked cell of a lattice.

    Args:
        vertices: Points [mm], (n, 3).
        faces: Vertex indices, (m, 3).
        low: Where the lattice begins [mm].
        size: Size of its cells [mm].
        cells: Nonzero for marked cells, (i, j, k).
        marked: Result, 0 at first, (m,).
    """
    first, last = np.zeros(3, np.int64), np.zeros(3, np.int64)
    for f in range(len(faces)):
        for k in range(3):
            a, b, c = vertices[faces[f, 0], k], vertices[faces[f, 1], k], vertices[faces[f, 2], k]
            first[k] = max(int((min(a, b, c) - low[k]) / size), 0)
            last[k] = min(int(np.floor((max(a, b, c) - low[k]) / size)), cells.shape[k] - 1)
        for i in range(first[0], last[0] + 1):
            for j in range(first[1], last[1] + 1):
                for k in range(first[2], last[2] + 1):
                    if cells[i, j, k]:
                        marked[f] = True
