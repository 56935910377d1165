# SPDX-License-Identifier: Apache-2.0
"""The run that records the disturbance: each axis up and down at a steady speed."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from vega_planner.datatypes import Floats
from vega_planner.errors import InvalidInput
from vega_robot_driver.job import PrintJob

#: Time in which an axis reaches its speed [s], and rests between two sweeps [s].
RUN_UP_S, REST_S = 0.2, 0.3


def calibration_job(
    joint_names: tuple[str, ...], here: Floats, lower: Floats, upper: Floats, speeds: Floats
) -> PrintJob:
    """Sweep each axis over its range, one after the other, and come back.

    Args:
        joint_names: The axes.
        here: Where they are [m, rad], shape (j,); the job begins and ends there.
        lower: Lowest positions of the sweeps, shape (j,).
        upper: Highest positions, shape (j,).
        speeds: Speeds of the sweeps, shape (j,).

    Raises:
        InvalidInput: If a range is empty or too short for its speed.
    """
    times, rows, rates = [0.0], [here.copy()], [np.zeros(len(here))]

    def sweep(k: int, goal: float) -> None:
        start = rows[-1][k]
        way, fast = goal - start, float(speeds[k])
        if abs(way) < 1e-9:
            return
        run_up = min(RUN_UP_S, abs(way) / fast)
        cruise = abs(way) / fast - run_up
        sign = np.sign(way)
        for duration, step, rate in (
            (REST_S, 0.0, 0.0),
            (run_up, 0.5 * fast * run_up, fast),
            (cruise, fast * cruise, fast),
            (run_up, 0.5 * fast * run_up, 0.0),
        ):
            if duration < 1e-6:
                continue
            row, speed = rows[-1].copy(), np.zeros(len(here))
            row[k] += sign * step
            speed[k] = sign * rate
            times.append(times[-1] + duration)
            rows.append(row)
            rates.append(speed)
        rows[-1][k] = goal

    for k, name in enumerate(joint_names):
        if upper[k] - lower[k] <= 4 * speeds[k] * RUN_UP_S:
            raise InvalidInput(
                f"{name} would sweep {lower[k]:g} .. {upper[k]:g}; too short for "
                f"{speeds[k]:g} /s, at least {4 * speeds[k] * RUN_UP_S:g}"
            )
        for goal in (lower[k], upper[k], lower[k], here[k]):
            sweep(k, float(goal))
    return dry_job(joint_names, times, rows, rates)


def dry_job(
    joint_names: tuple[str, ...],
    times: Sequence[float],
    positions: Sequence[Floats],
    velocities: Sequence[Floats],
) -> PrintJob:
    """Make a job that moves and lays nothing.

    Args:
        joint_names: Joints, j of them.
        times: Seconds from the start, n of them, rising.
        positions: [rad, m], n of shape (j,).
        velocities: [rad/s, m/s], n of shape (j,).
    """
    count = len(times)
    return PrintJob(
        joint_names=joint_names,
        times=np.array(times),
        positions=np.array(positions),
        velocities=np.array(velocities),
        extrude=np.zeros(count, np.bool_),
        path_id=np.full(count, -1),
        path_layer=np.zeros(0, np.int64),
    )
