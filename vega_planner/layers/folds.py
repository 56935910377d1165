# SPDX-License-Identifier: Apache-2.0
"""Triangles at the rim of a sheet that are folded back onto it."""

from __future__ import annotations

import numpy as np

from vega_planner.datatypes import Bools, Floats, Ints, face_cross


def folded_ears(vertices: Floats, faces: Ints) -> Bools:
    """Mark the triangles with two open edges that lie on a larger only neighbour, (m,).

    Where the rim follows a hollow wall, the last point of a thin triangle can come to lie
    inside the edge opposite to it. Its normal is turned over then, and so is that of the
    point: a nozzle that follows it would tip over.

    Args:
        vertices: Points [mm], shape (n, 3).
        faces: Vertex indices, shape (m, 3).
    """
    ears = np.zeros(len(faces), np.bool_)
    if len(faces) == 0:
        return ears
    ends = np.sort(np.stack([faces, np.roll(faces, -1, axis=1)], axis=2), axis=2)
    _, edge, uses = np.unique(
        (ends[:, :, 0] * len(vertices) + ends[:, :, 1]).ravel(),
        return_inverse=True,
        return_counts=True,
    )
    edge = edge.reshape(-1, 3)
    joined = uses[edge] > 1
    found = np.flatnonzero(joined.sum(1) == 1)
    # the sum of the faces at an edge, less the face itself, is its neighbour
    total = np.zeros(len(uses))
    np.add.at(total, edge.ravel(), np.repeat(np.arange(len(faces), dtype=np.float64), 3))
    beside = edge[found, np.argmax(joined[found], axis=1)]
    paired = uses[beside] == 2
    found, beside = found[paired], beside[paired]
    other = np.rint(total[beside] - found).astype(np.int64)
    normals = face_cross(vertices, faces)
    size = np.linalg.norm(normals, axis=1)
    turned = np.einsum("ij,ij->i", normals[found], normals[other]) < 0
    ears[found] = turned & (size[found] <= size[other])
    return ears
