# SPDX-License-Identifier: Apache-2.0
"""A PID on each axis, with mass and recorded disturbance fed forward.

The force of an axis is

    F = m a + d(q, v) + kp e + ki ∫ e dt + kd (v - v_measured)

with q, v, a the target and its derivatives, e the position error, and d the disturbance that
a calibration run recorded along the axis: cogging, gravity and friction. Without a
calibration d is 0 and the same PID has to do without it.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from vega_planner.datatypes import Floats
from vega_robot_driver.control.disturbance import DisturbanceMap
from vega_robot_driver.motion.bus_config import BusAxis

#: Time outside the following-error window after which an axis is astray [s].
PATIENCE_S = 0.02


class HostControl:
    """The loops of all axes.

    Args:
        axes: The axes, each with what its loop takes.
        dt: Cycle time [s].

    Attributes:
        disturbance: What is fed forward; None before a calibration.
        force: Forces of the last cycle [N, Nm], shape (j,).
        error: Position errors of the last cycle [m, rad], shape (j,).
    """

    def __init__(self, axes: Sequence[BusAxis], dt: float) -> None:
        host = [axis.host for axis in axes]
        self._names = [axis.joint for axis in axes]
        self._scale = np.array([axis.scale for axis in axes])
        self._offset = np.array([axis.offset for axis in axes])
        self._mass, self._kp, self._ki, self._kd, self._most, rated = (
            np.array([getattr(one, name) for one in host], np.float64)
            for name in ("mass", "kp", "ki", "kd", "most", "rated")
        )
        self._per_mille = np.sign(self._scale) * 1000.0 / rated
        self._window = np.array([axis.following_error for axis in axes]) / np.abs(self._scale)
        self._dt = dt
        self.disturbance: DisturbanceMap | None = None
        self.force = np.zeros(len(axes))
        self.error = np.zeros(len(axes))
        self.reset()

    def reset(self) -> None:
        """Forget the past: the next target is where the axes are."""
        self._integral = np.zeros(len(self._names))
        self._sent: list[tuple[Floats, Floats]] = []
        self._speed = np.zeros(len(self._names))
        self._outside = np.zeros(len(self._names))

    def torques(
        self, target: Floats, speed: Floats, position: Sequence[int], measured: Sequence[int]
    ) -> list[int]:
        """Find what each drive is told in this cycle.

        Args:
            target: Where the axes should be at the end of the cycle [m, rad], shape (j,).
            speed: How fast they should then be, shape (j,).
            position: Where the last frame found them: at the beginning of the last cycle
                [increments].
            measured: How fast they were then [increments/s].

        Returns:
            Torques in per mille of the drives' rated torque (object 6071).
        """
        here = np.array(position) / self._scale + self._offset
        fast = np.array(measured) / self._scale
        # What was read last is older than what was sent last, by a cycle.
        wanted, pace = self._sent[0] if self._sent else (here, np.zeros_like(here))
        self.error = wanted - here
        forward = self._mass * (speed - self._speed) / self._dt
        if self.disturbance is not None:
            forward = forward + self.disturbance(target, speed)
        force = forward + self._kp * self.error + self._integral + self._kd * (pace - fast)
        self.force = np.minimum(np.maximum(force, -self._most), self._most)
        free = force == self.force  # no winding up against the limit
        self._integral = self._integral + free * self._ki * self.error * self._dt
        outside = np.abs(self.error) > self._window
        self._outside = np.where(outside, self._outside + self._dt, 0.0)
        self._sent = [*self._sent[-1:], (target.copy(), speed.copy())]
        self._speed = self._sent[-1][1]
        return [int(value) for value in np.rint(self.force * self._per_mille)]

    @property
    def astray(self) -> str:
        """Name the axis that has been outside its window for too long, or nothing."""
        worst = int(self._outside.argmax())
        if self._outside[worst] < PATIENCE_S:
            return ""
        return (
            f"{self._names[worst]} is {abs(self.error[worst]):.6f} from its target; "
            f"window {self._window[worst]:.6f}"
        )
