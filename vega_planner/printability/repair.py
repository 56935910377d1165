# SPDX-License-Identifier: Apache-2.0
"""What is done about colliding waypoints: turn the nozzle, move another way, leave out.

The rest stays as it is. The tool axes of a pass are interpolated between the vertices of
its patch; in a tight place what is between two clear axes need not be clear. Each run of
colliding waypoints gets one clear axis, nearest to what it had, reached and left by a ramp
along the pass.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from vega_planner.datatypes import Floats, Ints, LayerStack, Toolpath, ToolpathSet, Travel
from vega_planner.printability.collisions import (
    CollisionCheck,
    Surroundings,
    check_toolpaths,
)
from vega_planner.printability.leave_out import leave_out, leave_out_everything, left_out_ratio
from vega_planner.printability.reroute import reroute
from vega_planner.printability.resequence import in_bands, joined
from vega_planner.printability.turning import arc_length, turned_clear
from vega_planner.progress import Progress, Report
from vega_planner.settings import PrintabilitySettings
from vega_planner.toolpaths.lay import plan_moves

if TYPE_CHECKING:
    from vega_planner.robot.workcell import Workcell

#: Length over which a move takes on the axis of the pass it meets [mm].
RAMP_MM = 4.0

#: Rounds of checking and turning.
ROUNDS = 4

#: Share of colliding waypoints up to which patches are printed in common bands.
FEW_SHARE = 0.015

#: Share of colliding waypoints beyond which turning the nozzle is no answer.
HOPELESS_SHARE = 0.45

#: Poses tried at most in all rounds of turning, and in one of finding other moves. Counted,
#: not timed, so that the outcome is the same everywhere.
TURN_POSES, REROUTE_POSES = 700_000, 100_000


def resolve_collisions(
    toolpaths: ToolpathSet,
    stack: LayerStack,
    cell: Workcell,
    settings: PrintabilitySettings,
    report: Report,
    *,
    links: bool = False,
    give_up_share: float = 1.0,
) -> tuple[ToolpathSet, CollisionCheck]:
    """Check every waypoint and do something about those that collide.

    The nozzle is turned; moves between passes that still collide take another way; and
    what little of the passes still does is left out, with a warning. Where that is not
    enough, patches are printed in common bands of height; and in the end all that collides
    is left out. Only the collision-free orientation policy changes anything; the others
    are checked.

    Args:
        toolpaths: Passes and travel.
        stack: The layers.
        cell: Tool, placement and substrate.
        settings: Policy, limits and clearance.
        report: Receives progress; may raise `Cancelled`.
        links: Whether the robot's links count, too; for robots with a closed form.
        give_up_share: Share of colliding waypoints beyond which nothing is tried.

    Returns:
        The toolpaths, and the outcome of their last check.
    """

    def checked(paths: ToolpathSet) -> CollisionCheck:
        return check_toolpaths(paths, stack, cell, report, links=links)

    check = checked(toolpaths)
    few = check.colliding <= give_up_share * check.checked
    if settings.orientation != "collision-free" or not check.colliding or not few:
        return toolpaths, check
    task = _Task(stack, cell, settings, report, checked, links)
    best = _without_rest(task, *_settled(task, toolpaths, check))
    ranges: list[tuple[int, int]] = []
    # over a substrate, patches printed from inside and outside do not share bands
    for last in (False, False, True) if cell.substrate is None else ():
        if not best[1].colliding:
            break
        if last:
            wider = [(0, max(path.patch for path in toolpaths.passes))]
        elif best[1].colliding > FEW_SHARE * best[1].checked:
            continue
        else:
            # what stands in the way of each other is printed in common bands of height
            around = task.around(best[0])
            wider = joined({*around.hit_patches(best[0], best[1]), *ranges})
        if wider == ranges or not wider:
            continue
        ranges = wider
        other = _without_rest(task, *_settled(task, *_banded(task, toolpaths, ranges)))
        if other[1].colliding < best[1].colliding:
            best = other
    paths, found = best
    if found.colliding:
        paths, found = leave_out_everything(*best, stack.part, task.moved)
        ratio = best[1].left_out_ratio + left_out_ratio(best[0], paths, stack.part)
        found = replace(found, left_out_ratio=ratio)
    return paths, found


@dataclass(frozen=True)
class _Task:
    """What stays the same while ways are tried, and how much trying is left."""

    stack: LayerStack
    cell: Workcell
    settings: PrintabilitySettings
    report: Report
    checked: Callable[[ToolpathSet], CollisionCheck]
    links: bool

    def around(self, toolpaths: ToolpathSet) -> Surroundings:
        """What is there, for trying other poses."""
        return Surroundings(toolpaths, self.stack, self.cell, self.links)

    def moved(self, toolpaths: ToolpathSet, travels: Ints) -> tuple[ToolpathSet, CollisionCheck]:
        """Find other ways for some moves and check all."""
        around = self.around(toolpaths)
        paths = reroute(toolpaths, travels, around, self.cell, self.report, REROUTE_POSES)
        return paths, self.checked(paths)


def _settled(
    task: _Task, toolpaths: ToolpathSet, check: CollisionCheck
) -> tuple[ToolpathSet, CollisionCheck]:
    """Turn the nozzle and find other moves, as long as that helps."""
    left = TURN_POSES
    for _ in range(ROUNDS):
        if not 0 < check.colliding <= HOPELESS_SHARE * check.checked or left <= 0:
            break
        around = task.around(toolpaths)
        turned = _turned(toolpaths, check, around, task.settings, task.report, left)
        left -= around.tried
        again = task.checked(turned)
        if again.colliding >= check.colliding:
            break
        toolpaths, check = turned, again
    travels = np.array(list(check.of_travels()), np.int64)
    if len(travels) and check.colliding <= HOPELESS_SHARE * check.checked:
        moved, again = task.moved(toolpaths, travels)
        if again.colliding < check.colliding:
            toolpaths, check = moved, again
    return toolpaths, check


def _without_rest(
    task: _Task, toolpaths: ToolpathSet, check: CollisionCheck
) -> tuple[ToolpathSet, CollisionCheck]:
    """Leave out what still collides, where it is next to nothing."""
    less = leave_out(toolpaths, check, task.stack.part)
    if less is None:
        return toolpaths, check
    moved, again = task.moved(*less)
    if again.colliding >= check.colliding:
        return toolpaths, check
    ratio = left_out_ratio(toolpaths, less[0], task.stack.part)
    return moved, replace(again, left_out_ratio=ratio)


def _banded(
    task: _Task, toolpaths: ToolpathSet, ranges: list[tuple[int, int]]
) -> tuple[ToolpathSet, CollisionCheck]:
    """Print some ranges of patches in common bands of height."""
    passes = in_bands(toolpaths.passes, ranges)
    moves, _ = plan_moves(passes, task.cell, task.report)
    banded = replace(toolpaths, passes=tuple(passes), travels=tuple(moves))
    return banded, task.checked(banded)


def _turned(
    toolpaths: ToolpathSet,
    check: CollisionCheck,
    around: Surroundings,
    settings: PrintabilitySettings,
    report: Report,
    budget: int,
) -> ToolpathSet:
    passes = list(toolpaths.passes)
    travels = list(toolpaths.travels)
    printing = enumerate(check.of_passes(toolpaths))
    hits = {number: hit for number, hit in printing if len(hit)}
    hits |= {-1 - number: hit for number, hit in check.of_travels().items()}
    for path, hit in hits.items():
        report(Progress("checks", 0.5))
        line: Toolpath | Travel = travels[-1 - path] if path < 0 else passes[path]
        first = around.first_of(path)
        axes = turned_clear(
            line.points, line.axes, hit, first, around, settings.max_tilt_deg, path < 0, budget
        )
        if path < 0:
            travels[-1 - path] = replace(travels[-1 - path], axes=axes)
        else:
            passes[path] = replace(passes[path], axes=axes)
    for number, path_ in enumerate(passes):
        travels[number] = _joined(travels[number], path_.axes[0], at_end=True)
        travels[number + 1] = _joined(travels[number + 1], path_.axes[-1], at_end=False)
    return replace(toolpaths, passes=tuple(passes), travels=tuple(travels))


def _blended(a: Floats, b: Floats, share: Floats) -> Floats:
    """Turn unit vectors a towards b along the great circle by a share of the angle."""
    cosine = np.clip(np.einsum("ij,ij->i", a, b), -1.0, 1.0)
    angle = np.arccos(cosine)
    sine = np.sin(angle)
    safe = np.where(sine > 1e-9, sine, 1.0)
    wa = np.where(sine > 1e-9, np.sin((1 - share) * angle) / safe, 1 - share)
    wb = np.where(sine > 1e-9, np.sin(share * angle) / safe, share)
    mixed = wa[:, None] * a + wb[:, None] * b
    return mixed / np.linalg.norm(mixed, axis=1, keepdims=True)


def _joined(travel: Travel, axis: Floats, *, at_end: bool) -> Travel:
    """Make a travel begin or end with the axis of the pass it meets."""
    end = -1 if at_end else 0
    if np.abs(travel.axes[end] - axis).max() < 1e-9:
        return travel
    along = arc_length(travel.points)
    away = along[-1] - along if at_end else along
    weight = np.clip(1.0 - away / max(RAMP_MM, 1e-9), 0.0, 1.0)
    weight[end] = 1.0
    axes = _blended(travel.axes, np.tile(axis, (len(travel.axes), 1)), weight)
    axes[end] = axis
    return replace(travel, axes=axes)
