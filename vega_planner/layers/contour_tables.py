# SPDX-License-Identifier: Apache-2.0
"""Tables of manifold dual contouring: which crossed edges of a cell share a vertex.

Corner c of a cell stands at bits (x, y, z) = (c & 1, c >> 1 & 1, c >> 2 & 1). Edge
4 a + j runs along axis a; bits of j are its offsets along axes a + 1 and a + 2.
A cell that two sheets pass through gets one vertex for each, so that every surface is
manifold (Nielson, Dual marching cubes, 2004).
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from vega_planner.datatypes import Ints


def _edges() -> list[tuple[int, int]]:
    edges = []
    for axis in range(3):
        along, first, second = 1 << axis, 1 << (axis + 1) % 3, 1 << (axis + 2) % 3
        for j in range(4):
            low = (first if j & 1 else 0) | (second if j & 2 else 0)
            edges.append((low, low | along))
    return edges


def _face_rings() -> list[list[int]]:
    rings = []
    for axis in range(3):
        first, second = 1 << (axis + 1) % 3, 1 << (axis + 2) % 3
        for base in (0, 1 << axis):
            rings.append([base, base | first, base | first | second, base | second])
    return rings


@lru_cache(maxsize=1)
def component_tables() -> tuple[Ints, Ints, Ints]:
    """Build the tables.

    Returns:
        Corners of each edge, shape (12, 2); number of vertices for each of the 256
        sets of inside corners; vertex each edge belongs to, -1 where the edge is not
        crossed, shape (256, 12).
    """
    edges = _edges()
    number = {frozenset(edge): i for i, edge in enumerate(edges)}
    rings = _face_rings()
    counts = np.zeros(256, np.int64)
    members = np.full((256, 12), -1, np.int64)
    for inside in range(256):
        parent = list(range(12))

        def root(i: int, parent: list[int] = parent) -> int:
            while parent[i] != i:
                i = parent[i]
            return i

        crossed = [(inside >> a & 1) != (inside >> b & 1) for a, b in edges]
        for ring in rings:
            around = [number[frozenset((ring[k], ring[(k + 1) % 4]))] for k in range(4)]
            hit = [edge for edge in around if crossed[edge]]
            if len(hit) == 2:
                parent[root(hit[1])] = root(hit[0])
            elif len(hit) == 4:
                # The inside corners of the face are kept apart.
                for k in range(4):
                    if inside >> ring[k] & 1:
                        parent[root(around[k])] = root(around[k - 1])
        names: dict[int, int] = {}
        for edge in range(12):
            if crossed[edge]:
                members[inside, edge] = names.setdefault(root(edge), len(names))
        counts[inside] = len(names)
    return np.array(edges), counts, members


@lru_cache(maxsize=1)
def edge_orders() -> Ints:
    """List the edges of each of the 256 cells by the vertex they belong to, (256, 12).

    Edges that are not crossed come last.
    """
    _, _, members = component_tables()
    return np.argsort(np.where(members < 0, 12, members), axis=1, kind="stable")


@lru_cache(maxsize=1)
def touching_components() -> Ints:
    """Mark, bit by bit, the vertices of the 256 cells that hold a face crossed four times.

    Where two cells with such a vertex share that face, four quads meet at one edge.
    """
    _, _, members = component_tables()
    number = {frozenset(edge): i for i, edge in enumerate(_edges())}
    marks = np.zeros(256, np.int64)
    for ring in _face_rings():
        around = [number[frozenset((ring[k], ring[(k + 1) % 4]))] for k in range(4)]
        parts = members[:, around]
        whole = (parts[:, 0] >= 0) & (parts == parts[:, :1]).all(1)
        marks[whole] |= 1 << parts[whole, 0]
    return marks
