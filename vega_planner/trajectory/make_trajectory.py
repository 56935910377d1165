# SPDX-License-Identifier: Apache-2.0
"""Toolpaths to joint motion: branch choice, refinement, timing, dispensing."""

from __future__ import annotations

import numpy as np

from vega_planner.datatypes import Floats, PrintTrajectory, ToolpathSet
from vega_planner.errors import Cancelled, VegaError
from vega_planner.progress import Progress, Report, silent
from vega_planner.robot.robot import Robot
from vega_planner.robot.workcell import Workcell
from vega_planner.settings import TrajectorySettings
from vega_planner.trajectory.branches import Clear
from vega_planner.trajectory.closed_form_path import ClosedFormPath
from vega_planner.trajectory.dispensing import rests, switching_times
from vega_planner.trajectory.joint_path import JointPath, PathSolver, joint_path
from vega_planner.trajectory.time_law import Timing, time_path
from vega_planner.trajectory.waypoints import knots_for_timing, refined, waypoints_of
from vega_planner.units import mm_to_m

#: Distance of the tip from its path that is left to the motion between samples [m]; a
#: hundredth of the thinnest beads, and near the repeatability of the paper's axes.
PATH_TOLERANCE = 8e-6
#: Acceleration along the path that poses near stops are laid out for [m/s²].
_LAYOUT_ACCELERATION = 1.0
#: A point is slow when the tip moves more than this below the set speed.
SLOW_RATIO = 0.01


def make_trajectory(
    toolpaths: ToolpathSet,
    cell: Workcell,
    settings: TrajectorySettings,
    report: Report = silent,
    clear: Clear | None = None,
) -> PrintTrajectory:
    """Turn toolpaths into the motion of the joints.

    The tip follows the chords of the toolpaths at the set speed, slower where a joint's
    limit asks for it, and rests between passes and travels.

    Args:
        toolpaths: Passes and travels in print order, part frame [mm].
        cell: Robot, material and placement.
        settings: Speeds.
        report: Receives progress; may raise `Cancelled`.
        clear: Tells which configurations to prefer; see `branches.Clear`.

    Returns:
        The joint trajectory [SI].

    Raises:
        Unreachable: If a pose is out of reach, or a pass needs a joint to jump.
        InvalidInput: If the toolpaths do not hang together.
    """
    robot = cell.robot
    report(Progress("trajectory", 0.0))
    way = waypoints_of(toolpaths, cell)
    speed = np.where(way.path_id < 0, settings.travel_speed_mm_s, settings.speed_mm_s)
    speed = mm_to_m(speed.astype(np.float64))
    way, _ = refined(
        way,
        *knots_for_timing(way, speed[way.segment[:-1]], PATH_TOLERANCE, _LAYOUT_ACCELERATION),
    )
    report(Progress("trajectory", 0.1))
    solver = path_solver(robot, mm_to_m(settings.speed_mm_s), clear)
    path = joint_path(way, robot, solver, PATH_TOLERANCE)
    report(Progress("trajectory", 0.7))
    speeds = np.where(
        path.reconfigures,
        1.0,
        np.where(
            path.way.path_id < 0,
            mm_to_m(settings.travel_speed_mm_s),
            mm_to_m(settings.speed_mm_s),
        ),
    )
    waits = rests(path.way.path_id, path.reconfigures, cell.material)
    timing = time_path(path, robot, speeds, waits)
    report(Progress("trajectory", 0.9))
    result = _assembled(path, timing, waits, cell, mm_to_m(settings.speed_mm_s))
    report(Progress("trajectory", 1.0))
    return result


def make_clear_trajectory(
    toolpaths: ToolpathSet,
    cell: Workcell,
    settings: TrajectorySettings,
    clear: Clear,
    report: Report = silent,
) -> PrintTrajectory:
    """Make a trajectory that prefers configurations in which no link touches anything.

    Where an arm cannot be led through those, it is led as if there were no preference; the
    check of the links tells what it touches then. Arguments as of `make_trajectory`.
    """
    try:
        return make_trajectory(toolpaths, cell, settings, report, clear)
    except Cancelled:
        raise
    except VegaError:
        return make_trajectory(toolpaths, cell, settings, report)


def path_solver(robot: Robot, speed: float, clear: Clear | None = None) -> PathSolver:
    """Choose the inverse kinematics along a path: closed form where there is one."""
    if robot.closed_form is not None:
        return ClosedFormPath(robot, speed, clear)
    from vega_planner.trajectory.free_turn_path import FreeTurnPath

    return FreeTurnPath(robot, clear)


def _assembled(
    path: JointPath, timing: Timing, waits: Floats, cell: Workcell, speed: float
) -> PrintTrajectory:
    """Merge the segments' shared samples and mark the beads."""
    way = path.way
    segment = way.segment
    ids = way.path_id[segment]
    # Of the two copies of a pose between segments the pass keeps its own; where the arm
    # waits, they are the beginning and the end of the wait.
    keep = np.ones(len(ids), np.bool_)
    for k in np.flatnonzero(waits[1:] <= 0) + 1:
        keep[way.starts[k] if way.path_id[k] < 0 else way.starts[k] - 1] = False
    first = np.zeros(len(ids), np.bool_)
    first[way.starts[:-1]] = True
    extrude = (ids >= 0) & ~first
    beads = np.flatnonzero(way.path_id >= 0)
    changes = int(path.reconfigures.sum())
    warnings = []
    slow = _slow_ratio(path, timing, speed)
    if slow > 0.005:
        warnings.append(
            f"the tip is more than 1 % too slow on {100 * slow:.1f} % of the printed length; "
            "beads are thicker there"
        )
    if changes:
        warnings.append(f"the arm changes its configuration on {changes} travels")
    return PrintTrajectory(
        joint_names=cell.robot.joint_names,
        times=timing.times[keep],
        positions=path.q[keep],
        velocities=timing.velocities[keep],
        extrude=extrude[keep],
        path_id=ids[keep],
        T_base_part=cell.placement.T_base_part,
        slow_ratio=slow,
        warnings=tuple(warnings),
        dispensing=switching_times(
            timing.times[way.starts[beads]] - waits[beads],
            timing.times[way.starts[beads + 1] - 1],
            cell.material,
        ),
    )


def _slow_ratio(path: JointPath, timing: Timing, speed: float) -> float:
    """Printed length below the set speed, over the printed length."""
    printing = path.way.printing
    length = np.diff(path.way.path)[printing]
    time = np.diff(timing.times)[printing]
    slow = length < (1.0 - SLOW_RATIO) * speed * time
    total: Floats = length.sum()
    return float(length[slow].sum() / total) if total > 0 else 0.0
