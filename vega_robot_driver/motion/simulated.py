# SPDX-License-Identifier: Apache-2.0
"""Simulated axes: each a second-order lag within speed and acceleration limits.

No noise and no clock: the same targets give the same positions. The axes keep their
positions in a file, as axes with absolute encoders keep theirs without power.
"""

from __future__ import annotations

import json
import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from vega_planner.datatypes import Bools, Floats
from vega_planner.errors import Faulted, InvalidInput
from vega_robot_driver.motion.base import AxisState, Feedback, MotionController


@dataclass(frozen=True)
class AxisModel:
    """Dynamics of the simulated axes; invented, of the order of small direct drives.

    Attributes:
        bandwidth_hz: Natural frequency of the position loop.
        damping_ratio: Damping of the loop.
        forward_ratio: Share of the target's speed that the loop feeds forward; below 1 the
            axis trails its target.
        acceleration: Largest acceleration [m/s², rad/s²].
        steps: Integration steps in a cycle.
    """

    bandwidth_hz: float = 40.0
    damping_ratio: float = 0.8
    forward_ratio: float = 0.9
    acceleration: float = 50.0
    steps: int = 4


class SimulatedMotion(MotionController):
    """Axes in memory.

    Args:
        joint_names: Names of the axes.
        lower: Lowest positions [m, rad], shape (j,).
        upper: Highest positions, shape (j,).
        velocity: Highest speeds, shape (j,).
        start: Positions at the first start, shape (j,).
        dt: Cycle time [s].
        model: Dynamics.
        memory: File that keeps the positions between runs, or None.
    """

    batched = True

    def __init__(
        self,
        joint_names: tuple[str, ...],
        lower: Floats,
        upper: Floats,
        velocity: Floats,
        start: Floats,
        *,
        dt: float = 0.002,
        model: AxisModel | None = None,
        memory: Path | None = None,
    ) -> None:
        self.joint_names = joint_names
        self.dt = dt
        self._model = model or AxisModel()
        joints = len(joint_names)
        acceleration = np.full(joints, self._model.acceleration)
        self._limits = np.array([lower, upper, velocity, acceleration], np.float64)
        if self._limits.shape != (4, joints):
            raise InvalidInput(f"limits of shape {self._limits.shape} for {joints} joints")
        self._position = np.array(start, np.float64)
        self._speed = np.zeros(joints)
        self._memory = memory
        self._epoch = 1
        self._state = "not connected"
        self._injected = ""

    def open(self) -> None:
        """Read where the axes were left."""
        if self._memory and self._memory.is_file():
            try:
                kept = json.loads(self._memory.read_text())
                if tuple(kept["joints"]) == self.joint_names:
                    self._position[:] = kept["positions"]
                    self._epoch = int(kept["epoch"])
            except (ValueError, KeyError, TypeError):
                self._epoch += 1  # the positions are lost, as with a dead encoder battery
        self._state = "switch on disabled"

    def enable(self) -> Feedback:
        """Power the axes."""
        if self._injected:
            raise Faulted(self._injected)
        self._speed[:] = 0.0
        self._state = "operation enabled"
        return Feedback(self._position.copy(), self._speed.copy())

    def exchange(self, targets: Floats, speeds: Floats, gate: Bools) -> Feedback:
        """Move the axes through all cycles."""
        from vega_robot_driver.kernels import move_axes

        model = self._model
        if self._state == "operation enabled":
            move_axes(
                self._position,
                self._speed,
                targets,
                speeds,
                2 * math.pi * model.bandwidth_hz,
                model.damping_ratio,
                model.forward_ratio,
                self._limits,
                self.dt,
                model.steps,
            )
        return Feedback(self._position.copy(), self._speed.copy(), self._injected)

    def stop_quickly(self) -> Feedback:
        """Brake at the acceleration limit for one cycle."""
        change = self._limits[3] * self.dt
        slower = np.sign(self._speed) * np.maximum(np.abs(self._speed) - change, 0.0)
        self._position += 0.5 * (self._speed + slower) * self.dt
        self._speed[:] = slower
        self._state = "quick stop active" if self._speed.any() else "fault"
        return Feedback(self._position.copy(), self._speed.copy(), self._injected)

    def disable(self) -> None:
        """Take the power; the axes stay where they are."""
        self._speed[:] = 0.0
        self._state = "switch on disabled"
        self._keep()

    def close(self) -> None:
        """Keep the positions for the next run."""
        self._keep()
        self._state = "not connected"

    def axes(self) -> list[AxisState]:
        """Tell the state of each axis."""
        return [AxisState(name, self._state) for name in self.joint_names]

    @property
    def homing_epoch(self) -> int:
        """Number of the last homing."""
        return self._epoch

    def home(self) -> None:
        """Home the axes: a new epoch."""
        self._epoch += 1
        self._keep()

    def reset_fault(self) -> None:
        """Forget an injected fault."""
        self._injected = ""
        self._state = "switch on disabled"

    def inject(self, fault: str) -> None:
        """Let an axis fail, for tests and dry runs."""
        self._injected = fault

    def _keep(self) -> None:
        if self._memory is None or self._state == "not connected":
            return
        kept = {
            "joints": list(self.joint_names),
            "positions": self._position.tolist(),
            "epoch": self._epoch,
        }
        fresh = self._memory.with_suffix(".new")
        fresh.write_text(json.dumps(kept))
        fresh.replace(self._memory)
