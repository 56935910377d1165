# SPDX-License-Identifier: Apache-2.0
# mypy: disable-error-code="no-untyped-def"
"""Compiled search for edges of a sheet that leave the level set between their ends."""

from __future__ import annotations

import numpy as np

from vega_planner.compiled import inner_kernel, kernel
from vega_planner.layers.rim_kernels import bring_back, settle_rim
from vega_planner.layers.triangle_kernels import SAME_BASIN, closest, walk, walk_from
from vega_planner.layers.vertex_kernels import (
    clear_about,
    nearest_about,
    walk_sheet,
)

#: Edges between the sides of a sliver may be so far off the level set [mm].
WIDE_MM = 0.1

#: How much nearer than its foot a triangle may be once a point has moved away from it [mm].
NEARER_MM = 3e-4

#: Centres this near to a corner, which is on the level, are not looked at, in their limit.
NEAR_CORNER = 0.9


@kernel
def flag_edges(
    tri,
    corner,
    ring_start,
    ring,
    vertices,
    inward,
    slots,
    rim,
    faces,
    first,
    r,
    tolerance,
    flagged,
):
    """Flag the edges whose middle is farther than `tolerance` from the level set.

    The turn of the gradient along an edge tells how far a smooth sheet bulges; only
    where that is not small is the middle measured. Of the two faces of an edge only the
    one flags it in which it begins with the lower vertex.

    Returns:
        Number of flags set.
    """
    total = 0
    for f in range(first, len(faces)):
        for c in range(3):
            a, b = faces[f, c], faces[f, (c + 1) % 3]
            if a > b:
                # Faces before the first have had their turn, those of the rim stand alone.
                if first == 0 and not (rim[a] and rim[b]):
                    continue
                a, b = b, a
            bulge = 0.0
            turn = 0.0
            for k in range(3):
                bulge += (vertices[b, k] - vertices[a, k]) * (inward[b, k] - inward[a, k])
                turn += inward[b, k] * inward[a, k]
            if turn > 0.8:
                # A smooth sheet bulges by an eighth of length times turn.
                if abs(bulge) > 8.0 * tolerance:
                    flagged[f - first, c] = 1
                    total += 1
                continue
            # An edge that joins the two sides of a sliver is halved only where the sliver
            # is wide; halving it may only make more such edges.
            allowed = tolerance if turn > -0.2 else max(tolerance, WIDE_MM)
            x = 0.5 * (vertices[a, 0] + vertices[b, 0])
            y = 0.5 * (vertices[a, 1] + vertices[b, 1])
            z = 0.5 * (vertices[a, 2] + vertices[b, 2])
            s, d2, _, _, _ = walk(tri, corner, ring_start, ring, slots[a], x, y, z)
            e2 = d2
            if slots[b] not in (slots[a], s):
                _, e2, _, _, _ = walk(tri, corner, ring_start, ring, slots[b], x, y, z, s)
            if abs(np.sqrt(min(d2, e2)) - r) > allowed:
                flagged[f - first, c] = 1
                total += 1
    return total


@inner_kernel
def meet_sheets(tri, corner, ring_start, ring, sa, sb, ga, gb, h, r, v):
    """Move v to the crease where the level sets of two sheets meet, if that is near.

    Returns:
        A triangle of the nearer sheet, -1 where the crease is too far or there is none.
    """
    x, y, z = v[0], v[1], v[2]
    reach = 0.0
    ax, ay, az = ga[0], ga[1], ga[2]
    bx, by, bz = gb[0], gb[1], gb[2]
    for step in range(10):
        sa, d2, fx, fy, fz = walk_sheet(tri, corner, ring_start, ring, sa, x, y, z, ax, ay, az)
        ea = max(np.sqrt(d2), 1e-9)
        ax, ay, az = (x - fx) / ea, (y - fy) / ea, (z - fz) / ea
        sb, d2, fx, fy, fz = walk_sheet(tri, corner, ring_start, ring, sb, x, y, z, bx, by, bz)
        eb = max(np.sqrt(d2), 1e-9)
        bx, by, bz = (x - fx) / eb, (y - fy) / eb, (z - fz) / eb
        if step == 0:
            off = max(abs(ea - r), abs(eb - r))
            # At a sharp ridge the crease is farther than the middle is off the level.
            half = np.sqrt(max(0.5 + 0.5 * (ax * bx + ay * by + az * bz), 1e-6))
            reach = max(4.0 * off + 0.05, min(1.4 * off / half, 2.0 * h))
        if abs(ea - r) < 1e-3 and abs(eb - r) < 1e-3:
            v[0], v[1], v[2] = x, y, z
            return sa if ea <= eb else sb
        # The shortest step onto both tangent planes.
        c = ax * bx + ay * by + az * bz
        det = 1.0 - c * c
        if det < 1e-2:
            return -1
        p = ((r - ea) - c * (r - eb)) / det
        q = ((r - eb) - c * (r - ea)) / det
        x += p * ax + q * bx
        y += p * ay + q * by
        z += p * az + q * bz
        if (x - v[0]) ** 2 + (y - v[1]) ** 2 + (z - v[2]) ** 2 > reach * reach:
            return -1
    return -1


