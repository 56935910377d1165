# SPDX-License-Identifier: Apache-2.0
"""All integer isolines of a vertex field in one pass over the mesh."""

from __future__ import annotations

import math

import numpy as np

from vega_planner.compiled import kernel


@kernel
def _levels_between(a, b, top):
    """First level in the open interval of a and b, and how many there are."""
    low = min(a, b)
    high = max(a, b)
    first = max(math.ceil(low), 0)
    last = min(math.floor(high), top)
    return first, max(0, last - first + 1)


@kernel
def trace_isolines(edges, face_edges, f, top):
    """Find the isolines f = 0, 1, ... top and chain them.

    Args:
        edges: Edge ends, shape (e, 2).
        face_edges: Edges of the faces, shape (m, 3).
        f: Field at the vertices, none of them on a level, shape (n,).
        top: Highest level wanted.

    Returns:
        For every crossing, in the order of the lines: its edge (k,), the place on the
        edge in 0..1 (k,) and its level (k,); the start of each line, shape (l + 1,);
        whether it is closed (the first point is not repeated), shape (l,). Higher
        values lie to the left of a line, seen from the side the normals point to.
    """
    count = edges.shape[0]
    start = np.zeros(count + 1, np.int64)
    first = np.zeros(count, np.int64)
    for e in range(count):
        first[e], n = _levels_between(f[edges[e, 0]], f[edges[e, 1]], top)
        start[e + 1] = start[e] + n
    total = start[count]
    edge = np.empty(total, np.int64)
    for e in range(count):
        for q in range(start[e], start[e + 1]):
            edge[q] = e
    # Walking round a counter-clockwise face, the line enters through the edge on which
    # the field falls and leaves through the one on which it rises: high on its left.
    following = np.full(total, -1, np.int64)
    preceding = np.full(total, -1, np.int64)
    return _chain(edges, face_edges, f, top, start, first, edge, following, preceding)


@kernel
def _chain(edges, face_edges, f, top, start, first, edge, following, preceding):
    total = edge.shape[0]
    for t in range(face_edges.shape[0]):
        low = 1e300
        high = -1e300
        for c in range(3):
            e = face_edges[t, c]
            low = min(low, f[edges[e, 0]], f[edges[e, 1]])
            high = max(high, f[edges[e, 0]], f[edges[e, 1]])
        k0, n = _levels_between(low, high, top)
        if n == 0:
            continue
        for k in range(k0, k0 + n):
            rising = -1
            falling = -1
            for c in range(3):
                e = face_edges[t, c]
                q = start[e] + k - first[e]
                if k < first[e] or q >= start[e + 1]:
                    continue
                # corner c is the end of edge c that it does not share with edge c + 1
                i = edges[e, 0]
                after = face_edges[t, (c + 1) % 3]
                if edges[after, 0] == i or edges[after, 1] == i:
                    i = edges[e, 1]
                if f[i] < k:
                    rising = q
                else:
                    falling = q
            if rising >= 0 and falling >= 0:
                following[falling] = rising
                preceding[rising] = falling
    order = np.empty(total, np.int64)
    level = np.empty(total, np.int64)
    seen = np.zeros(total, np.bool_)
    begin = np.empty(total + 1, np.int64)
    closed = np.zeros(total, np.bool_)
    filled = 0
    lines = 0
    for turn in range(2):
        for q in range(total):
            if seen[q] or (turn == 0 and preceding[q] >= 0):
                continue
            begin[lines] = filled
            closed[lines] = turn == 1
            lines += 1
            at = q
            while at >= 0 and not seen[at]:
                seen[at] = True
                order[filled] = at
                filled += 1
                at = following[at]
    begin[lines] = filled
    place = np.empty(total)
    where = np.empty(total, np.int64)
    for q in range(filled):
        x = order[q]
        e = edge[x]
        k = first[e] + x - start[e]
        a = f[edges[e, 0]]
        b = f[edges[e, 1]]
        level[q] = k
        where[q] = e
        place[q] = (k - a) / (b - a)
    return where, place, level, begin[: lines + 1].copy(), closed[:lines].copy()


@kernel
def gather(edges, where, place, values):
    """Interpolate vertex values at crossings.

    Args:
        edges: Edge ends, shape (e, 2).
        where: Edge of each crossing, shape (k,).
        place: Place on the edge, shape (k,).
        values: Vertex values, shape (n, c).

    Returns:
        Values at the crossings, shape (k, c).
    """
    out = np.empty((where.shape[0], values.shape[1]))
    for q in range(where.shape[0]):
        i = edges[where[q], 0]
        j = edges[where[q], 1]
        w = place[q]
        for c in range(values.shape[1]):
            out[q, c] = (1.0 - w) * values[i, c] + w * values[j, c]
    return out


@kernel
def area_above(vertices, faces, f, level, component, count):
    """Measure, for each component of vertices, the area where f is above its level.

    Args:
        vertices: Points, shape (n, 3).
        faces: Vertex indices, shape (m, 3).
        f: Field, shape (n,).
        level: Level of each component, shape (count,).
        component: Component of each vertex, shape (n,).
        count: Number of components.

    Returns:
        Areas, shape (count,). A face belongs to the component of its highest corner.
    """
    area = np.zeros(count)
    for t in range(faces.shape[0]):
        i = faces[t, 0]
        j = faces[t, 1]
        k = faces[t, 2]
        if f[j] > f[i]:
            i, j = j, i
        if f[k] > f[j]:
            j, k = k, j
            if f[j] > f[i]:
                i, j = j, i
        c = component[i]
        z = level[c]
        if f[i] <= z:
            continue
        ax = vertices[j] - vertices[i]
        bx = vertices[k] - vertices[i]
        nx = ax[1] * bx[2] - ax[2] * bx[1]
        ny = ax[2] * bx[0] - ax[0] * bx[2]
        nz = ax[0] * bx[1] - ax[1] * bx[0]
        whole = 0.5 * math.sqrt(nx * nx + ny * ny + nz * nz)
        if f[k] >= z:
            part = 1.0
        elif f[j] >= z:
            part = 1.0 - (z - f[k]) ** 2 / ((f[i] - f[k]) * (f[j] - f[k]))
        else:
            part = (f[i] - z) ** 2 / ((f[i] - f[j]) * (f[i] - f[k]))
        area[c] += part * whole
    return area
