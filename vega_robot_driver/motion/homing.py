# SPDX-License-Identifier: Apache-2.0
"""Homing by the drives themselves (CiA 402-2, homing mode), one axis after the other."""

from __future__ import annotations

from collections.abc import Sequence

from vega_robot_driver.motion.bus_config import BusAxis
from vega_robot_driver.motion.cia402 import HOMING_MODE, TOWARDS_ENABLED, State
from vega_robot_driver.motion.drive_bus import DriveBus

#: Bits of the status word in homing mode.
TARGET_REACHED, ATTAINED, FAILED = 1 << 10, 1 << 12, 1 << 13
START = 1 << 4
#: Cycles for which an axis stays in each mode before it is asked something.
_SETTLE = 5


def attained(axes: Sequence[BusAxis], bus: DriveBus) -> bool:
    """Tell whether all drives in homing mode say that they have their reference."""
    return all(
        bus.status[number] & ATTAINED
        for number, axis in enumerate(axes)
        if axis.homing is not None
    )


class HomingRun:
    """A homing of all axes that need one, in the order of the file's joints.

    Args:
        axes: The axes.
        bus: Their drives, powered.
        mode: Mode of operation to come back to.
        dt: Cycle time [s].
    """

    def __init__(self, axes: Sequence[BusAxis], bus: DriveBus, mode: int, dt: float) -> None:
        self._bus, self._mode, self._dt = bus, mode, dt
        self._axes = axes
        self._left = [number for number, axis in enumerate(axes) if axis.homing is not None]
        self._cycles = 0
        self._leaving = 0

    def command(self) -> None:
        """Set what the drives are told in the next cycle."""
        bus = self._bus
        bus.target = list(bus.position)
        bus.torque = [0] * len(bus.torque)
        bus.control = [TOWARDS_ENABLED[State.OPERATION_ENABLED]] * len(bus.control)
        bus.mode = [self._mode] * len(bus.mode)
        self._cycles += 1
        if self._leaving:
            self._leaving -= 1
        elif self._left:
            number = self._left[0]
            bus.mode[number] = HOMING_MODE
            if self._cycles > _SETTLE:
                bus.control[number] |= START

    def failed(self) -> str:
        """Say what went wrong, or nothing."""
        if not self._left:
            return ""
        number = self._left[0]
        axis = self._axes[number]
        assert axis.homing is not None
        if self._cycles > 2 * _SETTLE and self._bus.status[number] & FAILED:
            return f"homing of {axis.joint} failed (status 0x{self._bus.status[number]:04X})"
        if self._cycles * self._dt > axis.homing.timeout_s:
            return f"homing of {axis.joint} took more than {axis.homing.timeout_s:g} s"
        return ""

    def done(self) -> bool:
        """Look at the last cycle; true when all axes have their reference."""
        if self._left and self._cycles > 2 * _SETTLE:
            status = self._bus.status[self._left[0]]
            if status & ATTAINED and status & TARGET_REACHED:
                self._left.pop(0)
                self._cycles, self._leaving = 0, _SETTLE
        return not self._left and not self._leaving
