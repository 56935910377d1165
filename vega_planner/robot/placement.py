# SPDX-License-Identifier: Apache-2.0
"""Where the part stands on the plate and in the robot's base frame."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from vega_planner.datatypes import Floats, frozen_array
from vega_planner.errors import InvalidInput
from vega_planner.units import mm_to_m


@dataclass(frozen=True, eq=False)
class Placement:
    """Pose of the part.

    Attributes:
        T_base_part: Pose of the part frame in the base frame, metres, shape (4, 4).
        plate_z_mm: Height of the plate's top in the part frame; 0 where the part stands on
            it, negative where a substrate lifts the part.
        pose: X, Y, Z [mm] and YAW [deg] of the part on the plate, as T_base_part has them.
    """

    T_base_part: Floats
    plate_z_mm: float = 0.0
    pose: tuple[float, float, float, float] = (0.0, 0.0, 0.0, 0.0)

    def __post_init__(self) -> None:
        matrix = frozen_array("T_base_part", self.T_base_part, np.float64, (4, 4))
        object.__setattr__(self, "T_base_part", matrix)


def parse_pose(text: str) -> tuple[float, float, float, float] | None:
    """Read the setting X,Y,Z[mm],YAW[deg].

    Returns:
        The four numbers, or None for "auto".

    Raises:
        InvalidInput: If it is neither.
    """
    if text.strip() == "auto":
        return None
    try:
        x, y, z, yaw = (float(word) for word in text.split(","))
    except ValueError as error:
        raise InvalidInput(
            f"pose is '{text}'; expected X,Y,Z [mm] and YAW [deg], e.g. 10,0,0,90, or auto"
        ) from error
    if not all(math.isfinite(value) for value in (x, y, z, yaw)):
        raise InvalidInput(f"pose is '{text}'; all four numbers must be finite")
    return x, y, z, yaw


def place_part(
    T_base_plate: Floats, pose: tuple[float, float, float, float], lift_mm: float = 0.0
) -> Placement:
    """Stand the part on the plate.

    Args:
        T_base_plate: Pose of the plate's top in the base frame, metres, shape (4, 4).
        pose: X, Y, Z [mm] and YAW [deg] of the part's origin on the plate.
        lift_mm: Height by which a substrate lifts the part further.
    """
    x, y, z, yaw = pose
    c, s = math.cos(math.radians(yaw)), math.sin(math.radians(yaw))
    T_plate_part = np.eye(4)
    T_plate_part[:2, :2] = [[c, -s], [s, c]]
    T_plate_part[:3, 3] = mm_to_m(np.array([x, y, z + lift_mm]))
    return Placement(
        T_base_part=np.asarray(T_base_plate) @ T_plate_part,
        plate_z_mm=-(z + lift_mm) if z + lift_mm != 0 else 0.0,
        pose=pose,
    )
