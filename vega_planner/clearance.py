# SPDX-License-Identifier: Apache-2.0
"""Toolpaths that touch nothing: resolved as they are, or with their passes interleaved."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from vega_planner.datatypes import LayerStack, ToolpathSet
from vega_planner.ordering.order import PrintOrder, with_interleaved
from vega_planner.printability.collisions import CollisionCheck, too_much_left_out
from vega_planner.printability.interleave import interleaved
from vega_planner.printability.repair import resolve_collisions
from vega_planner.progress import Report
from vega_planner.settings import Settings
from vega_planner.toolpaths.lay import plan_moves

if TYPE_CHECKING:
    from vega_planner.printability.assessment import Assessment
    from vega_planner.robot.workcell import Workcell

#: Share of colliding waypoints beyond which passes are interleaved before the nozzle is
#: turned everywhere.
MANY = 0.08

#: Share of the area that may be printed with nothing under it before passes are interleaved.
FLOATING = 0.01


def clear_toolpaths(
    order: PrintOrder,
    toolpaths: ToolpathSet,
    assessment: Assessment,
    stack: LayerStack,
    cell: Workcell,
    settings: Settings,
    report: Report,
) -> tuple[PrintOrder, ToolpathSet, CollisionCheck]:
    """Resolve what collides; where too much is lost by it or floats, interleave passes.

    Args:
        order: The patches in print order.
        toolpaths: Their toolpaths.
        assessment: The judgement they come from.
        stack: The layers.
        cell: Robot, tool, placement and substrate.
        settings: Policies and widths.
        report: Receives progress; may raise `Cancelled`.

    Returns:
        The order, toolpaths and check of the better way.
    """
    policy = settings.printability

    def resolved(
        paths: ToolpathSet, give_up_share: float = 1.0
    ) -> tuple[ToolpathSet, CollisionCheck]:
        return resolve_collisions(paths, stack, cell, policy, report, give_up_share=give_up_share)

    if policy.orientation != "collision-free" or stack.engine == "planar":
        return (order, *resolved(toolpaths))
    floating = _floating_share(order)
    paths, check = toolpaths, None
    if floating <= FLOATING:
        paths, check = resolved(toolpaths, MANY)
        if not too_much_left_out(check, order.report):
            return order, paths, check
    found = interleaved(
        toolpaths.passes, cell, assessment.surroundings, stack.thickness_mm, report
    )
    moves, _ = plan_moves(found.passes, cell, report)
    others, checked = resolved(
        replace(toolpaths, passes=tuple(found.passes), travels=tuple(moves))
    )
    areas = [found.floating_mm2.get(place, 0.0) for place in range(len(order.patches))]
    other = with_interleaved(order, np.array(areas), assessment)
    if not too_much_left_out(checked, other.report) and _floating_share(other) <= FLOATING:
        return other, others, checked
    if check is None or check.colliding:
        paths, check = resolved(toolpaths)
    loss = check.colliding, check.left_out_ratio + floating
    if (checked.colliding, checked.left_out_ratio + _floating_share(other)) < loss:
        return other, others, checked
    return order, paths, check


def _floating_share(order: PrintOrder) -> float:
    """Share of the area that is printed with nothing under it."""
    area = sum(patch.area for patch in order.patches)
    return float(order.floating_mm2.sum()) / max(area, 1e-9)
