# SPDX-License-Identifier: Apache-2.0
# mypy: disable-error-code="no-untyped-def"
"""Compiled test of which points of a lattice the faces of a sheet cover."""

from __future__ import annotations

import numpy as np

from vega_planner.compiled import inner_kernel, kernel
from vega_planner.layers.triangle_kernels import measure_below
from vega_planner.part.surface_kernels import cross_of

#: Longest edge of an empty cube that is told, in points.
EMPTY = 250


@inner_kernel
def lay_triangle(vertices, a, b, c, normal, length, tri):
    """Lay out one triangle as a row of `triangle_kernels`."""
    for k in range(3):
        tri[0, k] = vertices[a, k]
        tri[0, 3 + k] = vertices[b, k] - vertices[a, k]
        tri[0, 6 + k] = vertices[c, k] - vertices[a, k]
        tri[0, 9 + k] = normal[k] / length if length > 0.0 else 0.0
    tri[0, 13] = tri[0, 14] = tri[0, 15] = 0.0
    for k in range(3):
        tri[0, 13] += tri[0, 3 + k] * tri[0, 3 + k]
        tri[0, 14] += tri[0, 3 + k] * tri[0, 6 + k]
        tri[0, 15] += tri[0, 6 + k] * tri[0, 6 + k]


@kernel
def measure_empty(row, empty):
    """Measure the cubes without a point that is asked about, each from its lowest corner.

    Args:
        row: Number of each point that is asked about, -1 for the others, (i, j, k).
        empty: Result: points along the edge of the largest such cube; `EMPTY` at first,
            as it stays beyond the lattice, (i + 1, j + 1, k + 1).
    """
    nx, ny, nz = row.shape
    for i in range(nx - 1, -1, -1):
        for j in range(ny - 1, -1, -1):
            here, beside = empty[i, j], empty[i, j + 1]
            behind, across = empty[i + 1, j], empty[i + 1, j + 1]
            for k in range(nz):
                least = min(behind[k], behind[k + 1], across[k], across[k + 1])
                here[k] = min(least, beside[k], beside[k + 1])
            last = np.uint8(EMPTY)
            for k in range(nz - 1, -1, -1):
                last = min(min(last, here[k]) + np.uint8(1), np.uint8(EMPTY))
                if row[i, j, k] >= 0:
                    last = np.uint8(0)
                here[k] = last


@kernel
def cover(points, axes, faces, thickness, origin, spacing, row, empty, covered):
    """Mark the points of a lattice that lie within half the thickness of a sheet.

    What counts is the thickness of the face that is nearest.

    Args:
        points: Vertices of the sheet [mm], (n, 3).
        axes: Unit vectors of the lattice, as columns, (3, 3).
        faces: Vertex indices, (m, 3).
        thickness: Thickness at the vertices [mm], (n,).
        origin: First point of the lattice [mm].
        spacing: Distance between its points [mm].
        row: Number of each point that is asked about, -1 for the others, (i, j, k).
        empty: Edges of the cubes without any of them, of `measure_empty`, (i + 1, j + 1, k + 1).
        covered: Result, 1 for the covered ones of the points asked about.

    Returns:
        Material of the sheet: area times thickness [mm³].
    """
    vertices = np.zeros((len(points), 3))
    for v in range(len(points)):
        for k in range(3):
            for c in range(3):
                vertices[v, k] += points[v, c] * axes[c, k]
    material = 0.0
    normal = np.zeros(3)
    tri = np.zeros((1, 16))
    first, last = np.zeros(3, np.int64), np.zeros(3, np.int64)
    reach = 0.5 * thickness.max() + 1e-6
    # This near to any face the nearest one covers a point, whichever it is.
    sure = (0.5 * thickness.min()) ** 2
    square = np.full(len(covered), reach * reach, np.float32)
    within = np.full(len(covered), -1.0, np.float32)
    scale = 1.0 / spacing
    for f in range(len(faces)):
        a, b, c = faces[f, 0], faces[f, 1], faces[f, 2]
        half = (thickness[a] + thickness[b] + thickness[c]) / 6.0
        length = cross_of(vertices, a, b, c, normal)
        material += length * half
        longest, shortest = 0, 1
        for k in range(3):
            p, q, r = vertices[a, k], vertices[b, k], vertices[c, k]
            low, high = min(p, q, r) - reach - origin[k], max(p, q, r) + reach - origin[k]
            first[k] = max(int(np.ceil(low * scale)), 0)
            last[k] = min(int(np.floor(high * scale)), row.shape[k] - 1)
            across = last[k] - first[k] + 1
            longest, shortest = max(longest, across), min(shortest, across)
        if shortest <= 0 or empty[first[0], first[1], first[2]] >= longest:
            continue
        laid = False
        for i in range(first[0], last[0] + 1):
            for j in range(first[1], last[1] + 1):
                for k in range(first[2], last[2] + 1):
                    n = row[i, j, k]
                    if n < 0 or covered[n] != 0:
                        continue
                    if not laid:
                        lay_triangle(vertices, a, b, c, normal, length, tri)
                        laid = True
                    x = origin[0] + spacing * i
                    y = origin[1] + spacing * j
                    z = origin[2] + spacing * k
                    least = np.float64(square[n])
                    d2 = measure_below(tri, 0, x, y, z, least)
                    if d2 < sure:
                        covered[n] = 1
                    elif d2 < least:
                        square[n] = d2
                        within[n] = (half + 1e-6) ** 2 - d2
    for n in range(len(covered)):
        if within[n] >= 0.0:
            covered[n] = 1
    return material
