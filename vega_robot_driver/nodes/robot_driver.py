# SPDX-License-Identifier: Apache-2.0
"""Node `robot_driver`, a lifecycle node: action `execute_print`.

Configure brings the real-time process and its link up, activate powers the axes,
deactivate stops and takes the power, cleanup ends the process. The node only asks and
shows: when it dies, the process stops the machine by itself.
"""

from __future__ import annotations

import contextlib
import os
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from rcl_interfaces.msg import ParameterDescriptor
from rclpy.action import ActionServer, CancelResponse, GoalResponse
from rclpy.action.server import ServerGoalHandle
from rclpy.callback_groups import MutuallyExclusiveCallbackGroup, ReentrantCallbackGroup
from rclpy.executors import ExternalShutdownException, MultiThreadedExecutor
from rclpy.lifecycle import LifecycleNode, LifecycleState, TransitionCallbackReturn
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import JointState
from std_msgs.msg import String
from std_srvs.srv import Trigger

from vega_msgs.action import ExecutePrint
from vega_msgs.msg import PrintStatus
from vega_msgs.srv import Jog
from vega_planner.datatypes import Floats
from vega_planner.errors import (
    Busy,
    Cancelled,
    DriverError,
    Faulted,
    InvalidInput,
    LinkTimeout,
    Refused,
    VegaError,
)
from vega_robot_driver.checkpoint import Checkpoint, read_checkpoint
from vega_robot_driver.job import PrintJob
from vega_robot_driver.link import MachineLink
from vega_robot_driver.machine import Machine
from vega_robot_driver.nodes import follow_joint_trajectory
from vega_robot_driver.nodes.conversions import (
    diagnostics_to_msg,
    error_to_msg,
    feedback_to_msg,
    job_from_msg,
    joint_state_to_msg,
    print_status_to_msg,
)
from vega_robot_driver.nodes.printed import PrintedBeads
from vega_robot_driver.nodes.tip_trail import TipTrail
from vega_robot_driver.resume import approach
from vega_robot_driver.status import MachineStatus, StatusPage

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
LATCHED = QoSProfile(
    depth=1, reliability=ReliabilityPolicy.RELIABLE, durability=DurabilityPolicy.TRANSIENT_LOCAL
)


