# SPDX-License-Identifier: Apache-2.0
"""A lower substrate where the usual one, up to the rim of the lower side, stands in the way.

A part that leans far out over its foot has a lower side that reaches high up, and so does
its substrate, beside what is to be printed. What leans little needs none to be printed on.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from vega_planner.datatypes import LayerStack
from vega_planner.errors import BadMesh
from vega_planner.printability.assessment import Assessment, assess_printability
from vega_planner.printability.collisions import LITTLE
from vega_planner.progress import Report
from vega_planner.robot.workcell import place
from vega_planner.settings import PrintabilitySettings

if TYPE_CHECKING:
    from vega_planner.robot.workcell import Workcell

#: Heights tried, over that of the usual substrate.
HEIGHTS = (0.2, 0.4)


def with_lower_substrate(
    stack: LayerStack,
    cell: Workcell,
    settings: PrintabilitySettings,
    assessment: Assessment,
    report: Report,
    bead_width_mm: float,
) -> tuple[Workcell, Assessment]:
    """Try lower substrates where more than a little of the part is blocked by its own.

    Args:
        stack: The layers.
        cell: The cell, with or without a substrate.
        settings: Limits and clearance.
        assessment: The judgement with the cell as it is.
        report: Receives progress; may raise `Cancelled`.
        bead_width_mm: Width of a bead.

    Returns:
        The cell and the judgement with which least is unprintable; as given where nothing
        is blocked or nothing helps.
    """
    from vega_planner.substrate.bowl import make_substrate

    blocked = sum(r.area_mm2 for r in assessment.report.reasons if r.code == "substrate")
    total = sum(sheet.area for sheet in stack.sheets)
    if cell.substrate is None or blocked <= LITTLE * total:
        return cell, assessment
    usual = float(cell.substrate.vertices[:, 2].max())
    best = cell, assessment
    for share in HEIGHTS:
        try:
            lower = make_substrate(stack.part, height_mm=share * usual)
        except BadMesh:  # the usual one remains
            continue
        pose = cell.placement.pose
        other = place(cell, pose, lift_mm=lower.floor_mm, substrate=lower)
        judged = assess_printability(stack, other, settings, report, bead_width_mm)
        if judged.report.unprintable_ratio < best[1].report.unprintable_ratio:
            best = other, judged
        if judged.report.unprintable_ratio <= LITTLE:
            break
    if best[0].substrate is None or best[0] is cell:
        return best
    edge = float(best[0].substrate.vertices[:, 2].max())
    said = (
        f"the substrate ends {edge:.1f} mm above the part's lowest point, not {usual:.1f} mm, "
        "where it would be in the way: print the substrate.stl of this result"
    )
    return replace(best[0], warnings=(*best[0].warnings, said)), best[1]
