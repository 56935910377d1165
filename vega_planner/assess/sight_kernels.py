# SPDX-License-Identifier: Apache-2.0
# mypy: disable-error-code="no-untyped-def"
"""Kernels that find which empty space can be seen from outside.

Empty nodes are collected as runs along x, and runs that touch are joined in a union-find
forest: a grid of 60 million nodes holds a few hundred thousand runs.
"""

from __future__ import annotations

import numpy as np

from vega_planner.compiled import kernel
from vega_planner.part.surface_kernels import find_root


@kernel
def find_runs(field, threshold, seen, skip_seen):
    """Collect runs of nodes at or above a threshold.

    Args:
        field: Signed field, shape (z, y, x) int16.
        threshold: Least value of a node in a run.
        seen: Marks, shape of the field, uint8.
        skip_seen: Whether marked nodes interrupt runs.

    Returns:
        Index of each row's first run, (z y + 1,); first and last node of the runs, (r, 2).
    """
    count_z, count_y, count_x = field.shape
    rows = np.zeros(count_z * count_y + 1, np.int64)
    runs = np.empty((1024, 2), np.int32)
    total = 0
    for row in range(count_z * count_y):
        iz, iy = row // count_y, row % count_y
        inside = False
        for ix in range(count_x):
            free = field[iz, iy, ix] >= threshold and not (skip_seen and seen[iz, iy, ix] > 0)
            if free and not inside:
                if total == len(runs):
                    longer = np.empty((2 * total, 2), np.int32)
                    longer[:total] = runs
                    runs = longer
                runs[total, 0] = ix
            if inside and not free:
                runs[total, 1] = ix - 1
                total += 1
            inside = free
        if inside:
            runs[total, 1] = count_x - 1
            total += 1
        rows[row + 1] = total
    return rows, runs[:total].copy()


@kernel
def join_runs(rows, runs, count_z, count_y):
    """Join runs that touch across rows and planes.

    Returns:
        Representative of each run's component, shape (r,).
    """
    parents = np.arange(len(runs))
    for iz in range(count_z):
        for iy in range(count_y):
            row = iz * count_y + iy
            for step in range(2):
                if (step == 0 and iy == 0) or (step == 1 and iz == 0):
                    continue
                other = row - 1 if step == 0 else row - count_y
                a, b = rows[row], rows[other]
                while a < rows[row + 1] and b < rows[other + 1]:
                    if runs[a, 1] < runs[b, 0]:
                        a += 1
                    elif runs[b, 1] < runs[a, 0]:
                        b += 1
                    else:
                        left, right = find_root(parents, a), find_root(parents, b)
                        if left != right:
                            parents[max(left, right)] = min(left, right)
                        if runs[a, 1] < runs[b, 1]:
                            a += 1
                        else:
                            b += 1
    for run in range(len(runs)):
        parents[run] = find_root(parents, run)
    return parents


@kernel
def mark_outside(rows, runs, parents, seen):
    """Mark the components of runs that reach the grid's sides or top.

    Args:
        rows: Index of each row's first run.
        runs: First and last node of each run.
        parents: Component of each run.
        seen: Receives 1 for the nodes of these components, shape (z, y, x).
    """
    count_z, count_y, count_x = seen.shape
    open_runs = np.zeros(len(runs), np.bool_)
    for row in range(count_z * count_y):
        iz, iy = row // count_y, row % count_y
        side = iy == 0 or iy == count_y - 1 or iz == count_z - 1
        for run in range(rows[row], rows[row + 1]):
            if side or runs[run, 0] == 0 or runs[run, 1] == count_x - 1:
                open_runs[parents[run]] = True
    for row in range(count_z * count_y):
        iz, iy = row // count_y, row % count_y
        for run in range(rows[row], rows[row + 1]):
            if open_runs[parents[run]]:
                for ix in range(runs[run, 0], runs[run, 1] + 1):
                    seen[iz, iy, ix] = 1


@kernel
def spread(field, seen, steps):
    """Let marks spread into empty nodes beside them, at most a number of steps.

    Args:
        field: Signed field; nodes above zero are empty, shape (z, y, x).
        seen: Marks, 1 where seen; receives 1 + step where the marks spread.
        steps: Number of steps, below 254.
    """
    count_z, count_y, count_x = field.shape
    candidates = np.empty(1024, np.int64)
    count = 0
    for iz in range(count_z):
        for iy in range(count_y):
            for ix in range(count_x):
                if field[iz, iy, ix] > 0 and seen[iz, iy, ix] == 0:
                    if count == len(candidates):
                        longer = np.empty(2 * count, np.int64)
                        longer[:count] = candidates
                        candidates = longer
                    candidates[count] = (iz * count_y + iy) * count_x + ix
                    count += 1
    for step in range(1, steps + 1):
        left = 0
        for i in range(count):
            at = candidates[i]
            ix, iy, iz = at % count_x, (at // count_x) % count_y, at // (count_x * count_y)
            near = False
            for k in range(6):
                jx = ix + (1 if k == 0 else 0) - (1 if k == 1 else 0)
                jy = iy + (1 if k == 2 else 0) - (1 if k == 3 else 0)
                jz = iz + (1 if k == 4 else 0) - (1 if k == 5 else 0)
                if 0 <= jx < count_x and 0 <= jy < count_y and 0 <= jz < count_z:
                    mark = seen[jz, jy, jx]
                    near = near or (mark > 0 and mark <= step)
            if near:
                seen[iz, iy, ix] = step + 1
            else:
                candidates[left] = at
                left += 1
        if left == count:
            return
        count = left


@kernel
def fill_unseen(field, rows, runs, parents, steps_per_voxel):
    """Fill the empty nodes of runs and measure what was filled.

    Args:
        field: Signed field; the runs' nodes change their sign, shape (z, y, x).
        rows: Index of each row's first run.
        runs: First and last node of each run.
        parents: Component of each run.
        steps_per_voxel: Field value of one voxel's length.

    Returns:
        Volumes of the components in voxels, shape (r,), at their representatives.
    """
    count_y = field.shape[1]
    volumes = np.zeros(len(runs))
    for row in range(len(rows) - 1):
        iz, iy = row // count_y, row % count_y
        for run in range(rows[row], rows[row + 1]):
            for ix in range(runs[run, 0], runs[run, 1] + 1):
                value = field[iz, iy, ix]
                if value > 0:  # a node on a surface, by rounding, is no void
                    volumes[parents[run]] += min(0.5 + value / steps_per_voxel, 1.0)
                field[iz, iy, ix] = -max(value, 1)
    return volumes
