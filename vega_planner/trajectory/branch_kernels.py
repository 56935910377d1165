# SPDX-License-Identifier: Apache-2.0
# mypy: disable-error-code="no-untyped-def"
"""Compiled choice among several joint configurations per pose."""

from __future__ import annotations

import math

import numpy as np

from vega_planner.compiled import kernel

#: Stands for "impossible" in sums of costs.
NEVER = 1e30


@kernel
def step_time(a, b, velocity, endless):
    """Time [s] the slowest joint needs from a to b at its largest velocity."""
    slowest = 0.0
    for k in range(a.shape[0]):
        d = abs(b[k] - a[k])
        if endless[k]:
            d = abs((d + math.pi) % (2.0 * math.pi) - math.pi)
        slowest = max(slowest, d / velocity[k])
    return slowest


@kernel
def cheapest_row(q, valid, node_cost, velocity, endless, allowed, jump_cost, stiffness, choice):
    """Viterbi: one candidate per pose so that the summed time is smallest.

    `stiffness` [1/s] times the squared time of each step is added: it spreads the motion. A
    step that takes longer than `allowed[i]` from pose i to i + 1 is a jump and costs
    `jump_cost[i]` more. Fills choice (n,); returns the cost, NEVER where a pose has none.
    """
    n, count, _ = q.shape
    cost = np.full(count, NEVER)
    best = np.zeros(count)
    origin = np.zeros((n, count), np.int32)
    for c in range(count):
        if valid[0, c]:
            cost[c] = node_cost[0, c]
    for i in range(1, n):
        for c in range(count):
            best[c] = NEVER
            if not valid[i, c]:
                continue
            for b in range(count):
                if cost[b] >= NEVER:
                    continue
                time = step_time(q[i - 1, b], q[i, c], velocity, endless)
                total = cost[b] + time + stiffness * time * time
                if time > allowed[i - 1]:
                    total += jump_cost[i - 1]
                if total < best[c]:
                    best[c] = total
                    origin[i, c] = b
            if best[c] < NEVER:
                best[c] += node_cost[i, c]
        cost[:] = best
    last = 0
    for c in range(1, count):
        if cost[c] < cost[last]:
            last = c
    total = cost[last]
    for i in range(n - 1, -1, -1):
        choice[i] = last
        last = origin[i, last]
    return total


@kernel
def unwind(q, endless):
    """Add turns to endless joints so that each step is the shorter way round. In place."""
    for i in range(1, q.shape[0]):
        for k in range(q.shape[1]):
            if endless[k]:
                d = q[i, k] - q[i - 1, k]
                q[i, k] -= 2.0 * math.pi * math.floor(d / (2.0 * math.pi) + 0.5)


@kernel
def nearest_candidate(q, valid, guess, revolute, lower, upper, out):
    """Take the valid candidate, in any turn within the limits, that is nearest to a guess.

    Returns the first row without one, or -1.
    """
    n, count, joints = q.shape
    missing = -1
    for i in range(n):
        best = NEVER
        pick = -1
        for c in range(count):
            if not valid[i, c]:
                continue
            far = 0.0
            for k in range(joints):
                if revolute[k]:
                    far = max(
                        far,
                        abs(
                            _nearest_turn(q[i, c, k], guess[i, k], lower[k], upper[k])
                            - guess[i, k]
                        ),
                    )
            if far < best:
                best = far
                pick = c
        if pick < 0:
            if missing < 0:
                missing = i
            out[i] = guess[i]
            continue
        for k in range(joints):
            x = q[i, pick, k]
            out[i, k] = _nearest_turn(x, guess[i, k], lower[k], upper[k]) if revolute[k] else x
    return missing


@kernel
def _nearest_turn(angle, guess, lower, upper):
    """The equal angle within the limits that is nearest to a guess."""
    turn = 2.0 * math.pi
    x = angle - turn * math.floor((angle - guess) / turn + 0.5)
    while x > upper + 1e-9 and x - turn >= lower - 1e-9:
        x -= turn
    while x < lower - 1e-9 and x + turn <= upper + 1e-9:
        x += turn
    return x
