# SPDX-License-Identifier: Apache-2.0
# mypy: disable-error-code="no-untyped-def"
"""Compiled numbering and splitting of chosen edges of a triangle mesh."""

from __future__ import annotations

import numpy as np

from vega_planner.compiled import kernel


@kernel
def place_of(key, bits):
    """Scatter an edge's key over a table of 2^bits places."""
    return np.int64((np.uint64(key) * np.uint64(0x9E3779B97F4A7C15)) >> np.uint64(64 - bits))


@kernel
def edge_key(a, b):
    """Pack an edge into one number, the same from both ends."""
    return (a << 32) | b if a < b else (b << 32) | a


@kernel
def number_edges(faces, first, flagged, bits, keys, numbers, ends):
    """Number the flagged edges of faces first: in the order in which they come.

    Args:
        faces: Vertex indices, (m, 3).
        first: First face that has flags.
        flagged: Flags of the edges from corner c to c + 1 of those faces, (m - first, 3).
        bits: Bits of the table.
        keys: Result: table of edges, -1 at first, (2^bits,).
        numbers: Result: their numbers, (2^bits,).
        ends: Result: corners of the edges, lower first, (e, 2).

    Returns:
        Number of edges.
    """
    mask = (1 << bits) - 1
    count = 0
    for f in range(len(flagged)):
        for c in range(3):
            if flagged[f, c] == 0:
                continue
            key = edge_key(faces[first + f, c], faces[first + f, (c + 1) % 3])
            p = place_of(key, bits)
            while keys[p] >= 0 and keys[p] != key:
                p = (p + 1) & mask
            if keys[p] == key:
                continue
            keys[p] = key
            numbers[p] = count
            ends[count, 0] = key >> 32
            ends[count, 1] = key & 0xFFFFFFFF
            count += 1
    return count


@kernel
def count_whole(middle):
    """Count the faces without a split edge, and the faces that the others become."""
    whole, made = 0, 0
    for f in range(len(middle)):
        split = 0
        for c in range(3):
            split += middle[f, c] >= 0
        if split:
            made += split + 1
        else:
            whole += 1
    return whole, made


@kernel
def find_middles(faces, at_edge, bits, keys, numbers, start, middle, uses):
    """Look up which edges of all faces are numbered.

    Args:
        at_edge: 1 for the ends of numbered edges.
        start: Vertex at the middle of edge 0.
        middle: Result: vertex at the middle of the edge from corner c to c + 1, or -1.
        uses: Result: how many faces have each edge.

    Returns:
        Faces without a numbered edge, and the faces the others become.
    """
    mask = (1 << bits) - 1
    for f in range(len(faces)):
        for c in range(3):
            middle[f, c] = -1
            a, b = faces[f, c], faces[f, (c + 1) % 3]
            if at_edge[a] == 0 or at_edge[b] == 0:
                continue
            key = edge_key(a, b)
            p = place_of(key, bits)
            while keys[p] >= 0 and keys[p] != key:
                p = (p + 1) & mask
            if keys[p] == key:
                middle[f, c] = start + numbers[p]
                uses[numbers[p]] += 1
    return count_whole(middle)


@kernel
def split_into(faces, middle, whole, out):
    """Split the faces at the middles of their edges: those without one first, in order."""
    kept, made = 0, whole
    for f in range(len(faces)):
        split = 0
        for c in range(3):
            split += middle[f, c] >= 0
        if split == 0:
            for c in range(3):
                out[kept, c] = faces[f, c]
            kept += 1
            continue
        # Turn the face so that its first edge is split (one), or its third is not (two).
        lead = 0
        for c in range(3):
            if split == 1 and middle[f, c] >= 0:
                lead = c
            if split == 2 and middle[f, c] < 0:
                lead = (c + 1) % 3
        a, b, c = faces[f, lead], faces[f, (lead + 1) % 3], faces[f, (lead + 2) % 3]
        p, q, s = middle[f, lead], middle[f, (lead + 1) % 3], middle[f, (lead + 2) % 3]
        if split == 1:
            out[made, 0], out[made, 1], out[made, 2] = a, p, c
            out[made + 1, 0], out[made + 1, 1], out[made + 1, 2] = p, b, c
        elif split == 2:
            out[made, 0], out[made, 1], out[made, 2] = p, b, q
            out[made + 1, 0], out[made + 1, 1], out[made + 1, 2] = a, p, q
            out[made + 2, 0], out[made + 2, 1], out[made + 2, 2] = a, q, c
        else:
            out[made, 0], out[made, 1], out[made, 2] = a, p, s
            out[made + 1, 0], out[made + 1, 1], out[made + 1, 2] = p, b, q
            out[made + 2, 0], out[made + 2, 1], out[made + 2, 2] = s, q, c
            out[made + 3, 0], out[made + 3, 1], out[made + 3, 2] = p, q, s
        made += split + 1
