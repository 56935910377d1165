# SPDX-License-Identifier: Apache-2.0
"""A last look at the vertices of a sheet where gaps narrower than the grid are about.

The nodes about a vertex may all have been across such a gap; then it stands on another
sheet than the nearest. Measured exactly, it is moved onto its level, or its faces go and
the hole is spanned between those that stay, where that is on the level too.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from vega_planner.datatypes import Floats, Ints
from vega_planner.layers.contour import Sheet
from vega_planner.layers.distance_field import DistanceField
from vega_planner.part.holes import rim_loops, span_rim

#: Vertices this far off their level are moved, and left out if that far off afterwards [mm].
OFF_MM, LOST_MM = 0.02, 0.05

#: Holes are spanned where all faces are less than this off the level at their centres [mm].
SPANNED_MM = 0.15

#: How far a vertex is moved at most, in the depth of its sheet, and in how many steps.
FARTHEST, STEPS = 2.0, 12


def settle_sheet(sheet: Sheet, field: DistanceField, brr: DistanceField | None) -> Sheet:
    """Move the vertices of a sheet that are off their level onto it, or leave out their faces.

    Args:
        sheet: The sheet, of straight distances.
        field: Distances to S.
        brr: Distances to the restraint region, or None.

    Returns:
        The sheet; those of its vertices that stay keep their order.
    """
    depth = sheet.depth
    found = field.nearest(sheet.vertices)
    rows = np.flatnonzero((np.abs(found.distances - depth) > OFF_MM) & ~sheet.rim)
    if len(rows) == 0:
        return sheet
    points, best = sheet.vertices[rows], sheet.vertices[rows]
    least = np.abs(found.distances[rows] - depth)
    for _ in range(STEPS):
        found = field.nearest(points)
        away = points - found.points
        off = np.abs(found.distances - depth)
        far = np.linalg.norm(points - sheet.vertices[rows], axis=1) > FARTHEST * depth
        better = (off < least) & ~far
        best, least = np.where(better[:, None], points, best), np.where(better, off, least)
        points = found.points + away * (depth / np.maximum(found.distances, 1e-9))[:, None]
    found = field.nearest(best)
    vertices, slots, inward = sheet.vertices.copy(), sheet.slots.copy(), sheet.inward.copy()
    vertices[rows], slots[rows] = best, field.slots(found.faces)
    inward[rows] = (best - found.points) / np.maximum(found.distances, 1e-9)[:, None]
    lost = np.zeros(len(vertices), bool)
    # Of a wall of an overlapping body both sides are inside: only who is out of S after
    # a way through it has left the part.
    out = (inward[rows] * field.normals(found.faces)).sum(1) > 0
    out &= field.first_hits(sheet.vertices[rows], best)[0] >= 0
    if brr is not None:
        out |= brr.first_hits(sheet.vertices[rows], best)[0] >= 0
    lost[rows] = (least > LOST_MM) | out
    faces = sheet.faces[~lost[sheet.faces].any(1)]
    used = np.zeros(len(vertices), bool)
    used[faces] = True
    faces = np.concatenate([faces, _spans(vertices, faces, sheet, field)])
    number = np.cumsum(used) - 1
    return replace(
        sheet, vertices=vertices[used], faces=number[faces], slots=slots[used],
        rim=sheet.rim[used], inward=inward[used],
    )  # fmt: skip


def _spans(vertices: Floats, faces: Ints, sheet: Sheet, field: DistanceField) -> Ints:
    """Span the holes that lost faces leave, away from the rim of the sheet."""
    spans = [np.zeros((0, 3), np.int64)]
    if len(faces) == len(sheet.faces):
        return spans[0]
    for loop in rim_loops(faces):
        if sheet.rim[loop].any():
            continue
        span = span_rim(vertices, loop)
        off = np.abs(field.distances(vertices[span].mean(1)) - sheet.depth)
        if off.max() < SPANNED_MM:
            spans.append(span)
    return np.concatenate(spans)
