# SPDX-License-Identifier: Apache-2.0
"""Toolpaths that touch nothing: resolved as they are, or after another cut of the layers."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from vega_planner.datatypes import LayerStack, Patch, ToolpathSet
from vega_planner.ordering import order_patches
from vega_planner.printability.collisions import CollisionCheck, too_much_left_out
from vega_planner.printability.repair import resolve_collisions
from vega_planner.progress import Report
from vega_planner.settings import Settings
from vega_planner.toolpaths import lay_toolpaths

if TYPE_CHECKING:
    from vega_planner.ordering.order import PrintOrder
    from vega_planner.printability.assessment import Assessment
    from vega_planner.robot.workcell import Workcell

#: Share of colliding waypoints beyond which layers cut into bands are tried before the
#: nozzle is turned everywhere.
MANY = 0.04


def clear_toolpaths(
    order: PrintOrder,
    toolpaths: ToolpathSet,
    patches: Sequence[Patch],
    assessment: Assessment,
    stack: LayerStack,
    cell: Workcell,
    settings: Settings,
    report: Report,
) -> tuple[PrintOrder, ToolpathSet, CollisionCheck]:
    """Resolve what collides; where too much is lost by it, try layers cut into bands.

    Args:
        order: The patches in print order.
        toolpaths: Their toolpaths.
        patches: The patches as the splitting left them.
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

    uncut = len(order.patches) == len(patches)
    if not uncut or not (policy.orientation == "collision-free" or order.report.status == "fully"):
        return (order, *resolved(toolpaths))
    paths, check = resolved(toolpaths, MANY)
    if not too_much_left_out(check, order.report):
        return order, paths, check
    pieces = order_patches(patches, stack, cell, policy, report, assessment, cut=True)
    other, found = resolved(lay_toolpaths(pieces.patches, stack, cell, settings.toolpaths, report))
    if check.colliding and too_much_left_out(found, pieces.report):
        paths, check = resolved(toolpaths)
    if (found.colliding, found.left_out_ratio) < (check.colliding, check.left_out_ratio):
        return pieces, other, found
    return order, paths, check
