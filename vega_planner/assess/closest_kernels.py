# SPDX-License-Identifier: Apache-2.0
# mypy: disable-error-code="no-untyped-def"
"""Kernels of the closest-point query on a triangle mesh.

The tree is a complete binary heap of boxes over triangles in Morton order: node k has
the children 2k+1 and 2k+2, and the last level holds runs of `LEAF` triangles. It is
built in one pass from below, which matters more here than the last factor in a query:
a printed surface has a million triangles and is asked once.
"""

from __future__ import annotations

import numpy as np

from vega_planner.compiled import kernel

LEAF = 4


@kernel
def morton_codes(centres, low, scale):
    """Interleave the bits of quantised triangle centres.

    Args:
        centres: Triangle centres, shape (m, 3).
        low: Lowest corner of their box, shape (3,).
        scale: Cells per length; cells run from 0 to 1023.
    """
    codes = np.zeros(len(centres), np.int64)
    for i in range(len(centres)):
        for k in range(3):
            cell = np.int64((centres[i, k] - low[k]) * scale)
            cell = min(max(cell, 0), 1023)
            for bit in range(10):
                codes[i] |= ((cell >> bit) & 1) << (3 * bit + k)
    return codes


@kernel
def build_boxes(corners, order, first_leaf):
    """Fill the heap of boxes from the leaves up.

    Args:
        corners: Triangle corners, shape (m, 3, 3).
        order: Triangles in Morton order, shape (m,).
        first_leaf: Heap index of the first leaf; there are first_leaf + 1 leaves.

    Returns:
        Boxes (2 first_leaf + 1, 6): lowest then highest corner; empty ones inverted.
    """
    boxes = np.empty((2 * first_leaf + 1, 6))
    boxes[:, :3] = np.inf
    boxes[:, 3:] = -np.inf
    for leaf in range(first_leaf + 1):
        node = first_leaf + leaf
        for at in range(leaf * LEAF, min((leaf + 1) * LEAF, len(order))):
            for corner in range(3):
                for k in range(3):
                    value = corners[order[at], corner, k]
                    boxes[node, k] = min(boxes[node, k], value)
                    boxes[node, 3 + k] = max(boxes[node, 3 + k], value)
    for node in range(first_leaf - 1, -1, -1):
        for k in range(3):
            boxes[node, k] = min(boxes[2 * node + 1, k], boxes[2 * node + 2, k])
            boxes[node, 3 + k] = max(boxes[2 * node + 1, 3 + k], boxes[2 * node + 2, 3 + k])
    return boxes


@kernel(inline="always")
def _box_distance2(boxes, node, x, y, z):
    dx = max(boxes[node, 0] - x, 0.0, x - boxes[node, 3])
    dy = max(boxes[node, 1] - y, 0.0, y - boxes[node, 4])
    dz = max(boxes[node, 2] - z, 0.0, z - boxes[node, 5])
    return dx * dx + dy * dy + dz * dz


@kernel
def closest_on_triangle(corners, face, x, y, z, foot):
    """Find the point of a triangle closest to a point.

    Writes the point to `foot`.

    Returns:
        Squared distance, and the feature it lies on: 0 the inside; 1, 2, 3 the edges
        from corners 0, 1, 2 to the next; 4, 5, 6 the corners 0, 1, 2.
    """
    ax, ay, az = corners[face, 0, 0], corners[face, 0, 1], corners[face, 0, 2]
    abx, aby, abz = corners[face, 1, 0] - ax, corners[face, 1, 1] - ay, corners[face, 1, 2] - az
    acx, acy, acz = corners[face, 2, 0] - ax, corners[face, 2, 1] - ay, corners[face, 2, 2] - az
    apx, apy, apz = x - ax, y - ay, z - az
    d1 = abx * apx + aby * apy + abz * apz
    d2 = acx * apx + acy * apy + acz * apz
    aa = abx * abx + aby * aby + abz * abz
    ab = abx * acx + aby * acy + abz * acz
    cc = acx * acx + acy * acy + acz * acz
    d3, d4 = d1 - aa, d2 - ab
    d5, d6 = d1 - ab, d2 - cc
    vc = d1 * d4 - d3 * d2
    vb = d5 * d2 - d1 * d6
    va = d3 * d6 - d5 * d4
    if d1 <= 0 and d2 <= 0:
        v, w, feature = 0.0, 0.0, 4
    elif d3 >= 0 and d4 <= d3:
        v, w, feature = 1.0, 0.0, 5
    elif vc <= 0 and d1 >= 0 and d3 <= 0 and d1 > d3:
        v, w, feature = d1 / (d1 - d3), 0.0, 1
    elif d6 >= 0 and d5 <= d6:
        v, w, feature = 0.0, 1.0, 6
    elif vb <= 0 and d2 >= 0 and d6 <= 0 and d2 > d6:
        v, w, feature = 0.0, d2 / (d2 - d6), 3
    elif va <= 0 and d4 - d3 >= 0 and d5 - d6 >= 0 and d4 - d3 + d5 - d6 > 0:
        w = (d4 - d3) / ((d4 - d3) + (d5 - d6))
        v, feature = 1.0 - w, 2
    elif va + vb + vc > 0:
        total = va + vb + vc
        v, w, feature = vb / total, vc / total, 0
    else:  # no area: the triangles beside it have all that is closer
        v, w, feature = 0.0, 0.0, 4
    foot[0] = ax + v * abx + w * acx
    foot[1] = ay + v * aby + w * acy
    foot[2] = az + v * abz + w * acz
    dx, dy, dz = x - foot[0], y - foot[1], z - foot[2]
    return dx * dx + dy * dy + dz * dz, feature


