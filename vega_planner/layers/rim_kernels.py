# SPDX-License-Identifier: Apache-2.0
# mypy: disable-error-code="no-untyped-def"
"""Compiled placing of vertices where a level set meets the restraint region."""

from __future__ import annotations

import numpy as np

from vega_planner.compiled import inner_kernel
from vega_planner.layers.grid_kernels import INSIDE
from vega_planner.layers.tree_kernels import first_hit, nearest, nearest_or_walk
from vega_planner.layers.triangle_kernels import closest, walk
from vega_planner.layers.vertex_kernels import settle_about, walk_sheet

#: Vertices of the rim this far off their level are placed again [mm].
OFF_RIM_MM = 0.02


@inner_kernel
def slide(brr_tri, q, x, y, z, gx, gy, gz, lack, damping):
    """Make a step of Newton's along the plane of a triangle of the region.

    Args:
        brr_tri: Triangle rows of the restraint region.
        q: The triangle.
        x, y, z: A point of it [mm].
        gx, gy, gz: Gradient of the distance there.
        lack: By how much the point must get deeper [mm].
        damping: Against long steps where the plane runs along the level.

    Returns:
        The point after the step.
    """
    nx, ny, nz = brr_tri[q, 9], brr_tri[q, 10], brr_tri[q, 11]
    along = gx * nx + gy * ny + gz * nz
    gx, gy, gz = gx - along * nx, gy - along * ny, gz - along * nz
    f = lack / (gx * gx + gy * gy + gz * gz + damping)
    return x + f * gx, y + f * gy, z + f * gz


@inner_kernel
def settle_rim(
    tri, corner, ring_start, ring, box, brr_tri, brr_box, h, r, hint, v, stack, lower
):  # fmt: skip
    """Slide a rim vertex along the region until it is at its depth."""
    s = hint
    x, y, z = v[0], v[1], v[2]
    least = 1e300
    bound = h * h
    for _ in range(8):
        q, _ = nearest(brr_tri, brr_box, x, y, z, -1, bound, stack, lower)
        if q < 0 and least > 1e299:
            q, _ = nearest(brr_tri, brr_box, x, y, z, -1, 1e300, stack, lower)
        if q < 0:
            break
        _, x, y, z = closest(brr_tri, q, x, y, z)
        if least > 1e299:
            s, _ = nearest_or_walk(tri, corner, ring_start, ring, box, x, y, z, s, stack, lower)
        k, d2, fx, fy, fz = walk(tri, corner, ring_start, ring, s, x, y, z)
        e = np.sqrt(d2)
        if abs(e - r) < least:
            least = abs(e - r)
            s = k
            v[0], v[1], v[2] = x, y, z
        if abs(e - r) < 2e-3:
            break
        gx, gy, gz = -tri[k, 9], -tri[k, 10], -tri[k, 11]
        if e > 1e-9:
            gx, gy, gz = (x - fx) / e, (y - fy) / e, (z - fz) / e
        x, y, z = slide(brr_tri, q, x, y, z, gx, gy, gz, r - e, 1e-2)
        bound = max(0.25 * h * h, 4.0 * (r - e) * (r - e))
    return s


