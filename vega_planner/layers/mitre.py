# SPDX-License-Identifier: Apache-2.0
"""Mitred edges: the thickness of a sheet along its sharp edges.

A band of thickness t that turns a corner of angle phi reaches t / 2 / cos(phi / 2) outwards
from the middle surface there, as a mitred joint does. What lies within half the thickness
of the sheet is round instead and leaves the corner open. So the sheet is as thick as the
joint on the sharp edge itself, and as thick as the bands a little beside it. The same goes
for the ends of the core's sheets: a band ends square.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from vega_planner.datatypes import Floats, Ints, Layer, row_lengths
from vega_planner.layers import mitre_kernels as kernels
from vega_planner.layers.subdivide import split_flagged
from vega_planner.part.topology import directed_edges, edge_uses

#: Measures the depth of points [mm], of shape (n, 3).
Depths = Callable[[Floats], Floats]

#: Edges are sharp from this angle between the faces on; below it next to nothing is open.
SHARP = np.radians(45.0)

#: A sheet of the core ends 0.75 of half its thickness from the surface, and its square end
#: is within 1.25 of that: as sharp as an edge of this angle.
END_BEND = 2 * np.arccos(1 / 1.25)

#: Up to this angle between the faces, the middle of an edge is on the level set.
EVEN = np.radians(10.0)

#: How sides are marked whose middle may be off the level set, and those on the rim, which
#: keeps its place on the restraint region.
UNEVEN, RIM = 1, 3

#: Width of the strip along a sharp edge over which the thickness falls, in t.
STRIP_RATIO = 1 / 32

#: Height of faces below which their normals mean nothing, in t.
FLAT_RATIO = 1 / 32

#: An edge at a small angle to the sharp one is split after this many widths at most.
LONGEST = 3.0

#: Edges are not split where their middle is farther than this from the level set [mm].
OFF_MM = 0.01

#: How much more than the joint the edge itself is, so that the faces beside it, which
#: have one corner off it, are as thick as the joint.
RAISED = 1.5

#: Thickness of a sheet on its sharp edges at most, in t, by kind.
MOST = {"envelope": 3.2, "core": 2.5}


@dataclass(frozen=True, eq=False)
class Strips:
    """A sheet with a narrow strip of faces on both sides of its sharp edges.

    Attributes:
        vertices: Points [mm], those of the sheet first, shape (n, 3).
        faces: Vertex indices, shape (m, 3).
        ends: Vertices between which each new point lies, shape (k, 2).
        share: How far from the first to the second, shape (k,).
        bend: Angle between the normals at the vertices, 0 where not sharp [rad], shape (n,).
    """

    vertices: Floats
    faces: Ints
    ends: Ints
    share: Floats
    bend: Floats

    def on(self, layer: Layer, t: float) -> Layer:
        """Give the sheet the thickness of mitred joints; `bead_thickness` stays.

        Args:
            layer: The sheet, with its vertices in the same order.
            t: Nominal layer thickness [mm].
        """
        if len(self.ends) == 0:
            return layer
        thickness = layer.thickness
        first = len(thickness)
        plain = np.concatenate([thickness, np.zeros(len(self.ends))])
        for rows, before, after, share in self._turns:
            a, b = plain[before], plain[after]
            plain[first + rows] = a + share * (b - a)
        raised = np.minimum(plain * self._joint, np.maximum(plain, MOST[layer.kind] * t))
        return replace(
            layer,
            vertices=self.vertices,
            faces=self.faces,
            thickness=raised,
            mitre=raised / plain,
        )

    @cached_property
    def _turns(self) -> list[tuple[Ints, Ints, Ints, Floats]]:
        """New points, their ends and shares; those between new points come after those."""
        late = (self.ends >= len(self.vertices) - len(self.ends)).any(1)
        turns = np.flatnonzero(~late), np.flatnonzero(late)
        return [(rows, *self.ends[rows].T.copy(), self.share[rows]) for rows in turns]

    @cached_property
    def _joint(self) -> Floats:
        """Thickness at the vertices over that of the bands beside them, shape (n,)."""
        joint = np.ones(len(self.bend))
        sharp = np.flatnonzero(self.bend)
        bend = np.minimum(self.bend[sharp], 0.9 * np.pi)
        joint[sharp] = 1 + RAISED * (1 / np.cos(bend / 2) - 1)
        return joint


def find_strips(layer: Layer, t: float, depths: Depths | None = None) -> Strips:
    """Lay strips along the sharp edges of a sheet.

    Args:
        layer: The sheet.
        t: Nominal layer thickness [mm].
        depths: Measures depths for a sheet whose points must stay at its own, or None.

    Returns:
        The strips; without any new point where no edge is sharp.
    """
    vertices, faces = layer.vertices, layer.faces
    none = np.zeros((0, 2), np.int64)
    bent = np.zeros(len(vertices), np.uint8)
    kernels.mark_bent(vertices, faces, np.cos(SHARP / 2) + 1e-9, np.zeros(vertices.shape), bent)
    bend, along, _ = _creases(vertices, faces, bent, 2, t)
    if layer.kind == "core":
        _square_ends(vertices, faces, bend, along)
    if not bend.any():
        return Strips(vertices, faces, none, np.zeros(0), bend)
    crease = _creases(vertices, faces, bend > 0, 1, t)[2]
    width, depth = STRIP_RATIO * t, layer.depth_mm
    # Faces that only touch sharp edges all round get a middle that is not sharp.
    flagged = np.zeros(faces.shape, np.uint8)
    kernels.flag_edges(vertices, faces, bend, crease, 2, 2 * width, flagged)
    _keep_flags(flagged, crease, None, vertices, faces, depths, depth)
    faces, middles = split_flagged(faces, len(vertices), flagged)
    vertices = np.concatenate([vertices, vertices[middles].mean(1)])
    bend = np.concatenate([bend, np.zeros(len(middles))])
    along = np.concatenate([along, np.zeros((len(middles), 3))])
    crease = _creases(vertices, faces, bend > 0, 1, t)[2]
    flagged = np.zeros(faces.shape, np.uint8)
    kernels.flag_edges(vertices, faces, bend, np.zeros_like(crease), 1, 2 * width, flagged)
    _keep_flags(flagged, crease, UNEVEN, vertices, faces, depths, depth)
    faces, ends = split_flagged(faces, len(vertices), flagged)
    sharp = np.where(bend[ends[:, 0]] > 0, ends[:, 0], ends[:, 1])
    other = ends.sum(1) - sharp
    away = vertices[other] - vertices[sharp]
    length, height = row_lengths(away), row_lengths(np.cross(away, along[sharp]))
    share = np.minimum(width / np.clip(height, length / LONGEST, length), 0.5)
    vertices = np.concatenate([vertices, vertices[sharp] + share[:, None] * away])
    # Sheets of any thickness share them.
    vertices.flags.writeable = faces.flags.writeable = False
    return Strips(
        vertices,
        faces,
        np.concatenate([middles, np.column_stack([sharp, other])]),
        np.concatenate([np.full(len(middles), 0.5), share]),
        np.concatenate([bend, np.zeros(len(ends))]),
    )


def _square_ends(vertices: Floats, faces: Ints, bend: Floats, along: Floats) -> None:
    """Count the ends of a sheet as sharp as it takes to reach the corners there, in place."""
    order, starts, uses = edge_uses(faces)
    ends = directed_edges(faces)[order[starts[uses == 1]]]
    fresh = ends[(bend[ends] < END_BEND).any(1)]
    away = vertices[fresh[:, 1]] - vertices[fresh[:, 0]]
    away /= np.maximum(row_lengths(away), 1e-12)[:, None]
    for corner in range(2):
        at = fresh[:, corner]
        blunt = bend[at] < END_BEND
        bend[at[blunt]], along[at[blunt]] = END_BEND, away[blunt]


def _creases(
    vertices: Floats, faces: Ints, near: np.ndarray, ends: int, t: float
) -> tuple[Floats, Floats, np.ndarray]:
    """Find the sharp edges of which so many ends are near.

    Returns:
        Bend and direction at the vertices, and flags of the sides.
    """
    near = near.astype(np.uint8)
    bits = int(2 * kernels.count_sides(faces, near, ends) + 1).bit_length()
    bend, along = np.zeros(len(vertices)), np.zeros(vertices.shape)
    crease = np.zeros(faces.shape, np.uint8)
    kernels.find_creases(
        vertices, faces, near, ends, np.cos(SHARP), np.cos(EVEN), FLAT_RATIO * t, bits,
        np.full(1 << bits, -1), np.zeros(1 << bits, np.int64), bend, along, crease,
    )  # fmt: skip
    return bend, along, crease


def _keep_flags(
    flagged: np.ndarray,
    crease: np.ndarray,
    doubtful: int | None,
    vertices: Floats,
    faces: Ints,
    depths: Depths | None,
    depth: float,
) -> None:
    """Take the flag from sides on the rim, and from those off the level set, in place.

    Only sides with the doubtful mark in `crease` are measured, or all where that is None.
    """
    sides = np.flatnonzero(flagged.view(np.bool_))
    marks = crease.ravel()[sides]
    flagged.ravel()[sides[marks == RIM]] = 0
    if depths is None:
        return
    sides = sides[marks != RIM if doubtful is None else marks == doubtful]
    corners = faces.ravel()
    ends = np.sort([corners[sides], corners[sides - sides % 3 + (sides + 1) % 3]], axis=0)
    edges, number = np.unique(ends[0] * len(vertices) + ends[1], return_inverse=True)
    first, second = np.divmod(edges, len(vertices))
    middles = (vertices[first] + vertices[second]) / 2
    off = np.abs(depths(middles) - depth)
    flagged.ravel()[sides] = (off < OFF_MM)[number]
