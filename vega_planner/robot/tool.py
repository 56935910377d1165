# SPDX-License-Identifier: Apache-2.0
"""The nozzle and the dispenser behind it, as a body of revolution about the nozzle's axis."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from vega_planner.datatypes import Floats, frozen_array
from vega_planner.errors import BadRobot
from vega_planner.robot.yaml_file import number, numbers, read_mapping
from vega_planner.shared_files import named_file


@dataclass(frozen=True, eq=False)
class Tool:
    """A nozzle with its holder.

    Attributes:
        name: Name of the tool.
        distance: Distances behind the tip [mm], rising from 0, shape (k,).
        radius: Radii of the body there [mm], linear between, shape (k,).
        bore_mm: Inner diameter of the nozzle's opening [mm].
    """

    name: str
    distance: Floats
    radius: Floats
    bore_mm: float

    def __post_init__(self) -> None:
        distance = frozen_array("distance", self.distance, np.float64, (None,))
        radius = frozen_array("radius", self.radius, np.float64, (len(distance),))
        if len(distance) < 2 or distance[0] != 0 or (np.diff(distance) < 0).any():
            raise BadRobot(f"tool '{self.name}': distance_mm must rise from 0; has {distance}")
        if radius.min() <= 0:
            raise BadRobot(f"tool '{self.name}': radius_mm {radius.min():g}; must be above 0")
        if self.bore_mm <= 0:
            raise BadRobot(f"tool '{self.name}': bore_mm {self.bore_mm:g}; must be above 0")
        object.__setattr__(self, "distance", distance)
        object.__setattr__(self, "radius", radius)

    @property
    def length_mm(self) -> float:
        """Length of the described body behind the tip [mm]."""
        return float(self.distance[-1])

    def radius_at(self, distance: Floats | float) -> Floats:
        """Radius of the body at distances behind the tip.

        Args:
            distance: Distances from the tip back along the nozzle [mm].

        Returns:
            Radii [mm], 0 before the tip and behind the described body.
        """
        radii = np.interp(distance, self.distance, self.radius, left=0.0, right=0.0)
        return np.asarray(radii)


def load_tool(spec: str) -> Tool:
    """Read a tool by name or path.

    Raises:
        InvalidInput: If there is no such tool.
        BadRobot: If its file is wrong.
    """
    path = named_file("tool", spec, "config", "tools")
    content = read_mapping(path, "tool", ("name", "bore_mm", "profile", "assumed"))
    where = f"tool file {path}"
    profile = content.get("profile")
    if not isinstance(profile, dict):
        raise BadRobot(f"{where}: 'profile' is {profile!r}; expected distance_mm and radius_mm")
    distance = numbers(profile, "distance_mm", where)
    return Tool(
        name=str(content.get("name", path.stem)),
        distance=np.array(distance),
        radius=np.array(numbers(profile, "radius_mm", where, len(distance))),
        bore_mm=number(content, "bore_mm", where),
    )
