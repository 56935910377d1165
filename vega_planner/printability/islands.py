# SPDX-License-Identifier: Apache-2.0
"""Labels of faces without the noise of small islands."""

from __future__ import annotations

import numpy as np

from vega_planner.datatypes import Floats, Ints, TriangleGeometry
from vega_planner.printability import mesh_kernels as kernels


def neighbours_of(mesh: TriangleGeometry) -> Ints:
    """Find the face across each edge of each face, -1 at a rim, shape (m, 3)."""
    out = np.empty((len(mesh.faces), 3), np.int64)
    kernels.face_neighbours(len(mesh.vertices), mesh.faces, out)
    return out


def without_islands(neighbours: Ints, areas: Floats, label: Ints, least_mm2: float) -> Ints:
    """Give regions smaller than an area the label of what surrounds them.

    Args:
        neighbours: From `neighbours_of`, shape (m, 3).
        areas: Face areas [mm²], shape (m,).
        label: Labels of the faces, shape (m,).
        least_mm2: Area below which a region is noise.

    Returns:
        New labels, shape (m,).
    """
    label = label.copy()
    for _ in range(4):
        piece = np.empty(len(label), np.int64)
        count = kernels.label_pieces(neighbours, label, piece)
        size = np.bincount(piece, weights=areas, minlength=count)
        across = neighbours.ravel()
        face = np.repeat(np.arange(len(label)), 3)
        edge = (across >= 0) & (size[piece[face]] < least_mm2)
        edge &= label[face] != label[np.maximum(across, 0)]
        if not edge.any():
            break
        face, across = face[edge], across[edge]
        bigger = size[piece[across]] > size[piece[face]]
        face, across = face[bigger], across[bigger]
        if not len(face):
            break
        values = np.unique(label)
        votes = np.zeros((count, len(values)))
        np.add.at(votes, (piece[face], np.searchsorted(values, label[across])), 1.0)
        change = np.flatnonzero(votes.sum(1) > 0)
        best = values[votes[change].argmax(1)]
        new = np.full(count, np.iinfo(np.int64).min)
        new[change] = best
        moved = new[piece] != np.iinfo(np.int64).min
        label[moved] = new[piece[moved]]
    return label
