# SPDX-License-Identifier: Apache-2.0
"""What a joint trajectory has to keep, measured on the finished result.

Nothing here shares code with the making of the trajectory but the robot's forward
kinematics and the definition of the curve between samples: the cubic of positions and
velocities (`curve="cubic"`), or straight joint moves (`curve="linear"`).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from vega_planner.datatypes import Bools, Floats, Ints, PrintTrajectory, ToolpathSet
from vega_planner.robot.robot import Robot
from vega_planner.robot.workcell import Workcell

#: Places between two samples at which the curve is looked at.
_PLACES = (0.25, 0.5, 0.75)
#: Toolpaths are cut into steps this short to find the nearest one [mm].
_STEP_MM = 0.25


@dataclass(frozen=True, eq=False)
class Deviation:
    """How far the nozzle is off its path, at the samples and between them.

    Attributes:
        tip_mm: Largest distance of the tip from the toolpath of its pass [mm].
        axis_rad: Largest angle between the nozzle and the toolpath's axis there [rad].
    """

    tip_mm: float
    axis_rad: float


def joint_states(
    trajectory: PrintTrajectory, place: float, curve: str = "cubic"
) -> tuple[Floats, Floats, Floats]:
    """Positions, velocities and accelerations at a place (0 to 1) of each interval."""
    h = np.diff(trajectory.times)[:, None]
    q0, q1 = trajectory.positions[:-1], trajectory.positions[1:]
    if curve == "linear":
        return q0 + place * (q1 - q0), (q1 - q0) / h, np.zeros_like(q0)
    m0, m1 = h * trajectory.velocities[:-1], h * trajectory.velocities[1:]
    b, c = 3.0 * (q1 - q0) - 2.0 * m0 - m1, 2.0 * (q0 - q1) + m0 + m1
    w = place
    return (
        q0 + w * (m0 + w * (b + w * c)),
        (m0 + w * (2.0 * b + 3.0 * w * c)) / h,
        (2.0 * b + 6.0 * w * c) / h**2,
    )


def limit_excess(trajectory: PrintTrajectory, robot: Robot) -> float:
    """Largest use of a joint's limit beyond the limit, over all samples and in between.

    Returns:
        The largest of position beyond a limit [m, rad], velocity / limit - 1 and
        acceleration / limit - 1; 0 or less where every limit holds.
    """
    worst = -np.inf
    for place in (0.0, *_PLACES, 1.0):
        q, v, a = joint_states(trajectory, place)
        worst = max(
            worst,
            float((robot.lower - q).max()),
            float((q - robot.upper).max()),
            float((np.abs(v) / robot.velocity).max()) - 1.0,
            float((np.abs(a) / robot.acceleration).max()) - 1.0,
        )
    return worst


def deviation(
    trajectory: PrintTrajectory, toolpaths: ToolpathSet, cell: Workcell, curve: str = "cubic"
) -> Deviation:
    """Measure how far the nozzle leaves the passes while printing."""
    tip, axis = 0.0, 0.0
    bead = trajectory.extrude[1:]
    for place in (*_PLACES, 1.0):
        q, _, _ = joint_states(trajectory, place, curve)
        points, axes = cell.to_part(*cell.robot.forward(q[bead]))
        owner = trajectory.path_id[1:][bead]
        for k, path in enumerate(toolpaths.passes):
            mine = owner == k
            if mine.any():
                off, turned = _off_path(points[mine], axes[mine], path.points, path.axes)
                tip, axis = max(tip, float(off.max())), max(axis, float(turned.max()))
    return Deviation(tip, axis)


def _off_path(
    points: Floats, axes: Floats, path: Floats, path_axes: Floats
) -> tuple[Floats, Floats]:
    """Distances from a polyline and angles from its axes at the nearest places."""
    length = np.linalg.norm(np.diff(path, axis=0), axis=1)
    pieces = np.maximum(np.ceil(length / _STEP_MM), 1).astype(int)
    segment = np.repeat(np.arange(len(length)), pieces)
    share = (np.arange(len(segment)) - np.repeat(np.cumsum(pieces) - pieces, pieces)) / pieces[
        segment
    ]
    dense = path[segment] + share[:, None] * (path[segment + 1] - path[segment])
    _, near = cKDTree(dense).query(points, k=min(4, len(dense)))
    near = near.reshape(len(points), -1)
    best, turned = np.full(len(points), np.inf), np.zeros(len(points))
    for column in near.T:
        for step in (-1, 0):
            k = segment[np.clip(column + step, 0, len(segment) - 1)]
            edge = path[k + 1] - path[k]
            along = np.einsum("ij,ij->i", points - path[k], edge)
            w = np.clip(along / np.maximum(np.einsum("ij,ij->i", edge, edge), 1e-30), 0, 1)
            off = np.linalg.norm(points - path[k] - w[:, None] * edge, axis=1)
            mixed = (1 - w)[:, None] * path_axes[k] + w[:, None] * path_axes[k + 1]
            mixed /= np.linalg.norm(mixed, axis=1, keepdims=True)
            angle = 2 * np.arcsin(np.clip(np.linalg.norm(mixed - axes, axis=1) / 2, 0, 1))
            closer = off < best - 1e-12
            best = np.where(closer, off, best)
            turned = np.where(closer, angle, turned)
    return best, turned


def steady_ratio(trajectory: PrintTrajectory, robot: Robot, speed_m_s: float) -> float:
    """Share of the printed length on which the tip's speed is within 1 % of the set speed."""
    points, _ = robot.forward(trajectory.positions)
    step = np.linalg.norm(np.diff(points, axis=0), axis=1)
    speed = step / np.diff(trajectory.times)
    bead = trajectory.extrude[1:]
    steady = np.abs(speed / speed_m_s - 1.0) <= 0.01
    return float(step[bead & steady].sum() / step[bead].sum())


def largest_printing_step(trajectory: PrintTrajectory, robot: Robot) -> float:
    """Largest step of a rotary joint between two samples while printing [rad]."""
    step = np.abs(np.diff(trajectory.positions[:, robot.chain.revolute], axis=0))
    bead = trajectory.extrude[1:]
    return float(step[bead].max(initial=0.0))


def slow_samples(trajectory: PrintTrajectory, robot: Robot, speed_m_s: float) -> Ints:
    """Samples at whose interval the tip prints more than 1 % below the set speed."""
    points, _ = robot.forward(trajectory.positions)
    step = np.linalg.norm(np.diff(points, axis=0), axis=1)
    slow: Bools = step < 0.99 * speed_m_s * np.diff(trajectory.times)
    return np.flatnonzero(slow & trajectory.extrude[1:]) + 1
