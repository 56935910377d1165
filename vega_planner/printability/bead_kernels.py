# SPDX-License-Identifier: Apache-2.0
"""Kernels of the final check: beads on a grid by when they are laid, and exact tool tests."""

from __future__ import annotations

import math

import numpy as np
from numba import njit


@njit(nogil=True, cache=True)
def lay_bead(points, axes, width, height, first, origin, spacing, birth):
    """Write into each voxel of a bead the number of the waypoint that lays it.

    A bead joins consecutive points; its section is a stadium `width` across and `height`
    along the tool axis. A voxel keeps the smallest number.

    Args:
        points, axes: (n, 3) bead centres [mm] and unit axes.
        width, height: (n,) [mm].
        first: Number of point 0; a segment counts as laid when its later point is reached.
        origin: (3,) position of voxel 0.
        spacing: Edge of a voxel [mm].
        birth: (nx, ny, nz) int32, updated.
    """
    for k in range(1, points.shape[0]):
        half = 0.5 * max(max(width[k], width[k - 1]), max(height[k], height[k - 1]))
        low = np.empty(3, np.int64)
        high = np.empty(3, np.int64)
        for x in range(3):
            a = min(points[k, x], points[k - 1, x]) - half
            b = max(points[k, x], points[k - 1, x]) + half
            low[x] = max(0, math.ceil((a - origin[x]) / spacing))
            high[x] = min(birth.shape[x] - 1, math.floor((b - origin[x]) / spacing))
        dx = points[k, 0] - points[k - 1, 0]
        dy = points[k, 1] - points[k - 1, 1]
        dz = points[k, 2] - points[k - 1, 2]
        length = dx * dx + dy * dy + dz * dz
        w = 0.5 * (width[k] + width[k - 1])
        h = 0.5 * (height[k] + height[k - 1])
        for i in range(low[0], high[0] + 1):
            for j in range(low[1], high[1] + 1):
                for m in range(low[2], high[2] + 1):
                    if birth[i, j, m] <= first + k:
                        continue
                    px = origin[0] + spacing * i - points[k - 1, 0]
                    py = origin[1] + spacing * j - points[k - 1, 1]
                    pz = origin[2] + spacing * m - points[k - 1, 2]
                    t = 0.0
                    if length > 0:
                        t = min(max((px * dx + py * dy + pz * dz) / length, 0.0), 1.0)
                    px -= t * dx
                    py -= t * dy
                    pz -= t * dz
                    along = px * axes[k, 0] + py * axes[k, 1] + pz * axes[k, 2]
                    square = px * px + py * py + pz * pz - along * along
                    # stadium: a core (w - h) wide with round ends of diameter h
                    side = max(math.sqrt(max(square, 0.0)) - 0.5 * max(w - h, 0.0), 0.0)
                    if side * side + along * along <= 0.25 * h * h:
                        birth[i, j, m] = first + k


@njit(nogil=True, cache=True)
def depth_in_tool(
    points, axes, number, since, birth, origin, spacing, start, step, inscribed, samples, out
):
    """Find how deep the tool reaches into voxels laid before its own waypoint.

    Args:
        points, axes: (n, 3) tips [mm] and unit axes.
        number: (n,) number of each waypoint; younger voxels do not count.
        since: (n,) voxels older than this do not count either.
        birth: (nx, ny, nz) int32 number of the waypoint that laid a voxel.
        origin: (3,) position of voxel 0.
        spacing: Edge of a voxel [mm].
        start: Distance behind the tip at which the tool begins to count [mm].
        step: Spacing of the profile samples [mm].
        inscribed, samples: (k,) radius [mm] of inscribed balls and of the tool.
        out: (n,) float64, written: largest depth [mm] below the tool's side; negative
            where no voxel is inside.
    """
    nx, ny, nz = birth.shape
    last = (samples.shape[0] - 1) * step
    for n in range(points.shape[0]):
        best = -1e3
        for i in range(nx):
            for j in range(ny):
                x = origin[0] + spacing * i - points[n, 0]
                y = origin[1] + spacing * j - points[n, 1]
                for k in range(nz):
                    b = birth[i, j, k]
                    if b >= number[n] or b < since[n]:
                        continue
                    z = origin[2] + spacing * k - points[n, 2]
                    s = x * axes[n, 0] + y * axes[n, 1] + z * axes[n, 2]
                    if s < start or s > last:
                        continue
                    r = math.sqrt(max(x * x + y * y + z * z - s * s, 0.0))
                    best = max(best, samples[int(s / step)] - r)
        out[n] = best
