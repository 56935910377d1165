# SPDX-License-Identifier: Apache-2.0
"""Kernels of the triangle tree: build, winding numbers, distances.

A node holds its box and, for far points, the dipole of its triangles: the sum of their
area vectors at their area-weighted middle.
"""

from __future__ import annotations

import math

import numpy as np

from vega_planner.compiled import kernel

LEAF = 8


@kernel
def build(corners, order, first, last, low, high, middle, dipole, reach):
    """Halve the given order of the triangles again and again, depth first.

    The order follows a space-filling curve, so that halves are compact. The children of
    node k are k + 1 and the node whose index first[k] holds; for leaves first[k] and
    last[k] bound a range in `order`, and first[k] is stored as -1 - start. Returns the
    number of nodes.
    """
    centres = (corners[:, 0] + corners[:, 1] + corners[:, 2]) / 3.0
    stack = np.empty((128, 3), np.int64)
    stack[0, 0], stack[0, 1], stack[0, 2] = 0, len(order), -1
    top, count = 1, 0
    while top > 0:
        top -= 1
        start, end, parent = stack[top, 0], stack[top, 1], stack[top, 2]
        node = count
        count += 1
        if parent >= 0:
            first[parent] = node
        for axis in range(3):
            low[node, axis], high[node, axis] = np.inf, -np.inf
            middle[node, axis], dipole[node, axis] = 0.0, 0.0
        total = 0.0
        for i in range(start, end):
            t = corners[order[i]]
            ux, uy, uz = t[1, 0] - t[0, 0], t[1, 1] - t[0, 1], t[1, 2] - t[0, 2]
            vx, vy, vz = t[2, 0] - t[0, 0], t[2, 1] - t[0, 1], t[2, 2] - t[0, 2]
            nx = 0.5 * (uy * vz - uz * vy)
            ny = 0.5 * (uz * vx - ux * vz)
            nz = 0.5 * (ux * vy - uy * vx)
            area = math.sqrt(nx * nx + ny * ny + nz * nz) + 1e-300
            dipole[node, 0] += nx
            dipole[node, 1] += ny
            dipole[node, 2] += nz
            total += area
            for axis in range(3):
                middle[node, axis] += area * centres[order[i], axis]
                for corner in range(3):
                    low[node, axis] = min(low[node, axis], t[corner, axis])
                    high[node, axis] = max(high[node, axis], t[corner, axis])
        far = 0.0
        for axis in range(3):
            middle[node, axis] /= total
            side = max(high[node, axis] - middle[node, axis], middle[node, axis] - low[node, axis])
            far += side * side
        reach[node] = math.sqrt(far)
        last[node] = end
        if end - start <= LEAF:
            first[node] = -1 - start
            continue
        half = (start + end) // 2
        stack[top, 0], stack[top, 1], stack[top, 2] = half, end, node
        stack[top + 1, 0], stack[top + 1, 1], stack[top + 1, 2] = start, half, -1
        top += 2
    return count


@kernel
def winding(points, corners, order, first, last, middle, dipole, reach, accuracy, out):
    """Sum solid angles over the tree, in turns; far nodes by their dipoles."""
    stack = np.empty(128, np.int64)
    for q in range(len(points)):
        px, py, pz = points[q, 0], points[q, 1], points[q, 2]
        total = 0.0
        stack[0] = 0
        top = 1
        while top > 0:
            top -= 1
            node = stack[top]
            dx = middle[node, 0] - px
            dy = middle[node, 1] - py
            dz = middle[node, 2] - pz
            distance2 = dx * dx + dy * dy + dz * dz
            if distance2 > (accuracy * reach[node]) ** 2:
                dot = dx * dipole[node, 0] + dy * dipole[node, 1] + dz * dipole[node, 2]
                total += dot / (distance2 * math.sqrt(distance2))
                continue
            if first[node] >= 0:
                stack[top] = node + 1
                stack[top + 1] = first[node]
                top += 2
                continue
            for i in range(-1 - first[node], last[node]):
                t = corners[order[i]]
                ax, ay, az = t[0, 0] - px, t[0, 1] - py, t[0, 2] - pz
                bx, by, bz = t[1, 0] - px, t[1, 1] - py, t[1, 2] - pz
                cx, cy, cz = t[2, 0] - px, t[2, 1] - py, t[2, 2] - pz
                a = math.sqrt(ax * ax + ay * ay + az * az)
                b = math.sqrt(bx * bx + by * by + bz * bz)
                c = math.sqrt(cx * cx + cy * cy + cz * cz)
                det = (
                    ax * (by * cz - bz * cy) + ay * (bz * cx - bx * cz) + az * (bx * cy - by * cx)
                )
                below = (
                    a * b * c
                    + (ax * bx + ay * by + az * bz) * c
                    + (bx * cx + by * cy + bz * cz) * a
                    + (cx * ax + cy * ay + cz * az) * b
                )
                total += 2.0 * math.atan2(det, below)
        out[q] = total / (4.0 * math.pi)


