# SPDX-License-Identifier: Apache-2.0
"""Smooth regions: faces joined across edges that bend by less than an angle."""

from __future__ import annotations

import numpy as np

from vega_planner.datatypes import Bools, Floats, Ints, TriangleGeometry
from vega_planner.part.topology import connected_labels, face_pairs


def smooth_pairs(mesh: TriangleGeometry, angle_deg: float) -> Ints:
    """List the neighbouring faces whose normals differ by at most an angle.

    A face without area has no normal and joins its neighbours.

    Args:
        mesh: Closed, oriented mesh.
        angle_deg: Largest angle between neighbours [deg].

    Returns:
        Pairs of face indices, shape (k, 2).
    """
    pairs, _, _ = face_pairs(mesh.faces)
    first, second = mesh.face_normals[pairs[:, 0]], mesh.face_normals[pairs[:, 1]]
    bend = np.einsum("ij,ij->i", first, second)
    flat = mesh.face_areas <= 0
    flat = flat[pairs[:, 0]] | flat[pairs[:, 1]]
    return pairs[(bend >= np.cos(np.radians(angle_deg)) - 1e-9) | flat]


def smooth_regions(mesh: TriangleGeometry, angle_deg: float) -> Ints:
    """Label each face with the smallest face index of its smooth region, shape (m,)."""
    return connected_labels(len(mesh.faces), smooth_pairs(mesh, angle_deg))


def grow_region(mesh: TriangleGeometry, seeds: Bools, allowed: Bools, angle_deg: float) -> Bools:
    """Grow a region from seed faces, smoothly and over allowed faces only.

    Args:
        mesh: Closed, oriented mesh.
        seeds: Faces to start from, shape (m,).
        allowed: Faces that may be taken, shape (m,).
        angle_deg: Largest angle between neighbouring faces [deg].

    Returns:
        Seeds that are allowed, and what they reach, shape (m,).
    """
    pairs = smooth_pairs(mesh, angle_deg)
    labels = connected_labels(len(mesh.faces), pairs[allowed[pairs].all(1)])
    return np.isin(labels, labels[seeds & allowed]) & allowed


def squared_distances(points: Floats, vertices: Floats, faces: Ints) -> Floats:
    """Compute the squared distance from one point to every triangle [mm²].

    The closest point of a triangle lies on an edge unless the point's projection falls
    inside it [Ericson2005]_; both are computed for all triangles at once.

    Args:
        points: One point [mm], shape (3,).
        vertices: Points [mm], shape (n, 3).
        faces: Vertex indices, shape (m, 3).

    Returns:
        Squared distances, shape (m,).
    """
    corners = vertices[faces] - points  # (m, 3, 3), the point at the origin
    along = np.roll(corners, -1, axis=1) - corners
    length2 = np.maximum(np.einsum("mij,mij->mi", along, along), 1e-300)
    share = np.clip(-np.einsum("mij,mij->mi", corners, along) / length2, 0.0, 1.0)
    nearest = corners + share[..., None] * along
    best = np.einsum("mij,mij->mi", nearest, nearest).min(1)
    normal = np.cross(along[:, 0], along[:, 1])
    area2 = np.maximum(np.einsum("mi,mi->m", normal, normal), 1e-300)
    sides = np.einsum("mij,mij->mi", np.cross(corners, along), normal[:, None, :])
    height2 = np.einsum("mi,mi->m", corners[:, 0], normal) ** 2 / area2
    inside = (sides > 0).all(1)
    return np.where(inside, np.minimum(best, height2), best)
