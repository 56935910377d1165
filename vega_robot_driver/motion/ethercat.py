# SPDX-License-Identifier: Apache-2.0
"""Axes of EtherCAT drives after CiA 402: cyclic synchronous position, or torque.

Every cycle checks the working counter and every drive's state; what is wrong stops all axes.
"""

from __future__ import annotations

import json
import time
from dataclasses import replace
from pathlib import Path

import numpy as np

from vega_planner.datatypes import Bools, Floats
from vega_planner.errors import Faulted, InvalidInput
from vega_robot_driver.control.disturbance import DisturbanceMap, Recording
from vega_robot_driver.control.host_control import HostControl
from vega_robot_driver.motion.base import AxisState, Feedback, LinkQuality, MotionController
from vega_robot_driver.motion.bus_config import BusConfig
from vega_robot_driver.motion.cia402 import (
    DISABLE_VOLTAGE,
    FAULT_RESET,
    HOMING_MODE,
    POSITION_MODE,
    QUICK_STOP,
    TORQUE_MODE,
    TOWARDS_ENABLED,
    State,
)
from vega_robot_driver.motion.drive_bus import PATIENCE, TRIES, DriveBus
from vega_robot_driver.motion.homing import HomingRun, attained

#: Share of the offset from the drives' clocks that is taken back in a cycle, and the most [s].
_CLOCK_GAIN, _CLOCK_STEP = 0.02, 20e-6