@kernel
def distance2(points, corners, order, first, last, low, high, out):
    """Squared distance of points to the nearest triangle [Ericson2005, 5.1.5]."""
    stack = np.empty(128, np.int64)
    for q in range(len(points)):
        px, py, pz = points[q, 0], points[q, 1], points[q, 2]
        best = np.inf
        stack[0] = 0
        top = 1
        while top > 0:
            top -= 1
            node = stack[top]
            if _box2(px, py, pz, low[node], high[node]) >= best:
                continue
            if first[node] >= 0:
                near, far = node + 1, first[node]
                if _box2(px, py, pz, low[far], high[far]) < _box2(
                    px, py, pz, low[near], high[near]
                ):
                    near, far = far, near
                stack[top] = far
                stack[top + 1] = near
                top += 2
                continue
            for i in range(-1 - first[node], last[node]):
                best = min(best, _triangle2(px, py, pz, corners[order[i]]))
        out[q] = best


@kernel
def _box2(px, py, pz, low, high):
    dx = max(low[0] - px, px - high[0], 0.0)
    dy = max(low[1] - py, py - high[1], 0.0)
    dz = max(low[2] - pz, pz - high[2], 0.0)
    return dx * dx + dy * dy + dz * dz


@kernel
def _triangle2(px, py, pz, t):
    best = np.inf
    for k in range(3):
        n = (k + 1) % 3
        ex, ey, ez = t[n, 0] - t[k, 0], t[n, 1] - t[k, 1], t[n, 2] - t[k, 2]
        fx, fy, fz = px - t[k, 0], py - t[k, 1], pz - t[k, 2]
        length2 = ex * ex + ey * ey + ez * ez
        s = 0.0
        if length2 > 0.0:
            s = min(max((ex * fx + ey * fy + ez * fz) / length2, 0.0), 1.0)
        dx, dy, dz = fx - s * ex, fy - s * ey, fz - s * ez
        best = min(best, dx * dx + dy * dy + dz * dz)
    ux, uy, uz = t[1, 0] - t[0, 0], t[1, 1] - t[0, 1], t[1, 2] - t[0, 2]
    vx, vy, vz = t[2, 0] - t[0, 0], t[2, 1] - t[0, 1], t[2, 2] - t[0, 2]
    nx, ny, nz = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
    area2 = nx * nx + ny * ny + nz * nz
    if area2 == 0.0:
        return best
    wx, wy, wz = px - t[0, 0], py - t[0, 1], pz - t[0, 2]
    height = wx * nx + wy * ny + wz * nz
    # barycentric coordinates of the foot, scaled by area2
    b = nx * (wy * vz - wz * vy) + ny * (wz * vx - wx * vz) + nz * (wx * vy - wy * vx)
    c = nx * (uy * wz - uz * wy) + ny * (uz * wx - ux * wz) + nz * (ux * wy - uy * wx)
    if b >= 0.0 and c >= 0.0 and b + c <= area2:
        best = min(best, height * height / area2)
    return best


@kernel
def trilinear(grid, x, y, z):
    """Interpolate a grid at a point in grid units, clamped to the grid."""
    nx, ny, nz = grid.shape
    x = min(max(x, 0.0), nx - 1.000001)
    y = min(max(y, 0.0), ny - 1.000001)
    z = min(max(z, 0.0), nz - 1.000001)
    i, j, k = int(x), int(y), int(z)
    u, v, w = x - i, y - j, z - k
    a = (grid[i, j, k] * (1 - u) + grid[i + 1, j, k] * u) * (1 - v)
    a += (grid[i, j + 1, k] * (1 - u) + grid[i + 1, j + 1, k] * u) * v
    b = (grid[i, j, k + 1] * (1 - u) + grid[i + 1, j, k + 1] * u) * (1 - v)
    b += (grid[i, j + 1, k + 1] * (1 - u) + grid[i + 1, j + 1, k + 1] * u) * v
    return a * (1 - w) + b * w