@inner_kernel
def go_ahead(
    tri, corner, ring_start, ring, slot, d, gradient, origin, h, corner_step, ga, gb, r, hint, v,
    seen,
):  # fmt: skip
    """Move v between two sheets, away from both, to where the level ends before their crease.

    Returns:
        A triangle of the sheet met there, -1 where none is met nearby.
    """
    wx, wy, wz = -ga[0] - gb[0], -ga[1] - gb[1], -ga[2] - gb[2]
    length = np.sqrt(wx * wx + wy * wy + wz * wz)
    if length < 0.1:
        return -1
    wx, wy, wz = wx / length, wy / length, wz / length
    x, y, z = v[0], v[1], v[2]
    s = hint
    gone = 0.0
    for _ in range(10):
        s, d2, fx, fy, fz = nearest_about(
            tri, corner, ring_start, ring, slot, d, gradient, origin, h, corner_step, x, y, z, s,
            seen,
        )  # fmt: skip
        e = max(np.sqrt(d2), 1e-9)
        if abs(e - r) < 1e-3:
            v[0], v[1], v[2] = x, y, z
            return s
        rate = -((x - fx) * wx + (y - fy) * wy + (z - fz) * wz) / e
        step = (e - r) / max(rate, 0.15)
        gone += step
        if gone > 2.0 * h or gone < 0.0:
            return -1
        x += step * wx
        y += step * wy
        z += step * wz
    return -1


@kernel
def place_middles(
    tri,
    corner,
    ring_start,
    ring,
    box,
    slot,
    d,
    gradient,
    origin,
    h,
    corner_step,
    state,
    brr_tri,
    brr_box,
    vertices,
    slots,
    ends,
    on_rim,
    r,
    inward,
    middles,
    middle_inward,
    middle_slots,
):
    """Put the middles of edges onto the level set, and those of the rim onto the region."""
    stack = np.zeros(64, np.int64)
    lower = np.zeros(64)
    v, start = np.zeros(3), np.zeros(3)
    seen = np.zeros((9, 3))
    for i in range(len(ends)):
        a, b = ends[i, 0], ends[i, 1]
        x = 0.5 * (vertices[a, 0] + vertices[b, 0])
        y = 0.5 * (vertices[a, 1] + vertices[b, 1])
        z = 0.5 * (vertices[a, 2] + vertices[b, 2])
        start[0], start[1], start[2] = x, y, z
        turn = 0.0
        for k in range(3):
            turn += inward[a, k] * inward[b, k]
        s, d2, fx, fy, fz = walk(tri, corner, ring_start, ring, slots[a], x, y, z)
        if turn < SAME_BASIN and slots[b] not in (slots[a], s):
            q, e2, gx, gy, gz = walk(tri, corner, ring_start, ring, slots[b], x, y, z, s)
            if e2 < d2:
                s, d2, fx, fy, fz = q, e2, gx, gy, gz
        on_crease = False
        if turn < 0.8:
            v[0], v[1], v[2] = x, y, z
            q = meet_sheets(
                tri, corner, ring_start, ring, slots[a], slots[b], inward[a], inward[b], h, r, v
            )  # fmt: skip
            if q >= 0:
                _, e2, _, _, _ = nearest_about(
                    tri, corner, ring_start, ring, slot, d, gradient, origin, h, corner_step,
                    v[0], v[1], v[2], q, seen,
                )  # fmt: skip
                if np.sqrt(e2) > r - 2e-3:
                    on_crease = True
                    s = q
                    x, y, z = v[0], v[1], v[2]
            if not on_crease and turn < 0.3 and np.sqrt(d2) > r + WIDE_MM:
                v[0], v[1], v[2] = x, y, z
                q = go_ahead(
                    tri, corner, ring_start, ring, slot, d, gradient, origin, h, corner_step,
                    inward[a], inward[b], r, s, v, seen,
                )  # fmt: skip
                if q >= 0:
                    on_crease = True
                    s = q
                    x, y, z = v[0], v[1], v[2]
        checked = False
        for step in range(0 if on_crease else 6):
            if step > 0:
                s, d2, fx, fy, fz = walk(tri, corner, ring_start, ring, s, x, y, z)
            e = max(np.sqrt(d2), 1e-9)
            if abs(e - r) < 0.05 and turn < 0.9 and not checked:
                # Across a crease another sheet may be nearer than walking tells.
                checked = True
                q, e2, gx, gy, gz = nearest_about(
                    tri, corner, ring_start, ring, slot, d, gradient, origin, h, corner_step,
                    x, y, z, s, seen,
                )  # fmt: skip
                e2 = np.sqrt(e2)
                if e2 < e - 0.01:
                    checked = False
                    s, e = q, max(e2, 1e-9)
                    fx, fy, fz = gx, gy, gz
            if abs(e - r) < 1e-4:
                break
            x = fx + (x - fx) * r / e
            y = fy + (y - fy) * r / e
            z = fz + (z - fz) * r / e
            if turn >= 0.9 and (r - e) * (1.0 - turn) < NEARER_MM:
                break  # towards the foot it stays the foot, away from it nearly so
        if not on_rim[i] and len(box) > 0:
            # Straight distances alone: nodes about may be across a slot.
            v[0], v[1], v[2] = x, y, z
            s = clear_about(
                tri, corner, ring_start, ring, r, slot, d, gradient, origin, h, corner_step,
                turn < 0.9, s, v,
            )  # fmt: skip
            x, y, z = v[0], v[1], v[2]
        elif on_rim[i]:
            v[0], v[1], v[2] = x, y, z
            length = 0.0
            for k in range(3):
                length += (vertices[a, k] - vertices[b, k]) ** 2
            length = np.sqrt(length)
            s = settle_rim(
                tri, corner, ring_start, ring, box, brr_tri, brr_box, max(length, 0.05), r, s,
                v, stack, lower,
            )  # fmt: skip
            x, y, z = v[0], v[1], v[2]
        if not on_rim[i] and len(brr_tri) > 0:
            v[0], v[1], v[2] = x, y, z
            s = bring_back(
                tri, corner, ring_start, ring, box, brr_tri, brr_box, h, r, state, slot, d,
                gradient, origin, corner_step, s, v, start, stack, lower, seen,
            )  # fmt: skip
            x, y, z = v[0], v[1], v[2]
        d2, fx, fy, fz = closest(tri, s, x, y, z)
        e = max(np.sqrt(d2), 1e-9)
        middles[i, 0], middles[i, 1], middles[i, 2] = x, y, z
        middle_inward[i, 0] = (x - fx) / e
        middle_inward[i, 1] = (y - fy) / e
        middle_inward[i, 2] = (z - fz) / e
        middle_slots[i] = s


