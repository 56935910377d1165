# SPDX-License-Identifier: Apache-2.0
"""Walls inside a solid: sheets that meet the surface at edges of three faces."""

from __future__ import annotations

import numpy as np

from vega_planner.datatypes import Bools, Floats, Ints, face_cross
from vega_planner.part.topology import connected_labels, edge_uses, face_pairs
from vega_planner.part.tree import TriangleTree

#: More sheets than this are no walls but a tangle, left to the remesher.
MOST_SHEETS = 64
#: Both sides of a wall lie this many turns inside what remains without it.
INSIDE_TURNS = 0.75


def inner_walls(vertices: Floats, faces: Ints) -> Bools:
    """Find sheets whose removal leaves the surface closed along their rims.

    Args:
        vertices: Points [mm], shape (n, 3).
        faces: Vertex indices, neighbours agreeing in orientation, shape (m, 3).

    Returns:
        True for the faces of such walls, shape (m,).
    """
    wall = np.zeros(len(faces), dtype=bool)
    order, _, uses = edge_uses(faces)
    by_edge = np.empty(len(order), dtype=np.int64)
    by_edge[order] = np.repeat(uses, uses)
    crowd = by_edge.reshape(-1, 3)
    if not (crowd > 2).any():
        return wall
    sheets = connected_labels(len(faces), face_pairs(faces)[0])
    names = np.unique(sheets[(crowd > 2).any(1)])
    if len(names) > MOST_SHEETS:
        return wall
    cross = face_cross(vertices, faces)
    areas = np.linalg.norm(cross, axis=1)
    for name in sorted(names, key=lambda n: (areas[sheets == n].sum(), n)):
        mine = sheets == name
        rest = ~mine & ~wall
        if (crowd[mine] == 1).any() or not rest.any():
            continue
        sample = np.flatnonzero(mine & (areas > 0))[:256]
        if not len(sample):
            continue
        centres = vertices[faces[sample]].mean(1)
        step = 1e-3 * np.sqrt(areas[sample])[:, None] * cross[sample] / areas[sample][:, None]
        tree = TriangleTree(vertices, faces[rest])
        turns = np.abs(tree.winding_numbers(np.concatenate([centres + step, centres - step])))
        if turns.min() > INSIDE_TURNS:
            wall |= mine
    return wall
