# SPDX-License-Identifier: Apache-2.0
# mypy: disable-error-code="no-untyped-def"
"""Compiled search for the sharp edges of a sheet and for the edges that leave them."""

from __future__ import annotations

import numpy as np

from vega_planner.compiled import kernel
from vega_planner.layers.subdivide_kernels import edge_key, place_of
from vega_planner.part.surface_kernels import cross_of


@kernel
def mark_bent(vertices, faces, least, first, bent):
    """Mark the vertices at which a face is turned against the first one there.

    Of two faces that turn by some angle over an edge, one is turned by half of it against
    any other direction: both ends of each sharp edge are marked.

    Args:
        vertices: Points [mm], (n, 3).
        faces: Vertex indices, (m, 3).
        least: Cosine of the angle from which faces count as turned.
        first: Scratch: normal of the first face at each vertex, 0 at first, (n, 3).
        bent: Result, 0 at first, (n,).
    """
    normal = np.zeros(3)
    for f in range(len(faces)):
        length = cross_of(vertices, faces[f, 0], faces[f, 1], faces[f, 2], normal)
        if length == 0.0:
            continue
        for c in range(3):
            v = faces[f, c]
            if bent[v]:
                continue
            cosine, known = 0.0, 0.0
            for k in range(3):
                cosine += first[v, k] * normal[k]
                known += abs(first[v, k])
            if known == 0.0:
                for k in range(3):
                    first[v, k] = normal[k] / length
            elif cosine < least * length:
                bent[v] = 1


@kernel
def count_sides(faces, near, ends):
    """Count the sides of which so many ends, 1 or 2, are near."""
    count = 0
    for f in range(len(faces)):
        a, b, c = near[faces[f, 0]], near[faces[f, 1]], near[faces[f, 2]]
        count += int(a + b >= ends) + int(b + c >= ends) + int(c + a >= ends)
    return count


@kernel
def find_creases(
    vertices, faces, near, ends, most, even, flat, bits, keys, owner, bend, along, crease
):
    """Find the edges over which a sheet bends outwards, convexly.

    Args:
        vertices: Points [mm], (n, 3).
        faces: Vertex indices, (m, 3).
        near: 1 for the vertices at which edges are looked at, (n,).
        ends: How many ends of an edge must be near for it to be looked at, 1 or 2.
        most: Cosine between the normals below which an edge is sharp.
        even: Cosine below which the middle of an edge may be off the level set.
        flat: Height of the faces below which their normals mean nothing [mm].
        bits: Bits of the table.
        keys: Scratch: table of edges, -1 at first, (2^bits,).
        owner: Scratch: the side that named each edge first, (2^bits,).
        bend: Result: largest angle between the normals at each vertex [rad], 0 at first, (n,).
        along: Result: direction of the sharpest edge at each vertex, (n, 3).
        crease: Result: 2 for sides on a sharp edge, 1 on one that is not even, 3 on the
            rim, 0 on others and where not looked at, (m, 3).
    """
    mask = (1 << bits) - 1
    normal, other = np.zeros(3), np.zeros(3)
    for f in range(len(faces)):
        if near[faces[f, 0]] + near[faces[f, 1]] + near[faces[f, 2]] < ends:
            continue
        length = cross_of(vertices, faces[f, 0], faces[f, 1], faces[f, 2], normal)
        for c in range(3):
            a, b = faces[f, c], faces[f, (c + 1) % 3]
            if near[a] + near[b] < ends:
                continue
            key = edge_key(a, b)
            p = place_of(key, bits)
            while keys[p] >= 0 and keys[p] != key:
                p = (p + 1) & mask
            if keys[p] < 0:
                keys[p] = key
                owner[p] = 3 * f + c
                crease[f, c] = 3
                continue
            g, e = owner[p] // 3, owner[p] % 3
            crease[g, e] = crease[g, e] % 3
            across = cross_of(vertices, faces[g, 0], faces[g, 1], faces[g, 2], other)
            side, cosine, rise = 0.0, 0.0, 0.0
            far = faces[g, (e + 2) % 3]
            for k in range(3):
                side += (vertices[b, k] - vertices[a, k]) ** 2
                cosine += normal[k] * other[k]
                rise += (vertices[far, k] - vertices[a, k]) * normal[k]
            if min(length, across) <= flat * np.sqrt(side):
                continue
            cosine /= length * across
            if cosine < even:
                crease[f, c] = 1
                crease[g, e] = 1
            if cosine >= most or rise >= 0.0:
                continue
            crease[f, c] = 2
            crease[g, e] = 2
            angle = np.arccos(max(cosine, -1.0))
            for v in (a, b):
                if angle > bend[v]:
                    bend[v] = angle
                    for k in range(3):
                        along[v, k] = (vertices[b, k] - vertices[a, k]) / np.sqrt(side)


@kernel
def flag_edges(vertices, faces, bend, crease, ends, shortest, flagged):
    """Flag the edges that have one sharp end, or two without being sharp themselves.

    Args:
        vertices: Points [mm], (n, 3).
        faces: Vertex indices, (m, 3).
        bend: Positive at sharp vertices, (n,).
        crease: 2 for sides on a sharp edge, (m, 3).
        ends: How many of its ends are sharp, 1 or 2.
        shortest: Length from which an edge is flagged [mm].
        flagged: Result, 0 at first, (m, 3).

    Returns:
        Number of flagged sides.
    """
    count = 0
    for f in range(len(faces)):
        for c in range(3):
            a, b = faces[f, c], faces[f, (c + 1) % 3]
            if (bend[a] > 0.0) + (bend[b] > 0.0) != ends or crease[f, c] == 2:
                continue
            side = 0.0
            for k in range(3):
                side += (vertices[b, k] - vertices[a, k]) ** 2
            if side > shortest * shortest:
                flagged[f, c] = 1
                count += 1
    return count
