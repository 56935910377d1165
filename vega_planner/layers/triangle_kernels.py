# SPDX-License-Identifier: Apache-2.0
# mypy: disable-error-code="no-untyped-def"
"""Compiled geometry of a set of triangles: distance to one, and walks from one to the next.

A triangle set is three arrays, in the order of the tree that `tree_kernels` builds over it.
`tri` holds one row of 13 numbers per triangle: corner a, edges ab and ac, unit normal, and a
head start that is added to distances (0 but for the sources of `geodesic`). `corner`,
`ring_start` and `ring` list for each triangle its vertices and for each vertex the triangles
around it.
"""

from __future__ import annotations

import numpy as np

from vega_planner.compiled import inner_kernel, kernel

#: Cosine between the ways to the nearest points of two places next to each other above
#: which walking from either ends at one triangle (8 degrees): they see one smooth sheet.
SAME_BASIN = 0.99


@inner_kernel(error_model="numpy", forceinline=True)
def measure(tri, s, x, y, z):
    """Measure the squared distance from (x, y, z) to triangle s.

    The seven cases are those of Ericson, Real-Time Collision Detection, 5.1.5.

    Returns:
        Squared distance, and where its nearest point is: a + u ab + v ac.
    """
    px, py, pz = x - tri[s, 0], y - tri[s, 1], z - tri[s, 2]
    bx, by, bz = tri[s, 3], tri[s, 4], tri[s, 5]
    cx, cy, cz = tri[s, 6], tri[s, 7], tri[s, 8]
    bb, bc, cc = tri[s, 13], tri[s, 14], tri[s, 15]
    d1 = bx * px + by * py + bz * pz
    d2 = cx * px + cy * py + cz * pz
    u = 0.0
    v = 0.0
    if d1 > 0.0 or d2 > 0.0:
        d3, d4 = d1 - bb, d2 - bc
        d5, d6 = d1 - bc, d2 - cc
        vb = d5 * d2 - d1 * d6
        vc = d1 * d4 - d3 * d2
        va = d3 * d6 - d5 * d4
        if va > 0.0 and vb > 0.0 and vc > 0.0:
            total = 1.0 / (va + vb + vc)
            u = vb * total
            v = vc * total
        elif d3 >= 0.0 and d4 <= d3:
            u = 1.0
        elif vc <= 0.0 and d1 >= 0.0 and d3 <= 0.0:
            u = d1 / bb
        elif d6 >= 0.0 and d5 <= d6:
            v = 1.0
        elif vb <= 0.0 and d2 >= 0.0 and d6 <= 0.0:
            v = d2 / cc
        else:
            v = (d4 - d3) / ((d4 - d3) + (d5 - d6))
            u = 1.0 - v
    px -= u * bx + v * cx
    py -= u * by + v * cy
    pz -= u * bz + v * cz
    d2 = px * px + py * py + pz * pz
    start = tri[s, 12]
    if start > 0.0:
        # A source with a head start acts as if it stood that much farther away.
        d2 = (np.sqrt(d2) + start) ** 2
    return d2, u, v


@inner_kernel
def off_plane(tri, s, x, y, z):
    """Signed distance of a point from the plane of a triangle: none of it is nearer."""
    return (
        tri[s, 9] * (x - tri[s, 0]) + tri[s, 10] * (y - tri[s, 1]) + tri[s, 11] * (z - tri[s, 2])
    )


@inner_kernel
def measure_below(tri, s, x, y, z, bound):
    """Squared distance of a point from triangle s where it is below a bound, else the bound."""
    px, py, pz = x - tri[s, 0], y - tri[s, 1], z - tri[s, 2]
    off = tri[s, 9] * px + tri[s, 10] * py + tri[s, 11] * pz
    off *= off
    rest = bound - off
    if rest <= 0.0:
        return bound
    # All of it is in a disc about its first corner.
    square = max(tri[s, 13], tri[s, 15])
    beside = px * px + py * py + pz * pz - off - square - rest
    if beside > 0.0 and beside * beside > 4.000001 * square * rest:
        return bound
    return min(measure(tri, s, x, y, z)[0], bound)


@inner_kernel(error_model="numpy")
def foot(tri, s, u, v, x, y, z):
    """Place the point a + u ab + v ac of triangle s, as seen from (x, y, z)."""
    qx = tri[s, 0] + u * tri[s, 3] + v * tri[s, 6]
    qy = tri[s, 1] + u * tri[s, 4] + v * tri[s, 7]
    qz = tri[s, 2] + u * tri[s, 5] + v * tri[s, 8]
    start = tri[s, 12]
    if start > 0.0:
        e = np.sqrt((x - qx) ** 2 + (y - qy) ** 2 + (z - qz) ** 2)
        if e > 1e-9:
            f = start / e
            qx += f * (qx - x)
            qy += f * (qy - y)
            qz += f * (qz - z)
        else:
            qz -= start
    return qx, qy, qz


@inner_kernel
def closest(tri, s, x, y, z):
    """Find the point of triangle s nearest to (x, y, z).

    Returns:
        Squared distance, and the point's coordinates.
    """
    d2, u, v = measure(tri, s, x, y, z)
    qx, qy, qz = foot(tri, s, u, v, x, y, z)
    return d2, qx, qy, qz


@inner_kernel
def heaviest(u, v):
    """Tell which corner the point a + u ab + v ac of a triangle belongs to most."""
    w = 1.0 - u - v
    if w >= u and w >= v:
        return 0
    return 1 if u >= v else 2


