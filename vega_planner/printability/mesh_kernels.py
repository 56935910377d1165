# SPDX-License-Identifier: Apache-2.0
"""Kernels on meshes: pieces, neighbours across edges, and the slope of vertex fields."""

from __future__ import annotations

import math

import numpy as np

from vega_planner.compiled import kernel


@kernel
def _slot(keys, key):
    mask = keys.shape[0] - 1
    h = (key * 0x9E3779B1) & mask
    while keys[h] != -1 and keys[h] != key:
        h = (h + 1) & mask
    return h


@kernel
def face_neighbours(count, faces, out):
    """Find the face across each edge.

    Args:
        count: Number of vertices.
        faces: (m, 3) int64.
        out: (m, 3) int64, written: face across the edge from corner e to e + 1, or -1;
            where more than two faces meet, the first two are joined.
    """
    m = faces.shape[0]
    size = 16
    while size < 6 * m:
        size *= 2
    keys = np.full(size, -1)
    where = np.empty(size, np.int64)
    for f in range(m):
        for e in range(3):
            out[f, e] = -1
    for f in range(m):
        for e in range(3):
            a, b = faces[f, e], faces[f, (e + 1) % 3]
            key = min(a, b) * count + max(a, b)
            h = _slot(keys, key)
            if keys[h] == -1:
                keys[h] = key
                where[h] = 3 * f + e
            elif where[h] >= 0:
                g, d = where[h] // 3, where[h] % 3
                out[f, e] = g
                out[g, d] = f
                where[h] = -2


@kernel
def label_pieces(neighbours, label, piece):
    """Number the connected regions of equal label, faces joined across edges.

    Args:
        neighbours: (m, 3) from `face_neighbours`.
        label: (m,) int64.
        piece: (m,) int64, written, numbered by first face.

    Returns:
        Number of regions.
    """
    m = label.shape[0]
    stack = np.empty(m, np.int64)
    for f in range(m):
        piece[f] = -1
    total = 0
    for seed in range(m):
        if piece[seed] >= 0:
            continue
        piece[seed] = total
        stack[0] = seed
        depth = 1
        while depth > 0:
            depth -= 1
            f = stack[depth]
            for e in range(3):
                g = neighbours[f, e]
                if g >= 0 and piece[g] < 0 and label[g] == label[f]:
                    piece[g] = total
                    stack[depth] = g
                    depth += 1
        total += 1
    return total


@kernel
def limit_slope(vertices, faces, value, rate):
    """Lower a vertex field until it rises by at most `rate` per mm along every edge.

    Args:
        vertices: (n, 3) float64 [mm].
        faces: (m, 3) int64.
        value: (n,) float64, lowered in place.
        rate: Largest slope per mm.
    """
    for sweep in range(200):
        changed = False
        count = faces.shape[0]
        for g in range(count):
            f = g if sweep % 2 == 0 else count - 1 - g
            for e in range(3):
                a, b = faces[f, e], faces[f, (e + 1) % 3]
                d = 0.0
                for x in range(3):
                    d += (vertices[a, x] - vertices[b, x]) ** 2
                rise = rate * math.sqrt(d)
                if value[a] > value[b] + rise + 1e-9:
                    value[a] = value[b] + rise
                    changed = True
                elif value[b] > value[a] + rise + 1e-9:
                    value[b] = value[a] + rise
                    changed = True
        if not changed:
            break
