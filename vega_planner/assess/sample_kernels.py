# SPDX-License-Identifier: Apache-2.0
# mypy: disable-error-code="no-untyped-def"
"""Kernels that look at the cells on a print's surface more closely than its nodes do."""

from __future__ import annotations

import numpy as np

from vega_planner.assess.bead_kernels import LIMIT, STEPS
from vega_planner.compiled import kernel

#: Samples along each side of a cell that a surface passes.
SUB = 4
#: Samples of a cell: those inside it, then its corners.
SAMPLES = SUB**3 + 8
#: Half the diagonal of a cell [voxels], and a little for sections that change.
_REACH = 0.9


@kernel
def surface_cells(printed, first_z, last_z, floor):
    """List the cells that the seen surface passes, or that lie beside one.

    Args:
        printed: Signed field of the print, its voids filled, shape (z, y, x).
        first_z: First plane of cells.
        last_z: Plane of cells after the last.
        floor: First plane of nodes above the plate: what lies on it is not seen.

    Returns:
        Index of the cells' first nodes, ascending, shape (n,).
    """
    count_z, count_y, count_x = printed.shape
    found = np.empty(4096, np.int64)
    count = 0
    far, deep = 1.8 * STEPS, -1.8 * STEPS
    for z in range(max(first_z, floor), last_z):
        for y in range(count_y - 1):
            for x in range(count_x - 1):
                low, high = LIMIT, -LIMIT
                for k in range(8):
                    value = printed[z + (k >> 2), y + ((k >> 1) & 1), x + (k & 1)]
                    low, high = min(low, value), max(high, value)
                if low > far or high < deep:
                    continue
                if high <= 0:
                    for dz in range(max(z - 1, floor), min(z + 3, count_z)):
                        for dy in range(max(y - 1, 0), min(y + 3, count_y)):
                            for dx in range(max(x - 1, 0), min(x + 3, count_x)):
                                high = max(high, printed[dz, dy, dx])
                if high <= 0:
                    continue
                if count == len(found):
                    longer = np.empty(2 * count, np.int64)
                    longer[:count] = found
                    found = longer
                found[count] = (z * count_y + y) * count_x + x
                count += 1
    return found[:count].copy()


@kernel(inline="always", fastmath=True)
def _value(x, y, z, direction, inverse, up, turn, size, more):
    """Signed distance to a bead of a point relative to its start."""
    t = (x * direction[0] + y * direction[1] + z * direction[2]) * inverse
    t = min(max(t, 0.0), 1.0)
    rx, ry, rz = x - t * direction[0], y - t * direction[1], z - t * direction[2]
    bx, by, bz = up[0] + t * turn[0], up[1] + t * turn[1], up[2] + t * turn[2]
    along = rx * bx + ry * by + rz * bz
    along2 = along * along / (bx * bx + by * by + bz * bz)
    across2 = max(rx * rx + ry * ry + rz * rz - along2, 0.0)
    out = max(np.sqrt(across2) - size[0] - t * more[0], 0.0)
    above = max(np.sqrt(along2) - size[1] - t * more[1], 0.0)
    return np.sqrt(out * out + above * above) - size[2] - t * more[2]


