# SPDX-License-Identifier: Apache-2.0
"""The print cell: robot, tool, material, placement, and the robot's kinematics."""

from vega_planner.robot.material import Material
from vega_planner.robot.placement import Placement
from vega_planner.robot.robot import IKSolutions, Robot, load_robot
from vega_planner.robot.tool import Tool
from vega_planner.robot.workcell import Workcell, load_cell, place

__all__ = [
    "IKSolutions",
    "Material",
    "Placement",
    "Robot",
    "Tool",
    "Workcell",
    "load_cell",
    "load_robot",
    "place",
]
