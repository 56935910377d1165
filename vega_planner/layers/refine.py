# SPDX-License-Identifier: Apache-2.0
"""Refinement of a sheet where its triangles leave the level set."""

from __future__ import annotations

import numpy as np

from vega_planner.layers import refine_kernels as kernels
from vega_planner.layers import subdivide_kernels as edges
from vega_planner.layers.contour import Sheet
from vega_planner.layers.distance_field import DistanceField
from vega_planner.layers.geodesic import Sources
from vega_planner.layers.grid import Grid

#: Edges are halved while their middle is farther than this from the level set [mm].
TOLERANCE_MM = 0.012

#: Times an edge is halved at most.
ROUNDS = 3

#: Faces are divided at last while their centre is farther than this from the level set [mm].
CENTRE_MM = 0.18

#: Times a face is divided at its centre at most.
CENTRE_ROUNDS = 2


def refine_sheet(sheet: Sheet, grid: Grid, sources: Sources, brr: DistanceField | None) -> Sheet:
    """Halve the edges of a sheet whose middles are off the level set.

    Args:
        sheet: The sheet; its vertices are on the level set.
        grid: Distances at the nodes.
        sources: What distances are measured from.
        brr: Distances to the restraint region, or None where there is none.

    Returns:
        The refined sheet, its old vertices first.
    """
    first = 0
    for _ in range(ROUNDS):
        halved = _with_middles(sheet, first, grid, sources, brr)
        if halved is None:
            break
        sheet, first = halved
    for _ in range(CENTRE_ROUNDS):
        before = len(sheet.faces)
        sheet = _with_centres(sheet, grid, sources)
        if len(sheet.faces) == before:
            break
    return sheet


def _with_middles(
    sheet: Sheet, first: int, grid: Grid, sources: Sources, brr: DistanceField | None
) -> tuple[Sheet, int] | None:
    """Halve the edges of faces `first` and later that are off the level set.

    Faces before those that share such an edge are split as well.

    Returns:
        The sheet and its first new face; None where no edge is off.
    """
    tri, rings = sources.tri, sources.rings
    brr_tri = brr.tri if brr else np.zeros((0, 16))
    brr_box = brr.box if brr else np.zeros((1, 6))
    faces = np.ascontiguousarray(sheet.faces)
    flagged = np.zeros((len(faces) - first, 3), np.uint8)
    found = kernels.flag_edges(
        tri, *rings, sheet.vertices, sheet.inward, sheet.slots, sheet.rim, faces, first,
        sheet.depth, TOLERANCE_MM, flagged,
    )  # fmt: skip
    if found == 0:
        return None
    bits = int(4 * found).bit_length()
    keys, numbers = np.full(1 << bits, -1), np.zeros(1 << bits, np.int64)
    ends = np.zeros((found, 2), np.int64)
    count = edges.number_edges(faces, first, flagged, bits, keys, numbers, ends)
    ends = ends[:count]
    at_edge = np.zeros(len(sheet.vertices), np.uint8)
    at_edge[ends] = 1
    middle, uses = np.zeros(faces.shape, np.int64), np.zeros(count, np.int64)
    whole, made = edges.find_middles(
        faces, at_edge, bits, keys, numbers, len(sheet.vertices), middle, uses
    )
    split = np.zeros((whole + made, 3), np.int64)
    edges.split_into(faces, middle, whole, split)
    on_rim = (uses == 1) & sheet.rim[ends].all(1)
    middles, inward = np.zeros((count, 3)), np.zeros((count, 3))
    slots = np.zeros(count, np.int64)
    kernels.place_middles(
        tri, *rings, sources.box, *grid.about, grid.state, brr_tri, brr_box, sheet.vertices,
        sheet.slots, ends, on_rim, sheet.depth, sheet.inward, middles, inward, slots,
    )  # fmt: skip
    refined = Sheet(
        sheet.depth,
        np.concatenate([sheet.vertices, middles]),
        split,
        np.concatenate([sheet.slots, slots]),
        np.concatenate([sheet.rim, on_rim]),
        np.concatenate([sheet.inward, inward]),
    )
    return refined, whole


def _with_centres(sheet: Sheet, grid: Grid, sources: Sources) -> Sheet:
    """Divide faces across a crease whose centre is still far off into three."""
    count = len(sheet.faces)
    chosen = np.zeros(count, np.uint8)
    centres, inward = np.zeros((count, 3)), np.zeros((count, 3))
    slots = np.zeros(count, np.int64)
    kernels.place_centres(
        sources.tri, *sources.rings, *grid.about, sheet.vertices, sheet.inward, sheet.slots,
        np.ascontiguousarray(sheet.faces), sheet.depth, CENTRE_MM, chosen, centres, inward, slots,
    )  # fmt: skip
    rows = np.flatnonzero(chosen)
    if len(rows) == 0:
        return sheet
    a, b, c = sheet.faces[rows].T
    p = len(sheet.vertices) + np.arange(len(rows))
    thirds = [np.column_stack(corners) for corners in ((a, b, p), (b, c, p), (c, a, p))]
    return Sheet(
        sheet.depth,
        np.concatenate([sheet.vertices, centres[rows]]),
        np.concatenate([sheet.faces[chosen == 0], *thirds]),
        np.concatenate([sheet.slots, slots[rows]]),
        np.concatenate([sheet.rim, np.zeros(len(rows), bool)]),
        np.concatenate([sheet.inward, inward[rows]]),
    )
