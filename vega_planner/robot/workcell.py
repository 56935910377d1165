# SPDX-License-Identifier: Apache-2.0
"""The cell in which a part is printed: robot, tool, material, placement and substrate."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from vega_planner.datatypes import Floats, Part, TriangleGeometry
from vega_planner.robot.material import Material, load_material
from vega_planner.robot.placement import Placement, parse_pose, place_part
from vega_planner.robot.robot import Robot, load_robot
from vega_planner.robot.tool import Tool, load_tool
from vega_planner.settings import CellSettings
from vega_planner.units import m_to_mm, mm_to_m


@dataclass(frozen=True, eq=False)
class Workcell:
    """Everything around the part.

    Attributes:
        robot: The robot.
        tool: Nozzle and dispenser body.
        material: What is printed.
        placement: Where the part stands.
        substrate: What the part stands on, in the part frame [mm], where it has one.
        warnings: What a person should know.
    """

    robot: Robot
    tool: Tool
    material: Material
    placement: Placement
    substrate: TriangleGeometry | None = None
    warnings: tuple[str, ...] = ()

    def to_base(self, points: Floats, axes: Floats) -> tuple[Floats, Floats]:
        """Bring tip positions and axes from the part frame into the base frame.

        Args:
            points: Positions [mm] in the part frame, shape (n, 3).
            axes: Unit vectors in the part frame, shape (n, 3).

        Returns:
            Positions [m] and unit vectors in the base frame.
        """
        T = self.placement.T_base_part
        return mm_to_m(points) @ T[:3, :3].T + T[:3, 3], axes @ T[:3, :3].T

    def to_part(self, points: Floats, axes: Floats) -> tuple[Floats, Floats]:
        """Bring positions [m] and axes from the base frame into the part frame [mm]."""
        T = self.placement.T_base_part
        return m_to_mm((points - T[:3, 3]) @ T[:3, :3]), axes @ T[:3, :3]

    def reachable(self, points: Floats, axes: Floats) -> np.ndarray:
        """Tell which poses of the part frame (points in mm) the robot reaches, shape (n,)."""
        return self.robot.reachable(*self.to_base(points, axes))

    def reach_reason(self, points: Floats, axes: Floats) -> np.ndarray:
        """Tell why poses of the part frame are not reached; see `Robot.reach_reason`."""
        return self.robot.reach_reason(*self.to_base(points, axes))


def place(
    cell: Workcell,
    pose: tuple[float, float, float, float],
    *,
    lift_mm: float | None = None,
    substrate: TriangleGeometry | None = None,
) -> Workcell:
    """Make the same cell with the part somewhere else.

    Args:
        cell: The cell.
        pose: X, Y, Z [mm] and YAW [deg] of the part's origin on the plate.
        lift_mm: Height by which a substrate lifts the part; as in the cell when absent.
        substrate: The substrate in the part frame; as in the cell when absent.
    """
    if lift_mm is None:
        lift_mm = -cell.placement.plate_z_mm - cell.placement.pose[2]
    placement = place_part(cell.robot.chain.T_base_plate, pose, lift_mm)
    return replace(cell, placement=placement, substrate=substrate or cell.substrate)


def load_cell(
    settings: CellSettings, part: Part | None = None, robot: Robot | None = None
) -> Workcell:
    """Read robot, tool and material and stand the part on the plate.

    Args:
        settings: Names or paths, and the pose. The pose "auto" puts the part's origin in
            the middle of the plate; the search for a better one starts from there.
        part: The part to print.
        robot: What `settings.robot` names, where it is loaded already.

    Raises:
        InvalidInput: If a name or the pose is wrong.
        BadRobot: If a description is wrong.
    """
    pose = parse_pose(settings.pose) or _centred(part)
    robot = robot or load_robot(settings.robot)
    return Workcell(
        robot=robot,
        tool=load_tool(settings.tool),
        material=load_material(settings.material),
        placement=place_part(robot.chain.T_base_plate, pose),
        warnings=robot.chain.assumptions,
    )


def _centred(part: Part | None) -> tuple[float, float, float, float]:
    """Pose that puts the middle of the part's outline over the middle of the plate."""
    if part is None or not len(part.vertices):
        return 0.0, 0.0, 0.0, 0.0
    middle = part.bounds.mean(0)
    return float(-middle[0]), float(-middle[1]), 0.0, 0.0
