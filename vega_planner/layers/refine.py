# SPDX-License-Identifier: Apache-2.0
"""Refinement of a sheet where its triangles leave the level set."""

from __future__ import annotations

import numpy as np

from vega_planner.datatypes import Ints
from vega_planner.layers import refine_kernels as kernels
from vega_planner.layers.contour import Sheet
from vega_planner.layers.distance_field import DistanceField
from vega_planner.layers.geodesic import Sources
from vega_planner.layers.subdivide import split_faces

#: Edges are halved while their middle is farther than this from the level set [mm].
TOLERANCE_MM = 0.012

#: Times an edge is halved at most.
ROUNDS = 3

#: Faces are divided at last while their centre is farther than this from the level set [mm].
CENTRE_MM = 0.18

#: Times a face is divided at its centre at most.
CENTRE_ROUNDS = 2


def refine_sheet(sheet: Sheet, sources: Sources, brr: DistanceField | None) -> Sheet:
    """Halve the edges of a sheet whose middles are off the level set.

    Args:
        sheet: The sheet; its vertices are on the level set.
        sources: What distances are measured from.
        brr: Distances to the restraint region, or None where there is none.

    Returns:
        The refined sheet, its old vertices first.
    """
    tri, rings = sources.tri, sources.rings
    brr_tri = brr.tri if brr else np.zeros((0, 16))
    brr_box = brr.box if brr else np.zeros((1, 6))
    active: Ints = np.arange(len(sheet.faces))
    for _ in range(ROUNDS):
        faces = np.ascontiguousarray(sheet.faces[active])
        flagged = np.zeros((len(faces), 3), np.uint8)
        found = kernels.flag_edges(
            tri, *rings, sheet.vertices, sheet.inward, sheet.slots, faces, 0, len(faces),
            sheet.depth, TOLERANCE_MM, flagged,
        )  # fmt: skip
        if found == 0:
            break
        rows, sides = np.nonzero(flagged)
        pairs = np.stack([faces[rows, sides], faces[rows, (sides + 1) % 3]], axis=1)
        pairs.sort(axis=1)
        count = len(sheet.vertices)
        keys = np.unique(pairs[:, 0] * count + pairs[:, 1])
        ends = np.column_stack([keys // count, keys % count])
        # Faces that share a flagged edge but were not looked at again are split as well.
        at_edge = np.zeros(count, bool)
        at_edge[ends] = True
        a, b, c = at_edge[sheet.faces].T
        near = np.flatnonzero((a & b) | (b & c) | (c & a))
        near_pairs = np.sort(
            np.stack([sheet.faces[near], np.roll(sheet.faces[near], -1, axis=1)], 2), axis=2
        )
        near_keys = near_pairs[:, :, 0] * count + near_pairs[:, :, 1]
        place = np.minimum(np.searchsorted(keys, near_keys), len(keys) - 1)
        near_middle = np.where(keys[place] == near_keys, count + place, -1)
        uses = np.bincount(place[near_middle >= 0], minlength=len(keys))
        middle = np.full(sheet.faces.shape, -1)
        middle[near] = near_middle
        on_rim = (uses == 1) & sheet.rim[ends].all(1)
        middles = np.zeros((len(ends), 3))
        inward = np.zeros((len(ends), 3))
        slots = np.zeros(len(ends), np.int64)
        kernels.place_middles(
            tri, *rings, sources.box, brr_tri, brr_box, sheet.vertices, sheet.slots, ends, on_rim,
            sheet.depth, sheet.inward, middles, inward, slots,
        )  # fmt: skip
        old = len(middle) - int(((near_middle >= 0).any(1)).sum())
        sheet = Sheet(
            sheet.depth,
            np.concatenate([sheet.vertices, middles]),
            split_faces(sheet.faces, middle),
            np.concatenate([sheet.slots, slots]),
            np.concatenate([sheet.rim, on_rim]),
            np.concatenate([sheet.inward, inward]),
        )
        active = np.arange(old, len(sheet.faces))
    for _ in range(CENTRE_ROUNDS):
        before = len(sheet.faces)
        sheet = _with_centres(sheet, sources)
        if len(sheet.faces) == before:
            break
    return sheet


def _with_centres(sheet: Sheet, sources: Sources) -> Sheet:
    """Divide faces across a crease whose centre is still far off into three."""
    count = len(sheet.faces)
    chosen = np.zeros(count, np.uint8)
    centres, inward = np.zeros((count, 3)), np.zeros((count, 3))
    slots = np.zeros(count, np.int64)
    kernels.place_centres(
        sources.tri, *sources.rings, sources.box, sheet.vertices, sheet.inward, sheet.slots,
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
