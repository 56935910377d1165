# SPDX-License-Identifier: Apache-2.0
"""What is done about colliding waypoints: turn the nozzle, move another way, leave out.

The rest stays as it is. The tool axes of a pass are interpolated between the vertices of
its patch; in a tight place what is between two clear axes need not be clear. Each run of
colliding waypoints gets one clear axis, nearest to what it had, reached and left by a ramp
along the pass.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from vega_planner.datatypes import Bools, Floats, LayerStack, Patch, Toolpath, ToolpathSet, Travel
from vega_planner.printability.collisions import (
    CollisionCheck,
    Surroundings,
    check_toolpaths,
)
from vega_planner.printability.leave_out import leave_out
from vega_planner.printability.reroute import reroute
from vega_planner.progress import Progress, Report
from vega_planner.settings import PrintabilitySettings

if TYPE_CHECKING:
    from vega_planner.robot.workcell import Workcell

#: Length of the ramps at both ends of a run [mm].
RAMP_MM = 4.0

#: Colliding waypoints nearer than this along a pass form one run [mm].
JOIN_MM = 3.0

#: Clearance a run is content with where the full one cannot be had [mm].
ENOUGH_MM = 0.02

#: Rounds of checking and turning.
ROUNDS = 3

#: Number, and share, of colliding waypoints beyond which turning the nozzle is no answer.
MANY, HOPELESS_SHARE = 500, 0.02

_TILTS_DEG, _AZIMUTHS = (0.0, 6.0, 12.0, 18.0, 25.0, 33.0, 42.0, 52.0, 63.0), 16


def resolve_collisions(
    toolpaths: ToolpathSet,
    patches: Sequence[Patch],
    stack: LayerStack,
    cell: Workcell,
    settings: PrintabilitySettings,
    report: Report,
) -> tuple[ToolpathSet, CollisionCheck]:
    """Check every waypoint and do something about those that collide.

    The nozzle is turned; moves between passes that still collide take another way; and
    what little of the passes still does is left out, with a warning. Only the
    collision-free orientation policy changes anything; the others are checked.

    Args:
        toolpaths: Passes and travel.
        patches: Patches in print order.
        stack: The layers.
        cell: Tool, placement and substrate.
        settings: Policy, limits and clearance.
        report: Receives progress; may raise `Cancelled`.

    Returns:
        The toolpaths, and the outcome of their last check.
    """

    def checked(paths: ToolpathSet) -> CollisionCheck:
        return check_toolpaths(paths, patches, stack, cell, settings, report)

    check = checked(toolpaths)
    if settings.orientation != "collision-free":
        return toolpaths, check
    for _ in range(ROUNDS):
        hopeless = max(MANY, HOPELESS_SHARE * check.checked)
        if not check.colliding or check.colliding > hopeless:
            break
        turned = _turned(toolpaths, check, stack, cell, settings, report)
        again = checked(turned)
        if again.colliding >= check.colliding:
            break
        toolpaths, check = turned, again
    travels = np.array(list(check.of_travels()), np.int64)
    if len(travels):
        around = Surroundings(toolpaths, stack, cell)
        moved = reroute(toolpaths, travels, around, cell, report)
        again = checked(moved)
        if again.colliding < check.colliding:
            toolpaths, check = moved, again
    less = leave_out(toolpaths, check, stack.part)
    if less is not None:
        around = Surroundings(less[0], stack, cell)
        moved = reroute(less[0], less[1], around, cell, report)
        again = checked(moved)
        if again.colliding < check.colliding:
            toolpaths, check = moved, again
    return toolpaths, check


def candidate_axes(max_tilt_deg: float) -> Floats:
    """Directions tried for the nozzle, upright first, shape (k, 3)."""
    axes = [(0.0, 0.0, 1.0)]
    for tilt in np.radians([t for t in _TILTS_DEG if 0 < t <= max_tilt_deg]):
        for turn in np.arange(_AZIMUTHS) * (2 * np.pi / _AZIMUTHS):
            axes.append((np.sin(tilt) * np.cos(turn), np.sin(tilt) * np.sin(turn), np.cos(tilt)))
    return np.array(axes)


def _turned(
    toolpaths: ToolpathSet,
    check: CollisionCheck,
    stack: LayerStack,
    cell: Workcell,
    settings: PrintabilitySettings,
    report: Report,
) -> ToolpathSet:
    around = Surroundings(toolpaths, stack, cell)
    tries = candidate_axes(settings.max_tilt_deg)
    passes = list(toolpaths.passes)
    travels = list(toolpaths.travels)
    printing = enumerate(check.of_passes(toolpaths))
    hits = {number: hit for number, hit in printing if len(hit)}
    hits |= {-1 - number: hit for number, hit in check.of_travels().items()}
    for path, hit in hits.items():
        report(Progress("checks", 0.5))
        line: Toolpath | Travel = travels[-1 - path] if path < 0 else passes[path]
        first = around.first_of(path)
        along = _arc_length(line.points)
        axes = np.array(line.axes)
        fixed = np.zeros(len(axes), np.bool_)
        for run in _runs(hit, along):
            fixed[run] = True
        for run in _runs(hit, along):
            _turn_run(run, first, line.points, axes, along, fixed, around, tries, settings)
        if path < 0:
            travels[-1 - path] = replace(travels[-1 - path], axes=axes)
        else:
            passes[path] = replace(passes[path], axes=axes)
    for number, path_ in enumerate(passes):
        travels[number] = _joined(travels[number], path_.axes[0], at_end=True)
        travels[number + 1] = _joined(travels[number + 1], path_.axes[-1], at_end=False)
    return replace(toolpaths, passes=tuple(passes), travels=tuple(travels))


def _arc_length(points: Floats) -> Floats:
    steps = np.linalg.norm(np.diff(points, axis=0), axis=1)
    return np.concatenate([[0.0], np.cumsum(steps)])


def _runs(hit: np.ndarray, along: Floats) -> list[np.ndarray]:
    breaks = np.flatnonzero(np.diff(along[hit]) > JOIN_MM) + 1
    return [np.arange(run[0], run[-1] + 1) for run in np.split(hit, breaks)]


def _turn_run(
    run: np.ndarray,
    first: int,
    points: Floats,
    axes: Floats,
    along: Floats,
    fixed: Bools,
    around: Surroundings,
    tries: Floats,
    settings: PrintabilitySettings,
) -> None:
    """Give a run the axis nearest to its own that is clear all along; halve it if none is."""
    # at its last waypoint, the whole of a pass is there as the move begins
    check = around.at(first + int(run[-1]) + (run[-1] == len(points) - 1))
    few = run[:: max(1, len(run) // 40)]
    least = np.full(len(tries), np.inf)
    for k in few:
        todo = np.flatnonzero(least >= ENOUGH_MM)
        tips = np.tile(points[k], (len(todo), 1))
        free = np.full(len(todo), around.is_free(first + int(k)))
        least[todo] = np.minimum(least[todo], check(tips, tries[todo], free))
    clear = least >= min(settings.clearance_mm, max(ENOUGH_MM, float(least.max())))
    if not clear.any():
        if len(run) > 1:
            middle = len(run) // 2
            for half in (run[:middle], run[middle:]):
                _turn_run(half, first, points, axes, along, fixed, around, tries, settings)
            return
        clear = least >= least.max()
    mean = axes[run].sum(0)
    chosen = tries[np.flatnonzero(clear)[np.argmax(tries[clear] @ mean)]]
    before, after = along[run[0]] - along, along - along[run[-1]]
    away = np.maximum(np.maximum(before, after), 0.0)
    weight = np.clip(1.0 - away / RAMP_MM, 0.0, 1.0)
    weight[fixed] = 0.0  # other runs keep what they are given
    weight[run] = 1.0
    near = np.flatnonzero(weight > 0)
    blend = weight[near] * weight[near] * (3 - 2 * weight[near])
    axes[near] = _blended(axes[near], np.tile(chosen, (len(near), 1)), blend)


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
    along = _arc_length(travel.points)
    away = along[-1] - along if at_end else along
    weight = np.clip(1.0 - away / max(RAMP_MM, 1e-9), 0.0, 1.0)
    weight[end] = 1.0
    axes = _blended(travel.axes, np.tile(axis, (len(travel.axes), 1)), weight)
    axes[end] = axis
    return replace(travel, axes=axes)