@inner_kernel
def meet_rim(
    tri, corner, ring_start, ring, box, brr_tri, brr_box, sheets, normals, sheet_count, h, r,
    hint, v, start, stack, lower,
):  # fmt: skip
    """Put a rim vertex that is off its level where one sheet alone meets the region.

    Where a sheet ends just above the region, which it is parallel to, the one beside it is
    what the rim follows.

    Args:
        v: The vertex, as `settle_rim` has left it; changed in place.
        start: Where it was before it was placed.
    """
    s, d2 = nearest_or_walk(
        tri, corner, ring_start, ring, box, v[0], v[1], v[2], hint, stack, lower
    )
    best = abs(np.sqrt(d2) - r)
    if best < OFF_RIM_MM:
        return hint
    for q in range(sheet_count):
        x, y, z = start[0], start[1], start[2]
        k = sheets[q]
        done = False
        for _ in range(12):
            p, _ = nearest(brr_tri, brr_box, x, y, z, -1, 1e300, stack, lower)
            _, x, y, z = closest(brr_tri, p, x, y, z)
            k, d2, fx, fy, fz = walk_sheet(
                tri, corner, ring_start, ring, k, x, y, z,
                normals[q, 0], normals[q, 1], normals[q, 2],
            )  # fmt: skip
            e = np.sqrt(d2)
            if abs(e - r) < 1e-3:
                done = True
                break
            if e < 1e-9:
                break
            gx, gy, gz = (x - fx) / e, (y - fy) / e, (z - fz) / e
            x, y, z = slide(brr_tri, p, x, y, z, gx, gy, gz, r - e, 1e-3)
        away = (x - start[0]) ** 2 + (y - start[1]) ** 2 + (z - start[2]) ** 2
        if not done or away > 4.0 * h * h:
            continue
        k, d2 = nearest_or_walk(tri, corner, ring_start, ring, box, x, y, z, k, stack, lower)
        off = abs(np.sqrt(d2) - r)
        if off < best:
            best = off
            s = k
            v[0], v[1], v[2] = x, y, z
    return s


@inner_kernel
def bring_back(
    tri, corner, ring_start, ring, box, brr_tri, brr_box, h, r, state, slot, d, gradient, origin,
    corner_step, hint, v, start, stack, lower, seen,
):  # fmt: skip
    """Bring a vertex back that was placed beyond the restraint region.

    Where the crease of two sheets leaves the part, it goes to the point of the region at its
    depth if that is near, and onto the nearest sheet if not.

    Args:
        v: The vertex, changed in place.
        start: Where it was before it was placed.

    Returns:
        Slot of the nearest triangle of S.
    """
    s = hint
    for attempt in range(3):
        cell = int((v[0] - origin[0]) / h) * corner_step[1]
        cell += int((v[1] - origin[1]) / h) * corner_step[2] + int((v[2] - origin[2]) / h)
        if cell < 0 or cell + corner_step[7] >= len(state):
            return s
        beyond = False
        for c in range(8):
            m = cell + corner_step[c]
            if state[m] != INSIDE and not d[m] <= 0.0:
                beyond = True
                break
        if not beyond:
            return s
        q, _ = nearest(brr_tri, brr_box, v[0], v[1], v[2], -1, 4.0 * h * h, stack, lower)
        if q < 0:
            return s
        _, x, y, z = closest(brr_tri, q, v[0], v[1], v[2])
        out = (v[0] - x) * brr_tri[q, 9] + (v[1] - y) * brr_tri[q, 10]
        out += (v[2] - z) * brr_tri[q, 11]
        away = np.sqrt((v[0] - x) ** 2 + (v[1] - y) ** 2 + (v[2] - z) ** 2)
        if out < 1e-6:
            return s
        if out < 0.9 * away:
            # Beside the region it is out only if it went through it.
            q, _ = first_hit(
                brr_tri, brr_box, start[0], start[1], start[2], v[0], v[1], v[2], stack
            )  # fmt: skip
            if q < 0:
                return s
        if attempt == 0:
            s = settle_rim(
                tri, corner, ring_start, ring, box, brr_tri, brr_box, h, r, s, v, stack, lower
            )
            away = (v[0] - start[0]) ** 2 + (v[1] - start[1]) ** 2 + (v[2] - start[2]) ** 2
            _, d2 = nearest_or_walk(
                tri, corner, ring_start, ring, box, v[0], v[1], v[2], s, stack, lower
            )  # fmt: skip
            if abs(np.sqrt(d2) - r) < OFF_RIM_MM and away < 2.0 * h * h:
                return s
            v[0], v[1], v[2] = start[0], start[1], start[2]
            s = settle_about(
                tri, corner, ring_start, ring, r, slot, d, gradient, origin, h, corner_step,
                hint, v, seen,
            )  # fmt: skip
        elif attempt == 1:
            v[0], v[1], v[2] = x, y, z
            s, _ = nearest_or_walk(tri, corner, ring_start, ring, box, x, y, z, s, stack, lower)
    return s
