# SPDX-License-Identifier: Apache-2.0
# mypy: disable-error-code="no-untyped-def"
"""Compiled parting of a sheet where fans of its faces share but a vertex."""

from __future__ import annotations

import numpy as np

from vega_planner.compiled import kernel


@kernel
def part_fans(faces, marked, count):
    """Give each fan of faces round a marked vertex, but the first, a vertex of its own.

    Args:
        faces: Vertex indices, changed in place, (m, 3).
        marked: 1 for the vertices that are looked at, (n,).
        count: Number of the first vertex that is added.

    Returns:
        For each vertex that is added the one it copies.
    """
    offsets = np.zeros(len(marked) + 1, np.int64)
    for f in range(len(faces)):
        for c in range(3):
            if marked[faces[f, c]]:
                offsets[faces[f, c] + 1] += 1
    for v in range(len(marked)):
        offsets[v + 1] += offsets[v]
    around, place = np.zeros(offsets[-1], np.int64), offsets[:-1].copy()
    for f in range(len(faces)):
        for c in range(3):
            v = faces[f, c]
            if marked[v]:
                around[place[v]] = 3 * f + c
                place[v] += 1
    copied, made = np.zeros(len(around), np.int64), 0
    for v in range(len(marked)):
        first, left = offsets[v], offsets[v + 1] - offsets[v]
        while left > 0:
            # The fan of the first face that is left comes to the front.
            size, done = 1, 0
            while done < size:
                f, c = around[first + done] // 3, around[first + done] % 3
                ahead, behind = faces[f, (c + 1) % 3], faces[f, (c + 2) % 3]
                for i in range(size, left):
                    g, e = around[first + i] // 3, around[first + i] % 3
                    p, q = faces[g, (e + 1) % 3], faces[g, (e + 2) % 3]
                    if p in (ahead, behind) or q in (ahead, behind):
                        around[first + i] = around[first + size]
                        around[first + size] = 3 * g + e
                        size += 1
                done += 1
            if first > offsets[v]:
                for i in range(first, first + size):
                    faces[around[i] // 3, around[i] % 3] = count + made
                copied[made] = v
                made += 1
            first += size
            left -= size
    return copied[:made].copy()
