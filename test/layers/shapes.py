# SPDX-License-Identifier: Apache-2.0
"""Parts made of arrays, whose layers are known in closed form."""

from __future__ import annotations

import numpy as np
import trimesh

from vega_planner.datatypes import Part


def part_of(mesh: trimesh.Trimesh, restrained: np.ndarray | None = None, name: str = "x") -> Part:
    if restrained is None:
        restrained = np.zeros(len(mesh.faces), bool)
    vertices = np.array(mesh.vertices)
    vertices[:, 2] -= vertices[:, 2].min()
    return Part(name, vertices, np.array(mesh.faces), restrained)


def box(length: float, width: float, height: float, source: str = "all") -> Part:
    """A box; `source` says which faces are buffered: all, top, or all but the bottom."""
    mesh = trimesh.creation.box((length, width, height))
    up = mesh.face_normals[:, 2]
    restrained = {
        "all": np.zeros(len(up), bool),
        "top": up < 0.5,
        "open": up < -0.5,
    }[source]
    return part_of(mesh, restrained, f"box_{source}")


def sphere(radius: float, subdivisions: int = 4) -> Part:
    return part_of(trimesh.creation.icosphere(subdivisions, radius), name="sphere")


def dome(radius: float, segments: int = 64) -> Part:
    """Half a sphere on its flat side, which is restrained."""
    import manifold3d

    solid = manifold3d.Manifold.sphere(radius, segments).trim_by_plane((0, 0, 1), 0.0)
    mesh = solid.to_mesh64()
    mesh = trimesh.Trimesh(
        np.asarray(mesh.vert_properties)[:, :3], np.asarray(mesh.tri_verts), process=False
    )
    flat = (mesh.face_normals[:, 2] < -0.999) & (mesh.triangles_center[:, 2] < 1e-6)
    return part_of(mesh, flat, "dome")
