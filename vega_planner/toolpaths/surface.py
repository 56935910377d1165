# SPDX-License-Identifier: Apache-2.0
"""A patch with its connectivity, ready for distance fields and isolines."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from vega_planner.datatypes import Bools, Floats, Ints, Patch
from vega_planner.part.surface_kernels import label_components, unique_edges, vertex_stars


@dataclass(frozen=True, eq=False)
class Surface:
    """The mesh of a patch and who is next to whom.

    Attributes:
        vertices: Points [mm], shape (n, 3).
        faces: Vertex indices, shape (m, 3).
        offsets: Start of each vertex's star in `star`, shape (n + 1,).
        star: Faces around the vertices.
        edges: Vertex indices, shape (e, 2); a rim edge runs as its face does.
        face_edges: Edges of the faces, shape (m, 3).
        edge_faces: Faces of the edges, shape (e, 2), the second -1 at the rim.
        component: Connected piece of each vertex, shape (n,).
        component_count: Number of pieces.
    """

    vertices: Floats
    faces: Ints
    offsets: Ints
    star: Ints
    edges: Ints
    face_edges: Ints
    edge_faces: Ints
    component: Ints
    component_count: int

    @property
    def rim_edges(self) -> Ints:
        """Edges with one face only, along the face's direction, shape (r, 2)."""
        return self.edges[self.edge_faces[:, 1] < 0]

    @property
    def on_rim(self) -> Bools:
        """True for the vertices of the rim, shape (n,)."""
        mask = np.zeros(len(self.vertices), np.bool_)
        mask[self.rim_edges.ravel()] = True
        return mask


def connect(patch: Patch) -> Surface:
    """Find the connectivity of a patch.

    Args:
        patch: The patch; several pieces and any number of rims are fine.
    """
    vertices = np.array(patch.vertices)
    faces = np.array(patch.faces)
    offsets, star = vertex_stars(faces, len(vertices))
    edges, face_edges, edge_faces = unique_edges(faces, offsets, star)
    component, count = label_components(edges, np.zeros(len(vertices), np.int64), len(vertices))
    return Surface(
        vertices, faces, offsets, star, edges, face_edges, edge_faces, component, int(count)
    )
