# SPDX-License-Identifier: Apache-2.0
"""Removal of slivers from a sheet, without moving a vertex."""

from __future__ import annotations

import numpy as np

from vega_planner.layers import tidy_kernels as kernels
from vega_planner.layers.contour import Sheet
from vega_planner.layers.geodesic import Sources
from vega_planner.part.surface_kernels import vertex_stars

#: Height below which a triangle is a sliver, in t.
SLIVER_HEIGHT = 0.012

#: Rounds of changes that do not touch each other.
ROUNDS = 4


def tidy_sheet(sheet: Sheet, sources: Sources, t: float) -> Sheet:
    """Merge the ends of the short edges of slivers, and flip the long ones.

    A change is made where the sheet stays manifold, no normal turns much and no new
    face leaves the level set farther than its like did before.

    Args:
        sheet: The sheet; its vertices are on the level set.
        sources: What distances are measured from.
        t: Layer thickness [mm].

    Returns:
        The sheet with fewer slivers; vertices stay where they are, or go.
    """
    count = len(sheet.vertices)
    faces = np.array(sheet.faces, np.int64, order="C")
    for _ in range(ROUNDS):
        start, around = vertex_stars(faces, count)
        changed, skipped = kernels.tidy_faces(
            sources.tri, *sources.rings, sheet.vertices, sheet.slots, faces, start, around,
            sheet.depth, SLIVER_HEIGHT * t,
        )  # fmt: skip
        if changed == 0:
            break
        faces = faces[faces[:, 0] >= 0]
        if skipped == 0:
            break
    if len(faces) == len(sheet.faces):
        return Sheet(
            sheet.depth, sheet.vertices, faces, sheet.slots, sheet.rim, sheet.inward
        )  # fmt: skip
    used = np.zeros(count, bool)
    used[faces] = True
    number = np.cumsum(used) - 1
    return Sheet(
        sheet.depth, sheet.vertices[used], number[faces], sheet.slots[used], sheet.rim[used],
        sheet.inward[used],
    )  # fmt: skip
