# SPDX-License-Identifier: Apache-2.0
"""Messages to the driver's values and back. SI throughout."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np
from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticStatus, KeyValue
from geometry_msgs.msg import Point, Vector3
from sensor_msgs.msg import JointState
from trajectory_msgs.msg import JointTrajectory

from vega_msgs.action import ExecutePrint
from vega_msgs.msg import JointPath, PrintStatus
from vega_planner.datatypes import Floats
from vega_planner.errors import InvalidInput, VegaError
from vega_robot_driver.checkpoint import Checkpoint
from vega_robot_driver.job import PrintJob, check_certificate, estimated_velocities, read_job
from vega_robot_driver.status import MachineStatus


def job_from_msg(goal: ExecutePrint.Goal) -> PrintJob:
    """Read the job of a goal and check its certificate.

    Raises:
        InvalidInput: If the goal holds no readable job.
        CertificateMismatch: If the job's certificate is missing or another job's.
    """
    if goal.folder:
        folder = Path(goal.folder)
        if not folder.is_dir():
            raise InvalidInput(f"result folder '{goal.folder}' is not there")
        job, certificate = read_job(folder)
        check_certificate(job, goal.certificate or certificate)
        return job
    if goal.trajectory.times:
        job = job_of_path(goal.trajectory)
        check_certificate(job, goal.certificate)
        return job
    if goal.joint_trajectory.points:
        return job_of_trajectory(goal.joint_trajectory)
    raise InvalidInput("the goal holds no job: neither folder, trajectory nor joint_trajectory")


def job_of_path(msg: JointPath) -> PrintJob:
    """Read a job from flat arrays."""
    joints, count = len(msg.joint_names), len(msg.times)
    if joints == 0 or len(msg.positions) != joints * count:
        raise InvalidInput(
            f"{len(msg.positions)} positions for {count} samples of {joints} joints"
        )
    times = np.array(msg.times)
    positions = np.array(msg.positions).reshape(count, joints)
    if len(msg.velocities) not in (0, joints * count):
        raise InvalidInput(f"{len(msg.velocities)} velocities for {count} samples")
    given = np.array(msg.velocities).reshape(-1, joints)
    return PrintJob(
        joint_names=tuple(msg.joint_names),
        times=times,
        positions=positions,
        velocities=given if len(given) else estimated_velocities(times, positions),
        extrude=np.array(msg.extrude, np.bool_),
        path_id=np.array(msg.path_id, np.int64),
        path_layer=np.array(msg.path_layer, np.int64),
    )


def job_of_trajectory(msg: JointTrajectory) -> PrintJob:
    """Read motion without deposition."""
    joints = len(msg.joint_names)
    times = np.array(
        [p.time_from_start.sec + 1e-9 * p.time_from_start.nanosec for p in msg.points]
    )
    if any(len(p.positions) != joints for p in msg.points):
        raise InvalidInput(f"a point of the joint trajectory has not {joints} positions")
    positions = np.array([p.positions for p in msg.points], np.float64)
    if len(times) and times[0] > 0:  # REP: the first point is reached from where the axes are
        times = times - times[0]
    given = all(len(p.velocities) == joints for p in msg.points)
    return PrintJob(
        joint_names=tuple(msg.joint_names),
        times=times,
        positions=positions,
        velocities=np.array([p.velocities for p in msg.points], np.float64)
        if given
        else estimated_velocities(times, positions),
        extrude=np.zeros(len(times), np.bool_),
        path_id=np.full(len(times), -1),
        path_layer=np.zeros(0, np.int64),
    )


def joint_state_to_msg(status: MachineStatus, names: tuple[str, ...], stamp: Time) -> JointState:
    """Write measured joint positions."""
    msg = JointState(name=list(names), position=status.positions.tolist())
    msg.header.stamp = stamp
    return msg


def print_status_to_msg(
    status: MachineStatus, tip: Floats, axis: Floats, error: float, stamp: Time
) -> PrintStatus:
    """Write where a print stands."""
    return PrintStatus(
        stamp=stamp,
        state=status.state,
        job=status.job,
        progress=status.progress,
        path_time=max(status.u, 0.0),
        speed_ratio=status.rate,
        layer=status.layer,
        path=status.path,
        tip=point_to_msg(tip),
        axis=Vector3(x=float(axis[0]), y=float(axis[1]), z=float(axis[2])),
        tracking_error=error,
        dispenser_on=status.dispenser_on,
        pressure=status.pressure,
        time_left=max(status.duration - max(status.u, 0.0), 0.0),
        detail=status.detail,
    )


def feedback_to_msg(status: PrintStatus) -> ExecutePrint.Feedback:
    """Write the feedback of a print."""
    return ExecutePrint.Feedback(
        progress=status.progress,
        layer=status.layer,
        path=status.path,
        tip=status.tip,
        tracking_error=status.tracking_error,
        pressure=status.pressure,
        time_left=status.time_left,
        speed_ratio=status.speed_ratio,
        dispenser_on=status.dispenser_on,
        state=status.state,
    )


def error_to_msg(
    error: VegaError, result: ExecutePrint.Result | None = None
) -> ExecutePrint.Result:
    """Write an error as a result, into what is known of the print."""
    result = result or ExecutePrint.Result()
    result.error_code, result.error_msg = error.code, str(error)
    return result


def point_to_msg(place: Floats) -> Point:
    """Write a point, shape (3,)."""
    return Point(x=float(place[0]), y=float(place[1]), z=float(place[2]))


def diagnostics_to_msg(
    status: MachineStatus | None,
    axes: list[tuple[str, str, int]],
    hardware: str,
    checkpoint: Checkpoint | None,
    quality: Mapping[str, str] | None = None,
) -> list[DiagnosticStatus]:
    """Write the state of machine, axes and dispenser.

    Args:
        status: The machine's status, None where none ever ran.
        axes: Name, state and error code of each axis.
        hardware: Kind of hardware.
        checkpoint: Last checkpoint, None where there is none.
        quality: What else is known of the bus, by name.
    """
    if status is None:
        text = "not connected"
        if checkpoint is not None and checkpoint.unfinished:
            text = _interrupted(checkpoint)
        return [_diagnostic("robot_driver: machine", hardware, 1, text, {})]
    level = 2 if status.state == "fault" else 1 if status.state == "stopped" else 0
    text = f"{status.state}: {status.detail}" if status.detail else status.state
    if status.state in ("off", "idle") and checkpoint is not None and checkpoint.unfinished:
        level, text = max(level, 1), f"{text}; {_interrupted(checkpoint)}"
    p50, p99, top = (f"{value * 1e6:.0f}" for value in status.lateness)
    machine = {
        "job": status.job[:12],
        "path_time_s": f"{status.u:.3f}",
        "speed_ratio": f"{status.rate:.3f}",
        "cycles": str(status.cycles),
        "overruns": str(status.overruns),
        "wrong_working_counters": str(status.wrong_counters),
        "lateness_us_p50": p50,
        "lateness_us_p99": p99,
        "lateness_us_max": top,
        "homing_epoch": str(status.homing_epoch),
        **(quality or {}),
    }
    if checkpoint is not None:
        machine["checkpoint_state"] = checkpoint.state
        machine["checkpoint_path_time_s"] = f"{checkpoint.done:.3f}"
        machine["checkpoint_reason"] = checkpoint.reason
    dispenser = {
        "pressure_pa": f"{status.pressure:.0f}",
        "cycles_on_at_standstill": str(status.idle_on_cycles),
    }
    found = [_diagnostic("robot_driver: machine", hardware, level, text, machine)]
    on = "on" if status.dispenser_on else "off"
    found.append(_diagnostic("robot_driver: dispenser", hardware, 0, on, dispenser))
    for index, (name, state, code) in enumerate(axes):
        bad = 2 if code or "fault" in state else 0
        values = {"error_code": f"0x{code:04X}"}
        if index < len(status.positions):
            error = status.targets[index] - status.positions[index]
            values["position"] = f"{status.positions[index]:.6f}"
            values["following_error"] = f"{error:.6f}"
        found.append(_diagnostic(f"robot_driver: {name}", hardware, bad, state, values))
    return found


def _interrupted(checkpoint: Checkpoint) -> str:
    return (
        f"print {checkpoint.job[:12]} was interrupted at {checkpoint.done:.3f} s after "
        f"{checkpoint.paths_done} passes, dispenser off; send it again with resume to go on"
    )


def _diagnostic(
    name: str, hardware: str, level: int, text: str, values: dict[str, str]
) -> DiagnosticStatus:
    return DiagnosticStatus(
        name=name,
        hardware_id=hardware,
        level=bytes([level]),
        message=text,
        values=[KeyValue(key=key, value=value) for key, value in values.items()],
    )
