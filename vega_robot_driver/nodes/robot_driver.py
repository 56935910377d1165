# SPDX-License-Identifier: Apache-2.0
"""Node `robot_driver`, a lifecycle node: action `execute_print`.

Configure brings the real-time process and its link up, activate powers the axes,
deactivate stops and takes the power, cleanup ends the process. The node only asks and
shows: when it dies, the process stops the machine by itself.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import rclpy
from rcl_interfaces.msg import ParameterDescriptor
from rclpy.action import ActionServer, CancelResponse, GoalResponse
from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.executors import ExternalShutdownException, MultiThreadedExecutor
from rclpy.lifecycle import LifecycleNode, LifecycleState, TransitionCallbackReturn
from std_srvs.srv import Trigger

from vega_msgs.action import ExecutePrint
from vega_msgs.srv import Jog
from vega_planner.errors import Busy, InvalidInput, VegaError
from vega_robot_driver.link import MachineLink
from vega_robot_driver.machine import Machine
from vega_robot_driver.nodes import follow_joint_trajectory
from vega_robot_driver.nodes.connection import Connection
from vega_robot_driver.nodes.printing import Printing
from vega_robot_driver.nodes.topics import Topics

if TYPE_CHECKING:
    from vega_planner.robot.robot import Robot

#: Parameters with their defaults and meaning.
PARAMETERS: dict[str, tuple[Any, str]] = {
    "hardware": ("simulated", "simulated, emulated (drives and dispenser on a wire) or ethercat."),
    "robot": ("vega5", "Name of a robot in config/robots, or path of a URDF or xacro file."),
    "material": ("se1700", "Name of a material: the dispenser's pressure."),
    "machine": ("", "YAML file of the bus: drives, their identity, units and mapping."),
    "interface": ("", "Network interface of the bus; over the one in the machine file."),
    "state_folder": ("", "Where checkpoint and status are kept; default below ~/.ros/vega."),
    "realtime": (False, "Run a simulation at the pace of the clock."),
    "time_scale": (500.0, "How much faster than the clock a simulation runs, if not realtime."),
    "cycle_time": (0.002, "Cycle time of the axes [s]."),
    "ramp_time": (0.1, "Time from full speed along the path to standstill [s]."),
    "stale_time": (0.1, "Silence of this node after which the machine stops [s]."),
    "orphan_time": (30.0, "Time a machine without a driver holds its axes [s]; 0 for ever."),
    "overlap_time": (0.5, "Time along the path by which a resumed print joins it earlier [s]."),
    "joint_state_rate": (50.0, "Rate of joint_states [Hz]."),
    "feedback_rate": (10.0, "Rate of feedback and status [Hz]."),
}


class RobotDriver(LifecycleNode):
    """Prints jobs on one machine."""

    def __init__(self) -> None:
        super().__init__("robot_driver")
        for name, (default, doc) in PARAMETERS.items():
            self.declare_parameter(name, default, ParameterDescriptor(description=doc))
        self._connection = Connection()
        self._topics = Topics(self, self._connection, self.state_folder)
        self._printing = Printing(self, self._connection, self._topics)
        self._group = ReentrantCallbackGroup()
        for name in ("pause", "resume", "stop", "home", "calibrate", "reset_fault"):
            self._serve(name)
        self.create_service(Jog, "~/jog", self._jog, callback_group=self._group)
        self._server = ActionServer(
            self,
            ExecutePrint,
            "execute_print",
            self._printing.execute,
            callback_group=self._group,
            goal_callback=lambda _: GoalResponse.ACCEPT,
            cancel_callback=lambda _: CancelResponse.ACCEPT,
        )
        self._follow_server = follow_joint_trajectory.offer(
            self,
            self._group,
            lambda: self._connection.there[1].joint_names,
            self._printing.follow,
        )

    def _value(self, name: str) -> Any:
        return self.get_parameter(name).value

    @property
    def state_folder(self) -> Path:
        """Where the machine keeps what survives it."""
        given = self._value("state_folder")
        if given:
            return Path(given).expanduser()
        home = Path(os.environ.get("ROS_HOME", "~/.ros")).expanduser()
        domain = os.environ.get("ROS_DOMAIN_ID", "0")
        return home / "vega" / f"{self.get_fully_qualified_name().strip('/')}_{domain}"

    # -- lifecycle ----------------------------------------------------------------------

    def on_configure(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Read the robot and bring the real-time process up."""
        return self._transition(self._configure)

    def on_activate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Power the axes."""
        super().on_activate(state)
        return self._transition(lambda: self._connection.ask("enable"))

    def on_deactivate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Stop and take the power from the axes."""
        super().on_deactivate(state)
        return self._transition(self._power_off)

    def on_cleanup(self, state: LifecycleState) -> TransitionCallbackReturn:
        """End the real-time process."""
        return self._transition(self.close)

    def on_shutdown(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Stop, take the power away and end the real-time process."""
        return self._transition(self.close)

    def on_error(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Leave the machine safe."""
        self.close()
        return TransitionCallbackReturn.SUCCESS

    def _transition(self, work: Callable[[], Any]) -> TransitionCallbackReturn:
        try:
            work()
        except VegaError as error:
            self.get_logger().error(str(error))
            return TransitionCallbackReturn.FAILURE
        return TransitionCallbackReturn.SUCCESS

    def _configure(self) -> None:
        from vega_planner.robot.material import load_material
        from vega_planner.robot.robot import load_robot

        robot = load_robot(self._value("robot"))
        material = load_material(self._value("material"))
        machine = self._machine(robot, material.pressure_kpa * 1e3)
        link = MachineLink(self.state_folder, machine)
        self._connection.open(link, robot, material)
        self._topics.describe(robot.urdf)
        status = link.status()
        if link.joined:
            self.get_logger().warning(
                f"joined a machine that was left {status.state}: {status.detail}; "
                f"its dispenser is {'on' if status.dispenser_on else 'off'}"
            )

    def _machine(self, robot: Robot, pressure_pa: float) -> Machine:
        return Machine(
            hardware=self._value("hardware"),
            joint_names=robot.joint_names,
            lower=tuple(robot.lower.tolist()),
            upper=tuple(robot.upper.tolist()),
            velocity=tuple(robot.velocity.tolist()),
            acceleration=tuple(robot.acceleration.tolist()),
            start=tuple(np.clip(0.0, robot.lower, robot.upper).tolist()),
            dt=self._value("cycle_time"),
            time_scale=1.0 if self._value("realtime") else self._value("time_scale"),
            ramp_s=self._value("ramp_time"),
            stale_s=self._value("stale_time"),
            orphan_s=self._value("orphan_time"),
            pressure_pa=pressure_pa,
            config=self._value("machine"),
            interface=self._value("interface"),
        )

    def _power_off(self) -> None:
        if self._connection.link is not None:
            self._connection.stop_and_wait()
            self._connection.ask("disable")

    def close(self) -> None:
        """Stop and end the real-time process."""
        self._connection.close()

    # -- requests -----------------------------------------------------------------------

    def _serve(self, name: str) -> None:
        def answer(_: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
            try:
                self._connection.ask(name)
                response.success, response.message = True, "done"
            except VegaError as error:
                response.success, response.message = False, str(error)
            return response

        public = name if name in ("pause", "resume", "stop") else f"~/{name}"
        self.create_service(Trigger, public, answer, callback_group=self._group)

    def _jog(self, request: Jog.Request, response: Jog.Response) -> Jog.Response:
        try:
            self._jog_joint(request.joint, request.distance, request.speed)
            response.success, response.message = True, "moving"
        except VegaError as error:
            response.success, response.message = False, str(error)
        return response

    def _jog_joint(self, joint: str, distance: float, speed: float) -> None:
        link, robot = self._connection.there
        names = robot.joint_names
        if joint not in names:
            raise InvalidInput(f"joint '{joint}' not in the robot; has: {', '.join(names)}")
        if self._printing.busy:
            raise Busy("a print runs")
        index = names.index(joint)
        goal = link.status().positions.copy()
        goal[index] += distance
        low, high = robot.lower[index], robot.upper[index]
        if not low <= goal[index] <= high:
            raise InvalidInput(f"{joint} would be at {goal[index]:g}; limits {low:g} .. {high:g}")
        # A move's own top speed is a fifth of the joint's limit; the ratio slows it down.
        top = 0.2 * robot.velocity[index]
        ratio = min((speed or 0.5 * top) / top, 1.0)
        link.ask("move", positions=goal.tolist(), speed_ratio=ratio)


def main() -> int:
    """Run the node until it is interrupted; the machine is then stopped and ended."""
    rclpy.init()
    node = RobotDriver()
    executor = MultiThreadedExecutor(num_threads=6)
    executor.add_node(node)
    try:
        executor.spin()
    except (KeyboardInterrupt, ExternalShutdownException):
        pass
    finally:
        node.close()
        rclpy.try_shutdown()
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
