# SPDX-License-Identifier: Apache-2.0
"""Kernels of the final check: the tool against beads, each with its own section, exactly.

A bead between two waypoints is a parallelogram, the way of the tip by the flat part of the
bead's width, grown by a ball of half the bead's height. Beads lie in the order in which
they are laid, so that what is there at a moment is a prefix.
"""

from __future__ import annotations

import math

import numpy as np

from vega_planner.compiled import kernel

#: Consecutive beads in a block, and children of a node of the tree over the blocks.
BLOCK, CHILDREN = 4, 8
#: Consecutive poses that go down the tree together: at most so many, and no farther from the
#: first than this in the tip [mm] and in the axis.
_TOGETHER, _TIP, _AXIS = 8, 2.0, 0.1


@kernel
def lay_beads(points, axes, width, height, first, out):
    """Describe the beads of one pass.

    Args:
        points, axes: (n, 3) bead centres [mm] and unit axes.
        width, height: (n,) [mm].
        first: Row of `out` for the first of the n - 1 beads.
        out: (k, 11) written: middle, half the way (3), half the flat width (3), radius, and
            the radius of the ball around it all.
    """
    for k in range(1, points.shape[0]):
        row = first + k - 1
        w = 0.5 * (width[k] + width[k - 1])
        h = 0.5 * (height[k] + height[k - 1])
        for x in range(3):
            out[row, x] = 0.5 * (points[k, x] + points[k - 1, x])
            out[row, 3 + x] = 0.5 * (points[k, x] - points[k - 1, x])
        ax, ay, az = axes[k, 0], axes[k, 1], axes[k, 2]
        dx, dy, dz = out[row, 3], out[row, 4], out[row, 5]
        sx = ay * dz - az * dy
        sy = az * dx - ax * dz
        sz = ax * dy - ay * dx
        length = math.sqrt(sx * sx + sy * sy + sz * sz)
        flat = 0.5 * max(w - h, 0.0) / length if length > 1e-12 else 0.0
        out[row, 6] = sx * flat
        out[row, 7] = sy * flat
        out[row, 8] = sz * flat
        out[row, 9] = 0.5 * h
        way = math.sqrt(dx * dx + dy * dy + dz * dz)
        out[row, 10] = way + flat * length + 0.5 * h


@kernel
def enclose(beads, balls, size):
    """Find a ball around every so many rows.

    Args:
        beads: (k, 11) of `lay_beads`, or (k, 4) balls: middle and radius.
        balls: (ceil(k / size), 4) written: middle and radius.
        size: Rows to a ball.
    """
    last = beads.shape[1] - 1
    for b in range(balls.shape[0]):
        begin = b * size
        end = min(begin + size, beads.shape[0])
        for x in range(3):
            low, high = 1e30, -1e30
            for k in range(begin, end):
                low = min(low, beads[k, x])
                high = max(high, beads[k, x])
            balls[b, x] = 0.5 * (low + high)
        radius = 0.0
        for k in range(begin, end):
            away = 0.0
            for x in range(3):
                away += (beads[k, x] - balls[b, x]) ** 2
            radius = max(radius, math.sqrt(away) + beads[k, last])
        balls[b, 3] = radius


@kernel(inline="always")
def _outside(s, r, at, radius):
    """Signed distance of a point (s, r) of the half plane from a tool's outline.

    The outline runs from (at[0], 0) along the corners (at, radius) to (at[-1], 0).
    """
    n = at.shape[0]
    best = 1e30
    # flat ends
    for k in (0, n - 1):
        ds = s - at[k]
        dr = max(r - radius[k], 0.0)
        best = min(best, ds * ds + dr * dr)
    inside = False
    for k in range(n - 1):
        ls = at[k + 1] - at[k]
        lr = radius[k + 1] - radius[k]
        square = ls * ls + lr * lr
        t = 0.0
        if square > 0.0:
            t = min(max(((s - at[k]) * ls + (r - radius[k]) * lr) / square, 0.0), 1.0)
        ds = s - at[k] - t * ls
        dr = r - radius[k] - t * lr
        best = min(best, ds * ds + dr * dr)
        if ls > 0.0 and at[k] <= s <= at[k + 1]:
            inside = inside or r <= radius[k] + lr * (s - at[k]) / ls
    return -math.sqrt(best) if inside else math.sqrt(best)


