# SPDX-License-Identifier: Apache-2.0
"""What a joint trajectory has to keep, measured on the finished result.

Nothing here shares code with the making of the trajectory but the robot's forward
kinematics and the definition of the curve between samples: the cubic of positions and
velocities (`curve="cubic"`), or straight joint moves (`curve="linear"`).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from vega_planner.datatypes import Bools, Floats, Ints, PrintTrajectory, ToolpathSet
from vega_planner.robot.robot import Robot
from vega_planner.robot.workcell import Workcell
from vega_planner.toolpaths.coverage_kernels import distance_to_segments
from vega_planner.toolpaths.segment_cells import cells_within

#: Places between two samples at which the curve is looked at.
_PLACES = (0.25, 0.5, 0.75)
#: Cells of the grid that finds the nearest piece of a toolpath [mm].
_CELL_MM = 2.0


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
    """Measure how far the nozzle leaves the passes while printing.

    The tip is compared with the nearest place of its pass; the axis with the one the pass
    has, turned evenly, after the length that has been printed of it.
    """
    tip, axis = 0.0, 0.0
    owner = np.where(trajectory.extrude[1:], trajectory.path_id[1:], -1)
    known, _ = cell.to_part(*cell.robot.forward(trajectory.positions))
    step = np.linalg.norm(np.diff(known, axis=0), axis=1)
    for place in (*_PLACES, 1.0):
        q, _, _ = joint_states(trajectory, place, curve)
        points, axes = cell.to_part(*cell.robot.forward(q))
        for k, path in enumerate(toolpaths.passes):
            mine = owner == k
            if not mine.any():
                continue
            tip = max(tip, float(_distances(points[mine], path.points).max()))
            printed = np.cumsum(step[mine]) - (1.0 - place) * step[mine]
            wanted = _axes_after(printed, path.points, path.axes)
            half = 0.5 * np.linalg.norm(wanted - axes[mine], axis=1)
            axis = max(axis, float(2.0 * np.arcsin(np.clip(half, 0.0, 1.0)).max()))
    return Deviation(tip, axis)


def _axes_after(printed: Floats, path: Floats, axes: Floats) -> Floats:
    """Axes of a pass after lengths along it, turned evenly from point to point."""
    length = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(path, axis=0), axis=1))])
    k = np.clip(np.searchsorted(length, printed, side="right") - 1, 0, len(path) - 2)
    gap = length[k + 1] - length[k]
    w = np.clip((printed - length[k]) / np.where(gap > 0, gap, 1.0), 0.0, 1.0)[:, None]
    a, b = axes[k], axes[k + 1]
    angle = np.arccos(np.clip(np.einsum("ij,ij->i", a, b), -1.0, 1.0))[:, None]
    small = angle < 1e-6
    sine = np.where(small, 1.0, np.sin(angle))
    mixed = np.where(small, 1 - w, np.sin((1 - w) * angle) / sine) * a
    mixed = mixed + np.where(small, w, np.sin(w * angle) / sine) * b
    return np.asarray(mixed / np.linalg.norm(mixed, axis=1, keepdims=True))


def _distances(points: Floats, path: Floats) -> Floats:
    """Distances of points from a polyline."""
    a, b = path[:-1], path[1:]
    low = points.min(0) - _CELL_MM
    cells = cells_within(a, b, low, points.max(0), _CELL_MM)
    distance = distance_to_segments(points, a, b, *cells)
    for lost in np.flatnonzero(distance >= _CELL_MM):  # farther than the cells can tell
        edge, from_a = b - a, points[lost] - a
        along = np.einsum("ij,ij->i", from_a, edge)
        w = np.clip(along / np.maximum(np.einsum("ij,ij->i", edge, edge), 1e-30), 0, 1)
        distance[lost] = np.linalg.norm(from_a - w[:, None] * edge, axis=1).min()
    return distance


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
