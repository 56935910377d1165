# SPDX-License-Identifier: Apache-2.0
"""Kernel of the solid tool check: a body of revolution against distance fields."""

from __future__ import annotations

import math

from vega_planner.compiled import kernel

CLEAR = 1e3  # distance [mm] reported where nothing is near


@kernel(inline="always")
def _distance(field, origin, inverse, x, y, z):
    """Look up a distance field, linear between samples.

    Beyond the grid, the nearest point c of its box gives a lower bound: for every point q
    of the box, |x - q|² >= |x - c|² + |c - q|².
    """
    nx, ny, nz = field.shape
    fx = (x - origin[0]) * inverse
    fy = (y - origin[1]) * inverse
    fz = (z - origin[2]) * inverse
    cx = min(max(fx, 0.0), nx - 1.000001)
    cy = min(max(fy, 0.0), ny - 1.000001)
    cz = min(max(fz, 0.0), nz - 1.000001)
    beyond = (fx - cx) ** 2 + (fy - cy) ** 2 + (fz - cz) ** 2
    a, b, c = int(cx), int(cy), int(cz)
    fx = cx - a
    fy = cy - b
    fz = cz - c
    near = (field[a, b, c] * (1 - fz) + field[a, b, c + 1] * fz) * (1 - fy) + (
        field[a, b + 1, c] * (1 - fz) + field[a, b + 1, c + 1] * fz
    ) * fy
    far = (field[a + 1, b, c] * (1 - fz) + field[a + 1, b, c + 1] * fz) * (1 - fy) + (
        field[a + 1, b + 1, c] * (1 - fz) + field[a + 1, b + 1, c + 1] * fz
    ) * fy
    value = near * (1 - fx) + far * fx
    if beyond > 0.0:
        value = max(value, 0.0)
        return math.sqrt(value * value + beyond / (inverse * inverse))
    return value


@kernel
def tool_clearance(
    points, axes, field, origin, inverse, start, step, inscribed, reach, rim_at, rim_radius,
    enough, give_up, out,
):  # fmt: skip
    """Measure how far the tool stays from what a distance field holds.

    The tool is the union of the balls inscribed along its axis, and circles at its rims.
    The walk along the axis jumps as far as the field, which changes by at most 1 mm per
    mm, proves the tool to be `enough` clear.

    Args:
        points: (n, 3) tips [mm].
        axes: (n, 3) unit vectors from the tip back along the tool.
        field: (nx, ny, nz) float32 distances [mm].
        origin: (3,) position of voxel 0.
        inverse: 1 / spacing.
        start: Distance behind the tip [mm] at which the check begins.
        step: Spacing [mm] of the profile samples below.
        inscribed: (k,) radius [mm] of the inscribed ball at s = step * index.
        reach: (m,) for a distance v = step * index the largest s with s + radius <= v.
        rim_at, rim_radius: (r,) rims: distance behind the tip, radius [mm].
        enough: Clearance [mm] beyond which the exact value does not matter.
        give_up: A clearance below this ends the walk: how far below does not matter.
        out: (n,) float64, written: the clearance, negative where the tool is inside;
            exact only between `give_up` and `enough`.
    """
    last = (inscribed.shape[0] - 1) * step
    for i in range(points.shape[0]):
        px, py, pz = points[i, 0], points[i, 1], points[i, 2]
        ux, uy, uz = axes[i, 0], axes[i, 1], axes[i, 2]
        best = CLEAR
        s = start
        while s <= last:
            d = _distance(field, origin, inverse, px + ux * s, py + uy * s, pz + uz * s)
            gap = d - inscribed[int(s / step + 0.5)]
            best = min(best, gap)
            if best < give_up:
                break
            k = int((d + s - enough) / step)
            if k >= reach.shape[0]:
                break
            s = max(s + step, reach[k] if k > 0 else 0.0)
        if best > enough or best < give_up:
            out[i] = best
            continue
        if abs(uz) < 0.9:
            ax, ay, az = uy, -ux, 0.0
        else:
            ax, ay, az = 0.0, uz, -uy
        norm = 1.0 / math.sqrt(ax * ax + ay * ay + az * az)
        ax *= norm
        ay *= norm
        az *= norm
        bx = uy * az - uz * ay
        by = uz * ax - ux * az
        bz = ux * ay - uy * ax
        for j in range(rim_at.shape[0]):
            r = rim_radius[j]
            cx = px + ux * rim_at[j]
            cy = py + uy * rim_at[j]
            cz = pz + uz * rim_at[j]
            d = _distance(field, origin, inverse, cx, cy, cz)
            if d > r + enough:
                continue
            count = max(12, int(6.3 * r / 0.8))
            for m in range(count):
                t = 2.0 * math.pi * m / count
                p = math.cos(t) * r
                q = math.sin(t) * r
                d = _distance(
                    field, origin, inverse,
                    cx + ax * p + bx * q, cy + ay * p + by * q, cz + az * p + bz * q,
                )  # fmt: skip
                best = min(best, d)
        out[i] = best


@kernel
def tool_hits(points, axes, group, obstacles, owner, start, step, radius, margin, hits):
    """Count for groups of tool poses how many contain a sample of each obstacle.

    Args:
        points, axes: (n, 3) tips [mm] and unit axes.
        group: (n,) group of each pose.
        obstacles: (m, 3) samples [mm] sorted by owner.
        owner: (m,) obstacle each belongs to.
        start: Distance behind the tip at which the tool begins to count [mm].
        step: Spacing [mm] of the profile samples.
        radius: (k,) radius [mm] of the tool at s = step * index.
        margin: Added to the radius [mm].
        hits: (groups, obstacles) int64, counts added.
    """
    n, m = points.shape[0], obstacles.shape[0]
    last = (radius.shape[0] - 1) * step
    widest = 0.0
    for k in range(radius.shape[0]):
        widest = max(widest, radius[k])
    widest = (widest + margin) ** 2
    for i in range(n):
        px, py, pz = points[i, 0], points[i, 1], points[i, 2]
        ux, uy, uz = axes[i, 0], axes[i, 1], axes[i, 2]
        g = group[i]
        skip = -1
        for j in range(m):
            if owner[j] == skip:
                continue
            dx = obstacles[j, 0] - px
            dy = obstacles[j, 1] - py
            dz = obstacles[j, 2] - pz
            s = dx * ux + dy * uy + dz * uz
            if s < start or s > last:
                continue
            square = dx * dx + dy * dy + dz * dz - s * s
            if square > widest:
                continue
            r = radius[int(s / step)] + margin
            if square < r * r:
                skip = owner[j]
                hits[g, skip] += 1
