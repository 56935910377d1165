# SPDX-License-Identifier: Apache-2.0
"""A tree over triangles that answers how often a surface winds round a point, and how
far the surface is.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from vega_planner.datatypes import Floats, Ints
from vega_planner.parallel import map_threads
from vega_planner.part import kernels
from vega_planner.part.morton import morton_order

#: A node counts as far beyond this many of its radii; errors stay below 0.05 turns.
FAR = 2.0
#: Points answered by one call of a kernel.
CHUNK = 4096


class TriangleTree:
    """Winding numbers and distances of one mesh, which need not be closed.

    Args:
        vertices: Points [mm], shape (n, 3).
        faces: Vertex indices, shape (m, 3), m >= 1.
    """

    def __init__(self, vertices: Floats, faces: Ints) -> None:
        count = len(faces)
        self._corners = np.ascontiguousarray(vertices[faces], dtype=np.float64)
        self._order = morton_order(self._corners.mean(1))
        room = max(2 * count, 1)
        self._first = np.zeros(room, dtype=np.int64)
        self._last = np.zeros(room, dtype=np.int64)
        self._low, self._high = np.zeros((room, 3)), np.zeros((room, 3))
        self._middle, self._dipole = np.zeros((room, 3)), np.zeros((room, 3))
        self._reach = np.zeros(room)
        kernels.build(
            self._corners,
            self._order,
            self._first,
            self._last,
            self._low,
            self._high,
            self._middle,
            self._dipole,
            self._reach,
        )

    def winding_numbers(self, points: Floats) -> Floats:
        """Measure how often the surface winds round points.

        One inside a closed surface with outward normals, zero outside, and what lies
        between near the holes of an open one.

        Args:
            points: Points [mm], shape (n, 3).

        Returns:
            Winding numbers, shape (n,), to 0.05.

        Source:
            [Barill2018]_, with the first term of its expansion.
        """

        def answer(chunk: Floats) -> Floats:
            out = np.zeros(len(chunk))
            kernels.winding(
                chunk,
                self._corners,
                self._order,
                self._first,
                self._last,
                self._middle,
                self._dipole,
                self._reach,
                FAR,
                out,
            )
            return out

        return self._by_chunks(answer, points)

    def distances(self, points: Floats) -> Floats:
        """Measure the distance from points to the surface [mm], shape (n,)."""

        def answer(chunk: Floats) -> Floats:
            out = np.zeros(len(chunk))
            kernels.distance2(
                chunk,
                self._corners,
                self._order,
                self._first,
                self._last,
                self._low,
                self._high,
                out,
            )
            return out

        return np.sqrt(self._by_chunks(answer, points))

    @staticmethod
    def _by_chunks(answer: Callable[[Floats], Floats], points: Floats) -> Floats:
        points = np.ascontiguousarray(points, dtype=np.float64)
        chunks = [points[i : i + CHUNK] for i in range(0, len(points), CHUNK)]
        return np.concatenate(map_threads(answer, chunks)) if chunks else np.zeros(0)