class EthercatMotion(MotionController):
    """The axes of a bus.

    Args:
        config: The bus, its axes in the order of the joints.
        interface: Network interface.
        dt: Cycle time [s].
        timeout_us: Time a frame may take to come back.
        batched: Whether cycles may be exchanged without pacing (frame-clocked emulation).
        memory: Folder that keeps the homing's number and the calibration, or None.
        bus: The drives, where they are not reached over an interface.
    """

    def __init__(
        self,
        config: BusConfig,
        interface: str,
        *,
        dt: float = 0.002,
        timeout_us: int = 1500,
        batched: bool = False,
        memory: Path | None = None,
        bus: DriveBus | None = None,
    ) -> None:
        self.joint_names = tuple(axis.joint for axis in config.axes)
        self.dt, self.batched = dt, batched
        self._config, self._memory = config, memory
        self._bus = bus or DriveBus(config, interface, dt=dt, timeout_us=timeout_us)
        self._mode = TORQUE_MODE if config.control == "host" else POSITION_MODE
        wired = config.dispenser.axis
        self._valve = self.joint_names.index(wired) if wired else -1
        self._enabled = False
        self._all_enabled = [State.OPERATION_ENABLED] * len(config.axes)
        self._scale = np.array([axis.scale for axis in config.axes])
        self._offset = np.array([axis.offset for axis in config.axes])
        self._homed = not any(axis.homing for axis in config.axes)
        self._homing: HomingRun | None = None
        self._host = HostControl(config.axes, dt) if config.control == "host" else None
        self._recording: Recording | None = None
        self._epoch = self._kept_epoch()

    # -- link -----------------------------------------------------------------------------

    def open(self) -> None:
        """Bring the bus up to operational; the axes stay without power.

        Raises:
            DriverError: If the interface, a drive or its identity is not as configured.
        """
        self._bus.open()
        if self._host is not None and self._memory is not None:
            self._host.disturbance = DisturbanceMap.read(
                self._memory / "disturbance.npz", self.joint_names, self._epoch
            )

    def close(self) -> None:
        """Take the bus down."""
        self._bus.close()

    def abandon(self) -> None:
        """Leave the line without a word, as a killed process does."""
        self._bus.abandon()

    def enable(self) -> Feedback:
        """Power the axes where they are.

        Raises:
            Faulted: Naming the axes that do not come up.
        """
        bus = self._bus
        bus.mode = [self._mode] * len(bus.mode)
        for _ in range(TRIES):
            bus.recover()
            self._homed = self._references_kept()
            if self._climb():
                self._enabled = True
                return self._feedback()
            if State.FAULT in bus.states:
                break
        raise Faulted(f"not enabled: {self._bad_axes()}")

    def _references_kept(self) -> bool:
        """Ask the drives that need homing whether they know where they are."""
        axes, bus = self._config.axes, self._bus
        if not any(axis.homing for axis in axes):
            return True
        bus.mode = [HOMING_MODE if axis.homing else self._mode for axis in axes]
        for _ in range(5):
            self._paced_exchange()
        kept = attained(axes, bus)
        bus.mode = [self._mode] * len(axes)
        for _ in range(3):
            self._paced_exchange()
        return kept

    def _climb(self) -> bool:
        """Lead all drives to operation enabled."""
        bus = self._bus
        if self._host is not None:
            self._host.reset()
        for _ in range(PATIENCE // 4):
            bus.target = list(bus.position)  # nothing moves while they come up
            bus.control = [TOWARDS_ENABLED[state] for state in bus.states]
            self._paced_exchange()
            if all(state is State.OPERATION_ENABLED for state in bus.states):
                return True
            if State.FAULT in bus.states:
                return False
        return False

    def _paced_exchange(self) -> None:
        if not self.batched:
            time.sleep(self.dt)
        self._bus.exchange()

    # -- cycles ---------------------------------------------------------------------------

    def exchange(self, targets: Floats, speeds: Floats, gate: Bools) -> Feedback:
        """Send targets cycle by cycle; stops at the first wrong one."""
        bus, host = self._bus, self._host if self._enabled else None
        follows = self._enabled and host is None
        sent = np.rint((targets - self._offset) * self._scale).astype(np.int64).tolist()
        for number, on in enumerate(gate.tolist()):
            bus.target = sent[number] if follows else list(bus.position)
            if host is not None:
                bus.torque = host.torques(targets[number], speeds[number], bus.position, bus.speed)
            self._open_valve(on)
            fault = self._cycle()
            if self._recording is not None and host is not None:
                self._recording.add(self._feedback().positions, speeds[number], host.force)
            if fault:
                self._open_valve(False)
                return replace(self._feedback(fault), cycles=number)
        return self._feedback()

    def stop_quickly(self) -> Feedback:
        """Quick stop of all drives, valve closed."""
        bus = self._bus
        self._enabled = False
        self._open_valve(False)
        bus.control = [QUICK_STOP] * len(bus.control)
        bus.target = list(bus.position)
        bus.exchange()
        return self._feedback()

    def disable(self) -> None:
        """Take the power from the axes."""
        bus = self._bus
        self._enabled = False
        self._open_valve(False)
        bus.control = [DISABLE_VOLTAGE] * len(bus.control)
        if bus.is_open:
            for _ in range(3):
                bus.exchange()

    def reset_fault(self) -> None:
        """Acknowledge the drives' faults, once."""
        bus = self._bus
        for control in (DISABLE_VOLTAGE, FAULT_RESET, DISABLE_VOLTAGE):
            bus.control = [control] * len(bus.control)
            for _ in range(3):
                bus.exchange()
        bus.wrong_in_a_row = 0
        self._homing = None

    def _cycle(self) -> str:
        """Exchange a frame; says why the machine must stop, or nothing."""
        bus = self._bus
        good = bus.exchange()
        if not good and bus.wrong_in_a_row >= self._config.wrong_counters:
            return f"{bus.wrong_in_a_row} wrong working counters in a row"
        if good and self._enabled and bus.states != self._all_enabled:
            return f"left operation enabled: {self._bad_axes()}"
        if self._enabled and self._host is not None and self._host.astray:
            return f"following error: {self._host.astray}"
        return ""

    def _open_valve(self, on: bool) -> None:
        if self._valve >= 0:
            bit = 1 << self._config.dispenser.bit
            self._bus.outputs[self._valve] = bit if on else 0

    def _feedback(self, fault: str = "") -> Feedback:
        places = np.array(self._bus.position) / self._scale + self._offset
        return Feedback(places, np.array(self._bus.speed) / self._scale, fault)

    # -- homing ---------------------------------------------------------------------------

    @property
    def homed(self) -> bool:
        """Whether every axis knows where it is."""
        return self._homed

    @property
    def homing_epoch(self) -> int:
        """Number of the last homing; axes with absolute encoders keep their reference."""
        return self._epoch

    def home(self) -> None:
        """Begin to home the axes that have a homing method.

        Raises:
            InvalidInput: If the axes are not powered.
        """
        if not any(axis.homing for axis in self._config.axes):
            return
        if not self._enabled:
            raise InvalidInput("cannot home; the axes are not powered")
        self._homed = False
        self._homing = HomingRun(self._config.axes, self._bus, self._mode, self.dt)

    @property
    def homing(self) -> bool:
        """Whether the axes are being homed."""
        return self._homing is not None

    def home_cycles(self, cycles: int) -> Feedback:
        """Go on homing for some cycles."""
        for _ in range(cycles):
            if self._homing is None:
                break
            self._open_valve(False)
            self._homing.command()
            failed = self._cycle() or self._homing.failed()
            if failed:
                self._homing = None
                return self._feedback(failed)
            if self._homing.done():
                self._homing, self._homed = None, True
                self._keep_epoch(self._epoch + 1)
                if self._host is not None:
                    self._host.reset()
        return self._feedback()

    def _kept_epoch(self) -> int:
        try:
            path = (self._memory or Path()) / "homing.json"
            return int(json.loads(path.read_text())["epoch"]) if self._memory else 1
        except (OSError, ValueError, KeyError, TypeError):
            return 1

    def _keep_epoch(self, epoch: int) -> None:
        self._epoch = epoch
        if self._memory is not None:
            fresh = self._memory / "homing.new"
            fresh.write_text(json.dumps({"epoch": epoch}))
            fresh.replace(self._memory / "homing.json")

    # -- calibration ----------------------------------------------------------------------

    def start_recording(self) -> None:
        """Begin to record the force that each axis takes.

        Raises:
            InvalidInput: If the drives close the loops.
        """
        if self._host is None:
            raise InvalidInput(
                "a calibration needs control 'host' in the machine file; it is 'drive'"
            )
        self._recording = Recording(len(self.joint_names))

    def finish_recording(self, *, keep: bool) -> None:
        """End a recording, and make its forces what is fed forward if they are kept."""
        recording, self._recording = self._recording, None
        if recording is None or self._host is None or not keep:
            return
        self._host.disturbance = recording.to_map(self.joint_names, self._epoch)
        if self._memory is not None:
            self._host.disturbance.write(self._memory / "disturbance.npz")

    # -- what is shown --------------------------------------------------------------------

    def axes(self) -> list[AxisState]:
        """Tell the state of each drive."""
        bus = self._bus
        return [
            AxisState(name, state.value, code)
            for name, state, code in zip(self.joint_names, bus.states, bus.errors, strict=True)
        ]

    @property
    def quality(self) -> LinkQuality:
        """Wrong working counters so far, and whose clock the drives run by."""
        clocks = "distributed" if self._bus.clocked else "frames"
        return LinkQuality(wrong_counters=self._bus.wrong, details={"clocks": clocks})

    @property
    def clock_correction(self) -> float:
        """Time by which the next cycle should come later, to stay with the drives' clock [s]."""
        return min(max(-_CLOCK_GAIN * self._bus.clock_offset, -_CLOCK_STEP), _CLOCK_STEP)

    def _bad_axes(self) -> str:
        return ", ".join(
            f"{axis.name} {axis.state}" + (f" (error 0x{axis.code:04X})" if axis.code else "")
            for axis in self.axes()
            if axis.state != State.OPERATION_ENABLED.value
        )
