# SPDX-License-Identifier: Apache-2.0
"""Kernels for a triangle mesh as a surface: stars, edges, pieces and normals.

All are linear in the number of faces, since a vertex has few neighbours.
"""

from __future__ import annotations

import numpy as np

from vega_planner.compiled import inner_kernel, kernel


@kernel
def vertex_stars(faces, count):
    """List the faces around each vertex.

    Args:
        faces: Vertex indices, shape (m, 3).
        count: Number of vertices n.

    Returns:
        Offsets of shape (n + 1,) and face indices of shape (3 m,): the faces around
        vertex v are `star[offsets[v]:offsets[v + 1]]`, rising.
    """
    offsets = np.zeros(count + 1, np.int64)
    for t in range(faces.shape[0]):
        for c in range(3):
            offsets[faces[t, c] + 1] += 1
    for v in range(count):
        offsets[v + 1] += offsets[v]
    star = np.empty(offsets[count], np.int64)
    place = offsets[:-1].copy()
    for t in range(faces.shape[0]):
        for c in range(3):
            v = faces[t, c]
            star[place[v]] = t
            place[v] += 1
    return offsets, star


@kernel
def unique_edges(faces, offsets, star):
    """Number the edges of a mesh.

    Args:
        faces: Vertex indices, shape (m, 3).
        offsets: Offsets of the stars.
        star: Faces of the stars.

    Returns:
        Edge ends of shape (e, 2), as the first face runs along the edge; the edges of
        each face, shape (m, 3), edge c joining corners c and c + 1; and the two faces
        of each edge, shape (e, 2), the second -1 at a rim.
    """
    count = faces.shape[0]
    ends = np.empty((3 * count, 2), np.int64)
    sides = np.full((3 * count, 2), -1, np.int64)
    face_edges = np.full((count, 3), -1, np.int64)
    n = 0
    for t in range(count):
        for c in range(3):
            i = faces[t, c]
            j = faces[t, (c + 1) % 3]
            found = -1
            for q in range(offsets[i], offsets[i + 1]):
                other = star[q]
                if other >= t:
                    break
                for k in range(3):
                    x = faces[other, k]
                    y = faces[other, (k + 1) % 3]
                    if (x == i and y == j) or (x == j and y == i):
                        found = face_edges[other, k]
                if found >= 0:
                    break
            if found < 0:
                found = n
                ends[n, 0] = i
                ends[n, 1] = j
                sides[n, 0] = t
                n += 1
            elif sides[found, 1] < 0:
                sides[found, 1] = t
            face_edges[t, c] = found
    return ends[:n].copy(), face_edges, sides[:n].copy()


@kernel
def vertex_normals(vertices, faces):
    """Unit normals at the vertices, the faces weighted by their area, shape (n, 3)."""
    out = np.zeros(vertices.shape)
    e = np.empty(3)
    f = np.empty(3)
    for t in range(faces.shape[0]):
        i, j, k = faces[t, 0], faces[t, 1], faces[t, 2]
        for c in range(3):
            e[c] = vertices[j, c] - vertices[i, c]
            f[c] = vertices[k, c] - vertices[i, c]
        for c in range(3):
            a = (c + 1) % 3
            b = (c + 2) % 3
            x = e[a] * f[b] - e[b] * f[a]
            out[i, c] += x
            out[j, c] += x
            out[k, c] += x
    for v in range(out.shape[0]):
        size = (out[v, 0] ** 2 + out[v, 1] ** 2 + out[v, 2] ** 2) ** 0.5
        if size > 0.0:
            for c in range(3):
                out[v, c] /= size
    return out


@kernel
def find_root(parent, v):
    """Find the root of a union-find tree, halving the path on the way."""
    while parent[v] != v:
        parent[v] = parent[parent[v]]
        v = parent[v]
    return v


@kernel
def label_components(ends, labels, count):
    """Join vertices that share an edge and a label.

    Args:
        ends: Edge ends, shape (e, 2).
        labels: Integers of the vertices, shape (n,); only equal ones are joined.
        count: Number of vertices n.

    Returns:
        Component of each vertex, numbered from 0 in the order of the lowest vertex,
        shape (n,), and the number of components.
    """
    parent = np.arange(count)
    for e in range(ends.shape[0]):
        if labels[ends[e, 0]] == labels[ends[e, 1]]:
            a = find_root(parent, ends[e, 0])
            b = find_root(parent, ends[e, 1])
            if a < b:
                parent[b] = a
            elif b < a:
                parent[a] = b
    component = np.empty(count, np.int64)
    n = 0
    for v in range(count):
        root = find_root(parent, v)
        if root == v:
            component[v] = n
            n += 1
        else:
            component[v] = component[root]
    return component, n


@kernel
def components(count, faces, out):
    """Number the connected pieces of a mesh, faces joined by a shared vertex.

    Args:
        count: Number of vertices.
        faces: (m, 3) int64.
        out: (m,) int64, written: piece of each face, numbered by first face.

    Returns:
        Number of pieces.
    """
    parent = np.arange(count)
    for f in range(faces.shape[0]):
        for e in range(1, 3):
            a, b = find_root(parent, faces[f, 0]), find_root(parent, faces[f, e])
            # The smaller one leads, so that a leader comes before all that follow it.
            if a < b:
                parent[b] = a
            else:
                parent[a] = b
    number = np.full(count, -1)
    total = 0
    for f in range(faces.shape[0]):
        a = find_root(parent, faces[f, 0])
        if number[a] < 0:
            number[a] = total
            total += 1
        out[f] = number[a]
    return total


@inner_kernel
def cross_of(vertices, a, b, c, out):
    """Work out the normal of a triangle, as long as twice its area, and that length."""
    total = 0.0
    for k in range(3):
        m, n = (k + 1) % 3, (k + 2) % 3
        out[k] = (vertices[b, m] - vertices[a, m]) * (vertices[c, n] - vertices[a, n]) - (
            vertices[b, n] - vertices[a, n]
        ) * (vertices[c, m] - vertices[a, m])
        total += out[k] * out[k]
    return np.sqrt(total)
