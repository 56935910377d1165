# SPDX-License-Identifier: Apache-2.0
"""The separating surface between two regions of a sheet, from a noisy border.

The paper regresses a separating surface through the border's points. As a height field
over a plane that fails where the border runs along a steep wall, so the surface is held
implicitly: s(x) is the regressed signed distance to the border, and {s = 0} separates.
"""

from __future__ import annotations

import numpy as np

from vega_planner.datatypes import Bools, Floats, Ints, TriangleGeometry

#: Half width of the band round the border the regression sees: in mm, and in edges.
BAND_MM, BAND_EDGES = 6.0, 5.0

#: Distance from the border within which the regression replaces the labels: a border may
#: move by no more.
CLOSE_MM, CLOSE_EDGES = 2.0, 2.5

#: Value of the field beyond the band.
FAR_MM = 10.0


def border_points(mesh: TriangleGeometry, neighbours: Ints, positive: Bools) -> Floats:
    """Find the middles of the edges between the two regions [mm], shape (k, 3)."""
    across = neighbours
    differ = (across >= 0) & (positive[:, None] != positive[np.maximum(across, 0)])
    face, edge = np.nonzero(differ & positive[:, None])
    a = mesh.faces[face, edge]
    b = mesh.faces[face, (edge + 1) % 3]
    return 0.5 * (mesh.vertices[a] + mesh.vertices[b])


def separating_field(
    mesh: TriangleGeometry, neighbours: Ints, positive: Bools
) -> tuple[Floats, Floats]:
    """Regress the signed distance to the border of two regions.

    Args:
        mesh: The sheet.
        neighbours: From `neighbours_of`.
        positive: True for the faces of the region with positive values, shape (m,).

    Returns:
        The field at the vertices [mm], positive inside the region, and its standard
        deviation [mm], both of shape (n,).
    """
    points = border_points(mesh, neighbours, positive)
    weight = np.where(positive, 1.0, -1.0) * mesh.face_areas
    sign = np.sign(
        np.bincount(mesh.faces.ravel(), weights=np.repeat(weight, 3), minlength=len(mesh.vertices))
    )
    sign[sign == 0] = 1.0
    field = sign * FAR_MM
    deviation = np.zeros(len(field))
    if not len(points):
        return field, deviation
    edge_mm = float(np.sqrt(2.3 * mesh.area / max(len(mesh.faces), 1)))
    band_mm = max(BAND_MM, BAND_EDGES * edge_mm)
    from scipy.spatial import cKDTree

    from vega_planner.splitting.gaussian_process import GaussianProcess

    distance, _ = cKDTree(points).query(mesh.vertices, distance_upper_bound=band_mm)
    band = np.flatnonzero(np.isfinite(distance))
    target = sign[band] * np.minimum(distance[band], 0.5 * band_mm)
    size = float(np.ptp(points, axis=0).max())
    lengths = np.geomspace(max(4.0, 2 * edge_mm), max(60.0, 0.5 * size), 5)
    process = GaussianProcess(mesh.vertices[band], target, lengths)
    close = band[distance[band] < max(CLOSE_MM, CLOSE_EDGES * edge_mm)]
    field[close] = process.mean(mesh.vertices[close])
    close = close[np.abs(field[close]) < edge_mm]
    deviation[close] = process.deviation(mesh.vertices[close])
    return field, deviation
