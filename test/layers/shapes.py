# SPDX-License-Identifier: Apache-2.0
"""Parts made of arrays, whose layers are known in closed form."""

from __future__ import annotations

import manifold3d
import numpy as np

from vega_planner.datatypes import Part

Solid = manifold3d.Manifold


def part_of(solid: Solid, restrain=None, name: str = "part", stand: bool = True) -> Part:
    """Turn a solid into a part; `restrain(normals, centres)` tells the restrained faces."""
    mesh = solid.to_mesh64()
    vertices = np.array(np.asarray(mesh.vert_properties)[:, :3])
    faces = np.array(np.asarray(mesh.tri_verts), np.int64)
    if stand:
        vertices[:, 2] -= vertices[:, 2].min()
    corners = vertices[faces]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-30)
    restrained = np.zeros(len(faces), bool)
    if restrain is not None:
        restrained = restrain(normals, corners.mean(1))
    return Part(name, vertices, faces, restrained)


def base(normals, centres):
    return (normals[:, 2] < -0.99) & (centres[:, 2] < 1e-6)


def box(length: float, width: float, height: float, restrain=base) -> Part:
    return part_of(Solid.cube((length, width, height)), restrain, "box")


def box_from_above(length: float, width: float, height: float) -> Part:
    return box(length, width, height, lambda n, c: n[:, 2] < 0.5)


def sphere(radius: float, segments: int = 64) -> Part:
    return part_of(Solid.sphere(radius, segments), None, "sphere")


def dome(radius: float, segments: int = 64) -> Part:
    return part_of(Solid.sphere(radius, segments).trim_by_plane((0, 0, 1), 0.0), base, "dome")


def slotted(gap: float) -> Part:
    """A block with a slot from above, buffered on one outer side only."""
    solid = Solid.cube((10, 24, 20)) - Solid.cube((12, gap, 20)).translate((-1, 12 - gap / 2, 6))
    return part_of(solid, lambda n, c: ~((np.abs(c[:, 1]) < 1e-6) & (n[:, 1] < -0.5)), "slotted")
