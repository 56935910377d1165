# SPDX-License-Identifier: Apache-2.0
"""Tracking of the loops that the computer closes, with and without recorded disturbances.

On emulated axes with cogging, friction, gravity and force noise: an emulation's figures,
not a machine's.
"""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path
from typing import Any

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parent))
from driver_job import JOINTS, ROOT, SPEED, machine

from vega_robot_driver.control.calibration import calibration_job, dry_job
from vega_robot_driver.dispenser.digital_output import DigitalOutputDispenser
from vega_robot_driver.executor import Executor
from vega_robot_driver.job import PrintJob
from vega_robot_driver.limits import Limits
from vega_robot_driver.motion.bus_config import read_bus_config
from vega_robot_driver.motion.direct_bus import DirectDrives, DirectMotion

DT = 0.002
BUS = ROOT / "config" / "machines" / "emulated_host.yaml"
#: Ways of the test and of the calibration around the middle of each linear axis [m].
WAY, CALIBRATED = 10e-3, 13e-3
MIDDLE = np.array([0.0, 0.0, -0.05, 0.0, 0.0])


def host_machine(folder: Path) -> tuple[Executor, DirectMotion]:
    told = machine()
    config = read_bus_config(BUS).for_joints(
        told.joint_names, told.lower, told.upper, told.velocity
    )
    drives = DirectDrives(config, DT)
    for slave, middle in zip(drives.line.segment.slaves, MIDDLE, strict=True):
        slave.drive.axis.position = middle * abs(config.axes[0].scale)
    motion = DirectMotion(config, drives, dt=DT, memory=folder)
    motion.open()
    limits = ("lower", "upper", "velocity", "acceleration")
    executor = Executor(
        motion, DigitalOutputDispenser(), Limits(*(np.array(getattr(told, k)) for k in limits))
    )
    executor.enable()
    return executor, motion


def to_and_fro(here: np.ndarray, rounds: int) -> PrintJob:
    """Move the linear axes together by WAY and back, each at a steady 5 mm/s."""
    run_up = 0.1
    cruise = WAY / SPEED - run_up
    times, rows, rates = [0.0], [here.copy()], [np.zeros(5)]
    for sign in (1.0, -1.0) * rounds:
        for duration, step, rate in (
            (0.5, 0.0, 0.0),
            (run_up, 0.5 * SPEED * run_up, SPEED),
            (cruise, SPEED * cruise, SPEED),
            (run_up, 0.5 * SPEED * run_up, 0.0),
        ):
            row, speed = rows[-1].copy(), np.zeros(5)
            row[:3] += sign * step
            speed[:3] = sign * rate
            times.append(times[-1] + duration)
            rows.append(row)
            rates.append(speed)
    return dry_job(JOINTS, times, rows, rates)


def run(executor: Executor, job: PrintJob) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Path times, targets and the positions found at their time, while the path runs."""
    executor.load(job)
    executor.run()
    rows = []
    while executor.state == "printing":
        executor.advance(1)
        rows.append((executor.u, executor.targets, executor.positions))
    if executor.state != "done":
        raise SystemExit(f"the run ended: {executor.state} {executor.detail}")
    u = np.array([row[0] for row in rows])
    targets, found = (np.array([row[k] for row in rows]) for k in (1, 2))
    inside = u[:-1] >= 0.0  # what a cycle reports is what the last one reached
    return u[:-1][inside], targets[:-1][inside], found[1:][inside]


def figures(executor: Executor, rounds: int) -> dict[str, Any]:
    """Tracking error and repeatability of the linear axes while they move at 5 mm/s."""
    job = to_and_fro(executor.positions.copy(), rounds + 1)
    u, targets, found = run(executor, job)
    period = job.duration_s / (rounds + 1)
    speed = np.abs(np.gradient(targets[:, 0], DT))
    steady = (speed > 0.99 * SPEED) & (u > period)  # the first round warms up
    error = (found - targets)[:, :3]
    # The same target of every round, in the same direction.
    phase = np.round((u % period) / DT).astype(int)
    spread = []
    for step in np.unique(phase[steady])[::10]:
        same = error[steady & (phase == step)]
        if len(same) >= rounds - 1:
            spread.append(2.0 * same.std(axis=0, ddof=1))
    return {
        "mean_abs_error_um": (np.abs(error[steady]).mean(0) * 1e6).round(2).tolist(),
        "worst_error_um": (np.abs(error[steady]).max(0) * 1e6).round(2).tolist(),
        "repeatability_2_sigma_um": (np.mean(spread, axis=0) * 1e6).round(2).tolist(),
    }


def measured(rounds: int = 6) -> dict[str, Any]:
    """The same PID in one run: as it is, then with the disturbance recorded and fed forward."""
    with tempfile.TemporaryDirectory() as scratch:
        executor, motion = host_machine(Path(scratch))
        executor.advance(500)
        plain = figures(executor, rounds)
        here = executor.positions.copy()
        way = np.array([CALIBRATED, CALIBRATED, CALIBRATED, 0.04, 0.04])
        lower, upper = here - 0.2 * way, here + way
        lower, upper = np.maximum(lower, machine().lower), np.minimum(upper, machine().upper)
        speeds = np.array([SPEED, SPEED, SPEED, 0.05, 0.05])
        motion.start_recording()
        run(executor, calibration_job(JOINTS, here, lower, upper, speeds))
        motion.finish_recording(keep=True)
        return {"pid": plain, "pid_with_disturbance": figures(executor, rounds)}


if __name__ == "__main__":
    import json

    print(json.dumps(measured(), indent=2))
