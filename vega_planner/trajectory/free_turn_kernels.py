# SPDX-License-Identifier: Apache-2.0
# mypy: disable-error-code="no-untyped-def"
"""Compiled ladder of configurations along a path: every family of the arm, every turn."""

from __future__ import annotations

import math

import numpy as np

from vega_planner.compiled import kernel
from vega_planner.robot.kernels import LENGTH, forward_one, jacobian_one, solve_one, workspace


@kernel
def turned_side(axis, side, angle, out):
    """Turn a side by an angle about the axis it is square to; no side stays no side."""
    if side.shape[0] == 0:
        return
    c, s = math.cos(angle), math.sin(angle)
    out[0] = c * side[0] + s * (axis[1] * side[2] - axis[2] * side[1])
    out[1] = c * side[1] + s * (axis[2] * side[0] - axis[0] * side[2])
    out[2] = c * side[2] + s * (axis[0] * side[1] - axis[1] * side[0])


@kernel
def manipulability(chain, q, work, gram):
    """Yoshikawa's measure, the square root of det J J^T, of the arm with lengths over LENGTH."""
    jacobian, world, centres = work[0], work[1], work[2]
    tip, frame = work[5], work[6]
    forward_one(chain, q, tip, frame, world, centres)
    jacobian_one(chain[3], tip, world, centres, jacobian)
    n = q.shape[0]
    for i in range(6):
        for j in range(6):
            total = 0.0
            for k in range(n):
                total += jacobian[i, k] * jacobian[j, k]
            if i < 3:
                total /= LENGTH
            if j < 3:
                total /= LENGTH
            gram[i, j] = total
    det = 1.0
    for i in range(6):
        pivot = gram[i, i]
        if pivot <= 1e-18:
            return 0.0
        det *= pivot
        for j in range(i + 1, 6):
            factor = gram[j, i] / pivot
            for k in range(i, 6):
                gram[j, k] -= factor * gram[i, k]
    return math.sqrt(det)


@kernel
def ring(chain, lower, upper, point, axis, side, start, angle, tolerance, limit, q, found):
    """Carry one configuration round the nozzle: q (r, j) at even turns, from the nearest on.

    `angle` is the turn that `start` has against `side`.
    """
    count, joints = q.shape
    work = workspace(joints)
    turned = np.zeros(3)
    step = 2.0 * math.pi / count
    first = round(angle / step) % count
    for way in (1, -1):
        trial = start.copy()
        for k in range(count // 2 + 1):
            at = (first + way * k) % count
            if k > 0 and found[at]:
                continue
            turned_side(axis, side, at * step, turned)
            ok = solve_one(chain, lower, upper, point, axis, turned, trial, tolerance, limit, work)
            if ok <= 0:
                break
            found[at] = True
            q[at] = trial


@kernel
def ladder(
    chain, lower, upper, points, axes, sides, seeds, known, tolerance, limit, q, found, measure
):
    """Carry families of rings along a path.

    seeds (f, r, j) and known (f, r) hold at the first pose; q (n, f * r, j), found and
    measure (n, f * r) are filled in. A rung that fails at one pose is tried again at the next,
    from its own last configuration or from a neighbour on the ring.
    """
    families, rungs, joints = seeds.shape
    work = workspace(joints)
    gram = np.zeros((6, 6))
    turned = np.zeros(sides.shape[1])
    step = 2.0 * math.pi / rungs
    last = seeds.copy()
    alive = known.copy()
    trial = np.zeros(joints)
    for i in range(points.shape[0]):
        for f in range(families):
            for r in range(rungs):
                at = f * rungs + r
                found[i, at] = False
                turned_side(axes[i], sides[i], r * step, turned)
                for attempt in range(3):
                    source = (r + (0, 1, rungs - 1)[attempt]) % rungs
                    if not alive[f, source]:
                        continue
                    trial[:] = last[f, source]
                    steps = solve_one(
                        chain,
                        lower,
                        upper,
                        points[i],
                        axes[i],
                        turned,
                        trial,
                        tolerance,
                        limit,
                        work,
                    )
                    if steps > 0:
                        found[i, at] = True
                        break
                alive[f, r] = found[i, at]
                if found[i, at]:
                    last[f, r] = trial
                    q[i, at] = trial
                    measure[i, at] = manipulability(chain, trial, work, gram)
