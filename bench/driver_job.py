# SPDX-License-Identifier: Apache-2.0
"""The job and the machine that the driver's benchmarks run: straight beads at 5 mm/s."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import yaml

ROOT = Path(__file__).resolve().parent.parent
sys.path[:0] = [str(ROOT)]

from vega_planner.robot.robot import load_robot
from vega_robot_driver.job import PrintJob
from vega_robot_driver.machine import Machine

JOINTS = ("x_axis", "y_axis", "z_axis", "a_axis", "b_axis")
SPEED = 5e-3
PITCH = 1.2e-3
BUS = ROOT / "config" / "machines" / "emulated.yaml"


def beads(passes: int = 4, length: float = 10e-3, travel_s: float = 0.4) -> PrintJob:
    """Parallel beads along x, to and fro, each at a steady 5 mm/s from end to end.

    Args:
        passes: Number of beads.
        length: Their length [m].
        travel_s: Time from one to the next.
    """
    times, rows, rates, extrude, path = [0.0], [[-1e-3, 0.0]], [[0.0, 0.0]], [False], [-1]
    for k in range(passes):
        sign = 1.0 if k % 2 == 0 else -1.0
        begin, end = (0.0, length) if sign > 0 else (length, 0.0)
        for duration, x, on in ((travel_s, begin, False), (length / SPEED, end, True)):
            times.append(times[-1] + duration)
            rows.append([x, PITCH * k])
            rates.append([sign * SPEED, 0.0])
            extrude.append(on)
            path.append(k if on else -1)
    times.append(times[-1] + travel_s)
    rows.append([rows[-1][0] + 0.5 * travel_s * rates[-1][0], rows[-1][1]])
    rates.append([0.0, 0.0])
    extrude.append(False)
    path.append(-1)
    count = len(times)
    positions, velocities = np.zeros((count, 5)), np.zeros((count, 5))
    positions[:, :2], velocities[:, :2] = rows, rates
    positions[:, 2] = -0.05
    return PrintJob(
        joint_names=JOINTS,
        times=np.array(times),
        positions=positions,
        velocities=velocities,
        extrude=np.array(extrude),
        path_id=np.array(path),
        path_layer=np.zeros(passes, np.int64),
    )


def machine(**changes: object) -> Machine:
    """The shipped robot on emulated drives."""
    robot = load_robot("vega5")
    values: dict = {
        "hardware": "emulated",
        "joint_names": robot.joint_names,
        "lower": tuple(robot.lower.tolist()),
        "upper": tuple(robot.upper.tolist()),
        "velocity": tuple(robot.velocity.tolist()),
        "acceleration": tuple(robot.acceleration.tolist()),
        "start": (0.0,) * 5,
        **changes,
    }
    return Machine(**values)


def bus_file(folder: Path, *, dispenser: dict | None = None, **changes: object) -> Path:
    """The shipped machine file with other values of the bus, or another dispenser."""
    content = yaml.safe_load(BUS.read_text(encoding="utf-8"))
    content["bus"] |= changes
    content["dispenser"] = dispenser or content["dispenser"]
    path = folder / "bus.yaml"
    path.write_text(yaml.safe_dump(content), encoding="utf-8")
    return path
