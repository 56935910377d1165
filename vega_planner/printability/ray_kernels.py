# SPDX-License-Identifier: Apache-2.0
"""Kernels of the line test: a bounding volume hierarchy and its any-hit query, in double."""

from __future__ import annotations

import math

import numpy as np

from vega_planner.compiled import kernel

LEAF = 4


@kernel
def build_tree(vertices, faces, order, boxes, first, number):
    """Build a bounding volume hierarchy by halving the longest axis at the middle.

    Args:
        vertices: (n, 3) float64.
        faces: (m, 3) int64.
        order: (m,) int64, written: faces in leaf order.
        boxes: (2 m, 6) float64, written: low and high corner per node.
        first: (2 m,) int64, written: first face of a leaf, or index of the left child.
        number: (2 m,) int64, written: faces of a leaf, 0 for an inner node.

    Returns:
        Number of nodes.
    """
    m = faces.shape[0]
    middle = np.empty((m, 3))
    for f in range(m):
        order[f] = f
        for x in range(3):
            middle[f, x] = (
                vertices[faces[f, 0], x] + vertices[faces[f, 1], x] + vertices[faces[f, 2], x]
            ) / 3
    stack = np.empty((128, 3), np.int64)
    stack[0, 0] = 0
    stack[0, 1] = 0
    stack[0, 2] = m
    depth = 1
    nodes = 1
    low_of, high_of = np.empty(3), np.empty(3)
    while depth > 0:
        depth -= 1
        node = stack[depth, 0]
        low = stack[depth, 1]
        high = stack[depth, 2]
        if high - low <= LEAF or depth >= 124:
            first[node] = low
            number[node] = high - low
            continue
        low_of[:] = 1e300
        high_of[:] = -1e300
        for k in range(low, high):
            f = order[k]
            for x in range(3):
                low_of[x] = min(low_of[x], middle[f, x])
                high_of[x] = max(high_of[x], middle[f, x])
        axis = 0
        for x in range(1, 3):
            if high_of[x] - low_of[x] > high_of[axis] - low_of[axis]:
                axis = x
        cut = 0.5 * (low_of[axis] + high_of[axis])
        i, j = low, high - 1
        while i <= j:
            if middle[order[i], axis] < cut:
                i += 1
            else:
                order[i], order[j] = order[j], order[i]
                j -= 1
        if i in (low, high):
            i = (low + high) // 2
        first[node] = nodes
        number[node] = 0
        stack[depth, 0] = nodes
        stack[depth, 1] = low
        stack[depth, 2] = i
        stack[depth + 1, 0] = nodes + 1
        stack[depth + 1, 1] = i
        stack[depth + 1, 2] = high
        depth += 2
        nodes += 2
    for node in range(nodes - 1, -1, -1):  # children come after their parents
        boxes[node, :3] = 1e300
        boxes[node, 3:] = -1e300
        if number[node] > 0:
            for k in range(first[node], first[node] + number[node]):
                for e in range(3):
                    for x in range(3):
                        v = vertices[faces[order[k], e], x]
                        boxes[node, x] = min(boxes[node, x], v)
                        boxes[node, 3 + x] = max(boxes[node, 3 + x], v)
            continue
        for child in range(first[node], min(first[node] + 2, nodes)):
            for x in range(3):
                boxes[node, x] = min(boxes[node, x], boxes[child, x])
                boxes[node, 3 + x] = max(boxes[node, 3 + x], boxes[child, 3 + x])
    return nodes


@kernel
def any_hit(vertices, faces, order, boxes, first, number, origins, directions, out):
    """Tell for each ray whether it meets any face ahead of its origin.

    Args:
        vertices, faces, order, boxes, first, number: As `build_tree` made them.
        origins: (r, 3), already moved off the surface they start on.
        directions: (r, 3).
        out: (r,) bool, written.
    """
    stack = np.empty(128, np.int64)
    for i in range(origins.shape[0]):
        ox, oy, oz = origins[i, 0], origins[i, 1], origins[i, 2]
        dx, dy, dz = directions[i, 0], directions[i, 1], directions[i, 2]
        ix = 1.0 / dx if abs(dx) > 1e-300 else math.copysign(1e300, dx)
        iy = 1.0 / dy if abs(dy) > 1e-300 else math.copysign(1e300, dy)
        iz = 1.0 / dz if abs(dz) > 1e-300 else math.copysign(1e300, dz)
        hit = False
        stack[0] = 0
        depth = 1
        while depth > 0 and not hit:
            depth -= 1
            node = stack[depth]
            a = (boxes[node, 0] - ox) * ix
            b = (boxes[node, 3] - ox) * ix
            near = min(a, b)
            far = max(a, b)
            a = (boxes[node, 1] - oy) * iy
            b = (boxes[node, 4] - oy) * iy
            near = max(near, min(a, b))
            far = min(far, max(a, b))
            a = (boxes[node, 2] - oz) * iz
            b = (boxes[node, 5] - oz) * iz
            near = max(near, min(a, b))
            far = min(far, max(a, b))
            if far < 0 or near > far * (1 + 1e-12) + 1e-12:
                continue
            if number[node] == 0:
                stack[depth] = first[node]
                stack[depth + 1] = first[node] + 1
                depth += 2
                continue
            for k in range(first[node], first[node] + number[node]):
                f = order[k]
                p, q, r = faces[f, 0], faces[f, 1], faces[f, 2]
                ax = vertices[q, 0] - vertices[p, 0]
                ay = vertices[q, 1] - vertices[p, 1]
                az = vertices[q, 2] - vertices[p, 2]
                bx = vertices[r, 0] - vertices[p, 0]
                by = vertices[r, 1] - vertices[p, 1]
                bz = vertices[r, 2] - vertices[p, 2]
                cx = dy * bz - dz * by
                cy = dz * bx - dx * bz
                cz = dx * by - dy * bx
                det = ax * cx + ay * cy + az * cz
                if det == 0.0:
                    continue
                tx, ty, tz = ox - vertices[p, 0], oy - vertices[p, 1], oz - vertices[p, 2]
                u = (tx * cx + ty * cy + tz * cz) / det
                if u < -1e-12 or u > 1 + 1e-12:
                    continue
                ex = ty * az - tz * ay
                ey = tz * ax - tx * az
                ez = tx * ay - ty * ax
                v = (dx * ex + dy * ey + dz * ez) / det
                if v < -1e-12 or u + v > 1 + 1e-12:
                    continue
                if (bx * ex + by * ey + bz * ez) / det > 0.0:
                    hit = True
                    break
        out[i] = hit
