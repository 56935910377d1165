# SPDX-License-Identifier: Apache-2.0
"""Splitting the edges of a triangle mesh at their midpoints, without cracks."""

from __future__ import annotations

import numpy as np

from vega_planner.datatypes import Floats, Ints


def mesh_edges(faces: Ints) -> tuple[Ints, Ints]:
    """List the edges of a mesh.

    Args:
        faces: Vertex indices, shape (m, 3).

    Returns:
        Edges as sorted pairs, shape (e, 2), and the edge opposite to no corner but
        following it: column c joins corners c and c + 1, shape (m, 3).
    """
    pairs = np.sort(np.stack([faces, np.roll(faces, -1, axis=1)], axis=2).reshape(-1, 2), axis=1)
    size = int(faces.max()) + 1 if len(faces) else 1
    keys, number = np.unique(pairs[:, 0] * size + pairs[:, 1], return_inverse=True)
    return np.column_stack([keys // size, keys % size]), number.reshape(-1, 3)


def split_faces(faces: Ints, middle: Ints) -> Ints:
    """Split the edges that have a midpoint.

    Args:
        faces: Vertex indices, shape (m, 3).
        middle: Vertex at the middle of the edge from corner c to c + 1, -1 where that
            edge is not split, shape (m, 3). Both faces of an edge must agree.

    Returns:
        The new faces: those without a split edge first, in their order. A face with
        one, two or three split edges becomes two, three or four.
    """
    a, b, c = (middle >= 0).astype(np.int64).T
    count = a + b + c
    parts = [faces[count == 0]]
    for wanted in (1, 2):
        rows = np.flatnonzero(count == wanted)
        # Turn each face so that its first edge is split (one), or its third is not (two).
        lead = np.argmax(middle[rows] >= 0, axis=1)
        if wanted == 2:
            lead = (np.argmax(middle[rows] < 0, axis=1) + 1) % 3
        turn = (lead[:, None] + np.arange(3)) % 3
        a, b, c = np.take_along_axis(faces[rows], turn, axis=1).T
        p, q, _ = np.take_along_axis(middle[rows], turn, axis=1).T
        if wanted == 1:
            parts += [np.column_stack([a, p, c]), np.column_stack([p, b, c])]
        else:
            parts += [
                np.column_stack([p, b, q]),
                np.column_stack([a, p, q]),
                np.column_stack([a, q, c]),
            ]
    rows = np.flatnonzero(count == 3)
    a, b, c = faces[rows].T
    p, q, s = middle[rows].T
    parts += [
        np.column_stack([a, p, s]),
        np.column_stack([p, b, q]),
        np.column_stack([s, q, c]),
        np.column_stack([p, q, s]),
    ]
    return np.concatenate(parts)


def split_long_edges(vertices: Floats, faces: Ints, length: float) -> tuple[Floats, Ints]:
    """Halve edges until none is longer than `length`.

    Args:
        vertices: Points, shape (n, 3).
        faces: Vertex indices, shape (m, 3).
        length: Longest edge wanted.

    Returns:
        The new vertices and faces; the old vertices come first.
    """
    while True:
        edges, sides = mesh_edges(faces)
        ends = vertices[edges]
        marked = np.linalg.norm(ends[:, 0] - ends[:, 1], axis=1) > length
        if not marked.any():
            return vertices, faces
        middle = np.where(marked, len(vertices) + np.cumsum(marked) - 1, -1)
        faces = split_faces(faces, middle[sides])
        vertices = np.concatenate([vertices, ends[marked].mean(1)])
