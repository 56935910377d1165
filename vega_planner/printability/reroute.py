# SPDX-License-Identifier: Apache-2.0
"""Another way for a move that collides: out, over everything and in again, each leg tried.

A move between passes is laid with a map of heights, which knows no overhangs and no tilted
neighbours. Where the check of every waypoint finds it colliding, ways out of the last pass
and into the next are tried against what is really there, the shortest first.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from vega_planner.datatypes import Bools, Floats, ToolpathSet, Travel
from vega_planner.printability.collisions import FREE_MM, Surroundings
from vega_planner.progress import Progress, Report
from vega_planner.toolpaths.travel import polyline_of_poses, slerp_one

if TYPE_CHECKING:
    from vega_planner.robot.workcell import Workcell

#: Distances the tool draws back from a pass before it rises [mm].
BACK_MM = (3.0, 6.0, 12.0, 24.0, 48.0)

#: Angles between the nozzle and the way it draws back [deg], and directions about it.
SPLAY_DEG, AROUND = (0.0, 20.0, 40.0, 60.0), 8

#: How far the nozzle is turned upright on the way back.
UPRIGHT = (0.0, 0.5, 1.0)

#: Clearance of a way that is taken [mm].
ENOUGH_MM = 0.05

#: Room between the tool and the highest material when it crosses over [mm].
ROOM_MM = 3.0

#: Moves that are rerouted at most; beyond, something else is wrong.
MOST = 200

_UP = np.array([0.0, 0.0, 1.0])
_Clearance = Callable[[Floats, Floats, Bools], Floats]


def reroute(
    toolpaths: ToolpathSet, travels: np.ndarray, around: Surroundings, cell: Workcell,
    report: Report, budget: int | None = None,
) -> ToolpathSet:  # fmt: skip
    """Replace moves by others that are clear, where there are such.

    Args:
        toolpaths: Passes and travel.
        travels: Indices into `toolpaths.travels` of the moves to replace.
        around: What is there at each moment of the same toolpaths.
        cell: Tool, placement and substrate.
        report: Receives progress; may raise `Cancelled`.
        budget: Poses tried by `around` at which trying ends; none when absent.

    Returns:
        The toolpaths; a move that has no clear way stays as it was.
    """
    moves = list(toolpaths.travels)
    for number in travels[:MOST]:
        if budget is not None and around.tried >= budget:
            break
        report(Progress("checks", 0.7, detail="travel"))
        found = _clear_move(toolpaths, int(number), around, cell)
        moves[number] = found if found is not None else moves[number]
    return replace(toolpaths, travels=tuple(moves))


def _clear_move(
    toolpaths: ToolpathSet, number: int, around: Surroundings, cell: Workcell
) -> Travel | None:
    passes = toolpaths.passes
    clear = around.at(around.first_of(-1 - number))
    before = passes[number - 1] if number > 0 else None
    after = passes[number] if number < len(passes) else None
    top = _top(toolpaths, cell)
    out, into = None, None
    if before is not None:
        out = _leg(before.points[-1], before.axes[-1], top, clear, cell)
        if out is None:
            return None
    if after is not None:
        into = _leg(after.points[0], after.axes[0], top, clear, cell)
        if into is None:
            return None
        into = (into[0][::-1], into[1][::-1])
    if out is None or into is None:
        leg = out or into
        return polyline_of_poses(*leg) if leg is not None else None
    return _lowest(out, into, clear) or polyline_of_poses(out[0] + into[0], out[1] + into[1])


def _top(toolpaths: ToolpathSet, cell: Workcell) -> float:
    """Height of the highest material there will be [mm]."""
    top = max(float((path.points[:, 2] + path.height).max()) for path in toolpaths.passes)
    return top if cell.substrate is None else max(top, float(cell.substrate.vertices[:, 2].max()))


def _leg(
    point: Floats, axis: Floats, top: float, clear: _Clearance, cell: Workcell
) -> tuple[list[Floats], list[Floats]] | None:
    """Find poses from the end of a pass to upright above everything, clear all along."""
    radius, distance = np.asarray(cell.tool.radius), np.asarray(cell.tool.distance)
    for back in BACK_MM:
        for way in _ways(axis):
            for upright in UPRIGHT:
                turned = slerp_one(axis, _UP, upright)
                sine = np.sqrt(max(0.0, 1.0 - float(turned[2]) ** 2))
                drop = float(np.max(radius * sine - distance * turned[2]))
                first = point + back * way
                high = max(top + ROOM_MM + drop, float(first[2]))
                over = np.array([first[0], first[1], high])
                points, axes = [point, first, over], [axis, turned, turned]
                if upright < 1.0:
                    points.append(over + 2.0 * _UP)
                    axes.append(_UP)
                if _is_clear(polyline_of_poses(points, axes), (point,), clear):
                    return points, axes
    return None


def _ways(axis: Floats) -> list[Floats]:
    """Directions to draw back: along the nozzle, upwards, and splayed about the nozzle."""
    side = np.cross(axis, [1.0, 0.0, 0.0] if abs(axis[0]) < 0.9 else [0.0, 1.0, 0.0])
    side /= np.linalg.norm(side)
    other = np.cross(axis, side)
    ways = [np.asarray(axis), _UP]
    for splay in np.radians(SPLAY_DEG[1:]):
        for turn in np.arange(AROUND) * (2 * np.pi / AROUND):
            lateral = np.cos(turn) * side + np.sin(turn) * other
            ways.append(np.cos(splay) * axis + np.sin(splay) * lateral)
    return [way for way in ways if way[2] > 0.0]


def _lowest(
    out: tuple[list[Floats], list[Floats]],
    into: tuple[list[Floats], list[Floats]],
    clear: _Clearance,
) -> Travel | None:
    """Cross over no higher than needed: the lowest level that is clear."""
    base = max(float(out[0][1][2]), float(into[0][-2][2]))
    for hop in (0.0, 4.0, 16.0):
        points, axes = list(out[0][:2]), list(out[1][:2])
        for pose, tilt in ((out[0][1], out[1][1]), (into[0][-2], into[1][-2])):
            points.append(np.array([pose[0], pose[1], base + hop]))
            axes.append(tilt)
        points += into[0][-2:]
        axes += into[1][-2:]
        move = polyline_of_poses(points, axes)
        if _is_clear(move, (points[0], points[-1]), clear):
            return move
    return None


def _is_clear(move: Travel, ends: tuple[Floats, ...], clear: _Clearance) -> bool:
    """Tell whether the tool is clear at every waypoint but the first and last of a move."""
    free = np.ones(len(move.points), np.bool_)
    for end in ends:
        free &= np.linalg.norm(move.points - end, axis=1) > FREE_MM
    gap = clear(move.points, move.axes, free)
    # at the end itself the tool stands as on the pass, which is checked there
    at_end = np.zeros(len(gap), np.bool_)
    for end in ends:
        at_end |= np.linalg.norm(move.points - end, axis=1) < 1e-9
    return bool((gap[~at_end] >= ENOUGH_MM).all() and (gap >= 0).all())
