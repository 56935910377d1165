# SPDX-License-Identifier: Apache-2.0
"""What a client may ask of a machine, by the name of the operation."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from vega_planner.errors import InvalidInput
from vega_robot_driver.control.calibration import calibration_job, dry_job
from vega_robot_driver.executor import Executor
from vega_robot_driver.job import PrintJob
from vega_robot_driver.machine import Machine


class Operations:
    """Operations on an executor.

    Args:
        executor: The executor.
        machine: Description of the machine.
        folder: State folder, in which jobs are handed over.
        end: Ends the process.
    """

    def __init__(
        self, executor: Executor, machine: Machine, folder: Path, end: Callable[[], None]
    ) -> None:
        self._executor, self._machine, self._folder, self._end = executor, machine, folder, end
        self._calibrating = False

    def prepare(self, request: dict[str, Any]) -> Callable[[], dict[str, Any]]:
        """Do the slow part of a request; what it returns runs between two cycles."""
        executor, op = self._executor, request.get("op")
        if op == "load":
            with np.load(self._folder / request["job"], allow_pickle=False) as file:
                arrays = {name: file[name] for name in file.files}
            way = arrays.pop("waypoints")
            arrays["joint_names"] = tuple(str(name) for name in arrays["joint_names"])
            job = PrintJob(**arrays)
            job.digest()
            executor.check_job(job)
            keys = ("start_u", "lead_s", "lag_s", "overlap_s")
            options = {key: float(request.get(key, 0.0)) for key in keys}
            return lambda: _done(lambda: executor.load(job, waypoints=way, **options))
        if op == "move":
            goal = np.array(request["positions"], np.float64)
            return lambda: _done(lambda: self._move(goal, float(request["speed_ratio"])))
        if op == "pressure":  # a serial line takes longer than a cycle
            executor.dispenser.set_pressure(float(request["pascal"]))
            return dict
        if op == "calibrate":
            calibration = self._calibration(request)
            return lambda: _done(lambda: self._calibrate(calibration))
        simple: dict[str, Callable[[], Any]] = {
            "enable": executor.enable,
            "disable": executor.disable,
            "pause": executor.pause,
            "resume": executor.resume,
            "stop": executor.stop,
            "reset_fault": executor.reset_fault,
            "home": executor.home,
            "shutdown": self._end,
            "run": lambda: executor.run(float(request.get("override", 1.0))),
            "override": lambda: setattr(
                executor, "override", min(max(float(request["ratio"]), 0.05), 1.0)
            ),
            "inject": lambda: self._inject(str(request["fault"])),
        }
        if op not in (*simple, "axes", "hello"):
            raise InvalidInput(f"unknown request '{op}'; has: {', '.join(sorted(simple))}")
        if op in ("axes", "hello"):
            return self._describe
        return lambda: _done(simple[str(op)])

    def _describe(self) -> dict[str, Any]:
        motion = self._executor.motion
        return {
            "pid": os.getpid(),
            "hardware": self._machine.hardware,
            "axes": [[axis.name, axis.state, axis.code] for axis in motion.axes()],
            "quality": {**motion.quality.details},
        }

    def _move(self, goal: np.ndarray, ratio: float) -> None:
        """Load and start a slow straight joint move."""
        executor = self._executor
        here = executor.positions
        names, rest = executor.motion.joint_names, np.zeros(len(here))
        job = dry_job(names, [0.0, 0.01], [goal, goal], [rest, rest])
        executor.load(job)
        executor.digest = ""
        executor.run(ratio)

    def _calibration(self, request: dict[str, Any]) -> PrintJob:
        """Make the run that records the axes' disturbance; by default over most of each axis."""
        executor, limits = self._executor, self._executor.limits
        inset = 0.05 * (limits.upper - limits.lower)
        lower = np.array(request.get("lower", limits.lower + inset), np.float64)
        upper = np.array(request.get("upper", limits.upper - inset), np.float64)
        speeds = np.array(request.get("speeds", 0.01 * limits.velocity), np.float64)
        names = executor.motion.joint_names
        job = calibration_job(names, executor.positions.copy(), lower, upper, speeds)
        executor.check_job(job)
        return job

    def _calibrate(self, job: PrintJob) -> None:
        executor = self._executor
        executor.load(job)
        executor.digest = ""
        executor.motion.start_recording()
        executor.run()
        self._calibrating = True

    def watch_calibration(self) -> None:
        """Keep what a calibration recorded, once it is done."""
        if self._calibrating and self._executor.state != "printing":
            self._calibrating = False
            self._executor.motion.finish_recording(keep=self._executor.state == "done")

    def _inject(self, fault: str) -> None:
        inject = getattr(self._executor.motion, "inject", None)
        if inject is None:
            raise InvalidInput(f"{self._machine.hardware} hardware takes no injected faults")
        inject(fault)


def _done(work: Callable[[], Any]) -> dict[str, Any]:
    work()
    return {}
