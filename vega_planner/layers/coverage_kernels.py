# SPDX-License-Identifier: Apache-2.0
# mypy: disable-error-code="no-untyped-def"
"""Compiled test of which points of a lattice the faces of a sheet cover."""

from __future__ import annotations

import numpy as np

from vega_planner.compiled import kernel
from vega_planner.layers.triangle_kernels import measure_below
from vega_planner.part.surface_kernels import cross_of


@kernel
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
def cover(vertices, faces, thickness, origin, spacing, shape, inside, covered):
    """Mark the inside points of a lattice that lie within half the thickness of a sheet.

    What counts is the thickness of the face that is nearest.

    Args:
        vertices: Points along the axes of the lattice [mm], (n, 3).
        faces: Vertex indices, (m, 3).
        thickness: Thickness at the vertices [mm], (n,).
        origin: First point of the lattice [mm].
        spacing: Distance between its points [mm].
        shape: Points along each axis.
        inside: Nonzero for the points that count.
        covered: Result, 1 for the covered ones.

    Returns:
        Material of the sheet: area times thickness [mm³].
    """
    material = 0.0
    normal = np.zeros(3)
    tri = np.zeros((1, 16))
    first, last = np.zeros(3, np.int64), np.zeros(3, np.int64)
    reach = 0.5 * thickness.max() + 1e-6
    square = np.full(len(inside), reach * reach, np.float32)
    within = np.full(len(inside), -1.0, np.float32)
    for f in range(len(faces)):
        a, b, c = faces[f, 0], faces[f, 1], faces[f, 2]
        half = (thickness[a] + thickness[b] + thickness[c]) / 6.0
        length = cross_of(vertices, a, b, c, normal)
        material += length * half
        for k in range(3):
            p, q, r = vertices[a, k], vertices[b, k], vertices[c, k]
            low, high = min(p, q, r) - reach - origin[k], max(p, q, r) + reach - origin[k]
            first[k] = max(int(np.ceil(low / spacing)), 0)
            last[k] = min(int(np.floor(high / spacing)), shape[k] - 1)
        laid = False
        for i in range(first[0], last[0] + 1):
            for j in range(first[1], last[1] + 1):
                for k in range(first[2], last[2] + 1):
                    n = (i * shape[1] + j) * shape[2] + k
                    if inside[n] == 0 or covered[n] != 0:
                        continue
                    if not laid:
                        lay_triangle(vertices, a, b, c, normal, length, tri)
                        laid = True
                    x = origin[0] + spacing * i
                    y = origin[1] + spacing * j
                    z = origin[2] + spacing * k
                    least = np.float64(square[n])
                    d2 = measure_below(tri, 0, x, y, z, least)
                    if d2 < least:
                        square[n] = d2
                        within[n] = (half + 1e-6) ** 2 - d2
    for n in range(len(inside)):
        if within[n] >= 0.0:
            covered[n] = 1
    return material
