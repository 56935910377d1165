# SPDX-License-Identifier: Apache-2.0
"""Kernels that measure how passes lie on a surface, on a grid of their segments."""

from __future__ import annotations

import math

import numpy as np

from vega_planner.compiled import kernel


@kernel
def bucket_segments(a, b, corner, size, shape):
    """Sort segments into the cells of a grid that their boxes touch.

    Args:
        a: Starts, shape (n, 3).
        b: Ends, shape (n, 3).
        corner: Lowest corner of the grid, shape (3,).
        size: Side of a cell.
        shape: Number of cells per direction, shape (3,).

    Returns:
        Start of each cell's list, and the segments in it.
    """
    cells = shape[0] * shape[1] * shape[2]
    begin = np.zeros(cells + 1, np.int64)
    low = np.empty(3, np.int64)
    high = np.empty(3, np.int64)
    items = np.empty(0, np.int64)
    place = begin
    for turn in range(2):
        for q in range(a.shape[0]):
            for c in range(3):
                x = int((min(a[q, c], b[q, c]) - corner[c]) / size)
                y = int((max(a[q, c], b[q, c]) - corner[c]) / size)
                low[c] = min(max(x, 0), shape[c] - 1)
                high[c] = min(max(y, 0), shape[c] - 1)
            for i in range(low[0], high[0] + 1):
                for j in range(low[1], high[1] + 1):
                    for k in range(low[2], high[2] + 1):
                        cell = (i * shape[1] + j) * shape[2] + k
                        if turn == 0:
                            begin[cell + 1] += 1
                        else:
                            items[place[cell]] = q
                            place[cell] += 1
        if turn == 0:
            for cell in range(cells):
                begin[cell + 1] += begin[cell]
            items = np.empty(begin[cells], np.int64)
            place = begin[:-1].copy()
    return begin, items


@kernel
def distance_to_segments(points, a, b, begin, items, corner, size, shape):
    """Distance of points from the nearest segment, at most the side of a cell.

    Args:
        points: Positions, shape (m, 3).
        a: Starts of the segments, shape (n, 3).
        b: Ends, shape (n, 3).
        begin: From `bucket_segments`.
        items: From `bucket_segments`.
        corner: Lowest corner of the grid.
        size: Side of a cell.
        shape: Number of cells per direction.

    Returns:
        Distances, shape (m,).
    """
    out = np.empty(points.shape[0])
    at = np.empty(3, np.int64)
    for p in range(points.shape[0]):
        best = size * size
        for c in range(3):
            at[c] = math.floor((points[p, c] - corner[c]) / size)
        for i in range(max(at[0] - 1, 0), min(at[0] + 2, shape[0])):
            for j in range(max(at[1] - 1, 0), min(at[1] + 2, shape[1])):
                for k in range(max(at[2] - 1, 0), min(at[2] + 2, shape[2])):
                    cell = (i * shape[1] + j) * shape[2] + k
                    for s in range(begin[cell], begin[cell + 1]):
                        q = items[s]
                        dx = b[q, 0] - a[q, 0]
                        dy = b[q, 1] - a[q, 1]
                        dz = b[q, 2] - a[q, 2]
                        x = points[p, 0] - a[q, 0]
                        y = points[p, 1] - a[q, 1]
                        z = points[p, 2] - a[q, 2]
                        ll = dx * dx + dy * dy + dz * dz
                        w = 0.0
                        if ll > 0.0:
                            w = min(max((x * dx + y * dy + z * dz) / ll, 0.0), 1.0)
                        d = (x - w * dx) ** 2 + (y - w * dy) ** 2 + (z - w * dz) ** 2
                        if d < best:
                            best = d
        out[p] = math.sqrt(best)
    return out


@kernel
def gaps_beside(a, b, axes, begin, items, corner, size, shape, nearest, farthest):
    """Distance from the middle of each segment to the lines on its two sides.

    The neighbours are the segments that cross the plane through the middle, across the
    segment, and run along with it.

    Args:
        a: Starts of the segments, shape (n, 3).
        b: Ends, shape (n, 3).
        axes: Directions away from the surface, shape (n, 3).
        begin: From `bucket_segments`.
        items: From `bucket_segments`.
        corner: Lowest corner of the grid.
        size: Side of a cell, at least `farthest`.
        shape: Number of cells per direction.
        nearest: Smallest distance counted.
        farthest: Largest distance counted.

    Returns:
        Distances to the left and to the right, shape (n, 2), -1 without a neighbour; and
        the ways there, from the middle of the segment, shape (n, 2, 3).
    """
    out = np.full((a.shape[0], 2), -1.0)
    way = np.zeros((a.shape[0], 2, 3))
    at = np.empty(3, np.int64)
    m = np.empty(3)
    t = np.empty(3)
    for p in range(a.shape[0]):
        length = 0.0
        for c in range(3):
            m[c] = 0.5 * (a[p, c] + b[p, c])
            t[c] = b[p, c] - a[p, c]
            length += t[c] * t[c]
            at[c] = math.floor((m[c] - corner[c]) / size)
        length = math.sqrt(length)
        if length < 1e-6:
            continue
        for c in range(3):
            t[c] /= length
        sx = axes[p, 1] * t[2] - axes[p, 2] * t[1]
        sy = axes[p, 2] * t[0] - axes[p, 0] * t[2]
        sz = axes[p, 0] * t[1] - axes[p, 1] * t[0]
        for i in range(max(at[0] - 1, 0), min(at[0] + 2, shape[0])):
            for j in range(max(at[1] - 1, 0), min(at[1] + 2, shape[1])):
                for k in range(max(at[2] - 1, 0), min(at[2] + 2, shape[2])):
                    cell = (i * shape[1] + j) * shape[2] + k
                    for s in range(begin[cell], begin[cell + 1]):
                        q = items[s]
                        u = 0.0
                        v = 0.0
                        ll = 0.0
                        for c in range(3):
                            u += (a[q, c] - m[c]) * t[c]
                            v += (b[q, c] - m[c]) * t[c]
                            ll += (b[q, c] - a[q, c]) ** 2
                        if (u < 0.0) == (v < 0.0) or abs(v - u) < 0.9 * math.sqrt(ll):
                            continue
                        w = u / (u - v)
                        x = a[q, 0] + w * (b[q, 0] - a[q, 0]) - m[0]
                        y = a[q, 1] + w * (b[q, 1] - a[q, 1]) - m[1]
                        z = a[q, 2] + w * (b[q, 2] - a[q, 2]) - m[2]
                        d = math.sqrt(x * x + y * y + z * z)
                        if d < nearest or d > farthest:
                            continue
                        side = 0 if x * sx + y * sy + z * sz > 0.0 else 1
                        if out[p, side] < 0.0 or d < out[p, side]:
                            out[p, side] = d
                            way[p, side, 0], way[p, side, 1], way[p, side, 2] = x, y, z
    return out, way
