# SPDX-License-Identifier: Apache-2.0
"""Crossing to manifold3d and back, with every bad status turned into an error.

manifold3d reports failure by a status and an empty solid; nothing of that passes here.
"""

from __future__ import annotations

from dataclasses import dataclass

import manifold3d
import numpy as np

from vega_planner.datatypes import Bools, Floats, Ints
from vega_planner.errors import BadMesh


@dataclass(frozen=True)
class TaggedSolid:
    """A solid whose faces remember, through booleans, whether they were restrained.

    Attributes:
        solid: The manifold3d solid.
        restrained_id: Original id that marks faces of the restraint region.
    """

    solid: manifold3d.Manifold
    restrained_id: int


def checked(solid: manifold3d.Manifold, doing: str) -> manifold3d.Manifold:
    """Pass a solid on if it is valid.

    Args:
        solid: Result of a manifold3d operation; it is evaluated here.
        doing: What was done, for the error text.

    Raises:
        BadMesh: If the status says that the operation failed.
    """
    status = solid.status()
    if status != manifold3d.Error.NoError:
        raise BadMesh(f"{doing} failed: manifold3d reports {status.name}")
    return solid


def to_solid(
    vertices: Floats, faces: Ints, doing: str = "taking in a mesh"
) -> manifold3d.Manifold:
    """Make a manifold3d solid of a closed, oriented mesh.

    Raises:
        BadMesh: If the mesh is not closed and oriented.
    """
    mesh = manifold3d.Mesh64(
        np.array(vertices, dtype=np.float64, order="C"),
        np.array(faces, dtype=np.uint64, order="C"),
    )
    return checked(manifold3d.Manifold(mesh), doing)


def to_tagged_solid(vertices: Floats, faces: Ints, restrained: Bools) -> TaggedSolid:
    """Make a solid that keeps track of its restrained faces.

    Args:
        vertices: Points [mm], shape (n, 3).
        faces: Vertex indices of a closed, oriented mesh, shape (m, 3).
        restrained: True for the faces to keep track of, shape (m,).

    Raises:
        BadMesh: If the mesh is not closed and oriented.
    """
    free_id = manifold3d.Manifold.reserve_ids(2)
    restrained_id = free_id + 1
    order = np.argsort(restrained, kind="stable")
    free = int((~restrained).sum())
    ends = [(3 * free, free_id), (3 * len(faces), restrained_id)]
    runs = [(end, name) for end, name in ends if end > 0]
    if free == len(faces):
        runs = runs[:1]
    mesh = manifold3d.Mesh64(
        np.array(vertices, dtype=np.float64, order="C"),
        np.array(faces[order], dtype=np.uint64, order="C"),
        run_index=np.array([0] + [end for end, _ in runs], dtype=np.uint64),
        run_original_id=np.array([name for _, name in runs], dtype=np.uint32),
    )
    return TaggedSolid(checked(manifold3d.Manifold(mesh), "taking in a mesh"), restrained_id)


def from_solid(
    solid: manifold3d.Manifold, restrained_id: int | None = None
) -> tuple[Floats, Ints, Bools]:
    """Read a solid back.

    Args:
        solid: A valid solid.
        restrained_id: Original id of the restrained faces, from `TaggedSolid`.

    Returns:
        Vertices [mm], shape (n, 3); faces, shape (m, 3); and True for the faces that
        stem from restrained ones, shape (m,).
    """
    mesh = solid.to_mesh64()
    vertices = np.array(mesh.vert_properties, dtype=np.float64)[:, :3]
    faces = np.array(mesh.tri_verts).astype(np.int64)
    merge_from = np.array(mesh.merge_from_vert).astype(np.int64)
    if len(merge_from):
        target = np.arange(len(vertices))
        target[merge_from] = np.array(mesh.merge_to_vert).astype(np.int64)
        faces = target[faces]
    runs = np.array(mesh.run_index).astype(np.int64) // 3
    restrained = np.zeros(len(faces), dtype=bool)
    for start, end, name in zip(runs[:-1], runs[1:], mesh.run_original_id):
        if name == restrained_id:
            restrained[start:end] = True
    return vertices, faces, restrained