@kernel(inline="always")
def _may_touch(ball, px, py, pz, ux, uy, uz, first, last, widest, step, enough):
    """Tell whether a ball may come nearer than `enough` to the tool."""
    x = ball[0] - px
    y = ball[1] - py
    z = ball[2] - pz
    reach = ball[3] + enough
    s = x * ux + y * uy + z * uz
    if s + reach < first or s - reach > last:
        return False
    k = min(int((s + reach) / step) + 1, widest.shape[0] - 1)
    most = widest[k] + reach
    return x * x + y * y + z * z - s * s < most * most


@kernel
def _block_gap(
    beads, begin, end, px, py, pz, ux, uy, uz, at, radius, widest, step, near
):  # fmt: skip
    """Measure how far a pose stays from the beads `begin` to `end`, if nearer than `near`."""
    best = near
    first, last = at[0], at[at.shape[0] - 1]
    for k in range(begin, end):
        x = beads[k, 0] - px
        y = beads[k, 1] - py
        z = beads[k, 2] - pz
        reach = beads[k, 10] + max(best, 0.0)
        s = x * ux + y * uy + z * uz
        if s + reach < first or s - reach > last:
            continue
        most = widest[min(int((s + reach) / step) + 1, widest.shape[0] - 1)] + reach
        square = max(x * x + y * y + z * z - s * s, 0.0)
        if square > most * most:
            continue
        r = math.sqrt(square)
        if _outside(s, r, at, radius) - beads[k, 10] > best:
            continue
        way = math.sqrt(beads[k, 3] ** 2 + beads[k, 4] ** 2 + beads[k, 5] ** 2)
        flat = math.sqrt(beads[k, 6] ** 2 + beads[k, 7] ** 2 + beads[k, 8] ** 2)
        h = beads[k, 9]
        along = max(1, math.ceil(way / 0.2))
        across = max(1, math.ceil(flat / 0.15)) if flat > 1e-9 else 0
        for m in range(-along, along + 1):
            v = m / along
            for j in range(-across, across + 1):
                w = j / across if across > 0 else 0.0
                qx = x + v * beads[k, 3] + w * beads[k, 6]
                qy = y + v * beads[k, 4] + w * beads[k, 7]
                qz = z + v * beads[k, 5] + w * beads[k, 8]
                s = qx * ux + qy * uy + qz * uz
                r = math.sqrt(max(qx * qx + qy * qy + qz * qz - s * s, 0.0))
                best = min(best, _outside(s, r, at, radius) - h)
    return best


@kernel
def _run_of(points, axes, counts, begin):
    """Find the poses after one that are so near to it that they may be looked at together.

    Returns:
        The end of the run, how far its tips [mm] and axes are from the first, and the
        largest of its counts.
    """
    tip, axis, latest = 0.0, 0.0, counts[begin]
    end = begin + 1
    while end < min(points.shape[0], begin + _TOGETHER):
        moved, turned = 0.0, 0.0
        for x in range(3):
            moved += (points[end, x] - points[begin, x]) ** 2
            turned += (axes[end, x] - axes[begin, x]) ** 2
        if moved > _TIP * _TIP or turned > _AXIS * _AXIS:
            break
        tip = max(tip, math.sqrt(moved))
        axis = max(axis, math.sqrt(turned))
        latest = max(latest, counts[end])
        end += 1
    return end, tip, axis, latest


