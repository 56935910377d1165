# SPDX-License-Identifier: Apache-2.0
"""Following a path along its parameter, and simulated axes: the numeric kernels.

The same kernels advance one cycle at a time on a bus and thousands in simulation.
"""

from __future__ import annotations

import numpy as np
from numba import njit


@njit(nogil=True, cache=True)
def find(times, value, start):
    """Find i with times[i] <= value < times[i + 1], searching from `start`."""
    i = start
    last = times.shape[0] - 2
    while i < last and value >= times[i + 1]:
        i += 1
    while i > 0 and value < times[i]:
        i -= 1
    return i


@njit(nogil=True, cache=True)
def hermite(times, positions, velocities, u, i, place, speed):
    """Evaluate the cubic Hermite curve at u in interval i into `place` and `speed`."""
    h = times[i + 1] - times[i]
    s = min(max((u - times[i]) / h, 0.0), 1.0)
    a = (1 + 2 * s) * (1 - s) * (1 - s)
    b = s * (1 - s) * (1 - s)
    c = s * s * (3 - 2 * s)
    d = s * s * (s - 1)
    e = 6 * s * (s - 1) / h
    f = (1 - s) * (1 - 3 * s)
    g = s * (3 * s - 2)
    for k in range(place.shape[0]):
        p0, p1 = positions[i, k], positions[i + 1, k]
        v0, v1 = velocities[i, k], velocities[i + 1, k]
        place[k] = a * p0 + c * p1 + h * (b * v0 + d * v1)
        speed[k] = e * (p0 - p1) + f * v0 + g * v1


@njit(nogil=True, cache=True)
def follow(
    times,
    positions,
    velocities,
    spans,
    state,
    want,
    ramp,
    allowed,
    floor,
    dt,
    targets,
    speeds,
    gate,
):
    """Advance along the path by a number of cycles.

    Args:
        times: Path times [s], shape (n,).
        positions: Joint positions, shape (n, j).
        velocities: Joint velocities, shape (n, j).
        spans: Path times at which the dispenser goes on and off, shape (k, 2).
        state: Path time u, its rate, sample index, span index, and the path time up to
            which everything that should be deposited is; changed in place.
        want: Rate to ramp to, 0 to stop.
        ramp: Largest change of the rate in a cycle.
        allowed: Whether the dispenser may be on at all.
        floor: Rate below which the dispenser is off.
        dt: Cycle time [s].
        targets: Joint targets to fill, shape (c, j).
        speeds: Joint target speeds to fill, shape (c, j).
        gate: Dispenser commands to fill, shape (c,).
    """
    u, rate, i, m, done = state[0], state[1], int(state[2]), int(state[3]), state[4]
    end = times[-1]
    for c in range(targets.shape[0]):
        rate += min(max(want - rate, -ramp), ramp)
        u += rate * dt
        if u >= end:
            u, rate = end, 0.0
        i = find(times, u, i)
        hermite(times, positions, velocities, u, i, targets[c], speeds[c])
        for k in range(speeds.shape[1]):
            speeds[c, k] *= rate
        while m < spans.shape[0] and u >= spans[m, 1]:
            m += 1
        inside = m < spans.shape[0] and u >= spans[m, 0]
        gate[c] = inside and allowed and rate > floor
        if allowed or not inside:
            done = u
    state[0], state[1], state[2], state[3], state[4] = u, rate, i, m, done


@njit(nogil=True, cache=True)
def curve_extremes(times, positions, velocities, dt):
    """Find lowest and highest position, largest speed and its time, of each joint."""
    joints = positions.shape[1]
    low, high = positions[0].copy(), positions[0].copy()
    fast, when = np.zeros(joints), np.zeros(joints)
    place, speed = np.empty(joints), np.empty(joints)
    for i in range(times.shape[0] - 1):
        h = times[i + 1] - times[i]
        count = max(2, int(np.ceil(h / dt)))
        for c in range(count + 1):
            u = times[i] + h * c / count
            hermite(times, positions, velocities, u, i, place, speed)
            for k in range(joints):
                low[k] = min(low[k], place[k])
                high[k] = max(high[k], place[k])
                if abs(speed[k]) > fast[k]:
                    fast[k], when[k] = abs(speed[k]), u
    return low, high, fast, when


@njit(nogil=True, cache=True)
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


@njit(nogil=True, cache=True)
def build_pressure(pressure, gate, supply, rise, fall, dt):
    """Let the pressure in the barrel follow the valve, with a first-order lag each way."""
    up, down = 1 - np.exp(-dt / rise), 1 - np.exp(-dt / fall)
    for c in range(gate.shape[0]):
        if gate[c]:
            pressure += (supply - pressure) * up
        else:
            pressure -= pressure * down
    return pressure
