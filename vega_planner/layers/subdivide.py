# SPDX-License-Identifier: Apache-2.0
"""Splitting the edges of a triangle mesh at their midpoints, without cracks."""

from __future__ import annotations

import numpy as np

from vega_planner.datatypes import Floats, Ints
from vega_planner.layers import subdivide_kernels as kernels


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
    faces = np.ascontiguousarray(faces, np.int64)
    whole, made = kernels.count_whole(middle)
    out = np.zeros((whole + made, 3), np.int64)
    kernels.split_into(faces, middle, whole, out)
    return out


def split_flagged(faces: Ints, count: int, flagged: np.ndarray) -> tuple[Ints, Ints]:
    """Split flagged edges, in both faces that share them.

    Args:
        faces: Vertex indices, shape (m, 3).
        count: Number of vertices; new ones are numbered from here.
        flagged: 1 for the edges from corner c to c + 1 that are split, shape (m, 3).

    Returns:
        The new faces, and the ends of the split edges in the order of their new vertices,
        shape (e, 2).
    """
    found = int(np.count_nonzero(flagged))
    if found == 0:
        return faces, np.zeros((0, 2), np.int64)
    faces = np.ascontiguousarray(faces, np.int64)
    bits = int(4 * found).bit_length()
    keys, numbers = np.full(1 << bits, -1), np.zeros(1 << bits, np.int64)
    ends = np.zeros((found, 2), np.int64)
    edges = kernels.number_edges(faces, 0, flagged, bits, keys, numbers, ends)
    ends = ends[:edges]
    at_edge = np.zeros(count, np.uint8)
    at_edge[ends] = 1
    middle, uses = np.zeros(faces.shape, np.int64), np.zeros(edges, np.int64)
    whole, made = kernels.find_middles(faces, at_edge, bits, keys, numbers, count, middle, uses)
    out = np.zeros((whole + made, 3), np.int64)
    kernels.split_into(faces, middle, whole, out)
    return out, ends


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
