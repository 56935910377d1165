# SPDX-License-Identifier: Apache-2.0
"""Moves without deposition between joint configurations, in time."""

from __future__ import annotations

import itertools

import numpy as np

from vega_planner.datatypes import Floats

#: Share of the joints' speed limits that approach moves use.
SPEED_RATIO = 0.2
#: Samples of one move.
SAMPLES = 33


def joint_move(start: Floats, end: Floats, velocity: Floats) -> tuple[Floats, Floats, Floats]:
    """Move all joints together from rest to rest along a straight line in joint space.

    The fraction of the way is the quintic 10 s³ - 15 s⁴ + 6 s⁵, whose speed peaks at 15/8
    of the mean.

    Args:
        start: Joint positions at the start [m, rad], shape (j,).
        end: Joint positions at the end, shape (j,).
        velocity: Joint speed limits, shape (j,).

    Returns:
        Times [s] from 0, shape (n,); positions and velocities, shape (n, j).
    """
    way = end - start
    seconds = max(float((1.875 * np.abs(way) / (SPEED_RATIO * velocity)).max()), 0.1)
    s = np.linspace(0.0, 1.0, SAMPLES)[:, None]
    fraction = s**3 * (10 - 15 * s + 6 * s**2)
    rate = 30 * s**2 * (1 - s) ** 2 / seconds
    return s[:, 0] * seconds, start + fraction * way, rate * way


def joint_route(points: Floats, velocity: Floats) -> tuple[Floats, Floats, Floats]:
    """Chain moves through joint configurations, at rest in each.

    Args:
        points: Joint configurations, shape (m, j), m >= 2.
        velocity: Joint speed limits, shape (j,).

    Returns:
        As `joint_move`.
    """
    times, positions, velocities = [np.zeros(1)], [points[:1]], [np.zeros((1, points.shape[1]))]
    for a, b in itertools.pairwise(points):
        if np.abs(b - a).max() < 1e-9:
            continue
        t, p, v = joint_move(a, b, velocity)
        times.append(times[-1][-1] + t[1:])
        positions.append(p[1:])
        velocities.append(v[1:])
    if len(times) == 1:
        times.append(np.array([0.1]))
        positions.append(points[-1:])
        velocities.append(velocities[0])
    return np.concatenate(times), np.concatenate(positions), np.concatenate(velocities)
