# SPDX-License-Identifier: Apache-2.0
"""Coarser copies of layers and toolpaths, for display only.

A machine without a graphics card draws some 40,000 triangles a few times a second;
what is planned and printed is never touched.
"""

from __future__ import annotations

import numpy as np

from vega_planner.datatypes import Bools, Floats, Ints, face_cross

#: Growth of the cell size from try to try.
_STEP = 1.2


def clustered(vertices: Floats, faces: Ints, budget: int) -> tuple[Floats, Ints]:
    """Coarsen a mesh by merging the vertices in the cells of a grid [RossignacBorrel1993]_.

    Vertices of an open border are merged with their like only, so that it stays where it is.

    Args:
        vertices: Points, shape (n, 3).
        faces: Vertex indices, shape (m, 3).
        budget: Largest number of faces wanted.

    Returns:
        Vertices and faces; those given where they are within the budget.
    """
    if len(faces) <= budget:
        return vertices, faces
    area = 0.5 * np.linalg.norm(face_cross(vertices, faces), axis=1).sum()
    low = vertices.min(0)
    border = _on_border(faces, len(vertices))
    cell = max(np.sqrt(2.0 * area / budget), 1e-9)
    while True:
        keys = np.floor((vertices - low) / cell).astype(np.int64)
        span = keys.max(0) + 1
        flat = 2 * ((keys[:, 0] * span[1] + keys[:, 1]) * span[2] + keys[:, 2]) + border
        _, cluster = np.unique(flat, return_inverse=True)
        coarse = cluster[faces]
        whole = (
            (coarse[:, 0] != coarse[:, 1])
            & (coarse[:, 1] != coarse[:, 2])
            & (coarse[:, 2] != coarse[:, 0])
        )
        coarse = coarse[whole]
        _, first = np.unique(np.sort(coarse, axis=1), axis=0, return_index=True)
        coarse = coarse[np.sort(first)]
        if len(coarse) <= budget:
            break
        cell *= _STEP
    count = cluster.max() + 1
    weight = np.bincount(cluster, minlength=count)
    middle = np.column_stack(
        [np.bincount(cluster, vertices[:, k], minlength=count) / weight for k in range(3)]
    )
    return middle, coarse


def _on_border(faces: Ints, count: int) -> Bools:
    """Find the vertices of edges that have a single face, shape (count,)."""
    edges = np.sort(np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]]), axis=1)
    keys = edges[:, 0].astype(np.int64) * count + edges[:, 1]
    single, uses = np.unique(keys, return_counts=True)
    single = single[uses == 1]
    border = np.zeros(count, dtype=bool)
    border[single // count] = border[single % count] = True
    return border


def kept_rows(points: Floats, ends: Bools, budget: int) -> Ints:
    """Choose which points of a set of lines to draw.

    Ends stay, then corners, then every n-th point between. Corners that the budget
    cannot hold go, the bluntest first.

    Args:
        points: Positions of all lines one after the other, shape (n, 3).
        ends: True for the first and the last point of each line, shape (n,).
        budget: Number of points wanted; more only where the lines have more ends.

    Returns:
        Indices of the points to draw, rising.
    """
    count = len(points)
    if count <= budget:
        return np.arange(count)
    step = np.diff(points, axis=0)
    length = np.linalg.norm(step, axis=1)
    unit = step / np.where(length > 0, length, 1.0)[:, None]
    turn = np.zeros(count)
    turn[1:-1] = np.arccos(np.clip(np.einsum("ij,ij->i", unit[1:], unit[:-1]), -1.0, 1.0))
    turn[ends] = 0.0
    room = max(budget - int(ends.sum()), 0)
    sharp = np.flatnonzero(turn > np.radians(15.0))
    if len(sharp) > room // 2:
        order = np.argsort(-turn[sharp], kind="stable")
        sharp = sharp[order[: room // 2]]
    keep = ends.copy()
    keep[sharp] = True
    every = int(np.ceil(count / max(budget - int(keep.sum()), 1)))
    keep[::every] = True
    return np.flatnonzero(keep)
