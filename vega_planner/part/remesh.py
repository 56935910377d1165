# SPDX-License-Identifier: Apache-2.0
"""The last resort: a new surface round what a broken one winds round.

Winding numbers tell inside from outside wherever most of a surface is sound, through
holes, crossings and walls inside. The new surface is the zero level of the signed
distance on a grid; edges come out rounded by a fraction of its spacing.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from vega_planner.datatypes import Floats, Ints, face_cross
from vega_planner.errors import BadMesh
from vega_planner.part.solid import checked, from_solid
from vega_planner.part.tree import TriangleTree
from vega_planner.progress import Progress, Report

#: Number of grid points aimed at; a second or two of work.
GRID_POINTS = 400_000
#: Points asked between two reports.
SLICE = 8192
#: Grid spacings from the surface within which every point is asked: a coarse neighbour
#: is √3 away, and the level set looks one further.
NEAR = 4.0
#: No finer grid than this [mm]: half a bead's error is not worth more.
FINEST_MM = 0.25
#: Winding numbers between these leave open what is inside.
DOUBTFUL = (0.3, 0.7)
#: Share of doubtful volume from which the surface is refused.
MOST_DOUBT = 0.25


@dataclass(frozen=True)
class Remeshed:
    """A new closed surface and how far it lies from the old one.

    Attributes:
        vertices: Points [mm], shape (n, 3).
        faces: Vertex indices, shape (m, 3).
        spacing_mm: Spacing of the grid.
        mean_mm: Mean distance between old and new surface.
        most_mm: Largest distance between them, both ways; inner parts of the old
            surface do not count.
    """

    vertices: Floats
    faces: Ints
    spacing_mm: float
    mean_mm: float
    most_mm: float


def remesh(vertices: Floats, faces: Ints, report: Report) -> Remeshed:
    """Build a closed surface round what a mesh winds round.

    Args:
        vertices: Points [mm], shape (n, 3).
        faces: Vertex indices, neighbours agreeing in orientation, shape (m, 3).
        report: Receives progress; may raise `Cancelled`.

    Raises:
        BadMesh: If the mesh winds round nothing, or what it winds round is doubtful.
    """
    import manifold3d

    from vega_planner.part.kernels import trilinear

    used = vertices[np.unique(faces)]
    low, high = used.min(0), used.max(0)
    spacing = max(FINEST_MM, float(np.prod(high - low + 2) / GRID_POINTS) ** (1 / 3))
    low, high = low - 2.5 * spacing, high + 2.5 * spacing
    shape = 2 * np.ceil((high - low) / spacing / 2).astype(np.int64)
    tree = TriangleTree(vertices, faces)
    turns, signed = _sampled(tree, low, spacing, shape, report)
    if turns.sum() < 0:
        turns = -turns
    inside, doubt = turns > 0.5, (turns > DOUBTFUL[0]) & (turns < DOUBTFUL[1])
    doubt &= signed > spacing
    if not inside.any():
        raise BadMesh("the surface is open and encloses no volume")
    if doubt.sum() > MOST_DOUBT * inside.sum():
        raise BadMesh(
            f"the surface is too open to tell inside from outside: "
            f"{doubt.sum() * spacing**3:.4g} mm³ in doubt of {inside.sum() * spacing**3:.4g} mm³"
        )
    signed[~inside] *= -1

    def level(x: float, y: float, z: float) -> float:
        return trilinear(
            signed, (x - low[0]) / spacing, (y - low[1]) / spacing, (z - low[2]) / spacing
        )

    box = [*(low + spacing / 2), *(high - spacing / 2)]
    solid = checked(manifold3d.Manifold.level_set(level, box, spacing), "remeshing")
    if solid.is_empty():
        raise BadMesh(f"nothing of the surface is thicker than {spacing:.2g} mm")
    new_vertices, new_faces, _ = from_solid(solid)
    moved = _movement(vertices, faces, tree, new_vertices, new_faces)
    return Remeshed(new_vertices, new_faces, spacing, float(moved.mean()), float(moved.max()))


def _sampled(
    tree: TriangleTree, low: Floats, spacing: float, shape: Ints, report: Report
) -> tuple[Floats, Floats]:
    """Sample winding numbers and distances on a grid, finely only near the surface.

    Every second point is asked first. A point that is farther from the surface than its
    coarse neighbour is from it lies on the same side and takes that one's answer.
    """
    coarse = _asked(tree, low, 2 * spacing, np.argwhere(np.ones(shape // 2)), report, 0.2)
    turns, distances = (
        np.repeat(np.repeat(np.repeat(values.reshape(shape // 2), 2, 0), 2, 1), 2, 2)
        for values in coarse
    )
    near = distances < NEAR * spacing
    turns[near], distances[near] = _asked(tree, low, spacing, np.argwhere(near), report, 0.3)
    return turns, distances


def _asked(
    tree: TriangleTree, low: Floats, spacing: float, nodes: Ints, report: Report, start: float
) -> tuple[Floats, Floats]:
    turns, distances = np.empty(len(nodes)), np.empty(len(nodes))
    for begin in range(0, len(nodes), SLICE):
        part = slice(begin, begin + SLICE)
        points = low + spacing * nodes[part]
        turns[part], distances[part] = tree.winding_numbers(points), tree.distances(points)
        report(Progress("part", start + 0.1 * begin / len(nodes), detail="remeshing"))
    return turns, distances


def _movement(
    vertices: Floats, faces: Ints, tree: TriangleTree, new_vertices: Floats, new_faces: Ints
) -> Floats:
    """Measure distances from the new surface to the old, and back from its outer faces."""
    there = tree.distances(np.concatenate([new_vertices, new_vertices[new_faces].mean(1)]))
    cross = face_cross(vertices, faces)
    length = np.linalg.norm(cross, axis=1)
    sound = length > 0
    centres = vertices[faces[sound]].mean(1)
    step = 1e-3 * np.sqrt(length[sound])[:, None] * cross[sound] / length[sound][:, None]
    outer = np.abs(tree.winding_numbers(centres + step)) < 0.5
    outer &= np.abs(tree.winding_numbers(centres - step)) > 0.5
    back = TriangleTree(new_vertices, new_faces).distances(centres[outer])
    return np.concatenate([there, back])
