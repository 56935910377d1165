# SPDX-License-Identifier: Apache-2.0
"""The prime line: a bead beside the part that fills the nozzle before the print begins."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from vega_planner.datatypes import Floats, Toolpath, ToolpathSet
from vega_planner.errors import InvalidInput
from vega_planner.toolpaths.travel import TravelPlanner

if TYPE_CHECKING:
    from vega_planner.robot.workcell import Workcell

#: Patch and layer of the prime line: it belongs to none.
NO_PATCH = -1

#: Distance between the prime line and what is printed or stands there [mm].
AWAY_MM = 8.0

#: Points of the line are this far apart [mm].
_STEP_MM = 1.0

#: The tip has to reach this high above the line too [mm].
_HEAD_ROOM_MM = 10.0


def with_prime_line(
    toolpaths: ToolpathSet,
    cell: Workcell,
    *,
    length_mm: float,
    width_mm: float,
    height_mm: float,
) -> ToolpathSet:
    """Lay a straight bead on the plate first, on the nearest side that can be reached.

    Args:
        toolpaths: Passes and travel.
        cell: Plate, substrate, tool and reach.
        length_mm: Length of the line; 0 for none.
        width_mm: Width of its bead.
        height_mm: Height of its bead.

    Returns:
        The toolpaths with one pass more, of patch and layer -1, before all others.

    Raises:
        InvalidInput: If no side of the part has room within reach for the line.
    """
    if length_mm <= 0 or not toolpaths.passes:
        return toolpaths
    low = np.min([path.points.min(0) for path in toolpaths.passes], axis=0)
    high = np.max([path.points.max(0) for path in toolpaths.passes], axis=0)
    substrate = cell.substrate
    if substrate is not None:
        low = np.minimum(low, substrate.vertices.min(0))
        high = np.maximum(high, substrate.vertices.max(0))
    floor = float(cell.placement.plate_z_mm)
    line = _line(toolpaths.passes[0], low, high, floor, cell, length_mm, width_mm, height_mm)
    planner = TravelPlanner(
        np.minimum(low, line.points.min(0)), np.maximum(high, line.points.max(0)), floor, cell.tool
    )
    if substrate is not None:
        points = np.concatenate([substrate.vertices, substrate.vertices[substrate.faces].mean(1)])
        planner.add_points(points, np.zeros(len(points)), 1.0)
    arrive = planner.arrive(line)
    planner.add(line)
    move = planner.move(line, toolpaths.passes[0])
    return replace(
        toolpaths,
        passes=(line, *toolpaths.passes),
        travels=(arrive, move, *toolpaths.travels[1:]),
    )


def _line(
    first: Toolpath,
    low: Floats,
    high: Floats,
    floor: float,
    cell: Workcell,
    length: float,
    width: float,
    height: float,
) -> Toolpath:
    """Choose the side nearest to the first pass, and end near it."""
    count = max(2, int(np.ceil(length / _STEP_MM)) + 1)
    along = np.linspace(-0.5 * length, 0.5 * length, count)
    middle = 0.5 * (low + high)
    gap = AWAY_MM + 0.5 * width
    up = np.tile([0.0, 0.0, 1.0], (count, 1))
    found = []
    for axis in (1, 0):
        for side in (low[axis] - gap, high[axis] + gap):
            points = np.empty((count, 3))
            points[:, 1 - axis] = middle[1 - axis] + along
            points[:, axis] = side
            points[:, 2] = floor + 0.5 * height
            both = np.concatenate([points, points + np.array([0.0, 0.0, _HEAD_ROOM_MM])])
            if not cell.reachable(both, np.concatenate([up, up])).all():
                continue
            ends = np.linalg.norm(points[[0, -1]] - first.points[0], axis=1)
            found.append((float(ends.min()), points if ends[1] <= ends[0] else points[::-1]))
    if not found:
        raise InvalidInput(
            f"a prime line of {length:g} mm, {AWAY_MM:g} mm beside the part, is within reach on "
            "no side; shorten toolpaths.prime_mm, set it to 0, or move the part with cell.pose"
        )
    points = min(found, key=lambda one: one[0])[1]
    return Toolpath(
        points, up, np.full(count, width), np.full(count, height), patch=NO_PATCH, layer=NO_PATCH
    )
