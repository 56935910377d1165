# SPDX-License-Identifier: Apache-2.0
"""The viewer's buttons on the ROS 2 actions: starts the nodes it needs on first use."""

from __future__ import annotations

import json
import os
import threading
from contextlib import ExitStack
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import rclpy
import yaml
from rclpy.signals import SignalHandlerOptions
from sensor_msgs.msg import JointState
from std_srvs.srv import Trigger

from vega_msgs.action import ExecutePrint, PlanLayers
from vega_msgs.msg import PrintStatus
from vega_planner.errors import Cancelled, DriverError, InvalidInput, LinkTimeout, VegaError
from vega_planner.nodes.node_processes import run_nodes
from vega_planner.nodes.session import ANSWER, Session
from vega_planner.progress import Progress, Report
from vega_planner.settings import Settings, as_dict
from vega_planner.viewer.job import RUNNING, JobState, MachineChoice

_PLANNER = "vega_planner.nodes.planner"
_DRIVER = "vega_robot_driver.nodes.robot_driver"


class RosJob:
    """Plans and prints through the nodes `planner` and `robot_driver`, each its own process."""

    def __init__(self) -> None:
        """Start nothing yet."""
        os.environ.setdefault("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
        self._namespace = f"/vega_view_{os.getpid()}"
        self._lock = threading.RLock()
        self._stack = ExitStack()
        self._scratch: Path | None = None
        self._joined_ros = False
        self._planner: _PlanningNode | None = None
        self._driver: _DrivingNode | None = None

    def plan(self, mesh: Path, settings: Settings, folder: Path, report: Report) -> Path:
        """Plan a mesh into a result folder through action `plan_layers`.

        A stop that comes when the result is written comes too late: the plan is kept.

        Raises:
            VegaError: What the planner raised; `Cancelled` if `report` did.
        """
        with self._lock:
            if self._planner is None:
                self._planner = _PlanningNode(self._namespace, self._start())
            planner = self._planner
        report(Progress("starting the planner", 0.0))
        return planner.plan(mesh, settings, folder, report)

    def print(self, folder: Path, machine: MachineChoice) -> None:
        """Start printing a result folder through action `execute_print`.

        Raises:
            VegaError: If the driver does not come up, or refuses the job.
        """
        with self._lock:
            driver = self._driver
            summary = _summary(folder)
            wanted = (machine, summary.get("robot", "vega5"), summary.get("material", "se1700"))
            if driver is not None and driver.wanted != wanted:
                driver.close()
                driver = None
            if driver is None:
                driver = _DrivingNode(self._namespace, self._start(), wanted)
            self._driver = driver
        driver.print(folder)

    def pause(self) -> None:
        """Ask the driver to stop on the path."""
        self._running_driver().trigger("pause")

    def resume(self) -> None:
        """Ask the driver to go on."""
        self._running_driver().trigger("resume")

    def stop(self) -> None:
        """Ask the driver to end the print."""
        self._running_driver().trigger("stop")

    def progress(self) -> JobState:
        """Tell what the driver last said."""
        driver = self._driver
        return JobState() if driver is None else driver.state()

    def close(self) -> None:
        """Stop what runs and end the nodes."""
        with self._lock:
            for node in (self._driver, self._planner):
                if node is not None:
                    node.close()
            self._driver = self._planner = None
            self._stack.close()
            if self._joined_ros:
                rclpy.try_shutdown()

    def _running_driver(self) -> _DrivingNode:
        if self._driver is None:
            raise DriverError("nothing is printing")
        return self._driver

    def _start(self) -> Path:
        """Join ROS, once; returns the folder of the nodes' logs and state."""
        if self._scratch is None:
            if not rclpy.ok():
                rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
                self._joined_ros = True
            folder = self._stack.enter_context(TemporaryDirectory(prefix="vega_view_"))
            self._scratch = Path(folder)
        return self._scratch


class _PlanningNode:
    """The process of the planner and a client of it."""

    def __init__(self, namespace: str, scratch: Path) -> None:
        self._stack = ExitStack()
        self._nodes = self._stack.enter_context(run_nodes(namespace, scratch, {_PLANNER: {}}))
        self._stopped = threading.Event()
        self._session = Session(namespace, "view_plan", self._alive)

    def close(self) -> None:
        self._session.close()
        self._stack.close()

    def plan(self, mesh: Path, settings: Settings, folder: Path, report: Report) -> Path:
        self._stopped.clear()
        goal = PlanLayers.Goal(
            mesh=str(mesh), settings=yaml.safe_dump(as_dict(settings)), output_folder=str(folder)
        )

        def tell(progress: Progress) -> None:
            # Raised here, it would end the thread that listens to ROS.
            try:
                report(progress)
            except Cancelled:
                self._stopped.set()

        try:
            return Path(self._session.plan(goal, tell).folder)
        except Cancelled:
            self._stopped.clear()
            self._session.cancel()
            raise

    def _alive(self) -> None:
        self._nodes.check()
        if self._stopped.is_set():
            raise Cancelled("stopped; nothing was written")


class _DrivingNode:
    """The process of the driver and a client of it."""

    def __init__(
        self, namespace: str, scratch: Path, wanted: tuple[MachineChoice, str, str]
    ) -> None:
        machine, robot, material = self.wanted = wanted
        parameters = {
            "hardware": machine.hardware,
            "robot": robot,
            "material": material,
            "realtime": machine.pace == 1.0,
            "time_scale": machine.pace,
            "state_folder": str(scratch / "machine"),
        }
        self._stack = ExitStack()
        self._nodes = self._stack.enter_context(
            run_nodes(namespace, scratch, {_DRIVER: parameters})
        )
        self._session = Session(namespace, "view_print", self._nodes.check)
        node = self._session.node
        self._triggers = {
            name: node.create_client(Trigger, name) for name in ("pause", "resume", "stop")
        }
        node.create_subscription(PrintStatus, "print_status", self._heard, 10)
        node.create_subscription(JointState, "joint_states", self._moved, 10)
        self._status: PrintStatus | None = None
        self._joints: dict[str, float] = {}
        self._error: VegaError | None = None
        self._thread: threading.Thread | None = None

    def close(self) -> None:
        if self._thread is not None and self._thread.is_alive():
            self._session.cancel()
            self._thread.join(timeout=ANSWER)
        self._session.close()
        self._stack.close()

    def print(self, folder: Path) -> None:
        if self._thread is not None and self._thread.is_alive():
            raise DriverError("a print is running; stop it first")
        self._session.bring_up()
        self._error, self._status = None, None
        accepted = threading.Event()

        def run() -> None:
            try:
                self._session.execute(
                    ExecutePrint.Goal(folder=str(folder)), lambda _: accepted.set()
                )
            except VegaError as error:
                self._error = error
            finally:
                accepted.set()

        self._thread = threading.Thread(target=run, daemon=True, name="print")
        self._thread.start()
        # A long job takes its time to be checked; the thread ends where the driver dies.
        accepted.wait()
        if self._error is not None:
            raise self._error

    def trigger(self, name: str) -> None:
        done = threading.Event()
        if not self._triggers[name].wait_for_service(ANSWER):
            raise LinkTimeout(f"the driver offers no '{name}' after {ANSWER:g} s")
        future = self._triggers[name].call_async(Trigger.Request())
        future.add_done_callback(lambda _: done.set())
        if not done.wait(ANSWER):
            raise LinkTimeout(f"the driver did not answer '{name}' in {ANSWER:g} s")
        answer: Any = future.result()
        if not answer.success:
            raise DriverError(f"{name}: {answer.message}")

    def state(self) -> JobState:
        status, error = self._status, self._error
        if status is None:
            detail = str(error) if error is not None else ""
            return JobState("fault" if error is not None else "idle", detail=detail)
        state = str(status.state)
        # Between the last status and the end of the action the machine is at rest.
        over = self._thread is None or not self._thread.is_alive()
        if over and state in RUNNING:
            state = "idle"
        detail = status.detail or (str(error) if over and error is not None else "")
        return JobState(
            state=state,
            progress=status.progress,
            path_time_s=max(status.path_time, 0.0),
            time_left_s=status.time_left,
            layer=status.layer,
            path=status.path,
            joints=self._joints,
            dispensing=status.dispenser_on,
            pressure_pa=status.pressure,
            tracking_error_m=status.tracking_error,
            detail=detail,
        )

    def _heard(self, message: PrintStatus) -> None:
        self._status = message

    def _moved(self, message: JointState) -> None:
        self._joints = dict(zip(message.name, message.position))


def _summary(folder: Path) -> dict[str, Any]:
    try:
        values = json.loads((folder / "summary.json").read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise InvalidInput(f"{folder / 'summary.json'} cannot be read: {error}") from error
    return dict(values)
