# SPDX-License-Identifier: Apache-2.0
"""Faults of the line in mid-bead: time to standstill, and to the valve's closing.

The drives are in this process and their time is the frames': the figures come out the same on
any computer.
"""

from __future__ import annotations

import sys
import tempfile
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parent))
from driver_job import beads, bus_file, machine

from vega_robot_driver.dispenser.digital_output import DigitalOutputDispenser
from vega_robot_driver.executor import Executor
from vega_robot_driver.limits import Limits
from vega_robot_driver.motion.bus_config import read_bus_config
from vega_robot_driver.motion.direct_bus import DirectDrives, DirectMotion

DT = 0.002
#: Injected faults, in words and for the line.
INJECTED = {
    "jam": "jam 0",
    "drive fault": "drive_fault 1",
    "safe torque off of one drive": "torque_off 3",
    "emergency stop (all drives)": "emergency_stop",
    "limit switch": "limit_switch 0",
    "unplug after drive 2": "unplug 2",
    "lost frames (20)": "lose_frames 20",
    "wrong counters (5)": "wrong_counters 5",
    "frozen master (300 ms)": "silence 300",
}


def direct(folder: Path) -> tuple[Executor, DirectDrives]:
    """A machine on drives in this process, with clocks and a limit of missed cycles."""
    told = machine()
    config = read_bus_config(bus_file(folder, watchdog_ms=50, sync_error_limit=8))
    drives = DirectDrives(config, DT)
    motion = DirectMotion(
        config.for_joints(told.joint_names, told.lower, told.upper, told.velocity), drives, dt=DT
    )
    limits = ("lower", "upper", "velocity", "acceleration")
    executor = Executor(
        motion, DigitalOutputDispenser(), Limits(*(np.array(getattr(told, k)) for k in limits))
    )
    motion.open()
    executor.enable()
    return executor, drives


def injected(names: Iterable[str] = INJECTED) -> dict[str, dict[str, Any]]:
    """Let faults of the line happen in the middle of a bead."""
    table = {}
    for name in names:
        fault = INJECTED[name]
        with tempfile.TemporaryDirectory() as folder:
            executor, drives = direct(Path(folder))
        executor.load(beads(1, 40e-3))
        executor.run()
        while executor.u < 2.0:
            executor.advance(1)
        assert executor.gate and executor.rate == 1.0
        drives.inject(fault)
        for _ in range(250):
            executor.advance(1)
        told = drives.line.told()
        row = times(told, told["injected"], DT)
        row["state"], row["detail"] = executor.state, executor.detail
        still = told["drives"]
        row["safe"] = executor.state == "fault" and not any(d["outputs"] for d in still)
        table[name] = row
    return table


def times(told: dict[str, Any], began: float, resolution: float) -> dict[str, Any]:
    """Times to standstill and to the closed valve, and how long it was open at standstill."""
    before = told.get("on_at_standstill_before", 0)
    return {
        "standstill_ms": round(1e3 * max(told["last_moving"] - began + resolution, 0.0), 1),
        "valve_closed_ms": round(1e3 * max(told["last_open"] - began + resolution, 0.0), 1),
        "on_at_standstill": told["on_at_standstill"] - before,
    }
