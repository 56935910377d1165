# SPDX-License-Identifier: Apache-2.0
"""Choice of one continuous joint path among the branches and turns that reach each pose."""

from __future__ import annotations

from collections.abc import Callable
from itertools import product

import numpy as np

from vega_planner.datatypes import Bools, Floats, Ints
from vega_planner.errors import Unreachable
from vega_planner.robot.chain import UNLIMITED
from vega_planner.robot.robot import IKSolutions, Robot
from vega_planner.trajectory import branch_kernels as kernels
from vega_planner.trajectory.waypoints import Waypoints

#: Tells of joint positions (n, j) where no link of the arm touches anything, (n,).
Clear = Callable[[Floats], Bools]

#: A step counts as a jump when it takes this much longer than the tip's own way would ask
#: of a joint that moves one radian for every 10 mm.
_RADIANS_PER_METRE = 100.0
#: Smallest step that can be a jump [rad].
_SMALLEST_JUMP = 0.35
#: Costs [s] of a jump: while printing it is out of the question, in the middle of a travel
#: it is a change of configuration.
JUMP_WHILE_PRINTING, JUMP_ON_TRAVEL = 1e9, 1e3
#: Cost [s] of a pose in which a link of the arm touches something.
TOUCH = 1e4


def with_turns(solutions: IKSolutions, robot: Robot) -> IKSolutions:
    """Add to each candidate its copies a full turn away that the limits allow as well."""
    shifts = []
    for k, turning in enumerate(robot.chain.revolute):
        wide = turning and robot.upper[k] < UNLIMITED
        wide = wide and robot.upper[k] - robot.lower[k] > 2.0 * np.pi
        shifts.append((0.0, 2.0 * np.pi, -2.0 * np.pi) if wide else (0.0,))
    if all(len(shift) == 1 for shift in shifts):
        return solutions
    candidates, valid = [], []
    for shift in product(*shifts):
        moved = solutions.candidates + np.array(shift)
        candidates.append(moved)
        inside = (moved >= robot.lower - 1e-9) & (moved <= robot.upper + 1e-9)
        valid.append(solutions.valid & inside.all(2))
    return IKSolutions(
        np.ascontiguousarray(np.concatenate(candidates, axis=1)), np.concatenate(valid, axis=1)
    )


def continuous_path(
    way: Waypoints,
    solutions: IKSolutions,
    robot: Robot,
    *,
    clear: Clear | None = None,
    rows: Ints | None = None,
    room: Floats | None = None,
) -> tuple[Floats, Ints]:
    """Choose a configuration for each pose so that the arm moves least and never jumps.

    Args:
        way: The poses, all of them reachable.
        solutions: Candidates of each pose.
        robot: The robot.
        clear: Tells which configurations to prefer; see `Clear`.
        rows: The poses to choose for, shape (m,); all when absent.
        room: Turn [rad] that a step between consecutive rows may take in any case, (m - 1,).

    Returns:
        Joint positions (m, j), and the intervals between rows, on travels, at which the arm
        has to change its configuration.

    Raises:
        Unreachable: If a pose has no candidate, or a pass cannot be printed without a jump.
    """
    if rows is None:
        rows = np.arange(len(way.points))
    reached = np.ones(len(way.points), np.bool_)
    reached[rows] = solutions.valid[rows].any(1)
    require_reached(way, reached)
    solutions = IKSolutions(solutions.candidates[rows], solutions.valid[rows])
    node_cost = _cost(solutions, clear)
    solutions = with_turns(solutions, robot)
    q, valid = solutions.candidates, solutions.valid
    node_cost = np.tile(node_cost, (1, q.shape[1] // node_cost.shape[1]))
    endless = robot.chain.revolute & (robot.upper >= UNLIMITED)
    step = np.diff(way.path[rows])
    turn = np.linalg.norm(np.diff(way.axes[rows], axis=0), axis=1)
    slowest = float(1.0 / robot.velocity[robot.chain.revolute].min())
    rest = np.zeros(len(step)) if room is None else room
    allowed = slowest * np.maximum(
        np.maximum(_SMALLEST_JUMP, rest), 3.0 * turn + _RADIANS_PER_METRE * step
    )
    choice = np.zeros(len(q), np.int64)
    kernels.cheapest_row(
        q,
        valid,
        node_cost,
        robot.velocity,
        endless,
        allowed,
        jump_costs(way)[rows[:-1]],
        0.0,
        choice,
    )
    path = q[np.arange(len(q)), choice]
    kernels.unwind(path, endless)
    jumps = np.array(
        [
            i
            for i in np.flatnonzero(np.abs(np.diff(path, axis=0)).max(1) > 0.1)
            if kernels.step_time(path[i], path[i + 1], robot.velocity, endless) > allowed[i]
        ],
        dtype=np.int64,
    )
    bad = jumps[way.printing[rows[jumps]]]
    if len(bad):
        at = int(bad[0])
        raise _jump_error(way, path[at : at + 2], robot, int(rows[at]))
    return path, jumps


def _cost(solutions: IKSolutions, clear: Clear | None) -> Floats:
    """Cost [s] of each candidate in itself, shape (m, k)."""
    cost: Floats = np.zeros((len(solutions.valid), solutions.valid.shape[1]))
    if clear is not None:
        several = np.flatnonzero(solutions.valid.sum(1) > 1)
        for k in range(cost.shape[1]):
            cost[several, k] = TOUCH * ~clear(solutions.candidates[several, k])
    return cost


def require_reached(way: Waypoints, reached: Bools) -> None:
    """Raise `Unreachable` for the first pose that is not reached, if there is one."""
    missed = np.flatnonzero(~reached)
    if not len(missed):
        return
    first = int(missed[0])
    error = Unreachable(
        f"{len(missed)} of {len(reached)} poses are out of the robot's reach; the first is in "
        f"{segment_name(way, first)} at {np.round(way.points[first] * 1000, 2).tolist()} mm in "
        f"the base frame, axis {np.round(way.axes[first], 3).tolist()}; move or turn the part, "
        "or tilt the nozzle less"
    )
    error.waypoint = first
    raise error


def segment_name(way: Waypoints, pose: int) -> str:
    """Name the pass or travel a pose belongs to, for people."""
    segment = int(np.searchsorted(way.starts, pose, side="right")) - 1
    if way.path_id[segment] >= 0:
        return f"pass {way.path_id[segment]}"
    return f"travel {segment // 2}"


def jump_costs(way: Waypoints) -> Floats:
    """Cost of a jump on each interval: a change of configuration belongs on top of a travel."""
    cost = np.where(way.printing, JUMP_WHILE_PRINTING, 100.0 * JUMP_ON_TRAVEL)
    for start, end, path_id in zip(way.starts[:-1], way.starts[1:], way.path_id, strict=True):
        if path_id < 0 and end - start > 2:
            top = start + int(np.argmax(way.points[start:end, 2]))
            cost[min(max(top, start), end - 2)] = JUMP_ON_TRAVEL
    return cost


def _jump_error(way: Waypoints, step: Floats, robot: Robot, at: int) -> Unreachable:
    change = np.abs(step[1] - step[0])
    joint = int(np.argmax(change / robot.velocity))
    error = Unreachable(
        f"{segment_name(way, at)} cannot be printed in one go: joint "
        f"'{robot.joint_names[joint]}' would jump by {change[joint]:.2f} at "
        f"{np.round(way.points[at] * 1000, 2).tolist()} mm in the base frame (its limits are "
        f"{robot.lower[joint]:.2f} to {robot.upper[joint]:.2f}); turn the part, or choose "
        "another pattern"
    )
    error.waypoint = at
    return error
