# SPDX-License-Identifier: Apache-2.0
"""The conformal substrate as a file for an ordinary printer."""

from __future__ import annotations

from pathlib import Path

from vega_planner.datatypes import Part
from vega_planner.errors import InvalidInput
from vega_planner.progress import Report, silent
from vega_planner.results.folder import check_output_folder, write_folder
from vega_planner.results.stl import mesh_stl
from vega_planner.settings import Settings
from vega_planner.substrate import Substrate, make_substrate, stands_flat


def write_substrate(
    part: Part,
    path: str | Path,
    clearance_mm: float | None = None,
    settings: Settings | None = None,
    report: Report = silent,
) -> Path:
    """Write the substrate of a part as binary STL, in the part frame [mm].

    It is the one the planner prints on with the same settings: a lower one where the usual
    one would stand in the nozzle's way.

    Args:
        part: The part, lowest point on z = 0; the substrate's foot is below.
        path: File to write.
        clearance_mm: Gap between part and substrate; the default's where absent.
        settings: Layers, robot, tool and limits; the defaults where absent.
        report: Receives progress; may raise `Cancelled`.

    Returns:
        The file's absolute path.

    Raises:
        InvalidInput: If the part stands flat and needs none, or a value is out of range.
        OutputError: If the file cannot be written.
    """
    target = Path(path).absolute()
    if target.suffix.lower() != ".stl":
        raise InvalidInput(f"substrate file {path} ends in '{target.suffix}'; choices: .stl")
    if stands_flat(part):
        raise InvalidInput(f"part '{part.name}' has a planar base and needs no substrate")
    check_output_folder(target.parent)
    changes = {} if clearance_mm is None else {"clearance_mm": clearance_mm}
    usual = make_substrate(part, **changes)
    planned = planned_substrate(part, settings or Settings(), report)
    if planned.height_mm < usual.height_mm:
        usual = make_substrate(part, height_mm=planned.height_mm, **changes)
    write_folder(target.parent, {target.name: mesh_stl(usual)})
    return target


def planned_substrate(part: Part, settings: Settings, report: Report = silent) -> Substrate:
    """Find the substrate the planner prints a part on.

    Args:
        part: A part without a planar base.
        settings: As for the plan.
        report: Receives progress; may raise `Cancelled`.
    """
    from vega_planner.layers import generate_layers
    from vega_planner.printability import assess_printability
    from vega_planner.printability.lower_substrate import with_lower_substrate
    from vega_planner.printability.pose import choose_pose
    from vega_planner.robot import load_cell
    from vega_planner.robot.placement import parse_pose
    from vega_planner.robot.workcell import place
    from vega_planner.substrate import stand_on_substrate

    limits, width = settings.printability, settings.toolpaths.width_mm
    stack = generate_layers(
        part, settings.layers, report, edge_angle_deg=settings.part.edge_angle_deg
    )
    cell = stand_on_substrate(load_cell(settings.cell, part), part)
    if parse_pose(settings.cell.pose) is None:
        cell = place(cell, choose_pose(stack, cell, limits))
    judged = assess_printability(stack, cell, limits, report, width)
    cell, _ = with_lower_substrate(stack, cell, limits, judged, report, width)
    assert isinstance(cell.substrate, Substrate)
    return cell.substrate
