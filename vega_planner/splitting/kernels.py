# SPDX-License-Identifier: Apache-2.0
"""Kernels of splitting: spread points, border edges, distances, and the cut of triangles."""

from __future__ import annotations

import numpy as np

from vega_planner.compiled import kernel


@kernel
def spread_points(points, out):
    """Farthest-point sampling from point 0; fills `out` with indices."""
    n = points.shape[0]
    near = np.full(n, np.inf)
    at = 0
    for k in range(out.shape[0]):
        out[k] = at
        far = -1.0
        nxt = 0
        for i in range(n):
            d = 0.0
            for x in range(3):
                d += (points[i, x] - points[at, x]) ** 2
            if d < near[i]:
                near[i] = d
            if near[i] > far:
                far = near[i]
                nxt = i
        at = nxt


@kernel
def squared_distances(a, b, out):
    """Squared distances between all of a (n, 3) and all of b (m, 3) into out (n, m)."""
    for i in range(a.shape[0]):
        for j in range(b.shape[0]):
            d = 0.0
            for x in range(3):
                d += (a[i, x] - b[j, x]) ** 2
            out[i, j] = d


@kernel
def _slot(keys, key):
    mask = keys.shape[0] - 1
    h = (key * 0x9E3779B1) & mask
    while keys[h] != -1 and keys[h] != key:
        h = (h + 1) & mask
    return h


@kernel
def _put(new_faces, source, side, k, a, b, c, face, positive):
    new_faces[k, 0] = a
    new_faces[k, 1] = b
    new_faces[k, 2] = c
    source[k] = face
    side[k] = positive


@kernel
def cut_faces(vertices, faces, value, new_faces, source, ends, weight, side):
    """Cut triangles along the zero line of a vertex field, with shared cut vertices.

    Args:
        vertices: (n, 3) float64.
        faces: (m, 3) int64.
        value: (n,) float64, linear on each triangle; no value is so close to zero that
            a sliver would come out, but exact zeros are allowed.
        new_faces: (3 m, 3) int64, written.
        source: (3 m,) int64, written: face each piece came from.
        ends: (2 m + n, 2) int64, written: ends of the edge each cut vertex lies on.
        weight: (2 m + n,) float64, written: share of the second end.
        side: (3 m,) bool, written: True where the piece is on the positive side.

    Returns:
        Number of pieces, number of cut vertices.
    """
    n, m = vertices.shape[0], faces.shape[0]
    crossing = 0
    for f in range(m):
        low = min(value[faces[f, 0]], min(value[faces[f, 1]], value[faces[f, 2]]))
        high = max(value[faces[f, 0]], max(value[faces[f, 1]], value[faces[f, 2]]))
        if low < 0 < high:
            crossing += 1
    size = 16
    while size < 6 * crossing + 4:
        size *= 2
    keys = np.full(size, -1)
    where = np.empty(size, np.int64)
    cuts = 0
    made = 0
    at = np.empty(3, np.int64)
    for f in range(m):
        positive = 0
        negative = 0
        for e in range(3):
            v = value[faces[f, e]]
            positive += v > 0
            negative += v < 0
        if positive == 0 or negative == 0:
            for e in range(3):
                new_faces[made, e] = faces[f, e]
            source[made] = f
            total = value[faces[f, 0]] + value[faces[f, 1]] + value[faces[f, 2]]
            side[made] = total > 0
            made += 1
            continue
        for e in range(3):
            a, b = faces[f, e], faces[f, (e + 1) % 3]
            at[e] = -1
            if value[a] * value[b] >= 0:
                continue
            low, high = min(a, b), max(a, b)
            key = low * n + high
            h = _slot(keys, key)
            if keys[h] == -1:
                keys[h] = key
                where[h] = n + cuts
                ends[cuts, 0] = low
                ends[cuts, 1] = high
                weight[cuts] = value[low] / (value[low] - value[high])
                cuts += 1
            at[e] = where[h]
        # turn the face so that corner 0 is alone on its side, or lies on the line
        first = 0
        for e in range(3):
            v = value[faces[f, e]]
            if v == 0:
                first = e
                break
            if (v > 0 and positive == 1 and negative == 2) or (
                v < 0 and negative == 1 and positive == 2
            ):
                first = e
        a = faces[f, first]
        b = faces[f, (first + 1) % 3]
        c = faces[f, (first + 2) % 3]
        ab, bc, ca = at[first], at[(first + 1) % 3], at[(first + 2) % 3]
        if value[a] == 0:
            _put(new_faces, source, side, made, a, b, bc, f, value[b] > 0)
            _put(new_faces, source, side, made + 1, a, bc, c, f, value[c] > 0)
            made += 2
            continue
        _put(new_faces, source, side, made, a, ab, ca, f, value[a] > 0)
        _put(new_faces, source, side, made + 1, ab, b, c, f, value[b] > 0)
        _put(new_faces, source, side, made + 2, ab, c, ca, f, value[b] > 0)
        made += 3
    return made, cuts
