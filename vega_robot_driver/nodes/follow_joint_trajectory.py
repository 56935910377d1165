# SPDX-License-Identifier: Apache-2.0
"""Action `follow_joint_trajectory`, where control_msgs is installed (a full ROS 2 has it).

For tools that send motion without deposition, as MoveIt and rqt do.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from builtin_interfaces.msg import Duration
from rclpy.action import ActionServer, CancelResponse
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

from vega_planner.errors import Cancelled, Faulted, InvalidInput, LinkTimeout, VegaError
from vega_robot_driver.job import PrintJob
from vega_robot_driver.nodes.conversions import job_of_trajectory
from vega_robot_driver.status import MachineStatus

#: Largest distance between the axes and a trajectory's first point [m, rad].
START_TOLERANCE = 2e-3
#: Runs a job, shows its status and asks whether it is cancelled.
Run = Callable[[PrintJob, Callable[[MachineStatus], None], Callable[[], bool]], None]


def offer(node: Any, group: Any, names: Callable[[], tuple[str, ...]], run: Run) -> Any:
    """Start the action server; None where control_msgs is not installed.

    Args:
        node: The driver's node.
        group: Its callback group.
        names: Tells the robot's joints.
        run: Executes a job.
    """
    try:
        from control_msgs.action import FollowJointTrajectory
    except ImportError:
        return None

    def execute(goal: Any) -> Any:
        result = FollowJointTrajectory.Result()

        def show(status: MachineStatus) -> None:
            feedback = FollowJointTrajectory.Feedback(joint_names=list(names()))
            feedback.header.stamp = node.get_clock().now().to_msg()
            feedback.desired = _point(status.targets, status.u)
            feedback.actual = _point(status.positions, status.u)
            feedback.error = _point(status.targets - status.positions, status.u)
            goal.publish_feedback(feedback)

        try:
            run(
                ordered_job(goal.request.trajectory, names()),
                show,
                lambda: goal.is_cancel_requested,
            )
            goal.succeed()
        except Cancelled as error:
            result.error_string = str(error)
            goal.canceled() if goal.is_cancel_requested else goal.abort()
        except (Faulted, LinkTimeout) as error:  # it had begun
            result.error_code = result.PATH_TOLERANCE_VIOLATED
            result.error_string = str(error)
            goal.abort()
        except VegaError as error:
            result.error_code, result.error_string = result.INVALID_GOAL, str(error)
            goal.abort()
        return result

    return ActionServer(
        node,
        FollowJointTrajectory,
        "follow_joint_trajectory",
        execute,
        callback_group=group,
        cancel_callback=lambda _: CancelResponse.ACCEPT,
    )


def ordered_job(trajectory: JointTrajectory, names: tuple[str, ...]) -> PrintJob:
    """Read a trajectory whose joints may come in another order.

    Raises:
        InvalidInput: If it does not move the robot's joints.
    """
    if sorted(trajectory.joint_names) != sorted(names):
        raise InvalidInput(
            f"the trajectory moves {', '.join(trajectory.joint_names)}; the robot has "
            f"{', '.join(names)}"
        )
    job = job_of_trajectory(trajectory)
    order = [job.joint_names.index(name) for name in names]
    return PrintJob(
        joint_names=names,
        times=job.times,
        positions=job.positions[:, order],
        velocities=job.velocities[:, order],
        extrude=job.extrude,
        path_id=job.path_id,
        path_layer=job.path_layer,
    )


def check_start(job: PrintJob, positions: np.ndarray) -> None:
    """Refuse a trajectory that does not begin where the axes are.

    Raises:
        InvalidInput: Naming the joint.
    """
    gap = np.abs(job.positions[0] - positions)
    if gap.max() > START_TOLERANCE:
        k = int(gap.argmax())
        raise InvalidInput(
            f"the trajectory begins with {job.joint_names[k]} at {job.positions[0][k]:g}, "
            f"which is at {positions[k]:g}; allowed: {START_TOLERANCE:g}"
        )


def _point(values: np.ndarray, seconds: float) -> JointTrajectoryPoint:
    whole = int(max(seconds, 0.0))
    return JointTrajectoryPoint(
        positions=values.tolist(),
        time_from_start=Duration(sec=whole, nanosec=int((max(seconds, 0.0) - whole) * 1e9)),
    )