@kernel
def lay_rows(vertices, faces, order, first, last, tri):
    """Lay out triangles first:last in tree order: corner, two edges, unit normal.

    Args:
        vertices: Points [mm], (n, 3).
        faces: Vertex indices, (m, 3).
        order: The face of each row, (m,).
        first: First row.
        last: End of the rows.
        tri: Result, 0 at first, (m, 16).
    """
    for s in range(first, last):
        f = order[s]
        for k in range(3):
            a = vertices[faces[f, 0], k]
            tri[s, k] = a
            tri[s, 3 + k] = vertices[faces[f, 1], k] - a
            tri[s, 6 + k] = vertices[faces[f, 2], k] - a
        nx = tri[s, 4] * tri[s, 8] - tri[s, 5] * tri[s, 7]
        ny = tri[s, 5] * tri[s, 6] - tri[s, 3] * tri[s, 8]
        nz = tri[s, 3] * tri[s, 7] - tri[s, 4] * tri[s, 6]
        length = np.sqrt(nx * nx + ny * ny + nz * nz)
        if length > 0.0:
            tri[s, 9] = nx / length
            tri[s, 10] = ny / length
            tri[s, 11] = nz / length
        for k in range(3):
            tri[s, 13] += tri[s, 3 + k] * tri[s, 3 + k]
            tri[s, 14] += tri[s, 3 + k] * tri[s, 6 + k]
            tri[s, 15] += tri[s, 6 + k] * tri[s, 6 + k]


@kernel
def rings(faces, order, vertex_count):
    """List the triangles around each vertex, as slots in tree order.

    Vertices are numbered as the triangles meet them, so that the rings of neighbours are
    neighbours in memory.
    """
    corner = np.zeros((len(order), 3), np.int32)
    number = np.full(vertex_count, -1)
    start = np.zeros(vertex_count + 1, np.int64)
    met = 0
    for s in range(len(order)):
        for c in range(3):
            v = faces[order[s], c]
            if number[v] < 0:
                number[v] = met
                met += 1
            corner[s, c] = number[v]
            start[number[v] + 1] += 1
    for v in range(met):
        start[v + 1] += start[v]
    start = start[: met + 1].copy()
    fill = start[:-1].copy()
    ring = np.zeros(3 * len(order), np.int32)
    for s in range(len(order)):
        for c in range(3):
            v = corner[s, c]
            ring[fill[v]] = s
            fill[v] += 1
    return corner, start, ring


@inner_kernel(forceinline=True)
def is_farther(tri, s, x, y, z, qx, qy, qz, least):
    """Tell at little cost that no point of triangle s is nearer to (x, y, z) than q.

    It is not where its plane is as far away, nor where all of it lies beyond the plane
    through q across the way to q.

    Args:
        qx: A point of another triangle.
        qy: The same.
        qz: The same.
        least: Squared distance to q.
    """
    gx, gy, gz = x - qx, y - qy, z - qz
    px, py, pz = tri[s, 0] - qx, tri[s, 1] - qy, tri[s, 2] - qz
    corner = gx * px + gy * py + gz * pz
    along = gx * tri[s, 3] + gy * tri[s, 4] + gz * tri[s, 5]
    other = gx * tri[s, 6] + gy * tri[s, 7] + gz * tri[s, 8]
    if corner + max(along, other, 0.0) <= 2.5e-13 * least:
        return True
    off = off_plane(tri, s, x, y, z)
    return off * off >= least


@inner_kernel
def walk(tri, corner, ring_start, ring, s, x, y, z, known=-1):
    """Step from triangle to triangle round the vertex next to the foot, downhill.

    Args:
        known: Where a walk to this point has ended already, so that this one ends there too.

    Returns:
        Slot and squared distance of a local minimum, and the nearest point on it.
    """
    least, u, v = measure(tri, s, x, y, z)
    qx, qy, qz = foot(tri, s, u, v, x, y, z)
    done = -1
    while s != known:
        vertex = corner[s, heaviest(u, v)]
        if vertex == done:
            break
        done = vertex
        for j in range(ring_start[vertex], ring_start[vertex + 1]):
            n = ring[j]
            if n == s or is_farther(tri, n, x, y, z, qx, qy, qz, least):
                continue
            d2, a, b = measure(tri, n, x, y, z)
            if d2 < least * (1.0 - 1e-12):
                least = d2
                s = n
                u, v = a, b
                qx, qy, qz = foot(tri, s, u, v, x, y, z)
    return s, least, qx, qy, qz


@inner_kernel
def walk_from(tri, corner, ring_start, ring, sa, sb, sc, x, y, z):
    """Walk from three triangles; from one that a walk began or ended at it leads no farther.

    Returns:
        Slot and squared distance of the nearest local minimum.
    """
    s, least, _, _, _ = walk(tri, corner, ring_start, ring, sa, x, y, z)
    first, second = s, s
    if sb not in (sa, s):
        second, d2, _, _, _ = walk(tri, corner, ring_start, ring, sb, x, y, z, s)
        if d2 < least:
            s, least = second, d2
    if sc not in (sa, sb, first, second):
        q, d2, _, _, _ = walk(tri, corner, ring_start, ring, sc, x, y, z, s)
        if d2 < least:
            s, least = q, d2
    return s, least


@inner_kernel
def is_among(values, count, value):
    """Tell whether a value is one of the first so many."""
    found = False
    for k in range(count):
        found = found or values[k] == value
    return found
