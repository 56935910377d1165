# SPDX-License-Identifier: Apache-2.0
"""The latched marker arrays of a plan, by topic, as they go over the wire."""

from __future__ import annotations

import numpy as np

from vega_planner.datatypes import (
    Floats,
    LayerStack,
    PrintabilityReport,
    PrintTrajectory,
    ToolpathSet,
)
from vega_planner.nodes.cdr import marker_array
from vega_planner.nodes.markers import layer_markers, toolpath_markers
from vega_planner.robot.workcell import Workcell
from vega_planner.units import m_to_mm
from vega_planner.viewer.tip_speed import tip_speeds

#: Topics of type visualization_msgs/MarkerArray that show a plan.
TOPICS = ("layers", "toolpath", "toolpath_speed")


def plan_markers(
    stack: LayerStack,
    report: PrintabilityReport | None,
    toolpaths: ToolpathSet,
    trajectory: PrintTrajectory,
    cell: Workcell,
) -> dict[str, bytes]:
    """Serialize what RViz shows of a plan.

    Returns:
        A visualization_msgs/MarkerArray in CDR for each of `TOPICS`; the toolpath comes
        twice, coloured by layer and by the speed of the tip.
    """
    speeds = pass_speeds(toolpaths, trajectory, cell)
    return {
        "layers": marker_array(layer_markers(stack, report)),
        "toolpath": marker_array(toolpath_markers(toolpaths)),
        "toolpath_speed": marker_array(toolpath_markers(toolpaths, speeds)),
    }


def pass_speeds(
    toolpaths: ToolpathSet, trajectory: PrintTrajectory, cell: Workcell
) -> list[Floats]:
    """Find the speed of the tip at the points of each pass [mm/s]."""
    if not toolpaths.passes:
        return []
    counts = [len(path.points) for path in toolpaths.passes]
    tips, _ = cell.robot.forward(trajectory.positions)
    speeds = tip_speeds(
        np.concatenate([path.points for path in toolpaths.passes]),
        np.repeat(np.arange(len(counts)), counts),
        m_to_mm(tips),
        trajectory.times,
        trajectory.path_id,
    )
    return np.split(speeds, np.cumsum(counts)[:-1])
