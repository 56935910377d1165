# SPDX-License-Identifier: Apache-2.0
# mypy: disable-error-code="no-untyped-def"
"""Kernel that tries poses of a scan against the distance field of its target."""

from __future__ import annotations

import numpy as np

from vega_planner.compiled import kernel


@kernel
def _frame(p, q, n, m, frame):
    """Frame of two points with normals: along their line, along the mean normal, across."""
    length, along = 0.0, 0.0
    for k in range(3):
        frame[k, 0] = q[k] - p[k]
        length += frame[k, 0] ** 2
    length = np.sqrt(length)
    for k in range(3):
        frame[k, 0] /= length
        along += (n[k] + m[k]) * frame[k, 0]
    up = 0.0
    for k in range(3):
        frame[k, 1] = n[k] + m[k] - along * frame[k, 0]
        up += frame[k, 1] ** 2
    up = np.sqrt(up)
    if up < 0.3:
        return False
    for k in range(3):
        frame[k, 1] /= up
    frame[0, 2] = frame[1, 0] * frame[2, 1] - frame[2, 0] * frame[1, 1]
    frame[1, 2] = frame[2, 0] * frame[0, 1] - frame[0, 0] * frame[2, 1]
    frame[2, 2] = frame[0, 0] * frame[1, 1] - frame[1, 0] * frame[0, 1]
    return True


@kernel
def _misfit(pose, probes, grid, origin, step, limit, give_up):
    """Mean distance of moved points to the target, each at most `limit`."""
    total, enough = 0.0, give_up * len(probes)
    nz, ny, nx = grid.shape
    for i in range(len(probes)):
        x = pose[0, 3] - origin[0]
        y = pose[1, 3] - origin[1]
        z = pose[2, 3] - origin[2]
        for k in range(3):
            x += pose[0, k] * probes[i, k]
            y += pose[1, k] * probes[i, k]
            z += pose[2, k] * probes[i, k]
        ix, iy, iz = int(np.rint(x / step)), int(np.rint(y / step)), int(np.rint(z / step))
        if 0 <= ix < nx and 0 <= iy < ny and 0 <= iz < nz:
            total += min(grid[iz, iy, ix], limit)
        else:
            total += limit
        if total > enough:
            return np.inf
    return total / len(probes)


@kernel
def try_pairs(
    scan, scan_normals, scan_pairs, target, target_normals, target_pairs, first, last, most,
    probes, grid, origin, step, limit, poses, scores,
):  # fmt: skip
    """Try the poses that lay pairs of scan points onto similar pairs of the target.

    Args:
        scan: Scan points, shape (n, 3).
        scan_normals: Their normals, shape (n, 3).
        scan_pairs: Pairs to lay, shape (p, 2).
        target: Target points, shape (m, 3).
        target_normals: Their normals, shape (m, 3).
        target_pairs: Pairs sorted by their features, shape (q, 2).
        first: First similar target pair of each scan pair, shape (p,).
        last: One after the last of them, shape (p,).
        most: Largest number of target pairs tried for one scan pair.
        probes: Scan points the poses are judged by, shape (k, 3).
        grid: Distances to the target on a grid, shape (z, y, x).
        origin: Place of its node 0, 0, 0, shape (3,).
        step: Distance of its nodes.
        limit: Distance from which a point counts as a miss.
        poses: Receives the best poses, shape (b, 4, 4).
        scores: Receives their misfits, initially infinite, shape (b,).
    """
    here, there = np.empty((3, 3)), np.empty((3, 3))
    pose = np.eye(4)
    worst = 0
    for pair in range(len(scan_pairs)):
        a, b = scan_pairs[pair, 0], scan_pairs[pair, 1]
        if not _frame(scan[a], scan[b], scan_normals[a], scan_normals[b], here):
            continue
        stride = max(1, (last[pair] - first[pair] + most - 1) // most)
        for other in range(first[pair] + pair % stride, last[pair], stride):
            c, d = target_pairs[other, 0], target_pairs[other, 1]
            if not _frame(target[c], target[d], target_normals[c], target_normals[d], there):
                continue
            for i in range(3):
                for j in range(3):
                    pose[i, j] = 0.0
                    for k in range(3):
                        pose[i, j] += there[i, k] * here[j, k]
            for i in range(3):
                pose[i, 3] = 0.5 * (target[c, i] + target[d, i])
                for j in range(3):
                    pose[i, 3] -= pose[i, j] * 0.5 * (scan[a, j] + scan[b, j])
            score = _misfit(pose, probes, grid, origin, step, limit, scores[worst])
            if score < scores[worst]:
                scores[worst] = score
                poses[worst] = pose
                worst = np.argmax(scores)
