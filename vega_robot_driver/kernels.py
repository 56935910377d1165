# SPDX-License-Identifier: Apache-2.0
"""Simulated axes and barrel, many cycles at a time: the numeric kernels."""

from __future__ import annotations

import numpy as np

from vega_planner.compiled import kernel


@kernel
def move_axes(position, speed, targets, speeds, bandwidth, damping, forward, limits, dt, steps):
    """Let axes follow their targets: second-order lag within speed and acceleration limits.

    Args:
        position: Axis positions, shape (j,); changed in place.
        speed: Axis speeds, shape (j,); changed in place.
        targets: Targets, shape (c, j).
        speeds: Speeds of the targets, shape (c, j).
        bandwidth: Angular frequency of the position loop [rad/s].
        damping: Damping ratio of the loop.
        forward: Share of the target's speed that is fed forward.
        limits: Lowest and highest position, speed and acceleration, shape (4, j).
        dt: Cycle time [s].
        steps: Integration steps in a cycle.
    """
    h = dt / steps
    for c in range(targets.shape[0]):
        for k in range(position.shape[0]):
            for _ in range(steps):
                pull = bandwidth * bandwidth * (targets[c, k] - position[k])
                drag = 2 * damping * bandwidth * (forward * speeds[c, k] - speed[k])
                push = min(max(pull + drag, -limits[3, k]), limits[3, k])
                speed[k] = min(max(speed[k] + push * h, -limits[2, k]), limits[2, k])
                position[k] += speed[k] * h
            if position[k] < limits[0, k] or position[k] > limits[1, k]:
                position[k] = min(max(position[k], limits[0, k]), limits[1, k])
                speed[k] = 0.0


@kernel
def build_pressure(pressure, gate, supply, rise, fall, dt):
    """Let the pressure in the barrel follow the valve, with a first-order lag each way."""
    up, down = 1 - np.exp(-dt / rise), 1 - np.exp(-dt / fall)
    for c in range(gate.shape[0]):
        if gate[c]:
            pressure += (supply - pressure) * up
        else:
            pressure -= pressure * down
    return pressure
