# SPDX-License-Identifier: Apache-2.0
"""Executing jobs: action `execute_print`, and motion without deposition.

Anything that goes wrong ends the job with the error's code; a machine is never left running
because of a bug here.
"""

from __future__ import annotations

import contextlib
import threading
import time
from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np
import rclpy
from rclpy.action.server import ServerGoalHandle

from vega_msgs.action import ExecutePrint
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
from vega_robot_driver.checkpoint import read_checkpoint
from vega_robot_driver.job import PrintJob
from vega_robot_driver.nodes import follow_joint_trajectory
from vega_robot_driver.nodes.connection import Connection
from vega_robot_driver.nodes.conversions import error_to_msg, feedback_to_msg, job_from_msg
from vega_robot_driver.nodes.topics import Topics
from vega_robot_driver.resume import approach
from vega_robot_driver.status import MachineStatus

if TYPE_CHECKING:
    from rclpy.lifecycle import LifecycleNode


class Printing:
    """Executes one job at a time on the machine.

    Args:
        node: Node whose parameters count and whose logger is used.
        connection: The machine.
        topics: Shows the print.
    """

    def __init__(self, node: LifecycleNode, connection: Connection, topics: Topics) -> None:
        self._node, self._connection, self._topics = node, connection, topics
        self._turn = threading.Lock()

    @property
    def busy(self) -> bool:
        """Whether a job is being executed."""
        return self._turn.locked()

    def execute(self, goal: ServerGoalHandle) -> ExecutePrint.Result:
        """Print a job, to its end or to what ends it."""
        if not self._turn.acquire(blocking=False):
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
            self._node.get_logger().error(str(error))
            error_to_msg(error, result)
            goal.abort()
        except Exception as error:  # a bug must stop the machine and not look like success
            self._node.get_logger().error(f"unexpected {type(error).__name__}: {error}")
            self._stop_on_bug()
            error_to_msg(VegaError(f"unexpected {type(error).__name__}: {error}"), result)
            goal.abort()
        finally:
            self._turn.release()
        return result

    def _stop_on_bug(self) -> None:
        with contextlib.suppress(VegaError):
            self._connection.ask("stop")

    def _print(self, goal: ServerGoalHandle, result: ExecutePrint.Result) -> None:
        link = self._connection.link
        if link is None or link.status().state == "off":
            raise Refused("the driver is not active (ros2 lifecycle set /robot_driver activate)")
        job = job_from_msg(goal.request)
        began = self._load(job, resume=goal.request.resume)
        self._connection.ask("run", override=goal.request.speed_ratio)
        errors = self._watch(goal, result, began)
        if errors:
            result.mean_tracking_error = float(np.mean(errors))
            result.max_tracking_error = float(np.max(errors))

    def _load(self, job: PrintJob, *, resume: bool) -> float:
        """Send a job to the machine; returns the machine's clock at its start."""
        link, robot = self._connection.there
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
        overlap = self._node.get_parameter("overlap_time").value if resume else 0.0
        entry = int(np.searchsorted(job.times, max(start - overlap, 0.0)))
        way = approach(robot, status.positions, job.positions[entry], float(tips[:, 2].max()))
        self._hand_over(job, way, start_u=start, overlap_s=overlap)
        self._topics.begin(job, tips)
        return link.status().clock

    def _hand_over(self, job: PrintJob, way: Floats, **options: float) -> None:
        """Give a job to the machine, with the way to it."""
        link, _ = self._connection.there
        material = self._connection.material
        lead, lag = (material.lead_s, material.lag_s) if material is not None else (0.0, 0.0)
        arrays = {name: getattr(job, name) for name in job.__dataclass_fields__}
        np.savez(link.folder / "job.npz", waypoints=way, **arrays)
        link.ask("load", job="job.npz", lead_s=lead, lag_s=lag, **options)

    def follow(
        self,
        job: PrintJob,
        show: Callable[[MachineStatus], None],
        cancelled: Callable[[], bool],
    ) -> None:
        """Move along a trajectory that begins where the axes are, without deposition."""
        link, _ = self._connection.there
        if not self._turn.acquire(blocking=False):
            raise Busy("another job is being executed; wait for its end or stop it")
        try:
            follow_joint_trajectory.check_start(job, link.status().positions)
            self._hand_over(job, np.zeros((0, len(job.joint_names))))
            self._connection.ask("run")
            told = False
            while (status := link.status()).state != "done":
                show(status)
                if status.state not in ("printing", "pausing", "paused", "stopping"):
                    failed = Cancelled if status.state == "stopped" else Faulted
                    raise failed(f"{status.state}: {status.detail}")
                if not told and cancelled():
                    told = True
                    self._connection.ask("stop")
                time.sleep(0.02)
        finally:
            self._turn.release()

    def _watch(
        self, goal: ServerGoalHandle, result: ExecutePrint.Result, began: float
    ) -> list[float]:
        """Follow a print to its end; cancel and faults end it early."""
        link, _ = self._connection.there
        period = 1.0 / self._node.get_parameter("feedback_rate").value
        errors: list[float] = []
        told, next_feedback = False, 0.0
        while True:
            status = link.status()
            self._note(status, result, began)
            now = time.monotonic()
            if now >= next_feedback:
                next_feedback = now + period
                shown = self._topics.print_status(status)
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