@kernel
def closest(corners, order, boxes, first_leaf, x, y, z, hint, bound2, foot):
    """Find the closest point of a mesh.

    Args:
        corners: Triangle corners, shape (m, 3, 3).
        order: Triangles in Morton order.
        boxes: Heap of `build_boxes`.
        first_leaf: Heap index of the first leaf.
        x: The point.
        y: The point.
        z: The point.
        hint: A triangle that is probably near, or -1.
        bound2: Squared distance beyond which nothing is looked for.
        foot: Receives the closest point, shape (3,).

    Returns:
        Squared distance, triangle, feature (as in `closest_on_triangle`); the bound and
        triangle -1 where nothing is nearer.
    """
    stack = np.empty(64, np.int64)
    trial = np.empty(3)
    best, face, feature = bound2, -1, 0
    if hint >= 0:
        distance2, where = closest_on_triangle(corners, hint, x, y, z, foot)
        if distance2 < best:
            best, face, feature = distance2, hint, where
    top = 1
    stack[0] = 0
    while top > 0:
        top -= 1
        node = stack[top]
        if _box_distance2(boxes, node, x, y, z) >= best:
            continue
        if node >= first_leaf:
            start = (node - first_leaf) * LEAF
            for at in range(start, min(start + LEAF, len(order))):
                distance2, where = closest_on_triangle(corners, order[at], x, y, z, trial)
                if distance2 < best:
                    best, face, feature = distance2, order[at], where
                    foot[0], foot[1], foot[2] = trial[0], trial[1], trial[2]
            continue
        left = _box_distance2(boxes, 2 * node + 1, x, y, z)
        right = _box_distance2(boxes, 2 * node + 2, x, y, z)
        near, far = 2 * node + 1, 2 * node + 2
        if right < left:
            near, far = far, near
            left, right = right, left
        if right < best:
            stack[top] = far
            top += 1
        if left < best:
            stack[top] = near
            top += 1
    return best, face, feature


@kernel
def closest_many(
    corners, order, boxes, first_leaf, normals, points, bound, signed, feet, faces, features
):
    """Find the closest points of many points, each tried first on its predecessor's face.

    Args:
        corners: Triangle corners, shape (m, 3, 3).
        order: Triangles in Morton order.
        boxes: Heap of `build_boxes`.
        first_leaf: Heap index of the first leaf.
        normals: Normals of the features of each face, shape (m, 7, 3); none for
            distances without sign.
        points: Points to ask for, shape (n, 3).
        bound: Distance beyond which nothing is looked for: such points get the bound as
            their distance, and themselves as the closest point.
        signed: Receives distances, below zero behind the feature's normal, shape (n,).
        feet: Receives closest points, shape (n, 3).
        faces: Receives triangles, shape (n,).
        features: Receives features, shape (n,).
    """
    hint = -1
    for i in range(len(points)):
        x, y, z = points[i, 0], points[i, 1], points[i, 2]
        distance2, face, feature = closest(
            corners, order, boxes, first_leaf, x, y, z, hint, bound * bound, feet[i]
        )
        if face < 0:
            signed[i], faces[i], features[i] = bound, 0, 0
            feet[i] = points[i]
            continue
        side = 0.0
        if len(normals) > 0:
            for k in range(3):
                side += (points[i, k] - feet[i, k]) * normals[face, feature, k]
        signed[i] = -np.sqrt(distance2) if side < 0 else np.sqrt(distance2)
        faces[i], features[i] = face, feature
        hint = face
