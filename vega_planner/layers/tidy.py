# SPDX-License-Identifier: Apache-2.0
"""Removal of slivers from a sheet, without moving a vertex."""

from __future__ import annotations

import numpy as np

from vega_planner.datatypes import Floats, Ints
from vega_planner.layers import tidy_kernels as kernels
from vega_planner.layers.contour import Sheet
from vega_planner.layers.geodesic import Sources
from vega_planner.part.surface_kernels import vertex_stars

#: Height below which a triangle is a sliver, in t.
SLIVER_HEIGHT = 0.012

#: Rounds of changes that do not touch each other, and of such where a larger share of the
#: faces has no area.
ROUNDS, FLAT_ROUNDS, FLAT_SHARE = 4, 16, 1 / 3000


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
    tall = np.zeros(len(faces), np.uint8)
    for done in range(1, FLAT_ROUNDS + 1):
        start, around = vertex_stars(faces, count)
        changed, skipped, flats, left = kernels.tidy_faces(
            sources.tri, *sources.rings, sheet.vertices, sheet.slots, faces, tall, start, around,
            sheet.depth, SLIVER_HEIGHT * t,
        )  # fmt: skip
        if changed == 0:
            break
        faces, tall = faces[:left], tall[:left]
        if skipped + flats == 0 or (done >= ROUNDS and flats < FLAT_SHARE * len(faces)):
            break
    # What coincides and could not be merged without joining the two sides of an edge.
    if kernels.drop_flat(sheet.vertices, faces):
        faces = _zipped(sheet.vertices, faces[faces[:, 0] >= 0])
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


def _zipped(vertices: Floats, faces: Ints) -> Ints:
    """Close the slits that flat faces leave: two open edges from a vertex to one place.

    Args:
        vertices: Points [mm], shape (n, 3).
        faces: Vertex indices, shape (m, 3).

    Returns:
        The faces with one vertex for both where every edge still has at most two faces.
    """
    while True:
        ahead = np.stack([faces, np.roll(faces, -1, axis=1)], axis=2).reshape(-1, 2)
        _, kind, uses = np.unique(
            np.sort(ahead, axis=1), axis=0, return_inverse=True, return_counts=True
        )
        open_edges = ahead[uses[kind.ravel()] == 1]
        after = dict(open_edges.tolist())
        closed: set[int] = set()
        for before, at in open_edges.tolist():
            other = after.get(at, before)
            if (
                other != before
                and closed.isdisjoint((before, at, other))
                and (vertices[other] == vertices[before]).all()
            ):
                merged = _merged(faces, before, other)
                if merged is not faces:
                    faces = merged
                    closed.update((before, at, other))
        if not closed:
            return faces


def _merged(faces: Ints, gone: int, kept: int) -> Ints:
    """Put one vertex in the place of another; the same faces where they would not fit.

    Two faces that come to lie on each other, a fin of the sheet, are left out.
    """
    about = ((faces == gone) | (faces == kept)).any(1)
    ring = faces[about]
    ring = np.where(ring == gone, kept, ring)
    _, kind, alike = np.unique(
        np.sort(ring, axis=1), axis=0, return_inverse=True, return_counts=True
    )
    stays = alike[kind.ravel()] == 1
    left = ring[stays]
    ends = np.sort(np.stack([left, np.roll(left, -1, axis=1)], axis=2).reshape(-1, 2), axis=1)
    _, uses = np.unique(ends, axis=0, return_counts=True)
    if (uses > 2).any() or (ends[:, 0] == ends[:, 1]).any() or (alike > 2).any():
        return faces
    about[about] = ~stays
    return np.where(faces == gone, kept, faces)[~about]
