# SPDX-License-Identifier: Apache-2.0
"""Edges and vertices at which a sheet touches itself, and how it is parted there."""

from __future__ import annotations

import numpy as np

from vega_planner.datatypes import Bools, Ints
from vega_planner.layers import touching_kernels as kernels
from vega_planner.part.topology import connected_pieces, directed_edges


def parted(faces: Ints, twice: Bools) -> tuple[Ints, Ints]:
    """Part a sheet where more than two of its faces meet at an edge.

    Two vertices joined through a face of the grid that the level crosses four times have
    two edges between them. The faces round one end of it form two fans; one of these gets
    a vertex of its own, at the same place.

    Args:
        faces: Vertex indices, shape (m, 3).
        twice: True for vertices that may end such an edge, shape (n,).

    Returns:
        The faces, and for each vertex that is added (number n and up) the one it copies.
    """
    marked = twice[faces]
    if not (marked.sum(1) >= 2).any():
        return faces, np.zeros(0, np.int64)
    faces = faces.copy()
    near = np.flatnonzero(marked.any(1))
    about = faces[near]
    edges = np.sort(directed_edges(about), axis=1)
    edges, uses = np.unique(edges[twice[edges].all(1)], axis=0, return_counts=True)
    copied: list[int] = []
    for a, b in edges[uses > 2].tolist():
        for v, w in ((a, b), (b, a)):
            fan = _second_fan(about, v, w)
            if len(fan):
                about[fan] = np.where(about[fan] == v, len(twice) + len(copied), about[fan])
                copied.append(v)
                break
    faces[near] = about
    return faces, np.array(copied, np.int64)


def fans_parted(faces: Ints, beside: Bools) -> tuple[Ints, Ints]:
    """Part a sheet where two fans of its faces have but a vertex in common.

    Where faces have been left out, what stays may hang together at one vertex. Each fan but
    the first gets a vertex of its own, at the same place.

    Args:
        faces: Vertex indices, shape (m, 3).
        beside: True for vertices that may be such, shape (n,).

    Returns:
        The faces, and for each vertex that is added (number n and up) the one it copies.
    """
    apart = np.array(faces, np.int64, order="C")
    copied: Ints = kernels.part_fans(apart, beside.view(np.uint8), len(beside))
    return apart, copied


def _second_fan(faces: Ints, v: int, w: int) -> Ints:
    """List the faces round v that hang together with the last face at the edge v w.

    Not through that edge; none where that are all of them.
    """
    round_v = np.flatnonzero((faces == v).any(1))
    ring = faces[round_v]
    at_edge = (ring == w).any(1)
    if at_edge.sum() <= 2:
        return np.zeros(0, np.int64)
    # The edge v w and v itself join nothing: each face has corners of its own there.
    apart = np.where((ring == v) | (ring == w), -1, ring)
    names, numbers = np.unique(apart, return_inverse=True)
    own = len(names) + np.arange(ring.size).reshape(ring.shape)
    numbers = np.where(apart < 0, own, numbers.reshape(ring.shape))
    fan_of, _ = connected_pieces(len(names) + ring.size, numbers)
    second = fan_of == fan_of[np.flatnonzero(at_edge)[-1]]
    return np.zeros(0, np.int64) if second[at_edge].all() else round_v[second]
