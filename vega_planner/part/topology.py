# SPDX-License-Identifier: Apache-2.0
"""How the triangles of a mesh hang together: edges, pairs, connected pieces.

Everything is sorting of integer keys, so that the answer depends on the mesh alone.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from vega_planner.datatypes import Bools, Floats, Ints
from vega_planner.part.surface_kernels import components


@dataclass(frozen=True)
class EdgeCensus:
    """What stands between a mesh and a closed, oriented surface.

    Attributes:
        open: Number of edges with one face.
        crowded: Number of edges with three faces or more.
        opposed: Number of edges whose two faces run through it in the same direction.
    """

    open: int
    crowded: int
    opposed: int

    @property
    def is_closed(self) -> bool:
        """Every edge has two faces that run through it in opposite directions."""
        return not (self.open or self.crowded or self.opposed)


def directed_edges(faces: Ints) -> Ints:
    """List the edges of each face in its own direction.

    Args:
        faces: Vertex indices, shape (m, 3).

    Returns:
        Start and end vertex, shape (3 m, 2); edge e belongs to face e // 3.
    """
    return np.stack([faces, np.roll(faces, -1, axis=1)], axis=2).reshape(-1, 2)


def _edge_keys(faces: Ints) -> tuple[Ints, Bools]:
    """Number the undirected edge of each directed edge, and tell if it runs downwards."""
    count = int(faces.max()) + 1 if len(faces) else 1
    start, end = faces.reshape(-1), np.roll(faces, -1, axis=1).reshape(-1)
    return np.minimum(start, end) * count + np.maximum(start, end), start > end


def is_closed_surface(faces: Ints) -> bool:
    """Tell whether each directed edge occurs once, and once in the other direction."""
    if len(faces) == 0 or len(faces) % 2:
        return False
    keys, downwards = _edge_keys(faces)
    keys = np.sort(2 * keys + downwards)
    up, down = keys[::2], keys[1::2]
    return bool(((up & 1) == 0).all() and (down == up + 1).all() and (np.diff(up) > 0).all())


def edge_uses(faces: Ints) -> tuple[Ints, Ints, Ints]:
    """Sort the directed edges so that the uses of one undirected edge are neighbours.

    Args:
        faces: Vertex indices, shape (m, 3).

    Returns:
        The order of the directed edges, shape (3 m,); the start of each undirected
        edge in that order, shape (e,); and its number of uses, shape (e,).
    """
    keys, _ = _edge_keys(faces)
    order = np.argsort(keys, kind="stable")
    starts = np.flatnonzero(np.diff(keys[order], prepend=-1))
    return order, starts, np.diff(starts, append=len(keys))


def face_pairs(faces: Ints) -> tuple[Ints, Ints, Bools]:
    """Find the faces that meet at edges of exactly two faces.

    Args:
        faces: Vertex indices, shape (m, 3).

    Returns:
        Indices of both faces, shape (k, 2); the vertices of their edge in the direction
        of the first face, shape (k, 2); and True where the two faces run through it in
        opposite directions, as on an oriented surface, shape (k,).
    """
    order, starts, uses = edge_uses(faces)
    edges = directed_edges(faces)
    starts = starts[uses == 2]
    first, second = order[starts], order[starts + 1]
    return (
        np.stack([first // 3, second // 3], axis=1),
        edges[first],
        edges[first, 0] == edges[second, 1],
    )


def edge_census(faces: Ints) -> EdgeCensus:
    """Count what stands between a mesh and a closed, oriented surface."""
    _, _, uses = edge_uses(faces)
    _, _, agree = face_pairs(faces)
    return EdgeCensus(
        open=int((uses == 1).sum()),
        crowded=int((uses > 2).sum()),
        opposed=int((~agree).sum()),
    )


def connected_labels(count: int, pairs: Ints) -> Ints:
    """Label the connected components of an undirected graph.

    Args:
        count: Number of nodes.
        pairs: Joined nodes, shape (k, 2).

    Returns:
        For each node the smallest index of its component, shape (count,).
    """
    labels = np.arange(count)
    first, second = pairs[:, 0], pairs[:, 1]
    while True:
        a, b = labels[first], labels[second]
        apart = a != b
        if not apart.any():
            break
        first, second, a, b = first[apart], second[apart], a[apart], b[apart]
        np.minimum.at(labels, np.maximum(a, b), np.minimum(a, b))
        while True:
            further = labels[labels]
            if (further == labels).all():
                break
            labels = further
    return labels


def connected_pieces(count: int, faces: Ints) -> tuple[Ints, int]:
    """Number the connected pieces of a mesh, faces joined by a shared vertex.

    Args:
        count: Number of vertices.
        faces: Vertex indices, shape (m, 3).

    Returns:
        The piece of each face, numbered by their first faces, shape (m,); their number.
    """
    piece = np.zeros(len(faces), np.int64)
    return piece, int(components(count, np.ascontiguousarray(faces, np.int64), piece))


def body_labels(faces: Ints) -> Ints:
    """Label the pieces of a mesh that hang together at edges.

    Args:
        faces: Vertex indices, shape (m, 3).

    Returns:
        For each face the smallest face index of its piece, shape (m,).
    """
    order, starts, _ = edge_uses(faces)
    same = np.ones(len(order), dtype=bool)
    same[starts] = False
    owner = order // 3
    return connected_labels(len(faces), np.stack([owner[:-1], owner[1:]], axis=1)[same[1:]])


def enclosed_volume(vertices: Floats, faces: Ints) -> float:
    """Compute the signed volume of a closed mesh [mm³], positive when normals look out."""
    corners = vertices[faces] - vertices.mean(0) if len(vertices) else vertices[faces]
    return float(np.einsum("ij,ij->", corners[:, 0], np.cross(corners[:, 1], corners[:, 2])) / 6)


def compact(vertices: Floats, faces: Ints) -> tuple[Floats, Ints]:
    """Drop the vertices that no face uses, keeping the order of the others."""
    used = np.zeros(len(vertices), dtype=bool)
    used[faces] = True
    if used.all():
        return vertices, faces
    return vertices[used], (np.cumsum(used) - 1)[faces]
