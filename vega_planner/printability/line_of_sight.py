# SPDX-License-Identifier: Apache-2.0
"""The paper's accessibility filter f2: a line from the tip along the tool.

The paper writes l(λ) = p_tool + λ ẑ_tool, λ > 0, with ẑ_tool pointing towards the tip;
read literally the line would run into the part. Here the direction is the tool axis as
everywhere in this package: from the tip back along the nozzle, away from the surface.
"""

from __future__ import annotations

import numpy as np

from vega_planner.datatypes import Bools, Floats, TriangleGeometry
from vega_planner.printability import ray_kernels as kernels

#: Rays start this far [mm] along the axis, so that they do not meet the faces they leave.
OFFSET_MM = 1e-3


class Occluder:
    """A mesh prepared for asking whether rays meet it."""

    def __init__(self, mesh: TriangleGeometry) -> None:
        count = max(len(mesh.faces), 1)
        self._mesh = (mesh.vertices, mesh.faces)
        self._tree = (
            np.empty(count, np.int64),
            np.empty((2 * count, 6)),
            np.zeros(2 * count, np.int64),
            np.zeros(2 * count, np.int64),
        )
        kernels.build_tree(*self._mesh, *self._tree)

    def blocks(self, points: Floats, axes: Floats, offset_mm: float = OFFSET_MM) -> Bools:
        """Tell for each point whether the line from it along its axis meets the mesh.

        Args:
            points: Points [mm], shape (n, 3).
            axes: Unit vectors, shape (n, 3).
            offset_mm: How far along the axis the line begins.

        Returns:
            True where something is in the way, shape (n,).
        """
        out = np.zeros(len(points), np.bool_)
        if len(self._mesh[1]):
            origins = points + offset_mm * axes
            kernels.any_hit(*self._mesh, *self._tree, origins, np.ascontiguousarray(axes), out)
        return out
