# SPDX-License-Identifier: Apache-2.0
"""Kernels on voxel grids: filling a closed mesh, exact distances, nearest labels.

A grid value belongs to the point `origin + spacing * index`. All kernels are serial and
release the interpreter lock.
"""

from __future__ import annotations

import math

import numpy as np

from vega_planner.compiled import kernel

FAR = 1e12  # squared distance of a voxel no feature has been found for


@kernel
def _side(ax, ay, bx, by, x, y):
    """Tell on which side of the line a-b the point lies; exactly antisymmetric in a, b."""
    if ax < bx or (ax == bx and ay < by):
        return (bx - ax) * (y - ay) - (by - ay) * (x - ax)
    return -((ax - bx) * (y - by) - (ay - by) * (x - bx))


@kernel
def fill_mesh(vertices, faces, origin, spacing, solid):
    """Set the voxels whose centre lies inside a closed mesh.

    Every triangle adds +1 or -1 to the column cells above it; a cell is inside where the
    running sum up its column is positive.

    Args:
        vertices: (n, 3) float64.
        faces: (m, 3) int64, counter-clockwise from outside.
        origin: (3,) position of voxel 0.
        spacing: Edge of a voxel.
        solid: (nx, ny, nz) bool, written.
    """
    nx, ny, nz = solid.shape
    winding = np.zeros((nx, ny, nz + 1), np.int16)
    for f in range(faces.shape[0]):
        a, b, c = faces[f, 0], faces[f, 1], faces[f, 2]
        ax = (vertices[a, 0] - origin[0]) / spacing
        ay = (vertices[a, 1] - origin[1]) / spacing
        az = (vertices[a, 2] - origin[2]) / spacing
        bx = (vertices[b, 0] - origin[0]) / spacing
        by = (vertices[b, 1] - origin[1]) / spacing
        bz = (vertices[b, 2] - origin[2]) / spacing
        cx = (vertices[c, 0] - origin[0]) / spacing
        cy = (vertices[c, 1] - origin[1]) / spacing
        cz = (vertices[c, 2] - origin[2]) / spacing
        area = (bx - ax) * (cy - ay) - (by - ay) * (cx - ax)
        if area == 0.0:
            continue
        turn = 1 if area > 0 else -1
        i0 = max(0, math.ceil(min(ax, min(bx, cx))))
        i1 = min(nx - 1, math.floor(max(ax, max(bx, cx))))
        j0 = max(0, math.ceil(min(ay, min(by, cy))))
        j1 = min(ny - 1, math.floor(max(ay, max(by, cy))))
        for i in range(i0, i1 + 1):
            x = float(i)
            for j in range(j0, j1 + 1):
                y = float(j)
                # a point on an edge belongs to one of the two triangles only: >= on edges
                # running one way, > on edges running the other
                u = _side(bx, by, cx, cy, x, y)
                v = _side(cx, cy, ax, ay, x, y)
                w = _side(ax, ay, bx, by, x, y)
                if turn < 0:
                    u, v, w = -u, -v, -w
                if u < 0 or v < 0 or w < 0:
                    continue
                if u == 0 and (by > cy or (by == cy and bx > cx)) == (turn > 0):
                    continue
                if v == 0 and (cy > ay or (cy == ay and cx > ax)) == (turn > 0):
                    continue
                if w == 0 and (ay > by or (ay == by and ax > bx)) == (turn > 0):
                    continue
                total = u + v + w
                z = (u * az + v * bz + w * cz) / total
                k = math.ceil(z)
                k = min(max(k, 0), nz)
                winding[i, j, k] += -turn
    for i in range(nx):
        for j in range(ny):
            run = 0
            for k in range(nz):
                run += winding[i, j, k]
                solid[i, j, k] = run > 0


