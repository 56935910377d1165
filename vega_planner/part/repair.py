# SPDX-License-Identifier: Apache-2.0
"""The repair ladder: from whatever a file holds to a solid."""

from __future__ import annotations

from vega_planner.datatypes import Floats, Ints
from vega_planner.errors import BadMesh
from vega_planner.part.topology import edge_census, enclosed_volume, is_closed_surface
from vega_planner.part.weld import weld_equal
from vega_planner.progress import Report, silent


def make_solid(
    vertices: Floats, faces: Ints, report: Report = silent
) -> tuple[Floats, Ints, list[str]]:
    """Weld a mesh and make it closed and outward.

    Args:
        vertices: Points [mm], shape (n, 3).
        faces: Vertex indices, shape (m, 3).
        report: Receives progress; may raise `Cancelled`.

    Returns:
        Vertices and faces of the solid, and what was done.

    Raises:
        BadMesh: If no solid can be made of it.
    """
    remarks: list[str] = []
    vertices, faces = weld_equal(vertices, faces)
    if not is_closed_surface(faces):
        census = edge_census(faces)
        raise BadMesh(f"not closed: {census}")
    volume = enclosed_volume(vertices, faces)
    if volume < 0:
        faces = faces[:, ::-1]
        remarks.append("the mesh was inside out: all faces were turned")
    return vertices, faces, remarks
