# SPDX-License-Identifier: Apache-2.0
"""Toolpaths that touch nothing: resolved as they are, with passes interleaved, or in bands."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from vega_planner.datatypes import LayerStack, Patch, ToolpathSet
from vega_planner.ordering import order_patches
from vega_planner.ordering.order import PrintOrder, with_interleaved
from vega_planner.printability.collisions import (
    TOO_MUCH,
    CollisionCheck,
    too_much_left_out,
)
from vega_planner.printability.interleave import interleaved
from vega_planner.printability.repair import resolve_collisions
from vega_planner.progress import Report
from vega_planner.settings import Settings
from vega_planner.toolpaths import lay_toolpaths
from vega_planner.toolpaths.coverage import deposited_volume
from vega_planner.toolpaths.lay import plan_moves

if TYPE_CHECKING:
    from vega_planner.printability.assessment import Assessment
    from vega_planner.robot.workcell import Workcell

#: Share of colliding waypoints beyond which passes are interleaved before the nozzle is
#: turned everywhere, where layers are not printable as they are.
MANY = 0.08

#: Share of the area that may be printed with nothing under it before passes are interleaved,
#: and before patches are cut into bands, at whose rims the print stays open.
FLOATING, FLOATS_TOO_MUCH = 0.01, 0.03

#: Share of the poses that interleaved passes may leave in each other's way: turned, most of
#: them are clear.
BLOCKED = 0.1


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
    """Resolve what collides; where too much is lost by it or floats, cut and try again.

    First the passes of whole patches are cut and interleaved, which leaves nothing open
    between them. Where even those are too much in each other's way, the patches are cut
    into bands of height. The way that loses least is taken.

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
        The order, toolpaths and check of the best way.
    """
    policy = settings.printability
    whole = deposited_volume(toolpaths.passes)

    def resolved(way: PrintOrder, paths: ToolpathSet, give_up_share: float = 1.0) -> _Way:
        cleared, check = resolve_collisions(
            paths, stack, cell, policy, report, give_up_share=give_up_share
        )
        lack = 1.0 - deposited_volume(cleared.passes) / max(whole, 1e-9)
        return _Way(way, cleared, check, max(lack, check.left_out_ratio))

    if policy.orientation != "collision-free" or stack.engine == "planar":
        return resolved(order, toolpaths).outcome
    ways = []
    fully = order.report.status == "fully"
    if _floating_share(order) <= FLOATING:
        ways.append(resolved(order, toolpaths, 1.0 if fully else MANY))
        if ways[-1].is_good:
            return ways[-1].outcome
    found = interleaved(
        toolpaths.passes, cell, assessment.surroundings, stack.thickness_mm, report
    )
    if found.blocked_ratio <= BLOCKED:
        moves, _ = plan_moves(found.passes, cell, report)
        areas = [found.floating_mm2.get(place, 0.0) for place in range(len(order.patches))]
        paths = replace(toolpaths, passes=tuple(found.passes), travels=tuple(moves))
        ways.append(resolved(with_interleaved(order, np.array(areas), assessment), paths))
        if ways[-1].is_good:
            return ways[-1].outcome
    if any(way.is_enough for way in ways):
        return min(ways, key=lambda way: way.loss).outcome
    pieces = order_patches(patches, stack, cell, policy, report, assessment, cut=True)
    if len(pieces.patches) > len(patches):
        laid = lay_toolpaths(pieces.patches, stack, cell, settings.toolpaths, report)
        ways.append(resolved(pieces, laid))
    if not any(way.is_enough for way in ways):
        ways.append(resolved(order, toolpaths))
    return min(ways, key=lambda way: way.loss).outcome


@dataclass(frozen=True, eq=False)
class _Way:
    """One way of printing, as far as it goes.

    Attributes:
        order: Its patches.
        toolpaths: Its passes and moves.
        check: The check of them.
        lack: What it does not deposit of the volume of the whole patches.
    """

    order: PrintOrder
    toolpaths: ToolpathSet
    check: CollisionCheck
    lack: float

    @property
    def outcome(self) -> tuple[PrintOrder, ToolpathSet, CollisionCheck]:
        return self.order, self.toolpaths, self.check

    @property
    def is_good(self) -> bool:
        """Whether no other way has to be tried."""
        lost = too_much_left_out(self.check, self.order.report)
        return not lost and _floating_share(self.order) <= FLOATING

    @property
    def is_printable(self) -> bool:
        """Whether the part is printable this way, by what no bead is laid of."""
        lost = self.check.left_out_ratio + self.order.report.unprintable_ratio
        return not self.check.colliding and lost <= TOO_MUCH

    @property
    def is_enough(self) -> bool:
        """Whether nothing worse has to be tried."""
        return self.is_printable and _floating_share(self.order) <= FLOATS_TOO_MUCH

    @property
    def loss(self) -> tuple[int, bool, float]:
        """What counts against it: waypoints that collide, then what is missing or floats."""
        lost = self.lack + _floating_share(self.order)
        return self.check.colliding, not self.is_printable, lost


def _floating_share(order: PrintOrder) -> float:
    """Share of the area that is printed with nothing under it."""
    area = sum(patch.area for patch in order.patches)
    return float(order.floating_mm2.sum()) / max(area, 1e-9)
