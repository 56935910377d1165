# SPDX-License-Identifier: Apache-2.0
"""The machine that a driver's node works with, from configure to cleanup."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING, Any

import numpy as np

from vega_planner.datatypes import Floats
from vega_planner.errors import LinkTimeout, Refused
from vega_robot_driver.link import MachineLink
from vega_robot_driver.status import MachineStatus

if TYPE_CHECKING:
    from vega_planner.robot.material import Material
    from vega_planner.robot.robot import Robot

#: Time in which moving axes come to rest [s].
_COMING_TO_REST = 5.0


class Connection:
    """Link to the real-time process, and what is known of robot and material.

    Attributes:
        link: The link; None before `open` and after `close`.
        robot: The robot, None before the first `open`.
        material: The material.
    """

    def __init__(self) -> None:
        self.link: MachineLink | None = None
        self.robot: Robot | None = None
        self.material: Material | None = None

    def open(self, link: MachineLink, robot: Robot, material: Material) -> None:
        """Work with a machine."""
        self.link, self.robot, self.material = link, robot, material

    def close(self) -> None:
        """Stop the machine and end its process; safe to call twice."""
        link, self.link = self.link, None
        if link is not None:
            link.close()

    @property
    def there(self) -> tuple[MachineLink, Robot]:
        """Link and robot.

        Raises:
            Refused: If the driver is not configured.
        """
        if self.link is None or self.robot is None:
            raise Refused("the driver is not configured")
        return self.link, self.robot

    def ask(self, op: str, **values: Any) -> dict[str, Any]:
        """Send the machine a request, as `MachineLink.ask`."""
        return self.there[0].ask(op, **values)

    def stop_and_wait(self) -> None:
        """Stop, and wait until the axes are at rest.

        Raises:
            LinkTimeout: If they are not in time.
        """
        link, _ = self.there
        link.ask("stop")
        deadline = time.monotonic() + _COMING_TO_REST
        while link.status().rate > 0.0:
            if time.monotonic() > deadline:
                raise LinkTimeout("the axes do not come to rest")
            time.sleep(0.005)

    def tip(self, status: MachineStatus) -> tuple[Floats, Floats, float]:
        """Find where the tip is [m], the tool's axis, and how far the tip is from its target."""
        robot = self.robot
        if robot is None or len(status.positions) != len(robot.joint_names):
            return np.zeros(3), np.array([0.0, 0.0, 1.0]), 0.0
        tips, axes = robot.forward(np.array([status.positions, status.targets]))
        return tips[0], axes[0], float(np.linalg.norm(tips[0] - tips[1]))
