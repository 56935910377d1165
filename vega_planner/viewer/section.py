# SPDX-License-Identifier: Apache-2.0
"""Cutting meshes open at a plane, for looking inside."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from vega_planner.datatypes import Bools, Floats, Ints, TriangleGeometry

WHOLE, AT_X, AT_Y = CUTS = ("whole", "cut at x", "cut at y")


@dataclass(frozen=True)
class Cut:
    """A plane across an axis; one side of it is left out.

    Attributes:
        axis: 0 for x, 1 for y.
        at_mm: Where on the axis.
        keep_low: Whether the side of the lower values stays.
    """

    axis: int
    at_mm: float
    keep_low: bool

    def beyond(self, points: Floats) -> Floats:
        """How far points (..., 3) lie on the side that is left out [mm], below 0 on the other."""
        offset = points[..., self.axis] - self.at_mm
        return np.asarray(offset if self.keep_low else -offset)

    def keeps(self, mesh: TriangleGeometry) -> Bools:
        """True for the faces whose middle stays, shape (m,)."""
        return np.asarray(self.beyond(mesh.vertices[mesh.faces].mean(1)) <= 0)


def cut_through(sheets: Sequence[TriangleGeometry], kind: str) -> Cut | None:
    """Lay the plane of a kind of cut through the middle of meshes.

    Args:
        sheets: The meshes.
        kind: One of `CUTS`.

    Returns:
        The cut that leaves out the half nearer to the first view, +x or -y; None for none.
    """
    filled = [sheet.vertices for sheet in sheets if len(sheet.vertices)]
    if kind == WHOLE or not filled:
        return None
    axis = CUTS.index(kind) - 1
    low, high = min(v[:, axis].min() for v in filled), max(v[:, axis].max() for v in filled)
    return Cut(axis, float(low + high) / 2, keep_low=axis == 0)


def clipped(vertices: Floats, faces: Ints, cut: Cut | None) -> tuple[Floats, Ints]:
    """Cut a mesh exactly at the plane: triangles across it are divided.

    Args:
        vertices: Points, shape (n, 3).
        faces: Vertex indices, shape (m, 3).
        cut: Where; None leaves the mesh as it is.

    Returns:
        Vertices and faces of what stays.
    """
    if cut is None:
        return vertices, faces
    beyond = cut.beyond(vertices)
    outside = beyond[faces] > 0
    count = outside.sum(1)
    points, blocks, size = [vertices], [faces[count == 0]], len(vertices)
    for number in (1, 2):
        # The corner that is alone on its side comes first.
        chosen = np.flatnonzero(count == number)
        if not len(chosen):
            continue
        alone = (outside[chosen] if number == 1 else ~outside[chosen]).argmax(1)
        order = (alone[:, None] + np.arange(3)) % 3
        a, b, c = np.take_along_axis(faces[chosen], order, axis=1).T
        first = size + np.arange(len(chosen))
        second = first + len(chosen)
        points += [_crossing(vertices, beyond, a, b), _crossing(vertices, beyond, a, c)]
        size += 2 * len(chosen)
        if number == 1:
            blocks += [np.column_stack([first, b, c]), np.column_stack([first, c, second])]
        else:
            blocks.append(np.column_stack([a, first, second]))
    return np.concatenate(points), np.concatenate(blocks)


def _crossing(vertices: Floats, beyond: Floats, a: Ints, b: Ints) -> Floats:
    share = beyond[a] / (beyond[a] - beyond[b])
    return np.asarray(vertices[a] + share[:, None] * (vertices[b] - vertices[a]))
