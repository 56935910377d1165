# SPDX-License-Identifier: Apache-2.0
# mypy: disable-error-code="no-untyped-def"
"""Kernels of the check of the robot's links: a tree of balls per link against what is there.

Every node of a tree is a ball around the balls below it. Trees lie in preorder, each node
with the number of the node that follows where it is passed over. What is printed lies on a
grid of voxels, each with the number of the first pass that reaches into it.
"""

from __future__ import annotations

import math

import numpy as np

from vega_planner.compiled import kernel
from vega_planner.robot.kernels import apply, composed, turned

#: Balls in a leaf.
LEAF = 8

#: Bits of the outcome.
PLATE, SUBSTRATE, PRINT = 1, 2, 4

#: Pass number of voxels that stay empty, and of the substrate's.
NEVER, ALWAYS = 2**31 - 1, -1

#: Edge, in voxels, of the cells of the coarse grid.
COARSE = 4

#: Millimetres of a metre: chains are in metres, what is there in millimetres.
_MM = 1000.0

#: Half the diagonal of a voxel, in its edges.
_HALF_DIAGONAL = 0.8660254


@kernel
def grow(balls, nodes, spans, skip):
    """Build the tree over the balls of one link, which lie near each other where they follow.

    Args:
        balls: (n, 4) centres and radii.
        nodes: (k, 4) written: balls of the nodes; 2 n rows are enough.
        spans: (k, 2) written: first ball and end of each node.
        skip: (k,) written: node behind the subtree of each.

    Returns:
        The number of nodes.
    """
    stack = np.empty((128, 3), np.int64)
    depth = np.empty(len(skip), np.int64)
    stack[0, 0], stack[0, 1], stack[0, 2] = 0, len(balls), 0
    size, count = 1, 0
    while size:
        size -= 1
        low, high, level = stack[size]
        spans[count, 0], spans[count, 1] = low, high
        depth[count] = level
        for x in range(3):
            least, most = 1e30, -1e30
            for k in range(low, high):
                least = min(least, balls[k, x] - balls[k, 3])
                most = max(most, balls[k, x] + balls[k, 3])
            nodes[count, x] = 0.5 * (least + most)
        radius = 0.0
        for k in range(low, high):
            away = 0.0
            for x in range(3):
                away += (balls[k, x] - nodes[count, x]) ** 2
            radius = max(radius, math.sqrt(away) + balls[k, 3])
        nodes[count, 3] = radius
        count += 1
        if high - low > LEAF:
            middle = (low + high) // 2
            stack[size] = (middle, high, level + 1)
            stack[size + 1] = (low, middle, level + 1)
            size += 2
    for k in range(count - 1, -1, -1):
        j = k + 1
        while j < count and depth[j] > depth[k]:
            j = skip[j]
        skip[k] = j
    return count


@kernel
def mark_passes(points, number, longest, origin, spacing, laid):
    """Mark the voxels a pass runs through with its number, where no earlier one does.

    Args:
        points: (n, 3) bead centres [mm].
        number: Number of the pass.
        longest: Largest step along it [mm].
        origin, spacing: Of the grid; voxel i reaches half a spacing to both sides of
            origin + i * spacing.
        laid: (i, j, k) written.
    """
    for n in range(len(points) - 1):
        length = 0.0
        for x in range(3):
            length += (points[n + 1, x] - points[n, x]) ** 2
        count = math.ceil(math.sqrt(length) / longest) + 1
        for step in range(count + 1):
            w = step / count
            i = round(((1 - w) * points[n, 0] + w * points[n + 1, 0] - origin[0]) / spacing)
            j = round(((1 - w) * points[n, 1] + w * points[n + 1, 1] - origin[1]) / spacing)
            k = round(((1 - w) * points[n, 2] + w * points[n + 1, 2] - origin[2]) / spacing)
            laid[i, j, k] = min(laid[i, j, k], number)