@kernel(inline="always")
def _envelope(f, n, place, edge):
    """Build the lower envelope of the parabolas (q - i)² + f[i]; return its last index."""
    k = -1
    for q in range(n):
        if f[q] >= FAR:
            continue
        if k < 0:
            k = 0
            place[0] = q
            edge[0] = -1e30
            edge[1] = 1e30
            continue
        while True:
            p = place[k]
            s = ((f[q] + q * q) - (f[p] + p * p)) / (2.0 * (q - p))
            if s <= edge[k] and k > 0:
                k -= 1
            else:
                break
        if s <= edge[k]:
            place[0] = q
            edge[0] = -1e30
            edge[1] = 1e30
            k = 0
        else:
            k += 1
            place[k] = q
            edge[k] = s
            edge[k + 1] = 1e30
    return k


@kernel
def distance_to(solid, spacing, out):
    """Compute the exact distance from every voxel to the nearest solid voxel's centre.

    Args:
        solid: (nx, ny, nz) bool.
        spacing: Edge of a voxel [mm].
        out: (nx, ny, nz) float32, written; 1e6 where nothing is solid.

    Source:
        Felzenszwalb and Huttenlocher, Distance transforms of sampled functions, 2012.
    """
    nx, ny, nz = solid.shape
    longest = max(nx, max(ny, nz))
    f = np.empty(longest)
    place = np.empty(longest, np.int64)
    edge = np.empty(longest + 1)
    for i in range(nx):
        for j in range(ny):
            last = -(10**6)
            for k in range(nz):
                if solid[i, j, k]:
                    last = k
                out[i, j, k] = FAR if last < 0 else float((k - last) * (k - last))
            last = 10**7
            for k in range(nz - 1, -1, -1):
                if solid[i, j, k]:
                    last = k
                if last < 10**6:
                    d = float((last - k) * (last - k))
                    if d < out[i, j, k]:
                        out[i, j, k] = d
        for k in range(nz):
            for j in range(ny):
                f[j] = out[i, j, k]
            last = _envelope(f, ny, place, edge)
            if last < 0:
                continue
            p = 0
            for j in range(ny):
                while edge[p + 1] < j:
                    p += 1
                out[i, j, k] = (j - place[p]) ** 2 + f[place[p]]
    for j in range(ny):
        for k in range(nz):
            for i in range(nx):
                f[i] = out[i, j, k]
            last = _envelope(f, nx, place, edge)
            p = 0
            for i in range(nx):
                if last < 0:
                    out[i, j, k] = 1e6
                    continue
                while edge[p + 1] < i:
                    p += 1
                out[i, j, k] = spacing * math.sqrt((i - place[p]) ** 2 + f[place[p]])


@kernel
def nearest_label(label):
    """Spread labels to the voxels that have none: each takes the nearest one's.

    Args:
        label: (nx, ny, nz) int32, -1 where there is none; overwritten.
    """
    nx, ny, nz = label.shape
    longest = max(nx, max(ny, nz))
    f = np.empty(longest)
    name = np.empty(longest, np.int32)
    place = np.empty(longest, np.int64)
    edge = np.empty(longest + 1)
    square = np.empty((nx, ny, nz), np.float32)
    for i in range(nx):
        for j in range(ny):
            for k in range(nz):
                f[k] = 0.0 if label[i, j, k] >= 0 else FAR
                name[k] = label[i, j, k]
            last = _envelope(f, nz, place, edge)
            p = 0
            for k in range(nz):
                if last < 0:
                    square[i, j, k] = FAR
                    continue
                while edge[p + 1] < k:
                    p += 1
                square[i, j, k] = (k - place[p]) ** 2 + f[place[p]]
                label[i, j, k] = name[place[p]]
        for k in range(nz):
            for j in range(ny):
                f[j] = square[i, j, k]
                name[j] = label[i, j, k]
            last = _envelope(f, ny, place, edge)
            if last < 0:
                continue
            p = 0
            for j in range(ny):
                while edge[p + 1] < j:
                    p += 1
                square[i, j, k] = (j - place[p]) ** 2 + f[place[p]]
                label[i, j, k] = name[place[p]]
    for j in range(ny):
        for k in range(nz):
            for i in range(nx):
                f[i] = square[i, j, k]
                name[i] = label[i, j, k]
            last = _envelope(f, nx, place, edge)
            if last < 0:
                continue
            p = 0
            for i in range(nx):
                while edge[p + 1] < i:
                    p += 1
                label[i, j, k] = name[place[p]]


