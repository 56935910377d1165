# SPDX-License-Identifier: Apache-2.0
"""What every motion controller does: hold, follow targets, stop. SI units."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass, field

from vega_planner.datatypes import Bools, Floats
from vega_planner.errors import InvalidInput


@dataclass(frozen=True)
class AxisState:
    """One axis, as diagnostics show it.

    Attributes:
        name: Name of the joint.
        state: State in words ("operation enabled", "fault", ...).
        code: The drive's own error code, 0 for none.
    """

    name: str
    state: str
    code: int = 0


@dataclass(frozen=True, eq=False)
class Feedback:
    """What came back from the last cycle of an exchange.

    Attributes:
        positions: Joint positions [m, rad], shape (j,).
        velocities: Joint velocities [m/s, rad/s], shape (j,).
        fault: Why the machine must stop, or empty.
        cycles: Cycles that took place before the fault; None where all did.
    """

    positions: Floats
    velocities: Floats
    fault: str = ""
    cycles: int | None = None


@dataclass
class LinkQuality:
    """How well the bus works.

    Attributes:
        wrong_counters: Cycles with a wrong working counter.
        details: Anything else worth showing, by name.
    """

    wrong_counters: int = 0
    details: dict[str, str] = field(default_factory=dict)


class MotionController(ABC):
    """A group of axes that follows position targets cycle by cycle.

    Attributes:
        joint_names: Names of the axes, shape (j,).
        dt: Cycle time [s].
        batched: Whether many cycles may be exchanged in one call (simulation).
        waits: Whether the axes wait for a cycle that comes late (emulation).
    """

    joint_names: tuple[str, ...]
    dt: float
    batched: bool = False
    waits: bool = False

    @abstractmethod
    def open(self) -> None:
        """Bring the link up; the axes stay without power.

        Raises:
            DriverError: If it cannot be done, saying what is missing.
        """

    @abstractmethod
    def enable(self) -> Feedback:
        """Power the axes and hold them where they are.

        Returns:
            Where they are.

        Raises:
            Faulted: If an axis does not come up.
        """

    @abstractmethod
    def exchange(self, targets: Floats, speeds: Floats, gate: Bools) -> Feedback:
        """Send targets and get positions back.

        Args:
            targets: Joint targets [m, rad], a row for each cycle, shape (c, j).
            speeds: Their velocities [m/s, rad/s], shape (c, j).
            gate: Dispenser outputs, shape (c,).

        Returns:
            The state after the last cycle.
        """

    @abstractmethod
    def stop_quickly(self) -> Feedback:
        """Stop all axes as fast as the drives allow, dispenser off; called every cycle."""

    @abstractmethod
    def disable(self) -> None:
        """Take the power from the axes."""

    @abstractmethod
    def close(self) -> None:
        """Leave the link; safe to call twice."""

    @abstractmethod
    def axes(self) -> list[AxisState]:
        """Tell the state of each axis."""

    @property
    def quality(self) -> LinkQuality:
        """How well the link works."""
        return LinkQuality()

    @property
    def homing_epoch(self) -> int:
        """Number that changes whenever the axes may have lost their reference."""
        return 0

    @property
    def homed(self) -> bool:
        """Whether every axis knows where it is."""
        return True

    def home(self) -> None:  # noqa: B027 - axes with absolute encoders have nothing to do
        """Begin to find the reference of the axes that have none."""

    @property
    def homing(self) -> bool:
        """Whether the axes are being homed."""
        return False

    def home_cycles(self, cycles: int) -> Feedback:
        """Go on homing for some cycles.

        Raises:
            InvalidInput: If the axes have nothing to find.
        """
        raise InvalidInput("these axes know where they are; there is nothing to home")

    @property
    def clock_correction(self) -> float:
        """Time by which the next cycle should come later [s]."""
        return 0.0

    def start_recording(self) -> None:
        """Begin to record the force that each axis takes.

        Raises:
            InvalidInput: If the forces are not known here.
        """
        raise InvalidInput("these axes do not tell their forces; calibration needs host control")

    def finish_recording(self, *, keep: bool) -> None:  # noqa: B027 - see start_recording
        """End a recording, and make its forces what is fed forward if they are kept."""

    def reset_fault(self) -> None:  # noqa: B027 - not every controller latches one
        """Clear a fault on an explicit request."""
