# SPDX-License-Identifier: Apache-2.0
# mypy: disable-error-code="no-untyped-def"
"""Compiled closed-form inverse kinematics of three linear and two rotary axes."""

from __future__ import annotations

import math

import numpy as np

from vega_planner.compiled import kernel

#: Slack on the joint limits [m, rad]: rounding must not refuse a pose on a limit.
LIMIT_SLACK = 1e-9


@kernel(inline="always")
def _turn(w, c, s, v):
    """Rotate v about the unit vector w by the angle with cosine c and sine s."""
    d = (w[0] * v[0] + w[1] * v[1] + w[2] * v[2]) * (1.0 - c)
    return (
        v[0] * c + (w[1] * v[2] - w[2] * v[1]) * s + w[0] * d,
        v[1] * c + (w[2] * v[0] - w[0] * v[2]) * s + w[1] * d,
        v[2] * c + (w[0] * v[1] - w[1] * v[0]) * s + w[2] * d,
    )


@kernel(inline="always")
def _angle(w, a, b):
    """Cosine and sine of the turn about w that brings the direction of a over b's."""
    aw = a[0] * w[0] + a[1] * w[1] + a[2] * w[2]
    bw = b[0] * w[0] + b[1] * w[1] + b[2] * w[2]
    ax, ay, az = a[0] - aw * w[0], a[1] - aw * w[1], a[2] - aw * w[2]
    bx, by, bz = b[0] - bw * w[0], b[1] - bw * w[1], b[2] - bw * w[2]
    c = ax * bx + ay * by + az * bz
    s = w[0] * (ay * bz - az * by) + w[1] * (az * bx - ax * bz) + w[2] * (ax * by - ay * bx)
    h = math.sqrt(c * c + s * s)
    if h < 1e-15:
        return 1.0, 0.0
    return c / h, s / h


@kernel(inline="always")
def into_limits(angle, lower, upper):
    """The equal angle that lies within the limits and nearest to their middle."""
    middle = 0.0
    if lower > -1e8 and upper < 1e8:
        middle = 0.5 * (lower + upper)
    return angle - 2.0 * math.pi * math.floor((angle - middle) / (2.0 * math.pi) + 0.5)


@kernel
def linear_axes(geometry, point, c1, s1, c2, s2, out):
    """Linear joint positions that bring the tip to a point, for given rotary angles."""
    inverse, w1, w2, arm2, arm1, base = geometry[:6]
    v = _turn(w2, c2, s2, arm2)
    v = _turn(w1, c1, s1, (v[0] + arm1[0], v[1] + arm1[1], v[2] + arm1[2]))
    x, y, z = point[0] - base[0] - v[0], point[1] - base[1] - v[1], point[2] - base[2] - v[2]
    for k in range(3):
        out[k] = inverse[k, 0] * x + inverse[k, 1] * y + inverse[k, 2] * z


@kernel
def solve_many(geometry, lower, upper, points, axes, first_only, q, valid, wrist):
    """Both branches of Paden and Kahan's second subproblem for each target.

    With w1, w2 the rotary axes, u0 the nozzle at rest and U the wanted axis, z = R2 u0 =
    R1^T U is written z = a w1 + b w2 +- g w1 x w2; the linear axes then take what is left.

    q (n, 2, 5); valid: within all limits; wrist: within the rotary limits alone. With
    `first_only` the second branch is left out where the first one is valid.
    """
    w1, w2, u0 = geometry[1], geometry[2], geometry[6]
    d = w1[0] * w2[0] + w1[1] * w2[1] + w1[2] * w2[2]
    k2 = w2[0] * u0[0] + w2[1] * u0[1] + w2[2] * u0[2]
    square = 1.0 - d * d
    cross = (
        w1[1] * w2[2] - w1[2] * w2[1],
        w1[2] * w2[0] - w1[0] * w2[2],
        w1[0] * w2[1] - w1[1] * w2[0],
    )
    for i in range(points.shape[0]):
        u = axes[i]
        k1 = u[0] * w1[0] + u[1] * w1[1] + u[2] * w1[2]
        a = (k1 - d * k2) / square
        b = (k2 - d * k1) / square
        g2 = (1.0 - a * a - b * b - 2.0 * a * b * d) / square
        for branch in range(2):
            if branch == 1 and first_only and valid[i, 0]:
                break
            g = math.sqrt(max(g2, 0.0)) * (1.0 - 2.0 * branch)
            z = (
                a * w1[0] + b * w2[0] + g * cross[0],
                a * w1[1] + b * w2[1] + g * cross[1],
                a * w1[2] + b * w2[2] + g * cross[2],
            )
            c2, s2 = _angle(w2, u0, z)
            c1, s1 = _angle(w1, z, u)
            linear_axes(geometry, points[i], c1, s1, c2, s2, q[i, branch])
            q[i, branch, 3] = into_limits(math.atan2(s1, c1), lower[3], upper[3])
            q[i, branch, 4] = into_limits(math.atan2(s2, c2), lower[4], upper[4])
            good = g2 >= -1e-12
            for k in (3, 4):
                x = q[i, branch, k]
                good = good and lower[k] - LIMIT_SLACK <= x and x <= upper[k] + LIMIT_SLACK
            wrist[i, branch] = good
            for k in range(3):
                x = q[i, branch, k]
                good = good and lower[k] - LIMIT_SLACK <= x and x <= upper[k] + LIMIT_SLACK
            valid[i, branch] = good
            if good:
                for k in range(5):
                    q[i, branch, k] = min(max(q[i, branch, k], lower[k]), upper[k])


@kernel
def nearest_second_angle(geometry, axis, first, cosines):
    """Second rotary angle that brings the nozzle nearest to an axis, for a given first one."""
    w1, w2, u0 = geometry[1], geometry[2], geometry[6]
    c1, s1 = math.cos(first), math.sin(first)
    z = _turn(w1, c1, -s1, axis)
    c2, s2 = _angle(w2, u0, z)
    cosines[0], cosines[1], cosines[2], cosines[3] = c1, s1, c2, s2
    return math.atan2(s2, c2)


@kernel
def axis_of(geometry, first, second, out):
    """Nozzle axis at given rotary angles."""
    w1, w2, u0 = geometry[1], geometry[2], geometry[6]
    v = _turn(w2, math.cos(second), math.sin(second), u0)
    v = _turn(w1, math.cos(first), math.sin(first), v)
    for k in range(3):
        out[k] = v[k]


def empty_solutions(n: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Arrays that `solve_many` fills: q (n, 2, 5), valid (n, 2), wrist (n, 2)."""
    return np.zeros((n, 2, 5)), np.zeros((n, 2), np.bool_), np.zeros((n, 2), np.bool_)
