# SPDX-License-Identifier: Apache-2.0
"""What lines carry, at places that are no vertices of the patch."""

from __future__ import annotations

import numpy as np

from vega_planner.datatypes import Floats, row_lengths
from vega_planner.toolpaths.isolines import AXIS, CELL, POSITION


class Carrier:
    """Values of a patch at any place on it, from the vertices about that place.

    Args:
        vertices: Points of the patch [mm], shape (n, 3).
        values: What lines carry, at the vertices, shape (n, 12).
    """

    def __init__(self, vertices: Floats, values: Floats) -> None:
        from scipy.spatial import cKDTree

        self._tree = cKDTree(vertices)
        self._values = values

    def column(self, points: Floats, column: int) -> Floats:
        """One of the values at points, shape (k,)."""
        near, weight = self._about(points)
        return np.asarray(np.einsum("ij,ij->i", weight, self._values[near, column]))

    def rows(self, points: Floats, cell: Floats) -> Floats:
        """Rows of a line through points.

        Args:
            points: Places on the patch [mm], shape (k, 3).
            cell: Width of the strip to fill there [mm], shape (k,).
        """
        near, weight = self._about(points)
        rows = np.einsum("ij,ijc->ic", weight, self._values[near])
        rows[:, POSITION] = points
        rows[:, CELL] = cell
        rows[:, AXIS] /= row_lengths(rows[:, AXIS])[:, None]
        return np.asarray(rows)

    def _about(self, points: Floats) -> tuple[np.ndarray, Floats]:
        """The three vertices nearest to each point, and their weights, shape (k, 3)."""
        distance, near = self._tree.query(points, min(3, self._tree.n))
        weight = 1.0 / np.maximum(distance**2, 1e-6)
        return near, weight / weight.sum(1, keepdims=True)