@kernel(error_model="numpy")
def sample_beads(cells, shape, origin, voxel, chosen, starts, ends, up0, up1, section, samples):
    """Measure the signed distance to the union of beads at samples of cells.

    The beads are those of `bead_kernels.draw_beads`.

    Args:
        cells: Index of the cells' first nodes, ascending, shape (n,).
        shape: Number of nodes along z, y and x.
        origin: Place of node 0, 0, 0, shape (3,).
        voxel: Distance of the nodes.
        chosen: Segments to measure, shape (c,).
        starts: Start points, shape (s, 3).
        ends: End points, shape (s, 3).
        up0: Section's height direction at the start, shape (s, 3).
        up1: The same at the end.
        section: Width and height at the start, then at the end, shape (s, 4).
        samples: Receives the least distances in steps of voxel / STEPS, x fastest, and
            those at the corners; shape (n, SAMPLES) int16, filled with LIMIT.
    """
    if len(cells) == 0:
        return
    count_y, count_x = shape[1], shape[2]
    first_row, last_row = cells[0] // count_x, cells[-1] // count_x
    begin = np.zeros(last_row - first_row + 2, np.int64)
    for cell in cells:
        begin[cell // count_x - first_row + 1] += 1
    for row in range(len(begin) - 1):
        begin[row + 1] += begin[row]
    low, high = np.empty(3, np.int64), np.empty(3, np.int64)
    direction, up, turn = np.empty(3), np.empty(3), np.empty(3)
    size, more = np.empty(3), np.empty(3)
    scale = STEPS / voxel
    reach = _REACH * voxel
    for s in chosen:
        thick0, thick1 = min(section[s, 0], section[s, 1]), min(section[s, 2], section[s, 3])
        size[0], size[1] = 0.5 * (section[s, 0] - thick0), 0.5 * (section[s, 1] - thick0)
        more[0] = 0.5 * (section[s, 2] - thick1) - size[0]
        more[1] = 0.5 * (section[s, 3] - thick1) - size[1]
        size[2], more[2] = 0.5 * thick0, 0.5 * (thick1 - thick0)
        length2 = 0.0
        for k in range(3):
            direction[k] = ends[s, k] - starts[s, k]
            up[k], turn[k] = up0[s, k], up1[s, k] - up0[s, k]
            length2 += direction[k] ** 2
            side = np.sqrt(max(1 - min(up0[s, k] ** 2, up1[s, k] ** 2), 0.0))
            rise = max(abs(up0[s, k]), abs(up1[s, k]))
            wide = (
                max(size[0], size[0] + more[0]) * side
                + max(size[1], size[1] + more[1]) * rise
                + 0.5 * max(thick0, thick1)
                + voxel
            )
            low[k] = np.int64(np.floor((min(starts[s, k], ends[s, k]) - wide - origin[k]) / voxel))
            high[k] = np.int64(np.ceil((max(starts[s, k], ends[s, k]) + wide - origin[k]) / voxel))
        inverse = 1 / length2 if length2 > 0 else 0.0
        for iz in range(low[2], high[2] + 1):
            for iy in range(max(low[1], 0), min(high[1], count_y - 1) + 1):
                row = iz * count_y + iy - first_row
                if row < 0 or row >= len(begin) - 1:
                    continue
                a, b = begin[row], begin[row + 1]
                if a == b:
                    continue
                base = (row + first_row) * count_x
                a += np.searchsorted(cells[a:b], base + low[0])
                z = origin[2] + iz * voxel - starts[s, 2]
                y = origin[1] + iy * voxel - starts[s, 1]
                for n in range(a, b):
                    ix = cells[n] - base
                    if ix > high[0]:
                        break
                    x = origin[0] + ix * voxel - starts[s, 0]
                    half = 0.5 * voxel
                    middle = _value(
                        x + half, y + half, z + half, direction, inverse, up, turn, size, more
                    )
                    if middle > reach:
                        continue
                    for k in range(SAMPLES):
                        if k < SUB**3:
                            dx = (k % SUB + 0.5) / SUB
                            dy = (k // SUB % SUB + 0.5) / SUB
                            dz = (k // SUB**2 + 0.5) / SUB
                        else:
                            corner = k - SUB**3
                            dx, dy, dz = corner & 1, corner >> 1 & 1, corner >> 2
                        value = _value(
                            x + dx * voxel, y + dy * voxel, z + dz * voxel,
                            direction, inverse, up, turn, size, more,
                        )  # fmt: skip
                        value = min(max(value * scale, -LIMIT), LIMIT)
                        samples[n, k] = min(samples[n, k], np.int16(value))
