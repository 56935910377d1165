# SPDX-License-Identifier: Apache-2.0
"""What a part stands on."""

from __future__ import annotations

import numpy as np

from vega_planner.datatypes import Bools, TriangleGeometry
from vega_planner.part.regions import grow_region
from vega_planner.settings import PartSettings

#: Faces whose corners are all this near z = 0 [mm] rest on the plate: a tenth of a
#: common dispensing standoff, above the noise of meshes stored in single precision.
RESTING_MM = 0.02
#: How far a resting face may lean [deg]; long thin slivers of flat bases do.
RESTING_ANGLE_DEG = 5.0
#: A smaller rest, as a share of the footprint's box, is a point and not a base.
SMALLEST_REST_SHARE = 0.005


def footprint_mm2(mesh: TriangleGeometry) -> float:
    """Area of the bounding box seen from above [mm²]."""
    return float(np.prod(np.ptp(mesh.vertices[:, :2], axis=0)))


def resting_faces(mesh: TriangleGeometry) -> Bools:
    """Find the flat faces that lie on z = 0 and look down, shape (m,)."""
    a, b, c = (mesh.vertices[mesh.faces[:, k], 2] for k in range(3))
    top = np.maximum(np.maximum(a, b), c)
    down = -mesh.face_normals[:, 2] >= np.cos(np.radians(RESTING_ANGLE_DEG))
    resting = (top <= RESTING_MM) & down
    if mesh.face_areas[resting].sum() < SMALLEST_REST_SHARE * footprint_mm2(mesh):
        return np.zeros(len(mesh.faces), dtype=bool)
    return resting


def standing_faces(mesh: TriangleGeometry, settings: PartSettings) -> Bools:
    """Find what the part stands on.

    That is its flat faces on z = 0; where it has none, the smooth region round its
    lowest points as far as it looks down within θ_edge.

    Args:
        mesh: Closed, oriented mesh placed on z = 0.
        settings: For θ_edge and the angle of smooth regions.

    Returns:
        True for the faces, shape (m,); none when the part stands on a sharp edge.
    """
    resting = resting_faces(mesh)
    if resting.any():
        return resting
    lowest = mesh.vertices[mesh.faces][:, :, 2].min(1) <= RESTING_MM
    allowed = -mesh.face_normals[:, 2] >= np.cos(np.radians(settings.edge_angle_deg))
    return grow_region(mesh, lowest, allowed, max(settings.smooth_angle_deg, 1e-3))
