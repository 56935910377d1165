# SPDX-License-Identifier: Apache-2.0
# mypy: disable-error-code="no-untyped-def"
"""Kernels that draw a mesh into a signed field and compare two fields by volume."""

from __future__ import annotations

import numpy as np

from vega_planner.assess.bead_kernels import LIMIT, STEPS
from vega_planner.assess.closest_kernels import closest
from vega_planner.assess.sample_kernels import SUB
from vega_planner.compiled import kernel

#: Steps by which a field may differ from an exact distance by rounding.
_ROUNDING = 2
#: Edge lengths [nodes] of the blocks that are asked as a whole, largest first.
_BLOCKS = (16, 4, 2, 1)


def _sample_weights() -> np.ndarray:
    """Trilinear weights of a cell's corners at its samples, shape (SUB³, 8)."""
    at = (np.arange(SUB) + 0.5) / SUB
    z, y, x = (axis.ravel()[:, None] for axis in np.meshgrid(at, at, at, indexing="ij"))
    corner = np.arange(8)
    return (
        np.where(corner & 4, z, 1 - z)
        * np.where(corner & 2, y, 1 - y)
        * np.where(corner & 1, x, 1 - x)
    )


_WEIGHTS = _sample_weights()


@kernel
def _signed(corners, order, boxes, first_leaf, normals, x, y, z, hint, bound, foot):
    distance2, face, feature = closest(
        corners, order, boxes, first_leaf, x, y, z, hint, bound * bound, foot
    )
    if face < 0:
        return bound, face
    side = (
        (x - foot[0]) * normals[face, feature, 0]
        + (y - foot[1]) * normals[face, feature, 1]
        + (z - foot[2]) * normals[face, feature, 2]
    )
    distance = np.sqrt(distance2)
    return (-distance if side < 0 else distance), face


@kernel
def draw_mesh(field, first_z, origin, voxel, band, corners, order, boxes, first_leaf, normals):
    """Fill a slab with the signed distance to a closed mesh, exact within a band.

    Blocks of nodes are settled by one query at their middle where the surface is too
    far away to matter, and cut into smaller blocks where it is not.

    Args:
        field: Slab to fill, int16 in steps of voxel / STEPS, shape (z, y, x).
        first_z: Index of the slab's first plane.
        origin: Place of node 0, 0, 0, shape (3,).
        voxel: Distance of the nodes.
        band: Distance up to which the values are exact; beyond they are the limits.
        corners: Triangle corners, shape (m, 3, 3).
        order: Triangles in Morton order.
        boxes: Heap of boxes.
        first_leaf: Heap index of the first leaf.
        normals: Normals of the faces' features, shape (m, 7, 3).
    """
    count_z, count_y, count_x = field.shape
    foot = np.empty(3)
    stack = np.empty((4096, 5), np.int64)
    hint = -1
    scale = STEPS / voxel
    size = _BLOCKS[0]
    for bz in range(0, count_z, size):
        for by in range(0, count_y, size):
            for bx in range(0, count_x, size):
                top = 1
                stack[0, 0], stack[0, 1], stack[0, 2] = bz, by, bx
                stack[0, 3], stack[0, 4] = 0, hint
                while top > 0:
                    top -= 1
                    z0, y0, x0 = stack[top, 0], stack[top, 1], stack[top, 2]
                    level, near = stack[top, 3], stack[top, 4]
                    edge = _BLOCKS[level]
                    half = 0.5 * (edge - 1)
                    reach = np.sqrt(3.0) * half * voxel
                    z1, y1 = min(z0 + edge, count_z), min(y0 + edge, count_y)
                    x1 = min(x0 + edge, count_x)
                    distance, face = _signed(
                        corners, order, boxes, first_leaf, normals,
                        origin[0] + (x0 + half) * voxel,
                        origin[1] + (y0 + half) * voxel,
                        origin[2] + (z0 + first_z + half) * voxel,
                        near, reach + band if level == 0 else np.inf, foot,
                    )  # fmt: skip
                    if face < 0:
                        # No surface near: the same side as the block before, and the
                        # first block of a row is outside. (The query for the distance
                        # would be slow in the middle of round parts.)
                        inside = x0 > 0 and field[z0, y0, x0 - 1] < 0
                        field[z0:z1, y0:y1, x0:x1] = -LIMIT if inside else LIMIT
                        continue
                    hint = face
                    if edge == 1:
                        value = min(max(distance * scale, -LIMIT), LIMIT)
                        if abs(distance) > band:
                            value = LIMIT if distance > 0 else -LIMIT
                        field[z0, y0, x0] = np.int16(value)
                    elif abs(distance) > reach + band:
                        field[z0:z1, y0:y1, x0:x1] = LIMIT if distance > 0 else -LIMIT
                    else:
                        smaller = _BLOCKS[level + 1]
                        for z in range(z0, z1, smaller):
                            for y in range(y0, y1, smaller):
                                for x in range(x0, x1, smaller):
                                    stack[top, 0], stack[top, 1], stack[top, 2] = z, y, x
                                    stack[top, 3], stack[top, 4] = level + 1, face
                                    top += 1


