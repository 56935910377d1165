# SPDX-License-Identifier: Apache-2.0
"""Faces that occur more than once."""

from __future__ import annotations

import numpy as np

from vega_planner.datatypes import Ints
from vega_planner.part.topology import edge_uses


def drop_duplicates(faces: Ints) -> Ints:
    """Keep one face of each set of faces with the same three vertices.

    The orientation of the majority wins. Where as many look one way as the other, the
    faces are a wall between two bodies if every edge has two more faces besides, and
    all of them go; else one is kept.

    Args:
        faces: Vertex indices, shape (m, 3).

    Returns:
        The faces that stay, in their order.
    """
    corners = np.sort(faces, axis=1)
    turned = _is_odd(faces)
    order = np.lexsort((*corners.T[::-1], np.zeros(len(faces))))
    fresh = np.ones(len(faces), dtype=bool)
    fresh[1:] = (np.diff(corners[order], axis=0) != 0).any(1)
    if fresh.all():
        return faces
    group = np.empty(len(faces), dtype=np.int64)
    group[order] = np.cumsum(fresh) - 1
    net = np.bincount(group, weights=np.where(turned, -1.0, 1.0))
    size = np.bincount(group)
    uses = _uses_of_faces(faces).min(1)
    keep = np.zeros(len(faces), dtype=bool)
    settled = np.zeros(len(net), dtype=bool)
    for face in range(len(faces)):
        kind = group[face]
        if settled[kind]:
            continue
        if net[kind] == 0:
            settled[kind] = True
            keep[face] = uses[face] < size[kind] + 2
        elif size[kind] == 1 or turned[face] == (net[kind] < 0):
            settled[kind] = keep[face] = True
    return faces[keep]


def _is_odd(faces: Ints) -> np.ndarray:
    """Tell whether a face is an odd permutation of its sorted vertices."""
    a, b, c = faces.T
    return ((a > b).astype(int) + (b > c) + (a > c)) % 2 == 1


def _uses_of_faces(faces: Ints) -> Ints:
    """Count for each edge of each face how many faces use it, shape (m, 3)."""
    order, _, uses = edge_uses(faces)
    count = np.empty(len(order), dtype=np.int64)
    count[order] = np.repeat(uses, uses)
    return count.reshape(-1, 3)