@kernel
def place_centres(
    tri,
    corner,
    ring_start,
    ring,
    slot,
    d,
    gradient,
    origin,
    h,
    corner_step,
    vertices,
    inward,
    slots,
    faces,
    r,
    limit,
    chosen,
    centres,
    centre_inward,
    centre_slots,
):
    """Choose the faces across a crease with centres far off, and put those onto the level."""
    seen = np.zeros((9, 3))
    for f in range(len(faces)):
        turn = 1.0
        for c in range(3):
            a, b = faces[f, c], faces[f, (c + 1) % 3]
            along = 0.0
            for k in range(3):
                along += inward[a, k] * inward[b, k]
            turn = min(turn, along)
        if turn > 0.9:
            continue
        x, y, z = 0.0, 0.0, 0.0
        for c in range(3):
            x += vertices[faces[f, c], 0] / 3.0
            y += vertices[faces[f, c], 1] / 3.0
            z += vertices[faces[f, c], 2] / 3.0
        near = 1e300
        for c in range(3):
            away = (vertices[faces[f, c], 0] - x) ** 2 + (vertices[faces[f, c], 1] - y) ** 2
            near = min(near, away + (vertices[faces[f, c], 2] - z) ** 2)
        if near < NEAR_CORNER * NEAR_CORNER * limit * limit:
            continue  # a distance changes by no more than the way
        s, least = walk_from(
            tri, corner, ring_start, ring, slots[faces[f, 0]], slots[faces[f, 1]],
            slots[faces[f, 2]], x, y, z,
        )  # fmt: skip
        if abs(np.sqrt(least) - r) <= limit:
            continue
        for step in range(6):
            s, d2, fx, fy, fz = nearest_about(
                tri, corner, ring_start, ring, slot, d, gradient, origin, h, corner_step,
                x, y, z, s, seen,
            )  # fmt: skip
            e = max(np.sqrt(d2), 1e-9)
            if abs(e - r) <= (limit if step == 0 else 1e-3):
                break
            chosen[f] = 1
            x = fx + (x - fx) * r / e
            y = fy + (y - fy) * r / e
            z = fz + (z - fz) * r / e
        d2, fx, fy, fz = closest(tri, s, x, y, z)
        e = max(np.sqrt(d2), 1e-9)
        centres[f, 0], centres[f, 1], centres[f, 2] = x, y, z
        centre_inward[f, 0] = (x - fx) / e
        centre_inward[f, 1] = (y - fy) / e
        centre_inward[f, 2] = (z - fz) / e
        centre_slots[f] = s
