# SPDX-License-Identifier: Apache-2.0
"""Binary STL files, for printers that read nothing else."""

from __future__ import annotations

import numpy as np

from vega_planner.datatypes import TriangleGeometry


def mesh_stl(mesh: TriangleGeometry) -> bytes:
    """Encode a triangle mesh as binary STL.

    Args:
        mesh: Vertices [mm] and faces.
    """
    rows = np.zeros(len(mesh.faces), [("n", "<f4", (3,)), ("p", "<f4", (3, 3)), ("a", "<u2")])
    rows["n"], rows["p"] = mesh.face_normals, mesh.vertices[mesh.faces]
    head = b"millimetres, part frame".ljust(80)
    return head + np.uint32(len(rows)).astype("<u4").tobytes() + rows.tobytes()