@kernel(inline="always")
def _box_gap(x, y, z, low, high):
    dx = max(max(low[0] - x, x - high[0]), 0.0)
    dy = max(max(low[1] - y, y - high[1]), 0.0)
    dz = max(max(low[2] - z, z - high[2]), 0.0)
    return dx * dx + dy * dy + dz * dz


@kernel
def _voxel_near(x, y, z, reach, now, laid, origin, spacing):
    """Number of a pass before `now` with a voxel that far from a point; NEVER where none is."""
    wide = reach + _HALF_DIAGONAL * spacing
    i0 = max(math.ceil((x - wide - origin[0]) / spacing), 0)
    j0 = max(math.ceil((y - wide - origin[1]) / spacing), 0)
    k0 = max(math.ceil((z - wide - origin[2]) / spacing), 0)
    i1 = min(math.floor((x + wide - origin[0]) / spacing), laid.shape[0] - 1)
    j1 = min(math.floor((y + wide - origin[1]) / spacing), laid.shape[1] - 1)
    k1 = min(math.floor((z + wide - origin[2]) / spacing), laid.shape[2] - 1)
    square = wide * wide
    for i in range(i0, i1 + 1):
        dx = x - origin[0] - i * spacing
        for j in range(j0, j1 + 1):
            dy = y - origin[1] - j * spacing
            for k in range(k0, k1 + 1):
                if laid[i, j, k] < now:
                    dz = z - origin[2] - k * spacing
                    if dx * dx + dy * dy + dz * dz < square:
                        return laid[i, j, k]
    return NEVER


@kernel
def _touch(frame, trees, begin, end, scene, now, where):
    """Hold one link at a place against what is there; see `touching`."""
    balls, nodes, spans, skip, _, _ = trees
    to_plate, low, high, slack, laid, origin, spacing, reach, first, last, around, gap = scene
    r00, r01, r02, r10, r11, r12, r20, r21, r22, px, py, pz = frame
    found = 0
    n = begin
    while n < end:
        cx, cy, cz, radius = nodes[n, 0], nodes[n, 1], nodes[n, 2], nodes[n, 3]
        x = r00 * cx + r01 * cy + r02 * cz + px
        y = r10 * cx + r11 * cy + r12 * cz + py
        z = r20 * cx + r21 * cy + r22 * cz + pz
        square = radius * radius
        near_print = found < SUBSTRATE and _box_gap(x, y, z, first, last) < square
        u = to_plate[0, 0] * x + to_plate[0, 1] * y + to_plate[0, 2] * z + to_plate[0, 3]
        v = to_plate[1, 0] * x + to_plate[1, 1] * y + to_plate[1, 2] * z + to_plate[1, 3]
        w = to_plate[2, 0] * x + to_plate[2, 1] * y + to_plate[2, 2] * z + to_plate[2, 3]
        near_plate = found & PLATE == 0 and _box_gap(u, v, w, low, high) < square
        if not near_print and not near_plate:
            n = skip[n]
            continue
        if spans[n, 1] - spans[n, 0] > LEAF:
            n += 1
            continue
        for b in range(spans[n, 0], spans[n, 1]):
            cx, cy, cz, radius = balls[b, 0], balls[b, 1], balls[b, 2], balls[b, 3]
            x = r00 * cx + r01 * cy + r02 * cz + px
            y = r10 * cx + r11 * cy + r12 * cz + py
            z = r20 * cx + r21 * cy + r22 * cz + pz
            if near_plate and found & PLATE == 0:
                u = to_plate[0, 0] * x + to_plate[0, 1] * y + to_plate[0, 2] * z + to_plate[0, 3]
                v = to_plate[1, 0] * x + to_plate[1, 1] * y + to_plate[1, 2] * z + to_plate[1, 3]
                w = to_plate[2, 0] * x + to_plate[2, 1] * y + to_plate[2, 2] * z + to_plate[2, 3]
                inside = low[0] + slack < u and u < high[0] - slack
                inside = inside and low[1] + slack < v and v < high[1] - slack
                if inside and low[2] + slack < w and w < high[2] - slack:
                    found |= PLATE
                    where[0, 0], where[0, 1], where[0, 2] = x, y, z
            if near_print and found < SUBSTRATE and gap.size:
                i = round((x - origin[0]) / spacing)
                j = round((y - origin[1]) / spacing)
                k = round((z - origin[2]) / spacing)
                if i < 0 or j < 0 or k < 0:
                    continue
                if i >= gap.shape[0] or j >= gap.shape[1] or k >= gap.shape[2]:
                    continue
                if gap[i, j, k] < radius + reach + _HALF_DIAGONAL * spacing:
                    return found | PRINT
            elif near_print and found < SUBSTRATE:
                i = round((x - origin[0]) / spacing) // COARSE
                j = round((y - origin[1]) / spacing) // COARSE
                k = round((z - origin[2]) / spacing) // COARSE
                if i < 0 or j < 0 or k < 0:
                    continue
                if i >= around.shape[0] or j >= around.shape[1] or k >= around.shape[2]:
                    continue
                if around[i, j, k] >= now:
                    continue
                number = _voxel_near(x, y, z, radius + reach, now, laid, origin, spacing)
                if number < NEVER:
                    bit = 1 if number == ALWAYS else 2
                    found |= SUBSTRATE if number == ALWAYS else PRINT
                    where[bit, 0], where[bit, 1], where[bit, 2] = x, y, z
        n = skip[n]
    return found


