# SPDX-License-Identifier: Apache-2.0
"""Signed distance to a triangle mesh, with the closest point and what it lies on."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from vega_planner.assess import closest_kernels as kernels
from vega_planner.datatypes import Bools, Floats, Ints, face_cross
from vega_planner.errors import InvalidInput
from vega_planner.parallel import map_threads

#: Points handed to a thread at once.
_CHUNK = 16384


@dataclass(frozen=True, eq=False)
class ClosestPoints:
    """Answer of a closest-point query for n points.

    Attributes:
        signed: Distances [mm], below zero inside, shape (n,).
        feet: Closest points [mm], shape (n, 3).
        faces: Triangles they lie on, shape (n,).
        features: 0 inside the triangle; 1 to 3 on the edge from corner 0, 1, 2 to the
            next; 4 to 6 at corner 0, 1, 2. Shape (n,).
    """

    signed: Floats
    feet: Floats
    faces: Ints
    features: Ints


class SurfaceDistance:
    """Closest-point queries on one mesh.

    The sign is that of the angle-weighted normal of the closest feature, which is right
    on closed, consistently oriented meshes and the best there is on open ones.

    Args:
        vertices: Points [mm], shape (n, 3).
        faces: Vertex indices, shape (m, 3), m > 0.

    Source:
        Bærentzen, Aanæs: Signed distance computation using the angle weighted
        pseudonormal, IEEE TVCG 11(3), 2005.
    """

    def __init__(self, vertices: Floats, faces: Ints) -> None:
        if len(faces) == 0:
            raise InvalidInput("a mesh without faces has no distance")
        self.vertices = np.ascontiguousarray(vertices, np.float64)
        self.faces = np.ascontiguousarray(faces, np.int64)
        self.corners = np.ascontiguousarray(self.vertices[self.faces])
        centres = self.corners.mean(1)
        low = centres.min(0)
        extent = max(float((centres.max(0) - low).max()), 1e-9)
        codes = kernels.morton_codes(centres, low, 1023.9 / extent)
        self.order = np.argsort(codes, kind="stable")
        leaves = 1
        while leaves * kernels.LEAF < len(faces):
            leaves *= 2
        self.first_leaf = leaves - 1
        self.boxes = kernels.build_boxes(self.corners, self.order, self.first_leaf)

    @cached_property
    def edge_ids(self) -> Ints:
        """Undirected edge of each face side (corner k to the next), shape (m, 3)."""
        sides = np.stack([self.faces, np.roll(self.faces, -1, axis=1)], axis=-1)
        keys = sides.min(-1) * len(self.vertices) + sides.max(-1)
        return np.unique(keys, return_inverse=True)[1].reshape(-1, 3)

    @cached_property
    def normals(self) -> Floats:
        """Normals of the features of each face, not of unit length, shape (m, 7, 3)."""
        cross = face_cross(self.vertices, self.faces)
        lengths = np.linalg.norm(cross, axis=1, keepdims=True)
        unit = cross / np.where(lengths > 0, lengths, 1.0)
        edges = np.zeros((int(self.edge_ids.max()) + 1, 3))
        corners = np.zeros_like(self.vertices)
        for k in range(3):
            out = self.corners[:, (k + 1) % 3] - self.corners[:, k]
            back = self.corners[:, (k + 2) % 3] - self.corners[:, k]
            angle = np.arctan2(
                np.linalg.norm(np.cross(out, back), axis=1), np.einsum("ij,ij->i", out, back)
            )
            np.add.at(edges, self.edge_ids[:, k], unit)
            np.add.at(corners, self.faces[:, k], unit * angle[:, None])
        return np.concatenate([unit[:, None], edges[self.edge_ids], corners[self.faces]], axis=1)

    def query(
        self, points: Floats, signed: bool = True, bound_mm: float = np.inf
    ) -> ClosestPoints:
        """Find the closest point of the mesh for each point.

        Args:
            points: Points [mm], shape (n, 3).
            signed: Whether the distances get their sign.
            bound_mm: Distance beyond which nothing is looked for; such points get it as
                their distance, and themselves as the closest point.
        """
        points = np.ascontiguousarray(points, np.float64)
        count = len(points)
        distances, feet = np.empty(count), np.empty((count, 3))
        faces, features = np.empty(count, np.int64), np.empty(count, np.int64)
        normals = self.normals if signed else np.zeros((0, 7, 3))

        def work(start: int) -> None:
            part = slice(start, start + _CHUNK)
            kernels.closest_many(
                self.corners,
                self.order,
                self.boxes,
                self.first_leaf,
                normals,
                points[part],
                bound_mm,
                distances[part],
                feet[part],
                faces[part],
                features[part],
            )

        map_threads(work, range(0, count, _CHUNK))
        return ClosestPoints(distances, feet, faces, features)

    def touching(self, marked: Bools) -> Bools:
        """Tell which features touch a marked face.

        Args:
            marked: True for marked faces, shape (m,).

        Returns:
            By face and feature, as `ClosestPoints` numbers them, shape (m, 7).
        """
        edges = np.zeros(int(self.edge_ids.max()) + 1, bool)
        edges[self.edge_ids[marked].ravel()] = True
        corners = np.zeros(len(self.vertices), bool)
        corners[self.faces[marked].ravel()] = True
        return np.concatenate([marked[:, None], edges[self.edge_ids], corners[self.faces]], axis=1)
