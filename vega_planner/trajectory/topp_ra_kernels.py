# SPDX-License-Identifier: Apache-2.0
# mypy: disable-error-code="no-untyped-def"
"""Compiled time-optimal timing of one segment of a joint path."""

from __future__ import annotations

import math

import numpy as np

from vega_planner.compiled import kernel


@kernel
def path_slopes(s, q, slope, curvature):
    """First and second derivative of q (n, j) over s (n,) by three-point differences."""
    n, joints = q.shape
    for i in range(n):
        a = max(i - 1, 0)
        b = min(i + 1, n - 1)
        for j in range(joints):
            if a == i or b == i:
                slope[i, j] = (q[b, j] - q[a, j]) / (s[b] - s[a])
                curvature[i, j] = 0.0
            else:
                h0 = s[i] - s[a]
                h1 = s[b] - s[i]
                d0 = (q[i, j] - q[a, j]) / h0
                d1 = (q[b, j] - q[i, j]) / h1
                slope[i, j] = (d0 * h1 + d1 * h0) / (h0 + h1)
                curvature[i, j] = 2.0 * (d1 - d0) / (h0 + h1)


@kernel
def speed_caps(s, q, slope, curvature, speed, velocity, acceleration, caps):
    """Largest squared path speed at each pose that velocities and curvature allow."""
    n, joints = q.shape
    for i in range(n):
        cap = speed[i] * speed[i]
        for j in range(joints):
            steepest = abs(slope[i, j])
            if i > 0:
                steepest = max(steepest, abs(q[i, j] - q[i - 1, j]) / (s[i] - s[i - 1]))
            if i < n - 1:
                steepest = max(steepest, abs(q[i + 1, j] - q[i, j]) / (s[i + 1] - s[i]))
            if steepest > 1e-12:
                cap = min(cap, (velocity[j] / steepest) ** 2)
            # where the joint reverses only the curvature asks for acceleration
            if abs(slope[i, j]) < 1e-9 and abs(curvature[i, j]) > 1e-12:
                cap = min(cap, acceleration[i, j] / abs(curvature[i, j]))
        caps[i] = cap


@kernel(inline="always")
def _narrow(a, b, x, limit, low, low_slope, high, high_slope):
    """Cut the interval of u by |a u + b x| <= limit; the slopes are d/dx of its ends."""
    if a > 1e-9:
        h = (limit - b * x) / a
        l = (-limit - b * x) / a
    elif a < -1e-9:
        h = (-limit - b * x) / a
        l = (limit - b * x) / a
    else:
        return low, low_slope, high, high_slope
    if h < high:
        high = h
        high_slope = -b / a
    if l > low:
        low = l
        low_slope = -b / a
    return low, low_slope, high, high_slope


@kernel
def _interval(i, x, step, reach, slope, curvature, acceleration):
    """Path accelerations u possible from pose i at squared speed x: the ends and d/dx of them.

    The joints' limits are asked at pose i and, with x + 2 u step, at pose i + 1.
    """
    high = (reach - x) / step
    high_slope = -1.0 / step
    low = -x / step
    low_slope = -1.0 / step
    for j in range(slope.shape[1]):
        low, low_slope, high, high_slope = _narrow(
            slope[i, j], curvature[i, j], x, acceleration[i, j], low, low_slope, high, high_slope
        )
        c = curvature[i + 1, j]
        low, low_slope, high, high_slope = _narrow(
            slope[i + 1, j] + step * c,
            c,
            x,
            acceleration[i + 1, j],
            low,
            low_slope,
            high,
            high_slope,
        )
    return low, low_slope, high, high_slope


@kernel
def time_optimal(s, slope, curvature, caps, acceleration, first, last, x):
    """Reachability analysis: the fastest squared path speeds x (n,) under all limits.

    `first` and `last` are the squared speeds at the ends. Backward, the largest speed from
    which the end can still be reached; the width of the interval of accelerations is concave
    and piecewise linear in x, so Newton's steps from above meet its root. Forward, greedily.

    Returns False where no speed is possible.
    """
    n = s.shape[0]
    reach = np.zeros(n)
    reach[n - 1] = min(last, caps[n - 1])
    for i in range(n - 2, -1, -1):
        step = 2.0 * (s[i + 1] - s[i])
        trial = caps[i]
        for _ in range(100):
            low, low_slope, high, high_slope = _interval(
                i, trial, step, reach[i + 1], slope, curvature, acceleration
            )
            width = high - low
            if width >= -1e-12:
                break
            fall = high_slope - low_slope
            if fall >= 0.0:
                trial *= 0.5
            else:
                trial -= width / fall + 1e-15
            if trial <= 0.0:
                trial = 0.0
                break
        reach[i] = trial
    x[0] = min(first, reach[0])
    for i in range(n - 1):
        step = 2.0 * (s[i + 1] - s[i])
        low, _a, high, _b = _interval(i, x[i], step, reach[i + 1], slope, curvature, acceleration)
        x[i + 1] = min(max(x[i] + step * max(high, low), 0.0), reach[i + 1])
        if x[i] + x[i + 1] <= 0.0:
            return False
    return True


@kernel
def hermite_excess(t, q, v, velocity, acceleration, ratio):
    """How far the cubic curves between samples use the limits.

    Fills ratio (n - 1, 2) with the largest |velocity| / limit and |acceleration| / limit of
    each interval; the acceleration of a cubic is largest at an end, the velocity at an end
    or where the acceleration vanishes.
    """
    n, joints = q.shape
    for i in range(n - 1):
        h = t[i + 1] - t[i]
        fastest = 0.0
        hardest = 0.0
        for j in range(joints):
            d = (q[i + 1, j] - q[i, j]) / h
            a0 = (6.0 * d - 4.0 * v[i, j] - 2.0 * v[i + 1, j]) / h
            a1 = (-6.0 * d + 2.0 * v[i, j] + 4.0 * v[i + 1, j]) / h
            hardest = max(hardest, max(abs(a0), abs(a1)) / acceleration[j])
            top = max(abs(v[i, j]), abs(v[i + 1, j]))
            if a0 * a1 < 0.0:
                w = a0 / (a0 - a1)
                top = max(top, abs(v[i, j] + h * (a0 * w + 0.5 * (a1 - a0) * w * w)))
            fastest = max(fastest, top / velocity[j])
        ratio[i, 0] = fastest
        ratio[i, 1] = hardest


@kernel
def sample_times(s, x, t):
    """Times at which poses are passed, with even acceleration in between; t[0] is given."""
    for i in range(s.shape[0] - 1):
        t[i + 1] = t[i] + 2.0 * (s[i + 1] - s[i]) / (math.sqrt(x[i]) + math.sqrt(x[i + 1]))
