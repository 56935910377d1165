# SPDX-License-Identifier: Apache-2.0
"""Welding: vertices at the same place become one."""

from __future__ import annotations

import numpy as np

from vega_planner.datatypes import Floats, Ints
from vega_planner.part.topology import compact, connected_labels

# Odd 64-bit constants whose products spread the bits of a coordinate (multiplicative
# hashing, as in xxHash).
_SPREAD = np.array([0x9E3779B97F4A7C15, 0xC2B2AE3D27D4EB4F, 0x165667B19E3779F9], dtype=np.uint64)


def weld_equal(vertices: Floats, faces: Ints) -> tuple[Floats, Ints]:
    """Merge vertices with equal coordinates.

    Args:
        vertices: Points [mm], shape (n, 3).
        faces: Vertex indices, shape (m, 3).

    Returns:
        Vertices in the order of their first use as stored, and the faces that name
        them; faces that name a vertex twice are dropped.
    """
    first, inverse = _unique_rows(vertices + 0.0)  # turns -0.0 into 0.0
    return _merged(vertices, faces, first, inverse)


def weld_near(vertices: Floats, faces: Ints, tolerance_mm: float) -> tuple[Floats, Ints]:
    """Merge vertices that are joined by a chain of steps of at most a tolerance.

    Args:
        vertices: Points [mm], shape (n, 3).
        faces: Vertex indices, shape (m, 3).
        tolerance_mm: Longest step [mm].

    Returns:
        As `weld_equal`; a merged vertex takes the place of its first one.
    """
    from scipy.spatial import cKDTree

    pairs = cKDTree(vertices).query_pairs(tolerance_mm, output_type="ndarray")
    first, inverse = np.unique(connected_labels(len(vertices), pairs), return_inverse=True)
    return _merged(vertices, faces, first, inverse)


def _unique_rows(points: Floats) -> tuple[Ints, Ints]:
    """Number equal rows: index of the first of each kind, and the kind of each row."""
    bits = points.view(np.uint64) * _SPREAD
    bits ^= bits >> np.uint64(29)
    bits *= _SPREAD[::-1]
    keys = bits[:, 0] + bits[:, 1] + bits[:, 2]
    _, first, inverse = np.unique(keys, return_index=True, return_inverse=True)
    if (points[first][inverse] != points).any():  # two places share a key: compare in full
        _, first, inverse = np.unique(points, axis=0, return_index=True, return_inverse=True)
    return first, inverse.reshape(-1)


def _merged(vertices: Floats, faces: Ints, first: Ints, inverse: Ints) -> tuple[Floats, Ints]:
    order = np.argsort(first)
    rank = np.empty_like(order)
    rank[order] = np.arange(len(order))
    faces = rank[inverse][faces]
    a, b, c = faces.T
    faces = faces[(a != b) & (b != c) & (c != a)]
    return compact(vertices[first[order]], faces)
