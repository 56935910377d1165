# SPDX-License-Identifier: Apache-2.0
"""Exact cut of a mesh along the zero line of a field given at its vertices."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from vega_planner.datatypes import Bools, Floats, Ints
from vega_planner.splitting import kernels

#: Values below this share of the larger end of their edge are moved onto the line, so
#: that the cut makes no slivers.
SNAP_RATIO = 0.02


@dataclass(frozen=True, eq=False)
class Cut:
    """A mesh after the cut: old vertices first, then the cut vertices.

    Attributes:
        vertices: Points [mm], shape (n + c, 3).
        faces: Vertex indices, oriented as before, shape (p, 3).
        source: Face each piece came from, shape (p,).
        positive: True for the pieces on the positive side, shape (p,).
        ends: Ends of the edge each cut vertex lies on, shape (c, 2).
        weight: Share of the second end at each cut vertex, shape (c,).
    """

    vertices: Floats
    faces: Ints
    source: Ints
    positive: Bools
    ends: Ints
    weight: Floats

    def carry(self, values: Floats) -> Floats:
        """Extend a vertex field, linear on the old edges, to the cut vertices."""
        weight = self.weight.reshape((-1,) + (1,) * (values.ndim - 1))
        new = (1 - weight) * values[self.ends[:, 0]] + weight * values[self.ends[:, 1]]
        return np.concatenate([values, new])


def cut_mesh(vertices: Floats, faces: Ints, field: Floats) -> Cut:
    """Cut a mesh where a vertex field changes sign.

    Cut vertices are shared by the triangles of both sides, so that the pieces fit and
    their areas add up to the area before.

    Args:
        vertices: Points [mm], shape (n, 3).
        faces: Vertex indices, shape (m, 3).
        field: Values at the vertices, linear on each triangle, shape (n,).
    """
    field = snapped(faces, field)
    m = len(faces)
    new_faces = np.empty((3 * m, 3), np.int64)
    source = np.empty(3 * m, np.int64)
    side = np.empty(3 * m, np.bool_)
    ends = np.empty((2 * m + 1, 2), np.int64)
    weight = np.empty(2 * m + 1)
    made, cuts = kernels.cut_faces(vertices, faces, field, new_faces, source, ends, weight, side)
    ends, weight = ends[:cuts], weight[:cuts]
    share = weight[:, None]
    new = (1 - share) * vertices[ends[:, 0]] + share * vertices[ends[:, 1]]
    return Cut(
        np.concatenate([vertices, new]), new_faces[:made], source[:made], side[:made], ends, weight
    )


def snapped(faces: Ints, field: Floats) -> Floats:
    """Move values that are tiny against a neighbour of the other sign onto zero.

    A triangle whose corners would all become zero keeps the sign of the largest.
    """
    field = np.array(field, dtype=float)
    a = faces.ravel()
    b = np.roll(faces, -1, axis=1).ravel()
    for p, q in ((a, b), (b, a)):
        tiny = (field[p] * field[q] < 0) & (np.abs(field[p]) < SNAP_RATIO * np.abs(field[q]))
        flat = np.zeros(len(field), np.bool_)
        flat[p[tiny]] = True
        corner = flat[faces] | (field[faces] == 0)
        whole = corner.all(1)
        flat[faces[whole].ravel()] = False
        field[flat] = 0.0
    return field
