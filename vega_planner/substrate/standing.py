# SPDX-License-Identifier: Apache-2.0
"""Stand a part without a flat base on its substrate in the cell."""

from __future__ import annotations

from typing import TYPE_CHECKING

from vega_planner.datatypes import Part
from vega_planner.substrate.bowl import make_substrate, stands_flat

if TYPE_CHECKING:
    from vega_planner.robot.workcell import Workcell


def stand_on_substrate(cell: Workcell, part: Part) -> Workcell:
    """Give the cell a conformal substrate where the part needs one.

    Args:
        cell: Robot, tool and placement.
        part: The part to print.

    Returns:
        The cell as it is for a part with a planar base, or one that has a substrate
        already; else the part lifted onto its substrate.
    """
    if cell.substrate is not None or stands_flat(part):
        return cell
    from vega_planner.robot.workcell import place

    substrate = make_substrate(part)
    return place(cell, cell.placement.pose, lift_mm=substrate.floor_mm, substrate=substrate)
