# SPDX-License-Identifier: Apache-2.0
# mypy: disable-error-code="no-untyped-def"
"""Compiled measurement of distances inside the part, round restrained corners.

A way that cannot be straight bends at edges of the restraint region about which the
part turns inwards. Points on these edges act as sources with a head start: the length
of the way from S to them.
"""

from __future__ import annotations

import numpy as np

from vega_planner.compiled import kernel
from vega_planner.layers.grid_kernels import INSIDE, NONE
from vega_planner.layers.tree_kernels import first_hit
from vega_planner.layers.triangle_kernels import closest, is_among


@kernel
def blocked(brr_tri, brr_box, x, y, z, fx, fy, fz, stack):
    """Tell whether the restraint region lies between a point and a source."""
    dx, dy, dz = fx - x, fy - y, fz - z
    length = np.sqrt(dx * dx + dy * dy + dz * dz)
    if length < 2e-5:
        return False
    # Both ends may lie on the region itself.
    e = 1e-5 / length
    s, u = first_hit(
        brr_tri, brr_box, x + e * dx, y + e * dy, z + e * dz,
        fx - e * dx, fy - e * dy, fz - e * dz, stack,
    )  # fmt: skip
    return s >= 0 and u < 1.0


@kernel
def source_point(tri, s, x, y, z):
    """Distance to a source, and the point of it that the way leads to."""
    d2, fx, fy, fz = closest(tri, s, x, y, z)
    if tri[s, 12] > 0.0:
        return np.sqrt(d2), tri[s, 0], tri[s, 1], tri[s, 2]
    return np.sqrt(d2), fx, fy, fz


@kernel
def find_blocked(tri, brr_tri, brr_box, origin, h, state, ny, nz, first, last, slot, shaded):
    """Mark the nodes inside whose straight way to S leaves the part.

    Returns:
        Number of such nodes.
    """
    stack = np.zeros(64, np.int64)
    total = 0
    for i in range(first, last):
        for j in range(ny):
            for k in range(nz):
                n = (i * ny + j) * nz + k
                if state[n] != INSIDE or slot[n] < 0:
                    continue
                x, y, z = origin[0] + h * i, origin[1] + h * j, origin[2] + h * k
                _, fx, fy, fz = closest(tri, slot[n], x, y, z)
                if blocked(brr_tri, brr_box, x, y, z, fx, fy, fz, stack):
                    shaded[n] = 1
                    total += 1
    return total


@kernel
def relax_sources(tri, first_source, brr_tri, brr_box, origin, h, shape, state, slot, touched):
    """Shorten the head starts of the sources by way of the nodes around them.

    Returns:
        Number of sources that changed.
    """
    stack = np.zeros(64, np.int64)
    changed = 0
    for s in range(first_source, len(tri)):
        x, y, z = tri[s, 0], tri[s, 1], tri[s, 2]
        i0 = int(np.floor((x - origin[0]) / h))
        j0 = int(np.floor((y - origin[1]) / h))
        k0 = int(np.floor((z - origin[2]) / h))
        best = tri[s, 12]
        for i in range(max(i0 - 1, 0), min(i0 + 3, shape[0])):
            for j in range(max(j0 - 1, 0), min(j0 + 3, shape[1])):
                for k in range(max(k0 - 1, 0), min(k0 + 3, shape[2])):
                    n = (i * shape[1] + j) * shape[2] + k
                    q = slot[n]
                    if state[n] != INSIDE or q < 0 or q == s:
                        continue
                    e, fx, fy, fz = source_point(tri, q, x, y, z)
                    if e >= best - 1e-6:
                        continue
                    if blocked(brr_tri, brr_box, x, y, z, fx, fy, fz, stack):
                        continue
                    # The way from the source to the node must be free as well.
                    u, v, w = origin[0] + h * i, origin[1] + h * j, origin[2] + h * k
                    if blocked(brr_tri, brr_box, x, y, z, u, v, w, stack):
                        continue
                    best = e
        if best < tri[s, 12]:
            tri[s, 12] = best
            touched[s - first_source] = 1
            changed += 1
    return changed


@kernel
def sweep_inside(
    tri,
    first_source,
    near_start,
    near,
    brr_tri,
    brr_box,
    origin,
    h,
    state,
    shaded,
    ny,
    nz,
    first,
    last,
    backwards,
    d,
    slot,
):
    """Hand sources from node to node among the shaded ones, where the way is free.

    Args:
        near_start: Start of each node's list of sources close by.
        near: These lists, one after the other.

    Returns:
        Number of nodes that changed.
    """
    stack = np.zeros(64, np.int64)
    tried = np.zeros(26, np.int64)
    changed = 0
    for ii in range(last - first):
        i = last - 1 - ii if backwards else first + ii
        for jj in range(1, ny - 1):
            j = ny - 1 - jj if backwards else jj
            for kk in range(1, nz - 1):
                k = nz - 1 - kk if backwards else kk
                n = (i * ny + j) * nz + k
                if shaded[n] == 0:
                    continue
                x, y, z = origin[0] + h * i, origin[1] + h * j, origin[2] + h * k
                best = slot[n]
                reach = 1e30
                if best >= 0:
                    reach, _, _, _ = source_point(tri, best, x, y, z)
                was = reach
                for q in range(near_start[n], near_start[n + 1]):
                    s = near[q]
                    if tri[s, 12] > 1e29:
                        continue
                    e, fx, fy, fz = source_point(tri, s, x, y, z)
                    if e < reach - 1e-6 and not blocked(
                        brr_tri, brr_box, x, y, z, fx, fy, fz, stack
                    ):
                        reach = e
                        best = s
                count = 0
                for a in range(-1, 2):
                    for b in range(-1, 2):
                        for c in range(-1, 2):
                            m = n + (a * ny + b) * nz + c
                            s = slot[m]
                            if state[m] == NONE or s < 0 or s == best:
                                continue
                            if is_among(tried, count, s):
                                continue
                            tried[count] = s
                            count += 1
                            e, fx, fy, fz = source_point(tri, s, x, y, z)
                            if e < reach - 1e-6 and not blocked(
                                brr_tri, brr_box, x, y, z, fx, fy, fz, stack
                            ):
                                reach = e
                                best = s
                if reach < was - 1e-6:
                    slot[n] = best
                    d[n] = reach
                    changed += 1
    return changed


@kernel
def extend_ring(tri, origin, h, state, shaded, ny, nz, first, last, d, slot):
    """Carry the sources of shaded nodes on to the ring of nodes outside them."""
    for i in range(max(first, 1), last):
        for j in range(1, ny - 1):
            for k in range(1, nz - 1):
                n = (i * ny + j) * nz + k
                if state[n] == INSIDE or state[n] == NONE:
                    continue
                fewest = 4
                reach = 1e30
                best = -1
                dark = False
                x, y, z = origin[0] + h * i, origin[1] + h * j, origin[2] + h * k
                for a in range(-1, 2):
                    for b in range(-1, 2):
                        for c in range(-1, 2):
                            m = n + (a * ny + b) * nz + c
                            if state[m] != INSIDE or slot[m] < 0:
                                continue
                            steps = abs(a) + abs(b) + abs(c)
                            e, _, _, _ = source_point(tri, slot[m], x, y, z)
                            if steps < fewest or (steps == fewest and e < reach):
                                fewest = steps
                                reach = e
                                best = slot[m]
                                dark = shaded[m] > 0
                if dark:
                    slot[n] = best
                    d[n] = reach