class RobotDriver(LifecycleNode):
    """Prints jobs on one machine."""

    def __init__(self) -> None:
        super().__init__("robot_driver")
        for name, (default, doc) in PARAMETERS.items():
            self.declare_parameter(name, default, ParameterDescriptor(description=doc))
        self._link: MachineLink | None = None
        self._robot: Robot | None = None
        self._material: Any = None
        self._executing = threading.Lock()
        self._axes: list[tuple[str, str, int]] = []
        self._was: Checkpoint | None = None
        self._recall()
        self._group = ReentrantCallbackGroup()
        self._joints = self.create_publisher(JointState, "joint_states", 10)
        self._diagnostics = self.create_publisher(DiagnosticArray, "diagnostics", 10)
        self._status = self.create_publisher(PrintStatus, "print_status", 10)
        self._description = self.create_publisher(String, "robot_description", LATCHED)
        self._beads = PrintedBeads(self)
        self._trail = TipTrail(self)
        shown = MutuallyExclusiveCallbackGroup()
        self.create_timer(1.0 / self._value("joint_state_rate"), self._show_joints, shown)
        self.create_timer(1.0 / self._value("feedback_rate"), self._show_status, shown)
        self.create_timer(1.0, self._show_diagnostics, MutuallyExclusiveCallbackGroup())
        for name in ("pause", "resume", "stop", "home", "calibrate", "reset_fault"):
            self._serve(name)
        self.create_service(Jog, "~/jog", self._jog, callback_group=self._group)
        self._server = ActionServer(
            self,
            ExecutePrint,
            "execute_print",
            self._execute,
            callback_group=self._group,
            goal_callback=lambda _: GoalResponse.ACCEPT,
            cancel_callback=lambda _: CancelResponse.ACCEPT,
        )

        self._follow_server = follow_joint_trajectory.offer(
            self,
            self._group,
            lambda: self._robot.joint_names if self._robot is not None else (),
            self._follow_trajectory,
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

    def _recall(self) -> None:
        """Look at what the last driver left."""
        try:
            self._was = read_checkpoint(self.state_folder / "checkpoint.json")
        except VegaError as error:
            self.get_logger().error(str(error))
        if self._was is not None and self._was.unfinished:
            self.get_logger().warning(
                f"print {self._was.job[:12]} was interrupted at {self._was.done:.3f} s after "
                f"{self._was.paths_done} passes ({self._was.reason or self._was.state}); "
                "the dispenser is off"
            )

    # -- lifecycle ----------------------------------------------------------------------

    def on_configure(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Read the robot and bring the real-time process up."""
        return self._transition(self._configure)

    def on_activate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Power the axes."""
        super().on_activate(state)
        return self._transition(lambda: self._ask("enable"))

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

        self._robot = load_robot(self._value("robot"))
        self._material = load_material(self._value("material"))
        self._link = MachineLink(self.state_folder, self._machine(self._robot))
        self._description.publish(String(data=self._robot.urdf))
        self._look_at_axes()
        status = self._link.status()
        if self._link.joined:
            self.get_logger().warning(
                f"joined a machine that was left {status.state}: {status.detail}; "
                f"its dispenser is {'on' if status.dispenser_on else 'off'}"
            )

    def _machine(self, robot: Robot) -> Machine:
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
            pressure_pa=self._material.pressure_kpa * 1e3,
            config=self._value("machine"),
            interface=self._value("interface"),
        )

    def _power_off(self) -> None:
        if self._link is None:
            return
        self._stop_and_wait()
        self._ask("disable")

    def close(self) -> None:
        """Stop and end the real-time process."""
        link, self._link = self._link, None
        if link is not None:
            link.close()

    # -- requests -----------------------------------------------------------------------

    def _ask(self, op: str, **values: Any) -> dict[str, Any]:
        link = self._link
        if link is None:
            raise Refused("the driver is not configured")
        return link.ask(op, **values)

    def _serve(self, name: str) -> None:
        def answer(_: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
            try:
                self._ask(name)
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
        if self._link is None or self._robot is None:
            raise Refused("the driver is not configured")
        names = self._robot.joint_names
        if joint not in names:
            raise InvalidInput(f"joint '{joint}' not in the robot; has: {', '.join(names)}")
        if self._executing.locked():
            raise Busy("a print runs")
        index = names.index(joint)
        goal = self._link.status().positions.copy()
        goal[index] += distance
        low, high = self._robot.lower[index], self._robot.upper[index]
        if not low <= goal[index] <= high:
            raise InvalidInput(f"{joint} would be at {goal[index]:g}; limits {low:g} .. {high:g}")
        # A move's own top speed is a fifth of the joint's limit; the ratio slows it down.
        top = 0.2 * self._robot.velocity[index]
        ratio = min((speed or 0.5 * top) / top, 1.0)
        self._ask("move", positions=goal.tolist(), speed_ratio=ratio)

    # -- printing -----------------------------------------------------------------------

    def _execute(self, goal: ServerGoalHandle) -> ExecutePrint.Result:
        if not self._executing.acquire(blocking=False):
            goal.abort()
            return error_to_msg(Busy("another job is being printed; wait for its end or stop it"))
        result = ExecutePrint.Result()
        try:
            self._print(goal, result)
            goal.succeed()
        except Cancelled as error:
            error_to_msg(error, result)
            goal.canceled() if goal.is_cancel_requested else goal.abort()
        except VegaError as error:
            self.get_logger().error(str(error))
            error_to_msg(error, result)
            goal.abort()
        except Exception as error:  # a bug must stop the machine and not look like success
            self.get_logger().error(f"unexpected {type(error).__name__}: {error}")
            self._stop_on_bug()
            error_to_msg(VegaError(f"unexpected {type(error).__name__}: {error}"), result)
            goal.abort()
        finally:
            self._executing.release()
        return result

    def _stop_on_bug(self) -> None:
        with contextlib.suppress(VegaError):
            self._ask("stop")

    def _print(self, goal: ServerGoalHandle, result: ExecutePrint.Result) -> None:
        if self._link is None or self._link.status().state == "off":
            raise Refused("the driver is not active (ros2 lifecycle set /robot_driver activate)")
        job = job_from_msg(goal.request)
        began = self._load(job, resume=goal.request.resume)
        self._ask("run", override=goal.request.speed_ratio)
        errors = self._watch(goal, result, began)
        if errors:
            result.mean_tracking_error = float(np.mean(errors))
            result.max_tracking_error = float(np.max(errors))

    def _load(self, job: PrintJob, *, resume: bool) -> float:
        """Send a job to the machine; returns the machine's clock at its start."""
        assert self._link is not None and self._robot is not None
        link, robot = self._link, self._robot
        start = 0.0
        status = link.status()
        if resume:
            checkpoint = read_checkpoint(link.folder / "checkpoint.json")
            if checkpoint is None:
                raise Refused("no interrupted print to resume")
            if status.state == "done":  # its checkpoint may still be on its way to the disk
                raise Refused("no interrupted print to resume; the last one is done")
            checkpoint.check_resumable(job.digest(), status.homing_epoch)
            start = checkpoint.done
        if job.joint_names != robot.joint_names:
            raise InvalidInput(
                f"the job moves {', '.join(job.joint_names)}; "
                f"the robot has {', '.join(robot.joint_names)}"
            )
        tips, _ = robot.forward(job.positions)
        overlap = self._value("overlap_time") if resume else 0.0
        entry = int(np.searchsorted(job.times, max(start - overlap, 0.0)))
        way = approach(robot, status.positions, job.positions[entry], float(tips[:, 2].max()))
        self._hand_over(job, way, start_u=start, overlap_s=overlap)
        self._beads.start(job, tips)
        self._trail.clear()
        return link.status().clock

    def _hand_over(self, job: PrintJob, way: Floats, **options: float) -> None:
        """Give a job to the machine, with the way to it."""
        assert self._link is not None
        arrays = {name: getattr(job, name) for name in job.__dataclass_fields__}
        np.savez(self._link.folder / "job.npz", waypoints=way, **arrays)
        lead, lag = self._material.lead_s, self._material.lag_s
        self._link.ask("load", job="job.npz", lead_s=lead, lag_s=lag, **options)

    def _follow_trajectory(
        self,
        job: PrintJob,
        show: Callable[[MachineStatus], None],
        cancelled: Callable[[], bool],
    ) -> None:
        """Move along a trajectory that begins where the axes are, without deposition."""
        if self._link is None:
            raise Refused("the driver is not configured")
        if not self._executing.acquire(blocking=False):
            raise Busy("another job is being executed; wait for its end or stop it")
        try:
            link = self._link
            follow_joint_trajectory.check_start(job, link.status().positions)
            self._hand_over(job, np.zeros((0, len(job.joint_names))))
            self._ask("run")
            told = False
            while (status := link.status()).state != "done":
                show(status)
                if status.state not in ("printing", "pausing", "paused", "stopping"):
                    failed = Cancelled if status.state == "stopped" else Faulted
                    raise failed(f"{status.state}: {status.detail}")
                if not told and cancelled():
                    told = True
                    self._ask("stop")
                time.sleep(0.02)
        finally:
            self._executing.release()

    def _watch(
        self, goal: ServerGoalHandle, result: ExecutePrint.Result, began: float
    ) -> list[float]:
        """Follow a print to its end; cancel and faults end it early."""
        assert self._link is not None
        link, period = self._link, 1.0 / self._value("feedback_rate")
        errors: list[float] = []
        told, next_feedback = False, 0.0
        while True:
            status = link.status()
            self._note(status, result, began)
            now = time.monotonic()
            if now >= next_feedback:
                next_feedback = now + period
                shown = self._shown(status)
                if status.path >= 0 and status.rate > 0:
                    errors.append(shown.tracking_error)
                if goal.is_active:
                    goal.publish_feedback(feedback_to_msg(shown))
            if status.state == "done":
                return errors
            if status.state == "stopped":
                raise Cancelled(f"the print {status.detail or 'was stopped'}")
            if status.state == "fault":
                raise Faulted(status.detail)
            if status.state in ("off", "idle"):
                raise DriverError(f"the machine is {status.state} in mid-print")
            if not link.alive():
                raise LinkTimeout("the real-time process is gone")
            if not told and (goal.is_cancel_requested or not rclpy.ok()):
                told = True
                link.ask("stop")
            time.sleep(0.005)

    def _note(self, status: MachineStatus, result: ExecutePrint.Result, began: float) -> None:
        result.progress = status.progress
        result.path_time = max(status.u, 0.0)
        result.paths_done = status.paths_done
        result.duration = status.clock - began

    def _stop_and_wait(self) -> None:
        assert self._link is not None
        self._ask("stop")
        deadline = time.monotonic() + 5.0
        while self._link.status().rate > 0.0:
            if time.monotonic() > deadline:
                raise LinkTimeout("the axes do not come to rest")
            time.sleep(0.005)

    # -- what is shown ------------------------------------------------------------------

    def _shown(self, status: MachineStatus) -> PrintStatus:
        tip, axis, error = self._tip(status)
        return print_status_to_msg(status, tip, axis, error, self.get_clock().now().to_msg())

    def _tip(self, status: MachineStatus) -> tuple[Floats, Floats, float]:
        if self._robot is None or len(status.positions) != len(self._robot.joint_names):
            return np.zeros(3), np.array([0.0, 0.0, 1.0]), 0.0
        tips, axes = self._robot.forward(np.array([status.positions, status.targets]))
        return tips[0], axes[0], float(np.linalg.norm(tips[0] - tips[1]))

    def _show_joints(self) -> None:
        link, robot = self._link, self._robot
        if link is not None and robot is not None:
            stamp, status = self.get_clock().now().to_msg(), link.status()
            self._joints.publish(joint_state_to_msg(status, robot.joint_names, stamp))
            tip, axis, _ = self._tip(status)
            self._trail.add(tip, axis, dispensing=status.dispenser_on)

    def _show_status(self) -> None:
        link = self._link
        if link is not None:
            status = link.status()
            self._status.publish(self._shown(status))
            self._beads.show(status)

    def _look_at_axes(self) -> None:
        self._axes = [(str(n), str(s), int(c)) for n, s, c in self._ask("axes")["axes"]]

    def _show_diagnostics(self) -> None:
        link = self._link
        status: MachineStatus | None = None
        try:
            if link is not None:
                self._look_at_axes()
                status = link.status()
            elif (self.state_folder / "status").is_file():
                status = StatusPage(self.state_folder).read()
            self._was = read_checkpoint(self.state_folder / "checkpoint.json")
        except VegaError as error:
            self.get_logger().warning(str(error), throttle_duration_sec=10.0)
        message = DiagnosticArray()
        message.header.stamp = self.get_clock().now().to_msg()
        message.status = diagnostics_to_msg(status, self._axes, self._value("hardware"), self._was)
        self._diagnostics.publish(message)


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
