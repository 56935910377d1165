# SPDX-License-Identifier: Apache-2.0
# mypy: disable-error-code="no-untyped-def"
"""Compiled test of which points the faces of a sheet cover."""

from __future__ import annotations

import numpy as np

from vega_planner.compiled import kernel
from vega_planner.layers.triangle_kernels import measure, off_plane, triangle_rows
from vega_planner.part.surface_kernels import cross_of


@kernel
def weigh_faces(vertices, faces, thickness, middle, half):
    """Work out the middle and half the thickness of each face.

    Returns:
        Material of the sheet: area times thickness [mm³]; and the greatest distance
        from a middle to a point that its face covers [mm].
    """
    material, reach = 0.0, 0.0
    normal = np.zeros(3)
    for f in range(len(faces)):
        a, b, c = faces[f, 0], faces[f, 1], faces[f, 2]
        half[f] = (thickness[a] + thickness[b] + thickness[c]) / 6.0
        wide = 0.0
        for k in range(3):
            middle[f, k] = (vertices[a, k] + vertices[b, k] + vertices[c, k]) / 3.0
        for v in (a, b, c):
            d2 = 0.0
            for k in range(3):
                d2 += (vertices[v, k] - middle[f, k]) ** 2
            wide = max(wide, d2)
        material += cross_of(vertices, a, b, c, normal) * half[f]
        reach = max(reach, np.sqrt(wide) + half[f])
    return material, reach + 1e-6


@kernel
def sort_faces(middle, low, size, shape, start, order):
    """Sort faces into the boxes of a coarse grid that their middles lie in."""
    count = len(middle)
    box = np.zeros(count, np.int64)
    for f in range(count):
        place = 0
        for k in range(3):
            place = place * shape[k] + min(int((middle[f, k] - low[k]) / size), shape[k] - 1)
        box[f] = place
        start[place + 1] += 1
    for i in range(len(start) - 1):
        start[i + 1] += start[i]
    fill = start[:-1].copy()
    for f in range(count):
        order[fill[box[f]]] = f
        fill[box[f]] += 1


@kernel
def is_near_face(tri, half, low, size, shape, start, order, x, y, z):
    """Tell whether a point lies within half its thickness of any face."""
    i = int(np.floor((x - low[0]) / size))
    j = int(np.floor((y - low[1]) / size))
    k = int(np.floor((z - low[2]) / size))
    for a in range(max(i - 1, 0), min(i + 2, shape[0])):
        for b in range(max(j - 1, 0), min(j + 2, shape[1])):
            first = (a * shape[1] + b) * shape[2]
            # Boxes along the last axis are neighbours in the order as well.
            front, back = max(k - 1, 0), min(k + 2, shape[2])
            if front >= back:
                continue
            for n in range(start[first + front], start[first + back]):
                f = order[n]
                least = (half[f] + 1e-6) ** 2
                off = off_plane(tri, f, x, y, z)
                if off * off <= least and measure(tri, f, x, y, z)[0] <= least:
                    return True
    return False


@kernel
def mark_covered(vertices, faces, half, low, size, shape, start, order, points, out):
    """Mark the points that lie within half the thickness of a face."""
    tri = triangle_rows(vertices, faces, np.arange(len(faces)))
    for p in range(len(points)):
        out[p] = is_near_face(
            tri, half, low, size, shape, start, order, points[p, 0], points[p, 1], points[p, 2]
        )
