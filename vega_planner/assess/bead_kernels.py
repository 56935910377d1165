# SPDX-License-Identifier: Apache-2.0
# mypy: disable-error-code="no-untyped-def"
"""Kernels that thin out bead rows and draw beads into a signed field."""

from __future__ import annotations

import numpy as np

from vega_planner.compiled import kernel

#: Steps of the fixed-point field per voxel, and its largest value.
STEPS = 2048
LIMIT = 32767


@kernel
def thin_rows(points, axes, width, height, joined, tolerance, keep):
    """Mark the rows that are needed to follow the beads within a tolerance.

    A run of rows is replaced by its chord while every row in it stays within
    `tolerance` of the chord, in place and at the bead's edge.

    Args:
        points: Centres, shape (n, 3).
        axes: Unit axes, shape (n, 3).
        width: Widths, shape (n,).
        height: Heights, shape (n,).
        joined: True where a bead joins row i and i + 1, shape (n - 1,).
        tolerance: Largest deviation, a length.
        keep: Receives True for rows to keep, shape (n,).
    """
    n = len(points)
    start = 0
    keep[0] = True
    while start < n - 1:
        if not joined[start]:
            start += 1
            keep[start] = True
            continue
        end = start + 1
        while end + 1 < n and joined[end] and end - start < 200:
            far = end + 1
            length2 = 0.0
            for k in range(3):
                length2 += (points[far, k] - points[start, k]) ** 2
            good = length2 > 0
            for i in range(start + 1, far):
                if not good:
                    break
                along = 0.0
                for k in range(3):
                    along += (points[i, k] - points[start, k]) * (
                        points[far, k] - points[start, k]
                    )
                t = along / length2
                away2, turn2 = 0.0, 0.0
                for k in range(3):
                    away2 += (
                        points[i, k] - points[start, k] - t * (points[far, k] - points[start, k])
                    ) ** 2
                    turn2 += (
                        axes[i, k] - axes[start, k] - t * (axes[far, k] - axes[start, k])
                    ) ** 2
                reach = 0.5 * width[i]
                wider = width[i] - width[start] - t * (width[far] - width[start])
                higher = height[i] - height[start] - t * (height[far] - height[start])
                good = (
                    0 <= t <= 1
                    and away2 <= tolerance * tolerance
                    and turn2 * reach * reach <= tolerance * tolerance
                    and abs(wider) <= tolerance
                    and abs(higher) <= tolerance
                )
            if not good:
                break
            end = far
        keep[end] = True
        start = end


# numpy's error model: a check for division by zero would keep the loop from being vectorised
@kernel(fastmath=True, error_model="numpy")
def _draw_row(
    row, ramp, x0, y, z, dx, dy, dz, inverse, ux, uy, uz, vx, vy, vz, flat, more_flat, tall,
    more_tall, radius, more_radius, scale,
):  # fmt: skip
    """Draw one bead into a row of nodes; all lengths are relative to its start."""
    zero, one, limit = np.float32(0), np.float32(1), np.float32(LIMIT)
    rest = y * dy + z * dz
    for i in range(row.shape[0]):
        x = x0 + ramp[i]
        t = (x * dx + rest) * inverse
        t = t if t > zero else zero
        t = t if t < one else one
        rx, ry, rz = x - t * dx, y - t * dy, z - t * dz
        bx, by, bz = ux + t * vx, uy + t * vy, uz + t * vz
        along = rx * bx + ry * by + rz * bz
        along2 = along * along / (bx * bx + by * by + bz * bz)
        across2 = rx * rx + ry * ry + rz * rz - along2
        across2 = across2 if across2 > zero else zero
        out = np.sqrt(across2) - flat - t * more_flat
        out = out if out > zero else zero
        above = np.sqrt(along2) - tall - t * more_tall
        above = above if above > zero else zero
        value = (np.sqrt(out * out + above * above) - radius - t * more_radius) * scale
        value = value if value < limit else limit
        row[i] = min(row[i], np.int16(value))