@kernel
def touching(chain, q, now, trees, T_part_base, scene, found, where):
    """Hold all links, in many configurations, against what is there.

    Args:
        chain: See `robot.kernels`.
        q: (n, j) joint positions [m, rad].
        now: (n,) passes of smaller number are there.
        trees: Balls (b, 4) in the frames behind the joints [mm], nodes (k, 4), spans
            (k, 2) and skip (k,) of all links, the first node of each and the end (l + 1,),
            and the joint that carries each link (l,).
        T_part_base: (3, 4) base frame [mm] to part frame.
        scene: (3, 4) part frame to plate frame, corners of the plate in that (3,), (3,),
            depth [mm] that is no touch yet, voxels (i, j, k), their origin and spacing, how
            far a bead reaches from its centre, corners of the printed box with that (3,),
            (3,), the earliest pass around each `COARSE` voxels, and the distance from each
            voxel to the nearest that is ever marked (i, j, k): where this is given, it
            takes the place of the passes, and one touching link is enough.
        found: (n, l) written: bits of what each link touches; of substrate and print the
            one that is found first.
        where: (3, 3) written: a touching point of the last link that touches the plate,
            the substrate and the print.
    """
    rotations, offsets, axes, revolute, _, _ = chain
    begins, carrier = trees[4], trees[5]
    t = T_part_base
    for i in range(q.shape[0]):
        r = (t[0, 0], t[0, 1], t[0, 2], t[1, 0], t[1, 1], t[1, 2], t[2, 0], t[2, 1], t[2, 2])
        px, py, pz = t[0, 3], t[1, 3], t[2, 3]
        link = 0
        done = False
        for joint in range(q.shape[1]):
            d = apply(r, offsets[joint])
            px += _MM * d[0]
            py += _MM * d[1]
            pz += _MM * d[2]
            r = composed(r, rotations[joint])
            if revolute[joint]:
                r = turned(r, axes[joint], q[i, joint])
            else:
                a = apply(r, axes[joint])
                px += _MM * a[0] * q[i, joint]
                py += _MM * a[1] * q[i, joint]
                pz += _MM * a[2] * q[i, joint]
            frame = (r[0], r[1], r[2], r[3], r[4], r[5], r[6], r[7], r[8], px, py, pz)
            while link < len(carrier) and carrier[link] == joint and not done:
                found[i, link] = _touch(
                    frame, trees, begins[link], begins[link + 1], scene, now[i], where
                )
                done = scene[11].size > 0 and found[i, link] != 0
                link += 1
