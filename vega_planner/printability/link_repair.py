# SPDX-License-Identifier: Apache-2.0
"""The motion of the joints, and what is done where links of the robot touch something.

An arm of more than five axes, or with a second branch of the wrist, takes another
configuration. Where the pose leaves no choice, the nozzle is turned like for a collision of
its own, and what little cannot be laid so is left out.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from vega_planner.datatypes import LayerStack, PrintTrajectory, ToolpathSet
from vega_planner.printability.collisions import CollisionCheck, check_toolpaths
from vega_planner.printability.leave_out import left_out_ratio
from vega_planner.printability.links import LinkWatch
from vega_planner.printability.repair import resolve_collisions
from vega_planner.printability.robot_body import BodyCheck, check_robot_body
from vega_planner.progress import Report
from vega_planner.settings import Settings
from vega_planner.trajectory import make_clear_trajectory

if TYPE_CHECKING:
    from vega_planner.robot.workcell import Workcell

#: Room that configurations are asked to leave between links and what is there [mm], one
#: after the other: an arm with a free turn strays between the poses it is chosen for.
ROOMS_MM = (6.0, 15.0)

#: Toolpaths with their check, and the motion along them with its own.
Motion = tuple[ToolpathSet, CollisionCheck, PrintTrajectory, BodyCheck]


def clear_motion(
    toolpaths: ToolpathSet,
    check: CollisionCheck,
    stack: LayerStack,
    cell: Workcell,
    settings: Settings,
    report: Report,
) -> Motion:
    """Make the joint motion and keep the robot's links off what is there, where that goes.

    Args:
        toolpaths: Passes, at least one, and travel.
        check: The check of their waypoints.
        stack: The layers.
        cell: Robot, tool, placement and substrate.
        settings: Policy, limits and speeds.
        report: Receives progress; may raise `Cancelled`.

    Returns:
        The toolpaths, changed where links touched something, their check, the motion, and
        the check of its every sample.

    Raises:
        Unreachable: As `make_trajectory`.
    """
    first = _moved(toolpaths, check, cell, settings, report)
    policy = settings.printability
    if (
        not first[3].touching
        or cell.robot.closed_form is None
        or policy.orientation != "collision-free"
    ):
        return first
    paths, _ = resolve_collisions(toolpaths, stack, cell, policy, report, links=True)
    if not paths.passes:
        return first
    other = check_toolpaths(paths, stack, cell, report)
    ratio = check.left_out_ratio + left_out_ratio(toolpaths, paths, stack.part)
    other = replace(other, left_out_ratio=ratio)
    second = _moved(paths, other, cell, settings, report)
    better = (second[3].touching, other.colliding) < (first[3].touching, check.colliding)
    return second if better else first


def _moved(
    toolpaths: ToolpathSet,
    check: CollisionCheck,
    cell: Workcell,
    settings: Settings,
    report: Report,
) -> Motion:
    """The motion with the fewest touching samples, of those that leave more and more room."""
    watch = LinkWatch(toolpaths, cell)
    found: list[tuple[PrintTrajectory, BodyCheck]] = []
    for room in ROOMS_MM:
        wide = LinkWatch(toolpaths, cell, room)
        motion = make_clear_trajectory(toolpaths, cell, settings.trajectory, wide.avoids, report)
        found.append((motion, check_robot_body(toolpaths, motion, cell, report, watch)))
        if not found[-1][1].touching or cell.robot.closed_form is not None:
            break
    return (toolpaths, check, *min(found, key=lambda each: each[1].touching))
