# SPDX-License-Identifier: Apache-2.0
# mypy: disable-error-code="no-untyped-def"
"""Compiled check of how far the nozzle leaves its path between two poses."""

from __future__ import annotations

import math

import numpy as np

from vega_planner.compiled import kernel
from vega_planner.robot.kernels import forward_one


@kernel
def gaps_between(chain, points, axes, path, q, slope, rows, tip_gap, axis_gap):
    """Measure intervals i to i + 1, for i in rows, into tip_gap and axis_gap (len(rows),).

    The tip's distance from the chord, on straight joint moves in the middle and on the cubic
    through q with derivatives `slope` over `path` at three places; the angle between the
    nozzle and the mean axis in the middle, as a chord.
    """
    joints = q.shape[1]
    world, centres = np.zeros((joints, 3)), np.zeros((joints, 3))
    tip, frame, trial = np.zeros(3), np.zeros((2, 3)), np.zeros(joints)
    for r in range(rows.shape[0]):
        i = rows[r]
        for k in range(joints):
            trial[k] = 0.5 * (q[i, k] + q[i + 1, k])
        forward_one(chain, trial, tip, frame, world, centres)
        worst = 0.0
        size = 0.0
        for k in range(3):
            worst += (tip[k] - 0.5 * (points[i, k] + points[i + 1, k])) ** 2
            size += (axes[i, k] + axes[i + 1, k]) ** 2
        size = 1.0 / math.sqrt(size) if size > 0.0 else 0.0
        off = 0.0
        for k in range(3):
            off += (frame[0, k] - size * (axes[i, k] + axes[i + 1, k])) ** 2
        axis_gap[r] = math.sqrt(off)
        square = 0.0
        for k in range(3):
            square += (points[i + 1, k] - points[i, k]) ** 2
        h = path[i + 1] - path[i]
        for w in (0.25, 0.5, 0.75):
            for k in range(joints):
                step = q[i + 1, k] - q[i, k]
                m0, m1 = h * slope[i, k], h * slope[i + 1, k]
                trial[k] = q[i, k] + w * (
                    m0 + w * (3.0 * step - 2.0 * m0 - m1 + w * (m0 + m1 - 2.0 * step))
                )
            forward_one(chain, trial, tip, frame, world, centres)
            along = 0.0
            total = 0.0
            for k in range(3):
                d = tip[k] - points[i, k]
                along += d * (points[i + 1, k] - points[i, k])
                total += d * d
            if square > 0.0:
                total -= along * along / square
            worst = max(worst, total)
        tip_gap[r] = math.sqrt(max(worst, 0.0))
