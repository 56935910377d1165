# SPDX-License-Identifier: Apache-2.0
"""What the driver shows: topics `joint_states`, `print_status`, `diagnostics`, printed beads."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from diagnostic_msgs.msg import DiagnosticArray
from rclpy.callback_groups import MutuallyExclusiveCallbackGroup
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import JointState
from std_msgs.msg import String

from vega_msgs.msg import PrintStatus
from vega_planner.datatypes import Floats
from vega_planner.errors import VegaError
from vega_robot_driver.checkpoint import Checkpoint, read_checkpoint
from vega_robot_driver.job import PrintJob
from vega_robot_driver.nodes.connection import Connection
from vega_robot_driver.nodes.conversions import (
    diagnostics_to_msg,
    joint_state_to_msg,
    print_status_to_msg,
)
from vega_robot_driver.nodes.printed import PrintedBeads
from vega_robot_driver.nodes.tip_trail import TipTrail
from vega_robot_driver.status import MachineStatus, StatusPage

if TYPE_CHECKING:
    from rclpy.lifecycle import LifecycleNode

LATCHED = QoSProfile(
    depth=1, reliability=ReliabilityPolicy.RELIABLE, durability=DurabilityPolicy.TRANSIENT_LOCAL
)


class Topics:
    """Publishes what the machine does, whether it prints or not.

    Args:
        node: Node that publishes; its parameters name the rates.
        connection: The machine.
        folder: State folder, which tells of the last machine where there is none.
    """

    def __init__(self, node: LifecycleNode, connection: Connection, folder: Path) -> None:
        self._node, self._connection, self._folder = node, connection, folder
        self._axes: list[tuple[str, str, int]] = []
        self._quality: dict[str, str] = {}
        self._was = self._recalled()
        self._joints = node.create_publisher(JointState, "joint_states", 10)
        self._diagnostics = node.create_publisher(DiagnosticArray, "diagnostics", 10)
        self._status = node.create_publisher(PrintStatus, "print_status", 10)
        self._description = node.create_publisher(String, "robot_description", LATCHED)
        self._beads = PrintedBeads(node)
        self._trail = TipTrail(node)
        shown = MutuallyExclusiveCallbackGroup()
        for rate, show in (
            ("joint_state_rate", self._show_joints),
            ("feedback_rate", self._show_status),
        ):
            node.create_timer(1.0 / node.get_parameter(rate).value, show, shown)
        node.create_timer(1.0, self._show_diagnostics, MutuallyExclusiveCallbackGroup())

    def begin(self, job: PrintJob, tips: Floats) -> None:
        """Show a new print.

        Args:
            job: Its job.
            tips: Tip positions of its samples [m], shape (n, 3).
        """
        self._beads.start(job, tips)
        self._trail.clear()

    def describe(self, urdf: str) -> None:
        """Publish the robot's description."""
        self._description.publish(String(data=urdf))

    def print_status(self, status: MachineStatus) -> PrintStatus:
        """Where a print stands, as a message."""
        stamp = self._node.get_clock().now().to_msg()
        return print_status_to_msg(status, *self._connection.tip(status), stamp)

    def _recalled(self) -> Checkpoint | None:
        """Look at what the last driver left."""
        logger = self._node.get_logger()
        try:
            was = read_checkpoint(self._folder / "checkpoint.json")
        except VegaError as error:
            logger.error(str(error))
            return None
        if was is not None and was.unfinished:
            logger.warning(
                f"print {was.job[:12]} was interrupted at {was.done:.3f} s after "
                f"{was.paths_done} passes ({was.reason or was.state}); the dispenser is off"
            )
        return was

    def _show_joints(self) -> None:
        link, robot = self._connection.link, self._connection.robot
        if link is not None and robot is not None:
            stamp, status = self._node.get_clock().now().to_msg(), link.status()
            self._joints.publish(joint_state_to_msg(status, robot.joint_names, stamp))
            tip, axis, _ = self._connection.tip(status)
            self._trail.add(tip, axis, dispensing=status.dispenser_on)

    def _show_status(self) -> None:
        link = self._connection.link
        if link is not None:
            status = link.status()
            self._status.publish(self.print_status(status))
            self._beads.show(status)

    def _show_diagnostics(self) -> None:
        link, node = self._connection.link, self._node
        status: MachineStatus | None = None
        try:
            if link is not None:
                told = link.ask("axes")
                self._axes = [(str(n), str(s), int(c)) for n, s, c in told["axes"]]
                self._quality = {str(k): str(v) for k, v in told["quality"].items()}
                status = link.status()
            elif (self._folder / "status").is_file():
                status = StatusPage(self._folder).read()
            self._was = read_checkpoint(self._folder / "checkpoint.json")
        except VegaError as error:
            node.get_logger().warning(str(error), throttle_duration_sec=10.0)
        hardware = node.get_parameter("hardware").value
        message = DiagnosticArray()
        message.header.stamp = node.get_clock().now().to_msg()
        message.status = diagnostics_to_msg(status, self._axes, hardware, self._was, self._quality)
        self._diagnostics.publish(message)
