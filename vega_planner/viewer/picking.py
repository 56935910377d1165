# SPDX-License-Identifier: Apache-2.0
"""Which face lies under the pointer."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from vega_planner.datatypes import Bools, Floats, Ints

#: How far outside a triangle, in its own coordinates, a hit still counts: a ray through
#: a shared edge must not fall between two faces.
_MARGIN = 1e-9


@dataclass(frozen=True)
class Hit:
    """Where a ray meets a mesh.

    Attributes:
        face: Index of the face.
        distance: Distance from the ray's origin.
        point: Where, in the mesh's frame.
    """

    face: int
    distance: float
    point: tuple[float, float, float]


def first_hit(
    origin: Floats, direction: Floats, vertices: Floats, faces: Ints, allowed: Bools | None = None
) -> Hit | None:
    """Find the first face a ray meets, from either side [MollerTrumbore1997]_.

    Args:
        origin: Start of the ray, shape (3,).
        direction: Its direction, any length above zero, shape (3,).
        vertices: Points, shape (n, 3).
        faces: Vertex indices, shape (m, 3).
        allowed: Faces that can be hit, shape (m,); all when absent.

    Returns:
        The nearest hit in front of the origin, or None where the ray misses.
    """
    direction = np.asarray(direction, dtype=np.float64)
    direction = direction / np.linalg.norm(direction)
    indices = np.arange(len(faces)) if allowed is None else np.flatnonzero(allowed)
    corners = vertices[faces[indices]]
    edge1 = corners[:, 1] - corners[:, 0]
    edge2 = corners[:, 2] - corners[:, 0]
    across = np.cross(direction, edge2)
    determinant = np.einsum("ij,ij->i", edge1, across)
    facing = np.abs(determinant) > 1e-14 * np.linalg.norm(edge1, axis=1) * np.linalg.norm(
        edge2, axis=1
    )
    inverse = 1.0 / np.where(facing, determinant, 1.0)
    offset = np.asarray(origin) - corners[:, 0]
    u = np.einsum("ij,ij->i", offset, across) * inverse
    turned = np.cross(offset, edge1)
    v = turned @ direction * inverse
    distance = np.einsum("ij,ij->i", edge2, turned) * inverse
    met = facing & (u >= -_MARGIN) & (v >= -_MARGIN) & (u + v <= 1 + _MARGIN) & (distance > 0)
    if not met.any():
        return None
    best = int(np.flatnonzero(met)[np.argmin(distance[met])])
    x, y, z = np.asarray(origin) + distance[best] * direction
    return Hit(int(indices[best]), float(distance[best]), (float(x), float(y), float(z)))


def ray_through_pixel(
    position: Floats,
    wxyz: Floats,
    vertical_fov: float,
    aspect: float,
    screen: tuple[float, float],
) -> tuple[Floats, Floats]:
    """Compute the ray of a point on the screen.

    Args:
        position: Position of the camera, shape (3,).
        wxyz: Its orientation: x right, y down, z forward.
        vertical_fov: Opening angle from bottom to top [rad].
        aspect: Width over height of the picture.
        screen: Horizontal and vertical place, 0 to 1 from the upper left corner.

    Returns:
        Origin and unit direction.
    """
    w, x, y, z = wxyz
    rotation = np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )
    half = np.tan(vertical_fov / 2)
    seen = np.array([(2 * screen[0] - 1) * half * aspect, (2 * screen[1] - 1) * half, 1.0])
    return np.asarray(position, dtype=np.float64), rotation @ (seen / np.linalg.norm(seen))
