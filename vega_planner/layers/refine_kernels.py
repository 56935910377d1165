# SPDX-License-Identifier: Apache-2.0
# mypy: disable-error-code="no-untyped-def"
"""Compiled search for edges of a sheet that leave the level set between their ends."""

from __future__ import annotations

import numpy as np
from numba import njit

from vega_planner.layers.triangle_kernels import closest, nearest, walk


@njit(nogil=True, cache=True)
def flag_edges(
    tri,
    corner,
    ring_start,
    ring,
    vertices,
    inward,
    slots,
    faces,
    first,
    last,
    r,
    tolerance,
    flagged,
):
    """Flag the edges whose middle is farther than `tolerance` from the level set.

    The turn of the gradient along an edge tells how far a smooth sheet bulges; only
    where that is not small is the middle measured.

    Returns:
        Number of flags set.
    """
    total = 0
    for f in range(first, last):
        for c in range(3):
            a, b = faces[f, c], faces[f, (c + 1) % 3]
            if a > b:
                a, b = b, a
            bulge = 0.0
            turn = 0.0
            for k in range(3):
                bulge += (vertices[b, k] - vertices[a, k]) * (inward[b, k] - inward[a, k])
                turn += inward[b, k] * inward[a, k]
            if turn > 0.8:
                # A smooth sheet bulges by an eighth of length times turn.
                if abs(bulge) > 8.0 * tolerance:
                    flagged[f, c] = 1
                    total += 1
                continue
            if turn < -0.2:
                # The edge joins two sides of a sliver that ends here; halving it would
                # only make more such edges.
                continue
            x = 0.5 * (vertices[a, 0] + vertices[b, 0])
            y = 0.5 * (vertices[a, 1] + vertices[b, 1])
            z = 0.5 * (vertices[a, 2] + vertices[b, 2])
            _, d2, _, _, _ = walk(tri, corner, ring_start, ring, slots[a], x, y, z)
            _, e2, _, _, _ = walk(tri, corner, ring_start, ring, slots[b], x, y, z)
            if abs(np.sqrt(min(d2, e2)) - r) > tolerance:
                flagged[f, c] = 1
                total += 1
    return total


@njit(nogil=True, cache=True)
def place_middles(
    tri,
    corner,
    ring_start,
    ring,
    box,
    brr_tri,
    brr_box,
    vertices,
    slots,
    ends,
    on_rim,
    r,
    inward,
    middles,
    middle_inward,
    middle_slots,
):
    """Put the middles of edges onto the level set, and those of the rim onto the region."""
    stack = np.zeros(64, np.int64)
    lower = np.zeros(64)
    for i in range(len(ends)):
        a, b = ends[i, 0], ends[i, 1]
        x = 0.5 * (vertices[a, 0] + vertices[b, 0])
        y = 0.5 * (vertices[a, 1] + vertices[b, 1])
        z = 0.5 * (vertices[a, 2] + vertices[b, 2])
        s = slots[a]
        _, d2, _, _, _ = walk(tri, corner, ring_start, ring, s, x, y, z)
        _, e2, _, _, _ = walk(tri, corner, ring_start, ring, slots[b], x, y, z)
        if e2 < d2:
            s = slots[b]
        turn = 0.0
        for k in range(3):
            turn += inward[a, k] * inward[b, k]
        checked = False
        for _ in range(6):
            s, d2, fx, fy, fz = walk(tri, corner, ring_start, ring, s, x, y, z)
            e = max(np.sqrt(d2), 1e-9)
            if abs(e - r) < 0.05 and turn < 0.9 and len(box) > 0 and not checked:
                # Across a crease another sheet may be nearer than walking tells.
                checked = True
                bound = max(e - 0.01, 0.0)
                q, _ = nearest(tri, box, x, y, z, -1, bound * bound, stack, lower)
                if q >= 0:
                    checked = False
                    s = q
                    d2, fx, fy, fz = closest(tri, s, x, y, z)
                    e = max(np.sqrt(d2), 1e-9)
            if abs(e - r) < 1e-4:
                break
            x = fx + (x - fx) * r / e
            y = fy + (y - fy) * r / e
            z = fz + (z - fz) * r / e
            if on_rim[i]:
                q, _ = nearest(brr_tri, brr_box, x, y, z, -1, 1e300, stack, lower)
                _, x, y, z = closest(brr_tri, q, x, y, z)
        d2, fx, fy, fz = closest(tri, s, x, y, z)
        e = max(np.sqrt(d2), 1e-9)
        middles[i, 0], middles[i, 1], middles[i, 2] = x, y, z
        middle_inward[i, 0] = (x - fx) / e
        middle_inward[i, 1] = (y - fy) / e
        middle_inward[i, 2] = (z - fz) / e
        middle_slots[i] = s
