# SPDX-License-Identifier: Apache-2.0
"""Timing: as fast as the set speeds and the joints' limits allow, at rest between segments.

Source: H. Pham and Q.-C. Pham, "A New Approach to Time-Optimal Path Parameterization Based on
Reachability Analysis", IEEE T-RO 34(3), 2018 (TOPP-RA), with the tip's speed as a bound.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from vega_planner.datatypes import Floats
from vega_planner.errors import VegaError
from vega_planner.parallel import map_threads
from vega_planner.robot.robot import Robot
from vega_planner.trajectory import topp_ra_kernels as kernels
from vega_planner.trajectory.joint_path import JointPath

#: Share of the limits that is planned for; the rest is left to the controller.
VELOCITY_SHARE = 0.98
ACCELERATION_SHARE = 0.9
#: Rounds in which places that exceed a limit between the samples are slowed.
_ROUNDS = 16
#: Neighbours that accelerate less beside such a place.
_SPREAD = 3


@dataclass(frozen=True, eq=False)
class Timing:
    """When each pose is passed, and how fast.

    Attributes:
        times: Times [s], shape (n,); both copies of a pose between segments have one time,
            unless the arm waits there.
        velocities: Joint velocities [m/s, rad/s], shape (n, j).
        speeds: Path speeds [m/s], shape (n,).
    """

    times: Floats
    velocities: Floats
    speeds: Floats


def time_segment(
    s: Floats, q: Floats, speed: Floats, velocity: Floats, acceleration: Floats
) -> tuple[Floats, Floats, Floats]:
    """Time one segment from rest to rest.

    Args:
        s: Path parameter [m], rising, shape (n,).
        q: Joint positions, shape (n, j).
        speed: Largest path speed at each pose [m/s], shape (n,).
        velocity: Joint velocity limits, shape (j,).
        acceleration: Joint acceleration limits at each pose, shape (n, j).

    Returns:
        Times from 0, joint velocities (n, j) and path speeds (n,).

    Raises:
        VegaError: If the limits leave no speed at all.
    """
    slope, curvature = np.zeros_like(q), np.zeros_like(q)
    kernels.path_slopes(s, q, slope, curvature)
    caps, x, times = np.zeros(len(s)), np.zeros(len(s)), np.zeros(len(s))
    kernels.speed_caps(s, q, slope, curvature, speed, velocity, acceleration, caps)
    if not kernels.time_optimal(s, slope, curvature, caps, acceleration, 0.0, 0.0, x):
        raise VegaError("the joints' limits leave no speed along a segment of the trajectory")
    kernels.sample_times(s, x, times)
    speeds = np.sqrt(x)
    return times, slope * speeds[:, None], speeds


def time_path(
    path: JointPath, robot: Robot, speeds: Floats, waits: Floats | None = None
) -> Timing:
    """Time a whole job.

    Args:
        path: The joint path.
        robot: The robot, for its limits.
        speeds: Largest path speed of each segment [m/s], shape (m,).
        waits: How long the arm rests before each segment [s], shape (m,); not at all when
            absent.
    """
    way = path.way
    n, joints = path.q.shape
    times, velocities, tip = np.zeros(n), np.zeros((n, joints)), np.zeros(n)
    segments = [slice(*ends) for ends in pairwise(way.starts.tolist())]

    def timed(k: int) -> None:
        rows = segments[k]
        speed = np.full(rows.stop - rows.start, speeds[k])
        times[rows], velocities[rows], tip[rows] = _within_limits(
            way.path[rows], path.q[rows], speed, robot
        )

    map_threads(timed, range(len(segments)))
    now = 0.0
    for k, rows in enumerate(segments):
        now += 0.0 if waits is None else float(waits[k])
        times[rows] += now
        now = float(times[rows.stop - 1])
    return Timing(times, velocities, tip)


def _within_limits(
    s: Floats, q: Floats, speed: Floats, robot: Robot
) -> tuple[Floats, Floats, Floats]:
    """Time a segment and slow it where the cubic between two samples exceeds a limit."""
    velocity = VELOCITY_SHARE * robot.velocity
    planned = ACCELERATION_SHARE * robot.acceleration
    share = np.ones(len(s))
    ratio = np.zeros((len(s) - 1, 2))
    for _ in range(_ROUNDS):
        t, v, x = time_segment(s, q, speed, velocity, share[:, None] * planned)
        kernels.hermite_excess(t, q, v, robot.velocity, robot.acceleration, ratio)
        over = np.maximum(ratio[:, 0] ** 2, ratio[:, 1])
        if over.max() <= 1.0:
            break
        factor = np.where(over > 1.0, 0.97 / over, 1.0)
        ease = np.minimum(np.append(factor, 1.0), np.append(1.0, factor))
        speed = np.minimum(speed, np.where(ease < 1.0, x * np.sqrt(ease), speed))
        # less acceleration on both sides too, or the excess only moves to the neighbour
        for _ in range(_SPREAD):
            ease[1:] = np.minimum(ease[1:], 0.5 + 0.5 * ease[:-1])
            ease[:-1] = np.minimum(ease[:-1], 0.5 + 0.5 * ease[1:])
        share *= ease
        speed = np.maximum(speed, 1e-6)
    worst = float(over.max())
    if worst > 1.0:  # as a last resort the whole segment is slowed
        stretch = np.sqrt(worst) * (1.0 + 1e-9)
        t, v, x = t * stretch, v / stretch, x / stretch
    return t, v, x