@kernel
def _gather(
    point, direction, tip, axis, latest, balls, earliest, level, first, last, widest, step,
    enough, near,
):  # fmt: skip
    """List the leaves that a tool may come nearer to than `enough` somewhere about a pose.

    Seen from a pose whose tip is off by `tip` and whose axis by `axis`, a point at distance d
    from the tip lies elsewhere, along and across the tool, by no more than tip + d * axis.

    Returns:
        Their number; `near` holds them.
    """
    px, py, pz = point[0], point[1], point[2]
    ux, uy, uz = direction[0], direction[1], direction[2]
    nodes = np.empty(CHILDREN * level.shape[0] + 1, np.int64)
    heights = np.empty(nodes.shape[0], np.int64)
    along, square, away = np.empty(CHILDREN), np.empty(CHILDREN), np.empty(CHILDREN)
    found = 0
    waiting = 1
    nodes[0], heights[0] = 0, level.shape[0] - 1
    while waiting > 0:
        waiting -= 1
        height = heights[waiting] - 1
        node = nodes[waiting] * CHILDREN
        row = level[height] + node
        count = min(CHILDREN, level[height + 1] - row)
        for c in range(count):  # apart from the decisions, so that several go at once
            dx = balls[0, row + c] - px
            dy = balls[1, row + c] - py
            dz = balls[2, row + c] - pz
            s = dx * ux + dy * uy + dz * uz
            along[c] = s
            square[c] = dx * dx + dy * dy + dz * dz - s * s
            dx, dy, dz = abs(dx), abs(dy), abs(dz)
            most = max(dx, max(dy, dz))
            away[c] = most + 0.42 * (dx + dy + dz - most)  # no less than the distance
        for c in range(count):
            if earliest[row + c] >= latest:
                continue
            reach = balls[3, row + c] + enough + tip + away[c] * axis
            s = along[c]
            if s + reach < first or s - reach > last:
                continue
            most = widest[min(int((s + reach) / step) + 1, widest.shape[0] - 1)] + reach
            if square[c] >= most * most:
                continue
            if height == 0:
                near[found] = node + c
                found += 1
            else:
                nodes[waiting], heights[waiting] = node + c, height
                waiting += 1
    return found


@kernel
def bead_clearance(
    points, axes, counts, beads, block, balls, earliest, level, at, radius, widest, step, enough,
    give_up, out,
):  # fmt: skip
    """Measure how far tool poses stay from the beads that are there.

    What one pose hits, the next one is held against first.

    Args:
        points, axes: (n, 3) tips [mm] and unit axes.
        counts: (n,) number of beads laid before each pose.
        beads: (k, 11) of `lay_beads`.
        block: (b,) blocks of `BLOCK` beads in the order of the tree's leaves.
        balls: (4, m) balls around the nodes of the tree, leaves first, level by level.
        earliest: (m,) first bead of each node.
        level: (l + 1,) where the nodes of each level begin, and their end.
        at, radius: (c,) corners of the tool's outline from where it begins to count [mm].
        widest: largest radius [mm] of the tool up to s = `step` * index.
        enough: Clearance [mm] beyond which the exact value does not matter; the most that
            is told.
        give_up: A clearance below this ends the search.
        out: (n,) float64, written: clearance [mm], negative where the tool is in a bead.
    """
    first, last = at[0], at[at.shape[0] - 1]
    near = np.empty(block.shape[0], np.int64)
    hint = -1
    begin = 0
    while begin < points.shape[0]:
        end, tip, axis, latest = _run_of(points, axes, counts, begin)
        found = _gather(
            points[begin], axes[begin], tip, axis, latest, balls, earliest, level, first, last,
            widest, step, max(enough, 0.0), near,
        )  # fmt: skip
        for i in range(begin, end):
            px, py, pz = points[i, 0], points[i, 1], points[i, 2]
            ux, uy, uz = axes[i, 0], axes[i, 1], axes[i, 2]
            count = counts[i]
            best = enough
            if hint >= 0 and hint * BLOCK < count:
                best = _block_gap(
                    beads, hint * BLOCK, min((hint + 1) * BLOCK, count), px, py, pz, ux, uy, uz,
                    at, radius, widest, step, best,
                )  # fmt: skip
            for k in range(found):
                if best < give_up:
                    break
                b = block[near[k]]
                if b * BLOCK >= count or not _may_touch(
                    balls[:, near[k]], px, py, pz, ux, uy, uz, first, last, widest, step,
                    max(best, 0.0),
                ):  # fmt: skip
                    continue
                gap = _block_gap(
                    beads, b * BLOCK, min((b + 1) * BLOCK, count), px, py, pz, ux, uy, uz,
                    at, radius, widest, step, best,
                )  # fmt: skip
                if gap < best:
                    best = gap
                    hint = b
            out[i] = best
        begin = end
