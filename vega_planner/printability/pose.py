# SPDX-License-Identifier: Apache-2.0
"""Where to stand the part: most of it printable, with margin to the limits."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from vega_planner.datatypes import Floats, LayerStack
from vega_planner.printability.orientation import tilt_of, tilted
from vega_planner.printability.tool_shape import ToolShape
from vega_planner.settings import PrintabilitySettings

if TYPE_CHECKING:
    from vega_planner.robot.workcell import Workcell

#: Poses tried: shifts on a grid over the robot's travel [mm], and turns about z [deg].
SHIFTS_MM, TURNS_DEG = (-160.0, -80.0, -40.0, 0.0, 40.0, 80.0, 160.0), (0.0, 45.0, 90.0, 135.0)

#: Samples of the outermost layers the robot is asked about.
SAMPLES = 1500


def choose_pose(
    stack: LayerStack, cell: Workcell, settings: PrintabilitySettings | None = None
) -> tuple[float, float, float, float]:
    """Choose where the part stands.

    The pose with the largest reachable area wins; among equals the one whose joints stay
    farthest from their limits, relative to their travel; then the one nearest to the
    middle of the plate.

    Args:
        stack: The layers.
        cell: Robot and tool; the part's pose and lift are taken from it to begin with.
        settings: Limits of the tilt; the defaults when absent.

    Returns:
        X, Y, Z [mm] and YAW [deg] for the cell's placement.
    """
    from vega_planner.robot.workcell import place

    settings = settings or PrintabilitySettings()
    points, axes = _samples(stack, cell, settings)
    middle = stack.part.bounds.mean(0)
    best: tuple[tuple[float, float, float], tuple[float, float, float, float]] | None = None
    for turn in TURNS_DEG:
        c, s = np.cos(np.radians(turn)), np.sin(np.radians(turn))
        x0, y0 = -(c * middle[0] - s * middle[1]), -(s * middle[0] + c * middle[1])
        for dx in SHIFTS_MM:
            for dy in SHIFTS_MM:
                pose = (
                    round(float(x0 + dx), 3),
                    round(float(y0 + dy), 3),
                    cell.placement.pose[2],
                    turn,
                )
                moved = place(cell, pose)
                share, margin = _reach(moved, points, axes)
                score = (round(share, 4), round(margin, 3), -float(np.hypot(dx, dy)) - turn * 1e-3)
                if best is None or score > best[0]:
                    best = (score, pose)
    assert best is not None
    return best[1]


def _samples(
    stack: LayerStack, cell: Workcell, settings: PrintabilitySettings
) -> tuple[Floats, Floats]:
    """Poses of the outermost sheets, as the tool would stand there."""
    sheets = stack.sheets[: max(1, len(stack.sheets) // 8)]
    points = np.concatenate([sheet.vertices for sheet in sheets])
    normals = np.concatenate([sheet.vertex_normals for sheet in sheets])
    step = max(1, len(points) // SAMPLES)
    points, normals = points[::step], normals[::step]
    normals = np.where(normals[:, 2:] < -0.7, -normals, normals)
    height = np.maximum(points[:, 2] - cell.placement.plate_z_mm, 0.75 * stack.thickness_mm)
    limit = ToolShape.of(cell.tool).largest_tilt(height, 0.1 * stack.thickness_mm)
    most = np.minimum(np.maximum(limit, 0.0), np.radians(settings.max_tilt_deg))
    return points, tilted(normals, np.minimum(tilt_of(normals), most))


def _reach(cell: Workcell, points: Floats, axes: Floats) -> tuple[float, float]:
    """Share of the poses that is reached, and the least margin to the limits of sliding
    joints over their travel, 0 at a limit and 0.5 in the middle."""
    found = cell.robot.solve(*cell.to_base(points, axes))
    share = float(found.valid.any(1).mean())
    if not found.valid.any():
        return share, 0.0
    slides = ~cell.robot.chain.revolute
    if not slides.any():
        return share, 0.0
    q = found.candidates[found.valid][:, slides]
    lower, upper = cell.robot.lower[slides], cell.robot.upper[slides]
    margin = np.minimum(q - lower, upper - q) / (upper - lower)
    return share, float(margin.min())
