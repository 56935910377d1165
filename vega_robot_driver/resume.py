# SPDX-License-Identifier: Apache-2.0
"""The way from where the axes stand to where a job begins, clear of what is printed."""

from __future__ import annotations

from typing import Protocol

import numpy as np

from vega_planner.datatypes import Bools, Floats

#: Height above everything the job prints at which the tip crosses over it [m].
CROSSING_HEIGHT = 0.010
#: How far the tip backs off along the nozzle before it rises [m].
BACK_OFF = 0.003
#: Rows in which the crossing is looked at, how far it may dip [m], and how often it is raised.
_ROWS, _DIP, _RAISED = 33, 1e-5, 4


class _Solutions(Protocol):
    """Joint configurations of targets, shape (n, k, j), and which of them are valid."""

    @property
    def candidates(self) -> Floats: ...

    @property
    def valid(self) -> Bools: ...


class Kinematics(Protocol):
    """What an approach asks of a robot: `vega_planner.robot.robot.Robot` has it."""

    def forward(self, q: Floats) -> tuple[Floats, Floats]:
        """Tips [m] and axes of joint configurations, shapes (n, 3), from q of shape (n, j)."""
        ...

    def solve(self, points: Floats, axes: Floats) -> _Solutions:
        """Configurations whose tip and axis are those given [m], shapes (n, 3)."""
        ...


def approach(robot: Kinematics, here: Floats, goal: Floats, top_m: float) -> Floats:
    """Find joint configurations that lead over what is printed.

    The tip backs off along the nozzle, rises above everything, crosses, comes down above
    the goal and meets it along the nozzle. Where the nozzle turns while it crosses, the tip
    swings on an arc: it rises so much higher that it nowhere dips below. A height out of reach
    is left out.

    Args:
        robot: The robot.
        here: Joint positions the axes are at, shape (j,).
        goal: Joint positions to get to, shape (j,).
        top_m: Height in the base frame of the highest point of the job [m].

    Returns:
        Configurations between here and the goal, shape (m, j).
    """
    if np.abs(here - goal).max() < 1e-9:
        return np.zeros((0, len(here)))
    safe = height = top_m + CROSSING_HEIGHT
    leaving, arriving = _raised(robot, here, safe), _raised(robot, goal, safe)
    for _ in range(_RAISED):
        if not leaving or not arriving:
            break
        crossing = np.linspace(leaving[-1], arriving[-1], _ROWS)
        dip = safe - float(robot.forward(crossing)[0][:, 2].min())
        if dip <= _DIP:
            break
        height += dip
        higher = _raised(robot, here, height), _raised(robot, goal, height)
        if len(higher[0]) < len(leaving) or len(higher[1]) < len(arriving):
            break
        leaving, arriving = higher
    return np.array([*leaving, *arriving[::-1]]).reshape(-1, len(here))


def _raised(robot: Kinematics, q: Floats, safe_z: float) -> list[Floats]:
    """Back off along the nozzle, then rise to a height, as far as the robot gets there."""
    points, axes = robot.forward(q[None])
    back = points[0] + BACK_OFF * axes[0]
    above = np.array([back[0], back[1], max(back[2], safe_z)])
    steps: list[Floats] = []
    for point in (back, above):
        found = _nearest(robot, point, axes[0], steps[-1] if steps else q)
        if found is not None:
            steps.append(found)
    return steps


def _nearest(robot: Kinematics, point: Floats, axis: Floats, q: Floats) -> Floats | None:
    solutions = robot.solve(point[None], axis[None])
    valid = solutions.candidates[0][solutions.valid[0]]
    if len(valid) == 0:
        return None
    return valid[np.abs(valid - q).max(axis=1).argmin()]
