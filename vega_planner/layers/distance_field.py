# SPDX-License-Identifier: Apache-2.0
"""Exact distance to the buffered surface S = ∂A \\ ∂A*, for any point."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from vega_planner.datatypes import Floats, Ints, Part
from vega_planner.errors import InvalidInput
from vega_planner.layers import tree_kernels as trees
from vega_planner.layers import triangle_kernels as triangles
from vega_planner.parallel import map_threads

#: Points answered by one piece of work, at most and where there are few.
_CHUNK, _FEW = 256, 32

#: Subtrees that threads sort, and leaves from which on that pays.
_SUBTREES, _MANY = 8, 1024

#: Cells along each axis, at most, that tell which faces come near to points.
_CELLS = 64


@dataclass(frozen=True, eq=False)
class NearestPoints:
    """Answer of a nearest-point query.

    Attributes:
        distances: Distance of each point to the surface [mm], shape (n,).
        points: Nearest point of the surface [mm], shape (n, 3).
        faces: The face it lies on, an index into the faces of the field, shape (n,).
    """

    distances: Floats
    points: Floats
    faces: Ints


class DistanceField:
    """Nearest points on a set of triangles, exact to rounding.

    A balanced tree of boxes over the triangles. The object is built once and answers
    any number of queries; it changes nothing when it does.

    Attributes:
        faces: Index, in the mesh it was built from, of each triangle in tree order.
    """

    def __init__(self, vertices: Floats, faces: Ints) -> None:
        """Build the tree.

        Args:
            vertices: Points [mm], shape (n, 3).
            faces: Vertex indices, shape (m, 3), m >= 1.

        Raises:
            InvalidInput: If there are no faces.
        """
        if len(faces) == 0:
            raise InvalidInput("a distance field needs at least one face")
        vertices = np.ascontiguousarray(vertices, np.float64)
        faces = np.ascontiguousarray(faces, np.int64)
        leaves = 1
        while leaves * trees.LEAF < len(faces):
            leaves *= 2
        self.faces: Ints = _sorted(trees.triangle_middles(vertices, faces), leaves)
        self.tri, self.box = _bounded(vertices, faces, self.faces, leaves)
        self._vertices = vertices
        self._mesh_faces = faces
        self._rings: tuple[Ints, Ints, Ints] | None = None

    @classmethod
    def of_part(cls, part: Part) -> DistanceField:
        """Build the field of distances to the faces of a part that are buffered (S)."""
        return cls(part.vertices, part.faces[~part.restrained])

    @property
    def rings(self) -> tuple[Ints, Ints, Ints]:
        """Corners of each triangle, and the triangles round each vertex, in tree order."""
        if self._rings is None:
            self._rings = triangles.rings(self._mesh_faces, self.faces, len(self._vertices))
        return self._rings

    def nearest(self, points: Floats, reach: Floats | None = None) -> NearestPoints:
        """Find the nearest point of the surface for each point.

        Args:
            points: Points [mm], shape (n, 3).
            reach: Distance of each from which on nothing is wanted [mm], shape (n,).

        Returns:
            Distances, nearest points and faces; an infinite distance, and face -1, where
            nothing is within reach.
        """
        points = np.ascontiguousarray(points, np.float64)
        count = len(points)
        reach = np.full(count, np.inf) if reach is None else np.ascontiguousarray(reach)
        slot = np.zeros(count, np.int64)
        distance = np.zeros(count)
        foot = np.zeros((count, 3))
        # Few points are shared out, too: deep inside, each of them takes long.
        chunk = min(_CHUNK, max(count // 4, _FEW))

        def answer(first: int) -> None:
            last = min(first + chunk, count)
            trees.nearest_many(
                self.tri, self.box, points, reach, first, last, slot, distance, foot
            )

        map_threads(answer, range(0, count, chunk))
        return NearestPoints(distance, foot, np.where(slot >= 0, self.faces[slot], -1))

    def distances(self, points: Floats) -> Floats:
        """Measure the distance of each point to the surface [mm], shape (n,)."""
        return self.nearest(points).distances

    def normals(self, faces: Ints) -> Floats:
        """Unit normals of faces, shape (n, 3)."""
        corners = self._vertices[self._mesh_faces[faces]]
        cross = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        length = np.linalg.norm(cross, axis=1, keepdims=True)
        return cross / np.where(length > 0, length, 1.0)

    def slots(self, faces: Ints) -> Ints:
        """Places of faces in the order of the tree, that of the rows of `tri`, shape (n,)."""
        places = np.zeros(len(self.faces), np.int64)
        places[self.faces] = np.arange(len(self.faces))
        return places[faces]

    def first_hits(self, starts: Floats, ends: Floats) -> tuple[Ints, Floats]:
        """Find where segments first meet the surface.

        Args:
            starts: First ends [mm], shape (n, 3).
            ends: Other ends [mm], shape (n, 3).

        Returns:
            Face met, -1 where none, and the parameter from 0 to 1 along the segment.
        """
        starts = np.ascontiguousarray(starts, np.float64)
        ends = np.ascontiguousarray(ends, np.float64)
        count = len(starts)
        slot = np.zeros(count, np.int64)
        parameter = np.zeros(count)

        def answer(first: int) -> None:
            last = min(first + _CHUNK, count)
            trees.first_hit_many(self.tri, self.box, starts, ends, first, last, slot, parameter)

        map_threads(answer, range(0, count, _CHUNK))
        return np.where(slot >= 0, self.faces[slot], -1), parameter


def distances_within(vertices: Floats, faces: Ints, points: Floats, reach: float) -> Floats:
    """Measure the distance of a few points to a mesh, as far as it matters.

    Args:
        vertices: Points of the mesh [mm], shape (n, 3).
        faces: Its vertex indices, shape (m, 3).
        points: Points that are asked about [mm], shape (k, 3).
        reach: Distance from which on it does not matter [mm].

    Returns:
        The distances [mm], infinite from `reach` on, shape (k,).
    """
    found = np.full(len(points), np.inf)
    if len(points) == 0 or len(faces) == 0:
        return found
    points = np.ascontiguousarray(points, np.float64)
    faces = np.ascontiguousarray(faces, np.int64)
    low, high = points.min(0) - 1.01 * reach, points.max(0) + 1.01 * reach
    size = max(2 * reach, float((high - low).max()) / _CELLS)
    cells = np.zeros(((high - low) / size).astype(np.int64) + 1, np.uint8)
    trees.mark_cells(points, reach, low, size, cells)
    near = np.zeros(len(faces), bool)
    trees.mark_faces(vertices, faces, low, size, cells, near)
    if near.any():
        near_field = DistanceField(vertices, faces[near])
        found = near_field.nearest(points, np.full(len(points), reach)).distances
    return found


def _subtree(leaves: int) -> int:
    """Leaves of the subtrees that threads work on; all of them where there are few."""
    return leaves // _SUBTREES if leaves >= _MANY else leaves


def _sorted(middles: Floats, leaves: int) -> Ints:
    """Order triangles so that each leaf of the tree holds neighbours; shuffles the middles."""
    order = np.arange(len(middles))
    subtree = _subtree(leaves)
    trees.sort_leaves(middles, order, leaves, 0, leaves, subtree)
    map_threads(
        lambda first: trees.sort_leaves(middles, order, leaves, first, first + subtree, 1),
        range(0, leaves, subtree),
    )
    return order


def _bounded(vertices: Floats, faces: Ints, order: Ints, leaves: int) -> tuple[Floats, Floats]:
    """Lay out the rows of the triangles, and bound them box by box."""
    count, subtree = len(order), _subtree(leaves)
    tri, box = np.zeros((count, 16)), np.zeros((2 * leaves - 1, 11))

    def bound(first: int) -> None:
        last = first + subtree
        rows = first * count // leaves, last * count // leaves
        triangles.lay_rows(vertices, faces, order, *rows, tri)
        trees.bound_boxes(tri, leaves, subtree, 1, first, last, box)

    map_threads(bound, range(0, leaves, subtree))
    trees.bound_boxes(tri, leaves, leaves, 2 * subtree, 0, leaves, box)
    return tri, box
