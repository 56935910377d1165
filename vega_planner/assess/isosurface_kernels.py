# SPDX-License-Identifier: Apache-2.0
# mypy: disable-error-code="no-untyped-def"
"""Kernel of marching cubes over a fixed-point field, plane by plane."""

from __future__ import annotations

import numpy as np

from vega_planner.compiled import kernel


@kernel(inline="always")
def _value(field, z, y, x):
    """Field value that is never zero: zero would put three vertices at one node."""
    value = field[z, y, x]
    return np.float64(value) if value != 0 else 1.0


@kernel
def count_crossings(field, counts):
    """Count the edges between nodes of different sign and the triangles.

    Args:
        field: Signed field, shape (z, y, x) int16.
        counts: Triangles of each of the 256 cases.

    Returns:
        Number of vertices, number of triangles.
    """
    count_z, count_y, count_x = field.shape
    vertices, triangles = 0, 0
    for z in range(count_z):
        for y in range(count_y):
            for x in range(count_x):
                inside = field[z, y, x] < 0
                if x + 1 < count_x and (field[z, y, x + 1] < 0) != inside:
                    vertices += 1
                if y + 1 < count_y and (field[z, y + 1, x] < 0) != inside:
                    vertices += 1
                if z + 1 < count_z and (field[z + 1, y, x] < 0) != inside:
                    vertices += 1
                if x + 1 < count_x and y + 1 < count_y and z + 1 < count_z:
                    case = 0
                    for k in range(8):
                        if field[z + (k >> 2), y + ((k >> 1) & 1), x + (k & 1)] < 0:
                            case |= 1 << k
                    triangles += counts[case]
    return vertices, triangles


@kernel
def march(field, origin, voxel, counts, table, vertices, faces):
    """Extract the surface where the field changes its sign.

    Args:
        field: Signed field, shape (z, y, x) int16.
        origin: Place of node 0, 0, 0, shape (3,).
        voxel: Distance of the nodes.
        counts: Triangles of each of the 256 cases.
        table: Cell edges of the triangles' corners of each case, shape (256, t, 3).
            Edge 4 a + b runs along axis a (x, y, z) from the b-th of the four nodes
            that lie at the low end of that axis.
        vertices: Receives the vertices, shape (v, 3).
        faces: Receives the triangles, shape (t, 3).
    """
    count_z, count_y, count_x = field.shape
    # index of the vertex on the edge along x, y, z from each node, in two planes
    ids = np.full((2, count_y, count_x, 3), -1, np.int32)
    vertex, face = 0, 0
    for z in range(count_z):
        here = z % 2
        for y in range(count_y):
            for x in range(count_x):
                value = _value(field, z, y, x)
                for axis in range(3):
                    jx, jy, jz = x + (axis == 0), y + (axis == 1), z + (axis == 2)
                    if jx >= count_x or jy >= count_y or jz >= count_z:
                        continue
                    other = _value(field, jz, jy, jx)
                    if (value < 0) == (other < 0):
                        continue
                    t = value / (value - other)
                    vertices[vertex, 0] = origin[0] + voxel * (x + (t if axis == 0 else 0.0))
                    vertices[vertex, 1] = origin[1] + voxel * (y + (t if axis == 1 else 0.0))
                    vertices[vertex, 2] = origin[2] + voxel * (z + (t if axis == 2 else 0.0))
                    ids[here, y, x, axis] = vertex
                    vertex += 1
        if z == 0:
            continue
        below = 1 - here
        for y in range(count_y - 1):
            for x in range(count_x - 1):
                case = 0
                for k in range(8):
                    if field[z - 1 + (k >> 2), y + ((k >> 1) & 1), x + (k & 1)] < 0:
                        case |= 1 << k
                for i in range(counts[case]):
                    for corner in range(3):
                        edge = table[case, i, corner]
                        axis, b = edge // 4, edge % 4
                        low, high = b & 1, b >> 1
                        if axis == 0:
                            cx, cy, cz = 0, low, high
                        elif axis == 1:
                            cx, cy, cz = low, 0, high
                        else:
                            cx, cy, cz = low, high, 0
                        plane = here if cz == 1 else below
                        faces[face, corner] = ids[plane, y + cy, x + cx, axis]
                    face += 1
