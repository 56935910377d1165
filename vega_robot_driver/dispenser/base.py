# SPDX-License-Identifier: Apache-2.0
"""What every dispenser does: a pressure, and on or off."""

from __future__ import annotations

from abc import ABC, abstractmethod

from vega_planner.datatypes import Bools


class Dispenser(ABC):
    """A pneumatic dispenser.

    Whether material may flow is decided by the real-time process, cycle by cycle; the
    dispenser only follows.
    """

    @abstractmethod
    def open(self) -> None:
        """Connect; the dispenser is off.

        Raises:
            DriverError: If it does not answer.
        """

    @abstractmethod
    def set_pressure(self, pressure_pa: float) -> None:
        """Set the supply pressure [Pa]."""

    @property
    def fault(self) -> str:
        """Why the machine must stop, or nothing."""
        return ""

    def reset_fault(self) -> None:  # noqa: B027 - not every dispenser has one
        """Forget a fault on an explicit request."""

    @abstractmethod
    def follow(self, gate: Bools, dt: float) -> float:
        """Follow the gate through some cycles.

        Args:
            gate: True where it is on, one for each cycle, shape (c,).
            dt: Cycle time [s].

        Returns:
            The pressure in the barrel after the last cycle [Pa]; the set pressure
            where the device does not tell.
        """

    @abstractmethod
    def close(self) -> None:
        """Switch off and leave; safe to call twice."""