@kernel
def _coverage(value, all_inside, step):
    if all_inside:
        return 1.0
    return min(max(0.5 - value / step, 0.0), 1.0)


@kernel
def _corner_values(field, z, y, x, values):
    """Collect the corners of a cell; returns whether all are inside, and all outside."""
    inside, outside = True, True
    for k in range(8):
        value = field[z + (k >> 2), y + ((k >> 1) & 1), x + (k & 1)]
        values[k] = value
        inside = inside and value < 0
        outside = outside and value >= 0
    return inside, outside


@kernel
def _is_exact(corners, samples):
    """Tell whether the beads alone make a cell: nothing in it was filled or cut."""
    for k in range(8):
        exact = samples[SUB**3 + k]
        if (corners[k] < 0 and exact > _ROUNDING) or (corners[k] > 0 and exact < -_ROUNDING):
            return False
    return True


@kernel
def compare_fields(printed, target, first_z, last_z, looked_at, samples):
    """Measure by volume where two solids differ, cell by cell.

    A cell that both surfaces miss counts whole. Others are sampled: the fields are
    turned into the share of the sample's volume that is inside. Where the cell was
    looked at closely, its samples are used; else the fields are interpolated.

    Args:
        printed: Signed field of the print, shape (z, y, x).
        target: Signed field of the target, same shape.
        first_z: First plane of cells to compare.
        last_z: Plane of cells after the last.
        looked_at: Cells whose samples are known, ascending, shape (n,).
        samples: Distances to the print there, see `sample_kernels.sample_beads`.

    Returns:
        Cells that differ, as index of their first node, (n,); their under- and
        overshoot in voxels, (n, 2); volumes of print and target in voxels, (2,).
    """
    _, count_y, count_x = printed.shape
    a, b = np.empty(8), np.empty(8)
    step = STEPS / SUB
    weight = 1.0 / SUB**3
    cells, parts = np.empty(1024, np.int64), np.empty((1024, 2))
    volumes = np.zeros(2)
    count, known = 0, 0
    for z in range(first_z, last_z):
        for y in range(count_y - 1):
            for x in range(count_x - 1):
                at = (z * count_y + y) * count_x + x
                while known < len(looked_at) and looked_at[known] < at:
                    known += 1
                inside_p, outside_p = _corner_values(printed, z, y, x, a)
                inside_t, outside_t = _corner_values(target, z, y, x, b)
                under, over = 0.0, 0.0
                exact = known < len(looked_at) and looked_at[known] == at
                exact = exact and _is_exact(a, samples[known])
                if not exact and (inside_p or outside_p) and (inside_t or outside_t):
                    if inside_p:
                        volumes[0] += 1.0
                    if inside_t:
                        volumes[1] += 1.0
                    if inside_p == inside_t:
                        continue
                    under, over = (1.0, 0.0) if inside_t else (0.0, 1.0)
                else:
                    for s in range(SUB**3):
                        p, t = 0.0, 0.0
                        for k in range(8):
                            p += _WEIGHTS[s, k] * a[k]
                            t += _WEIGHTS[s, k] * b[k]
                        if exact:
                            p = _coverage(float(samples[known, s]), False, step)
                        else:
                            p = 0.0 if outside_p else _coverage(p, inside_p, step)
                        t = 0.0 if outside_t else _coverage(t, inside_t, step)
                        volumes[0] += p * weight
                        volumes[1] += t * weight
                        under += max(t - p, 0.0) * weight
                        over += max(p - t, 0.0) * weight
                    if under == 0 and over == 0:
                        continue
                if count == len(cells):
                    more_cells, more_parts = (
                        np.empty(2 * count, np.int64),
                        np.empty((2 * count, 2)),
                    )
                    more_cells[:count], more_parts[:count] = cells, parts
                    cells, parts = more_cells, more_parts
                cells[count] = at
                parts[count, 0], parts[count, 1] = under, over
                count += 1
    return cells[:count].copy(), parts[:count].copy(), volumes
