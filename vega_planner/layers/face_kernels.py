# SPDX-License-Identifier: Apache-2.0
# mypy: disable-error-code="no-untyped-def"
"""Compiled joining of the vertices of level sets to faces, and sorting of both by level."""

from __future__ import annotations

import numpy as np

from vega_planner.compiled import inner_kernel, kernel
from vega_planner.layers.contour_kernels import is_real
from vega_planner.layers.grid_kernels import INSIDE
from vega_planner.layers.triangle_kernels import walk


@inner_kernel
def vertex_of(level, corner_step, counts, members, base, cell, lev, edge):
    """Number the vertex that an edge of a cell has at a level."""
    low = level[cell]
    for c in range(1, 8):
        low = min(low, level[cell + corner_step[c]])
    vertex = base[cell]
    for q in range(low, lev + 1):
        inside = 0
        for c in range(8):
            if level[cell + corner_step[c]] > q:
                inside |= 1 << c
        if q == lev:
            return vertex + members[inside, edge]
        vertex += counts[inside]
    return -1


@kernel
def count_crossings(level, state, ny, nz, first, last):
    """Count where edges of the grid cross levels, and may do so inside the part."""
    step = (ny * nz, nz, 1)
    total = 0
    for i in range(first, last):
        for j in range(1, ny - 1):
            for k in range(1, nz - 1):
                n = (i * ny + j) * nz + k
                for axis in range(3):
                    m = n + step[axis]
                    if state[n] == INSIDE or state[m] == INSIDE:
                        total += abs(np.int64(level[n]) - level[m])
    return total


@kernel
def make_quads(
    tri,
    origin,
    h,
    state,
    d,
    slot,
    level,
    leave,
    r0,
    t,
    counts,
    members,
    corner_step,
    ny,
    nz,
    first,
    last,
    base,
    quads,
):
    """Join the vertices around each crossed edge, outward side up.

    Returns:
        Number of quads.
    """
    step = (ny * nz, nz, 1)
    total = 0
    ring = np.zeros(4, np.int64)
    for i in range(first, last):
        for j in range(1, ny - 1):
            for k in range(1, nz - 1):
                n = (i * ny + j) * nz + k
                for axis in range(3):
                    m = n + step[axis]
                    la, lb = level[n], level[m]
                    if la == lb or (state[n] != INSIDE and state[m] != INSIDE):
                        continue
                    s1, s2 = step[(axis + 1) % 3], step[(axis + 2) % 3]
                    for lev in range(min(la, lb), max(la, lb)):
                        r = r0 + t * lev
                        if not is_real(
                            tri, origin, h, state, d, slot, leave, n, axis, step[axis], ny, nz, r
                        ):  # fmt: skip
                            continue
                        ring[0] = vertex_of(
                            level, corner_step, counts, members, base, n, lev, 4 * axis
                        )
                        ring[1] = vertex_of(
                            level, corner_step, counts, members, base, n - s1, lev, 4 * axis + 1
                        )
                        ring[2] = vertex_of(
                            level, corner_step, counts, members, base, n - s1 - s2, lev,
                            4 * axis + 3,
                        )  # fmt: skip
                        ring[3] = vertex_of(
                            level, corner_step, counts, members, base, n - s2, lev, 4 * axis + 2
                        )
                        for q in range(4):
                            quads[total, q] = ring[q] if la > lb else ring[3 - q]
                        total += 1
    return total


@kernel
def split_quads(
    tri,
    corner,
    ring_start,
    ring,
    position,
    vertex_level,
    vertex_slot,
    inward,
    quads,
    count,
    r0,
    t,
    faces,
):
    """Split each quad along the diagonal that lies nearer to the level set."""
    for q in range(count):
        a, b, c, e = quads[q, 0], quads[q, 1], quads[q, 2], quads[q, 3]
        r = r0 + t * vertex_level[a]
        bulge_ac, bulge_be = 0.0, 0.0
        ab, bc, ce, ea = 0.0, 0.0, 0.0, 0.0
        for x in range(3):
            bulge_ac += (position[c, x] - position[a, x]) * (inward[c, x] - inward[a, x])
            bulge_be += (position[e, x] - position[b, x]) * (inward[e, x] - inward[b, x])
            ab += inward[a, x] * inward[b, x]
            bc += inward[b, x] * inward[c, x]
            ce += inward[c, x] * inward[e, x]
            ea += inward[e, x] * inward[a, x]
        turn = min(ab, bc, ce, ea)
        along = abs(bulge_ac) <= abs(bulge_be)
        if turn < 0.9:
            _, d2, _, _, _ = walk(
                tri, corner, ring_start, ring, vertex_slot[a],
                0.5 * (position[a, 0] + position[c, 0]),
                0.5 * (position[a, 1] + position[c, 1]),
                0.5 * (position[a, 2] + position[c, 2]),
            )  # fmt: skip
            _, e2, _, _, _ = walk(
                tri, corner, ring_start, ring, vertex_slot[b],
                0.5 * (position[b, 0] + position[e, 0]),
                0.5 * (position[b, 1] + position[e, 1]),
                0.5 * (position[b, 2] + position[e, 2]),
            )  # fmt: skip
            along = abs(np.sqrt(d2) - r) <= abs(np.sqrt(e2) - r)
        if along:
            faces[2 * q] = (a, b, c)
            faces[2 * q + 1] = (a, c, e)
        else:
            faces[2 * q] = (a, b, e)
            faces[2 * q + 1] = (b, c, e)


@kernel
def count_by_level(vertex_level, faces, used, counts):
    """Count the faces of each level, and mark their vertices as used."""
    for f in range(len(faces)):
        for e in range(3):
            used[faces[f, e]] = 1
        counts[vertex_level[faces[f, 0]]] += 1


@kernel
def number_by_level(vertex_level, used, start, rows, number):
    """List the used vertices level by level.

    Args:
        vertex_level: Level of each vertex.
        used: 1 for vertices of faces.
        start: Result: where each level begins, (levels + 1,); zero at first.
        rows: Result: the vertices of all levels one after the other.
        number: Result: number of each vertex within its level.
    """
    for v in range(len(used)):
        if used[v]:
            start[vertex_level[v] + 1] += 1
    for lev in range(len(start) - 1):
        start[lev + 1] += start[lev]
    fill = start.copy()
    for v in range(len(used)):
        if used[v]:
            lev = vertex_level[v]
            rows[fill[lev]] = v
            number[v] = fill[lev] - start[lev]
            fill[lev] += 1


@kernel
def sort_by_level(vertex_level, faces, number, fill, sorted_faces):
    """Put faces in the places of their levels, with the numbers of their corners there."""
    for f in range(len(faces)):
        lev = vertex_level[faces[f, 0]]
        for e in range(3):
            sorted_faces[fill[lev], e] = number[faces[f, e]]
        fill[lev] += 1