@kernel(error_model="numpy")
def draw_beads(field, first_z, origin, voxel, chosen, starts, ends, up0, up1, section, band):
    """Draw beads into the slab of a field: the least signed distance wins.

    A bead is what a flat round cake of its height leaves that is moved along the
    segment: across, its section is the stadium; its ends are round.

    Args:
        field: Slab of the field, int16 in steps of voxel / STEPS, shape (z, y, x).
        first_z: Index of the slab's first plane in the whole grid.
        origin: Place of the grid's node 0, 0, 0, shape (3,) float32.
        voxel: Distance of the nodes.
        chosen: Segments to draw, shape (c,).
        starts: Start points, shape (s, 3) float32.
        ends: End points, shape (s, 3) float32.
        up0: Section's height direction at the start, square to the segment, (s, 3).
        up1: The same at the end.
        section: Width and height at the start, then at the end, shape (s, 4) float32.
        band: Distance outside the bead up to which it is drawn.
    """
    count_z, count_y, count_x = field.shape
    low, high = np.empty(3, np.int64), np.empty(3, np.int64)
    sizes = (count_x, count_y, count_z)
    h = np.float32(voxel)
    scale = np.float32(STEPS) / h
    ramp = np.empty(count_x, np.float32)
    for i in range(count_x):
        ramp[i] = np.float32(i) * h
    zero, one, half = np.float32(0), np.float32(1), np.float32(0.5)
    for s in chosen:
        thick0, thick1 = min(section[s, 0], section[s, 1]), min(section[s, 2], section[s, 3])
        flat0 = half * max(section[s, 0] - section[s, 1], zero)
        flat1 = half * max(section[s, 2] - section[s, 3], zero)
        tall0 = half * max(section[s, 1] - section[s, 0], zero)
        tall1 = half * max(section[s, 3] - section[s, 2], zero)
        empty = False
        for k in range(3):
            side = max(
                np.sqrt(max(one - up0[s, k] ** 2, zero)), np.sqrt(max(one - up1[s, k] ** 2, zero))
            )
            rise = max(abs(up0[s, k]), abs(up1[s, k]))
            reach = (
                max(flat0, flat1) * side
                + max(tall0, tall1) * rise
                + half * max(thick0, thick1)
                + np.float32(band)
            )
            first = np.floor((min(starts[s, k], ends[s, k]) - reach - origin[k]) / h)
            last = np.ceil((max(starts[s, k], ends[s, k]) + reach - origin[k]) / h)
            shift = first_z if k == 2 else 0
            low[k] = max(np.int64(first) - shift, 0)
            high[k] = min(np.int64(last) - shift, sizes[k] - 1)
            empty = empty or low[k] > high[k]
        if empty:
            continue
        px, py, pz = starts[s, 0], starts[s, 1], starts[s, 2]
        dx, dy, dz = ends[s, 0] - px, ends[s, 1] - py, ends[s, 2] - pz
        length2 = dx * dx + dy * dy + dz * dz
        inverse = one / length2 if length2 > 0 else zero
        ux, uy, uz = up0[s, 0], up0[s, 1], up0[s, 2]
        vx, vy, vz = up1[s, 0] - ux, up1[s, 1] - uy, up1[s, 2] - uz
        radius = half * thick0
        more_radius = half * thick1 - radius
        first_x = origin[0] + np.float32(low[0]) * h - px
        for iz in range(low[2], high[2] + 1):
            z = origin[2] + np.float32(iz + first_z) * h - pz
            for iy in range(low[1], high[1] + 1):
                y = origin[1] + np.float32(iy) * h - py
                row = field[iz, iy, low[0] : high[0] + 1]
                _draw_row(
                    row, ramp, first_x, y, z, dx, dy, dz, inverse, ux, uy, uz, vx, vy, vz,
                    flat0, flat1 - flat0, tall0, tall1 - tall0, radius, more_radius, scale,
                )  # fmt: skip
