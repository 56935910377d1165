# SPDX-License-Identifier: Apache-2.0
"""Mitred edges: the thickness of a sheet along its sharp edges.

A band of thickness t that turns a corner of angle phi reaches t / 2 / cos(phi / 2) outwards
from the middle surface there, as a mitred joint does. What lies within half the thickness
of the sheet is round instead and leaves the corner open. So the sheet is as thick as the
joint on the sharp edge itself, and as thick as the bands a little beside it.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from vega_planner.datatypes import Floats, Ints, Layer, row_lengths
from vega_planner.layers import mitre_kernels as kernels
from vega_planner.layers.distance_field import DistanceField
from vega_planner.layers.subdivide import split_flagged

#: Edges are sharp from this angle between the faces on; below it next to nothing is open.
SHARP = np.radians(35.0)

#: Width of the strip along a sharp edge over which the thickness falls, in t.
STRIP_RATIO = 1 / 32

#: Height of faces below which their normals mean nothing, in t.
FLAT_RATIO = 1 / 32

#: An edge at a small angle to the sharp one is split after this many widths at most.
LONGEST = 3.0

#: Edges are not split where their middle is farther than this from the level set [mm].
OFF_MM = 0.02

#: How much more than the joint the edge itself is, so that the faces beside it, which
#: have one corner off it, are as thick as the joint.
RAISED = 1.5

#: Thickness of a sheet at most, in t.
MOST = 1.5


def mitred(layer: Layer, t: float, field: DistanceField | None = None) -> Layer:
    """Give a sheet the thickness of mitred joints along its sharp edges.

    Args:
        layer: The sheet.
        t: Nominal layer thickness [mm].
        field: Distances to S for a sheet whose points must stay at its depth, or None.

    Returns:
        The sheet with a narrow strip of faces on both sides of its sharp edges, which are
        thicker there; `bead_thickness` stays. The same sheet where it has no sharp edge.
    """
    vertices, faces, thickness = layer.vertices, layer.faces, layer.thickness
    if len(faces) == 0:
        return layer
    bits = int(4 * len(faces)).bit_length()
    bend, along = np.zeros(len(vertices)), np.zeros(vertices.shape)
    crease = np.zeros(faces.shape, np.uint8)
    kernels.find_creases(
        vertices, faces, np.cos(SHARP), FLAT_RATIO * t, bits, np.full(1 << bits, -1),
        np.zeros(1 << bits, np.int64), bend, along, crease,
    )  # fmt: skip
    if not bend.any():
        return layer
    width = STRIP_RATIO * t
    # Faces that only touch sharp edges all round get a middle that is not sharp.
    depth = layer.depth_mm
    faces, ends = _split(vertices, faces, bend, crease, 2, 2 * width, field, depth)
    vertices = np.concatenate([vertices, vertices[ends].mean(1)])
    thickness = np.concatenate([thickness, thickness[ends].mean(1)])
    bend = np.concatenate([bend, np.zeros(len(ends))])
    crease = np.zeros(faces.shape, np.uint8)
    faces, ends = _split(vertices, faces, bend, crease, 1, 2 * width, field, depth)
    sharp = np.where(bend[ends[:, 0]] > 0, ends[:, 0], ends[:, 1])
    plain = ends.sum(1) - sharp
    away = vertices[plain] - vertices[sharp]
    length, height = row_lengths(away), row_lengths(np.cross(away, along[sharp]))
    share = width / np.clip(height, length / LONGEST, length)
    share = np.minimum(share, 0.5)
    beside = thickness[sharp] + share * (thickness[plain] - thickness[sharp])
    joint = 1 + RAISED * (1 / np.cos(np.minimum(bend, 0.9 * np.pi) / 2) - 1)
    raised = np.minimum(thickness * joint, np.maximum(thickness, MOST * t))
    mitre = np.concatenate([raised / thickness, np.ones(len(beside))])
    return replace(
        layer,
        vertices=np.concatenate([vertices, vertices[sharp] + share[:, None] * away]),
        faces=faces,
        thickness=np.concatenate([raised, beside]),
        mitre=mitre,
    )


def _split(
    vertices: Floats,
    faces: Ints,
    bend: Floats,
    crease: np.ndarray,
    ends: int,
    shortest: float,
    field: DistanceField | None,
    depth: float,
) -> tuple[Ints, Ints]:
    """Split edges that leave sharp vertices, except where their middles are off the level set.

    Returns:
        The faces, and the ends of the edges that were split.
    """
    flagged = np.zeros(faces.shape, np.uint8)
    found = kernels.flag_edges(vertices, faces, bend, crease, ends, shortest, flagged)
    if found and field is not None:
        rows, sides = np.nonzero(flagged)
        first, second = faces[rows, sides], faces[rows, (sides + 1) % 3]
        off = np.abs(field.distances((vertices[first] + vertices[second]) / 2) - depth)
        flagged[rows, sides] = off < OFF_MM
        found = int((off < OFF_MM).sum())
    return split_flagged(faces, len(vertices), flagged, found)
