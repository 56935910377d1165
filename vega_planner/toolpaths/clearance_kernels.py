# SPDX-License-Identifier: Apache-2.0
"""Clearance of the tool above a height map of what is printed so far."""

from __future__ import annotations

import math

from vega_planner.compiled import kernel


@kernel
def raise_map(heights, corner, size, points, reach, rise):
    """Put beads into a height map.

    Args:
        heights: Highest material in each cell [mm], shape (nx, ny); overwritten.
        corner: x and y of the map's corner [mm], shape (2,).
        size: Side of a cell [mm].
        points: Bead centres, shape (k, 3).
        reach: Half width of a bead [mm].
        rise: Half height of a bead [mm], shape (k,).
    """
    nx, ny = heights.shape
    for q in range(points.shape[0]):
        i0 = max(int((points[q, 0] - reach - corner[0]) / size), 0)
        i1 = min(int((points[q, 0] + reach - corner[0]) / size), nx - 1)
        j0 = max(int((points[q, 1] - reach - corner[1]) / size), 0)
        j1 = min(int((points[q, 1] + reach - corner[1]) / size), ny - 1)
        z = points[q, 2] + rise[q]
        for i in range(i0, i1 + 1):
            for j in range(j0, j1 + 1):
                if heights[i, j] < z:
                    heights[i, j] = z


@kernel
def is_clear(heights, corner, size, floor, top, points, axes, distance, radius, room):
    """Check that the tool is clear of a height map at every pose.

    The map counts as solid below its surface, and the tool as the balls inscribed at
    every millimetre of its axis: that is on the safe side for whatever overhangs.

    Args:
        heights: Height map [mm], shape (nx, ny).
        corner: x and y of the map's corner [mm], shape (2,).
        size: Side of a cell [mm].
        floor: Height of the plate [mm].
        top: Highest value in the map [mm].
        points: Tip positions, shape (k, 3).
        axes: Unit vectors from the tip back along the nozzle, shape (k, 3).
        distance: Profile, distance behind the tip [mm], rising, shape (p,).
        radius: Profile, radius [mm], shape (p,).
        room: Distance to keep [mm].
    """
    nx, ny = heights.shape
    reach = distance[-1]
    for q in range(points.shape[0]):
        s = 0.0
        k = 0
        while s <= reach:
            while k + 2 < distance.shape[0] and distance[k + 1] < s:
                k += 1
            w = (s - distance[k]) / max(distance[k + 1] - distance[k], 1e-9)
            r = radius[k] + min(max(w, 0.0), 1.0) * (radius[k + 1] - radius[k]) + room
            x = points[q, 0] + s * axes[q, 0]
            y = points[q, 1] + s * axes[q, 1]
            z = points[q, 2] + s * axes[q, 2]
            if z - r < floor:
                return False
            if z - r < top:
                i0 = max(int((x - r - corner[0]) / size), 0)
                i1 = min(int((x + r - corner[0]) / size), nx - 1)
                j0 = max(int((y - r - corner[1]) / size), 0)
                j1 = min(int((y + r - corner[1]) / size), ny - 1)
                for i in range(i0, i1 + 1):
                    ax = corner[0] + i * size - x
                    dx = max(max(ax, -ax - size), 0.0)
                    for j in range(j0, j1 + 1):
                        ay = corner[1] + j * size - y
                        dy = max(max(ay, -ay - size), 0.0)
                        rest = r * r - dx * dx - dy * dy
                        if rest > 0.0 and heights[i, j] > z - math.sqrt(rest):
                            return False
            elif axes[q, 2] >= 0.0 and z - 14.0 > top:
                break
            s += 1.0
    return True