@kernel
def stamp_faces(vertices, faces, origin, spacing, first, label, best):
    """Write each face's number into the voxels its surface passes.

    Faces are sampled no coarser than half a voxel; a voxel keeps the face whose sample
    came nearest to its centre, the first of equals.

    Args:
        vertices: (n, 3) float64.
        faces: (m, 3) int64.
        origin: (3,) position of voxel 0.
        spacing: Edge of a voxel.
        first: Number of face 0.
        label: (nx, ny, nz) int32, updated.
        best: (nx, ny, nz) float32, squared distance in voxels of the sample kept, updated.
    """
    nx, ny, nz = label.shape
    for f in range(faces.shape[0]):
        a, b, c = faces[f, 0], faces[f, 1], faces[f, 2]
        longest = 0.0
        shortest = np.inf
        apex = 0
        for k in range(3):
            d = 0.0
            for x in range(3):
                d += (vertices[faces[f, (k + 1) % 3], x] - vertices[faces[f, (k + 2) % 3], x]) ** 2
            longest = max(longest, d)
            if d < shortest:
                shortest = d
                apex = k
        parts = max(1, math.ceil(math.sqrt(longest) / (0.6 * spacing)))
        across = max(1, math.ceil(math.sqrt(shortest) / (0.6 * spacing)))
        # a needle is sampled along it, with as many samples across as it is wide there
        needle = 3 * across < parts
        if needle:
            a, b, c = faces[f, apex], faces[f, (apex + 1) % 3], faces[f, (apex + 2) % 3]
        for i in range(parts + 1):
            columns = math.ceil((parts - i) * across / parts) if needle else parts - i
            for j in range(columns + 1):
                u = i / parts
                v = (1.0 - u) * j / max(columns, 1) if needle else j / parts
                w = 1.0 - u - v
                x = (u * vertices[a, 0] + v * vertices[b, 0] + w * vertices[c, 0] - origin[0]) / (
                    spacing
                )
                y = (u * vertices[a, 1] + v * vertices[b, 1] + w * vertices[c, 1] - origin[1]) / (
                    spacing
                )
                z = (u * vertices[a, 2] + v * vertices[b, 2] + w * vertices[c, 2] - origin[2]) / (
                    spacing
                )
                k0 = math.floor(x + 0.5)
                k1 = math.floor(y + 0.5)
                k2 = math.floor(z + 0.5)
                if k0 < 0 or k1 < 0 or k2 < 0 or k0 >= nx or k1 >= ny or k2 >= nz:
                    continue
                d = (x - k0) ** 2 + (y - k1) ** 2 + (z - k2) ** 2
                if d < best[k0, k1, k2] - 1e-6:
                    best[k0, k1, k2] = d
                    label[k0, k1, k2] = first + f


@kernel
def select(label, solid, chosen, out):
    """Mark the solid voxels whose label is chosen.

    Args:
        label: (nx, ny, nz) int32, -1 where there is none.
        solid: (nx, ny, nz) bool.
        chosen: (labels,) bool.
        out: (nx, ny, nz) bool, written.

    Returns:
        Number of voxels marked.
    """
    nx, ny, nz = label.shape
    count = 0
    for i in range(nx):
        for j in range(ny):
            for k in range(nz):
                name = label[i, j, k]
                mark = solid[i, j, k] and name >= 0 and chosen[name]
                out[i, j, k] = mark
                count += mark
    return count
