# SPDX-License-Identifier: Apache-2.0
"""Triangles at the rim of a sheet that are folded back onto it."""

from __future__ import annotations

import numpy as np

from vega_planner.datatypes import Bools, Floats, Ints
from vega_planner.layers import tidy_kernels as kernels
from vega_planner.part.surface_kernels import vertex_stars


def folded_ears(vertices: Floats, faces: Ints) -> Bools:
    """Mark the triangles with two open edges that lie on a larger only neighbour, (m,).

    Where the rim follows a hollow wall, the last point of a thin triangle can come to lie
    inside the edge opposite to it. Its normal is turned over then, and so is that of the
    point: a nozzle that follows it would tip over.

    Args:
        vertices: Points [mm], shape (n, 3).
        faces: Vertex indices, shape (m, 3).
    """
    ears = np.zeros(len(faces), np.bool_)
    if len(faces) == 0:
        return ears
    faces = np.ascontiguousarray(faces, np.int64)
    start, around = vertex_stars(faces, len(vertices))
    kernels.mark_ears(vertices, faces, start, around, ears)
    return ears
