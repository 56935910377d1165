# SPDX-License-Identifier: Apache-2.0
"""A simulated dispenser: pressure builds up and falls with a first-order lag."""

from __future__ import annotations

from vega_planner.datatypes import Bools
from vega_robot_driver.dispenser.base import Dispenser


class SimulatedDispenser(Dispenser):
    """A barrel behind a valve.

    Args:
        rise_s: Time constant of the build-up; invented, of the order of a 20 ml barrel.
        fall_s: Time constant of the release.
    """

    def __init__(self, *, rise_s: float = 0.03, fall_s: float = 0.02) -> None:
        self._rise, self._fall = rise_s, fall_s
        self._supply = self._pressure = 0.0

    def open(self) -> None:
        """Start without pressure."""
        self._pressure = 0.0

    def set_pressure(self, pressure_pa: float) -> None:
        """Set the supply pressure [Pa]."""
        self._supply = pressure_pa

    def follow(self, gate: Bools, dt: float) -> float:
        """Let the pressure follow the valve."""
        from vega_robot_driver.kernels import build_pressure

        self._pressure = build_pressure(
            self._pressure, gate, self._supply, self._rise, self._fall, dt
        )
        return self._pressure

    def close(self) -> None:
        """Release the pressure."""
        self._pressure = 0.0
