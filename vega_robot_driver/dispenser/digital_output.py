# SPDX-License-Identifier: Apache-2.0
"""A dispenser on a digital output in level mode: open while the output is on.

The output travels with the axes' process data, so that a drive's watchdog clears it when the
bus falls silent. The pressure is set at the dispenser by hand or over its serial line.
"""

from __future__ import annotations

from vega_planner.datatypes import Bools
from vega_robot_driver.dispenser.base import Dispenser


class DigitalOutputDispenser(Dispenser):
    """A valve that follows an output of the motion controller."""

    def __init__(self) -> None:
        self._supply = 0.0

    def open(self) -> None:
        """Nothing to connect: the output is the motion controller's."""

    def set_pressure(self, pressure_pa: float) -> None:
        """Note the pressure [Pa] that is set at the dispenser."""
        self._supply = pressure_pa

    def follow(self, gate: Bools, dt: float) -> float:
        """Tell the set pressure while the valve is open; the device tells nothing back."""
        return self._supply if len(gate) and gate[-1] else 0.0

    def close(self) -> None:
        """The output is cleared with the axes' power."""
